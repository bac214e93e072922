//! Images drawn in source.

#![allow(clippy::cast_possible_truncation, reason = "small numbers, drawn here")]

use cornerbench::detect::Detection;
use cornerbench::geometry::ImagePoint;
use cornerbench::image::Plane;
use cornerbench::sensor::{Encoding, Exposure, Transfer};

/// An 8-bit exposure of three planes.
pub fn colour(rgb: [Plane<f32>; 3]) -> Exposure {
    Exposure::new(rgb, Encoding { bit_depth: 8, transfer: Transfer::Srgb, black_dn: 0.0 })
        .expect("finite")
}

/// An 8-bit exposure that shows `plane` in grey; its luma is `plane`.
pub fn grey(plane: Plane<f32>) -> Exposure {
    colour([plane.clone(), plane.clone(), plane])
}

/// A seed of no particular strength.
pub fn seed(x: f64, y: f64) -> Detection {
    Detection::new(ImagePoint::new(x, y), 1.0)
}

/// A whole number in 0..256 that looks random and is always the same for a pixel.
pub fn texture(x: usize, y: usize) -> f32 {
    let mut bits = (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77);
    bits = (bits ^ (bits >> 15)).wrapping_mul(0x2C1B_3C6D);
    bits = (bits ^ (bits >> 12)).wrapping_mul(0x297A_2D39);
    f32::from((bits >> 24) as u8)
}

/// The fraction, in 1/256, of the pixel at (x, y) where `inside` holds, by 16 x 16 points.
pub fn coverage(x: usize, y: usize, inside: impl Fn(f64, f64) -> bool) -> f64 {
    let offset = |k: u32| (f64::from(k) + 0.5) / 16.0 - 0.5;
    let hits =
        (0..256).filter(|k| inside(x as f64 + offset(k % 16), y as f64 + offset(k / 16))).count();
    hits as f64 / 256.0
}
