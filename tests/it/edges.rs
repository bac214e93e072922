//! Corners located by their edges.

use cornerbench::geometry::ImagePoint;
use cornerbench::image::Plane;
use cornerbench::junction::drawing::{Drawing, DrawingBuffers};
use cornerbench::junction::rays::Rays;
use cornerbench::refine::apriltag_edges::AprilTagEdges;
use cornerbench::refine::edge_intersection::{EdgeIntersection, Operator};
use cornerbench::refine::{Corner, RefineStatus, Refiner};
use cornerbench::sensor::{Encoding, Exposure, Transfer};

use crate::drawn::seed;

const SIZE: usize = 48;

fn drawing(vertex: [f64; 2], angles_deg: &[f64], levels: [f64; 3], sigma_px: f64) -> Drawing {
    let mut angles_rad = [0.0; 3];
    for (angle, degrees) in angles_rad.iter_mut().zip(angles_deg) {
        *angle = degrees.to_radians();
    }
    let rays = Rays { vertex, sigma_px, count: angles_deg.len(), angles_rad };
    Drawing { rays, levels, ramps: [[0.0; 2]; 3] }
}

/// A photograph by a linear camera without noise; 0 to 1 is 0 to 65535, not rounded.
fn photograph(value: impl FnMut(usize, usize) -> f32) -> Exposure {
    let plane = Plane::from_fn(SIZE, SIZE, value);
    let encoding = Encoding { bit_depth: 16, transfer: Transfer::Linear, black_dn: 0.0 };
    Exposure::new([plane.clone(), plane.clone(), plane], encoding).expect("finite")
}

fn exposure(drawing: &Drawing) -> Exposure {
    let plane = drawing.over_pixels([SIZE, SIZE], &mut DrawingBuffers::default());
    photograph(|x, y| 65535.0 * plane.at(x, y))
}

/// Ls, a Y and an arrow in several orientations and phases.
fn junctions(sigma_px: f64) -> Vec<Drawing> {
    (0..6_u32)
        .flat_map(|turn| {
            let first = 17.0 + 61.0 * f64::from(turn);
            let phase = [0.23 * f64::from(turn), 0.41 * f64::from(turn)];
            let vertex = [24.0 + phase[0].fract(), 23.0 + phase[1].fract()];
            let of = |angles_deg: &[f64], levels: [f64; 3]| {
                let turned: Vec<f64> = angles_deg.iter().map(|angle| first + angle).collect();
                drawing(vertex, &turned, levels, sigma_px)
            };
            [
                of(&[0.0, 60.0], [0.8, 0.2, 0.0]),
                of(&[0.0, 90.0], [0.8, 0.2, 0.0]),
                of(&[0.0, 120.0], [0.8, 0.2, 0.0]),
                of(&[0.0, 120.0, 240.0], [0.8, 0.5, 0.3]),
                of(&[0.0, 60.0, 120.0], [0.9, 0.5, 0.15]),
            ]
        })
        .collect()
}

fn refined(refiner: &dyn Refiner, exposure: &Exposure, x: f64, y: f64) -> Corner {
    refiner.refine(exposure, &[seed(x, y)])[0]
}

/// The farthest answer from the vertex of junctions of this blur, seeds up to 3 px off \[px\].
fn farthest_px(refiner: &dyn Refiner, sigma_px: f64) -> f64 {
    let mut farthest_px = 0.0_f64;
    for drawing in junctions(sigma_px) {
        let [x, y] = drawing.rays.vertex;
        let exposure = exposure(&drawing);
        for (right, down) in [(0.4, 0.3), (-1.5, 2.0), (2.1, 2.1), (-3.0, 0.0)] {
            let corner = refined(refiner, &exposure, x + right, y + down);
            assert!(corner.status.answered(), "{drawing:?}: {corner:?}");
            farthest_px = farthest_px.max(corner.position.distance_px(ImagePoint::new(x, y)));
        }
    }
    farthest_px
}

#[test]
fn every_operator_locates_corners_without_noise() {
    for (operator, most_px) in [
        (Operator::Erf, [0.012, 0.004, 0.004]),
        (Operator::Devernay, [0.09, 0.09, 0.08]),
        (Operator::PartialArea, [0.12, 0.12, 0.12]),
    ] {
        for (sigma_px, most_px) in [0.5, 1.0, 1.5].into_iter().zip(most_px) {
            let refiner = EdgeIntersection { operator, ..EdgeIntersection::default() };
            let found_px = farthest_px(&refiner, sigma_px);
            assert!(found_px < most_px, "{operator:?} {sigma_px}: {found_px}");
        }
    }
}

