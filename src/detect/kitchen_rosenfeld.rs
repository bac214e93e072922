//! Kitchen and Rosenfeld's corner detector: how fast the gradient turns along an edge.
//!
//! ```text
//! # Method      K = |Ixx Iy^2 - 2 Ixy Ix Iy + Iyy Ix^2| / (Ix^2 + Iy^2): the curvature of the line of
//!               equal brightness times the gradient. Corners are the maxima of K.
//! # Input       the channel as encoded [DN].
//! # Parameters  channel       none, luma       luma, red, red_difference, colour
//!               sigma_d       px, 1.5          range [0.5, 8]
//!               border        replicate        how the image continues: replicate, reflect
//!               those of peaks (peaks.rs: thresholds, the strongest so many, suppression radius,
//!               margin around a region)
//! # Output      whole-pixel maxima, strongest first, equals by row, then column; response in DN/px^2.
//! # Border      no candidate nearer to an edge than ceil(3 sigma_d) px.
//! # Cost        O(pixels searched); one plane and 8 rows of f32.
//! # Departures  Their derivatives are of 3 x 3 pixels; Gaussian ones here. 1e-6 DN^2/px^2 beside the
//!               squared gradient makes flat places 0. They suppress along the gradient; ours in a square.
//! # Source      Kitchen & Rosenfeld, Gray-level corner detection, Pattern Recognition Letters 1(2), 1982.
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
    name: "kitchen_rosenfeld",
    summary: "maxima of the curvature of lines of equal brightness times the gradient",
    reference: "Kitchen & Rosenfeld 1982",
    version: 1,
    defaults: defaults::<KitchenRosenfeld>,
    schema: schema::<KitchenRosenfeld>,
    build: |place, table| Ok(Box::new(parameters::<KitchenRosenfeld>(place, table)?)),
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct KitchenRosenfeld {
    /// How derivatives are measured.
    #[serde(flatten)]
    pub jet: Jet,
    /// When a response is a corner.
    #[serde(flatten)]
    pub peaks: Peaks,
}

impl MeasureJet for KitchenRosenfeld {
    #[inline(always)]
    fn of<R: Real>(&self, derivatives: Derivatives<R>) -> R {
        let Derivatives { x, y, xx, xy, yy } = derivatives;
        let turned = xx * y * y + yy * x * x - (xy * x * y) * 2.0;
        turned.abs() / (x * x + y * y + 1e-6)
    }
}

impl PeakDetector for KitchenRosenfeld {
    fn response(&self) -> impl Response {
        self.jet.measured(self)
    }

    fn peaks(&self) -> &Peaks {
        &self.peaks
    }
}
