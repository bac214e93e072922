//! Red colour extraction.
//!
//! ```text
//! # Method      A pixel is red where R - G > diff_r and R - B > diff_r. The target is the largest
//!               8-connected region of red pixels; its quadrilateral is the rectangle of least
//!               area, at any angle, around the region's pixel areas.
//! # Input       encoded red, green and blue, scaled to 8 bit.
//! # Parameters  diff_r      DN of 8 bit, 100   range [0, 255]
//!               min_pixels  px^2, 16           range [1, 2^32)
//! # Output      mask, its range of rows and columns, quadrilateral clockwise from its topmost
//!               corner; no_pixel where nothing is red, too_small where the region has under
//!               min_pixels.
//! # Border      none: each pixel is judged alone.
//! # Cost        O(pixels), two masks.
//! # Departures  The paper keeps every red pixel; the largest region alone is ours, so that a red
//!               leaf does not stretch the range. min_pixels is ours too.
//! # Source      The paper, section 3.2 (diff_R = 100). Rectangle: Freeman & Shapira,
//!               Communications of the ACM 18, 1975 (one side lies on the convex hull).
//! # Checked by  tests/it/contract.rs (all),
//!               tests/it/oracle.rs::red_difference_frames_a_drawn_rectangle
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::image::Plane;
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;
use crate::target::{NoTarget, TargetExtractor, TargetRegion, largest_region};

/// The registry's line.
pub const ENTRY: Entry<dyn TargetExtractor> = Entry {
    name: "red_difference",
    summary: "largest region where red exceeds green and blue by diff_r",
    reference: "the paper, section 3.2",
    version: 1,
    defaults: defaults::<RedDifference>,
    schema: schema::<RedDifference>,
    build: |place, table| Ok(Box::new(parameters::<RedDifference>(place, table)?)),
};

/// The extractor; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct RedDifference {
    /// By how much red exceeds green and blue \[DN of 8 bit\].
    #[schemars(range(min = 0.0, max = 255.0))]
    pub diff_r: f64,
    /// Pixels of the smallest region taken for a target.
    #[schemars(range(min = 1))]
    pub min_pixels: u32,
}

impl Default for RedDifference {
    fn default() -> Self {
        Self { diff_r: 100.0, min_pixels: 16 }
    }
}

impl TargetExtractor for RedDifference {
    fn extract(&self, exposure: &Exposure) -> Result<TargetRegion, NoTarget> {
        #[allow(clippy::cast_possible_truncation, reason = "at most 2^16")]
        let least = (self.diff_r * (exposure.encoding().full_scale_dn() / 255.0)) as f32;
        let [red, green, blue] = exposure.rgb();
        let is_red = red
            .samples()
            .iter()
            .zip(green.samples())
            .zip(blue.samples())
            .map(|((r, g), b)| (r - g > least) & (r - b > least))
            .collect();
        let red_pixels = Plane::from_samples(exposure.width(), exposure.height(), is_red);
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
    use crate::geometry::ImagePoint;
    use crate::sensor::{Encoding, Transfer};

    /// Grey 50 but for a block of columns 2..7, rows 3..6 in `rgb`; full scale 2^bit_depth - 1.
    fn block(rgb: [f32; 3], bit_depth: u8) -> Exposure {
        let channel = |value: f32| {
            Plane::from_fn(12, 9, |x, y| {
                if (2..7).contains(&x) && (3..6).contains(&y) { value } else { 50.0 }
            })
        };
        Exposure::new(
            rgb.map(channel),
            Encoding { bit_depth, transfer: Transfer::Srgb, black_dn: 0.0 },
        )
        .expect("finite")
    }

    fn extract(exposure: &Exposure) -> Result<TargetRegion, NoTarget> {
        RedDifference { min_pixels: 15, ..RedDifference::default() }.extract(exposure)
    }

    #[test]
    fn the_difference_must_exceed_the_threshold_on_both_sides() {
        let region = extract(&block([181.0, 80.0, 80.0], 8)).expect("red");
        assert_eq!(region.pixels, 15);
        assert_eq!(region.quadrilateral[0], ImagePoint::new(1.5, 2.5));
        assert_eq!(region.quadrilateral[2], ImagePoint::new(6.5, 5.5));
        assert_eq!(extract(&block([180.0, 80.0, 79.0], 8)).err(), Some(NoTarget::NoPixel));
        assert_eq!(extract(&block([180.0, 79.0, 80.0], 8)).err(), Some(NoTarget::NoPixel));
    }

    #[test]
    fn the_threshold_scales_with_the_bit_depth() {
        assert!(extract(&block([25_751.0, 50.0, 50.0], 16)).is_ok());
        assert!(extract(&block([25_750.0, 50.0, 50.0], 16)).is_err());
    }

    #[test]
    fn a_region_below_min_pixels_is_too_small() {
        let extractor = RedDifference::default();
        let found = extractor.extract(&block([200.0, 20.0, 20.0], 8));
        assert_eq!(found.err(), Some(NoTarget::TooSmall));
        assert_eq!(NoTarget::TooSmall.name(), "too_small");
    }
}
