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
//! # Output      position, covariance, iterations, status. The covariance is that of the normal
//!               equations with residuals that are correlated by sigma_d: s^2 N^-1 (sum w^2 g g^T) N^-1
//!               4 pi sigma_d^2, s^2 the weighted mean square of g . d. diverged: it left max_shift_px;
//!               singular: gradients of one direction only (the eigenvalues' ratio below 1e-2), or no
//!               more than noise has; max_iterations: the last position. Elsewhere the seed's own.
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

use nalgebra::{Matrix2, SymmetricEigen, Vector2};
use pulp::Simd;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Detection;
use crate::filter::{Border, ImageRows, Kernel};
use crate::geometry::ImagePoint;
use crate::image::{PixelRange, Plane};
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, in_range, parameters, schema};
use crate::sensor::{Exposure, LinearLight};
use crate::vector::{Lanes, Real};

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "annular_orthogonality",
    summary: "gradient orthogonality of Gaussian derivatives in an annulus, in linear light",
    reference: "Foerstner & Guelch 1987; the annulus and its weights are our own",
    version: 1,
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

/// The least ratio of the eigenvalues of N.
const LEAST_RATIO: f64 = 1e-2;

/// How many times as strong as noise the weaker direction's gradients must be, as a mean.
const LEAST_OVER_NOISE: f64 = 2.0;

impl Refiner for AnnularOrthogonality {
    fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner> {
        let mut patch = Patch::new(self, exposure);
        seeds.iter().map(|seed| self.refine_one(exposure, &mut patch, seed)).collect()
    }
}

impl AnnularOrthogonality {
    fn refine_one(&self, exposure: &Exposure, patch: &mut Patch, seed: &Detection) -> Corner {
        if !patch.take(exposure, seed.point, self.radius_px + self.max_shift_px) {
            return Corner::at_seed(*seed, 0, RefineStatus::OutOfBounds);
        }
        let start = Vector2::new(seed.point.x, seed.point.y);
        let mut position = start;
        for iterations in 1..=self.max_iterations {
            let sums = patch.sums(self, position);
            let Some(step) = sums.step(patch.noise2) else {
                return Corner::at_seed(*seed, iterations, RefineStatus::Singular);
            };
            position += step;
            if (position - start).norm() > self.max_shift_px {
                return Corner::at_seed(*seed, iterations, RefineStatus::Diverged);
            }
            let is_done = step.norm() <= self.epsilon_px;
            if is_done || iterations == self.max_iterations {
                return Corner {
                    seed: *seed,
                    position: ImagePoint::new(position.x, position.y),
                    covariance_px2: sums.covariance_px2(self.sigma_d),
                    iterations,
                    status: if is_done { RefineStatus::Ok } else { RefineStatus::MaxIterations },
                };
            }
        }
        Corner::at_seed(*seed, 0, RefineStatus::MaxIterations)
    }
}

/// Sums over a window: all weighted.
struct Sums {
    /// Of the weights.
    weight: f64,
    /// Of g g^T.
    normal: Matrix2<f64>,
    /// Of g (g . d).
    right: Vector2<f64>,
    /// Of (g . d)^2.
    squares: f64,
    /// Of g g^T, weighted twice.
    normal2: Matrix2<f64>,
}

impl Sums {
    /// The step to the point that solves the equations; `None` where gradients are of one direction, or
    /// those of the weaker one no stronger than noise.
    fn step(&self, noise2: f64) -> Option<Vector2<f64>> {
        let values = SymmetricEigen::new(self.normal).eigenvalues;
        let (weaker, stronger) = (values.min(), values.max());
        let least = LEAST_OVER_NOISE * LEAST_OVER_NOISE * noise2 * self.weight;
        if weaker.is_nan() || weaker <= least || weaker < LEAST_RATIO * stronger {
            return None;
        }
        let step = self.normal.try_inverse()? * self.right;
        (step.x.is_finite() && step.y.is_finite()).then_some(step)
    }

    fn covariance_px2(&self, sigma_d: f64) -> Option<Matrix2<f64>> {
        let inverse = self.normal.try_inverse()?;
        let variance = self.squares / self.weight;
        // So many neighbouring gradients share their noise.
        let shared = 4.0 * std::f64::consts::PI * sigma_d * sigma_d;
        let covariance = shared * variance * inverse * self.normal2 * inverse;
        covariance.iter().all(|value| value.is_finite()).then_some(covariance)
    }
}

