//! Gradients about a corner are orthogonal to the lines from it: the equations of Foerstner & Guelch (1987) with
//! any window, and the covariance of what solves them.

use nalgebra::{Matrix2, SymmetricEigen, Vector2};
use pulp::Simd;

use super::gradients::Gradients;
use super::{Corner, RefineStatus};
use crate::detect::Detection;
use crate::geometry::ImagePoint;
use crate::image::Plane;
use crate::vector::{Lanes, Real};

/// Weights of pixels by their distance from the corner.
pub(super) trait Window: Copy {
    /// Where they end \[px\].
    fn radius_px(&self) -> f64;
    /// The weight at a squared distance; 0 from the radius on.
    fn weight<S: Simd>(&self, simd: S, r2: Lanes<S>) -> Lanes<S>;
}

/// Sums over a window about a place, weighted.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sums {
    /// Of the weights.
    pub weight: f64,
    /// Of g g^T.
    pub normal: Matrix2<f64>,
    /// Of g (g . d).
    pub right: Vector2<f64>,
    /// Of (g . d)^2.
    pub squares: f64,
}

/// The least ratio of the eigenvalues of the normal matrix.
const LEAST_RATIO: f64 = 1e-2;

/// How many times as strong as noise the weaker direction's gradients must be, as a mean.
const LEAST_OVER_NOISE: f64 = 2.0;

impl Sums {
    /// The inverse of the normal matrix; `None` where gradients are of one direction, or those of the weaker
    /// one no stronger than noise.
    pub fn inverse(&self, noise2: f64) -> Option<Matrix2<f64>> {
        let values = SymmetricEigen::new(self.normal).eigenvalues;
        let (weaker, stronger) = (values.min(), values.max());
        let least = LEAST_OVER_NOISE * LEAST_OVER_NOISE * noise2 * self.weight;
        if weaker.is_nan() || weaker <= least || weaker < LEAST_RATIO * stronger {
            return None;
        }
        self.normal.try_inverse().filter(|inverse| inverse.iter().all(|value| value.is_finite()))
    }
}

/// How the equations are solved.
#[derive(Clone, Copy, Debug)]
pub(super) struct Iterated {
    /// Gradients below this share of the largest have no weight.
    pub least_gradient: f64,
    /// How far from the seed the corner may be \[px\].
    pub max_shift_px: f64,
    /// Steps at most.
    pub max_iterations: u32,
    /// The step that ends the iteration \[px\].
    pub epsilon_px: f64,
}

/// What solves them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solved {
    pub position: ImagePoint,
    pub iterations: u32,
    pub status: RefineStatus,
    /// About the last position but one.
    pub sums: Sums,
    inverse: Matrix2<f64>,
    least2: f32,
}

impl Iterated {
    /// Solves the equations from `start` on, the window about the corner, again and again; or says why not,
    /// and after how many steps.
    pub fn solve(
        &self,
        gradients: &mut Gradients,
        window: impl Window,
        start: ImagePoint,
        seed: ImagePoint,
    ) -> Result<Solved, (RefineStatus, u32)> {
        // So far the window may move before gradients are taken again.
        const MOVES_PX: f64 = 3.0;
        let mut middle = start;
        let mut position = start;
        gradients.take(middle, window.radius_px() + MOVES_PX);
        for iterations in 1..=self.max_iterations {
            if position.distance_px(middle) > MOVES_PX {
                middle = position;
                gradients.take(middle, window.radius_px() + MOVES_PX);
            }
            #[allow(clippy::cast_possible_truncation, reason = "a share")]
            let least2 = (self.least_gradient * self.least_gradient) as f32 * gradients.strongest2;
            let sums = sums(gradients, window, least2, position);
            let inverse =
                sums.inverse(gradients.noise2).ok_or((RefineStatus::Singular, iterations))?;
            let step = inverse * sums.right;
            position = ImagePoint::new(position.x + step.x, position.y + step.y);
            let is_near = position.distance_px(seed) <= self.max_shift_px;
            if !is_near || !gradients.light.is_inside(position) {
                return Err((RefineStatus::Diverged, iterations));
            }
            let is_done = step.norm() <= self.epsilon_px;
            if is_done || iterations == self.max_iterations {
                let status = if is_done { RefineStatus::Ok } else { RefineStatus::MaxIterations };
                return Ok(Solved { position, iterations, status, sums, inverse, least2 });
            }
        }
        Err((RefineStatus::MaxIterations, 0))
    }
}

impl Solved {
    /// It as a seed's corner, with its covariance: what each gradient does to it, and each pixel to the
    /// gradients. Where g changes, so does the point: dq = N^-1 sum w (dg (g . d) + g (dg . d)).
    pub fn corner(
        &self,
        gradients: &mut Gradients,
        window: impl Window,
        seed: &Detection,
        iterations: u32,
    ) -> Corner {
        let Self { position, inverse, least2, .. } = *self;
        let covariance = gradients.covariance(|gradients, margin, pulls| {
            let pulled = Pulled { gradients, window, least2, position, margin, pulls };
            pulp::Arch::new().dispatch(pulled);
        });
        let covariance = inverse * covariance * inverse.transpose();
        Corner {
            seed: *seed,
            position,
            covariance_px2: Some(covariance),
            iterations,
            status: self.status,
        }
    }
}

