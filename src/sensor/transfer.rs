//! Transfer functions between linear light and encoded values, both in \[0, 1\].

use serde::{Deserialize, Serialize};

/// How linear light becomes an encoded value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Transfer {
    /// Encoded value proportional to light.
    Linear,
    /// The piecewise sRGB curve (IEC 61966-2-1:1999).
    Srgb,
    /// Light to the power of one over gamma.
    Power {
        /// The exponent that decodes: 2.2, say.
        gamma: f64,
    },
    /// The logarithm of one and so many times the light.
    Log {
        /// How many times: more than 0; 1000 sees ten octaves.
        gain: f64,
    },
}

impl Transfer {
    /// Encodes linear light in \[0, 1\].
    pub fn encode(self, linear: f64) -> f64 {
        match self {
            Self::Linear => linear,
            Self::Srgb if linear <= 0.003_130_8 => 12.92 * linear,
            Self::Srgb => 1.055 * linear.powf(1.0 / 2.4) - 0.055,
            Self::Power { gamma } => linear.powf(1.0 / gamma),
            Self::Log { gain } => (gain * linear).ln_1p() / gain.ln_1p(),
        }
    }

    /// Linear light of an encoded value in \[0, 1\].
    pub fn decode(self, encoded: f64) -> f64 {
        match self {
            Self::Linear => encoded,
            Self::Srgb if encoded <= 0.040_45 => encoded / 12.92,
            Self::Srgb => ((encoded + 0.055) / 1.055).powf(2.4),
            Self::Power { gamma } => encoded.powf(gamma),
            Self::Log { gain } => (encoded * gain.ln_1p()).exp_m1() / gain,
        }
    }

    /// Derivative of [`Self::encode`] at linear light in \[0, 1\]; where a power is steeper than a
    /// thousand, a thousand.
    pub fn slope(self, linear: f64) -> f64 {
        match self {
            Self::Linear => 1.0,
            Self::Srgb if linear <= 0.003_130_8 => 12.92,
            Self::Srgb => 1.055 / 2.4 * linear.powf(1.0 / 2.4 - 1.0),
            Self::Power { gamma } => (linear.powf(1.0 / gamma - 1.0) / gamma).min(1000.0),
            Self::Log { gain } => gain / ((1.0 + gain * linear) * gain.ln_1p()),
        }
    }
}

/// A curve followed by rounding to whole numbers, from a table: exactly what the formula gives.
#[derive(Clone, Debug)]
pub(super) struct Quantiser {
    /// The smallest light of every number but the first; then what no light reaches.
    thresholds: Box<[f32; NUMBERS]>,
    /// Of each of the table's equal steps of light: the number at its beginning.
    starts: Box<[u32; 2 * STEPS]>,
}

/// The largest numbers have 16 bits; powers of two let an index be masked instead of checked.
const NUMBERS: usize = 1 << 16;

/// Equal steps of light: of 8 bits there is at most one threshold in a step, but for the darkest.
const STEPS: usize = 1 << 12;

impl Quantiser {
    /// The curve, to numbers from 0 to `most`, which has 16 bits.
    pub(super) fn new(transfer: Transfer, most: u16) -> Self {
        let mut thresholds = boxed([f32::INFINITY; NUMBERS]);
        for (threshold, number) in thresholds.iter_mut().zip(0..most) {
            let light = transfer.decode((f64::from(number) + 0.5) / f64::from(most));
            #[allow(clippy::cast_possible_truncation, reason = "rounded upwards next")]
            let near = light as f32;
            *threshold = if f64::from(near) < light { near.next_up() } else { near };
        }
        let mut starts = boxed([u32::from(most); 2 * STEPS]);
        for (step, start) in starts.iter_mut().enumerate().take(STEPS + 1) {
            let light = step as f32 / STEPS as f32;
            let below = thresholds.partition_point(|&threshold| threshold <= light);
            *start = u32::try_from(below).unwrap_or(u32::MAX).min(u32::from(most));
        }
        Self { thresholds, starts }
    }

