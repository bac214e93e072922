//! Harris corner detector.
//!
//! ```text
//! # Method      M = W * [Ix^2 IxIy; IxIy Iy^2] = [A C; C B],  R = det M - k (tr M)^2.
//!               Corners are the maxima of R. Ix, Iy: derivatives of the luma. W: normalised
//!               Gaussian window at sigma_i, sampled to ceil(3 sigma_i). Sums in f64.
//! # Input       luma as encoded [DN]; R scales with the fourth power of the contrast.
//! # Parameters  k              none, 0.04    range [0, 0.25): R <= 0 everywhere from 1/4 on;
//!                                            custom is 0.04 to 0.06; 0 is det M alone
//!               derivative     central       central: (-1, 0, 1) / 2; sobel: the same, smoothed
//!                                            across by (1, 2, 1) / 4; gaussian: at sigma_d
//!               sigma_d        px, 1.0       range [0.5, 8]; read where derivative is gaussian
//!               sigma_i        px, 1.5       range [0.5, 8]
//!               threshold_rel  none, 0.01    range [0, 1): part of the area's strongest response
//!               threshold      DN^4/px^4, 0  range [0, inf); a corner exceeds both thresholds
//!               nms_radius_px  px, 2         range [1, 64]: nothing stronger in (2r+1)^2 pixels
//!               margin_px      px, 3         range [0, 1000]: widens the region on each side
//! # Output      whole-pixel maxima of R, strongest first, equals by row, then column; response in
//!               DN^4/px^4, not comparable across detectors, bit depths or derivatives.
//! # Border      the image continues outwards with its border pixels, then the products with
//!               theirs; no candidate nearer than ceil(3 sigma_i) px to an edge.
//! # Cost        O(pixels searched); one plane of f32 and 6 ceil(3 sigma_i) rows of f64.
//! # Departures  The paper says "Gaussian window" but gives neither its sigma nor the derivative:
//!               central differences (Harris & Stephens' (-1, 0, 1), halved to be a slope) and
//!               sigma_i = 1.5 are our choice. Its threshold T is absolute and not stated; ours is
//!               relative by default.
//! # Source      Harris & Stephens, Alvey Vision Conference 1988, corner response function; the
//!               paper's equations 1 to 3.
//! # Checked by  tests/it/contract.rs (all), tests/it/oracle.rs::harris_matches_direct_sum (to 1e-6
//!               of each |R|), harris_on_a_region_equals_harris_on_the_image (to the bit)
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::{Detection, Detector, PeakRule, SearchArea, peaks};
use crate::filter::{Kernel, gaussian_radius};
use crate::image::Plane;
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;
use crate::target::TargetRegion;

/// The registry's line.
pub const ENTRY: Entry<dyn Detector> = Entry {
    name: "harris",
    summary: "maxima of det M - k (tr M)^2, Gaussian window",
    reference: "Harris & Stephens 1988, corner response function",
    version: 1,
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
    /// The derivative operator.
    pub derivative: Derivative,
    /// Scale of the Gaussian derivative \[px\].
    #[schemars(range(min = 0.5, max = 8.0))]
    pub sigma_d: f64,
    /// Scale of the window \[px\].
    #[schemars(range(min = 0.5, max = 8.0))]
    pub sigma_i: f64,
    /// Threshold as a fraction of the strongest response searched.
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 1.0))]
    pub threshold_rel: f64,
    /// Threshold on the response itself \[DN^4/px^4\].
    #[schemars(range(min = 0.0))]
    pub threshold: f64,
    /// Half side of the square in which a corner is the maximum \[px\].
    #[schemars(range(min = 1, max = 64))]
    pub nms_radius_px: u32,
    /// How far around the region to search \[px\].
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub margin_px: f64,
}

impl Default for Harris {
    fn default() -> Self {
        Self {
            k: 0.04,
            derivative: Derivative::Central,
            sigma_d: 1.0,
            sigma_i: 1.5,
            threshold_rel: 0.01,
            threshold: 0.0,
            nms_radius_px: 2,
            margin_px: 3.0,
        }
    }
}

/// How slopes are measured; each gives 1 DN/px on a ramp of 1 DN/px.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Derivative {
    /// (-1, 0, 1) / 2.
    Central,
    /// (-1, 0, 1) / 2 along, (1, 2, 1) / 4 across.
    Sobel,
    /// Derivative of a Gaussian along, the Gaussian across.
    Gaussian,
}

