//! Separable linear filters, a row at a time, and the kernels they are made of.
//!
//! Sums are in single precision, multiply-add fused, and in one order wherever a sample lies, so that a
//! crop that holds the kernel's support gives the very bits of the whole plane. The filters are inlined
//! into their caller, which chooses the machine's vectors (`pulp`).

use pulp::Simd;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::image::View;
use crate::vector::{Lanes, Real};

/// Weights of a sample and its neighbours on both sides, in one direction.
///
/// Tap `k` weighs the sample `k - radius` away from the centre: a correlation, nothing is mirrored.
#[derive(Clone, Debug, PartialEq)]
pub struct Kernel {
    taps: [f32; MOST_TAPS], // in place: a kernel is made for each image
    count: usize,
}

/// Rows that a kernel is applied across. A trait, not a closure: whose code is to be inlined into
/// that of wider vectors must say so.
pub trait Rows {
    /// The row that tap `k` weighs; it may be longer than needed.
    fn row(&self, k: usize) -> &[f32];
}

/// Rows of an image from `first` on, which may lie beyond its border, and columns from `column` on.
#[derive(Clone, Copy, Debug)]
pub struct ImageRows<'a> {
    /// The image.
    pub image: View<'a, f32>,
    /// The row that the first tap weighs.
    pub first: isize,
    /// The first column.
    pub column: usize,
    /// How the image continues.
    pub border: Border,
}

impl Rows for ImageRows<'_> {
    #[inline(always)]
    fn row(&self, k: usize) -> &[f32] {
        let y = self.border.index(self.first + k.cast_signed(), self.image.height());
        &self.image.row(y)[self.column..]
    }
}

/// How an image continues beyond its border.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Border {
    /// With its border samples: aaa|abcd|ddd.
    #[default]
    Replicate,
    /// Mirrored about its border samples: dcb|abcd|cba, OpenCV's default.
    Reflect,
}

impl Border {
    /// The sample of `count` that stands for the one `index` away from the first.
    #[inline(always)]
    pub fn index(self, index: isize, count: usize) -> usize {
        let last = count.cast_signed() - 1;
        let index = match self {
            Self::Replicate => index,
            // Once about each end; beyond that, the end.
            Self::Reflect => last - (last - index.abs()).abs(),
        };
        index.clamp(0, last.max(0)).unsigned_abs()
    }

    /// Fills a row that begins at sample `wanted.start` of `count` and holds those of `have` already.
    #[inline(always)]
    pub fn extend(self, row: &mut [f32], have: &Span, wanted: &Span, count: usize) {
        let first = wanted.start;
        for at in (wanted.start..have.start).chain(have.end..wanted.end) {
            let from = self.index(at, count).cast_signed() - first;
            row[(at - first).unsigned_abs()] = row[from.unsigned_abs()];
        }
    }
}

/// Samples of a row, which may begin before it and end beyond it.
pub type Span = std::ops::Range<isize>;

/// `span` and `radius` more on both sides.
#[inline(always)]
pub fn grown(span: &Span, radius: usize) -> Span {
    span.start - radius.cast_signed()..span.end + radius.cast_signed()
}

/// What of `span` lies in a row of `count` samples.
#[inline(always)]
pub fn inside(span: &Span, count: usize) -> Span {
    span.start.max(0)..span.end.min(count.cast_signed())
}

impl Kernel {
    /// # Panics
    /// Of more than [`MOST_TAPS`] taps: a mistake of the caller's code.
    fn new(taps: impl Iterator<Item = f64>) -> Self {
        let mut kernel = Self { taps: [0.0; MOST_TAPS], count: 0 };
        for tap in taps {
            #[allow(clippy::cast_possible_truncation, reason = "rounds to the nearest")]
            let tap = tap as f32;
            kernel.taps[kernel.count] = tap;
            kernel.count += 1;
        }
        kernel
    }

    /// The kernel that changes nothing.
    pub fn identity() -> Self {
        Self::new([1.0].into_iter())
    }

    /// The difference of the two neighbours, halved: a slope.
    pub fn central_difference() -> Self {
        Self::new([-0.5, 0.0, 0.5].into_iter())
    }

