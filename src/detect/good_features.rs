//! OpenCV's `goodFeaturesToTrack`: the same points in the same order.
//!
//! ```text
//! # Method      lambda, the smaller eigenvalue of M = W * [Ix^2 IxIy; IxIy Iy^2], with Sobel's slopes
//!               and a box. Corners: where lambda exceeds quality_level times its maximum and no
//!               neighbour of eight is larger; from the strongest on those that keep min_distance_px
//!               from all taken before.
//! # Input       luma as encoded [DN].
//! # Parameters  quality_level    none, 0.01  range (0, 1)
//!               min_distance_px  px, 3       range [0, 1000]; less than 1: none is left out
//!               box_radius_px    px, 1       range [1, 15]: blockSize is 2 r + 1
//!               most             none, 0     range [0, 1e6]: the strongest so many; 0: all
//!               margin_px        px, 3       range [0, 1000]: widens the region on each side
//! # Output      whole pixels, strongest first, equals by row, then column, the last one first, as
//!               OpenCV's; response lambda in DN^2/px^2: OpenCV's times 255^2 / 4.
//! # Border      reflected about its border pixels, which count for the maximum but are no candidates.
//! # Cost        O(pixels searched); one plane of f32 and one of a byte.
//! # Departures  A region is searched as if it were a mask. Lambda is rounded otherwise than OpenCV's:
//!               points of equal strength to 1e-6 may change places.
//! # Source      Shi & Tomasi, CVPR 1994; OpenCV, modules/imgproc/src/featureselect.cpp, as documented
//!               for `goodFeaturesToTrack`.
//! # Checked by  tests/it/contract.rs (all), tests/it/opencv.rs::detectors_equal_opencv
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::maxima::Equals;
use crate::detect::peaks::Searched;
use crate::detect::shi_tomasi::ShiTomasi;
use crate::detect::tensor::{Derivative, Measured, StructureTensor, Window};
use crate::detect::{Detection, Detector, Peaks, Scratch};
use crate::filter::Border;
use crate::geometry::ImagePoint;
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;
use crate::target::TargetRegion;

/// The registry's line.
pub const ENTRY: Entry<dyn Detector> = Entry {
    name: "good_features",
    summary: "OpenCV's goodFeaturesToTrack: smaller eigenvalue, box, quality level, distance",
    reference: "Shi & Tomasi 1994; OpenCV's goodFeaturesToTrack",
    version: 1,
    defaults: defaults::<GoodFeatures>,
    schema: schema::<GoodFeatures>,
    build: |place, table| Ok(Box::new(parameters::<GoodFeatures>(place, table)?)),
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct GoodFeatures {
    /// Threshold as a fraction of the strongest response searched.
    #[schemars(extend("exclusiveMinimum" = 0.0, "exclusiveMaximum" = 1.0))]
    pub quality_level: f64,
    /// The least distance of two corners \[px\].
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub min_distance_px: f64,
    /// Half side of the box \[px\].
    #[schemars(range(min = 1, max = 15))]
    pub box_radius_px: u32,
    /// The most corners, the strongest ones; 0: all.
    #[schemars(range(min = 0, max = 1_000_000))]
    pub most: u32,
    /// How far around the region to search \[px\].
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub margin_px: f64,
}

impl Default for GoodFeatures {
    fn default() -> Self {
        Self {
            quality_level: 0.01,
            min_distance_px: 3.0,
            box_radius_px: 1,
            most: 0,
            margin_px: 3.0,
        }
    }
}

impl Detector for GoodFeatures {
    fn detect_into(
        &self,
        exposure: &Exposure,
        region: Option<&TargetRegion>,
        scratch: &mut Scratch,
        found: &mut Vec<Detection>,
    ) {
        found.clear();
        let tensor = StructureTensor {
            derivative: Derivative::Sobel,
            window: Window::Box,
            box_radius_px: self.box_radius_px,
            border: Border::Reflect,
            ..StructureTensor::default()
        };
        let measure = ShiTomasi::default();
        let response = Measured { border: 0, ..tensor.measured(&measure) };
        let rule = Peaks { nms_radius_px: 1, margin_px: self.margin_px, ..Peaks::default() };
        let Some(searched) = Searched::of(&response, &rule, exposure, region, scratch) else {
            return;
        };
        #[allow(clippy::cast_possible_truncation, reason = "as OpenCV compares")]
        let threshold =
            (f64::from(searched.strongest(&scratch.response)) * self.quality_level) as f32;
        let Scratch { response, candidates, taken, .. } = scratch;
        searched.candidates(response, 1, f64::from(threshold), Equals::All, candidates);
        candidates.strongest_and_last_first(); // as OpenCV's
        let most = if self.most > 0 { self.most as usize } else { usize::MAX };
        let [width, height] = [exposure.width(), exposure.height()];
        taken.reset([width, height], self.min_distance_px);
        for (index, response) in candidates.iter() {
            let [x, y] = searched.place(index);
            if found.len() == most {
                break;
            }
            // The image's border pixels may be the strongest, but are no corners: as OpenCV has it.
            let is_inside = x > 0 && y > 0 && x + 1 < width && y + 1 < height;
            if is_inside && !taken.holds([x, y]) {
                found.push(Detection::new(ImagePoint::new(x as f64, y as f64), response));
                taken.take([x, y]);
            }
        }
    }
}