/// Gradients about a seed, and memory for them: one serves all seeds.
struct Patch {
    light: LinearLight,
    gaussian: Kernel,
    derivative: Kernel,
    /// The pixels whose gradients are known.
    range: PixelRange,
    /// Linear light of these and of so many around them as the kernels reach.
    samples: Plane<f32>,
    row: Vec<f32>,
    gradient_x: Plane<f32>,
    gradient_y: Plane<f32>,
    /// 0, 1, 2, ...
    columns: Vec<f32>,
    /// The largest squared gradient.
    strongest2: f32,
    /// Variance of a gradient's component by noise alone.
    noise2: f64,
}

impl Patch {
    fn new(refiner: &AnnularOrthogonality, exposure: &Exposure) -> Self {
        Self {
            light: exposure.linear_light(),
            gaussian: Kernel::gaussian(refiner.sigma_d),
            derivative: Kernel::gaussian_derivative(refiner.sigma_d),
            range: PixelRange { x0: 0, y0: 0, x1: 0, y1: 0 },
            samples: Plane::default(),
            row: Vec::new(),
            gradient_x: Plane::default(),
            gradient_y: Plane::default(),
            columns: Vec::new(),
            strongest2: 0.0,
            noise2: 0.0,
        }
    }

    /// Takes the gradients so far from a seed and nearer; false where it lies outside the image.
    fn take(&mut self, exposure: &Exposure, seed: ImagePoint, reach_px: f64) -> bool {
        let inside = |place: f64, count: usize| (-0.5..count as f64 - 0.5).contains(&place);
        let (width, height) = (exposure.width(), exposure.height());
        if !inside(seed.x, width) || !inside(seed.y, height) {
            return false;
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in the image")]
        let span = |place: f64, count: usize| {
            let first = (place - reach_px).floor().max(0.0) as usize;
            (first, ((place + reach_px).ceil() as usize + 1).min(count))
        };
        let ((x0, x1), (y0, y1)) = (span(seed.x, width), span(seed.y, height));
        self.range = PixelRange { x0, y0, x1, y1 };
        self.fill(exposure);
        pulp::Arch::new().dispatch(Gradients(self));
        self.columns.clear();
        #[allow(clippy::cast_precision_loss, reason = "some dozens")]
        self.columns.extend((0..self.range.width()).map(|x| x as f32));

        let (x, y) = (seed.x.round().max(0.0), seed.y.round().max(0.0));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in the image")]
        let level_dn = exposure.rgb()[1].at(x as usize, y as usize);
        let slope = f64::from(self.light.of(level_dn + 0.5) - self.light.of(level_dn - 0.5));
        let energy = |kernel: &Kernel| kernel.taps().iter().map(|t| f64::from(t * t)).sum::<f64>();
        self.noise2 = exposure.variance_dn2(1, f64::from(level_dn))
            * slope
            * slope
            * energy(&self.gaussian)
            * energy(&self.derivative);
        true
    }

    /// The light of the range and around it.
    fn fill(&mut self, exposure: &Exposure) {
        const WEIGHTS: [f32; 3] = [0.2126, 0.7152, 0.0722];
        let radius = self.gaussian.radius().max(self.derivative.radius());
        let PixelRange { x0, y0, .. } = self.range;
        let (width, height) = (self.range.width(), self.range.height());
        self.samples.reset(width + 2 * radius, height + 2 * radius, 0.0);
        let source = |place: usize, first: usize, count: usize| {
            (first + place).saturating_sub(radius).min(count - 1)
        };
        let channels = exposure.rgb();
        for y in 0..height + 2 * radius {
            let from = source(y, y0, exposure.height());
            let rows = [0, 1, 2].map(|channel| channels[channel].row(from));
            for (x, sample) in self.samples.row_mut(y).iter_mut().enumerate() {
                let x = source(x, x0, exposure.width());
                *sample = WEIGHTS[0] * self.light.of(rows[0][x])
                    + WEIGHTS[1] * self.light.of(rows[1][x])
                    + WEIGHTS[2] * self.light.of(rows[2][x]);
            }
        }
    }

    fn sums(&self, refiner: &AnnularOrthogonality, position: Vector2<f64>) -> Sums {
        pulp::Arch::new().dispatch(Summed { patch: self, refiner, position })
    }
}

/// The gradients of a patch: compiled for the machine's vectors.
struct Gradients<'a>(&'a mut Patch);

