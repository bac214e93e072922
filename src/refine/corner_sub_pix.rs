//! Gradient orthogonality, exactly as OpenCV's `cornerSubPix` computes it.
//!
//! ```text
//! # Method      q minimises the sum over its window of m (g . (p - q))^2: every gradient g is
//!               orthogonal to the line from its pixel p to the corner q. Each iteration, p from q:
//!                 N = [a b; b c] = sum m g g^T,  [u; v] = sum m g g^T p
//!                 q += [c u - b v; a v - b u] / (a c - b^2)
//!               g: differences I(x+1) - I(x-1) of the window resampled at q (bilinear);
//!               m = exp(-(i/w)^2) exp(-(j/w)^2) for offsets i, j in [-w, w].
//! # Input       luma as encoded [DN]; gain and offset cancel. Positions and gradients are kept in
//!               f32, rounded as OpenCV rounds them, sums in f64: an iteration that does not converge
//!               makes of any other rounding another answer.
//! # Parameters  half_window_px  px, 5     range [1, 255]: w; the window is (2w+1)^2 pixels
//!               zero_zone_px    px, -1    range [-1, w-1]: z >= 0 leaves (2z+1)^2 pixels out
//!               max_iterations  none, 40  range [1, 100]
//!               epsilon_px      px, 1e-3  range [0, inf): done when a step is no longer than this
//!               least_roundness none, 0.03  range [0, 1): of N, 4 det N / (tr N)^2, at the answer; 0 is OpenCV
//! # Output      position, iterations, status; no covariance.
//! # Border      the window continues outwards with border pixels; the image has at least 2w+5 rows
//!               and columns; seeds and steps stay in [0, width) x [0, height).
//! # Cost        O(w^2) per iteration.
//! # Departures  OpenCV returns positions alone. What it does silently is a status here, and the
//!               position of a declined seed is the seed's: reverted (its answer lies further than
//!               w from the seed; OpenCV returns the seed), out_of_bounds (a step leaves the image)
//!               and singular (both after the first iteration: OpenCV returns the last position
//!               inside). On a straight edge aslant OpenCV answers somewhere along it: its equations are
//!               singular but for the pixels' grid; where N is not round, that is singular here.
//!               Where it throws for the whole batch, a seed is out_of_bounds: outside the
//!               image, or an image under 2w+5. Windows across the border differ by rounding, and
//!               past the image's top right corner by more: there OpenCV 5.0.0 does not continue
//!               the border pixels.
//! # Source      Foerstner & Guelch, ISPRS Intercommission Workshop 1987 (the equations); OpenCV
//!               5.0.0, modules/imgproc/src/cornersubpix.cpp and samplers.cpp (what is summed, and
//!               when it stops).
//! # Checked by  tests/it/contract.rs (all), tests/it/oracle.rs::corner_sub_pix_equals_opencv,
//!               corner_sub_pix_recovers_quarter_pixel_shifts, tests/it/opencv.rs (10,000 seeds, w = 3,
//!               5, 7, 10, to 1e-4 px). Against OpenCV 5.0.0 on 12,000 seeds more (junctions, texture, a
//!               rendered picture): the same seeds reverted; across the border 9 of 30,000 answers
//!               differ by more than 1e-4 px, elsewhere none.
//! ```

use pulp::Simd;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Detection;
use crate::geometry::ImagePoint;
use crate::image::Plane;
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, in_range, parameters, schema};
use crate::sensor::Exposure;
use crate::vector::{Doubles, Lanes, Widen, WithWiden, dispatch_widening};

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "corner_sub_pix",
    summary: "gradient orthogonality, as OpenCV's cornerSubPix",
    reference: "Foerstner & Guelch 1987; OpenCV 5.0.0 cornerSubPix",
    version: 3,
    defaults: defaults::<CornerSubPix>,
    schema: schema::<CornerSubPix>,
    build: |place, table| {
        let refiner: CornerSubPix = parameters(place, table)?;
        let half_window = i32::from(refiner.half_window_px);
        in_range(place, "zero_zone_px", refiner.zero_zone_px, -1..=half_window - 1)?;
        Ok(Box::new(refiner))
    },
};

/// The refiner; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct CornerSubPix {
    /// Half the window's side \[px\], its centre not counted.
    #[schemars(range(min = 1, max = 255))]
    pub half_window_px: u8,
    /// Half the side of the square left out around the centre \[px\]; -1 leaves nothing out.
    #[schemars(range(min = -1, max = 254))]
    pub zero_zone_px: i32,
    /// Iterations at most.
    #[schemars(range(min = 1, max = 100))]
    pub max_iterations: u32,
    /// The step that ends the iteration \[px\].
    #[schemars(range(min = 0.0))]
    pub epsilon_px: f64,
    /// Answers from gradients of next to one direction are declined: 4 det N / (tr N)^2 below this.
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 1.0))]
    pub least_roundness: f64,
}

