//! Robust statistics of plain numbers; knows nothing of corners.

mod bootstrap;
#[cfg(test)]
mod coverage;
mod permutation;
mod ranking;

use serde::Serialize;

pub use bootstrap::{Bootstrap, Interval, NoInterval};
pub use permutation::{SignFlips, holm, sign_flips};
pub use ranking::{Friedman, critical_difference, friedman, groups, ranks, studentised_range};

/// The mean; `None` of nothing.
#[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// The root of the mean square; `None` of nothing.
pub fn root_mean_square(values: &[f64]) -> Option<f64> {
    mean(&values.iter().map(|value| value * value).collect::<Vec<_>>()).map(f64::sqrt)
}

/// The standard error of the mean; `None` of fewer than two values.
#[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
pub fn standard_error(values: &[f64]) -> Option<f64> {
    let average = mean(values)?;
    let count = values.len() as f64;
    (values.len() > 1).then(|| {
        let sum: f64 = values.iter().map(|value| (value - average).powi(2)).sum();
        (sum / (count - 1.0) / count).sqrt()
    })
}

/// By how much squared errors over their variances exceed 1, so many degrees of freedom being left over: 1 where chance
/// makes as much of it (three standard deviations of chi square), so that covariances of what is described rightly are not
/// made larger by their own scatter.
pub fn excess(chi_square: f64, degrees_of_freedom: f64) -> f64 {
    const DEVIATIONS: f64 = 3.0;
    let of_one = chi_square / degrees_of_freedom;
    if of_one > 1.0 + DEVIATIONS * (2.0 / degrees_of_freedom).sqrt() { of_one } else { 1.0 }
}

/// The quantile at `probability` in \[0, 1\], interpolated linearly between order statistics
/// (Hyndman & Fan 1996, definition 7, as in NumPy); `None` of nothing.
pub fn quantile(values: &[f64], probability: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    quantile_of_sorted(&sorted, probability)
}

/// The quantile of values in ascending order.
#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "an index inside the slice"
)]
fn quantile_of_sorted(sorted: &[f64], probability: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let place = probability.clamp(0.0, 1.0) * last as f64;
    let below = place.floor() as usize;
    let above = (below + 1).min(last);
    Some(sorted[below] + (place - below as f64) * (sorted[above] - sorted[below]))
}

/// The median; `None` of nothing.
pub fn median(values: &[f64]) -> Option<f64> {
    quantile(values, 0.5)
}

/// The probability of lying beyond one end of an interval of `level`: at least 1e-6, and that where the
/// level is NaN, for what inverts distributions answers no less.
fn tail(level: f64) -> f64 {
    if level.is_nan() { 1e-6 } else { (0.5 - 0.5 * level).clamp(1e-6, 0.5) }
}

/// What a threshold on a score lets through.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OperatingPoint {
    /// The threshold: scores equal to it pass.
    pub threshold: f64,
    /// Right answers, of all answers.
    pub precision: f64,
    /// Right answers, of all that was asked for.
    pub recall: f64,
}

impl OperatingPoint {
    /// The harmonic mean of precision and recall (van Rijsbergen 1979, Information Retrieval).
    pub fn f1(&self) -> f64 {
        let sum = self.precision + self.recall;
        if sum > 0.0 { 2.0 * self.precision * self.recall / sum } else { 0.0 }
    }

    /// Of a curve, the highest threshold first, the point where that mean is largest; of equally good ones that with
    /// the higher threshold. `None` of an empty curve.
    pub fn best(curve: &[Self]) -> Option<Self> {
        curve.iter().fold(None, |best: Option<Self>, point| match best {
            Some(best) if best.f1() >= point.f1() => Some(best),
            _ => Some(*point),
        })
    }
}

/// One that answers only where it is certain enough: how often it answers, and how often it is wrong then.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Selective {
    /// Share of what was asked that is answered.
    pub coverage: f64,
    /// Share of these answers that are wrong.
    pub risk: f64,
}

/// Risk over coverage, the most certain answers first (El-Yaniv & Wiener, On the foundations of noise-free selective
/// classification, JMLR 2010): of each answer the error that it states of itself, infinite where it states none, and
/// whether it is wrong. Answers that state the same come together. The last point is that of all answers.
#[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
pub fn risk_coverage(answers: &[(f64, bool)], asked: usize) -> Vec<Selective> {
    let mut sorted = answers.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut curve = Vec::new();
    let mut wrong = 0;
    for (index, (stated, is_wrong)) in sorted.iter().enumerate() {
        wrong += usize::from(*is_wrong);
        let count = index + 1;
        if sorted.get(count).is_none_or(|next| next.0 > *stated) && asked > 0 {
            let coverage = count as f64 / asked as f64;
            curve.push(Selective { coverage, risk: wrong as f64 / count as f64 });
        }
    }
    curve
}

/// The mean of risk over coverage, up to where the curve ends (Geifman, Uziel & El-Yaniv, Bias-reduced uncertainty
/// estimation, ICLR 2019: AURC, there over all coverages); `None` of an empty curve.
pub fn mean_risk(curve: &[Selective]) -> Option<f64> {
    let end = curve.last()?.coverage;
    let before = std::iter::once(0.0).chain(curve.iter().map(|point| point.coverage));
    let steps = curve.iter().zip(before).map(|(point, b)| (point.coverage - b) * point.risk);
    Some(steps.sum::<f64>() / end)
}

