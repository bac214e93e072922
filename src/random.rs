//! Random numbers by name: adding something moves nothing else, and threads do not matter.
//!
//! A stream is named by texts; its words are a function of the name and their place alone. They come from ChaCha
//! with eight rounds, which can be entered anywhere.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use sha2::{Digest, Sha256};

/// Words of 32 random bits.
#[derive(Clone, Debug)]
pub struct Stream(ChaCha8Rng);

impl Stream {
    /// The stream of a name, which is a list of texts.
    pub fn named(name: &[&str]) -> Self {
        let mut digest = Sha256::new();
        for text in name {
            // With its length: ("ab", "c") is not ("a", "bc").
            digest.update((text.len() as u64).to_le_bytes());
            digest.update(text);
        }
        Self(ChaCha8Rng::from_seed(digest.finalize().into()))
    }

    /// Fills `words` with those from place `first` on.
    pub fn words(&mut self, first: usize, words: &mut [u32]) {
        self.0.set_word_pos(first as u128);
        self.0.fill_bytes(bytemuck::cast_slice_mut(words));
        for word in words {
            *word = u32::from_le(*word);
        }
    }

    /// The next 32 random bits.
    pub fn word(&mut self) -> u32 {
        self.0.next_u32()
    }

    /// The next number in \[0, 1), a multiple of 2^-32.
    pub fn uniform(&mut self) -> f64 {
        f64::from(self.word()) / 4_294_967_296.0
    }

    /// The next whole number below `count`, which is at most 2^32; 0 where `count` is 0. Some numbers are more
    /// frequent than others by `count` / 2^32 of their frequency, which no statistic of thousands of draws can tell.
    pub fn below(&mut self, count: usize) -> usize {
        #[allow(clippy::cast_possible_truncation, reason = "less than count")]
        let number = ((u64::from(self.word()) * count as u64) >> 32) as usize;
        number
    }

    /// The next normal deviate of mean 0 and variance 1 (Box & Muller 1958).
    pub fn normal(&mut self) -> f64 {
        let far = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        far * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// The next point of a disc about (0, 0) of radius 1, evenly spread.
    pub fn in_disc(&mut self) -> [f64; 2] {
        let (far, turn) = (self.uniform().sqrt(), std::f64::consts::TAU * self.uniform());
        [far * turn.cos(), far * turn.sin()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_is_that_of_its_name_from_any_place_on() {
        let (mut all, mut some) = ([0; 100], [0; 10]);
        Stream::named(&["a", "b"]).words(0, &mut all);
        Stream::named(&["a", "b"]).words(90, &mut some);
        assert_eq!(all[90..], some);
        Stream::named(&["ab"]).words(90, &mut some);
        assert_ne!(all[90..], some);
    }

    #[test]
    fn whole_numbers_are_equally_frequent() {
        let mut stream = Stream::named(&["whole numbers"]);
        let mut counts = [0_u32; 5];
        for _ in 0..50_000 {
            counts[stream.below(5)] += 1;
        }
        let far = |count: &u32| count.abs_diff(10_000) > 400; // 4.5 standard deviations
        assert!(!counts.iter().any(far), "{counts:?}");
        assert_eq!(stream.below(0), 0);
    }

    #[test]
    fn points_of_a_disc_are_evenly_spread() {
        let mut stream = Stream::named(&["disc"]);
        let points: Vec<[f64; 2]> = (0..20_000).map(|_| stream.in_disc()).collect();
        let mean = |of: &dyn Fn(&[f64; 2]) -> f64| points.iter().map(of).sum::<f64>() / 20_000.0;
        assert!(points.iter().all(|[x, y]| x.hypot(*y) <= 1.0));
        assert!(mean(&|[x, _]| *x).abs() < 0.02 && mean(&|[_, y]| *y).abs() < 0.02);
        // The mean square of an evenly filled disc is half of its radius squared.
        assert!((mean(&|[x, y]| x * x + y * y) - 0.5).abs() < 0.01);
    }
}
