//! Harris corner detector.
//!
//! ```text
//! # Method      M = W * [Ix^2 IxIy; IxIy Iy^2] = [A C; C B],  R = det M - k (tr M)^2.
//!               Corners are the maxima of R. Ix, Iy: derivatives of the channel. W: normalised
//!               window, a Gaussian sampled to ceil(3 sigma_i) or a box. Sums in f32.
//! # Input       the channel as encoded [DN]; R scales with the fourth power of the contrast.
//! # Parameters  k              none, 0.04    range [0, 0.25): R <= 0 everywhere from 1/4 on;
//!                                            custom is 0.04 to 0.06; 0 is det M alone
//!               those of the structure tensor (tensor.rs: channel, derivative, window, scales,
//!               oversampling, border) and of peaks (peaks.rs: thresholds, the strongest so many,
//!               suppression radius, margin around a region)
//! # Output      maxima of R at whole pixels, with oversampling 2 at half ones, strongest first, equals
//!               by row, then column; response in DN^4/px^4, not comparable across detectors, bit depths
//!               or derivatives.
//! # Border      the image continues outwards as `border` says, then the products do; no candidate
//!               nearer to an edge than the window reaches, ceil(3 sigma_i) px of a Gaussian.
//! # Cost        O(pixels searched); one plane of f32 and rows of 192 columns, 6 ceil(3 sigma_i) of a
//!               Gaussian.
//! # Departures  The paper says "Gaussian window" but gives neither its sigma nor the derivative:
//!               central differences (Harris & Stephens' (-1, 0, 1), halved to be a slope) and
//!               sigma_i = 1.5 are our choice. Its threshold T is absolute and not stated; ours is
//!               relative by default. With derivative "sobel", window "box" and border "reflect" R is that
//!               of cv2.cornerHarris(picture, 3, 3, k) times 255^4 / 16 of 8 bits, times 1 / 16 of
//!               floats: OpenCV scales slopes by 1 / 255, and neither they nor the box are normalised.
//! # Source      Harris & Stephens, Alvey Vision Conference 1988, corner response function; the
//!               paper's equations 1 to 3.
//! # Checked by  tests/it/contract.rs (all),
//!               tests/it/responses.rs::measures_of_the_tensor_match_direct_sums
//!               (to 1e-5 of the largest |R|), harris_on_a_region_equals_harris_on_the_image (to the bit)
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
    name: "harris",
    summary: "maxima of det M - k (tr M)^2",
    reference: "Harris & Stephens 1988, corner response function",
    version: 2,
    defaults: defaults::<Harris>,
    schema: schema::<Harris>,
    build: |place, table| Ok(Box::new(parameters::<Harris>(place, table)?)),
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Harris {
    /// Weight of the squared trace.
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 0.25))]
    pub k: f64,
    /// How the structure tensor is measured.
    #[serde(flatten)]
    pub tensor: StructureTensor,
    /// When a response is a corner.
    #[serde(flatten)]
    pub peaks: Peaks,
}

impl Default for Harris {
    fn default() -> Self {
        Self { k: 0.04, tensor: StructureTensor::default(), peaks: Peaks::default() }
    }
}

impl Measure for Harris {
    #[inline(always)]
    fn of<R: Real>(&self, a: R, b: R, c: R) -> R {
        #[allow(clippy::cast_possible_truncation, reason = "rounds to the nearest")]
        let k = self.k as f32;
        a * b - c * c - (a + b) * (a + b) * k
    }
}

impl PeakDetector for Harris {
    fn response(&self) -> impl Response {
        self.tensor.measured(self)
    }

    fn peaks(&self) -> &Peaks {
        &self.peaks
    }
}
