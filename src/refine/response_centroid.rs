//! The centroid of Harris's response about its maximum.
//!
//! ```text
//! # Method      R, Harris's response, is computed about the seed; its largest sample R_0 within
//!               max_shift_px is the first middle c. Each iteration
//!                 c = sum w p / sum w,  w = a(p - c) max(R(p) - floor R_0, 0)
//!               over the samples p in a square of half side radius_px + 1/2 about c, a: the share of the
//!               sample's cell within the square. At its fixed point c is the middle of what it is made of:
//!               a square that stays at the largest sample pulls the centroid towards it.
//! # Input       the channel as encoded [DN]; gain and offset cancel.
//! # Parameters  radius_px       px, 2     range [1, 10]
//!               floor           none, 0.1 range [0, 1): of R_0; less has no weight
//!               max_shift_px    px, 3     range [0.5, 20]: how far the largest sample may be from the seed
//!               max_iterations  none, 20  range [1, 100]
//!               epsilon_px      px, 1e-3  range [0, 1]: done when a step is no longer than this
//!               k               none, 0.04 range [0, 0.25): that of Harris's detector
//!               those of the structure tensor (src/detect/tensor.rs)
//! # Output      position, iterations, status; no covariance. As the maximum of R it lies within an L's
//!               wedge, not at its vertex. singular: R is not positive or no more than noise (slopes of both
//!               directions three times its); diverged: a larger sample lies beyond max_shift_px, or the
//!               centroid farther from the largest than radius_px; max_iterations: the last position. Elsewhere
//!               the seed's own.
//! # Border      the image continues as `border` says; out_of_bounds where one of the samples within
//!               2 radius_px + 1 of the largest is not in it, or the seed.
//! # Cost        the tensor on (2 (max_shift_px + 2 radius_px + 1) + 1)^2 samples and its support around them;
//!               O(radius_px^2) for each iteration.
//! # Departures  A square that moves by whole samples makes the answer jump; this one moves with the centroid.
//! # Source      Harris & Stephens, Alvey Vision Conference 1988 (R); the centroid is common property.
//! # Checked by  tests/it/contract.rs (all), tests/it/peaks.rs
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::harris::Harris;
use crate::detect::tensor::StructureTensor;
use crate::detect::{Detection, Peaks};
use crate::geometry::ImagePoint;
use crate::refine::response::Responses;
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "response_centroid",
    summary: "the centroid of Harris's response about its maximum",
    reference: "Harris & Stephens 1988; the centroid is common property",
    version: 1,
    defaults: defaults::<ResponseCentroid>,
    schema: schema::<ResponseCentroid>,
    build: |place, table| Ok(Box::new(parameters::<ResponseCentroid>(place, table)?)),
};

/// The refiner; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct ResponseCentroid {
    /// Half side of the square, half a sample less \[px\].
    #[schemars(range(min = 1, max = 10))]
    pub radius_px: u32,
    /// Responses below this share of the largest have no weight.
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 1.0))]
    pub floor: f64,
    /// How far from its seed the largest sample may be \[px\].
    #[schemars(range(min = 0.5, max = 20.0))]
    pub max_shift_px: f64,
    /// Iterations at most.
    #[schemars(range(min = 1, max = 100))]
    pub max_iterations: u32,
    /// The step that ends the iteration \[px\].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub epsilon_px: f64,
    /// Weight of the squared trace.
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 0.25))]
    pub k: f64,
    /// How the structure tensor is measured.
    #[serde(flatten)]
    pub tensor: StructureTensor,
}

impl Default for ResponseCentroid {
    fn default() -> Self {
        let Harris { k, tensor, .. } = Harris::default();
        Self {
            radius_px: 2,
            floor: 0.1,
            max_shift_px: 3.0,
            max_iterations: 20,
            epsilon_px: 1e-3,
            k,
            tensor,
        }
    }
}

impl Refiner for ResponseCentroid {
    fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner> {
        let Self { max_shift_px, k, ref tensor, .. } = *self;
        let harris = Harris { k, tensor: tensor.clone(), peaks: Peaks::default() };
        // The square may move by its radius.
        let margin = 2 * (self.radius_px * tensor.oversampling) as usize + 1;
        let mut responses = Responses::new(exposure, &harris, max_shift_px, margin);
        let refined = |seed: &Detection| {
            let mut iterations = 0;
            match self.locate(&mut responses, seed.point, &mut iterations) {
                Ok((position, status)) => {
                    Corner { position, ..Corner::at_seed(*seed, iterations, status) }
                }
                Err(status) => Corner::at_seed(*seed, iterations, status),
            }
        };
        seeds.iter().map(refined).collect()
    }
}

impl ResponseCentroid {
    fn locate(
        &self,
        responses: &mut Responses,
        seed: ImagePoint,
        iterations: &mut u32,
    ) -> Result<(ImagePoint, RefineStatus), RefineStatus> {
        let largest = responses.largest(seed)?;
        let floor = self.floor * responses.around(largest)[1][1];
        let half = f64::from(self.radius_px * self.tensor.oversampling) + 0.5;
        let mut middle = largest.map(|place| place as f64);
        let start = responses.point(middle);
        for _ in 0..self.max_iterations {
            *iterations += 1;
            let next = centroid(responses, middle, half, floor);
            let [here, there] = [middle, next].map(|place| responses.point(place));
            if there.distance_px(start) > f64::from(self.radius_px) {
                return Err(RefineStatus::Diverged);
            }
            middle = next;
            if there.distance_px(here) <= self.epsilon_px {
                return Ok((there, RefineStatus::Ok));
            }
        }
        Ok((responses.point(middle), RefineStatus::MaxIterations))
    }
}

/// The centroid of what exceeds the floor within a square; its middle where nothing does.
fn centroid(responses: &Responses, middle: [f64; 2], half: f64, floor: f64) -> [f64; 2] {
    #[allow(clippy::cast_possible_truncation, reason = "among the known samples")]
    let span = |at: f64| (at - half).round() as isize..=(at + half).round() as isize;
    let share = |place: isize, at: f64| (half + 0.5 - (place as f64 - at).abs()).clamp(0.0, 1.0);
    let mut sums = [0.0; 3];
    for y in span(middle[1]) {
        for x in span(middle[0]) {
            let above = (responses.at(x, y) - floor).max(0.0);
            let weight = above * share(x, middle[0]) * share(y, middle[1]);
            sums[0] += weight;
            sums[1] += weight * (x as f64 - middle[0]);
            sums[2] += weight * (y as f64 - middle[1]);
        }
    }
    let scale = 1.0 / sums[0].max(f64::MIN_POSITIVE);
    [middle[0] + scale * sums[1], middle[1] + scale * sums[2]]
}
