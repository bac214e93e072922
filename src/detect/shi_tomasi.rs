//! Shi and Tomasi's corner detector: the smaller eigenvalue.
//!
//! ```text
//! # Method      M = W * [Ix^2 IxIy; IxIy Iy^2] = [A C; C B]; lambda = (A + B) / 2 -
//!               sqrt(((A - B) / 2)^2 + C^2). Corners are the maxima of lambda.
//! # Input       the channel as encoded [DN].
//! # Parameters  those of the structure tensor (tensor.rs: channel, derivative, window, scales,
//!               oversampling, border) and of peaks (peaks.rs: thresholds, the strongest so many,
//!               suppression radius, margin around a region)
//! # Output      maxima at whole pixels, with oversampling 2 at half ones, strongest first, equals by
//!               row, then column; response in DN^2/px^2: the squared slope in the direction of least
//!               contrast.
//! # Border      the image continues outwards as `border` says, then the products do; no candidate
//!               nearer to an edge than the window reaches, ceil(3 sigma_i) px of a Gaussian.
//! # Cost        O(pixels searched); one plane of f32 and rows of 192 columns, 6 ceil(3 sigma_i) of a
//!               Gaussian.
//! # Departures  Theirs sums over a square window without weights and thresholds lambda alone; ours
//!               weighs by a Gaussian by default, as `harris` does. `good_features` is OpenCV's form. With
//!               derivative "sobel", window "box" and border "reflect" lambda is
//!               cv2.cornerMinEigenVal(picture, 3) times 255^2 / 4 of 8 bits, times 1 / 4 of floats.
//! # Source      Shi & Tomasi, CVPR 1994, Good features to track, section 4: min(l1, l2) > l.
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
    name: "shi_tomasi",
    summary: "maxima of the smaller eigenvalue of M",
    reference: "Shi & Tomasi 1994, section 4",
    version: 1,
    defaults: defaults::<ShiTomasi>,
    schema: schema::<ShiTomasi>,
    build: |place, table| Ok(Box::new(parameters::<ShiTomasi>(place, table)?)),
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct ShiTomasi {
    /// How the structure tensor is measured.
    #[serde(flatten)]
    pub tensor: StructureTensor,
    /// When a response is a corner.
    #[serde(flatten)]
    pub peaks: Peaks,
}

impl Measure for ShiTomasi {
    #[inline(always)]
    fn of<R: Real>(&self, a: R, b: R, c: R) -> R {
        let (mean, half) = ((a + b) * 0.5, (a - b) * 0.5);
        mean - half.mul_add(half, c * c).sqrt()
    }
}

impl PeakDetector for ShiTomasi {
    fn response(&self) -> impl Response {
        self.tensor.measured(self)
    }

    fn peaks(&self) -> &Peaks {
        &self.peaks
    }
}
