//! Detectors that follow edges: contours, polygons, line segments, on drawn shapes.

#![allow(clippy::cast_possible_truncation, reason = "small numbers, drawn here")]

use cornerbench::detect::contour_curvature::ContourCurvature;
use cornerbench::detect::line_junctions::LineJunctions;
use cornerbench::detect::red_polygon::RedPolygon;
use cornerbench::detect::{Detection, Detector, Places};
use cornerbench::geometry::ImagePoint;
use cornerbench::image::Plane;
use cornerbench::junction::{BlurredJunction, Junction};
use cornerbench::sensor::Exposure;
use cornerbench::target::TargetExtractor;
use cornerbench::target::red_difference::RedDifference;

use crate::drawn::{colour, coverage, grey, texture};

/// The share of each pixel that a convex polygon covers, its vertices clockwise as seen.
fn covered([width, height]: [usize; 2], vertices: &[[f64; 2]]) -> Plane<f64> {
    let count = vertices.len();
    Plane::from_fn(width, height, |x, y| {
        coverage(x, y, |x, y| {
            (0..count).all(|i| {
                let ([x0, y0], [x1, y1]) = (vertices[i], vertices[(i + 1) % count]);
                (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) >= 0.0
            })
        })
    })
}

/// A polygon of 8-bit grey on grey ground.
fn grey_polygon(size: [usize; 2], vertices: &[[f64; 2]]) -> Exposure {
    grey(covered(size, vertices).map(|share| (60.0 + 140.0 * share).round() as f32))
}

/// A red polygon of 8 bit on grey ground.
fn red_polygon(size: [usize; 2], vertices: &[[f64; 2]]) -> Exposure {
    let share = covered(size, vertices);
    let channel =
        |ground: f64, red: f64| share.map(|share| (ground + share * (red - ground)).round() as f32);
    colour([channel(90.0, 210.0), channel(90.0, 25.0), channel(90.0, 30.0)])
}

/// A regular polygon of `count` vertices, clockwise as seen.
fn regular(count: usize, centre: [f64; 2], radius: f64, first_deg: f64) -> Vec<[f64; 2]> {
    let corner = |i: usize| {
        let (sine, cosine) = (first_deg + 360.0 * i as f64 / count as f64).to_radians().sin_cos();
        [centre[0] + radius * cosine, centre[1] + radius * sine]
    };
    (0..count).map(corner).collect()
}

fn nearest_px(found: &[Detection], [x, y]: [f64; 2]) -> f64 {
    let vertex = ImagePoint::new(x, y);
    found.iter().map(|corner| corner.point.distance_px(vertex)).fold(f64::INFINITY, f64::min)
}

/// The largest distance of a vertex from the corner nearest to it.
fn worst_px(found: &[Detection], vertices: &[[f64; 2]]) -> f64 {
    vertices.iter().map(|vertex| nearest_px(found, *vertex)).fold(0.0, f64::max)
}

/// A junction in the middle of a 48 x 48 image, 8 bit.
fn drawn_junction(junction: &BlurredJunction) -> Exposure {
    let plane =
        Plane::from_fn(48, 48, |x, y| (255.0 * junction.over_pixel(x, y, 1.0)).round() as f32);
    grey(plane)
}

const MIDDLE: ImagePoint = ImagePoint::new(23.3, 24.1);

fn pair(degrees: [f64; 2]) -> [f64; 2] {
    degrees.map(f64::to_radians)
}

fn ell(first_deg: f64, opening_deg: f64) -> Exposure {
    let angles = pair([first_deg, opening_deg]);
    drawn_junction(&BlurredJunction::l(MIDDLE, angles, [0.8, 0.25], 0.6))
}

fn three(edges_deg: [f64; 3], levels: [f64; 3]) -> Exposure {
    let edges = edges_deg.map(f64::to_radians);
    drawn_junction(&BlurredJunction::y_or_arrow(MIDDLE, edges, levels, 0.6))
}