/// Sums over the window about a place; gradients whose square is less than `least2` have no weight.
fn sums(gradients: &Gradients, window: impl Window, least2: f32, position: ImagePoint) -> Sums {
    pulp::Arch::new().dispatch(Summed { gradients, window, least2, position })
}

/// Where a row lies from the corner.
struct Row<S: Simd> {
    dy: Lanes<S>,
    from_left: Lanes<S>,
}

#[inline(always)]
#[allow(clippy::cast_possible_truncation, reason = "sums are in single precision")]
fn row<S: Simd>(simd: S, gradients: &Gradients, position: ImagePoint, y: usize) -> (f64, Row<S>) {
    let dy = (y + gradients.range.y0) as f64 - position.y;
    let from_left = position.x - gradients.range.x0 as f64;
    let splat = |value: f64| Lanes::splat(simd, value as f32);
    (dy, Row { dy: splat(dy), from_left: splat(from_left) })
}

/// Compiled for the machine's vectors.
struct Summed<'a, 'b, W> {
    gradients: &'a Gradients<'b>,
    window: W,
    least2: f32,
    position: ImagePoint,
}

impl<W: Window> pulp::WithSimd for Summed<'_, '_, W> {
    type Output = Sums;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Sums {
        let Self { gradients, window, least2, position } = self;
        let zero = Lanes::splat(simd, 0.0);
        // Beyond a row's end gradients are 0: they must not pass.
        let least2 = Lanes::splat(simd, least2.max(f32::MIN_POSITIVE));
        let mut sums = [zero; 7];
        for y in 0..gradients.range.height() {
            let (dy, Row { dy: down, from_left }) = row(simd, gradients, position, y);
            if dy.abs() >= window.radius_px() {
                continue;
            }
            let (row_x, row_y) = (gradients.x.row(y), gradients.y.row(y));
            let mut x = 0;
            while x < row_x.len() {
                let gx = Lanes::load_part(simd, row_x, x);
                let gy = Lanes::load_part(simd, row_y, x);
                let dx = Lanes::load_part(simd, &gradients.columns, x) - from_left;
                let r2 = dx.mul_add(dx, down * down);
                let (xx, yy) = (gx * gx, gy * gy);
                let w = window.weight(simd, r2).where_at_least(xx + yy, least2);
                let across = gx.mul_add(dx, gy * down);
                let w_across = w * across;
                sums[0] = sums[0] + w;
                sums[1] = w.mul_add(xx, sums[1]);
                sums[2] = w.mul_add(gx * gy, sums[2]);
                sums[3] = w.mul_add(yy, sums[3]);
                sums[4] = w_across.mul_add(gx, sums[4]);
                sums[5] = w_across.mul_add(gy, sums[5]);
                sums[6] = w_across.mul_add(across, sums[6]);
                x += S::F32_LANES;
            }
        }
        let [weight, xx, xy, yy, x, y, squares] = sums;
        let [weight, xx, xy, yy, x, y, squares] = [
            weight.total(),
            xx.total(),
            xy.total(),
            yy.total(),
            x.total(),
            y.total(),
            squares.total(),
        ]
        .map(f64::from);
        let normal = Matrix2::new(xx, xy, xy, yy);
        Sums { weight, normal, right: Vector2::new(x, y), squares }
    }
}

/// What gradients do to the equations' right side: compiled for the machine's vectors.
struct Pulled<'a, 'b, W> {
    gradients: &'a Gradients<'b>,
    window: W,
    least2: f32,
    position: ImagePoint,
    margin: usize,
    pulls: &'a mut [[Plane<f32>; 2]; 2],
}

impl<W: Window> pulp::WithSimd for Pulled<'_, '_, W> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { gradients, window, least2, position, margin, pulls } = self;
        let least2 = Lanes::splat(simd, least2.max(f32::MIN_POSITIVE));
        let columns = margin..margin + gradients.range.width();
        let [[xx, xy], [yx, yy]] = pulls;
        for y in 0..gradients.range.height() {
            let (dy, Row { dy: down, from_left }) = row(simd, gradients, position, y);
            if dy.abs() >= window.radius_px() {
                continue;
            }
            let (row_x, row_y) = (gradients.x.row(y), gradients.y.row(y));
            let out_xx = &mut xx.row_mut(y + margin)[columns.clone()];
            let out_xy = &mut xy.row_mut(y + margin)[columns.clone()];
            let out_yx = &mut yx.row_mut(y + margin)[columns.clone()];
            let out_yy = &mut yy.row_mut(y + margin)[columns.clone()];
            let mut x = 0;
            while x < row_x.len() {
                let gx = Lanes::load_part(simd, row_x, x);
                let gy = Lanes::load_part(simd, row_y, x);
                let dx = Lanes::load_part(simd, &gradients.columns, x) - from_left;
                let r2 = dx.mul_add(dx, down * down);
                let strength2 = gx.mul_add(gx, gy * gy);
                let w = window.weight(simd, r2).where_at_least(strength2, least2);
                let across = gx.mul_add(dx, gy * down);
                (w * gx.mul_add(dx, across)).store_part(out_xx, x);
                (w * gx * down).store_part(out_xy, x);
                (w * gy * dx).store_part(out_yx, x);
                (w * gy.mul_add(down, across)).store_part(out_yy, x);
                x += S::F32_LANES;
            }
        }
    }
}
