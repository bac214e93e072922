//! What is known of detectors: where their maxima lie, and what they leave out.

#![allow(clippy::cast_possible_truncation, reason = "grey values, drawn here")]

use std::f64::consts::PI;

use cornerbench::detect::chess::Chess;
use cornerbench::detect::deriche_giraudon::DericheGiraudon;
use cornerbench::detect::harris::Harris;
use cornerbench::detect::hessian_determinant::HessianDeterminant;
use cornerbench::detect::tensor::{Derivative, StructureTensor, TensorBuffers, Window};
use cornerbench::detect::{DETECTORS, Detection, Detector, Peaks, Scratch};
use cornerbench::filter::Border;
use cornerbench::geometry::ImagePoint;
use cornerbench::image::{Plane, View};
use cornerbench::junction::BlurredJunction;
use cornerbench::sensor::{Encoding, Exposure, Transfer};
use toml::Table;

use crate::drawn::{grey, texture};

const SIZE: usize = 81;
const VERTEX: ImagePoint = ImagePoint { x: 40.3, y: 39.8 };
/// Grey values of an image's sectors: those of a cuboid's faces and of the ground.
const LEVELS: [f64; 3] = [150.0, 90.0, 30.0];

/// An image of a junction, its grey values whole numbers.
fn drawn(junction: &BlurredJunction) -> Exposure {
    grey(Plane::from_fn(SIZE, SIZE, |x, y| junction.over_pixel(x, y, 1.0).round() as f32))
}

/// An L that opens by `opening_deg`, its bisector towards `turn_deg`.
fn l(opening_deg: f64, turn_deg: f64, sigma_px: f64) -> BlurredJunction {
    let [opening, turn] = [opening_deg, turn_deg].map(f64::to_radians);
    BlurredJunction::l(VERTEX, [turn - 0.5 * opening, opening], [200.0, 40.0], sigma_px)
}

/// Three edges a third of a turn apart.
fn y() -> BlurredJunction {
    let edges = [0.3, 0.3 + 2.0 * PI / 3.0, 0.3 + 4.0 * PI / 3.0];
    BlurredJunction::y_or_arrow(VERTEX, edges, LEVELS, 0.8)
}

/// An edge that ends at a straight one.
fn t() -> BlurredJunction {
    BlurredJunction::t(VERTEX, [0.3, 0.5 * PI], LEVELS, 0.8)
}

/// Harris as the known figures have it: no smoothing but the window's.
fn harris(k: f64) -> Harris {
    let peaks = Peaks { threshold_rel: 0.0, ..Peaks::default() };
    Harris { k, peaks, ..Harris::default() }
}

/// The strongest within 8 px of the vertex.
fn strongest(detector: &dyn Detector, exposure: &Exposure) -> Option<Detection> {
    let found = detector.detect(exposure, None);
    found.into_iter().find(|detection| detection.point.distance_px(VERTEX) < 8.0)
}

// ---- Known facts --------------------------------------------------------------------------------------------

/// 0.9 to 4.4 px, the more the sharper the angle and the larger the blur and the window.
#[test]
fn harris_maxima_lie_inside_an_l() {
    let mut displacements_px = Vec::new();
    for opening_deg in [60.0, 90.0, 120.0] {
        for sigma_px in [0.3, 1.0, 2.0] {
            let mut inward_px = 0.0;
            const TURNS: u32 = 12;
            for turn in 0..TURNS {
                let turn_deg = 30.0 * f64::from(turn) + 7.0;
                let exposure = drawn(&l(opening_deg, turn_deg, sigma_px));
                let found = strongest(&harris(0.04), &exposure).expect("a corner");
                let (sine, cosine) = turn_deg.to_radians().sin_cos();
                inward_px +=
                    cosine * (found.point.x - VERTEX.x) + sine * (found.point.y - VERTEX.y);
            }
            displacements_px.push((opening_deg, sigma_px, inward_px / f64::from(TURNS)));
        }
    }
    for (opening_deg, sigma_px, inward_px) in &displacements_px {
        assert!((0.85..4.4).contains(inward_px), "{opening_deg} {sigma_px}: {inward_px}");
    }
    let at = |wanted_deg: f64, wanted_px: f64| {
        let is_wanted = |&&(deg, px, _): &&(f64, f64, f64)| {
            (deg - wanted_deg).abs() < 1.0 && (px - wanted_px).abs() < 0.1
        };
        displacements_px.iter().find(is_wanted).expect("measured").2
    };
    assert!(at(60.0, 1.0) > at(90.0, 1.0) && at(90.0, 1.0) > at(120.0, 1.0));
    assert!(at(90.0, 2.0) > at(90.0, 0.3));
}