/// Precision and recall at every threshold that makes a difference, the highest first: `answers` are the
/// scores of all answers, `right` those at which one thing more of the `asked` is found, each of them
/// among `answers`. Empty where nothing is asked for or nothing answered.
#[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
pub fn precision_recall(answers: &[f64], right: &[f64], asked: usize) -> Vec<OperatingPoint> {
    let descending = |scores: &[f64]| {
        let mut sorted = scores.to_vec();
        sorted.sort_by(|a, b| b.total_cmp(a));
        sorted
    };
    let (answers, right) = (descending(answers), descending(right));
    let passing = |scores: &[f64], threshold: f64| scores.partition_point(|s| *s >= threshold);
    let mut thresholds = if asked > 0 { answers.clone() } else { Vec::new() };
    thresholds.dedup();
    let at = |threshold: f64| {
        let found = passing(&right, threshold) as f64;
        let precision = found / passing(&answers, threshold) as f64;
        OperatingPoint { threshold, precision, recall: found / asked as f64 }
    };
    thresholds.into_iter().map(at).collect()
}

/// The area under a curve of precision over recall, as steps: each gain in recall counts with the
/// precision at which it is made. No interpolation, which would flatter (scikit-learn's definition).
pub fn average_precision(curve: &[OperatingPoint]) -> f64 {
    let before = std::iter::once(0.0).chain(curve.iter().map(|point| point.recall));
    let steps = curve.iter().zip(before).map(|(point, b)| (point.recall - b) * point.precision);
    steps.fold(0.0, |sum, step| sum + step) // the sum of nothing would be -0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn risk_grows_with_coverage_where_what_answers_state_of_themselves_is_true() {
        let answers =
            [(0.3, true), (0.1, false), (0.2, false), (f64::INFINITY, true), (0.2, false)];
        let curve = risk_coverage(&answers, 10);
        let point = |coverage, risk| Selective { coverage, risk };
        assert_eq!(curve, [point(0.1, 0.0), point(0.3, 0.0), point(0.4, 0.25), point(0.5, 0.4)]);
        let mean = mean_risk(&curve).expect("a curve");
        assert!((mean - (0.1 * 0.25 + 0.1 * 0.4) / 0.5).abs() < 1e-12, "{mean}");
        // The other way round the first answers are wrong ones.
        let reversed: Vec<(f64, bool)> = answers.iter().map(|(s, wrong)| (-s, *wrong)).collect();
        let worse = mean_risk(&risk_coverage(&reversed, 10)).expect("a curve");
        assert!(worse > 0.5, "{worse}");
        assert!(risk_coverage(&[], 10).is_empty() && mean_risk(&[]).is_none());
    }

    #[test]
    fn errors_exceed_their_variances_by_more_than_chance_or_not_at_all() {
        // Chi square of 8 has deviation 4: up to 20 is chance.
        for (chi_square, excess_is) in [(1.0, 1.0), (8.0, 1.0), (19.9, 1.0), (24.0, 3.0)] {
            assert!((excess(chi_square, 8.0) - excess_is).abs() < 1e-12, "{chi_square}");
        }
    }

    #[test]
    fn statistics_of_nothing_are_none() {
        assert_eq!((mean(&[]), median(&[]), root_mean_square(&[])), (None, None, None));
        assert_eq!(standard_error(&[1.0]), None);
    }

    #[test]
    fn quantiles_interpolate_between_order_statistics() {
        let values = [4.0, 1.0, 3.0, 2.0];
        assert_eq!(median(&values), Some(2.5));
        assert_eq!(quantile(&values, 0.0), Some(1.0));
        assert_eq!(quantile(&values, 1.0), Some(4.0));
        assert!((quantile(&values, 0.95).expect("some") - 3.85).abs() < 1e-12);
    }

    #[test]
    fn standard_error_of_a_known_sample() {
        assert!((standard_error(&[1.0, 3.0]).expect("two") - 1.0).abs() < 1e-12);
    }

    #[test]
    fn precision_and_recall_of_a_known_ranking() {
        // Right, wrong, right at the same score as a wrong one, wrong; three were asked for.
        let curve = precision_recall(&[5.0, 9.0, 7.0, 5.0, 1.0], &[9.0, 5.0], 3);
        let points: Vec<_> = curve.iter().map(|p| (p.threshold, p.precision, p.recall)).collect();
        let third = 1.0 / 3.0;
        assert_eq!(
            points,
            [
                (9.0, 1.0, third),
                (7.0, 0.5, third),
                (5.0, 0.5, 2.0 * third),
                (1.0, 0.4, 2.0 * third)
            ]
        );
        assert!((average_precision(&curve) - 0.5).abs() < 1e-12);
        assert!((curve[0].f1() - 0.5).abs() < 1e-12);
    }

    #[test]
    fn nothing_asked_or_answered_has_no_curve() {
        assert_eq!(precision_recall(&[1.0], &[], 0), []);
        assert_eq!(precision_recall(&[], &[], 3), []);
        assert_eq!(average_precision(&[]).to_bits(), 0, "0, not -0");
    }
}
