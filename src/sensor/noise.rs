//! Random deviates of photographs: of every pixel its own, whatever else is drawn.

/// Normal deviates of mean 0 and variance 1 of random words, by inversion.
///
/// Giles (2012), Approximating the erfinv function, GPU Computing Gems Jade, single precision: without
/// a branch, so that several are computed at once. What he takes of the number's distance from the
/// middle, 1 - x^2, is computed from the distance to the nearer end here: exact in both tails. His
/// polynomial ends at a tail of 3e-8; beyond, to the last word's 1e-10, the tail is right to 2 %.
#[inline(always)]
pub(super) fn normals(words: &[u32], deviates: &mut [f32]) {
    for (deviate, &word) in deviates.iter_mut().zip(words) {
        let is_low = word < 1 << 31;
        let to_end = if is_low { word } else { !word };
        #[allow(clippy::cast_precision_loss, reason = "a relative error of 1e-7")]
        let tail = (to_end.cast_signed() as f32 + 0.5) * TO_SHARE;
        let size = 1.0 - 2.0 * tail;
        let w = -logarithm(4.0 * tail * (1.0 - tail));
        let v = w - 2.5;
        let mut near: f32 = 2.810_226_4e-8;
        for term in [
            3.432_739_4e-7,
            -3.523_387_7e-6,
            -4.391_506_5e-6,
            0.000_218_580_87,
            -0.001_253_725,
            -0.004_177_681_7,
            0.246_640_73,
            1.501_409_4,
        ] {
            near = near.mul_add(v, term);
        }
        let u = w.max(0.0).sqrt() - 3.0;
        let mut far: f32 = -0.000_200_214_26;
        for term in [
            0.000_100_950_56,
            0.001_349_343_2,
            -0.003_673_428_4,
            0.005_739_507_7,
            -0.007_622_461_3,
            0.009_438_87,
            1.001_674,
            2.832_976_8,
        ] {
            far = far.mul_add(u, term);
        }
        let magnitude = std::f32::consts::SQRT_2 * size * if w < 5.0 { near } else { far };
        *deviate = if is_low { -magnitude } else { magnitude };
    }
}

/// 2^-32: a word as a share of all.
const TO_SHARE: f32 = 1.0 / 4_294_967_296.0;

/// The natural logarithm of a positive normal number, to 1e-7 of it or absolutely, without a branch:
/// exponent and mantissa, and the series of the inverse hyperbolic tangent.
#[inline(always)]
fn logarithm(x: f32) -> f32 {
    // The mantissa is put into [0.70, 1.41).
    let bits = x.to_bits().wrapping_sub(0x3f33_3333);
    let exponent = bits.cast_signed() >> 23;
    let mantissa = f32::from_bits((bits & 0x007f_ffff).wrapping_add(0x3f33_3333));
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let square = s * s;
    let series = 1.0 + square * (1.0 / 3.0 + square * (0.2 + square * (1.0 / 7.0 + square / 9.0)));
    #[allow(clippy::cast_precision_loss, reason = "a small whole number")]
    let exponent = exponent as f32;
    exponent * std::f32::consts::LN_2 + 2.0 * s * series
}

/// Below this mean a Poisson deviate is found by adding up probabilities.
const SMALL_MEAN: f32 = 16.0;

/// Turns means into Poisson deviates of those means, by inversion.
///
/// Means from 16 on: Giles (2016), ACM Transactions on Mathematical Software 42(1), Algorithm 955,
/// the normal asymptotic expansion with three terms; where it is wrong, in one of several hundred
/// draws, it is so by one. Smaller means: exact, to the 32 bits of a word.
#[inline(always)]
pub(super) fn poisson(words: &[u32], deviates: &mut [f32], means: &mut [f32]) {
    normals(words, deviates);
    // All as if they were large: without a branch, so that several are computed at once.
    let mut small = 0;
    for (deviate, &mean) in deviates.iter_mut().zip(&*means) {
        small += u32::from(mean < SMALL_MEAN);
        *deviate = expanded(mean.max(SMALL_MEAN), *deviate);
    }
    if small > 0 {
        for ((deviate, &mean), &word) in deviates.iter_mut().zip(&*means).zip(words) {
            if mean < SMALL_MEAN {
                *deviate = added_up(mean, word);
            }
        }
    }
    means.copy_from_slice(deviates);
}

