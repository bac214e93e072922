//! Separable linear filters, a row at a time, and the kernels they are made of.
//!
//! Sums are in single precision, multiply-add fused, and in one order wherever a sample lies, so that a
//! crop that holds the kernel's support gives the very bits of the whole plane. The filters are inlined
//! into their caller, which chooses the machine's vectors (`pulp`).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Weights of a sample and its neighbours on both sides, in one direction.
///
/// Tap `k` weighs the sample `k - radius` away from the centre: a correlation, nothing is mirrored.
#[derive(Clone, Debug, PartialEq)]
pub struct Kernel {
    taps: Vec<f32>,
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

    /// Fills the first and last `margin` samples of a row from those between.
    #[inline(always)]
    pub fn extend(self, row: &mut [f32], margin: usize) {
        let count = row.len() - 2 * margin;
        for step in 1..=margin.cast_signed() {
            let (before, after) =
                (self.index(-step, count), self.index(count.cast_signed() - 1 + step, count));
            row[margin - step.unsigned_abs()] = row[margin + before];
            row[margin + count - 1 + step.unsigned_abs()] = row[margin + after];
        }
    }
}

/// Taps as they are kept.
#[allow(clippy::cast_possible_truncation, reason = "rounds to the nearest")]
fn rounded(taps: impl Iterator<Item = f64>) -> Vec<f32> {
    taps.map(|tap| tap as f32).collect()
}

impl Kernel {
    /// The kernel that changes nothing.
    pub fn identity() -> Self {
        Self { taps: vec![1.0] }
    }

    /// The difference of the two neighbours, halved: a slope.
    pub fn central_difference() -> Self {
        Self { taps: vec![-0.5, 0.0, 0.5] }
    }

    /// (1, 2, 1) / 4: what Sobel's operator smoothes by.
    pub fn binomial() -> Self {
        Self { taps: vec![0.25, 0.5, 0.25] }
    }

    /// (3, 10, 3) / 16: what Scharr's operator smoothes by.
    pub fn scharr() -> Self {
        Self { taps: vec![0.1875, 0.625, 0.1875] }
    }

    /// The mean of `2 radius + 1` samples.
    pub fn mean(radius: usize) -> Self {
        let count = 2 * radius + 1;
        Self { taps: rounded(std::iter::repeat_n(1.0 / count as f64, count)) }
    }

    /// A Gaussian of `sigma` \[px\], sampled to [`gaussian_radius`]; the taps add up to 1.
    pub fn gaussian(sigma: f64) -> Self {
        let taps: Vec<f64> = offsets(sigma).map(|x| bell(x / sigma)).collect();
        let sum: f64 = taps.iter().sum();
        Self { taps: rounded(taps.into_iter().map(|tap| tap / sum)) }
    }

    /// The first derivative of a Gaussian of `sigma` \[px\], sampled to [`gaussian_radius`]; its
    /// answer to a ramp of slope 1 is 1.
    pub fn gaussian_derivative(sigma: f64) -> Self {
        let taps: Vec<f64> = offsets(sigma).map(|x| x * bell(x / sigma)).collect();
        let slope: f64 = taps.iter().zip(offsets(sigma)).map(|(tap, x)| tap * x).sum();
        Self { taps: rounded(taps.into_iter().map(|tap| tap / slope)) }
    }

    /// The second derivative of a Gaussian of `sigma` \[px\], sampled to [`gaussian_radius`]; its answer
    /// to a constant is 0, to x^2 / 2 it is 1.
    pub fn gaussian_second_derivative(sigma: f64) -> Self {
        let bells: Vec<f64> = offsets(sigma).map(|x| bell(x / sigma)).collect();
        let area: f64 = bells.iter().sum();
        let square: f64 = bells.iter().zip(offsets(sigma)).map(|(g, x)| g * x * x).sum();
        let taps: Vec<f64> =
            bells.iter().zip(offsets(sigma)).map(|(g, x)| g * (x * x - square / area)).collect();
        let curvature: f64 =
            taps.iter().zip(offsets(sigma)).map(|(tap, x)| 0.5 * tap * x * x).sum();
        Self { taps: rounded(taps.into_iter().map(|tap| tap / curvature)) }
    }

