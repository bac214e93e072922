//! Noble's corner detector: det M / tr M.
//!
//! ```text
//! # Method      M = W * [Ix^2 IxIy; IxIy Iy^2] = [A C; C B]; N = det M / (tr M + e), e = 1e-6 of a
//!               DN^2/px^2 so that flat places give 0. Corners are the maxima of N: half the harmonic
//!               mean of the eigenvalues, without a weight to choose.
//! # Input       the channel as encoded [DN].
//! # Parameters  those of the structure tensor (tensor.rs: channel, derivative, window, scales,
//!               oversampling, border) and of peaks (peaks.rs: thresholds, the strongest so many,
//!               suppression radius, margin around a region)
//! # Output      maxima at whole pixels, with oversampling 2 at half ones, strongest first, equals by
//!               row, then column; response in DN^2/px^2.
//! # Border      the image continues outwards as `border` says, then the products do; no candidate
//!               nearer to an edge than the window reaches, ceil(3 sigma_i) px of a Gaussian.
//! # Cost        O(pixels searched); one plane of f32 and rows of 192 columns, 6 ceil(3 sigma_i) of a
//!               Gaussian.
//! # Departures  none in the formula; the window is a Gaussian by default.
//! # Source      Noble, Image and Vision Computing 6(2), 1988, Finding corners: the ratio of
//!               determinant and trace. Brown, Szeliski & Winder, CVPR 2005, name it the harmonic mean.
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
    name: "noble",
    summary: "maxima of det M / tr M",
    reference: "Noble 1988, ratio of determinant and trace",
    version: 1,
    defaults: defaults::<Noble>,
    schema: schema::<Noble>,
    build: |place, table| Ok(Box::new(parameters::<Noble>(place, table)?)),
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Noble {
    /// How the structure tensor is measured.
    #[serde(flatten)]
    pub tensor: StructureTensor,
    /// When a response is a corner.
    #[serde(flatten)]
    pub peaks: Peaks,
}

impl Measure for Noble {
    #[inline(always)]
    fn of<R: Real>(&self, a: R, b: R, c: R) -> R {
        (a * b - c * c) / (a + b + 1e-6)
    }
}

impl PeakDetector for Noble {
    fn response(&self) -> impl Response {
        self.tensor.measured(self)
    }

    fn peaks(&self) -> &Peaks {
        &self.peaks
    }
}
