//! The blurred junction that fits best, and the limit that it should reach.

use nalgebra::{DMatrix, Vector2};

use cornerbench::geometry::ImagePoint;
use cornerbench::image::Plane;
use cornerbench::junction::BlurredJunction;
use cornerbench::junction::drawing::{Drawing, DrawingBuffers};
use cornerbench::junction::fit::{Fitter, Samples, Unknown};
use cornerbench::junction::rays::Rays;
use cornerbench::refine::junction_fit::JunctionFit;
use cornerbench::refine::{Corner, RefineStatus, Refiner};
use cornerbench::sensor::{Encoding, Exposure, Transfer};

use crate::drawn::seed;

fn drawing(vertex: [f64; 2], angles_deg: &[f64], levels: [f64; 3], sigma_px: f64) -> Drawing {
    let mut angles_rad = [0.0; 3];
    for (angle, degrees) in angles_rad.iter_mut().zip(angles_deg) {
        *angle = degrees.to_radians();
    }
    let rays = Rays { vertex, sigma_px, count: angles_deg.len(), angles_rad };
    Drawing { rays, levels, ramps: [[0.0; 2]; 3] }
}

/// The least root mean square error of a vertex \[px\], from pixels so near to the middle one.
fn bound_px(drawing: &Drawing, radius_px: f64, noise: f64, unknown: Unknown) -> f64 {
    let mut samples = Samples { channel_count: 1, radius_px, ..Samples::default() };
    samples.make_square(16);
    let count = samples.places.x.len();
    #[allow(clippy::cast_possible_truncation, reason = "weights are f32")]
    let weight = |index: usize| {
        let (x, y) = (f64::from(samples.places.x[index]), f64::from(samples.places.y[index]));
        let is_near = index < 33 * 33 && x.hypot(y) <= radius_px;
        if is_near { (1.0 / noise) as f32 } else { 0.0 }
    };
    let weights = (0..count).map(weight).collect();
    samples.channels[0].weights = weights;
    samples.channels[0].samples = vec![0.0; count];
    // With the pixel's own area.
    let sigma_px = drawing.rays.sigma_px.hypot(12.0_f64.sqrt().recip());
    let levels = drawing.levels.map(|level| [level, 0.0, 0.0]);
    let rays = Rays { sigma_px, ..drawing.rays };
    let information = Fitter::default().information(&samples, &rays, &[levels; 3]);
    information.vertex_covariance_px2(unknown).expect("edges that cross").trace().sqrt()
}

#[test]
fn what_an_edge_tells_is_what_the_closed_form_says() {
    // lambda = A^2 / (2 sqrt(pi) sigma_e sigma_n^2) for each pixel of its length; with unknown levels less by
    // 2 sqrt(pi) sigma_e / W, W the width of the strip. A square of 21 pixels, the edge at four phases.
    let mut samples = Samples { channel_count: 1, radius_px: 10.0, ..Samples::default() };
    samples.make_square(10);
    let count = samples.places.x.len();
    samples.channels[0].weights = vec![50.0; count];
    samples.channels[0].weights[21 * 21..].fill(0.0);
    samples.channels[0].samples = vec![0.0; count];
    for blur_px in [0.5_f64, 0.8, 1.2] {
        let sigma_px = blur_px.hypot(12.0_f64.sqrt().recip());
        let lambda = 50.0_f64.powi(2) / (2.0 * std::f64::consts::PI.sqrt() * sigma_px);
        let mean = |unknown: Unknown| {
            let of = |phase: u32| {
                let vertex = [0.0, 0.25 * f64::from(phase)];
                let angles_rad = [0.0, std::f64::consts::PI, 0.0];
                let rays = Rays { vertex, sigma_px, count: 2, angles_rad };
                let levels = [[[1.0, 0.0, 0.0], [0.0; 3], [0.0; 3]]; 3];
                let information = Fitter::default().information(&samples, &rays, &levels);
                information.shape(unknown).expect("a shape")[(1, 1)]
            };
            (0..4).map(of).sum::<f64>() / 4.0
        };
        let known = mean(Unknown::default());
        assert!((known / (21.0 * lambda) - 1.0).abs() < 0.001, "{blur_px}: {known} {lambda}");
        let share = mean(Unknown { levels: true, ..Unknown::default() }) / known;
        let wanted = 1.0 - 2.0 * std::f64::consts::PI.sqrt() * sigma_px / 21.0;
        assert!((share - wanted).abs() < 0.001, "{blur_px}: {share} {wanted}");
    }
}

