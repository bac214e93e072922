//! Beaudet's DET: the determinant of the Hessian.
//!
//! ```text
//! # Method      DET = sigma^4 (Ixx Iyy - Ixy^2), second derivatives of a Gaussian of sigma_d.
//!               Corners are its maxima: where the image is a cap or a cup.
//! # Input       the channel as encoded [DN].
//! # Parameters  channel       none, luma       luma, red, red_difference, colour
//!               sigma_d       px, 1.5          range [0.5, 8]
//!               border        replicate        how the image continues: replicate, reflect
//!               those of peaks (peaks.rs: thresholds, the strongest so many, suppression radius,
//!               margin around a region)
//! # Output      whole-pixel maxima, strongest first, equals by row, then column; response in DN^2. The
//!               maximum lies inside the wedge, away from its vertex, the farther the larger sigma_d is.
//! # Border      no candidate nearer to an edge than ceil(3 sigma_d) px.
//! # Cost        O(pixels searched); one plane and 8 rows of f32.
//! # Departures  Beaudet's derivatives are polynomials fitted to windows; Gaussian ones here, and sigma^4
//!               makes scales comparable (Lindeberg 1998). Saddles, whose DET is negative, are no
//!               corners: an X has none at its centre.
//! # Source      Beaudet, Rotationally invariant image operators, ICPR 1978.
//! # Checked by  tests/it/contract.rs (all),
//!               tests/it/responses.rs::measures_of_derivatives_match_direct_sums
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::jet::{Derivatives, Jet, MeasureJet};
use crate::detect::peaks::{PeakDetector, Response};
use crate::detect::{Detector, Peaks};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::vector::Real;

/// The registry's line.
pub const ENTRY: Entry<dyn Detector> = Entry {
    name: "hessian_determinant",
    summary: "maxima of the determinant of the Hessian: Beaudet's DET",
    reference: "Beaudet 1978, DET",
    version: 1,
    defaults: defaults::<HessianDeterminant>,
    schema: schema::<HessianDeterminant>,
    build: |place, table| Ok(Box::new(parameters::<HessianDeterminant>(place, table)?)),
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct HessianDeterminant {
    /// How derivatives are measured.
    #[serde(flatten)]
    pub jet: Jet,
    /// When a response is a corner.
    #[serde(flatten)]
    pub peaks: Peaks,
}

impl MeasureJet for HessianDeterminant {
    #[inline(always)]
    fn of<R: Real>(&self, derivatives: Derivatives<R>) -> R {
        let Derivatives { xx, xy, yy, .. } = derivatives;
        #[allow(clippy::cast_possible_truncation, reason = "rounds to the nearest")]
        let scale = self.jet.sigma_d.powi(4) as f32;
        (xx * yy - xy * xy) * scale
    }
}

impl PeakDetector for HessianDeterminant {
    fn response(&self) -> impl Response {
        self.jet.measured(self)
    }

    fn peaks(&self) -> &Peaks {
        &self.peaks
    }
}