// ---- Red polygon --------------------------------------------------------------------------------------------

/// Unblurred, which is the worst case: the steepest place of a side along the rows lies up to 0.04 px from
/// the edge, and a sharp corner farther. Measured: 0.026 px root mean square, 0.0997 px at worst.
#[test]
fn red_polygon_finds_drawn_corners_to_a_tenth_of_a_pixel() {
    let mut off: Vec<f64> = Vec::new();
    for step in 0..12 {
        let turn = f64::from(step) * 7.3;
        let centre = [50.0 + 0.13 * f64::from(step), 48.0 - 0.21 * f64::from(step)];
        for count in [3, 4, 5, 6] {
            let vertices = regular(count, centre, 32.0, turn);
            let found = RedPolygon::default().detect(&red_polygon([100, 96], &vertices), None);
            assert_eq!(found.len(), count, "{turn}: {found:?}");
            assert!(found.iter().all(|corner| corner.junction.is_none()));
            off.extend(vertices.iter().map(|vertex| nearest_px(&found, *vertex)));
        }
    }
    let worst = off.iter().copied().fold(0.0, f64::max);
    let rms = (off.iter().map(|px| px * px).sum::<f64>() / off.len() as f64).sqrt();
    assert!(worst < 0.11 && rms < 0.03, "{rms} px root mean square, {worst} px at worst");
}

#[test]
fn red_polygon_s_corners_are_weaker_the_less_contrast_a_side_has_and_the_blunter_they_are() {
    let square = regular(4, [40.0, 40.0], 25.0, 11.0);
    let strong = RedPolygon::default().detect(&red_polygon([80, 80], &square), None)[0].response;
    let blunt = regular(8, [40.0, 40.0], 30.0, 11.0);
    let blunt = RedPolygon::default().detect(&red_polygon([80, 80], &blunt), None);
    assert_eq!(blunt.len(), 8);
    let ratio = blunt[0].response / strong;
    assert!((ratio - 45.0_f64.to_radians().sin()).abs() < 0.03, "{ratio}");

    // Beyond the right side the ground is reddish: a third of the contrast is gone.
    let (size, right) = ([80, 80], [[65.0, 16.0], [64.0, 66.0]]);
    let red = covered(size, &[[15.0, 15.0], right[0], right[1], [14.0, 65.0]]);
    let reddish = covered(size, &[right[0], [90.0, -20.0], [90.0, 100.0], right[1]]);
    let channel = |ground: f64, weak: f64, strong: f64| {
        Plane::from_fn(size[0], size[1], |x, y| {
            let (weak, strong) = (weak - ground, strong - ground);
            (ground + reddish.at(x, y) * weak + red.at(x, y) * strong).round() as f32
        })
    };
    let exposure =
        colour([channel(90.0, 130.0, 210.0), channel(90.0, 70.0, 30.0), channel(90.0, 70.0, 30.0)]);
    let found = RedPolygon::default().detect(&exposure, None);
    assert_eq!(found.len(), 4, "{found:?}");
    for corner in &found {
        let share = corner.response / found[0].response;
        let wanted = if corner.point.x > 40.0 { 2.0 / 3.0 } else { 1.0 };
        assert!((share - wanted).abs() < 0.02, "{share} {corner:?}");
    }
}

#[test]
fn red_polygon_finds_the_ends_of_a_short_side() {
    // A square, one corner of which is cut off by 7 px.
    let vertices = [[20.3, 15.2], [60.1, 15.9], [65.2, 20.8], [64.6, 58.9], [19.8, 58.3]];
    let found = RedPolygon::default().detect(&red_polygon([90, 76], &vertices), None);
    assert_eq!(found.len(), 5, "{found:?}");
    let worst = worst_px(&found, &vertices);
    assert!(worst < 0.5, "{worst} px");
}