#[test]
fn bounds_equal_those_of_differences_of_closed_forms() {
    // Levels, directions and blur unknown; the image of exact pixels, differentiated.
    let noise = 0.02;
    for (angles_deg, levels) in
        [(vec![20.0, 110.0], vec![1.0, 0.0]), (vec![7.0, 100.0, 250.0], vec![0.9, 0.6, 0.3])]
    {
        let count = angles_deg.len();
        let mut parameters = vec![0.13, -0.21, 0.7];
        parameters.extend(angles_deg.iter().map(|degrees: &f64| degrees.to_radians()));
        parameters.extend(&levels);
        let image = |p: &[f64]| {
            // From the middle of a square of pixels.
            let junction = BlurredJunction {
                vertex: ImagePoint::new(7.0 + p[0], 7.0 + p[1]),
                edges_rad: p[3..3 + count].to_vec(),
                levels: p[3 + count..].to_vec(),
                sigma_px: p[2],
            };
            let pixel = |index: usize| {
                let (x, y) = (index % 15, index / 15);
                let is_near = (x as f64 - 7.0).hypot(y as f64 - 7.0) <= 7.0;
                if is_near { junction.over_pixel(x, y, 1.0) } else { 0.0 }
            };
            (0..225).map(pixel).collect::<Vec<f64>>()
        };
        let h = 1e-4;
        let columns: Vec<Vec<f64>> = (0..parameters.len())
            .map(|index| {
                let [less, more] = [-h, h].map(|step| {
                    let mut changed = parameters.clone();
                    changed[index] += step;
                    image(&changed)
                });
                less.iter().zip(&more).map(|(a, b)| (b - a) / (2.0 * h * noise)).collect()
            })
            .collect();
        let jacobian = DMatrix::from_fn(225, columns.len(), |row, column| columns[column][row]);
        let covariance = (jacobian.transpose() * &jacobian).try_inverse().expect("regular");
        let wanted_px = (covariance[(0, 0)] + covariance[(1, 1)]).sqrt();

        let mut values = [0.0; 3];
        values[..count].copy_from_slice(&levels);
        let drawn = drawing([0.13, -0.21], &angles_deg, values, 0.7);
        let unknown = Unknown { ramps: false, ..Unknown::ALL };
        let found_px = bound_px(&drawn, 7.0, noise, unknown);
        assert!((found_px / wanted_px - 1.0).abs() < 0.01, "{found_px} {wanted_px}");
    }
}

#[test]
fn every_unknown_more_makes_the_bound_larger() {
    let drawn = drawing([0.0, 0.0], &[33.0, 123.0], [1.0, 0.0, 0.0], 0.7);
    let none = Unknown::default();
    let of = |unknown: Unknown| bound_px(&drawn, 10.0, 0.02, unknown);
    let known_px = of(none);
    let angles_px = of(Unknown { angles: true, ..none });
    let ladder = [
        known_px,
        of(Unknown { levels: true, ..none }),
        angles_px,
        of(Unknown { angles: true, levels: true, ..none }),
        of(Unknown { ramps: false, ..Unknown::ALL }) + 1e-9,
        of(Unknown::ALL),
    ];
    assert!(ladder.is_sorted(), "{ladder:?}");
    // A free end with a free direction: twice, less what blur rounds.
    assert!((2.0..2.4).contains(&(angles_px / known_px)), "{ladder:?}");
    // Twice the noise, twice the bound; and more of a smaller window.
    assert!((bound_px(&drawn, 10.0, 0.04, none) / known_px - 2.0).abs() < 1e-4);
    assert!(bound_px(&drawn, 5.0, 0.02, none) > 1.3 * known_px);
    // In closed form, by 2 sqrt(pi) sigma_e sigma_n^2 / (A^2 L) along each of two edges.
    let sigma_e = 0.7_f64.hypot(12.0_f64.sqrt().recip());
    let closed_px = (4.0 * std::f64::consts::PI.sqrt() * sigma_e * 0.02 * 0.02 / 10.0).sqrt();
    assert!((known_px / closed_px - 1.0).abs() < 0.05, "{known_px} {closed_px}");
}