#[inline(always)]
fn expanded(mean: f32, w: f32) -> f32 {
    let (root, square) = (mean.sqrt(), w * w);
    let third = (-8.0 / 405.0 + 7.0 / 810.0 * square + square * square / 270.0) / mean;
    let second = -w * (1.0 / 36.0 + square / 72.0) / root;
    (mean + root * w + (1.0 / 3.0 + square / 6.0) + second + third).floor()
}

fn added_up(mean: f32, word: u32) -> f32 {
    let share = (f64::from(word) + 0.5) * (-32.0_f64).exp2();
    let mean = f64::from(mean.max(0.0));
    let mut probability = libm::exp(-mean);
    let mut sum = probability;
    let mut count = 0.0;
    // Beyond 100 no probability of a mean below 16 is left in 32 bits.
    while share > sum && count < 100.0 {
        count += 1.0;
        probability *= mean / count;
        sum += probability;
    }
    #[allow(clippy::cast_possible_truncation, reason = "at most 100")]
    let count = count as f32;
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Stream;

    #[test]
    fn normal_deviates_invert_the_normal_distribution() {
        let words: Vec<u32> =
            (0..20_000_u32).map(|i| i.wrapping_mul(214_748) + 1).chain([0, u32::MAX, 7]).collect();
        let mut deviates = vec![0.0; words.len()];
        normals(&words, &mut deviates);
        for (&word, &deviate) in words.iter().zip(&deviates) {
            let wanted = (f64::from(word) + 0.5) * (-32.0_f64).exp2();
            let (z, tail) = (f64::from(deviate), wanted.min(1.0 - wanted));
            let found = 0.5 * libm::erfc(z.abs() / std::f64::consts::SQRT_2);
            // The source ends where a float does, at 3e-8.
            let most = if tail > 3e-8 { 5e-5 } else { 0.02 };
            assert!((found - tail).abs() < most * tail, "{word}: {found} is not {tail}");
            assert_eq!(z < 0.0, wanted < 0.5, "{word}");
        }
    }

    #[test]
    fn poisson_deviates_have_mean_variance_and_skewness_of_the_distribution() {
        let count = 1 << 20;
        for mean in [0.3_f32, 4.0, 15.9, 16.1, 40.0, 900.0, 20_000.0] {
            let (mut words, mut deviates) = (vec![0; count], vec![0.0; count]);
            let mut found = vec![mean; count];
            Stream::named(&["test", &mean.to_string()]).words(5, &mut words);
            poisson(&words, &mut deviates, &mut found);
            assert!(found.iter().all(|value| value.fract() == 0.0 && *value >= 0.0));
            let mean = f64::from(mean);
            let moment = |power: i32| {
                found.iter().map(|&v| (f64::from(v) - mean).powi(power)).sum::<f64>() / count as f64
            };
            let root = (count as f64).sqrt();
            // Central moments of the distribution: 0, mean, mean; and the variances of their means.
            assert!(moment(1).abs() < 4.0 * mean.sqrt() / root, "{mean}: {}", moment(1));
            let error = (2.0 * mean * mean + mean).sqrt() / root;
            assert!((moment(2) - mean).abs() < 4.0 * error, "{mean}: {}", moment(2));
            let error = (15.0 * mean.powi(3) + 30.0 * mean * mean + mean).sqrt() / root;
            assert!((moment(3) - mean).abs() < 4.0 * error, "{mean}: {}", moment(3));
        }
    }

    #[test]
    fn small_means_have_the_probabilities_of_the_distribution() {
        let count = 1 << 20;
        let (mut words, mut deviates) = (vec![0; count], vec![0.0; count]);
        let mut found = vec![2.5; count];
        Stream::named(&["small"]).words(0, &mut words);
        poisson(&words, &mut deviates, &mut found);
        let mut probability = (-2.5_f64).exp();
        for value in 0..8 {
            #[allow(clippy::float_cmp, reason = "whole numbers")]
            let share = found.iter().filter(|&&v| v == value as f32).count() as f64 / count as f64;
            let error = (probability / count as f64).sqrt();
            assert!((share - probability).abs() < 4.0 * error, "{value}: {share} {probability}");
            probability *= 2.5 / f64::from(value + 1);
        }
    }

    #[test]
    fn a_pixel_s_number_depends_on_nothing_else() {
        let (mut all, mut some) = ([0; 300], [0; 7]);
        let mut stream = Stream::named(&["scene", "0", "shot"]);
        stream.words(0, &mut all);
        stream.words(101, &mut some);
        assert_eq!(all[101..108], some);
        Stream::named(&["scen", "e0", "shot"]).words(101, &mut some);
        assert_ne!(all[101..108], some);
    }
}
