//! Slow, obvious second versions, and images whose answer is known.

#![allow(clippy::cast_possible_truncation, reason = "small numbers, drawn here")]

use cornerbench::geometry::ImagePoint;
use cornerbench::image::Plane;
use cornerbench::refine::corner_sub_pix::CornerSubPix;
use cornerbench::refine::{RefineStatus, Refiner};
use cornerbench::target::TargetExtractor;
use cornerbench::target::red_difference::RedDifference;

use crate::drawn::{colour, coverage, grey, seed, texture};

// ---- corner_sub_pix ---------------------------------------------------------------------------

/// A chessboard's corner at `vertex`, one edge at `angle` [rad], the other square to it.
fn chess(size: usize, vertex: ImagePoint, angle: f64) -> Plane<f32> {
    let (sin, cos) = angle.sin_cos();
    Plane::from_fn(size, size, |x, y| {
        let white = coverage(x, y, |x, y| {
            let (dx, dy) = (x - vertex.x, y - vertex.y);
            (dx * cos + dy * sin > 0.0) == (dy * cos - dx * sin > 0.0)
        });
        (40.0 + 160.0 * white).round() as f32
    })
}

/// Where gradient orthogonality settles from `start`: the normal equations in f64, pixel by pixel.
fn settle(plane: &Plane<f32>, start: ImagePoint, half_window_px: i32) -> ImagePoint {
    let mut q = start;
    for _ in 0..40 {
        let at = |dx: i32, dy: i32| {
            plane.bilinear(ImagePoint::new(q.x + f64::from(dx), q.y + f64::from(dy)))
        };
        let (mut n, mut r) = (nalgebra::Matrix2::zeros(), nalgebra::Vector2::zeros());
        for dy in -half_window_px..=half_window_px {
            for dx in -half_window_px..=half_window_px {
                let offset = nalgebra::Vector2::new(f64::from(dx), f64::from(dy));
                let m = (-offset.norm_squared() / f64::from(half_window_px).powi(2)).exp();
                let g = nalgebra::Vector2::new(
                    at(dx + 1, dy) - at(dx - 1, dy),
                    at(dx, dy + 1) - at(dx, dy - 1),
                );
                let outer = m * g * g.transpose();
                n += outer;
                r += outer * offset;
            }
        }
        let step = n.lu().solve(&r).expect("two directions");
        q = ImagePoint::new(q.x + step.x, q.y + step.y);
        if step.norm() <= 1e-3 {
            break;
        }
    }
    q
}

#[test]
fn corner_sub_pix_recovers_quarter_pixel_shifts() {
    for (quarters_x, quarters_y) in [(0, 0), (1, 0), (2, 1), (3, 3), (2, 2)] {
        let vertex = ImagePoint::new(
            20.0 + 0.25 * f64::from(quarters_x),
            20.0 + 0.25 * f64::from(quarters_y),
        );
        for angle in [0.2, 0.6, 1.1] {
            let plane = chess(41, vertex, angle);
            let seeds = [seed(20.0, 20.0), seed(21.0, 19.0), seed(19.0, 22.0)];
            let corners = CornerSubPix::default().refine(&grey(plane.clone()), &seeds);
            for corner in corners {
                assert_eq!(corner.status, RefineStatus::Ok);
                // Resampling moves a sharp corner by up to 0.04 px (algorithms.md, section 0).
                assert!(corner.position.distance_px(vertex) < 0.05, "{vertex:?} {corner:?}");
                let second = settle(&plane, corner.seed.point, 5);
                assert!(corner.position.distance_px(second) < 1e-4, "{second:?} {corner:?}");
            }
        }
    }
}

/// A noisy wedge in whole numbers, the same in any language: 16 points per pixel, texture 0 to 7.
fn noisy_wedge() -> Plane<f32> {
    Plane::from_fn(64, 48, |x, y| {
        let points =
            (0..16).map(|k| (8 * x as i32 + 2 * (k / 4) - 3, 8 * y as i32 + 2 * (k % 4) - 3));
        let hits = points.filter(|(u, v)| 3 * u - v > 400 && u + 2 * v < 620).count();
        40.0 + 10.0 * hits as f32 + (texture(x, y) / 32.0).floor()
    })
}

