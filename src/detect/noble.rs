//! Noble's corner detector: det M / tr M.
//!
//! ```text
//! # Method      M = W * [Ix^2 IxIy; IxIy Iy^2] = [A C; C B]; N = det M / (tr M + e), e = 1e-6 of a
//!               DN^2/px^2 so that flat places give 0. Corners are the maxima of N: half the harmonic
//!               mean of the eigenvalues, without a weight to choose.
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
//!               threshold      DN^2/px^2, 0  range [0, inf); a corner exceeds both thresholds
//!               most           none, 0       range [0, 1e6]: the strongest so many; 0: all
//!               nms_radius_px  px, 2         range [1, 64]: nothing stronger in (2r+1)^2 pixels
//!               margin_px      px, 3         range [0, 1000]: widens the region on each side
//! # Output      whole-pixel maxima, strongest first, equals by row, then column; response in
//!               DN^2/px^2.
//! # Border      the image continues outwards as `border` says, then the products do; no candidate
//!               nearer to an edge than the window reaches, ceil(3 sigma_i) px of a Gaussian.
//! # Cost        O(pixels searched); one plane and 6 ceil(3 sigma_i) rows of f32.
//! # Departures  none in the formula; the window is a Gaussian.
//! # Source      Noble, Image and Vision Computing 6(2), 1988, Finding corners: the ratio of
//!               determinant and trace. Brown, Szeliski & Winder, CVPR 2005, name it the harmonic mean.
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
    name: "noble",
    summary: "maxima of det M / tr M, Gaussian window",
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

impl Noble {
    /// det M / tr M \[DN^2/px^2\] of the tensor's elements.
    pub fn measure(&self) -> impl Fn(f32, f32, f32) -> f32 + use<> {
        |a, b, c| (a * b - c * c) / (a + b + 1e-6)
    }
}

impl Detector for Noble {
    fn detect(&self, exposure: &Exposure, region: Option<&TargetRegion>) -> Vec<Detection> {
        self.tensor.detect(exposure, region, &self.peaks, self.measure())
    }
}