    /// (1, 2, 1) / 4: what Sobel's operator smoothes by.
    pub fn binomial() -> Self {
        Self::new([0.25, 0.5, 0.25].into_iter())
    }

    /// (3, 10, 3) / 16: what Scharr's operator smoothes by.
    pub fn scharr() -> Self {
        Self::new([0.1875, 0.625, 0.1875].into_iter())
    }

    /// The mean of `2 radius + 1` samples.
    pub fn mean(radius: usize) -> Self {
        let count = 2 * radius + 1;
        Self::new(std::iter::repeat_n(1.0 / count as f64, count))
    }

    /// A Gaussian of `sigma` \[px\], sampled to [`gaussian_radius`]; the taps add up to 1.
    pub fn gaussian(sigma: f64) -> Self {
        let taps = || offsets(sigma).map(|x| bell(x / sigma));
        let sum: f64 = taps().sum();
        Self::new(taps().map(|tap| tap / sum))
    }

    /// The first derivative of a Gaussian of `sigma` \[px\], sampled to [`gaussian_radius`]; its
    /// answer to a ramp of slope 1 is 1.
    pub fn gaussian_derivative(sigma: f64) -> Self {
        let taps = || offsets(sigma).map(|x| x * bell(x / sigma));
        let slope: f64 = taps().zip(offsets(sigma)).map(|(tap, x)| tap * x).sum();
        Self::new(taps().map(|tap| tap / slope))
    }

    /// The second derivative of a Gaussian of `sigma` \[px\], sampled to [`gaussian_radius`]; its answer
    /// to a constant is 0, to x^2 / 2 it is 1.
    pub fn gaussian_second_derivative(sigma: f64) -> Self {
        let bells = || offsets(sigma).map(|x| (x, bell(x / sigma)));
        let area: f64 = bells().map(|(_, g)| g).sum();
        let square: f64 = bells().map(|(x, g)| g * x * x).sum();
        let taps = || bells().map(|(x, g)| g * (x * x - square / area));
        let curvature: f64 = taps().zip(offsets(sigma)).map(|(tap, x)| 0.5 * tap * x * x).sum();
        Self::new(taps().map(|tap| tap / curvature))
    }

    /// It, and every tap multiplied by `factor`.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self::new(self.taps().iter().map(|tap| f64::from(*tap) * factor))
    }

    /// How many neighbours it weighs on each side.
    #[inline(always)]
    pub fn radius(&self) -> usize {
        self.count / 2
    }

    /// Its taps.
    #[inline(always)]
    pub fn taps(&self) -> &[f32] {
        &self.taps[..self.count]
    }

    /// Filters along a row: `out[x]` is the sum over k of `taps[k] * row[x + k]`.
    #[inline(always)]
    pub fn along<S: Simd>(&self, simd: S, row: &[f32], out: &mut [f32]) {
        self.across(simd, &Shifted(row), out);
    }

    /// Filters across rows: `out[x]` is the sum over k of `taps[k] * rows.row(k)[x]`.
    #[inline(always)]
    pub fn across<S: Simd>(&self, simd: S, rows: &impl Rows, out: &mut [f32]) {
        // Of these counts the loops over the taps are unrolled: Sobel's, and Gaussians' of 0.6 to 2 px.
        match self.count {
            1 => weigh_n::<S, 1>(simd, self.taps(), rows, out),
            3 => weigh_n::<S, 3>(simd, self.taps(), rows, out),
            7 => weigh_n::<S, 7>(simd, self.taps(), rows, out),
            11 => weigh_n::<S, 11>(simd, self.taps(), rows, out),
            13 => weigh_n::<S, 13>(simd, self.taps(), rows, out),
            _ => weigh(simd, self.taps(), rows, out),
        }
    }
}

/// One row, which each tap weighs from another sample on.
struct Shifted<'a>(&'a [f32]);

impl Rows for Shifted<'_> {
    #[inline(always)]
    fn row(&self, k: usize) -> &[f32] {
        &self.0[k..]
    }
}