impl Default for CornerSubPix {
    fn default() -> Self {
        Self {
            half_window_px: 5,
            zero_zone_px: -1,
            max_iterations: 40,
            epsilon_px: 1e-3,
            least_roundness: 0.03,
        }
    }
}

impl Refiner for CornerSubPix {
    fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner> {
        let plane = exposure.luma();
        let least = 2 * usize::from(self.half_window_px) + 5;
        if plane.width() < least || plane.height() < least {
            let declined = |seed: &Detection| Corner::at_seed(*seed, 0, RefineStatus::OutOfBounds);
            return seeds.iter().map(declined).collect();
        }
        dispatch_widening(Refined { refiner: self, plane, seeds })
    }
}

/// The corners of some seeds: compiled for the machine's vectors.
struct Refined<'a> {
    refiner: &'a CornerSubPix,
    plane: &'a Plane<f32>,
    seeds: &'a [Detection],
}

impl WithWiden for Refined<'_> {
    type Output = Vec<Corner>;

    #[inline(always)]
    fn with_simd<S: Widen>(self, simd: S) -> Vec<Corner> {
        let Self { refiner, plane, seeds } = self;
        let mut window = Window::new(refiner);
        // Those outside the image stay as they are.
        let outside = |seed: &Detection| Corner::at_seed(*seed, 0, RefineStatus::OutOfBounds);
        let mut corners: Vec<Corner> = seeds.iter().map(outside).collect();
        let mut starts = seeds.iter().enumerate().filter_map(|(index, seed)| {
            #[allow(clippy::cast_possible_truncation, reason = "OpenCV keeps positions in f32")]
            let start = [seed.point.x as f32, seed.point.y as f32];
            contains(plane, start).then_some(Run { index, start, position: start, iterations: 0 })
        });
        // A step waits for its own sums: the machine goes on with another corner's meanwhile.
        let mut runs = [starts.next(), starts.next()];
        while runs.iter().any(Option::is_some) {
            for slot in &mut runs {
                let Some(run) = slot else { continue };
                if let Some(end) = refiner.advance(simd, plane, &mut window, run) {
                    let corner = &mut corners[run.index];
                    corner.status = end;
                    corner.iterations = run.iterations;
                    if matches!(end, RefineStatus::Ok | RefineStatus::MaxIterations) {
                        let [x, y] = run.position.map(f64::from);
                        corner.position = ImagePoint::new(x, y);
                    }
                    *slot = starts.next();
                }
            }
        }
        corners
    }
}

/// A corner's iteration.
#[derive(Clone, Copy, Debug)]
struct Run {
    /// Of its seed.
    index: usize,
    start: [f32; 2],
    position: [f32; 2],
    iterations: u32,
}

impl CornerSubPix {
    /// A step of a run; its status where that ends it.
    #[inline(always)]
    fn advance<S: Widen>(
        &self,
        simd: S,
        plane: &Plane<f32>,
        window: &mut Window,
        run: &mut Run,
    ) -> Option<RefineStatus> {
        let Some(Step { by: [dx, dy], roundness }) = window.step(simd, plane, run.position) else {
            return Some(RefineStatus::Singular);
        };
        let [x, y] = run.position;
        #[allow(clippy::cast_possible_truncation, reason = "OpenCV keeps positions in f32")]
        let next = [(f64::from(x) + dx) as f32, (f64::from(y) + dy) as f32];
        if !contains(plane, next) {
            return Some(RefineStatus::OutOfBounds);
        }
        run.position = next;
        run.iterations += 1;
        let [dx, dy] = [next[0] - x, next[1] - y];
        let is_done = f64::from(dx * dx + dy * dy) <= self.epsilon_px * self.epsilon_px;
        if !is_done && run.iterations < self.max_iterations {
            return None;
        }
        let reach = f32::from(self.half_window_px);
        Some(if (next[0] - run.start[0]).abs() > reach || (next[1] - run.start[1]).abs() > reach {
            RefineStatus::Reverted
        } else if roundness < self.least_roundness {
            RefineStatus::Singular
        } else if is_done {
            RefineStatus::Ok
        } else {
            RefineStatus::MaxIterations
        })
    }
}

/// Whether a position counts as inside: from the first pixel's centre up to, and without, the one
/// after the last; never for NaN.
#[inline(always)]
fn contains(plane: &Plane<f32>, [x, y]: [f32; 2]) -> bool {
    (0.0..plane.width() as f32).contains(&x) && (0.0..plane.height() as f32).contains(&y)
}

