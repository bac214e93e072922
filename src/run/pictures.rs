//! Pictures that a report shows: exposure, depth, target.

use std::path::Path;

use image::{Rgb, RgbImage};

use crate::error::{Error, Result};
use crate::image::Plane;
use crate::sensor::Exposure;
use crate::target::TargetRegion;

/// Colours that depths are told apart by.
const STEPS: usize = 1024;

pub(super) fn write_exposure(path: &Path, exposure: &Exposure) -> Result<()> {
    save(path, &exposure.to_preview())
}

/// Depth as colour, near yellow, far violet, nothing black; returns nearest and farthest \[m\].
pub(super) fn write_depth(path: &Path, depth_m: &Plane<f32>) -> Result<[f64; 2]> {
    let met = || depth_m.samples().iter().copied().filter(|depth| *depth > 0.0).map(f64::from);
    let nearest = met().fold(f64::INFINITY, f64::min);
    let farthest = met().fold(0.0, f64::max);
    let range = if nearest <= farthest { [nearest, farthest] } else { [0.0, 0.0] };
    let span = (range[1] - range[0]).max(f64::MIN_POSITIVE);
    // The spline takes longer than a photograph.
    let colours: [Rgb<u8>; STEPS] = std::array::from_fn(|step| {
        let colour = colorous::VIRIDIS.eval_rational(step, STEPS);
        Rgb([colour.r, colour.g, colour.b])
    });
    let picture = from_fn(depth_m.width(), depth_m.height(), |x, y| {
        let depth = f64::from(depth_m.at(x, y));
        if depth <= 0.0 {
            return Rgb([0, 0, 0]);
        }
        let nearness = 1.0 - (depth - range[0]) / span;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in 0..=1023")]
        let step = (nearness * (STEPS - 1) as f64).round() as usize;
        colours[step.min(STEPS - 1)]
    });
    save(path, &picture)?;
    Ok(range)
}

/// The target in its own colours, the rest as pale grey.
pub(super) fn write_target(path: &Path, exposure: &Exposure, region: &TargetRegion) -> Result<()> {
    let colours = exposure.to_preview();
    let luma = exposure.luma();
    let scale = 255.0 / exposure.encoding().full_scale_dn();
    let picture = from_fn(exposure.width(), exposure.height(), |x, y| {
        if region.mask.at(x, y) {
            return colours.get_pixel(pixel(x), pixel(y)).to_owned();
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in 150..=255")]
        let grey = (150.0 + 0.35 * scale * f64::from(luma.at(x, y))).min(255.0) as u8;
        Rgb([grey; 3])
    });
    save(path, &picture)
}

fn from_fn(width: usize, height: usize, mut f: impl FnMut(usize, usize) -> Rgb<u8>) -> RgbImage {
    RgbImage::from_fn(pixel(width), pixel(height), |x, y| f(x as usize, y as usize))
}

fn pixel(index: usize) -> u32 {
    u32::try_from(index).unwrap_or(u32::MAX)
}

fn save(path: &Path, picture: &RgbImage) -> Result<()> {
    picture
        .save(path)
        .map_err(|error| Error::malformed(path, format!("cannot write the picture: {error}")))
}
