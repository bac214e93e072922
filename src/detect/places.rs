//! Corners that lie between pixels: where they may lie, and which come first.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Detection;
use crate::detect::area::{SearchArea, holds};
use crate::image::PixelRange;
use crate::sensor::Exposure;
use crate::target::TargetRegion;

/// Which corners are returned: parameters that detectors share whose corners are no peaks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Places {
    /// The most corners, the strongest ones; 0: all.
    #[schemars(range(min = 0, max = 1_000_000))]
    pub most: u32,
    /// How far around the region to search \[px\].
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub margin_px: f64,
}

impl Default for Places {
    fn default() -> Self {
        Self { most: 0, margin_px: 3.0 }
    }
}

impl Places {
    /// The pixels to look at: those that hold the region and its margin, and `reach_px` more on every
    /// side, or all of the image; `None` of none.
    pub(super) fn window(
        &self,
        exposure: &Exposure,
        region: Option<&TargetRegion>,
        reach_px: usize,
    ) -> Option<PixelRange> {
        let [width, height] = [exposure.width(), exposure.height()];
        let range = SearchArea::new([width, height], 0, region, self.margin_px, 1).range;
        (range.width() > 0 && range.height() > 0).then(|| range.grown(reach_px, width, height))
    }

    /// Keeps the strongest candidates inside the image and the region's margin, strongest first, equals
    /// by row, then column.
    pub(super) fn keep(
        &self,
        exposure: &Exposure,
        region: Option<&TargetRegion>,
        found: &mut Vec<Detection>,
    ) {
        let quadrilateral = region.map(|region| region.grown_quadrilateral(self.margin_px));
        let inside = |value: f64, size: usize| value >= -0.5 && value <= size as f64 - 0.5;
        found.retain(|Detection { point, response, .. }| {
            inside(point.x, exposure.width())
                && inside(point.y, exposure.height())
                && quadrilateral.as_ref().is_none_or(|corners| holds(corners, *point))
                && response.is_finite()
                && *response > 0.0
        });
        found.sort_by(|a, b| {
            let by_place = a.point.y.total_cmp(&b.point.y).then(a.point.x.total_cmp(&b.point.x));
            b.response.total_cmp(&a.response).then(by_place)
        });
        if self.most > 0 {
            found.truncate(self.most as usize);
        }
    }
}