/// No vector holds more samples.
const MOST_LANES: usize = 16;

/// A step of the iteration.
#[derive(Clone, Copy, Debug)]
struct Step {
    /// \[px\]
    by: [f64; 2],
    /// Of N.
    roundness: f64,
}

/// The window's weights, and room for what reaches beyond the image; one serves all seeds.
struct Window {
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
    fn new(parameters: &CornerSubPix) -> Self {
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
    fn step<S: Widen>(&mut self, simd: S, plane: &Plane<f32>, centre: [f32; 2]) -> Option<Step> {
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
    use crate::sensor::{Encoding, Transfer};

    fn grey(width: usize, height: usize, value: impl FnMut(usize, usize) -> f32) -> Exposure {
        let plane = Plane::from_fn(width, height, value);
        let encoding = Encoding { bit_depth: 8, transfer: Transfer::Srgb, black_dn: 0.0 };
        Exposure::new([plane.clone(), plane.clone(), plane], encoding).expect("finite")
    }

    /// A chessboard's corner between the pixels 9 and 10, both ways.
    fn chess() -> Exposure {
        grey(20, 20, |x, y| if (x < 10) == (y < 10) { 200.0 } else { 50.0 })
    }

    fn refine(refiner: &CornerSubPix, exposure: &Exposure, x: f64, y: f64) -> Corner {
        let seed = Detection::new(ImagePoint::new(x, y), 1.0);
        refiner.refine(exposure, &[seed])[0]
    }

    #[test]
    fn a_corner_between_pixels_is_found_from_every_side() {
        for (x, y) in [(9.0, 9.0), (10.0, 9.0), (8.0, 11.0), (9.3, 12.0)] {
            let corner = refine(&CornerSubPix::default(), &chess(), x, y);
            assert_eq!(corner.status, RefineStatus::Ok);
            assert!(corner.position.distance_px(ImagePoint::new(9.5, 9.5)) < 1e-3, "{corner:?}");
        }
    }

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

    #[test]
    fn one_iteration_that_has_not_converged_says_so() {
        let refiner = CornerSubPix { max_iterations: 1, ..Default::default() };
        let corner = refine(&refiner, &chess(), 8.0, 8.0);
        assert_eq!((corner.status, corner.iterations), (RefineStatus::MaxIterations, 1));
        assert!(corner.position != corner.seed.point);
    }

    #[test]
    fn an_answer_beyond_the_window_is_given_up() {
        // From 4 px off, a window of +-3 sees the corner's edges run towards it step by step.
        let refiner = CornerSubPix { half_window_px: 3, ..Default::default() };
        let corner = refine(&refiner, &chess(), 6.0, 6.0);
        assert_eq!(corner.status, RefineStatus::Reverted, "{corner:?}");
        assert_eq!(corner.position, corner.seed.point);
    }

    #[test]
    fn no_gradient_or_one_direction_is_singular() {
        let flat = grey(20, 20, |_, _| 80.0);
        let edge = grey(20, 20, |x, _| if x < 10 { 80.0 } else { 90.0 });
        for exposure in [flat, edge] {
            let corner = refine(&CornerSubPix::default(), &exposure, 10.0, 10.0);
            assert_eq!(corner, Corner::at_seed(corner.seed, 0, RefineStatus::Singular));
        }
    }

    #[test]
    fn a_way_that_leaves_the_image_is_out_of_bounds() {
        // Two edges meet at (-2, 10).
        let wedge = grey(20, 20, |x, y| {
            let inside = 2 * y.abs_diff(10) < x + 2;
            if inside { 200.0 } else { 20.0 }
        });
        let corner = refine(&CornerSubPix::default(), &wedge, 1.0, 10.0);
        assert_eq!(corner.status, RefineStatus::OutOfBounds, "{corner:?}");
        assert_eq!(corner.position, corner.seed.point);
    }

    #[test]
    fn seeds_outside_and_images_too_small_are_out_of_bounds() {
        for (x, y) in [(-0.1, 5.0), (5.0, 20.0), (f64::NAN, 5.0), (5.0, f64::INFINITY)] {
            let corner = refine(&CornerSubPix::default(), &chess(), x, y);
            assert_eq!((corner.status, corner.iterations), (RefineStatus::OutOfBounds, 0));
        }
        assert_ne!(
            refine(&CornerSubPix::default(), &chess(), 5.0, 19.9).status,
            RefineStatus::OutOfBounds
        );
        let small = grey(14, 40, |x, y| (x * y) as f32);
        let corner = refine(&CornerSubPix::default(), &small, 5.0, 5.0);
        assert_eq!(corner.status, RefineStatus::OutOfBounds);
    }
}
