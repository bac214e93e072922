//! Responses between their samples, saddles, and drawn templates: where they land, and what they refuse.

use cornerbench::geometry::ImagePoint;
use cornerbench::image::Plane;
use cornerbench::junction::drawing::{Drawing, DrawingBuffers};
use cornerbench::junction::rays::Rays;
use cornerbench::refine::corner_sub_pix::CornerSubPix;
use cornerbench::refine::response_centroid::ResponseCentroid;
use cornerbench::refine::response_parabola::{Method, ResponseParabola};
use cornerbench::refine::saddle_polynomial::SaddlePolynomial;
use cornerbench::refine::template_ecc::{Motion, TemplateEcc};
use cornerbench::refine::{Corner, RefineStatus, Refiner};
use cornerbench::sensor::{Encoding, Exposure, Transfer};

use crate::drawn::seed;

const SIZE: usize = 48;

fn drawn(vertex: [f64; 2], angles_deg: &[f64], levels: [f64; 3], sigma_px: f64) -> Plane<f32> {
    let mut angles_rad = [0.0; 3];
    for (angle, degrees) in angles_rad.iter_mut().zip(angles_deg) {
        *angle = degrees.to_radians();
    }
    let rays = Rays { vertex, sigma_px, count: angles_deg.len(), angles_rad };
    Drawing { rays, levels, ramps: [[0.0; 2]; 3] }
        .over_pixels([SIZE, SIZE], &mut DrawingBuffers::default())
}

/// An X of two opposite wedges, bright on dark.
fn drawn_x(vertex: [f64; 2], first_deg: f64, opening_deg: f64, sigma_px: f64) -> Plane<f32> {
    let wedge =
        |first: f64| drawn(vertex, &[first, first + opening_deg], [0.6, 0.0, 0.0], sigma_px);
    let (one, other) = (wedge(first_deg), wedge(first_deg + 180.0));
    Plane::from_fn(SIZE, SIZE, |x, y| 0.2 + one.at(x, y) + other.at(x, y))
}

/// A photograph by a linear camera without noise: 0 to 1 is 0 to 65535, not rounded.
fn exposure(plane: &Plane<f32>) -> Exposure {
    let plane = plane.map(|value| 65535.0 * value);
    let encoding = Encoding { bit_depth: 16, transfer: Transfer::Linear, black_dn: 0.0 };
    Exposure::new([plane.clone(), plane.clone(), plane], encoding).expect("finite")
}

fn refined(refiner: &dyn Refiner, plane: &Plane<f32>, x: f64, y: f64) -> Corner {
    refiner.refine(&exposure(plane), &[seed(x, y)])[0]
}

/// Directions and places of vertices, some of each.
fn poses() -> impl Iterator<Item = (f64, [f64; 2])> {
    (0..8_u32).map(|turn| {
        let turn = f64::from(turn);
        (11.0 + 47.0 * turn, [23.0 + (0.37 * turn).fract(), 24.0 + (0.61 * turn).fract()])
    })
}

fn parabolas() -> [ResponseParabola; 3] {
    [Method::Axes, Method::Gaussian, Method::Quadric]
        .map(|method| ResponseParabola { method, ..ResponseParabola::default() })
}

fn peaks() -> Vec<Box<dyn Refiner>> {
    let mut all: Vec<Box<dyn Refiner>> = vec![Box::new(ResponseCentroid::default())];
    all.extend(parabolas().map(|parabola| Box::new(parabola) as Box<dyn Refiner>));
    all
}

#[test]
fn a_response_s_maximum_lies_within_the_wedge() {
    for refiner in peaks() {
        for (first_deg, vertex) in poses() {
            for (opening_deg, range_px) in [(90.0, 1.3..2.0), (120.0, 0.75..1.4)] {
                let angles_deg = [first_deg, first_deg + opening_deg];
                let plane = drawn(vertex, &angles_deg, [0.8, 0.2, 0.0], 0.8);
                let corner =
                    refined(refiner.as_ref(), &plane, vertex[0].round(), vertex[1].round());
                assert_eq!(corner.status, RefineStatus::Ok, "{corner:?}");
                let (sine, cosine) = (first_deg + 0.5 * opening_deg).to_radians().sin_cos();
                let error = [corner.position.x - vertex[0], corner.position.y - vertex[1]];
                let inwards = error[0] * cosine + error[1] * sine;
                let across = error[1] * cosine - error[0] * sine;
                assert!(range_px.contains(&inwards), "{opening_deg} {inwards} {corner:?}");
                assert!(across.abs() < 0.2, "{opening_deg} {across} {corner:?}");
            }
        }
    }
}