#[test]
fn red_polygon_finds_no_corner_at_the_image_s_border() {
    // A triangle whose base lies below the image.
    let exposure = red_polygon([80, 60], &[[40.0, 10.0], [75.0, 90.0], [5.0, 90.0]]);
    let found = RedPolygon::default().detect(&exposure, None);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(nearest_px(&found, [40.0, 10.0]) < 0.1, "{found:?}");
}

#[test]
fn red_polygon_reads_the_region_it_is_given() {
    let square = regular(4, [40.0, 40.0], 25.0, 11.0);
    let exposure = red_polygon([80, 80], &square);
    let region = RedDifference::default().extract(&exposure).expect("red");
    let whole = RedPolygon::default().detect(&exposure, None);
    assert_eq!(RedPolygon::default().detect(&exposure, Some(&region)), whole);
    let small = regular(4, [20.0, 20.0], 12.0, 11.0);
    let other = red_polygon([80, 80], &small);
    let elsewhere = RedDifference::default().extract(&other).expect("red");
    assert!(RedPolygon::default().detect(&exposure, Some(&elsewhere)).is_empty());

    // Of two polygons, the smaller one: by itself it would read the larger.
    let larger = regular(4, [75.0, 40.0], 25.0, 11.0);
    let shares = [&small, &larger].map(|vertices| covered([110, 80], vertices));
    let channel = |ground: f64, red: f64| {
        Plane::from_fn(110, 80, |x, y| {
            let share = shares[0].at(x, y) + shares[1].at(x, y);
            (ground + share * (red - ground)).round() as f32
        })
    };
    let both = colour([channel(90.0, 210.0), channel(90.0, 25.0), channel(90.0, 30.0)]);
    let alone = RedDifference::default().extract(&red_polygon([110, 80], &small)).expect("red");
    let found = RedPolygon::default().detect(&both, Some(&alone));
    assert_eq!(found.len(), 4, "{found:?}");
    assert!(worst_px(&found, &small) < 0.11, "{found:?}");
}

// ---- Contour curvature --------------------------------------------------------------------------------------

#[test]
fn contour_curvature_finds_drawn_corners_and_no_others() {
    for count in [3, 4, 5, 6, 8] {
        for step in 0..6 {
            let turn = 4.0 + f64::from(step) * 9.1;
            let vertices = regular(count, [60.3, 59.6], 45.0, turn);
            let exposure = grey_polygon([120, 120], &vertices);
            let found = ContourCurvature::default().detect(&exposure, None);
            assert_eq!(found.len(), count, "{count} {turn}: {found:?}");
            // Smoothing draws a corner inwards: the sharper, the more. Measured: 2.27 px of a triangle,
            // 1.34 of a square.
            let worst = worst_px(&found, &vertices);
            assert!(worst < 2.5, "{count} {turn}: {worst} px");
        }
    }
}

#[test]
fn contour_curvature_finds_an_ellipse_s_vertices_but_not_on_a_disc_or_nearly_one() {
    for (across, down, count) in
        [(8.0, 8.0, 0), (20.0, 20.0, 0), (33.0, 33.0, 0), (36.0, 28.0, 0), (38.0, 25.0, 2)]
    {
        let exposure = grey(Plane::from_fn(100, 100, |x, y| {
            let share =
                coverage(x, y, |x, y| ((x - 50.2) / across).hypot((y - 49.7) / down) <= 1.0);
            (60.0 + 140.0 * share).round() as f32
        }));
        let found = ContourCurvature::default().detect(&exposure, None);
        assert_eq!(found.len(), count, "{across} {down}: {found:?}");
        for corner in &found {
            let x = 50.2 + f64::copysign(across, corner.point.x - 50.2);
            assert!(corner.point.distance_px(ImagePoint::new(x, 49.7)) < 3.0, "{found:?}");
        }
    }
}