impl Harris {
    /// The response R \[DN^4/px^4\] at every pixel of `plane` \[DN\].
    pub fn response(&self, plane: &Plane<f32>) -> Plane<f32> {
        let mut response = Plane::filled(plane.width(), plane.height(), 0.0);
        self.for_each_tensor_row(plane, |y, [a, b, c]| {
            for (x, r) in response.row_mut(y).iter_mut().enumerate() {
                let (a, b, c) = (a[x], b[x], c[x]);
                #[allow(clippy::cast_possible_truncation, reason = "rounds to the nearest")]
                let rounded = (a * b - c * c - self.k * (a + b) * (a + b)) as f32;
                *r = rounded;
            }
        });
        response
    }

    /// Calls `use_row` with each row's number and the row of A = W * Ix^2, B = W * Iy^2 and
    /// C = W * IxIy, from the top.
    ///
    /// Rows smoothed along x are kept for as long as the window needs them, in a ring.
    fn for_each_tensor_row(&self, plane: &Plane<f32>, mut use_row: impl FnMut(usize, [&[f64]; 3])) {
        let (width, height) = (plane.width(), plane.height());
        let (along, across) = self.derivative_kernels();
        let window = Kernel::gaussian(self.sigma_i);
        let kept = 2 * window.radius() + 1;
        let row = || vec![0.0; width];
        let [mut ix, mut iy, mut product, mut line, mut work] = [(); 5].map(|()| row());
        let mut smoothed = [(); 3].map(|()| Plane::filled(width, kept, 0.0));
        let mut tensor = [(); 3].map(|()| row());
        let mut next = 0; // the first row not yet smoothed along x
        for y in 0..height {
            while next < height.min(y + window.radius() + 1) {
                across.across_rows(next, height, |y| plane.row(y), &mut line);
                along.along_row(&line, &mut work, &mut ix);
                along.across_rows(next, height, |y| plane.row(y), &mut line);
                across.along_row(&line, &mut work, &mut iy);
                for (smoothed, (p, q)) in
                    smoothed.iter_mut().zip([(&ix, &ix), (&iy, &iy), (&ix, &iy)])
                {
                    for (product, (p, q)) in product.iter_mut().zip(p.iter().zip(q)) {
                        *product = p * q;
                    }
                    window.along_row(&product, &mut work, smoothed.row_mut(next % kept));
                }
                next += 1;
            }
            for (smoothed, row) in smoothed.iter().zip(&mut tensor) {
                window.across_rows(y, height, |y| smoothed.row(y % kept), row);
            }
            use_row(y, tensor.each_ref().map(Vec::as_slice));
        }
    }

    /// The kernels of the derivative, along its axis and across it.
    fn derivative_kernels(&self) -> (Kernel, Kernel) {
        match self.derivative {
            Derivative::Central => (Kernel::central_difference(), Kernel::identity()),
            Derivative::Sobel => (Kernel::central_difference(), Kernel::binomial()),
            Derivative::Gaussian => {
                (Kernel::gaussian_derivative(self.sigma_d), Kernel::gaussian(self.sigma_d))
            }
        }
    }

    /// How far from a pixel the samples lie on which its response depends \[px\].
    fn support(&self) -> usize {
        self.derivative_kernels().0.radius() + gaussian_radius(self.sigma_i)
    }
}

impl Detector for Harris {
    fn detect(&self, exposure: &Exposure, region: Option<&TargetRegion>) -> Vec<Detection> {
        let (width, height) = (exposure.width(), exposure.height());
        let border = gaussian_radius(self.sigma_i);
        let area = SearchArea::new([width, height], border, region, self.margin_px);
        let rule = PeakRule {
            radius: self.nms_radius_px as usize,
            threshold_rel: self.threshold_rel,
            threshold: self.threshold,
        };
        if area.range.width() == 0 || area.range.height() == 0 {
            return Vec::new();
        }
        let crop = area.range.grown(rule.radius + self.support(), width, height);
        let response = self.response(&exposure.luma().crop(crop));
        peaks(&response, [crop.x0, crop.y0], &area, &rule)
    }
}
