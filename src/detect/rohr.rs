//! Rohr's corner detector: det M.
//!
//! ```text
//! # Method      M = W * [Ix^2 IxIy; IxIy Iy^2] = [A C; C B]; corners are the maxima of det M.
//! # Input       the channel as encoded [DN].
//! # Parameters  channel        none, luma    luma, red, red_difference (red less the mean
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
//!               threshold      DN^4/px^4, 0  range [0, inf); a corner exceeds both thresholds
//!               most           none, 0       range [0, 1e6]: the strongest so many; 0: all
//!               nms_radius_px  px, 2         range [1, 64]: nothing stronger in (2r+1)^2 pixels
//!               margin_px      px, 3         range [0, 1000]: widens the region on each side
//! # Output      whole-pixel maxima, strongest first, equals by row, then column; response in
//!               DN^4/px^4.
//! # Border      the image continues outwards as `border` says, then the products do; no candidate
//!               nearer to an edge than the window reaches, ceil(3 sigma_i) px of a Gaussian.
//! # Cost        O(pixels searched); one plane and 6 ceil(3 sigma_i) rows of f32.
//! # Departures  none in the formula; the window is a Gaussian. `harris` with k = 0 gives the same.
//! # Source      Rohr, Image and Vision Computing 5(2), 1987; Rohr (1994), Localization properties
//!               of direct corner detectors, Journal of Mathematical Imaging and Vision 4, table of operators.
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
    name: "rohr",
    summary: "maxima of det M, Gaussian window",
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

impl Rohr {
    /// det M \[DN^4/px^4\] of the tensor's elements.
    pub fn measure(&self) -> impl Fn(f32, f32, f32) -> f32 + use<> {
        |a, b, c| a * b - c * c
    }
}

impl Detector for Rohr {
    fn detect(&self, exposure: &Exposure, region: Option<&TargetRegion>) -> Vec<Detection> {
        self.tensor.detect(exposure, region, &self.peaks, self.measure())
    }
}