#[test]
fn contour_curvature_keeps_angles_up_to_the_largest() {
    for (opening, wanted) in [(40.0, 1), (90.0, 1), (130.0, 1), (150.0, 1), (172.0, 0)] {
        for first in [10.0, 201.0] {
            let found = ContourCurvature::default().detect(&ell(first, opening), None);
            assert_eq!(found.len(), wanted, "{opening} from {first}: {found:?}");
            if wanted == 1 {
                let off = found[0].point.distance_px(MIDDLE);
                assert!(off < 4.0, "{opening} from {first}: {off} px");
            }
        }
    }
}

#[test]
fn contour_curvature_adds_a_t_junction_and_finds_a_y_once() {
    let t = BlurredJunction::t(MIDDLE, pair([20.0, 80.0]), [0.7, 0.4, 0.05], 0.6);
    let found = ContourCurvature::default().detect(&drawn_junction(&t), None);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].point.distance_px(MIDDLE) < 2.0, "{found:?}");
    let without_ends = ContourCurvature { keep_ends: false, ..ContourCurvature::default() };
    assert_eq!(without_ends.detect(&drawn_junction(&t), None), found);
    // Its third edge ends at the bend of the other two.
    let y =
        ContourCurvature::default().detect(&three([20.0, 135.0, 260.0], [0.9, 0.5, 0.15]), None);
    assert_eq!(y.len(), 1, "{y:?}");
    assert!(y[0].point.distance_px(MIDDLE) < 3.0, "{y:?}");
}

// ---- Line junctions -----------------------------------------------------------------------------------------

/// The only junction in the middle, its type, and how far it is from its place.
fn seen(exposure: &Exposure, detector: &LineJunctions) -> (Option<Junction>, f64) {
    let found = detector.detect(exposure, None);
    assert_eq!(found.len(), 1, "{found:?}");
    (found[0].junction, found[0].point.distance_px(MIDDLE))
}

/// Measured: 0.017 px at worst.
#[test]
fn line_junctions_find_type_and_place_of_drawn_junctions() {
    let mut worst = 0.0_f64;
    let mut check = |exposure: &Exposure, wanted: Junction, what: String| {
        let (junction, off) = seen(exposure, &LineJunctions::default());
        assert_eq!(junction, Some(wanted), "{what}");
        worst = worst.max(off);
    };
    for step in 0..4 {
        let turn = 3.0 + 83.0 * f64::from(step);
        for opening in [50.0, 90.0, 140.0, 250.0] {
            check(&ell(turn, opening), Junction::L, format!("L {turn} {opening}"));
        }
        let y = three([turn, turn + 115.0, turn + 240.0], [0.9, 0.5, 0.15]);
        check(&y, Junction::Y, format!("Y {turn}"));
        let arrow = three([turn, turn + 55.0, turn + 120.0], [0.9, 0.5, 0.15]);
        check(&arrow, Junction::Arrow, format!("arrow {turn}"));
        let x = BlurredJunction::x(MIDDLE, pair([turn, 80.0]), [0.8, 0.2], 0.6);
        check(&drawn_junction(&x), Junction::X, format!("X {turn}"));
    }
    assert!(worst < 0.03, "{worst} px");
}

/// Measured: 0.010 px at worst.
#[test]
fn line_junctions_keep_t_junctions_when_asked() {
    for step in 0..4 {
        let turn = 3.0 + 83.0 * f64::from(step);
        let t = BlurredJunction::t(MIDDLE, pair([turn, 70.0]), [0.8, 0.5, 0.1], 0.6);
        let exposure = drawn_junction(&t);
        assert!(LineJunctions::default().detect(&exposure, None).is_empty(), "{turn}");
        let keep = LineJunctions { keep_t: true, ..LineJunctions::default() };
        let (junction, off) = seen(&exposure, &keep);
        assert_eq!(junction, Some(Junction::T), "{turn}");
        assert!(off < 0.03, "{turn}: {off} px");
    }
}