#[test]
fn a_response_s_maximum_moves_with_the_image() {
    for refiner in peaks() {
        let of = |x: f64, y: f64| {
            let plane = drawn([21.3 + x, 22.8 + y], &[20.0, 110.0], [0.8, 0.2, 0.0], 0.8);
            refined(refiner.as_ref(), &plane, 22.0 + x, 23.0 + y).position
        };
        let (one, other) = (of(0.0, 0.0), of(5.0, 3.0));
        let moved = ImagePoint::new(one.x + 5.0, one.y + 3.0);
        assert!(other.distance_px(moved) < 2e-3, "{one:?} {other:?}");
    }
}

#[test]
fn twice_the_samples_leave_the_maximum_where_it_is() {
    for mut parabola in parabolas() {
        let plane = drawn([23.3, 24.6], &[20.0, 110.0], [0.8, 0.2, 0.0], 1.0);
        let once = refined(&parabola, &plane, 24.0, 25.0);
        parabola.tensor.oversampling = 2;
        let twice = refined(&parabola, &plane, 24.0, 25.0);
        assert_eq!((once.status, twice.status), (RefineStatus::Ok, RefineStatus::Ok));
        assert!(once.position.distance_px(twice.position) < 0.25, "{once:?} {twice:?}");
    }
}

#[test]
fn a_larger_response_beyond_the_reach_has_diverged() {
    let plane = drawn([23.3, 24.6], &[20.0, 110.0], [0.8, 0.2, 0.0], 0.8);
    for refiner in peaks() {
        let corner = refined(refiner.as_ref(), &plane, 19.5, 22.0);
        assert_eq!(corner.status, RefineStatus::Diverged, "{corner:?}");
        assert_eq!(corner.position, corner.seed.point);
    }
}

#[test]
fn a_saddle_without_noise_is_found_to_a_hundredth_of_a_pixel() {
    let saddle = SaddlePolynomial::default();
    for sigma_px in [0.5, 1.0, 1.5] {
        for (first_deg, vertex) in poses() {
            for opening_deg in [45.0, 70.0, 90.0] {
                let plane = drawn_x(vertex, first_deg, opening_deg, sigma_px);
                let corner = refined(&saddle, &plane, vertex[0] + 0.9, vertex[1] - 1.0);
                let error_px = corner.position.distance_px(ImagePoint::new(vertex[0], vertex[1]));
                assert_eq!(corner.status, RefineStatus::Ok, "{corner:?}");
                assert!(error_px < 0.01, "{opening_deg} {sigma_px} {error_px}");
                assert!(corner.covariance_px2.is_some(), "{corner:?}");
            }
        }
    }
}

#[test]
fn a_saddle_is_not_applicable_to_any_other_corner() {
    let saddle = SaddlePolynomial::default();
    let kinds: [(&[f64], [f64; 3]); 7] = [
        (&[0.0, 60.0], [0.8, 0.2, 0.0]),
        (&[0.0, 90.0], [0.2, 0.8, 0.0]),
        (&[0.0, 150.0], [0.8, 0.2, 0.0]),
        (&[0.0, 120.0, 240.0], [0.8, 0.5, 0.3]),
        (&[0.0, 60.0, 120.0], [0.9, 0.5, 0.15]),
        (&[0.0, 90.0, 180.0], [0.9, 0.5, 0.15]),
        (&[0.0, 50.0, 180.0], [0.2, 0.8, 0.5]),
    ];
    for (first_deg, vertex) in poses() {
        for (angles_deg, levels) in kinds {
            let turned: Vec<f64> = angles_deg.iter().map(|angle| first_deg + angle).collect();
            let plane = drawn(vertex, &turned, levels, 0.8);
            let corner = refined(&saddle, &plane, vertex[0].round(), vertex[1].round());
            assert_eq!(corner.status, RefineStatus::NotApplicable, "{angles_deg:?} {corner:?}");
        }
    }
}

