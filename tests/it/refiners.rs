//! What refiners make of junctions whose vertex is known exactly.

use cornerbench::geometry::ImagePoint;
use cornerbench::image::Plane;
use cornerbench::junction::BlurredJunction;
use cornerbench::refine::annular_orthogonality::AnnularOrthogonality;
use cornerbench::refine::corner_sub_pix::CornerSubPix;
use cornerbench::refine::{RefineStatus, Refiner};
use cornerbench::sensor::{Encoding, Exposure, Transfer};

use crate::drawn::seed;

const SIZE: usize = 64;

/// A photograph of a junction by a linear camera without noise: 0 to 1 is 0 to 65535, not rounded.
fn exposure(junction: &BlurredJunction) -> Exposure {
    #[allow(clippy::cast_possible_truncation, reason = "samples are f32")]
    let plane =
        Plane::from_fn(SIZE, SIZE, |x, y| (65535.0 * junction.over_pixel(x, y, 1.0)) as f32);
    let encoding = Encoding { bit_depth: 16, transfer: Transfer::Linear, black_dn: 0.0 };
    Exposure::new([plane.clone(), plane.clone(), plane], encoding).expect("finite")
}

/// Ls of 60, 90, 120 degrees and a Y in several orientations and phases, of this blur.
fn junctions(sigma_px: f64) -> Vec<(&'static str, BlurredJunction)> {
    (0..4)
        .flat_map(|turn| {
            let first = 0.3 + 1.37 * f64::from(turn);
            let (dx, dy) = (0.23 * f64::from(turn), 0.41 * f64::from(turn));
            let vertex = ImagePoint::new(31.0 + dx.fract(), 32.0 + dy.fract());
            let l = |degrees: f64| {
                let angles = [first, degrees.to_radians()];
                BlurredJunction::l(vertex, angles, [0.8, 0.2], sigma_px)
            };
            let thirds = [0.0, 120.0, 240.0].map(|degrees: f64| first + degrees.to_radians());
            let y = BlurredJunction::y_or_arrow(vertex, thirds, [0.9, 0.6, 0.35], sigma_px);
            [("L 60", l(60.0)), ("L 90", l(90.0)), ("L 120", l(120.0)), ("Y", y)]
        })
        .collect()
}

/// Of each kind of junction the root mean square error from seeds 1.8 px off.
fn rmse_px(refiner: &dyn Refiner, kind: &str, sigma_px: f64) -> f64 {
    let mut squares = Vec::new();
    for (name, junction) in junctions(sigma_px) {
        if name != kind {
            continue;
        }
        let exposure = exposure(&junction);
        let vertex = junction.vertex;
        let seeds = [seed(vertex.x + 1.0, vertex.y - 1.5), seed(vertex.x - 1.8, vertex.y)];
        for corner in refiner.refine(&exposure, &seeds) {
            assert!(corner.status.answered(), "{name} {sigma_px}: {corner:?}");
            squares.push(corner.position.distance_px(vertex).powi(2));
        }
    }
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn an_annulus_leaves_out_what_blur_rounds() {
    let annular = AnnularOrthogonality::default();
    let opencv = CornerSubPix::default();
    // Without noise; the zone of 4 px is made for blurs of less than a pixel.
    for sigma_px in [0.5, 0.7, 1.0] {
        for (kind, most_px) in [("L 60", 0.15), ("L 90", 0.025), ("L 120", 0.007), ("Y", 0.02)] {
            let ours_px = rmse_px(&annular, kind, sigma_px);
            let theirs_px = rmse_px(&opencv, kind, sigma_px);
            assert!(ours_px < most_px, "{sigma_px} {kind}: {ours_px}");
            assert!(3.0 * ours_px < theirs_px, "{sigma_px} {kind}: {ours_px}, {theirs_px}");
        }
    }
    let wide = AnnularOrthogonality { zone_px: 6.0, ..annular };
    for (kind, most_px) in [("L 90", 0.03), ("L 120", 0.02), ("Y", 0.03)] {
        let ours_px = rmse_px(&wide, kind, 1.5);
        assert!(ours_px < most_px, "{kind}: {ours_px}");
    }
}

#[test]
fn a_corner_beyond_the_largest_shift_has_diverged() {
    let (_, junction) = &junctions(0.7)[1];
    let near = AnnularOrthogonality { max_shift_px: 1.0, ..AnnularOrthogonality::default() };
    let far = seed(junction.vertex.x + 1.8, junction.vertex.y);
    let corner = near.refine(&exposure(junction), &[far])[0];
    assert_eq!((corner.status, corner.position), (RefineStatus::Diverged, far.point));
}

#[test]
fn linear_light_undoes_the_camera_s_curve() {
    // The same light, encoded by sRGB and not rounded: the same corner, not one shifted by the curve.
    for (name, junction) in &junctions(1.0) {
        let linear = exposure(junction);
        let transfer = Transfer::Srgb;
        let plane = linear.rgb()[0].map(|dn| {
            #[allow(clippy::cast_possible_truncation, reason = "samples are f32")]
            let encoded = (65535.0 * transfer.encode(f64::from(dn) / 65535.0)) as f32;
            encoded
        });
        let encoding = Encoding { bit_depth: 16, transfer, black_dn: 0.0 };
        let encoded = Exposure::new([plane.clone(), plane.clone(), plane], encoding);
        let seeds = [seed(junction.vertex.x + 1.0, junction.vertex.y)];
        let annular = AnnularOrthogonality::default();
        let [one, other] = [linear, encoded.expect("finite")]
            .map(|exposure| annular.refine(&exposure, &seeds)[0].position);
        assert!(one.distance_px(other) < 2e-3, "{name}: {one:?} {other:?}");
    }
}

#[test]
fn flat_and_straight_surroundings_are_singular() {
    let encoding = Encoding { bit_depth: 8, transfer: Transfer::Srgb, black_dn: 0.0 };
    let of = |sample: &dyn Fn(usize, usize) -> f32| {
        let plane = Plane::from_fn(SIZE, SIZE, sample);
        Exposure::new([plane.clone(), plane.clone(), plane], encoding).expect("finite")
    };
    let exposures = [
        of(&|_, _| 100.0),
        of(&|x, _| 2.0 * x as f32),
        of(&|x, _| if x < 30 { 40.0 } else { 200.0 }),
        of(&|x, y| 100.0 + crate::drawn::texture(x, y) / 128.0), // rounding's noise
    ];
    for exposure in exposures {
        let corner = AnnularOrthogonality::default().refine(&exposure, &[seed(31.0, 32.0)])[0];
        assert_eq!(corner.status, RefineStatus::Singular, "{corner:?}");
    }
}
