//! Foerstner's junction point: where the lines along all edges of a window meet best, in the window that tells
//! most.
//!
//! ```text
//! # Method      q minimises the sum over pixels p of w (g . (p - q))^2, the squared distances of q from the edge
//!               elements, weighted by their gradients: N = sum w g g^T, q += N^-1 sum w g (g . (p - q)), again
//!               and again about q, so that the window is symmetric about the answer, not about the seed.
//!               g: Gaussian derivatives of linear light at sigma_d. w: a Gaussian at sigma_w that ends smoothly
//!               at 3 sigma_w. Windows from sigma_window_px down (1, 0.71, 0.5, 0.35 of it), each from the
//!               answer of the last, are compared by (n - 2) lambda_min(N) / sum w (g . (p - q))^2, n the sum
//!               of w: the precision of the answer by what is left; the best is kept.
//! # Input       red, green and blue as encoded, decoded to linear light, weighted by 0.2126, 0.7152,
//!               0.0722 (Rec. 709). Gain and offset cancel.
//! # Parameters  sigma_d          px, 1    range [0.5, 3]
//!               sigma_window_px  px, 5    range [1, 12]: of the largest window
//!               optimal_window   bool, true: smaller windows are tried
//!               max_shift_px     px, 6    range [0.5, 20]: how far from its seed a corner may be
//!               max_iterations   none, 30 range [1, 100]: in each window
//!               epsilon_px       px, 1e-4 range [0, 1]: done when a step is no longer than this
//! # Output      position, covariance, iterations (of all windows), status. The covariance is the noise of each
//!               pixel times what it does to q, as annular_orthogonality has it. diverged: the largest window's
//!               answer left max_shift_px; singular: gradients of one direction only (the eigenvalues' ratio
//!               below 1e-2), or no more than noise has. Elsewhere the seed's own position.
//! # Border      pixels beyond the image are replicated for the gradients and have no weight; a seed outside the
//!               image is out_of_bounds.
//! # Cost        O(sigma_w^2) for each iteration; four windows.
//! # Departures  The source takes one step from the seed, and s^2 N^-1 for the covariance, s^2 from what is left:
//!               with gradients whose noise is shared by neighbours that is too large by far, and blur, which
//!               rounds a corner and displaces it, is not in it either.
//! # Source      Foerstner & Guelch, ISPRS Intercommission Workshop 1987 (the equations); Foerstner, A framework
//!               for low level feature extraction, ECCV 1994; Foerstner, Dickscheid & Schindler, Detecting
//!               interpretable and accurate scale-invariant keypoints, ICCV 2009, equation 8 (the window).
//! # Checked by  tests/it/contract.rs (all), tests/it/refiners.rs
//! ```

use pulp::Simd;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Detection;
use crate::refine::gradients::Gradients;
use crate::refine::orthogonality::{Iterated, Solved, Window};
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;
use crate::vector::{Lanes, Real};

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "foerstner",
    summary: "where the lines along all edges meet best, in the window that tells most",
    reference: "Foerstner & Guelch 1987; Foerstner, Dickscheid & Schindler 2009",
    version: 1,
    defaults: defaults::<Foerstner>,
    schema: schema::<Foerstner>,
    build: |place, table| Ok(Box::new(parameters::<Foerstner>(place, table)?)),
};

/// The refiner; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Foerstner {
    /// Scale of the Gaussian derivatives \[px\].
    #[schemars(range(min = 0.5, max = 3.0))]
    pub sigma_d: f64,
    /// Scale of the largest window \[px\].
    #[schemars(range(min = 1.0, max = 12.0))]
    pub sigma_window_px: f64,
    /// Whether smaller windows are tried.
    pub optimal_window: bool,
    /// How far from its seed a corner may be \[px\].
    #[schemars(range(min = 0.5, max = 20.0))]
    pub max_shift_px: f64,
    /// Iterations at most, in each window.
    #[schemars(range(min = 1, max = 100))]
    pub max_iterations: u32,
    /// The step that ends the iteration \[px\].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub epsilon_px: f64,
}

impl Default for Foerstner {
    fn default() -> Self {
        Self {
            sigma_d: 1.0,
            sigma_window_px: 5.0,
            optimal_window: true,
            max_shift_px: 6.0,
            max_iterations: 30,
            epsilon_px: 1e-4,
        }
    }
}

/// Scales of the windows, of the largest one's.
const WINDOWS: [f64; 4] = [1.0, 0.71, 0.5, 0.35];

/// A Gaussian that ends smoothly.
#[derive(Clone, Copy)]
struct Bell {
    sigma_px: f64,
}

/// Where it ends, in units of its scale.
const END: f64 = 3.0;

impl Window for Bell {
    fn radius_px(&self) -> f64 {
        END * self.sigma_px
    }

    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "weights are in single precision")]
    fn weight<S: Simd>(&self, simd: S, r2: Lanes<S>) -> Lanes<S> {
        let scale = (-0.5 / (self.sigma_px * self.sigma_px)) as f32;
        let end = (-0.5 * END * END).exp() as f32;
        ((r2 * scale).exp() + -end).max(Lanes::splat(simd, 0.0))
    }
}

impl Refiner for Foerstner {
    fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner> {
        let mut gradients = Gradients::new(exposure, self.sigma_d);
        let refined = |seed: &Detection| {
            if !gradients.light.is_inside(seed.point) {
                return Corner::at_seed(*seed, 0, RefineStatus::OutOfBounds);
            }
            self.refine_one(&mut gradients, seed)
        };
        seeds.iter().map(refined).collect()
    }
}

impl Foerstner {
    fn refine_one(&self, gradients: &mut Gradients, seed: &Detection) -> Corner {
        let iterated = Iterated {
            least_gradient: 0.0,
            max_shift_px: self.max_shift_px,
            max_iterations: self.max_iterations,
            epsilon_px: self.epsilon_px,
        };
        let windows = if self.optimal_window { &WINDOWS[..] } else { &WINDOWS[..1] };
        let mut start = seed.point;
        let mut iterations = 0;
        let mut best: Option<(f64, Bell, Solved)> = None;
        for share in windows {
            let window = Bell { sigma_px: share * self.sigma_window_px };
            match iterated.solve(gradients, window, start, seed.point) {
                Ok(solved) => {
                    iterations += solved.iterations;
                    start = solved.position;
                    let precision = precision(&solved);
                    if best.as_ref().is_none_or(|(other, ..)| precision > *other) {
                        best = Some((precision, window, solved));
                    }
                }
                Err((status, steps)) => {
                    iterations += steps;
                    if best.is_none() {
                        return Corner::at_seed(*seed, iterations, status);
                    }
                    break;
                }
            }
        }
        let Some((_, window, solved)) = best else {
            return Corner::at_seed(*seed, iterations, RefineStatus::Singular);
        };
        gradients.take(solved.position, window.radius_px() + 1.0);
        solved.corner(gradients, window, seed, iterations)
    }
}

/// Of the worse direction, by what is left.
fn precision(solved: &Solved) -> f64 {
    let sums = &solved.sums;
    let least = sums.normal.symmetric_eigenvalues().min();
    (sums.weight - 2.0).max(0.0) * least / sums.squares.max(f64::MIN_POSITIVE)
}