#[test]
fn corner_sub_pix_equals_opencv() {
    // From OpenCV 5.0.0 (opencv-python-headless, x86-64): cv2.cornerSubPix(noisy_wedge as uint8,
    // seeds, (w, w), (z, z), (3, 40, 1e-3)). The seed itself where OpenCV returns it.
    let seeds = [
        [25.0, 26.0],
        [28.25, 24.5],
        [23.0, 29.0],
        [30.0, 22.0],
        [40.0, 27.0],
        [20.5, 10.0],
        [61.5, 45.25],
    ];
    let opencv = [
        (
            (3, -1),
            [
                [25.552_15, 25.879_732],
                [25.552_197, 25.879_81],
                [23.0, 29.0],
                [31.429_789, 23.041_039],
                [41.919_197, 29.203_602],
                [20.117_893, 10.132_441_5],
                [61.590_43, 44.363_674],
            ],
        ),
        (
            (5, -1),
            [
                [25.661_804, 25.994_787],
                [25.661_716, 25.994_719],
                [25.661_85, 25.994_823],
                [25.661_789, 25.994_776],
                [40.0, 27.0],
                [20.047_485, 9.948_899],
                [61.5, 45.25],
            ],
        ),
        (
            (7, 1),
            [
                [25.693_817, 26.137_869],
                [25.693_9, 26.137_82],
                [25.693_68, 26.137_722],
                [25.693_68, 26.137_651],
                [35.545_372, 20.951_532],
                [20.035_383, 9.883_136],
                [61.5, 45.25],
            ],
        ),
    ];
    let exposure = grey(noisy_wedge());
    for ((half_window_px, zero_zone_px), expected) in opencv {
        let refiner = CornerSubPix {
            half_window_px,
            zero_zone_px,
            least_roundness: 0.0,
            ..CornerSubPix::default()
        };
        let corners = refiner.refine(&exposure, &seeds.map(|[x, y]| seed(x, y)));
        for (corner, expected) in corners.iter().zip(expected.map(ImagePoint::from)) {
            let error = corner.position.distance_px(expected);
            assert!(error < 2e-6, "w {half_window_px}: {corner:?}, OpenCV has {expected:?}");
            let reverted = corner.status == RefineStatus::Reverted;
            assert_eq!(reverted, expected == corner.seed.point, "w {half_window_px}: {corner:?}");
        }
    }
}

// ---- red_difference ---------------------------------------------------------------------------

#[test]
fn red_difference_frames_a_drawn_rectangle() {
    let (centre, half_width, half_height) = (ImagePoint::new(80.3, 60.8), 45.0, 20.0);
    for degrees in [0.0_f64, 12.0, 45.0, 77.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let inside = |x: f64, y: f64| {
            let (dx, dy) = (x - centre.x, y - centre.y);
            (dx * cos + dy * sin).abs() <= half_width && (dy * cos - dx * sin).abs() <= half_height
        };
        let [red, other] = [220.0, 30.0].map(|value| {
            Plane::from_fn(160, 120, |x, y| if inside(x as f64, y as f64) { value } else { 100.0 })
        });
        let region = RedDifference::default()
            .extract(&colour([red, other.clone(), other]))
            .expect("a red rectangle");
        // Pixels whose centres are inside reach past the drawn sides by half a diagonal at most,
        // and may miss them by as much.
        let drawn = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(u, v)| {
            let (u, v) = (u * half_width, v * half_height);
            ImagePoint::new(centre.x + u * cos - v * sin, centre.y + u * sin + v * cos)
        });
        for corner in drawn {
            let nearest = region.quadrilateral.iter().map(|found| found.distance_px(corner));
            let nearest = nearest.fold(f64::INFINITY, f64::min);
            assert!(nearest < 1.0, "{degrees} degrees: {corner:?} is {nearest} px off");
        }
        let twice_area: f64 = (0..4)
            .map(|i| (region.quadrilateral[i], region.quadrilateral[(i + 1) % 4]))
            .map(|(p, q)| p.x * q.y - q.x * p.y)
            .sum();
        assert!(twice_area > 0.0, "clockwise as seen, y down");
    }
}
