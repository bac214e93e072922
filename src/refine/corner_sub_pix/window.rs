//! A step of the iteration: the normal equations of a window between pixels.

use pulp::Simd;

use super::CornerSubPix;
use crate::image::Plane;
use crate::vector::{Doubles, Lanes, Widen};

/// No vector holds more samples.
const MOST_LANES: usize = 16;

/// A step of the iteration.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    /// \[px\]
    pub by: [f64; 2],
    /// Of N.
    pub roundness: f64,
}

/// The window's weights, and room for what reaches beyond the image; one serves all seeds.
pub(super) struct Window {
    /// w.
    half: usize,
    /// m, 2w+1 rows, each followed by zeros up to whole vectors.
    weights: Vec<f64>,
    /// The offsets of columns and rows from the centre.
    offsets: Vec<f64>,
    /// The pixels under a window that reaches beyond the image.
    pixels: Vec<f32>,
}

impl Window {
    pub fn new(parameters: &CornerSubPix) -> Self {
        let half = usize::from(parameters.half_window_px);
        let w = f32::from(parameters.half_window_px);
        let side = 2 * half + 1;
        let padded = side.next_multiple_of(MOST_LANES);
        let offsets = (0..padded).map(|i| i as f64 - f64::from(w)).collect();
        let bell: Vec<f32> =
            (0..side).map(|i| (i as f32 - w) / w).map(|offset| (-offset * offset).exp()).collect();
        let mut weights = vec![0.0; side * padded];
        for (row, vy) in weights.chunks_exact_mut(padded).zip(&bell) {
            for (weight, vx) in row.iter_mut().zip(&bell) {
                *weight = f64::from(vy * vx);
            }
        }
        if let Ok(zone) = usize::try_from(parameters.zero_zone_px) {
            for row in weights.chunks_exact_mut(padded).skip(half - zone).take(2 * zone + 1) {
                row[half - zone..=half + zone].fill(0.0);
            }
        }
        Self { half, weights, offsets, pixels: vec![0.0; (side + 3) * (padded + 3)] }
    }

    /// The step from `centre` to the point that solves the normal equations of the window about it;
    /// `None` where they are singular.
    #[inline(always)]
    pub fn step<S: Widen>(
        &mut self,
        simd: S,
        plane: &Plane<f32>,
        centre: [f32; 2],
    ) -> Option<Step> {
        let reach = (self.half + 1) as f32;
        let corner = [centre[0] - reach, centre[1] - reach];
        let whole = [corner[0].floor(), corner[1].floor()];
        let between = [corner[0] - whole[0], corner[1] - whole[1]];
        #[allow(clippy::cast_possible_truncation, reason = "inside the image, less the reach")]
        let [x0, y0] = [whole[0] as isize, whole[1] as isize];

        let (rows, columns) = (2 * self.half + 4, self.offsets.len() + 3);
        let inside =
            |first: isize, count: usize| first >= 0 && first.unsigned_abs() + rows <= count;
        let first = y0.unsigned_abs() * plane.width() + x0.unsigned_abs();
        // A row's last vector may reach into the next row: what is there has no weight.
        let end = first + (rows - 1) * plane.width() + columns;
        let is_inside =
            inside(x0, plane.width()) && inside(y0, plane.height()) && end <= plane.samples().len();
        let sums = if is_inside {
            self.sums(simd, &plane.samples()[first..end], plane.width(), between)
        } else {
            self.copy(plane, [x0, y0]);
            self.sums(simd, &self.pixels, columns, between)
        };
        let [a, b, c, u, v] = sums;
        let determinant = a * c - b * b;
        if determinant.abs() <= f64::EPSILON * f64::EPSILON {
            return None;
        }
        let scale = 1.0 / determinant;
        Some(Step {
            by: [c * scale * u - b * scale * v, a * scale * v - b * scale * u],
            roundness: 4.0 * determinant / ((a + c) * (a + c)),
        })
    }

    /// Takes the pixels from (x0, y0) on, the border's continued outwards.
    fn copy(&mut self, plane: &Plane<f32>, [x0, y0]: [isize; 2]) {
        let (columns, stride) = (2 * self.half + 4, self.offsets.len() + 3);
        for (row, y) in self.pixels.chunks_exact_mut(stride).zip(y0..) {
            for (sample, x) in row[..columns].iter_mut().zip(x0..) {
                *sample = plane.at_replicated(x, y);
            }
        }
    }

