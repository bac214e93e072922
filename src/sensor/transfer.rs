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
}

impl Transfer {
    /// Encodes linear light in \[0, 1\].
    pub fn encode(self, linear: f64) -> f64 {
        match self {
            Self::Linear => linear,
            Self::Srgb if linear <= 0.003_130_8 => 12.92 * linear,
            Self::Srgb => 1.055 * linear.powf(1.0 / 2.4) - 0.055,
            Self::Power { gamma } => linear.powf(1.0 / gamma),
        }
    }

    /// Linear light of an encoded value in \[0, 1\].
    pub fn decode(self, encoded: f64) -> f64 {
        match self {
            Self::Linear => encoded,
            Self::Srgb if encoded <= 0.040_45 => encoded / 12.92,
            Self::Srgb => ((encoded + 0.055) / 1.055).powf(2.4),
            Self::Power { gamma } => encoded.powf(gamma),
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
        }
    }
}

/// A curve followed by rounding to whole numbers, from a table: exactly what the formula gives.
#[derive(Clone, Debug)]
pub(super) struct Quantiser {
    /// The smallest light of every number but the first.
    thresholds: Vec<f32>,
    /// Of each of the table's equal steps of light: the number at its beginning.
    starts: Vec<u32>,
}

/// Equal steps of light in the table.
const STEPS: usize = 4096;

impl Quantiser {
    /// The curve, to numbers from 0 to `most`.
    pub(super) fn new(transfer: Transfer, most: u32) -> Self {
        let thresholds: Vec<f32> = (0..most)
            .map(|number| {
                let light = transfer.decode((f64::from(number) + 0.5) / f64::from(most));
                #[allow(clippy::cast_possible_truncation, reason = "rounded upwards next")]
                let near = light as f32;
                if f64::from(near) < light { near.next_up() } else { near }
            })
            .collect();
        let starts = (0..=STEPS)
            .map(|step| {
                let light = step as f32 / STEPS as f32;
                u32::try_from(thresholds.partition_point(|&t| t <= light)).unwrap_or(most)
            })
            .collect();
        Self { thresholds, starts }
    }

    /// The number of a light; light beyond \[0, 1\] counts as its end.
    #[inline]
    pub(super) fn number(&self, light: f32) -> u32 {
        let light = light.clamp(0.0, 1.0);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0..=4096")]
        let mut number = self.starts[(light * STEPS as f32) as usize] as usize;
        while number < self.thresholds.len() && self.thresholds[number] <= light {
            number += 1;
        }
        #[allow(clippy::cast_possible_truncation, reason = "at most 65535")]
        let number = number as u32;
        number
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Transfer; 3] = [Transfer::Linear, Transfer::Srgb, Transfer::Power { gamma: 2.2 }];

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
            for most in [255_u32, 4095] {
                let table = Quantiser::new(transfer, most);
                for step in 0..=30_000_u16 {
                    let light = f32::from(step) / 30_000.0;
                    let exact = transfer.encode(f64::from(light)) * f64::from(most);
                    let found = f64::from(table.number(light));
                    // Within rounding of a half either number is right.
                    assert!((found - exact).abs() <= 0.5 + 1e-7, "{transfer:?} {light}: {found}");
                }
                assert_eq!(table.number(-1.0), 0);
                assert_eq!(table.number(7.0), most);
            }
        }
    }
}
