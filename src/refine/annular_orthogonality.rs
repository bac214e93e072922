//! Annular gradient orthogonality: gradients about a corner are orthogonal to the lines from it, and
//! those too near to it are left out.
//!
//! ```text
//! # Method      q minimises the sum over pixels p of w (g . (p - q))^2, as cornerSubPix has it, with
//!               other gradients and weights. Each iteration, d = p - q:
//!                 N = sum w g g^T,  q += N^-1 sum w g (g . d)
//!               g: Gaussian derivatives of linear light at sigma_d, alike in all directions, on the
//!               image's own grid. w(r) = (1 - (r / R)^2)^2 s(r): a window that ends at R, and an annulus
//!               without its middle, s from 0 at z - 1 px to 1 at z + 1 px, smooth in r^2. Blur rounds an
//!               L's vertex and pulls what looks there into the corner; z leaves it out.
//! # Input       red, green and blue as encoded, decoded to linear light, weighted by 0.2126, 0.7152,
//!               0.0722 (Rec. 709). Gain and offset cancel.
//! # Parameters  sigma_d         px, 1     range [0.5, 3]
//!               radius_px       px, 14    range [4, 40]: R
//!               zone_px         px, 4     range [1, 20], less than R - 1: z; about 3.3 times the blur of
//!                                         image and gradient together
//!               least_gradient  none, 0.1 range [0, 1): of the window's largest; less is noise or a ramp
//!               max_shift_px    px, 6     range [0.5, 20]: how far from its seed a corner may be
//!               max_iterations  none, 30  range [1, 100]
//!               epsilon_px      px, 1e-4  range [0, 1]: done when a step is no longer than this
//! # Output      position, covariance, iterations, status. The covariance is the noise of each pixel times
//!               what it does to q: dq = N^-1 sum w (dg (g . d) + g (dg . d)); what ramps and blur do is
//!               not in it. diverged: it left max_shift_px; singular: gradients of one direction only (the
//!               eigenvalues' ratio below 1e-2), or no more than noise has; max_iterations: the last
//!               position. Elsewhere the seed's own.
//! # Border      pixels beyond the image are replicated for the gradients and have no weight; a seed
//!               outside the image is out_of_bounds.
//! # Cost        O((R + max_shift)^2) for the gradients of a seed, O(R^2) for each iteration.
//! # Departures  The source's sums are over all of a window. The annulus wants edges that are straight, alone
//!               and of even brightness on both sides out to R: on the six scenes of suite `quick`, with
//!               Harris's seeds, inner edges, shadows and occluders within 14 px make it worse (median
//!               0.91 px) than corner_sub_pix (0.38 px); R = 7 and z = 1.5 give 0.54 px. Where other things
//!               are near, give a smaller R.
//! # Source      Foerstner & Guelch, ISPRS Intercommission Workshop 1987 (the equations).
//! # Checked by  tests/it/contract.rs (all), tests/it/refiners.rs
//! ```

use pulp::Simd;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Detection;
use crate::refine::gradients::Gradients;
use crate::refine::orthogonality::{Iterated, Window};
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, in_range, parameters, schema};
use crate::sensor::Exposure;
use crate::vector::{Lanes, Real};

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "annular_orthogonality",
    summary: "gradient orthogonality of Gaussian derivatives in an annulus, in linear light",
    reference: "Foerstner & Guelch 1987; the annulus and its weights are our own",
    version: 2,
    defaults: defaults::<AnnularOrthogonality>,
    schema: schema::<AnnularOrthogonality>,
    build: |place, table| {
        let refiner: AnnularOrthogonality = parameters(place, table)?;
        in_range(place, "zone_px", refiner.zone_px, 1.0..=refiner.radius_px - 1.0)?;
        Ok(Box::new(refiner))
    },
};

/// The refiner; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct AnnularOrthogonality {
    /// Scale of the Gaussian derivatives \[px\].
    #[schemars(range(min = 0.5, max = 3.0))]
    pub sigma_d: f64,
    /// Where the window ends \[px\].
    #[schemars(range(min = 4.0, max = 40.0))]
    pub radius_px: f64,
    /// Radius of the middle that is left out, to half its weight \[px\].
    #[schemars(range(min = 1.0, max = 20.0))]
    pub zone_px: f64,
    /// Gradients below this share of the largest have no weight.
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 1.0))]
    pub least_gradient: f64,
    /// How far from its seed a corner may be \[px\].
    #[schemars(range(min = 0.5, max = 20.0))]
    pub max_shift_px: f64,
    /// Iterations at most.
    #[schemars(range(min = 1, max = 100))]
    pub max_iterations: u32,
    /// The step that ends the iteration \[px\].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub epsilon_px: f64,
}

impl Default for AnnularOrthogonality {
    fn default() -> Self {
        Self {
            sigma_d: 1.0,
            radius_px: 14.0,
            zone_px: 4.0,
            least_gradient: 0.1,
            max_shift_px: 6.0,
            max_iterations: 30,
            epsilon_px: 1e-4,
        }
    }
}

/// A window that ends smoothly at a radius, without its middle.
#[derive(Clone, Copy)]
struct Annulus {
    radius_px: f64,
    /// The squared distances where the middle ends and the whole weight begins.
    inner2: f32,
    outer2: f32,
}

impl Window for Annulus {
    fn radius_px(&self) -> f64 {
        self.radius_px
    }

    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "weights are in single precision")]
    fn weight<S: Simd>(&self, simd: S, r2: Lanes<S>) -> Lanes<S> {
        let splat = |value: f32| Lanes::splat(simd, value);
        let (zero, one) = (splat(0.0), splat(1.0));
        let end = splat(-(1.0 / (self.radius_px * self.radius_px)) as f32);
        let window = end.mul_add(r2, one).max(zero);
        let place = (r2 - splat(self.inner2)) * (1.0 / (self.outer2 - self.inner2));
        let place = place.max(zero).min(one);
        window * window * (place * place * (splat(3.0) - place - place))
    }
}

impl Refiner for AnnularOrthogonality {
    #[allow(clippy::cast_possible_truncation, reason = "weights are in single precision")]
    fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner> {
        let mut gradients = Gradients::new(exposure, self.sigma_d);
        let window = Annulus {
            radius_px: self.radius_px,
            inner2: (self.zone_px - 1.0).powi(2) as f32,
            outer2: (self.zone_px + 1.0).powi(2) as f32,
        };
        let iterated = Iterated {
            least_gradient: self.least_gradient,
            max_shift_px: self.max_shift_px,
            max_iterations: self.max_iterations,
            epsilon_px: self.epsilon_px,
        };
        let refined = |seed: &Detection| {
            if !gradients.light.is_inside(seed.point) {
                return Corner::at_seed(*seed, 0, RefineStatus::OutOfBounds);
            }
            match iterated.solve(&mut gradients, window, seed.point, seed.point) {
                Ok(solved) => solved.corner(&mut gradients, window, seed, solved.iterations),
                Err((status, iterations)) => Corner::at_seed(*seed, iterations, status),
            }
        };
        seeds.iter().map(refined).collect()
    }
}
