//! How uncertain a share is.

use statrs::distribution::{ContinuousCDF, Normal};

use super::tail;

/// A share of things that are independent of each other, and between what it lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proportion {
    /// The share observed.
    pub estimate: f64,
    /// The lower end, in \[0, estimate\].
    pub low: f64,
    /// The upper end, in \[estimate, 1\].
    pub high: f64,
}

/// The score interval of a share (Wilson 1927, Probable inference, the law of succession, and statistical
/// inference): all shares that the observed one does not contradict. `level` is in (0, 1). `None` of
/// nothing, and of more successes than trials.
///
/// Trials are independent. For corners of the same scenes, which are not, take
/// [`Bootstrap::of_sums`](super::Bootstrap::of_sums) with the ratio of the sums; but where all scenes have
/// the same share, that has no width, and the honest trials are the scenes.
#[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
pub fn wilson(successes: usize, trials: usize, level: f64) -> Option<Proportion> {
    if trials == 0 || successes > trials {
        return None;
    }
    let square = Normal::standard().inverse_cdf(tail(level)).powi(2);
    let count = trials as f64;
    let estimate = successes as f64 / count;
    let centre = estimate + square / (2.0 * count);
    let variance = estimate * (1.0 - estimate) / count + square / (4.0 * count * count);
    let half = (square * variance).sqrt();
    let [low, high] = [centre - half, centre + half].map(|end| end / (1.0 + square / count));
    // At no and at all successes one end is the estimate, but for rounding.
    Some(Proportion { estimate, low: low.clamp(0.0, estimate), high: high.clamp(estimate, 1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_intervals_of_newcombe() {
        // Newcombe 1998, Two-sided confidence intervals for the single proportion, table I, method 3.
        let cases = [
            (81, 263, 0.2553, 0.3662),
            (15, 148, 0.0624, 0.1605),
            (0, 20, 0.0, 0.1611),
            (1, 29, 0.0061, 0.1718),
        ];
        for (successes, trials, low, high) in cases {
            let found = wilson(successes, trials, 0.95).expect("trials");
            assert!((found.low - low).abs() < 6e-5, "{found:?}");
            assert!((found.high - high).abs() < 6e-5, "{found:?}");
            let mirrored = wilson(trials - successes, trials, 0.95).expect("trials");
            assert!((mirrored.low - (1.0 - found.high)).abs() < 1e-12);
        }
    }

    #[test]
    fn ends_hold_the_estimate_at_any_level() {
        for level in [f64::NAN, -1.0, 0.0, 0.5, 1.0, 2.0] {
            for successes in 0..=3 {
                let Proportion { estimate, low, high } =
                    wilson(successes, 3, level).expect("three");
                assert!(0.0 <= low && low <= estimate && estimate <= high && high <= 1.0);
            }
        }
        assert_eq!(wilson(0, 0, 0.95), None);
        assert_eq!(wilson(4, 3, 0.95), None);
    }
}
