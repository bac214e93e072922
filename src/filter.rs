//! Separable linear filters, a row at a time, and the kernels they are made of.
//!
//! Sums are in double precision and in one order wherever a sample lies, so that a crop that holds
//! the kernel's support gives the very bits of the whole plane.

/// Weights of a sample and its neighbours on both sides, in one direction.
///
/// Tap `k` weighs the sample `k - radius` away from the centre: a correlation, nothing is mirrored.
#[derive(Clone, Debug, PartialEq)]
pub struct Kernel {
    taps: Vec<f64>,
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

    /// (1, 2, 1) / 4.
    pub fn binomial() -> Self {
        Self { taps: vec![0.25, 0.5, 0.25] }
    }

    /// A Gaussian of `sigma` \[px\], sampled to [`gaussian_radius`]; the taps add up to 1.
    pub fn gaussian(sigma: f64) -> Self {
        let taps: Vec<f64> = offsets(sigma).map(|x| bell(x / sigma)).collect();
        let sum: f64 = taps.iter().sum();
        Self { taps: taps.into_iter().map(|tap| tap / sum).collect() }
    }

    /// The first derivative of a Gaussian of `sigma` \[px\], sampled to [`gaussian_radius`]; its
    /// answer to a ramp of slope 1 is 1.
    pub fn gaussian_derivative(sigma: f64) -> Self {
        let taps: Vec<f64> = offsets(sigma).map(|x| x * bell(x / sigma)).collect();
        let slope: f64 = taps.iter().zip(offsets(sigma)).map(|(tap, x)| tap * x).sum();
        Self { taps: taps.into_iter().map(|tap| tap / slope).collect() }
    }

    /// How many neighbours it weighs on each side.
    pub fn radius(&self) -> usize {
        self.taps.len() / 2
    }

    /// Filters along a row, its end samples continued outwards; `out` is as long as the row, `work`
    /// is overwritten.
    pub fn along_row(&self, row: &[f64], work: &mut Vec<f64>, out: &mut [f64]) {
        let (&[first, ..], &[.., last]) = (row, row) else { return };
        work.clear();
        work.resize(self.radius(), first);
        work.extend_from_slice(row);
        work.resize(row.len() + 2 * self.radius(), last);
        self.weigh(|k| &work[k..k + row.len()], out);
    }

    /// Filters across the rows of an image of `height` rows, its first and last continued outwards:
    /// `out` becomes the filtered row `y`.
    pub fn across_rows<'a, S: Copy + Into<f64> + 'a>(
        &self,
        y: usize,
        height: usize,
        row: impl Fn(usize) -> &'a [S],
        out: &mut [f64],
    ) {
        self.weigh(|k| row((y + k).saturating_sub(self.radius()).min(height - 1)), out);
    }

    /// `out[x]` = sum over k of `taps[k] * samples(k)[x]`, in the order of k.
    fn weigh<'a, S: Copy + Into<f64> + 'a>(
        &self,
        samples: impl Fn(usize) -> &'a [S],
        out: &mut [f64],
    ) {
        const LANES: usize = 16; // a block's sums stay in registers over all taps
        let (blocks, rest) = out.as_chunks_mut::<LANES>();
        let rest_start = blocks.len() * LANES;
        for (index, block) in blocks.iter_mut().enumerate() {
            let mut sums = [0.0; LANES];
            for (k, tap) in self.taps.iter().enumerate() {
                let samples = &samples(k)[index * LANES..][..LANES];
                for (sum, &sample) in sums.iter_mut().zip(samples) {
                    *sum += tap * sample.into();
                }
            }
            *block = sums;
        }
        rest.fill(0.0);
        for (k, tap) in self.taps.iter().enumerate() {
            for (sum, &sample) in rest.iter_mut().zip(&samples(k)[rest_start..]) {
                *sum += tap * sample.into();
            }
        }
    }
}

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

    fn along(kernel: &Kernel, row: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; row.len()];
        kernel.along_row(row, &mut Vec::new(), &mut out);
        out
    }

    #[test]
    fn taps_weigh_the_samples_around_the_centre_and_ends_continue() {
        let ahead = Kernel { taps: vec![0.0, 0.0, 1.0] };
        assert_eq!(along(&ahead, &[1.0, 2.0, 4.0, 8.0]), [2.0, 4.0, 8.0, 8.0]);
        assert_eq!(along(&Kernel::central_difference(), &[1.0, 2.0, 4.0]), [0.5, 1.5, 1.0]);
        assert!(along(&Kernel::binomial(), &[]).is_empty());
    }

    #[test]
    fn rows_are_weighed_like_samples() {
        let rows = [[1.0_f32, 3.0], [2.0, 3.0], [4.0, 3.0]];
        let across = |y| {
            let mut out = [0.0; 2];
            Kernel::central_difference().across_rows(y, 3, |y| &rows[y], &mut out);
            out
        };
        assert_eq!([across(0), across(1), across(2)], [[0.5, 0.0], [1.5, 0.0], [1.0, 0.0]]);
    }

    #[test]
    fn a_sample_is_summed_alike_wherever_it_lies() {
        let row: Vec<f64> = (0..53_u32).map(|x| f64::from(x * x * 31 % 257)).collect();
        let kernel = Kernel::gaussian(1.5);
        let (whole, part) = (along(&kernel, &row), along(&kernel, &row[7..40]));
        assert_eq!(part[5..28], whole[12..35]);
    }

    #[test]
    fn a_gaussian_keeps_a_constant_and_its_derivative_measures_a_slope() {
        let ramp: Vec<f64> = (0..30).map(|x| 3.0 * f64::from(x)).collect();
        assert!((along(&Kernel::gaussian_derivative(1.2), &ramp)[15] - 3.0).abs() < 1e-12);
        assert!((along(&Kernel::gaussian(1.2), &ramp)[15] - 45.0).abs() < 1e-12);
        assert!((along(&Kernel::gaussian(1.2), &[7.0; 4])[0] - 7.0).abs() < 1e-12);
    }
}
