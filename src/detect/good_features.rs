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
//! # Border      reflected about its border pixels; none of these is a candidate.
//! # Cost        O(pixels searched); one plane and some rows of f32.
//! # Departures  A region is searched as if it were a mask. Lambda is rounded otherwise than OpenCV's:
//!               points of equal strength to 1e-6 may change places.
//! # Source      Shi & Tomasi, CVPR 1994; OpenCV, modules/imgproc/src/featureselect.cpp, as documented
//!               for `goodFeaturesToTrack`.
//! # Checked by  tests/it/contract.rs (all), tests/it/opencv.rs::detectors_equal_opencv
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::shi_tomasi::ShiTomasi;
use crate::detect::tensor::{Derivative, StructureTensor, TensorBuffers, Window};
use crate::detect::{Detection, Detector, SearchArea, maxima};
use crate::filter::Border;
use crate::geometry::ImagePoint;
use crate::image::Plane;
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
    fn detect(&self, exposure: &Exposure, region: Option<&TargetRegion>) -> Vec<Detection> {
        let size = [exposure.width(), exposure.height()];
        let area = SearchArea::new(size, 1, region, self.margin_px);
        if area.range.width() == 0 || area.range.height() == 0 {
            return Vec::new();
        }
        let kernels = StructureTensor {
            derivative: Derivative::Sobel,
            window: Window::Box,
            box_radius_px: self.box_radius_px,
            border: Border::Reflect,
            ..StructureTensor::default()
        }
        .kernels();
        let crop = area.range.grown(1 + kernels.support(), size[0], size[1]);
        let luma = exposure.luma().crop(crop);
        let mut response = Plane::filled(crop.width(), crop.height(), 0.0);
        let measure = ShiTomasi::default().measure();
        kernels.response(&[(&luma, 1.0)], &mut TensorBuffers::default(), measure, &mut response);

        let row = |y: usize| response.row(y - crop.y0);
        let strongest = area
            .rows()
            .flat_map(|(y, columns)| &row(y)[columns.start - crop.x0..columns.end - crop.x0])
            .fold(0.0, |strongest: f32, &r| strongest.max(r));
        #[allow(clippy::cast_possible_truncation, reason = "as OpenCV compares")]
        let threshold = (f64::from(strongest) * self.quality_level) as f32;
        let mut found = Vec::new();
        maxima(&response, [crop.x0, crop.y0], &area, 1, threshold, |x, y, r| {
            if r > threshold {
                // A picture has less than 2^32 pixels.
                found.push((u32::try_from(y * size[0] + x).unwrap_or(u32::MAX), r));
            }
        });
        // Of equals OpenCV takes the last one first. Responses are positive: their bits are in order.
        found.sort_unstable_by_key(|&(index, r): &(u32, f32)| {
            std::cmp::Reverse((r.to_bits(), index))
        });
        let most = if self.most > 0 { self.most as usize } else { usize::MAX };
        let mut taken = Taken::new(self.min_distance_px, size);
        found
            .into_iter()
            .map(|(index, r)| {
                let (x, y) = (index as usize % size[0], index as usize / size[0]);
                Detection { point: ImagePoint::new(x as f64, y as f64), response: f64::from(r) }
            })
            .filter(|found| self.min_distance_px < 1.0 || taken.take(found.point))
            .take(most)
            .collect()
    }
}

/// Points that keep a distance from each other.
struct Taken {
    distance_px: f64,
    /// Squares so wide that no two points share one.
    columns: usize,
    rows: usize,
    squares: Vec<Option<ImagePoint>>,
}

impl Taken {
    fn new(distance_px: f64, [width, height]: [usize; 2]) -> Self {
        let distance_px = distance_px.max(1.0);
        let mut new = Self { distance_px, columns: 0, rows: 0, squares: Vec::new() };
        (new.columns, new.rows) = (new.square(width as f64) + 1, new.square(height as f64) + 1);
        new.squares = vec![None; new.columns * new.rows];
        new
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in the image")]
    fn square(&self, place: f64) -> usize {
        (place / self.distance_px * std::f64::consts::SQRT_2) as usize
    }

    /// Takes a point that is not too near to any that was taken before; returns whether it was.
    fn take(&mut self, point: ImagePoint) -> bool {
        let (u, v) = (self.square(point.x), self.square(point.y));
        let most = self.distance_px * self.distance_px;
        for v in v.saturating_sub(2)..=(v + 2).min(self.rows - 1) {
            for u in u.saturating_sub(2)..=(u + 2).min(self.columns - 1) {
                if let Some(other) = self.squares[v * self.columns + u] {
                    let (dx, dy) = (other.x - point.x, other.y - point.y);
                    if dx * dx + dy * dy < most {
                        return false;
                    }
                }
            }
        }
        self.squares[v * self.columns + u] = Some(point);
        true
    }
}
