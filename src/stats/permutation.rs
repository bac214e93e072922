//! Whether paired differences are more than chance, and many such questions at once.

use crate::random::Stream;

/// How many differences are enumerated in full: 4096 patterns of signs.
const MOST_ENUMERATED: usize = 12;

/// How many patterns of signs are drawn where there are more.
const DRAWN: u32 = 10_000;

/// What a test by random signs says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SignFlips {
    /// The mean difference, in the differences' unit.
    pub mean: f64,
    /// How often the mean is as far from 0 or farther, on either side, if signs are chance.
    pub p: f64,
    /// How many patterns of signs were tried.
    pub patterns: u32,
    /// Whether these are all that there are.
    pub is_exact: bool,
}

/// The paired permutation test of differences, one of each cluster (Fisher 1935, The Design of
/// Experiments, section 21): where two methods are equally good, each difference is as likely with the
/// other sign.
///
/// Exact for up to 12 differences; else 10 000 patterns of signs are drawn from the stream of `name`, and
/// the pattern observed counts as one more, so that p is never 0 and never too small (Phipson & Smyth
/// 2010). `None` of nothing and where a difference is not finite. With n differences no p is
/// below 2^(1 - n): five cannot be significant at 0.05.
#[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
pub fn sign_flips(differences: &[f64], name: &[&str]) -> Option<SignFlips> {
    let count = differences.len();
    if count == 0 || differences.iter().any(|difference| !difference.is_finite()) {
        return None;
    }
    // Patterns that give the same sum but for its rounding are as far.
    let scale: f64 = differences.iter().map(|difference| difference.abs()).sum();
    let observed: f64 = differences.iter().sum();
    let limit = observed.abs() - 1e-12 * scale;
    let is_as_far = |sum: f64| u32::from(sum.abs() >= limit);

    let is_exact = count <= MOST_ENUMERATED;
    let (far, patterns) = if is_exact {
        let patterns = 1_u32 << count;
        ((0..patterns).map(|signs| is_as_far(signed_sum(differences, signs))).sum(), patterns)
    } else {
        let mut random = Stream::named(name);
        let mut drawn =
            || differences.chunks(32).map(|some| signed_sum(some, random.word())).sum::<f64>();
        (1 + (0..DRAWN).map(|_| is_as_far(drawn())).sum::<u32>(), DRAWN + 1)
    };
    let p = f64::from(far) / f64::from(patterns);
    Some(SignFlips { mean: observed / count as f64, p, patterns, is_exact })
}

/// The sum of at most 32 values, each with the sign that its bit says.
fn signed_sum(values: &[f64], signs: u32) -> f64 {
    let signed = |(bit, value): (usize, &f64)| {
        // The sign is the topmost bit of a number: no branch, which chance would mispredict.
        f64::from_bits(value.to_bits() ^ (u64::from(signs >> bit & 1) << 63))
    };
    values.iter().enumerate().map(signed).sum()
}

