//! Kernels of three taps: slopes, products and sums stay in registers from the image to the response.

use pulp::Simd;

use super::tiles::Tiles;
use super::{Block, BlockMemory, Measure, TensorKernels};
use crate::image::{PixelRange, Plane, View};
use crate::vector::{Lanes, Real};

/// Rows that are done at a time, column by column: so few that the first cache keeps them.
pub(super) const BAND: usize = 16;
/// As many columns as the widest vector holds.
pub(super) const LEAST_COLUMNS: usize = 16;
/// How far from a pixel the samples lie on which its response depends.
const SUPPORT: usize = 2;

/// What tells such kernels from each other.
#[derive(Clone, Copy)]
pub(super) struct ThreeTaps {
    /// Of the smoothing: the outer taps' weight, the middle one's being 1.
    beside: f32,
    /// What products of slopes are short of.
    scale: f32,
}

impl ThreeTaps {
    /// `None` of other kernels.
    pub(super) fn of(kernels: &TensorKernels) -> Option<Self> {
        let [along, smooth] = kernels.derivative.each_ref().map(|kernel| kernel.taps());
        let &[before, _, after] = along else { return None };
        let (beside, middle) = match *smooth {
            [middle] => (0.0, middle),
            [beside, middle, _] => (beside, middle),
            _ => return None,
        };
        let &[outer, inner, _] = kernels.window.taps() else { return None };
        let is = |a: f32, b: f32| a.to_bits() == b.to_bits();
        let gain = after * middle * outer;
        (is(before, -after) && is(outer, inner))
            .then_some(Self { beside: beside / middle, scale: gain * gain })
    }

    /// Fills the `range`, of which no pixel's support leaves the image; the first of `out`'s rows, which
    /// are as wide as the image's, is the image's row `first_row`.
    pub(super) fn run<M: Measure>(
        self,
        image: View<'_, f32>,
        range: PixelRange,
        first_row: usize,
        measure: &M,
        out: &mut [f32],
    ) {
        pulp::Arch::new().dispatch(Fused { taps: self, image, range, first_row, measure, out });
    }
}

/// The part of `range` of which no pixel's support leaves the image.
pub(super) fn inner(range: PixelRange, [width, height]: [usize; 2]) -> PixelRange {
    let within = |first: usize, end: usize, size: usize| {
        let (low, high) = (SUPPORT.min(size), size.saturating_sub(SUPPORT));
        let first = first.clamp(low, high.max(low));
        (first, end.clamp(first, high.max(first)))
    };
    let (x0, x1) = within(range.x0, range.x1, width);
    let (y0, y1) = within(range.y0, range.y1, height);
    PixelRange { x0, y0, x1, y1 }
}

/// Memory of [`sides`].
#[derive(Debug, Default)]
pub(super) struct SideMemory {
    turned: Plane<f32>,
    response: Plane<f32>,
}

/// The columns beside `inner`, in its rows. Turned over, columns are rows, which are fast.
pub(super) fn sides<M: Measure>(
    block: &Block<'_>,
    inner: PixelRange,
    memory: &mut BlockMemory,
    measure: &M,
    out: &mut [f32],
) {
    let (image, _) = block.planes[0];
    let BlockMemory { tiles, sides: SideMemory { turned, response } } = memory;
    // Rows on which those of `inner` depend.
    let rows = inner.y0 - SUPPORT..inner.y1 + SUPPORT;
    turned.resize(rows.len(), 2 * SUPPORT, 0.0);
    response.resize(rows.len(), 2 * SUPPORT, 0.0);
    // The first column of the image that is turned, and which of these are at its border.
    for (first, border) in [(0, 0), (image.width() - 2 * SUPPORT, SUPPORT)] {
        for (x, y) in rows.clone().enumerate() {
            for step in 0..2 * SUPPORT {
                turned.row_mut(step)[x] = image.row(y)[first + step];
            }
        }
        let range =
            PixelRange { x0: SUPPORT, y0: border, x1: rows.len() - SUPPORT, y1: border + SUPPORT };
        Tiles {
            kernels: block.kernels,
            planes: &[(turned.view(), 1.0)],
            range,
            first_row: 0,
            memory: &mut *tiles,
            out: response.samples_mut(),
        }
        .run(measure);
        for (x, y) in (inner.y0..inner.y1).enumerate() {
            for step in border..border + SUPPORT {
                let at = (y - block.rows.start) * image.width() + first + step;
                out[at] = response.row(step)[x + SUPPORT];
            }
        }
    }
}

/// The computation, compiled for the machine's vectors.
struct Fused<'a, M> {
    taps: ThreeTaps,
    image: View<'a, f32>,
    range: PixelRange,
    first_row: usize,
    measure: &'a M,
    out: &'a mut [f32],
}

impl<M: Measure> pulp::WithSimd for Fused<'_, M> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { taps, image, range, first_row, measure, out } = self;
        let none = Lanes::splat(simd, 0.0);
        let beside = Lanes::splat(simd, taps.beside);
        let scale = Lanes::splat(simd, taps.scale);
        let last = range.x1 - S::F32_LANES;
        let mut y0 = range.y0;
        while y0 < range.y1 {
            let y1 = (y0 + BAND).min(range.y1);
            let mut x = range.x0;
            loop {
                // Of the row before, and the one before that: differences and means along the row at
                // the pixel and its two neighbours; sums of products over the three.
                let mut differences = [[none; 3]; 2];
                let mut means = [[none; 3]; 2];
                let mut sums = [[none; 3]; 2];
                for y in y0 - SUPPORT..y1 + SUPPORT {
                    let samples = &image.row(y)[x - SUPPORT..x + S::F32_LANES + SUPPORT];
                    let a = Lanes::load(simd, samples, 0);
                    let b = Lanes::load(simd, samples, 1);
                    let c = Lanes::load(simd, samples, 2);
                    let d = Lanes::load(simd, samples, 3);
                    let e = Lanes::load(simd, samples, 4);
                    let difference = [c - a, d - b, e - c];
                    let mean = [
                        beside.mul_add(a + c, b),
                        beside.mul_add(b + d, c),
                        beside.mul_add(c + e, d),
                    ];
                    // The slopes of the row before.
                    let mut sum = [none; 3];
                    for at in 0..3 {
                        let outer = differences[1][at] + difference[at];
                        let slope_x = beside.mul_add(outer, differences[0][at]);
                        let slope_y = mean[at] - means[1][at];
                        sum = [
                            slope_x.mul_add(slope_x, sum[0]),
                            slope_y.mul_add(slope_y, sum[1]),
                            slope_x.mul_add(slope_y, sum[2]),
                        ];
                    }
                    if y >= y0 + SUPPORT {
                        let [a, b, c] = [
                            sum[0] + sums[0][0] + sums[1][0],
                            sum[1] + sums[0][1] + sums[1][1],
                            sum[2] + sums[0][2] + sums[1][2],
                        ];
                        let response = measure.of(a * scale, b * scale, c * scale);
                        let row = (y - SUPPORT - first_row) * image.width();
                        response.store(&mut out[row + x..row + x + S::F32_LANES], 0);
                    }
                    differences = [difference, differences[0]];
                    means = [mean, means[0]];
                    sums = [sum, sums[0]];
                }
                if x == last {
                    break;
                }
                x = (x + S::F32_LANES).min(last);
            }
            y0 = y1;
        }
    }
}