#[test]
fn line_junctions_find_no_segment_in_noise_and_none_on_a_disc() {
    let noise = grey(Plane::from_fn(200, 160, texture));
    assert!(LineJunctions::default().segments(&noise).len() <= 1);
    let disc = grey(Plane::from_fn(60, 60, |x, y| {
        let share = coverage(x, y, |x, y| (x - 30.2).hypot(y - 29.7) <= 9.0);
        (60.0 + 140.0 * share).round() as f32
    }));
    assert!(LineJunctions::default().detect(&disc, None).is_empty());
}

#[test]
fn segments_lie_on_the_sides_of_a_drawn_polygon() {
    let vertices = regular(5, [60.3, 59.6], 45.0, 17.0);
    let segments = LineJunctions::default().segments(&grey_polygon([120, 120], &vertices));
    assert_eq!(segments.len(), 5);
    for segment in &segments {
        let side = (0..5).find(|&i| {
            let ([x0, y0], [x1, y1]) = (vertices[i], vertices[(i + 1) % 5]);
            let length = (x1 - x0).hypot(y1 - y0);
            segment.ends.iter().all(|end| {
                ((x1 - x0) * (end.y - y0) - (y1 - y0) * (end.x - x0)).abs() < 0.05 * length
            })
        });
        assert!(side.is_some(), "{segment:?}");
        let length = segment.ends[0].distance_px(segment.ends[1]);
        assert!(length > 45.0 && length < 54.0, "{length}"); // of 52.9 px
    }
    // An edge of 140 DN, about as steep as a Gaussian of 1 px and a difference of two pixels leave it:
    // 140 (Phi(1) - Phi(-1)) / 2 DN/px along the rows, some more or less along others.
    for segment in &segments {
        assert!((segment.steepness - 47.8).abs() < 2.5, "{}", segment.steepness);
    }
}

// ---- All of them --------------------------------------------------------------------------------------------

#[test]
fn nothing_is_found_outside_the_region_and_its_margin() {
    // The grey square's nearest corner is among the pixels that are looked at, but beyond the margin.
    let size = [120, 80];
    let mut shares = covered(size, &regular(4, [28.0, 30.0], 22.0, 11.0));
    let grey = covered(size, &regular(4, [79.0, 46.0], 22.0, 2.0));
    let red_only = shares.clone();
    for (share, grey) in shares.samples_mut().iter_mut().zip(grey.samples()) {
        *share += grey;
    }
    let channel = |red: f64| {
        Plane::from_fn(size[0], size[1], |x, y| {
            let (red_share, share) = (red_only.at(x, y), shares.at(x, y));
            (60.0 + red_share * (red - 60.0) + (share - red_share) * 60.0).round() as f32
        })
    };
    let exposure = colour([channel(250.0), channel(60.0), channel(60.0)]);
    let region = RedDifference::default().extract(&exposure).expect("red");
    let detectors: [Box<dyn Detector>; 3] = [
        Box::new(ContourCurvature::default()),
        Box::new(RedPolygon::default()),
        Box::new(LineJunctions::default()),
    ];
    for (i, detector) in detectors.iter().enumerate() {
        let inside = |found: &[Detection]| found.iter().filter(|c| c.point.x < 55.0).count();
        let found = detector.detect(&exposure, Some(&region));
        assert_eq!((found.len(), inside(&found)), (4, 4), "{i}: {found:?}");
        let whole = detector.detect(&exposure, None);
        assert_eq!(whole.len(), if i == 1 { 4 } else { 8 }, "{i}: {whole:?}");
    }
}

#[test]
fn of_many_corners_the_strongest_are_returned() {
    let exposure = grey_polygon([120, 120], &regular(5, [60.3, 59.6], 45.0, 17.0));
    let places = Places { most: 2, ..Places::default() };
    let all = LineJunctions::default().detect(&exposure, None);
    let few = LineJunctions { places, ..LineJunctions::default() }.detect(&exposure, None);
    assert_eq!(all.len(), 5);
    assert_eq!(few, all[..2]);
}