#[test]
fn a_k_of_004_removes_obtuse_corners_that_a_k_of_0_keeps() {
    let response = |k: f64, opening_deg: f64| {
        let found = strongest(&harris(k), &drawn(&l(opening_deg, 20.0, 0.8)));
        found.map_or(0.0, |found| found.response)
    };
    assert!(response(0.0, 150.0) > 0.01 * response(0.0, 90.0));
    assert!(response(0.04, 150.0) < 1e-3 * response(0.04, 90.0));
}

#[test]
fn a_t_outscores_a_y() {
    let [t, y] = [t(), y()]
        .map(|junction| strongest(&harris(0.04), &drawn(&junction)).expect("a corner").response);
    assert!(t > 1.2 * y, "{t} {y}");
}

#[test]
fn chess_finds_an_x_and_no_l_or_y() {
    let chess = Chess::default();
    let x = BlurredJunction::x(VERTEX, [0.2, 0.5 * PI], [200.0, 40.0], 0.8);
    let found = strongest(&chess, &drawn(&x)).expect("the X");
    assert!(found.point.distance_px(VERTEX) < 1.0, "{found:?}");
    for junction in [l(60.0, 10.0, 0.8), l(90.0, 40.0, 0.8), l(120.0, 80.0, 0.8), y(), t()] {
        let other = strongest(&chess, &drawn(&junction));
        let response = other.map_or(0.0, |other| other.response);
        assert!(response < 0.1 * found.response, "{junction:?}: {response} of {}", found.response);
    }
}

#[test]
fn two_scales_cancel_most_of_the_determinant_s_displacement() {
    let (mut one_px2, mut two_px2) = (0.0, 0.0);
    for opening_deg in [60.0, 90.0, 120.0] {
        for turn in 0..12 {
            let exposure = drawn(&l(opening_deg, 30.0 * f64::from(turn) + 7.0, 0.8));
            let error_px = |detector: &dyn Detector| {
                strongest(detector, &exposure).expect("a corner").point.distance_px(VERTEX)
            };
            one_px2 += error_px(&HessianDeterminant::default()).powi(2) / 36.0;
            two_px2 += error_px(&DericheGiraudon::default()).powi(2) / 36.0;
        }
    }
    let (one_px, two_px) = (one_px2.sqrt(), two_px2.sqrt());
    assert!(one_px > 1.5 && two_px < 0.35, "{one_px} px by one scale, {two_px} px by two");
}

// ---- Oversampling -------------------------------------------------------------------------------------------

#[test]
fn on_a_grid_of_half_the_pitch_maxima_lie_between_pixels_too() {
    let tensor = StructureTensor { oversampling: 2, ..StructureTensor::default() };
    let fine = Harris { tensor, ..harris(0.04) };
    let mut halves = 0;
    for turn in 0..12 {
        let exposure = drawn(&l(90.0, 30.0 * f64::from(turn) + 7.0, 0.8));
        let [coarse, fine] = [&harris(0.04), &fine]
            .map(|detector| strongest(detector, &exposure).expect("a corner"));
        let distance_px = coarse.point.distance_px(fine.point);
        assert!(distance_px < 1.1, "{coarse:?} {fine:?}");
        // Of the same size: slopes are per pixel on either grid.
        let ratio = fine.response / coarse.response;
        assert!((0.7..2.0).contains(&ratio), "{coarse:?} {fine:?}");
        let is_half = |place: f64| (place.fract() - 0.5).abs() < 1e-9;
        assert!([fine.point.x, fine.point.y].iter().all(|p| is_half(*p) || p.fract() < 1e-9));
        halves += usize::from(is_half(fine.point.x) || is_half(fine.point.y));
    }
    assert!(halves >= 6, "{halves} of 12 lie between pixels");
}

#[test]
fn corners_are_farther_apart_than_the_suppression_radius_on_either_grid() {
    let exposure = grey(textured(60, 50));
    for oversampling in [1, 2] {
        let tensor = StructureTensor { oversampling, ..StructureTensor::default() };
        let fine = Harris { tensor, ..harris(0.04) };
        let found = fine.detect(&exposure, None);
        assert!(found.len() > 20, "{oversampling}: {}", found.len());
        for (index, one) in found.iter().enumerate() {
            for other in &found[..index] {
                let [dx, dy] = [one.point.x - other.point.x, one.point.y - other.point.y];
                let apart_px = dx.abs().max(dy.abs());
                assert!(apart_px > f64::from(fine.peaks.nms_radius_px), "{one:?} {other:?}");
            }
        }
    }
}