/// Junctions of all kinds, in many orientations and phases.
fn junctions(sigma_px: f64) -> Vec<Drawing> {
    (0..6_u32)
        .flat_map(|turn| {
            let first = 17.0 + 61.0 * f64::from(turn);
            let phase = [0.23 * f64::from(turn), 0.41 * f64::from(turn)];
            let vertex = [24.0 + phase[0].fract(), 23.0 + phase[1].fract()];
            let l = |opening: f64| {
                drawing(vertex, &[first, first + opening], [0.8, 0.2, 0.0], sigma_px)
            };
            let three = |second: f64, third: f64, levels: [f64; 3]| {
                drawing(vertex, &[first, first + second, first + third], levels, sigma_px)
            };
            [
                l(60.0),
                l(90.0),
                l(150.0),
                three(120.0, 240.0, [0.8, 0.5, 0.3]),
                three(60.0, 120.0, [0.9, 0.5, 0.15]),
            ]
        })
        .collect()
}

const SIZE: usize = 48;

/// A photograph by a linear camera; 0 to 1 is 0 to 65535, not rounded.
fn exposure(drawing: &Drawing, noise: &mut dyn FnMut() -> f64) -> Exposure {
    let plane = drawing.over_pixels([SIZE, SIZE], &mut DrawingBuffers::default());
    #[allow(clippy::cast_possible_truncation, reason = "samples are f32")]
    let plane = plane.map(|value| (65535.0 * (f64::from(value) + noise())) as f32);
    let encoding = Encoding { bit_depth: 16, transfer: Transfer::Linear, black_dn: 0.0 };
    Exposure::new([plane.clone(), plane.clone(), plane], encoding).expect("finite")
}

fn fitted(exposure: &Exposure, x: f64, y: f64) -> Corner {
    JunctionFit::default().refine(exposure, &[seed(x, y)])[0]
}

#[test]
fn a_junction_without_noise_is_fitted_to_a_thousandth_of_a_pixel() {
    for sigma_px in [0.5, 1.0, 1.5] {
        for drawing in junctions(sigma_px) {
            let [x, y] = drawing.rays.vertex;
            let exposure = exposure(&drawing, &mut || 0.0);
            for (right, down) in [(0.4, 0.3), (-1.5, 2.0), (2.1, 2.1), (-3.0, 0.0)] {
                let corner = fitted(&exposure, x + right, y + down);
                let error_px = corner.position.distance_px(ImagePoint::new(x, y));
                // Orders of a pixel's square beyond the fourth are all that is left, where blur is small.
                let most_px = if sigma_px < 0.7 { 0.001 } else { 0.0005 };
                assert!(corner.status == RefineStatus::Ok, "{drawing:?}: {corner:?}");
                assert!(error_px < most_px, "{drawing:?}: {corner:?}");
            }
        }
    }
}

#[test]
fn what_a_mosaic_lacks_does_not_count() {
    // Red, green and blue of the same junction; what another filter was on is anything.
    let drawing = drawing([24.2, 23.7], &[20.0, 110.0], [0.8, 0.2, 0.0], 0.7);
    let whole = drawing.over_pixels([SIZE, SIZE], &mut DrawingBuffers::default());
    let planes = [0, 1, 2].map(|channel: usize| {
        Plane::from_fn(SIZE, SIZE, |x, y| {
            let is_own = (x + 1) % 2 + y % 2 == channel;
            let other = crate::drawn::texture(x + 7 * channel, y) / 255.0;
            65535.0 * if is_own { whole.at(x, y) } else { 0.5 * (whole.at(x, y) + other) }
        })
    });
    let encoding = Encoding { bit_depth: 16, transfer: Transfer::Linear, black_dn: 0.0 };
    let exposure = Exposure::new(planes, encoding).expect("finite");
    let off_px = |exposure: &Exposure| {
        let corner = fitted(exposure, 25.0, 23.0);
        corner.position.distance_px(ImagePoint::new(24.2, 23.7))
    };
    // The first pixel is the second of the pattern.
    let own_px = off_px(&exposure.clone().with_mosaic([1, 0]));
    let other_px = off_px(&exposure.clone().with_mosaic([0, 0]));
    let all_px = off_px(&exposure);
    assert!(own_px < 0.001, "{own_px}");
    assert!(other_px > 0.02 && all_px > 0.02, "{other_px} {all_px}");
}

