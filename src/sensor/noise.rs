//! Random numbers of photographs: of every pixel its own, whatever else is drawn.
//!
//! A stream is named by texts; its number of a pixel is a function of the name and the pixel's index
//! alone. So a region has the noise of the whole picture, and threads do not matter. The words come
//! from ChaCha with eight rounds, which can be entered anywhere.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use sha2::{Digest, Sha256};

/// Words of 32 random bits, one per pixel.
pub(super) struct Stream(ChaCha8Rng);

impl Stream {
    /// The stream of a name, which is a list of texts.
    pub(super) fn named(name: &[&str]) -> Self {
        let mut digest = Sha256::new();
        for text in name {
            // With its length: ("ab", "c") is not ("a", "bc").
            digest.update((text.len() as u64).to_le_bytes());
            digest.update(text);
        }
        Self(ChaCha8Rng::from_seed(digest.finalize().into()))
    }

    /// Fills `words` with those of the pixels from `first` on.
    pub(super) fn words(&mut self, first: usize, words: &mut [u32]) {
        self.0.set_word_pos(first as u128);
        for word in words {
            *word = self.0.next_u32();
        }
    }
}

/// Normal deviates of mean 0 and variance 1 of random words, by inversion.
///
/// Wichura (1988), Applied Statistics 37(3), algorithm AS 241, PPND7: seven digits.
#[inline(always)]
pub(super) fn normals(words: &[u32], deviates: &mut [f32]) {
    // The middle of the distribution, 85 % of it, has no branch; the tails follow one by one.
    for (deviate, &word) in deviates.iter_mut().zip(words) {
        let q = from_middle(word);
        let r = 0.180_625 - q * q;
        let above = ((59.109_375 * r + 159.291_13) * r + 50.434_272) * r + 3.387_132_7;
        let below = ((67.187_56 * r + 78.757_76) * r + 17.895_17) * r + 1.0;
        *deviate = q * above / below;
    }
    for (deviate, &word) in deviates.iter_mut().zip(words) {
        if from_middle(word).abs() > 0.425 {
            *deviate = tail(word);
        }
    }
}

/// A word as a number in (-0.5, 0.5).
#[inline(always)]
fn from_middle(word: u32) -> f32 {
    #[allow(clippy::cast_precision_loss, reason = "24 bits suffice away from the tails")]
    let signed = (word ^ (1 << 31)).cast_signed() as f32;
    (signed + 0.5) * (-32.0_f32).exp2()
}

#[cold]
fn tail(word: u32) -> f32 {
    let is_low = word < 1 << 31;
    #[allow(clippy::cast_precision_loss, reason = "a relative error of 1e-7")]
    let probability = ((if is_low { word } else { !word }) as f32 + 0.5) * (-32.0_f32).exp2();
    let r = (-libm::logf(probability)).sqrt() - 1.6;
    // The farthest word lies where r is 3.1: the third branch of the source is never reached.
    let size = (((0.170_238_21 * r + 1.306_728_5) * r + 2.756_815_4) * r + 1.423_437_3)
        / ((0.120_211_33 * r + 0.737_001_64) * r + 1.0);
    if is_low { -size } else { size }
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
    for ((mean, &deviate), &word) in means.iter_mut().zip(&*deviates).zip(words) {
        *mean = if *mean >= SMALL_MEAN { expanded(*mean, deviate) } else { added_up(*mean, word) };
    }
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
            assert!((found - tail).abs() < 2e-5 * tail, "{word}: {found} is not {tail}");
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
