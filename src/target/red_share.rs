//! Red colour extraction that light and encoding do not change.
//!
//! ```text
//! # Method      In linear light a pixel is red where red exceeds the larger of green and blue by a share of itself, and
//!               by so many standard deviations of their difference as the camera's noise says. What the light is
//!               multiplied by, shade or another exposure, changes no share. The target is the largest 8-connected region
//!               of red pixels, its quadrilateral as of red_difference.
//! # Input       all channels, decoded to linear light, and the exposure's noise model.
//! # Parameters  share       none, 0.7   range [0, 1]: 0 of grey, 1 of what reflects red alone; wood in warm light has up to 0.65
//!               deviations  none, 3     range [0, 100]: darker pixels are nothing
//!               min_pixels  px^2, 16    range [1, 2^32)
//! # Output      as of red_difference.
//! # Border      none: each pixel is judged alone.
//! # Cost        O(pixels), two masks.
//! # Departures  The paper's difference is one of encoded samples: its threshold is right for one brightness of one curve.
//! # Source      saturation of the HSV cone (Smith, Color gamut transform pairs, SIGGRAPH 1978), in linear light;
//!               propagated noise as in EMVA 1288.
//! # Checked by  tests/it/contract.rs (all), its own tests
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::image::Plane;
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;
use crate::target::{NoTarget, TargetExtractor, TargetRegion, largest_region};

/// The registry's line.
pub const ENTRY: Entry<dyn TargetExtractor> = Entry {
    name: "red_share",
    summary: "largest region where red exceeds green and blue by a share of itself, in linear light",
    reference: "Smith 1978 (saturation)",
    version: 1,
    defaults: defaults::<RedShare>,
    schema: schema::<RedShare>,
    build: |place, table| Ok(Box::new(parameters::<RedShare>(place, table)?)),
};

/// The extractor; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct RedShare {
    /// By what share of itself red exceeds green and blue.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub share: f64,
    /// By how many standard deviations it does.
    #[schemars(range(min = 0.0, max = 100.0))]
    pub deviations: f64,
    /// Pixels of the smallest region taken for a target.
    #[schemars(range(min = 1))]
    pub min_pixels: u32,
}

impl Default for RedShare {
    fn default() -> Self {
        Self { share: 0.7, deviations: 3.0, min_pixels: 16 }
    }
}

impl TargetExtractor for RedShare {
    fn extract(&self, exposure: &Exposure) -> Result<TargetRegion, NoTarget> {
        let light = exposure.linear_light();
        let [red, green, blue] = exposure.rgb();
        let is_red = |((r, g), b): ((&f32, &f32), &f32)| {
            let [r, g, b] = [r, g, b].map(|sample| f64::from(light.of(*sample)));
            let (other, channel) = if g >= b { (g, 1) } else { (b, 2) };
            let excess = r - other;
            // Only where the share alone would do: noise costs more to know.
            excess > 0.0 && excess >= self.share * r && {
                let variance = exposure.light_variance(0, r)
                    + exposure.light_variance(channel, other.max(0.0));
                excess * excess > self.deviations * self.deviations * variance
            }
        };
        let samples = red.samples().iter().zip(green.samples()).zip(blue.samples()).map(is_red);
        let red_pixels =
            Plane::from_samples(exposure.width(), exposure.height(), samples.collect());
        let region = largest_region(&red_pixels)
            .and_then(TargetRegion::from_mask)
            .ok_or(NoTarget::NoPixel)?;
        if region.pixels < self.min_pixels as usize {
            return Err(NoTarget::TooSmall);
        }
        Ok(region)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::{Encoding, Transfer};

    /// Grey light 0.2 but for a block of 5 x 3 pixels of `rgb` in linear light, encoded.
    fn block(rgb: [f64; 3], transfer: Transfer) -> Exposure {
        let encoding = Encoding { bit_depth: 12, transfer, black_dn: 64.0 };
        let channel = |value: f64| {
            Plane::from_fn(12, 9, |x, y| {
                let is_inside = (2..7).contains(&x) && (3..6).contains(&y);
                let encoded = transfer.encode(if is_inside { value } else { 0.2 });
                #[allow(clippy::cast_possible_truncation, reason = "samples are f32")]
                let sample = (64.0 + (encoding.full_scale_dn() - 64.0) * encoded).round() as f32;
                sample
            })
        };
        Exposure::new(rgb.map(channel), encoding).expect("finite")
    }

    fn pixels(exposure: &Exposure) -> Option<usize> {
        let extractor = RedShare { min_pixels: 15, ..RedShare::default() };
        extractor.extract(exposure).ok().map(|region| region.pixels)
    }

    #[test]
    fn the_share_decides_whatever_the_light_and_the_curve() {
        for transfer in [Transfer::Linear, Transfer::Srgb] {
            for brightness in [1.0, 0.1, 0.02] {
                let of =
                    |rgb: [f64; 3]| pixels(&block(rgb.map(|value| brightness * value), transfer));
                assert_eq!(of([0.6, 0.15, 0.15]), Some(15), "{brightness}");
                assert_eq!(of([0.6, 0.22, 0.02]), None, "{brightness}");
                assert_eq!(of([0.6, 0.02, 0.22]), None, "{brightness}");
                assert_eq!(of([0.3, 0.6, 0.1]), None, "{brightness}");
            }
        }
    }

    #[test]
    fn what_noise_may_have_made_is_not_red() {
        // Two digital numbers: their rounding alone has a deviation of 0.4.
        let dim = |red_dn: f64| block([red_dn / 4031.0, 0.0, 0.0], Transfer::Linear);
        assert_eq!(pixels(&dim(1.0)), None);
        assert_eq!(pixels(&dim(2.0)), Some(15));
    }

    #[test]
    fn a_region_below_min_pixels_is_too_small() {
        let found = RedShare::default().extract(&block([0.6, 0.02, 0.02], Transfer::Linear));
        assert_eq!(found.err(), Some(NoTarget::TooSmall));
    }
}