/// Rows of `N` taps added up.
#[inline(always)]
fn weigh_n<S: Simd, const N: usize>(simd: S, taps: &[f32], rows: &impl Rows, out: &mut [f32]) {
    let count = out.len();
    if count < S::F32_LANES {
        return weigh(simd, taps, rows, out);
    }
    let mut weights = [Lanes::splat(simd, 0.0); N];
    let mut samples: [&[f32]; N] = [&[]; N];
    for k in 0..N {
        weights[k] = Lanes::splat(simd, taps[k]);
        samples[k] = &rows.row(k)[..count];
    }
    let mut x = 0;
    while x < count {
        x = last_vector::<S>(x, count);
        let mut sum = weights[0] * Lanes::load(simd, samples[0], x);
        for k in 1..N {
            sum = weights[k].mul_add(Lanes::load(simd, samples[k], x), sum);
        }
        sum.store(out, x);
        x += S::F32_LANES;
    }
}

/// Rows of any number of taps added up.
#[inline(always)]
fn weigh<S: Simd>(simd: S, taps: &[f32], rows: &impl Rows, out: &mut [f32]) {
    let mut x = 0;
    while out.len() - x >= MANY * S::F32_LANES {
        let mut sums = [Lanes::splat(simd, 0.0); MANY]; // in registers over all taps
        for (k, &tap) in taps.iter().enumerate() {
            add_many(&mut sums, Lanes::splat(simd, tap), simd, rows.row(k), x);
        }
        x = store_many(sums, out, x);
    }
    while x < out.len() {
        x = last_vector::<S>(x, out.len());
        let mut sum = Lanes::splat(simd, 0.0);
        for (k, &tap) in taps.iter().enumerate() {
            let samples = Lanes::load_part(simd, &rows.row(k)[..out.len()], x);
            sum = Lanes::splat(simd, tap).mul_add(samples, sum);
        }
        sum.store_part(out, x);
        x += S::F32_LANES;
    }
}

/// Where the next vector of `count` samples begins: so that none but an only one is cut off.
#[inline(always)]
fn last_vector<S: Simd>(x: usize, count: usize) -> usize {
    x.min(count.saturating_sub(S::F32_LANES))
}

/// Vectors that are summed at a time: sums that do not wait for each other.
const MANY: usize = 4;

/// Adds `tap` times the samples from `first` on.
#[inline(always)]
fn add_many<S: Simd>(
    sums: &mut [Lanes<S>; MANY],
    tap: Lanes<S>,
    simd: S,
    samples: &[f32],
    first: usize,
) {
    let samples = &samples[first..first + MANY * S::F32_LANES];
    for (part, sum) in sums.iter_mut().enumerate() {
        *sum = tap.mul_add(Lanes::load(simd, samples, part * S::F32_LANES), *sum);
    }
}

/// Writes the sums to the samples from `first` on; returns where the next ones go.
#[inline(always)]
fn store_many<S: Simd>(sums: [Lanes<S>; MANY], samples: &mut [f32], first: usize) -> usize {
    let written = &mut samples[first..first + MANY * S::F32_LANES];
    for (part, sum) in sums.into_iter().enumerate() {
        sum.store(written, part * S::F32_LANES);
    }
    first + MANY * S::F32_LANES
}

/// The most taps: those of a Gaussian of 16 px, and some more.
const MOST_TAPS: usize = 128;

/// How far a Gaussian of `sigma` \[px\] is sampled from its centre: ceil(3 sigma) \[px\].
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
pub fn gaussian_radius(sigma: f64) -> usize {
    (3.0 * sigma).ceil() as usize
}

/// -radius, ..., 0, ..., radius.
fn offsets(sigma: f64) -> impl Iterator<Item = f64> {
    let radius = gaussian_radius(sigma);
    (0..=2 * radius).map(move |k| k as f64 - radius as f64)
}