    /// How many neighbours it weighs on each side.
    pub fn radius(&self) -> usize {
        self.taps.len() / 2
    }

    /// Filters along a row that holds [`Kernel::radius`] more samples than `out` on each side.
    #[inline(always)]
    pub fn along(&self, row: &[f32], out: &mut [f32]) {
        let count = out.len();
        self.weigh(|k| &row[k..k + count], out);
    }

    /// Filters across rows as long as `out`: `row(k)` is the one that tap `k` weighs.
    #[inline(always)]
    pub fn across<'a>(&self, row: impl Fn(usize) -> &'a [f32], out: &mut [f32]) {
        self.weigh(row, out);
    }

    /// `out[x]` = sum over k of `taps[k] * samples(k)[x]`, in the order of k.
    #[inline(always)]
    fn weigh<'a>(&self, samples: impl Fn(usize) -> &'a [f32], out: &mut [f32]) {
        // Of so few taps the sums are one expression.
        match *self.taps {
            [a] => return weigh_rows(&[(a, samples(0))], out),
            [a, b, c] => {
                return weigh_rows(&[(a, samples(0)), (b, samples(1)), (c, samples(2))], out);
            }
            _ => (),
        }
        let none: &[f32] = &[];
        let mut rows = [(0.0, none); MOST_TAPS];
        for (k, (row, &tap)) in rows.iter_mut().zip(&self.taps).enumerate() {
            *row = (tap, samples(k));
        }
        weigh_rows(&rows[..self.taps.len()], out);
    }
}

/// Weighted rows added up.
#[inline(always)]
fn weigh_rows(rows: &[(f32, &[f32])], out: &mut [f32]) {
    let mut done = 0;
    while done < out.len() {
        let rest = &mut out[done..];
        done += match rest.len() {
            BLOCK.. => weigh_block::<BLOCK>(rows, done, rest),
            SMALL_BLOCK.. => weigh_block::<SMALL_BLOCK>(rows, done, rest),
            _ => weigh_block::<1>(rows, done, rest),
        };
    }
}

/// The first `COUNT` samples of `out`, which are those from `first` on of the rows.
#[inline(always)]
fn weigh_block<const COUNT: usize>(rows: &[(f32, &[f32])], first: usize, out: &mut [f32]) -> usize {
    let mut sums = [0.0_f32; COUNT]; // in registers over all taps
    for (tap, row) in rows {
        for (sum, sample) in sums.iter_mut().zip(&row[first..first + COUNT]) {
            *sum = tap.mul_add(*sample, *sum);
        }
    }
    out[..COUNT].copy_from_slice(&sums);
    COUNT
}

/// The most taps: those of a Gaussian of 8 px, and some more.
const MOST_TAPS: usize = 64;

/// Samples that are summed at a time, in the middle of a row and near its end.
const BLOCK: usize = 128;
const SMALL_BLOCK: usize = 16;

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

    fn along(kernel: &Kernel, row: &[f32], border: Border) -> Vec<f32> {
        let margin = kernel.radius();
        let mut padded = vec![0.0; row.len() + 2 * margin];
        padded[margin..margin + row.len()].copy_from_slice(row);
        border.extend(&mut padded, margin);
        let mut out = vec![0.0; row.len()];
        kernel.along(&padded, &mut out);
        out
    }

    #[test]
    fn taps_weigh_the_samples_around_the_centre_and_the_border_continues() {
        let ahead = Kernel { taps: vec![0.0, 0.0, 1.0] };
        let behind = Kernel { taps: vec![1.0, 0.0, 0.0] };
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
        let rows = [[1.0_f32, 3.0], [2.0, 3.0], [4.0, 3.0]];
        let mut out = [0.0; 2];
        Kernel::central_difference().across(|k| &rows[k], &mut out);
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