#[test]
fn means_across_edges_begin_in_the_rounded_corner() {
    // A square is theirs; what is acute is not.
    let square = drawing([24.3, 23.6], &[20.0, 110.0], [0.8, 0.2, 0.0], 0.5);
    let acute = drawing([24.3, 23.6], &[20.0, 80.0], [0.8, 0.2, 0.0], 0.5);
    let [of_square_px, of_acute_px] = [square, acute].map(|drawing| {
        let corner = refined(&AprilTagEdges::default(), &exposure(&drawing), 24.9, 23.0);
        assert_eq!((corner.status, corner.covariance_px2), (RefineStatus::Ok, None));
        corner.position.distance_px(ImagePoint::new(24.3, 23.6))
    });
    assert!(of_square_px < 0.15, "{of_square_px}");
    assert!(of_acute_px > 0.2, "{of_acute_px}");
}

#[test]
fn ramps_do_not_move_the_vertex() {
    let mut drawing = drawing([24.2, 23.7], &[20.0, 110.0], [0.8, 0.5, 0.0], 1.0);
    // 0.67 % of the contrast for each pixel; without noise larger ramps are taken for edges.
    drawing.ramps = [[0.002, 0.0], [0.0, -0.002], [0.0; 2]];
    let corner = refined(&EdgeIntersection::default(), &exposure(&drawing), 25.0, 23.0);
    let error_px = corner.position.distance_px(ImagePoint::new(24.2, 23.7));
    assert!(corner.status.answered() && error_px < 0.01, "{corner:?}");
}

#[test]
fn longer_edges_are_better() {
    let exposure = exposure(&drawing([24.2, 23.7], &[20.0, 110.0], [0.8, 0.2, 0.0], 1.0));
    let deviation_px = |max_length_px: f64| {
        let refiner = EdgeIntersection { max_length_px, ..EdgeIntersection::default() };
        let corner = refined(&refiner, &exposure, 25.0, 23.0);
        corner.covariance_px2.expect("a covariance").trace().sqrt()
    };
    let [short_px, long_px] = [12.0, 20.0].map(deviation_px);
    assert!(long_px < 0.7 * short_px, "{long_px} {short_px}");
}

#[test]
fn an_edge_that_ends_at_another_is_a_false_corner() {
    let t = exposure(&drawing([24.3, 23.6], &[40.0, 110.0, 220.0], [0.9, 0.5, 0.15], 0.8));
    let refiners: [&dyn Refiner; 2] = [&EdgeIntersection::default(), &AprilTagEdges::default()];
    for refiner in refiners {
        for (x, y) in [(24.0, 23.0), (25.0, 24.0)] {
            let corner = refined(refiner, &t, x, y);
            assert_eq!(corner.status, RefineStatus::FalseCorner, "{corner:?}");
        }
    }
}

#[test]
fn flat_ramped_straight_and_crossing_surroundings_are_refused() {
    let blurred = |edge: f32| 20000.0 + 20000.0 * (edge / (1.0 + edge.abs()));
    let exposures = [
        photograph(|_, _| 3000.0),
        photograph(|x, y| 100.0 * x as f32 + 70.0 * y as f32),
        photograph(|x, _| blurred(4.0 * (x as f32 - 24.3))),
        photograph(|x, y| blurred(3.0 * (x as f32 + 0.4 * y as f32 - 33.0))),
    ];
    let checks = photograph(|x, y| if (x < 24) == (y < 24) { 50000.0 } else { 9000.0 });
    let refiners: [&dyn Refiner; 2] = [&EdgeIntersection::default(), &AprilTagEdges::default()];
    for refiner in refiners {
        for exposure in &exposures {
            let corner = refined(refiner, exposure, 24.0, 23.0);
            assert_eq!(corner.status, RefineStatus::Singular, "{corner:?}");
        }
        assert_eq!(refined(refiner, &checks, 24.0, 24.0).status, RefineStatus::NotApplicable);
    }
}

#[test]
fn a_corner_beyond_the_largest_shift_has_diverged_or_is_not_seen() {
    let drawn = exposure(&drawing([24.3, 23.6], &[20.0, 110.0], [0.8, 0.2, 0.0], 0.7));
    let refiner = EdgeIntersection { max_shift_px: 0.5, ..EdgeIntersection::default() };
    let corner = refined(&refiner, &drawn, 27.3, 23.6);
    assert!(!corner.status.answered(), "{corner:?}");
    assert_eq!(corner.position, ImagePoint::new(27.3, 23.6));
}
