//! Förstner and Gülch's interest operator: precision where the point is round.
//!
//! ```text
//! # Method      M = W * [Ix^2 IxIy; IxIy Iy^2] = [A C; C B]; w = det M / tr M, the precision of a
//!               point there; q = 4 det M / (tr M)^2, the roundness of its error ellipse, 1 of a
//!               circle. Corners are the maxima of w where q is at least `roundness`.
//! # Input       the channel as encoded [DN].
//! # Parameters  roundness      none, 0.5     range [0, 1): 0.5 to 0.75 are customary
//!               those of the structure tensor (tensor.rs: channel, derivative, window, scales,
//!               oversampling, border) and of peaks (peaks.rs: thresholds, the strongest so many,
//!               suppression radius, margin around a region)
//! # Output      maxima at whole pixels, with oversampling 2 at half ones, strongest first, equals by
//!               row, then column; response w in DN^2/px^2.
//! # Border      the image continues outwards as `border` says, then the products do; no candidate
//!               nearer to an edge than the window reaches, ceil(3 sigma_i) px of a Gaussian.
//! # Cost        O(pixels searched); one plane of f32 and rows of 192 columns, 6 ceil(3 sigma_i) of a
//!               Gaussian.
//! # Departures  Theirs thresholds w by its mean or median over the image; ours by its maximum. The
//!               estimate of the point within the window is a refiner's here.
//! # Source      Förstner & Gülch, ISPRS Intercommission Workshop 1987, A fast operator for detection
//!               and precise location of distinct points, corners and circular features, w and q.
//! # Checked by  tests/it/contract.rs (all),
//!               tests/it/responses.rs::measures_of_the_tensor_match_direct_sums
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::peaks::{PeakDetector, Response};
use crate::detect::tensor::{Measure, StructureTensor};
use crate::detect::{Detector, Peaks};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::vector::Real;

/// The registry's line.
pub const ENTRY: Entry<dyn Detector> = Entry {
    name: "foerstner",
    summary: "maxima of precision det M / tr M where M is round",
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

impl Measure for Foerstner {
    #[inline(always)]
    fn of<R: Real>(&self, a: R, b: R, c: R) -> R {
        #[allow(clippy::cast_possible_truncation, reason = "rounds to the nearest")]
        let least = 0.25 * self.roundness as f32;
        let (determinant, trace) = (a * b - c * c, a + b + 1e-6);
        (determinant / trace).where_at_least(determinant, trace * trace * least)
    }
}

impl PeakDetector for Foerstner {
    fn response(&self) -> impl Response {
        self.tensor.measured(self)
    }

    fn peaks(&self) -> &Peaks {
        &self.peaks
    }
}