    /// Sums over the window, weighted: of gx^2, gxgy, gy^2, and of g (g . p), p from the centre. `pixels`
    /// begin with the one left of and above the resampled window, which lies `between` it and the next.
    #[inline(always)]
    fn sums<S: Widen>(&self, simd: S, pixels: &[f32], stride: usize, [a, b]: [f32; 2]) -> [f64; 5] {
        let shares = [(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b];
        let [w0, w1, w2, w3] = shares;
        let shares = [
            Lanes::splat(simd, w0),
            Lanes::splat(simd, w1),
            Lanes::splat(simd, w2),
            Lanes::splat(simd, w3),
        ];
        let mut sums = [Doubles::splat(simd, 0.0); 5];
        let side = 2 * self.half + 1;
        // The second half may be beyond the window.
        let is_half = |column: usize| column + S::F64_LANES >= side || S::F64_LANES == S::F32_LANES;
        if side + 2 <= S::F32_LANES {
            let rows = Whole::new(simd, shares);
            if is_half(0) {
                self.add_columns::<S, _, 1>(simd, pixels, stride, rows, 0, &mut sums);
            } else {
                self.add_columns::<S, _, 2>(simd, pixels, stride, rows, 0, &mut sums);
            }
        } else {
            let mut column = 0;
            while column < side {
                let (rows, pixels) = (Parts::new(simd, shares), &pixels[column..]);
                if is_half(column) {
                    self.add_columns::<S, _, 1>(simd, pixels, stride, rows, column, &mut sums);
                } else {
                    self.add_columns::<S, _, 2>(simd, pixels, stride, rows, column, &mut sums);
                }
                column += S::F32_LANES;
            }
        }
        let [a, b, c, u, v] = sums;
        [a.total(), b.total(), c.total(), u.total(), v.total()]
    }

    /// Adds one vector's columns from `column` on, or the first half of it. Nothing is rounded otherwise
    /// than OpenCV does it up to the gradients; products and sums are of double precision, as there.
    #[inline(always)]
    fn add_columns<S: Widen, R: Resampled<S>, const HALVES: usize>(
        &self,
        simd: S,
        pixels: &[f32],
        stride: usize,
        mut rows: R,
        column: usize,
        sums: &mut [Doubles<S>; 5],
    ) {
        let (side, padded) = (2 * self.half + 1, self.offsets.len());
        let none = Lanes::splat(simd, 0.0);
        let mut parts = [[Doubles::splat(simd, 0.0); 5]; HALVES];
        // Of the resampled rows before: two above, one above, and the difference across that one.
        let (mut above, mut beside, mut gx) = (none, none, none);
        for row in 0..side + 3 {
            let samples = &pixels[row * stride..][..S::F32_LANES + 3];
            let [left, below, right] = rows.next(simd, samples);
            // The first row of pixels makes none, the next two make what differences need.
            if row >= 3 {
                let y = row - 3;
                let (gx, gy) = (gx.widen(), (below - above).widen());
                let py = Doubles::splat(simd, self.offsets[y]);
                for half in 0..HALVES {
                    let first = y * padded + column + half * S::F64_LANES;
                    let m = Doubles::load(simd, &self.weights, first);
                    let (m_gx, m_gy) = (m * gx[half], m * gy[half]);
                    let (m_xy, m_yy) = (m_gx * gy[half], m_gy * gy[half]);
                    let [xx, xy, yy, xy_py, yy_py] = &mut parts[half];
                    *xx = m_gx.mul_add(gx[half], *xx);
                    *xy = *xy + m_xy;
                    *yy = *yy + m_yy;
                    *xy_py = m_xy.mul_add(py, *xy_py);
                    *yy_py = m_yy.mul_add(py, *yy_py);
                }
            }
            (above, beside, gx) = (beside, below, right - left);
        }
        for (half, [xx, xy, yy, xy_py, yy_py]) in parts.into_iter().enumerate() {
            let px = Doubles::load(simd, &self.offsets, column + half * S::F64_LANES);
            sums[0] = sums[0] + xx;
            sums[1] = sums[1] + xy;
            sums[2] = sums[2] + yy;
            sums[3] = sums[3] + xx.mul_add(px, xy_py);
            sums[4] = sums[4] + xy.mul_add(px, yy_py);
        }
    }
}

/// A window's rows between pixels, one after the other: each is made of a row of pixels and the one before it, the
/// upper one.
trait Resampled<S: Simd>: Sized {
    /// By the shares of the four pixels about a place.
    fn new(simd: S, shares: [Lanes<S>; 4]) -> Self;
    /// The row of places one to the left of the window's columns, that of these, and that of those one to the
    /// right; `pixels` begin two to the left.
    fn next(&mut self, simd: S, pixels: &[f32]) -> [Lanes<S>; 3];
}

/// Each by its own pixels: of any width.
struct Parts<S: Simd> {
    shares: [Lanes<S>; 4],
    upper: [Lanes<S>; 3],
}

impl<S: Simd> Resampled<S> for Parts<S> {
    #[inline(always)]
    fn new(simd: S, shares: [Lanes<S>; 4]) -> Self {
        Self { shares, upper: [Lanes::splat(simd, 0.0); 3] }
    }

