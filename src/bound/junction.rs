//! The bound of a junction from the pixels about it, by the blurred model that fits them.

use nalgebra::Matrix2;

use crate::geometry::ImagePoint;
use crate::junction::fit::{Fitter, Samples, Unknown};
use crate::junction::rays::Rays;
use crate::refine::junction_fit::Patches;
use crate::sensor::Exposure;

/// The least covariance \[px^2\], of any estimate without bias, of where these rays of the image meet, from the
/// pixels so near to that point; levels, directions and blur are unknown, and ramps where so said. Levels are
/// those that fit the exposure best; the noise is that of its model. `None` where the pixels say nothing about
/// one direction, or half of them are beyond the image or saturated.
pub fn junction_bound(
    exposure: &Exposure,
    rays: &Rays,
    radius_px: f64,
    ramps: bool,
) -> Option<Matrix2<f64>> {
    let [x, y] = rays.vertex;
    let mut samples = Samples::default();
    let origin = Patches::new(exposure).take(ImagePoint::new(x, y), radius_px, &mut samples)?;
    let rays = Rays { vertex: [x - origin[0], y - origin[1]], ..*rays };
    let mut fitter = Fitter::default();
    let levels = fitter.levels(&samples, &rays, ramps)?;
    let unknown = Unknown { ramps, ..Unknown::ALL };
    fitter.information(&samples, &rays, &levels).vertex_covariance_px2(unknown)
}