    /// Turns light into numbers; light beyond \[0, 1\] counts as its end.
    pub(super) fn quantise(&self, samples: &mut [f32]) {
        // In parts that stay in the cache between the two passes.
        for samples in samples.chunks_mut(1024) {
            pulp::Arch::new().dispatch(Quantise { quantiser: self, samples });
        }
    }

    fn threshold(&self, number: u32) -> f32 {
        self.thresholds[number as usize % NUMBERS]
    }
}

fn boxed<T: Copy, const COUNT: usize>(values: [T; COUNT]) -> Box<[T; COUNT]> {
    Box::new(values)
}

/// Numbers of light: compiled for the machine's vectors.
struct Quantise<'a> {
    quantiser: &'a Quantiser,
    samples: &'a mut [f32],
}

impl pulp::WithSimd for Quantise<'_> {
    type Output = ();

    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0..=65535")]
    #[allow(clippy::cast_precision_loss, reason = "0..=65535")]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { quantiser, samples } = self;
        // One threshold is passed or not, without a branch.
        let (mut numbers, mut unfinished) = ([0; 1024], 0);
        for (number, light) in numbers.iter_mut().zip(&*samples) {
            let light = light.clamp(0.0, 1.0);
            let start = quantiser.starts[(light * STEPS as f32) as usize % (2 * STEPS)];
            *number = start + u32::from(quantiser.threshold(start) <= light);
            unfinished += u32::from(quantiser.threshold(*number) <= light);
        }
        if unfinished > 0 {
            for (number, light) in numbers.iter_mut().zip(&*samples) {
                while quantiser.threshold(*number) <= light.min(1.0) {
                    *number += 1;
                }
            }
        }
        for (sample, number) in samples.iter_mut().zip(numbers) {
            *sample = number as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Transfer; 4] = [
        Transfer::Linear,
        Transfer::Srgb,
        Transfer::Power { gamma: 2.2 },
        Transfer::Log { gain: 1000.0 },
    ];

    #[test]
    fn srgb_of_mid_grey_is_the_published_value() {
        // 0.18 linear encodes to 0.4613561 (IEC 61966-2-1).
        assert!((Transfer::Srgb.encode(0.18) - 0.461_356_1).abs() < 1e-6);
    }

    #[test]
    fn decode_undoes_encode() {
        for transfer in ALL {
            for step in 0..=100 {
                let value = f64::from(step) / 100.0;
                assert!((transfer.decode(transfer.encode(value)) - value).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn the_slope_is_that_of_the_curve() {
        for transfer in ALL {
            for step in 1..100 {
                let (light, d) = (f64::from(step) / 100.0, 1e-6);
                let found = (transfer.encode(light + d) - transfer.encode(light - d)) / (2.0 * d);
                assert!((transfer.slope(light) - found).abs() < 1e-5 * found.max(1.0));
            }
        }
    }

    #[test]
    fn the_table_gives_what_the_formula_gives() {
        for transfer in ALL {
            for most in [255_u16, 4095, 65535] {
                let table = Quantiser::new(transfer, most);
                let lights: Vec<f32> = (0..=30_000_u16).map(|step| f32::from(step) / 3e4).collect();
                let mut numbers = lights.clone();
                table.quantise(&mut numbers);
                for (&light, &number) in lights.iter().zip(&numbers) {
                    let exact = transfer.encode(f64::from(light)) * f64::from(most);
                    // Within rounding of a half either number is right.
                    let far = (f64::from(number) - exact).abs();
                    assert!(far <= 0.5 + 1e-7, "{transfer:?} {light}: {number}");
                }
                let mut beyond = [-1.0, 7.0];
                table.quantise(&mut beyond);
                assert!(beyond[0].abs() < 0.5 && (beyond[1] - f32::from(most)).abs() < 0.5);
            }
        }
    }
}
