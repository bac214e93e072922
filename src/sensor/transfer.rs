//! Transfer functions between linear light and encoded values, both in \[0, 1\].

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How linear light becomes an encoded value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Transfer {
    /// Encoded value proportional to light.
    Linear,
    /// The piecewise sRGB curve (IEC 61966-2-1:1999).
    Srgb,
}

impl Transfer {
    /// Encodes linear light in \[0, 1\].
    pub fn encode(self, linear: f64) -> f64 {
        match self {
            Self::Linear => linear,
            Self::Srgb if linear <= 0.003_130_8 => 12.92 * linear,
            Self::Srgb => 1.055 * linear.powf(1.0 / 2.4) - 0.055,
        }
    }

    /// Linear light of an encoded value in \[0, 1\].
    pub fn decode(self, encoded: f64) -> f64 {
        match self {
            Self::Linear => encoded,
            Self::Srgb if encoded <= 0.040_45 => encoded / 12.92,
            Self::Srgb => ((encoded + 0.055) / 1.055).powf(2.4),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_of_mid_grey_is_the_published_value() {
        // 0.18 linear encodes to 0.4613561 (IEC 61966-2-1).
        assert!((Transfer::Srgb.encode(0.18) - 0.461_356_1).abs() < 1e-6);
    }

    #[test]
    fn decode_undoes_encode() {
        for transfer in [Transfer::Linear, Transfer::Srgb] {
            for step in 0..=100 {
                let value = f64::from(step) / 100.0;
                assert!((transfer.decode(transfer.encode(value)) - value).abs() < 1e-6);
            }
        }
    }
}