#[test]
fn ramps_do_not_move_the_vertex() {
    let mut drawing = drawing([24.2, 23.7], &[20.0, 110.0], [0.8, 0.2, 0.0], 1.0);
    // 3.3 % of the contrast for each pixel.
    drawing.ramps = [[0.02, 0.0], [0.0, -0.02], [0.0; 2]];
    let exposure = exposure(&drawing, &mut || 0.0);
    let vertex = ImagePoint::new(24.2, 23.7);
    let corner = fitted(&exposure, 25.0, 23.0);
    assert!(corner.position.distance_px(vertex) < 0.001, "{corner:?}");
    // Without ramps in the model they would.
    let flat = JunctionFit { ramps: false, ..JunctionFit::default() };
    let corner = flat.refine(&exposure, &[seed(25.0, 23.0)])[0];
    assert!(corner.position.distance_px(vertex) > 0.1, "{corner:?}");
}

#[test]
fn an_edge_that_ends_at_another_is_a_false_corner() {
    let t = drawing([24.3, 23.6], &[40.0, 110.0, 220.0], [0.9, 0.5, 0.15], 0.8);
    let exposure = exposure(&t, &mut || 0.0);
    let corner = fitted(&exposure, 25.0, 24.0);
    assert_eq!(corner.status, RefineStatus::FalseCorner, "{corner:?}");
}

#[test]
fn flat_ramped_straight_and_crossing_surroundings_have_no_junction() {
    let encoding = Encoding { bit_depth: 16, transfer: Transfer::Linear, black_dn: 0.0 };
    let of = |value: &dyn Fn(usize, usize) -> f32| {
        let plane = Plane::from_fn(SIZE, SIZE, value);
        Exposure::new([plane.clone(), plane.clone(), plane], encoding).expect("finite")
    };
    let blurred = |edge: f32| 20000.0 + 20000.0 * (edge / (1.0 + edge.abs()));
    let exposures = [
        of(&|_, _| 3000.0),
        of(&|x, y| 100.0 * x as f32 + 70.0 * y as f32),
        of(&|x, _| blurred(4.0 * (x as f32 - 24.3))),
        of(&|x, y| blurred(3.0 * (x as f32 + 0.4 * y as f32 - 33.0))),
    ];
    for exposure in &exposures {
        let corner = fitted(exposure, 24.0, 23.0);
        assert_eq!(corner.status, RefineStatus::Singular, "{corner:?}");
    }
    let checks = of(&|x, y| if (x < 24) == (y < 24) { 50000.0 } else { 9000.0 });
    assert_eq!(fitted(&checks, 24.0, 24.0).status, RefineStatus::NotApplicable);
}

#[test]
fn the_covariance_turns_with_the_image() {
    let drawn = drawing([24.3, 23.6], &[20.0, 80.0], [0.8, 0.2, 0.0], 0.8);
    let turned = drawing([47.0 - 23.6, 24.3], &[110.0, 170.0], [0.8, 0.2, 0.0], 0.8);
    let [one, other] =
        [(&drawn, [25.0, 23.0]), (&turned, [24.0, 25.0])].map(|(drawing, [x, y])| {
            fitted(&exposure(drawing, &mut || 0.0), x, y).covariance_px2.expect("one")
        });
    let across = Vector2::new(one[(1, 1)], one[(0, 0)]);
    assert!((other[(0, 0)] / across.x - 1.0).abs() < 0.01, "{one} {other}");
    assert!((other[(1, 1)] / across.y - 1.0).abs() < 0.01, "{one} {other}");
    assert!((other[(0, 1)] / -one[(0, 1)] - 1.0).abs() < 0.01, "{one} {other}");
}
