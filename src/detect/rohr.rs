//! Rohr's corner detector: det M.
//!
//! ```text
//! # Method      M = W * [Ix^2 IxIy; IxIy Iy^2] = [A C; C B]; corners are the maxima of det M.
//! # Input       the channel as encoded [DN].
//! # Parameters  those of the structure tensor (tensor.rs: channel, derivative, window, scales,
//!               oversampling, border) and of peaks (peaks.rs: thresholds, the strongest so many,
//!               suppression radius, margin around a region)
//! # Output      maxima at whole pixels, with oversampling 2 at half ones, strongest first, equals by
//!               row, then column; response in DN^4/px^4.
//! # Border      the image continues outwards as `border` says, then the products do; no candidate
//!               nearer to an edge than the window reaches, ceil(3 sigma_i) px of a Gaussian.
//! # Cost        O(pixels searched); one plane of f32 and rows of 192 columns, 6 ceil(3 sigma_i) of a
//!               Gaussian.
//! # Departures  none in the formula; the window is a Gaussian by default. `harris` with k = 0 gives
//!               the same.
//! # Source      Rohr, Image and Vision Computing 5(2), 1987; Rohr (1994), Localization properties
//!               of direct corner detectors, Journal of Mathematical Imaging and Vision 4, table of operators.
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
    name: "rohr",
    summary: "maxima of det M",
    reference: "Rohr 1987, det M",
    version: 1,
    defaults: defaults::<Rohr>,
    schema: schema::<Rohr>,
    build: |place, table| Ok(Box::new(parameters::<Rohr>(place, table)?)),
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Rohr {
    /// How the structure tensor is measured.
    #[serde(flatten)]
    pub tensor: StructureTensor,
    /// When a response is a corner.
    #[serde(flatten)]
    pub peaks: Peaks,
}

impl Measure for Rohr {
    #[inline(always)]
    fn of<R: Real>(&self, a: R, b: R, c: R) -> R {
        a * b - c * c
    }
}

impl PeakDetector for Rohr {
    fn response(&self) -> impl Response {
        self.tensor.measured(self)
    }

    fn peaks(&self) -> &Peaks {
        &self.peaks
    }
}