// ---- Memory, threads, views ---------------------------------------------------------------------------------

fn built() -> impl Iterator<Item = (&'static str, Box<dyn Detector>)> {
    DETECTORS.iter().map(|entry| {
        let detector = (entry.build)(entry.name, &Table::new());
        (entry.name, detector.unwrap_or_else(|error| panic!("{}: {}", entry.name, error.chain())))
    })
}

fn textured(width: usize, height: usize) -> Plane<f32> {
    Plane::from_fn(width, height, |x, y| {
        let base = if 2 * x > 3 * y { 30.0 } else { 120.0 };
        (base + 0.3 * texture(x, y)).round()
    })
}

#[test]
fn what_scratch_memory_held_changes_no_answer() {
    let (large, small) = (grey(textured(140, 90)), drawn(&y()));
    for (name, detector) in built() {
        let (mut scratch, mut found) = (Scratch::default(), Vec::new());
        for exposure in [&small, &large, &small] {
            found.push(Detection::new(VERTEX, 1.0));
            detector.detect_into(exposure, None, &mut scratch, &mut found);
            assert_eq!(found, detector.detect(exposure, None), "{name}");
        }
    }
}

#[test]
fn with_scratch_memory_the_detectors_of_a_response_allocate_nothing() {
    let exposure = grey(textured(140, 90));
    exposure.luma();
    for name in ["harris", "shi_tomasi", "noble", "rohr", "foerstner", "good_features", "fast"] {
        let (_, detector) = built().find(|(other, _)| *other == name).expect("registered");
        let (mut scratch, mut found) = (Scratch::default(), Vec::new());
        let mut detect = || detector.detect_into(&exposure, None, &mut scratch, &mut found);
        detect();
        let counted = allocation_counter::measure(detect);
        assert_eq!(counted.count_total, 0, "{name}: {counted:?}");
    }
}

#[test]
fn a_large_image_has_the_same_corners_on_one_thread_and_on_many() {
    let exposure = grey(textured(1400, 900));
    let pool =
        |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let boxed = Harris {
        tensor: StructureTensor {
            derivative: Derivative::Sobel,
            window: Window::Box,
            ..StructureTensor::default()
        },
        ..Harris::default()
    };
    for harris in [Harris::default(), boxed] {
        let one = pool(1).install(|| harris.detect(&exposure, None));
        let many = pool(3).install(|| harris.detect(&exposure, None));
        assert!(one.len() > 1000, "{}", one.len());
        assert_eq!(one, many);
    }
}

#[test]
fn a_view_with_a_stride_gives_the_bits_of_its_copy() {
    let plane = textured(150, 70);
    let range = cornerbench::image::PixelRange { x0: 13, y0: 5, x1: 101, y1: 63 };
    let (view, copy) = (plane.view().crop(range), plane.crop(range));
    let memory = View::new(plane.samples(), [120, 70], 150).crop(range);
    for window in [Window::Box, Window::Gaussian] {
        for border in [Border::Replicate, Border::Reflect] {
            let tensor = StructureTensor { window, border, ..StructureTensor::default() };
            let response = |image: View<'_, f32>| {
                let mut response = Plane::filled(88, 58, f32::NAN);
                let buffers = &mut TensorBuffers::default();
                let harris = Harris::default();
                tensor.kernels().response(&[(image, 1.0)], buffers, &harris, &mut response);
                response
            };
            assert_eq!(response(view), response(copy.view()));
            assert_eq!(response(memory), response(copy.view()));
        }
    }
}

#[test]
fn samples_that_are_not_finite_are_refused_with_their_place() {
    let encoding = Encoding { bit_depth: 8, transfer: Transfer::Srgb, black_dn: 0.0 };
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let plane = Plane::filled(7, 5, 100.0);
        let mut odd = plane.clone();
        odd.row_mut(2)[3] = value;
        let error = Exposure::new([plane.clone(), odd, plane], encoding).expect_err("not finite");
        let expected =
            format!("an exposure's green sample at (3, 2) is {value}, must be a finite number");
        assert_eq!(error.to_string(), expected);
    }
    let planes = [(7, 5), (7, 5), (5, 7)].map(|(w, h)| Plane::filled(w, h, 0.0));
    let error = Exposure::new(planes, encoding).expect_err("of two sizes").to_string();
    assert!(error.contains("7 x 5 and 5 x 7 px"), "{error}");
}