/// The p-values of a family of tests, adjusted so that one or more of those at most alpha is there by
/// chance with a probability of at most alpha, however the tests depend on each other (Holm 1979, A
/// simple sequentially rejective multiple test procedure). In the order given; NaN counts as 1.
#[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let known: Vec<f64> =
        p_values.iter().map(|p| if p.is_nan() { 1.0 } else { p.clamp(0.0, 1.0) }).collect();
    let mut ascending: Vec<usize> = (0..known.len()).collect();
    ascending.sort_by(|a, b| known[*a].total_cmp(&known[*b]));
    let mut adjusted = vec![1.0; known.len()];
    let mut largest = 0.0_f64;
    for (place, &index) in ascending.iter().enumerate() {
        // None is below one with a smaller p, which would have had to be rejected first.
        largest = largest.max(known[index] * (known.len() - place) as f64).min(1.0);
        adjusted[index] = largest;
    }
    adjusted
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Darwin's plants, cross- minus self-fertilised, in eighths of an inch (Fisher 1935, table 3).
    const DARWIN: [f64; 15] =
        [49.0, -67.0, 8.0, 16.0, 6.0, 23.0, 28.0, 41.0, 14.0, 29.0, 56.0, 24.0, 75.0, 60.0, -48.0];

    fn p(differences: &[f64]) -> Option<f64> {
        sign_flips(differences, &[]).map(|test| test.p)
    }

    #[test]
    fn three_differences_by_hand() {
        // With all signs the sums are 7, 5, 3, 1 and their mirrors: all are as far as 1.
        let all = sign_flips(&[1.0, 2.0, -4.0], &[]).expect("three");
        assert_eq!((all.p, all.patterns, all.is_exact), (1.0, 8, true));
        assert!((all.mean + 1.0 / 3.0).abs() < 1e-12);
        // The same side all: only this pattern and its mirror are as far.
        assert_eq!(p(&[1.0, 2.0, 4.0]), Some(0.25));
        // 1 + 4 - 2 = 3: as far are 7, 5, 3 and their mirrors.
        assert_eq!(p(&[1.0, -2.0, 4.0]), Some(0.75));
        assert_eq!(p(&[-1.0, 2.0, -4.0]), Some(0.75));
    }

    #[test]
    fn equal_sums_are_as_far_whatever_their_rounding() {
        // All are 0.1 or 0.5, though 0.1 + 0.1 + 0.1 - 0.2 is a little more than 0.1 + 0.1 - 0.1.
        assert_eq!(p(&[0.1, 0.1, 0.1, -0.2]), Some(1.0));
        assert_eq!(p(&[0.0; 40]), Some(1.0));
    }

    #[test]
    fn fishers_example() {
        // Of 2^15 patterns 863 sums are as large as 314 or larger (Fisher 1935, section 21): 0.0527.
        let test = sign_flips(&DARWIN, &["Darwin"]).expect("15");
        assert!(!test.is_exact);
        assert!((test.p - 2.0 * 863.0 / 32_768.0).abs() < 0.007, "{test:?}"); // three deviations
        assert_eq!(sign_flips(&DARWIN, &["Darwin"]), Some(test));
        assert_ne!(sign_flips(&DARWIN, &["other"]), Some(test));
    }

    #[test]
    fn drawn_patterns_agree_with_all_of_them() {
        // Differences of 0 change nothing but how patterns are found.
        let some = &DARWIN[..12];
        let padded = [some, &[0.0; 30]].concat();
        let (exact, drawn) = (sign_flips(some, &[]), sign_flips(&padded, &["padded"]));
        let (exact, drawn) = (exact.expect("12"), drawn.expect("42"));
        assert!(exact.is_exact && !drawn.is_exact);
        assert!((exact.p - drawn.p).abs() < 0.007, "{exact:?} {drawn:?}");
    }

    #[test]
    fn p_is_small_but_never_zero() {
        let p = sign_flips(&[1.0; 60], &["sure"]).expect("60").p;
        assert!((p - 1.0 / 10_001.0).abs() < 1e-12, "{p}");
    }

    #[test]
    fn no_p_of_nothing() {
        assert_eq!(sign_flips(&[], &[]), None);
        assert_eq!(sign_flips(&[1.0, f64::NAN], &[]), None);
    }

    #[test]
    fn p_is_right_where_nothing_differs() {
        // 5 % of 2000 tests of differences without a mean: a deviation is 0.5 %.
        let mut random = Stream::named(&["nothing differs"]);
        let is_below = |_: &u32| {
            let differences: [f64; 10] = std::array::from_fn(|_| random.uniform() - 0.5);
            sign_flips(&differences, &[]).expect("ten").p <= 0.05
        };
        let share = (0..2000).filter(is_below).count() as f64 / 2000.0;
        assert!((share - 0.05).abs() < 0.015, "{share}");
    }

    #[test]
    fn holm_by_hand() {
        // Ascending 0.005, 0.01, 0.03, 0.04 times 4, 3, 2, 1: the last is below the one before.
        let adjusted = holm(&[0.01, 0.04, 0.03, 0.005]);
        for (found, expected) in adjusted.iter().zip([0.03, 0.06, 0.06, 0.02]) {
            assert!((found - expected).abs() < 1e-12, "{adjusted:?}");
        }
        assert_eq!(holm(&[0.6, f64::NAN, 0.9]), [1.0, 1.0, 1.0]);
        assert!(holm(&[]).is_empty());
    }
}