    #[inline(always)]
    fn next(&mut self, simd: S, pixels: &[f32]) -> [Lanes<S>; 3] {
        let [w0, w1, w2, w3] = self.shares;
        let s0 = Lanes::load(simd, pixels, 0);
        let s1 = Lanes::load(simd, pixels, 1);
        let s2 = Lanes::load(simd, pixels, 2);
        let s3 = Lanes::load(simd, pixels, 3);
        let [left, middle, right] = self.upper;
        self.upper = [s0 * w0 + s1 * w1, s1 * w0 + s2 * w1, s2 * w0 + s3 * w1];
        [left + (s0 * w2 + s1 * w3), middle + (s1 * w2 + s2 * w3), right + (s2 * w2 + s3 * w3)]
    }
}

/// A row that one vector holds with a column to each side: its neighbours are its own lanes.
struct Whole<S: Simd> {
    shares: [Lanes<S>; 4],
    upper: Lanes<S>,
}

impl<S: Simd> Resampled<S> for Whole<S> {
    #[inline(always)]
    fn new(simd: S, shares: [Lanes<S>; 4]) -> Self {
        Self { shares, upper: Lanes::splat(simd, 0.0) }
    }

    #[inline(always)]
    fn next(&mut self, simd: S, pixels: &[f32]) -> [Lanes<S>; 3] {
        let [w0, w1, w2, w3] = self.shares;
        let (s0, s1) = (Lanes::load(simd, pixels, 0), Lanes::load(simd, pixels, 1));
        let row = self.upper + (s0 * w2 + s1 * w3);
        self.upper = s0 * w0 + s1 * w1;
        [row, row.rotated_left(1), row.rotated_left(2)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::ImagePoint;
    use crate::vector::{WithWiden, dispatch_widening};

    #[test]
    fn weights_fall_to_e_to_the_minus_two_in_the_corner_and_vanish_in_the_zone() {
        let parameters = CornerSubPix { half_window_px: 2, zero_zone_px: 0, ..Default::default() };
        let window = Window::new(&parameters);
        let expected = [-2.0_f64, -1.25, -1.0, -1.25, -2.0].map(f64::exp);
        for (found, expected) in window.weights.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-7, "{found} {expected}");
        }
        assert!(window.weights[5].abs() < f64::MIN_POSITIVE); // beyond the window
        assert!(window.weights[2 * MOST_LANES + 2].abs() < f64::MIN_POSITIVE); // the centre
        assert!(window.weights[2 * MOST_LANES + 1] > 0.7);
    }

    /// A step of the machine's vectors.
    struct StepOf<'a>(&'a mut Window, &'a Plane<f32>, [f32; 2]);

    impl WithWiden for StepOf<'_> {
        type Output = Option<[f64; 2]>;

        #[inline(always)]
        fn with_simd<S: Widen>(self, simd: S) -> Option<[f64; 2]> {
            self.0.step(simd, self.1, self.2).map(|step| step.by)
        }
    }

    /// The same, pixel by pixel in f64.
    fn plain_step(refiner: &CornerSubPix, plane: &Plane<f32>, [x, y]: [f32; 2]) -> [f64; 2] {
        let w = i32::from(refiner.half_window_px);
        let at = |dx: i32, dy: i32| {
            plane.bilinear(ImagePoint::new(
                f64::from(x) + f64::from(dx),
                f64::from(y) + f64::from(dy),
            ))
        };
        let (mut normal, mut right) = (nalgebra::Matrix2::zeros(), nalgebra::Vector2::zeros());
        for dy in -w..=w {
            for dx in -w..=w {
                if dx.abs().max(dy.abs()) <= refiner.zero_zone_px {
                    continue;
                }
                let offset = nalgebra::Vector2::new(f64::from(dx), f64::from(dy));
                let m = (-offset.norm_squared() / f64::from(w * w)).exp();
                let gx = at(dx + 1, dy) - at(dx - 1, dy);
                let gy = at(dx, dy + 1) - at(dx, dy - 1);
                let g = nalgebra::Vector2::new(gx, gy);
                normal += m * g * g.transpose();
                right += m * g * g.dot(&offset);
            }
        }
        normal.lu().solve(&right).expect("two directions").into()
    }

    #[test]
    fn a_step_of_vectors_is_that_of_pixels_across_the_border_too() {
        let hash = |x: usize, y: usize| ((x * 7 + y * 13) * (x ^ (3 * y)) % 223) as f32;
        let plane = Plane::from_fn(61, 53, hash);
        for half_window_px in [1, 2, 3, 5, 7, 8, 12, 20] {
            for zero_zone_px in [-1, 0, i32::from(half_window_px) / 2] {
                let refiner = CornerSubPix { half_window_px, zero_zone_px, ..Default::default() };
                let mut window = Window::new(&refiner);
                for place in [
                    [30.0, 25.0],
                    [29.75, 26.3],
                    [38.9, 30.1],
                    [0.25, 8.0],
                    [60.9, 52.6],
                    [59.0, 0.1],
                    [12.4, 51.7],
                    [60.3 - f32::from(half_window_px), 51.5 - f32::from(half_window_px)],
                ] {
                    let found = dispatch_widening(StepOf(&mut window, &plane, place));
                    let found = found.expect("two directions");
                    let wanted = plain_step(&refiner, &plane, place);
                    let off = (found[0] - wanted[0]).hypot(found[1] - wanted[1]);
                    assert!(off < 2e-5, "{refiner:?} {place:?}: {found:?} {wanted:?}");
                }
            }
        }
    }
}