/// Root mean square error over poses, from seeds 1.3 px off.
fn rmse_px(refiner: &dyn Refiner, angles_deg: &[f64], levels: [f64; 3], sigma_px: f64) -> f64 {
    let mut sum = 0.0;
    for (first_deg, vertex) in poses() {
        let turned: Vec<f64> = angles_deg.iter().map(|angle| first_deg + angle).collect();
        let plane = drawn(vertex, &turned, levels, sigma_px);
        let corner = refined(refiner, &plane, vertex[0] + 0.9, vertex[1] - 1.0);
        assert!(corner.status.answered(), "{angles_deg:?} {sigma_px} {corner:?}");
        sum += corner.position.distance_px(ImagePoint::new(vertex[0], vertex[1])).powi(2);
    }
    (sum / 8.0).sqrt()
}

#[test]
fn a_registered_template_is_far_nearer_than_orthogonality() {
    let registered = TemplateEcc::default();
    let kinds: [(&[f64], [f64; 3]); 4] = [
        (&[0.0, 60.0], [0.8, 0.2, 0.0]),
        (&[0.0, 90.0], [0.8, 0.2, 0.0]),
        (&[0.0, 120.0], [0.8, 0.2, 0.0]),
        (&[0.0, 120.0, 240.0], [0.8, 0.5, 0.3]),
    ];
    for (angles_deg, levels) in kinds {
        for (sigma_px, most_px) in [(0.5, 0.06), (1.0, 0.03)] {
            let ours_px = rmse_px(&registered, angles_deg, levels, sigma_px);
            let theirs_px = rmse_px(&CornerSubPix::default(), angles_deg, levels, sigma_px);
            assert!(ours_px < most_px, "{angles_deg:?} {sigma_px}: {ours_px}");
            assert!(ours_px < theirs_px, "{angles_deg:?} {sigma_px}: {ours_px} {theirs_px}");
        }
    }
}

#[test]
fn a_template_that_only_moves_is_as_good_as_its_directions() {
    let moving = TemplateEcc { motion: Motion::Translation, ..TemplateEcc::default() };
    let error_px = rmse_px(&moving, &[0.0, 90.0], [0.8, 0.2, 0.0], 0.8);
    assert!(error_px < 0.5, "{error_px}");
}

#[test]
fn a_template_of_a_false_corner_or_a_crossing_is_refused() {
    let registered = TemplateEcc::default();
    let t = drawn([24.3, 23.6], &[40.0, 110.0, 220.0], [0.9, 0.5, 0.15], 0.8);
    assert_eq!(refined(&registered, &t, 25.0, 24.0).status, RefineStatus::FalseCorner);
    let x = drawn_x([24.2, 23.6], 20.0, 80.0, 0.7);
    assert_eq!(refined(&registered, &x, 24.0, 24.0).status, RefineStatus::NotApplicable);
}

#[test]
fn flat_ramped_and_straight_surroundings_are_refused() {
    let mut refiners = peaks();
    refiners.push(Box::new(SaddlePolynomial::default()));
    refiners.push(Box::new(TemplateEcc::default()));
    let planes = [
        Plane::filled(SIZE, SIZE, 0.4),
        Plane::from_fn(SIZE, SIZE, |x, y| 0.2 + 0.004 * x as f32 + 0.003 * y as f32),
        Plane::from_fn(SIZE, SIZE, |x, _| if x < 24 { 0.2 } else { 0.8 }),
        drawn([24.1, 23.7], &[33.0, 213.0], [0.8, 0.2, 0.0], 0.8),
    ];
    for refiner in &refiners {
        for (index, plane) in planes.iter().enumerate() {
            for (x, y) in [(24.0, 24.0), (25.3, 23.2), (22.0, 26.0)] {
                let corner = refined(refiner.as_ref(), plane, x, y);
                assert!(!corner.status.answered(), "{index}: {corner:?}");
                assert_eq!(corner.position, corner.seed.point);
            }
        }
    }
}