/// exp(-z^2 / 2).
fn bell(z: f64) -> f64 {
    (-0.5 * z * z).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Several<'a>(&'a [&'a [f32]]);

    impl Rows for Several<'_> {
        #[inline(always)]
        fn row(&self, k: usize) -> &[f32] {
            self.0[k]
        }
    }

    /// A row filtered along, or columns of it across: compiled for the machine's vectors.
    struct Filtered<'a>(&'a Kernel, &'a [&'a [f32]], &'a mut [f32]);

    impl pulp::WithSimd for Filtered<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let Self(kernel, rows, out) = self;
            match rows {
                [row] => kernel.along(simd, row, out),
                rows => kernel.across(simd, &Several(rows), out),
            }
        }
    }

    fn along(kernel: &Kernel, row: &[f32], border: Border) -> Vec<f32> {
        let have = 0..row.len().cast_signed();
        let wanted = grown(&have, kernel.radius());
        let mut padded = vec![0.0; wanted.len()];
        padded[kernel.radius()..][..row.len()].copy_from_slice(row);
        border.extend(&mut padded, &have, &wanted, row.len());
        let mut out = vec![0.0; row.len()];
        pulp::Arch::new().dispatch(Filtered(kernel, &[&padded], &mut out));
        out
    }

    #[test]
    fn taps_weigh_the_samples_around_the_centre_and_the_border_continues() {
        let ahead = Kernel::new([0.0, 0.0, 1.0].into_iter());
        let behind = Kernel::new([1.0, 0.0, 0.0].into_iter());
        let row = [1.0, 2.0, 4.0, 8.0];
        assert_eq!(along(&ahead, &row, Border::Replicate), [2.0, 4.0, 8.0, 8.0]);
        assert_eq!(along(&behind, &row, Border::Replicate), [1.0, 1.0, 2.0, 4.0]);
        assert_eq!(along(&ahead, &row, Border::Reflect), [2.0, 4.0, 8.0, 4.0]);
        assert_eq!(along(&behind, &row, Border::Reflect), [2.0, 1.0, 2.0, 4.0]);
        let slopes = along(&Kernel::central_difference(), &[1.0, 2.0, 4.0], Border::Replicate);
        assert_eq!(slopes, [0.5, 1.5, 1.0]);
        assert_eq!(along(&ahead, &[3.0], Border::Reflect), [3.0]);
    }

    #[test]
    fn rows_are_weighed_like_samples() {
        let rows: [&[f32]; 3] = [&[1.0, 3.0], &[2.0, 3.0], &[4.0, 3.0]];
        let mut out = [0.0; 2];
        pulp::Arch::new().dispatch(Filtered(&Kernel::central_difference(), &rows, &mut out));
        assert!((out[0] - 1.5).abs() < 1e-6 && out[1].abs() < 1e-6, "{out:?}");
    }

    #[test]
    fn a_sample_is_summed_alike_wherever_it_lies() {
        #[allow(clippy::cast_precision_loss, reason = "small numbers")]
        let row: Vec<f32> = (0..153_u32).map(|x| (x * x * 31 % 257) as f32).collect();
        let kernel = Kernel::gaussian(1.5);
        let whole = along(&kernel, &row, Border::Replicate);
        let part = along(&kernel, &row[7..140], Border::Replicate);
        assert_eq!(part[5..128], whole[12..135]);
    }

    #[test]
    fn a_gaussian_keeps_a_constant_and_its_derivatives_measure_slope_and_curvature() {
        #[allow(clippy::cast_precision_loss, reason = "small numbers")]
        let polynomial =
            |power: i32| (0..30).map(|x| (x as f32 - 15.0).powi(power)).collect::<Vec<_>>();
        let at_middle =
            |kernel: &Kernel, power: i32| along(kernel, &polynomial(power), Border::Replicate)[15];
        let (flat, slope, curvature) = (
            Kernel::gaussian(1.2),
            Kernel::gaussian_derivative(1.2),
            Kernel::gaussian_second_derivative(1.2),
        );
        for (kernel, power, wanted) in [
            (&flat, 0, 1.0),
            (&flat, 1, 0.0),
            (&slope, 0, 0.0),
            (&slope, 1, 1.0),
            (&slope, 2, 0.0),
            (&curvature, 0, 0.0),
            (&curvature, 1, 0.0),
            (&curvature, 2, 2.0),
        ] {
            let found = at_middle(kernel, power);
            assert!((found - wanted).abs() < 1e-5, "{kernel:?} of x^{power}: {found}");
        }
    }
}