impl pulp::WithSimd for Gradients<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Patch { gaussian, derivative, range, samples, row, gradient_x, gradient_y, .. } =
            self.0;
        let (width, height) = (range.width(), range.height());
        gradient_x.resize(width, height, 0.0);
        gradient_y.resize(width, height, 0.0);
        row.resize(samples.width(), 0.0);
        let radius = gaussian.radius().max(derivative.radius());
        let (g, d) = (radius - gaussian.radius(), radius - derivative.radius());
        for y in 0..height {
            let rows = |first: usize| ImageRows {
                image: samples.view(),
                first: (y + first).cast_signed(),
                column: 0,
                border: Border::Replicate,
            };
            gaussian.across(simd, &rows(g), row);
            derivative.along(simd, &row[d..], gradient_x.row_mut(y));
            derivative.across(simd, &rows(d), row);
            gaussian.along(simd, &row[g..], gradient_y.row_mut(y));
        }
        let mut strongest2 = Lanes::splat(simd, 0.0);
        let mut x = 0;
        let (all_x, all_y) = (gradient_x.samples(), gradient_y.samples());
        while x < all_x.len() {
            let (gx, gy) = (Lanes::load_part(simd, all_x, x), Lanes::load_part(simd, all_y, x));
            strongest2 = strongest2.max(gx.mul_add(gx, gy * gy));
            x += S::F32_LANES;
        }
        self.0.strongest2 = strongest2.largest();
    }
}

/// The sums about a position: compiled for the machine's vectors.
struct Summed<'a> {
    patch: &'a Patch,
    refiner: &'a AnnularOrthogonality,
    position: Vector2<f64>,
}

impl pulp::WithSimd for Summed<'_> {
    type Output = Sums;

    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "sums are in single precision")]
    fn with_simd<S: Simd>(self, simd: S) -> Sums {
        let Self { patch, refiner, position } = self;
        let AnnularOrthogonality { radius_px, zone_px, least_gradient, .. } = *refiner;
        let splat = |value: f64| Lanes::splat(simd, value as f32);
        let (zero, one) = (splat(0.0), splat(1.0));
        // The annulus begins and ends where its weight is 0 and 1.
        let (inner2, outer2) = ((zone_px - 1.0).powi(2), (zone_px + 1.0).powi(2));
        let (begin, slope) = (splat(inner2), splat(1.0 / (outer2 - inner2)));
        let end = splat(-1.0 / (radius_px * radius_px));
        // Beyond a row's end gradients are 0: they must not pass.
        let least2 = least_gradient * least_gradient * f64::from(patch.strongest2);
        let least2 = splat(least2.max(f64::from(f32::MIN_POSITIVE)));
        let PixelRange { x0, y0, .. } = patch.range;
        let from_left = splat(position.x - x0 as f64);
        let mut sums = [zero; 10];
        for y in 0..patch.range.height() {
            let dy = (y + y0) as f64 - position.y;
            if dy.abs() >= radius_px {
                continue;
            }
            let (row_x, row_y) = (patch.gradient_x.row(y), patch.gradient_y.row(y));
            let dy = splat(dy);
            let mut x = 0;
            while x < row_x.len() {
                let gx = Lanes::load_part(simd, row_x, x);
                let gy = Lanes::load_part(simd, row_y, x);
                let dx = Lanes::load_part(simd, &patch.columns, x) - from_left;
                let r2 = dx.mul_add(dx, dy * dy);
                let window = end.mul_add(r2, one).max(zero);
                let place = ((r2 - begin) * slope).max(zero).min(one);
                let annulus = place * place * (one + one + one - place - place);
                let (xx, yy) = (gx * gx, gy * gy);
                let w = (window * window * annulus).where_at_least(xx + yy, least2);
                let (w_xx, w_xy, w_yy) = (w * xx, w * (gx * gy), w * yy);
                let across = gx.mul_add(dx, gy * dy);
                let w_across = w * across;
                sums[0] = sums[0] + w;
                sums[1] = sums[1] + w_xx;
                sums[2] = sums[2] + w_xy;
                sums[3] = sums[3] + w_yy;
                sums[4] = w_across.mul_add(gx, sums[4]);
                sums[5] = w_across.mul_add(gy, sums[5]);
                sums[6] = w_across.mul_add(across, sums[6]);
                sums[7] = w.mul_add(w_xx, sums[7]);
                sums[8] = w.mul_add(w_xy, sums[8]);
                sums[9] = w.mul_add(w_yy, sums[9]);
                x += S::F32_LANES;
            }
        }
        let mut totals = [0.0; 10];
        for (total, sum) in totals.iter_mut().zip(sums) {
            *total = f64::from(sum.total());
        }
        let [weight, xx, xy, yy, x, y, squares, xx2, xy2, yy2] = totals;
        Sums {
            weight,
            normal: Matrix2::new(xx, xy, xy, yy),
            right: Vector2::new(x, y),
            squares,
            normal2: Matrix2::new(xx2, xy2, xy2, yy2),
        }
    }
}
