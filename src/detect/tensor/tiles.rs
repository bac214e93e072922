//! Any kernels: row by row through tiles that fit into the first cache.

use std::ops::Range;

use pulp::Simd;

use super::{Measure, TensorKernels};
use crate::filter::{ImageRows, Kernel, Rows, grown, inside};
use crate::image::{PixelRange, View};
use crate::vector::{Lanes, Real};

/// Columns of a tile.
const COLUMNS: usize = 192;
/// More than any vector holds: rows are computed in whole vectors.
const SLACK: usize = 16;
/// Samples from one row of averages to the next. Were they a part of 4 KiB apart, loads would wait for
/// stores to other rows.
const PITCH: usize = COLUMNS + SLACK;

/// Part of a response.
pub(super) struct Tiles<'a> {
    pub(super) kernels: &'a TensorKernels,
    pub(super) planes: &'a [(View<'a, f32>, f32)],
    /// Which part of the image.
    pub(super) range: PixelRange,
    /// The image's row that is the first of `out`, whose rows are as wide as the image's.
    pub(super) first_row: usize,
    pub(super) memory: &'a mut Vec<f32>,
    pub(super) out: &'a mut [f32],
}

impl Tiles<'_> {
    pub(super) fn run<M: Measure>(self, measure: &M) {
        if self.range.width() > 0 && self.range.height() > 0 {
            pulp::Arch::new().dispatch(Vectors { tiles: self, measure: &Measuring(measure) });
        }
    }
}

/// A measure of rows: so that all else is compiled once for all measures.
trait MeasureRows {
    fn rows(&self, tensor: [&[f32]; 3], out: &mut [f32]);
}

struct Measuring<'a, M>(&'a M);

impl<M: Measure> MeasureRows for Measuring<'_, M> {
    fn rows(&self, tensor: [&[f32]; 3], out: &mut [f32]) {
        pulp::Arch::new().dispatch(Measured { measure: self.0, tensor, out });
    }
}

struct Measured<'a, M> {
    measure: &'a M,
    tensor: [&'a [f32]; 3],
    out: &'a mut [f32],
}

impl<M: Measure> pulp::WithSimd for Measured<'_, M> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { measure, tensor: [a, b, c], out } = self;
        for x in (0..out.len()).step_by(S::F32_LANES) {
            let (a, b, c) =
                (Lanes::load(simd, a, x), Lanes::load(simd, b, x), Lanes::load(simd, c, x));
            measure.of(a, b, c).store_part(out, x);
        }
    }
}

struct Vectors<'a> {
    tiles: Tiles<'a>,
    measure: &'a dyn MeasureRows,
}

impl pulp::WithSimd for Vectors<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { tiles: Tiles { kernels, planes, range, first_row, memory, out }, measure } =
            self;
        let width = planes[0].0.width();
        let mut x0 = range.x0;
        while x0 < range.x1 {
            let columns = x0..(x0 + COLUMNS).min(range.x1);
            let mut tile = Tile::new(kernels, planes, columns.clone(), memory);
            let window = kernels.window.radius();
            for y in
                range.y0.cast_signed() - window.cast_signed()..(range.y1 + window).cast_signed()
            {
                tile.next_row(simd, y);
                let done = y - window.cast_signed();
                if done >= range.y0.cast_signed() {
                    let at = (done.unsigned_abs() - first_row) * width;
                    let out = &mut out[at + columns.start..at + columns.end];
                    measure.rows(tile.tensor(simd), out);
                }
            }
            x0 = columns.end;
        }
    }
}

/// Columns of an image through which rows move.
struct Tile<'a> {
    kernels: &'a TensorKernels,
    planes: &'a [(View<'a, f32>, f32)],
    columns: Range<usize>,
    /// Samples from one row of `across` and `products` to the next.
    stride: usize,
    /// The image smoothed, and differentiated, from row to row.
    across: &'a mut [f32],
    /// Ix^2, Iy^2, Ix Iy.
    products: &'a mut [f32],
    /// Their averages along the row, of the window's rows: three of each.
    ring: &'a mut [f32],
    /// A, B, C.
    tensor: &'a mut [f32],
    /// Where in the ring the newest row is.
    newest: usize,
}

