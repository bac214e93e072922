//! Förstner and Gülch's interest operator: precision where the point is round.
//!
//! ```text
//! # Method      M = W * [Ix^2 IxIy; IxIy Iy^2] = [A C; C B]; w = det M / tr M, the precision of a
//!               point there; q = 4 det M / (tr M)^2, the roundness of its error ellipse, 1 of a
//!               circle. Corners are the maxima of w where q is at least `roundness`.
//! # Input       the channel as encoded [DN].
//! # Parameters  roundness      none, 0.5     range [0, 1): 0.5 to 0.75 are customary
//!               channel        none, luma    luma, red, red_difference (red less the mean
//!                                            of green and blue), colour (their tensors' sum, weighted
//!                                            by the inverse of the noise)
//!               derivative     central       central: (-1, 0, 1) / 2; sobel: the same, smoothed
//!                                            across by (1, 2, 1) / 4; scharr: by (3, 10, 3) / 16;
//!                                            gaussian: at sigma_d
//!               sigma_d        px, 1.0       range [0.5, 8]; read where derivative is gaussian
//!               window         gaussian      gaussian: at sigma_i; box: of box_radius_px
//!               sigma_i        px, 1.5       range [0.5, 8]
//!               box_radius_px  px, 1         range [1, 15]
//!               border         replicate     how the image continues: replicate, reflect
//!               threshold_rel  none, 0.01    range [0, 1): part of the area's strongest response
//!               threshold      DN^2/px^2, 0  range [0, inf); a corner exceeds both thresholds
//!               most           none, 0       range [0, 1e6]: the strongest so many; 0: all
//!               nms_radius_px  px, 2         range [1, 64]: nothing stronger in (2r+1)^2 pixels
//!               margin_px      px, 3         range [0, 1000]: widens the region on each side
//! # Output      whole-pixel maxima, strongest first, equals by row, then column; response
//!               w in DN^2/px^2.
//! # Border      the image continues outwards as `border` says, then the products do; no candidate
//!               nearer to an edge than the window reaches, ceil(3 sigma_i) px of a Gaussian.
//! # Cost        O(pixels searched); one plane and 6 ceil(3 sigma_i) rows of f32.
//! # Departures  Theirs thresholds w by its mean or median over the image; ours by its maximum. The
//!               estimate of the point within the window is a refiner's here.
//! # Source      Förstner & Gülch, ISPRS Intercommission Workshop 1987, A fast operator for detection
//!               and precise location of distinct points, corners and circular features, w and q.
//! # Checked by  tests/it/contract.rs (all), tests/it/oracle.rs::measures_of_the_tensor_match_direct_sums
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::tensor::StructureTensor;
use crate::detect::{Detection, Detector, Peaks};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;
use crate::target::TargetRegion;

/// The registry's line.
pub const ENTRY: Entry<dyn Detector> = Entry {
    name: "foerstner",
    summary: "maxima of precision det M / tr M where M is round, Gaussian window",
    reference: "Förstner & Gülch 1987, weight w and roundness q",
    version: 1,
    defaults: defaults::<Foerstner>,
    schema: schema::<Foerstner>,
    build: |place, table| Ok(Box::new(parameters::<Foerstner>(place, table)?)),
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Foerstner {
    /// The least roundness.
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 1.0))]
    pub roundness: f64,
    /// How the structure tensor is measured.
    #[serde(flatten)]
    pub tensor: StructureTensor,
    /// When a response is a corner.
    #[serde(flatten)]
    pub peaks: Peaks,
}

impl Default for Foerstner {
    fn default() -> Self {
        Self { roundness: 0.5, tensor: StructureTensor::default(), peaks: Peaks::default() }
    }
}

impl Foerstner {
    /// The precision w \[DN^2/px^2\] of the tensor's elements, 0 where they are not round.
    pub fn measure(&self) -> impl Fn(f32, f32, f32) -> f32 + use<> {
        #[allow(clippy::cast_possible_truncation, reason = "rounds to the nearest")]
        let least = 0.25 * self.roundness as f32;
        move |a, b, c| {
            let (determinant, trace) = (a * b - c * c, a + b + 1e-6);
            if determinant >= least * trace * trace { determinant / trace } else { 0.0 }
        }
    }
}

impl Detector for Foerstner {
    fn detect(&self, exposure: &Exposure, region: Option<&TargetRegion>) -> Vec<Detection> {
        self.tensor.detect(exposure, region, &self.peaks, self.measure())
    }
}