impl<'a> Tile<'a> {
    #[inline(always)]
    fn new(
        kernels: &'a TensorKernels,
        planes: &'a [(View<'a, f32>, f32)],
        columns: Range<usize>,
        memory: &'a mut Vec<f32>,
    ) -> Self {
        let stride = PITCH + (2 * kernels.support()).next_multiple_of(SLACK);
        let kept = 2 * kernels.window.radius() + 1;
        memory.resize((2 + 3) * stride + (3 + 3 * kept) * PITCH, 0.0);
        let (across, rest) = memory.split_at_mut(2 * stride);
        let (products, rest) = rest.split_at_mut(3 * stride);
        let (tensor, ring) = rest.split_at_mut(3 * PITCH);
        Self { kernels, planes, columns, stride, across, products, ring, tensor, newest: 0 }
    }

    /// Adds the image's row `y` to the ring, or the one that continues the products there.
    #[inline(always)]
    fn next_row<S: Simd>(&mut self, simd: S, y: isize) {
        let TensorKernels { derivative: [along, smooth], window, border } = self.kernels;
        let (width, height) = (self.planes[0].0.width(), self.planes[0].0.height());
        let y = border.index(y, height).cast_signed();
        let columns = self.columns.start.cast_signed()..self.columns.end.cast_signed();
        let wanted = grown(&columns, window.radius());
        let have = inside(&wanted, width); // columns of products
        let slope = self.kernels.slope_support();
        let wanted_across = grown(&have, slope);
        let have_across = inside(&wanted_across, width); // columns of the image
        let offset = have.start.abs_diff(wanted.start);
        let offset_across = have_across.start.abs_diff(wanted_across.start);

        let (smoothed, differentiated) = self.across.split_at_mut(self.stride);
        for (index, (plane, weight)) in self.planes.iter().enumerate() {
            for (kernel, out) in [(smooth, &mut *smoothed), (along, &mut *differentiated)] {
                let image = ImageRows {
                    image: *plane,
                    first: y - kernel.radius().cast_signed(),
                    border: *border,
                    column: have_across.start.unsigned_abs(),
                };
                let filled = &mut out[offset_across..offset_across + have_across.len()];
                kernel.across(simd, &image, filled);
                if have_across != wanted_across {
                    border.extend(out, &have_across, &wanted_across, width);
                }
            }
            let slopes = Slopes {
                x: (along, &smoothed[slope - along.radius()..]),
                y: (smooth, &differentiated[slope - smooth.radius()..]),
            };
            let products = &mut self.products[offset..];
            slopes.multiply(simd, *weight, index > 0, products, self.stride, have.len());
        }

        let kept = 2 * window.radius() + 1;
        self.newest = (self.newest + 1) % kept;
        let whole = self.columns.len().next_multiple_of(SLACK);
        for (index, products) in self.products.chunks_mut(self.stride).enumerate() {
            if have != wanted {
                border.extend(products, &have, &wanted, width);
            }
            let at = (3 * self.newest + index) * PITCH;
            window.along(simd, products, &mut self.ring[at..at + whole]);
        }
    }

    /// A, B and C of the row in the middle of the ring.
    #[inline(always)]
    fn tensor<S: Simd>(&mut self, simd: S) -> [&[f32]; 3] {
        let window = &self.kernels.window;
        let kept = 2 * window.radius() + 1;
        let whole = self.columns.len().next_multiple_of(SLACK);
        for (index, sums) in self.tensor.chunks_mut(PITCH).enumerate() {
            let oldest = self.newest + 1;
            let ring = RingRows { ring: self.ring, index, kept, oldest };
            window.across(simd, &ring, &mut sums[..whole]);
        }
        let (a, rest) = self.tensor.split_at(PITCH);
        let (b, c) = rest.split_at(PITCH);
        [a, b, c]
    }
}

/// Rows of one of the averages, from the oldest in the ring on.
struct RingRows<'a> {
    ring: &'a [f32],
    index: usize,
    kept: usize,
    oldest: usize,
}

impl Rows for RingRows<'_> {
    #[inline(always)]
    fn row(&self, k: usize) -> &[f32] {
        let slot = self.oldest + k;
        let slot = if slot >= self.kept { slot - self.kept } else { slot };
        &self.ring[(3 * slot + self.index) * PITCH..]
    }
}

/// Kernels of the slopes in x and y, and the row that each is applied along.
struct Slopes<'a> {
    x: (&'a Kernel, &'a [f32]),
    y: (&'a Kernel, &'a [f32]),
}

impl Slopes<'_> {
    /// Writes, or adds, the weighted products of `count` slopes to three rows that lie `stride` apart.
    #[inline(always)]
    fn multiply<S: Simd>(
        &self,
        simd: S,
        weight: f32,
        add: bool,
        products: &mut [f32],
        stride: usize,
        count: usize,
    ) {
        let Self { x: (along, smoothed), y: (smooth, differentiated) } = self;
        let (xx, rest) = products.split_at_mut(stride);
        let (yy, xy) = rest.split_at_mut(stride);
        let whole = count.next_multiple_of(S::F32_LANES);
        let (xx, yy, xy) = (&mut xx[..whole], &mut yy[..whole], &mut xy[..whole]);
        let weight = Lanes::splat(simd, weight);
        for x in (0..whole).step_by(S::F32_LANES) {
            // Whose loops are short are unrolled.
            let slope_x = match along.taps() {
                &[a, b, c] => weighed(simd, [a, b, c], smoothed, x),
                taps => weighed_by_any(simd, taps, smoothed, x),
            };
            let slope_y = match smooth.taps() {
                [_] => Lanes::load(simd, differentiated, x),
                &[a, b, c] => weighed(simd, [a, b, c], differentiated, x),
                taps => weighed_by_any(simd, taps, differentiated, x),
            };
            let (weighted_x, weighted_y) = (weight * slope_x, weight * slope_y);
            let (mut a, mut b, mut c) =
                (weighted_x * slope_x, weighted_y * slope_y, weighted_x * slope_y);
            if add {
                a = a + Lanes::load(simd, xx, x);
                b = b + Lanes::load(simd, yy, x);
                c = c + Lanes::load(simd, xy, x);
            }
            a.store(xx, x);
            b.store(yy, x);
            c.store(xy, x);
        }
    }
}

#[inline(always)]
fn weighed<S: Simd>(simd: S, taps: [f32; 3], row: &[f32], x: usize) -> Lanes<S> {
    let [a, b, c] = taps;
    let sum = Lanes::splat(simd, a) * Lanes::load(simd, row, x);
    let sum = Lanes::splat(simd, b).mul_add(Lanes::load(simd, row, x + 1), sum);
    Lanes::splat(simd, c).mul_add(Lanes::load(simd, row, x + 2), sum)
}

#[inline(always)]
fn weighed_by_any<S: Simd>(simd: S, taps: &[f32], row: &[f32], x: usize) -> Lanes<S> {
    let mut sum = Lanes::splat(simd, 0.0);
    for (k, &tap) in taps.iter().enumerate() {
        sum = Lanes::splat(simd, tap).mul_add(Lanes::load(simd, row, x + k), sum);
    }
    sum
}
