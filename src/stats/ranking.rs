//! Which of several methods differ, by their ranks on the same clusters.
//!
//! Demšar (2006), Statistical Comparisons of Classifiers over Multiple Data Sets, JMLR 7: the ranks of
//! methods on each cluster do not mind that some clusters are harder by far, nor a wild error.

use statrs::distribution::{ContinuousCDF, FisherSnedecor};

/// The ranks of values, the least having rank 1; equal ones have the mean of their ranks. `None` where
/// a value is NaN. Infinity is the last rank: what failed.
pub fn ranks(values: &[f64]) -> Option<Vec<f64>> {
    if values.iter().any(|value| value.is_nan()) {
        return None;
    }
    let below = |value: f64| values.iter().filter(|other| **other < value).count();
    let not_above = |value: f64| values.iter().filter(|other| **other <= value).count();
    #[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
    let rank = |value: &f64| 0.5 * (below(*value) + not_above(*value) + 1) as f64;
    Some(values.iter().map(rank).collect())
}

/// Whether methods differ at all.
#[derive(Clone, Debug, PartialEq)]
pub struct Friedman {
    /// The mean rank of each method over all clusters; the best possible is 1.
    pub mean_ranks: Vec<f64>,
    /// How many clusters there are.
    pub clusters: usize,
    /// Friedman's statistic, corrected for ties.
    pub chi_square: f64,
    /// Iman and Davenport's statistic; infinite where all clusters rank the methods alike.
    pub f: f64,
    /// How often it is as large or larger where no method differs.
    pub p: f64,
}

/// Friedman's test of whether methods differ, `clusters` being the values of all methods on each, the
/// least being the best.
///
/// Friedman (1937), corrected for ties (Conover 1999, Practical Nonparametric Statistics, section 5.8,
/// T1), and Iman & Davenport (1980), Approximations of the critical region of the Friedman statistic:
/// F = (n - 1) chi^2 / (n (k - 1) - chi^2), which follows Fisher's distribution with k - 1 and
/// (k - 1) (n - 1) degrees of freedom better than chi^2 does its own (Demšar 2006, section 3.2.2).
///
/// `None` of fewer than two clusters or methods, of rows of different lengths and of NaN. Where all
/// methods tie everywhere, p is 1.
#[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
pub fn friedman(clusters: &[Vec<f64>]) -> Option<Friedman> {
    let methods = clusters.first()?.len();
    if clusters.len() < 2 || methods < 2 || clusters.iter().any(|row| row.len() != methods) {
        return None;
    }
    let of_clusters: Vec<Vec<f64>> =
        clusters.iter().map(|row| ranks(row)).collect::<Option<_>>()?;
    let (n, k) = (clusters.len() as f64, methods as f64);
    let mean_rank = |method: usize| of_clusters.iter().map(|row| row[method]).sum::<f64>() / n;
    let mean_ranks: Vec<f64> = (0..methods).map(mean_rank).collect();

    let middle = 0.5 * (k + 1.0);
    let from_middle = |ranks: &[f64]| ranks.iter().map(|r| (r - middle).powi(2)).sum::<f64>();
    let within: f64 = of_clusters.iter().map(|row| from_middle(row)).sum();
    let freedom = k - 1.0;
    // As if all were ties, of which no cluster prefers a method: 0 of 0.
    let share = if within > 0.0 { n * from_middle(&mean_ranks) / within } else { 0.0 };
    let chi_square = n * freedom * share;
    let rest = 1.0 - share;
    let f = if rest > 1e-12 { (n - 1.0) * share / rest } else { f64::INFINITY };
    let fisher = FisherSnedecor::new(freedom, freedom * (n - 1.0)).ok()?;
    let p = if f.is_finite() { fisher.sf(f) } else { 0.0 };
    Some(Friedman { mean_ranks, clusters: clusters.len(), chi_square, f, p })
}

/// How far the mean ranks of two of `methods` must be apart to differ at level `alpha`, all pairs
/// being compared (Nemenyi 1963; Demšar 2006, section 3.2.2). `None` of fewer than two methods, of no
/// cluster, and where `alpha` is not in (0, 1).
#[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
pub fn critical_difference(methods: usize, clusters: usize, alpha: f64) -> Option<f64> {
    let (n, k) = (clusters as f64, methods as f64);
    let range = studentised_range(methods, alpha)?;
    (clusters > 0).then(|| range / 2_f64.sqrt() * (k * (k + 1.0) / (6.0 * n)).sqrt())
}

/// What the range of `count` standard normal numbers exceeds with probability `alpha`: the studentised
/// range of infinite degrees of freedom. `None` of fewer than two and where `alpha` is not in (0, 1).
pub fn studentised_range(count: usize, alpha: f64) -> Option<f64> {
    if count < 2 || !(alpha > 0.0 && alpha < 1.0) {
        return None;
    }
    let (mut low, mut high) = (0.0, 80.0); // beyond the range of any numbers that may be
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if range_below(count, middle) < 1.0 - alpha {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(0.5 * (low + high))
}

/// The probability that the range of `count` standard normal numbers is less than `range`: the least of
/// them is somewhere, and the others are at most that far above it (Tukey 1953; Hartley 1942),
/// k \int phi(z) (Phi(z + q) - Phi(z))^(k - 1) dz.
#[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
fn range_below(count: usize, range: f64) -> f64 {
    const STEP: f64 = 1.0 / 16.0; // the trapezoidal rule is exact to rounding for so smooth a bell
    let others = count as f64 - 1.0;
    let above = |z: f64| 0.5 * libm::erfc(z * std::f64::consts::FRAC_1_SQRT_2);
    let density = |z: f64| (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
    let at = |z: f64| density(z) * (above(z) - above(z + range)).powf(others);
    let sum: f64 = (-160..=160).map(|step| at(f64::from(step) * STEP)).sum();
    count as f64 * STEP * sum
}

/// The groups of methods that do not differ, as drawn below a line of ranks: each as large as can be,
/// its mean ranks less than a critical difference apart, none within another, none of one method. The
/// indices of the methods, the best first, in each group and among the groups.
pub fn groups(mean_ranks: &[f64], critical_difference: f64) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..mean_ranks.len()).collect();
    order.sort_by(|a, b| mean_ranks[*a].total_cmp(&mean_ranks[*b]));
    let mut groups: Vec<Vec<usize>> = Vec::new();
    let mut drawn_to = 0;
    for (first, best) in order.iter().enumerate() {
        let alike = |other: &&usize| mean_ranks[**other] - mean_ranks[*best] < critical_difference;
        let end = first + order[first..].iter().take_while(alike).count();
        if end > drawn_to.max(first + 1) {
            groups.push(order[first..end].to_vec());
            drawn_to = end;
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() < tolerance, "{found}, not {expected}");
    }

    #[test]
    fn ties_share_their_ranks() {
        assert_eq!(ranks(&[3.0, 1.0, 3.0, 2.0]), Some(vec![3.5, 1.0, 3.5, 2.0]));
        assert_eq!(ranks(&[f64::INFINITY, 5.0, f64::INFINITY]), Some(vec![2.5, 1.0, 2.5]));
        assert_eq!(ranks(&[0.0; 4]), Some(vec![2.5; 4]));
        assert_eq!(ranks(&[1.0, f64::NAN]), None);
    }

    /// The ranks of four classifiers on 14 data sets: Demšar 2006, table 6.
    fn demsar() -> Vec<Vec<f64>> {
        [
            [4.0, 3.0, 2.0, 1.0],
            [1.0, 2.0, 3.0, 4.0],
            [4.0, 1.0, 2.0, 3.0],
            [4.0, 1.0, 3.0, 2.0],
            [4.0, 2.0, 3.0, 1.0],
            [1.0, 2.5, 4.0, 2.5],
            [3.0, 2.0, 4.0, 1.0],
            [2.5, 2.5, 4.0, 1.0],
            [4.0, 3.0, 2.0, 1.0],
            [2.5, 2.5, 2.5, 2.5],
            [4.0, 2.5, 1.0, 2.5],
            [3.0, 2.0, 4.0, 1.0],
            [4.0, 1.0, 2.0, 3.0],
            [3.0, 1.0, 4.0, 2.0],
        ]
        .map(|row| row.to_vec())
        .to_vec()
    }

    #[test]
    fn demsars_example() {
        let test = friedman(&demsar()).expect("14 by 4");
        for (found, expected) in test.mean_ranks.iter().zip([3.143, 2.000, 2.893, 1.964]) {
            near(*found, expected, 5e-4);
        }
        // He has 9.28, not corrected for ties, of which each of three takes 0.5 and one of four 5 from
        // the ranks' sum of squares about their middle, 70.
        near(test.chi_square, 9.28 * 70.0 / 63.5, 0.01);
        near(test.f, 13.0 * test.chi_square / (14.0 * 3.0 - test.chi_square), 1e-9);
        near(critical_difference(4, 14, 0.05).expect("some"), 1.25, 5e-3);
        near(critical_difference(4, 14, 0.10).expect("some"), 1.12, 5e-3);
        assert_eq!(groups(&test.mean_ranks, 1.25), [[3, 1, 2, 0]]);
        assert_eq!(groups(&test.mean_ranks, 1.12), [vec![3, 1, 2], vec![2, 0]]);
    }

    #[test]
    fn friedman_without_ties_by_hand() {
        // Ranks (1 2 3), (1 2 3), (1 3 2), (2 1 3): sums 5, 8, 11, chi^2 = 12 / (4 * 3 * 4) * 210 - 48,
        // F = 3 * 4.5 / (8 - 4.5) of 2 and 6 degrees of freedom, whose tail is (1 + F / 3)^-3.
        let rows = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [1.0, 9.0, 8.0], [0.2, 0.1, 0.3]];
        let test = friedman(&rows.map(|row| row.to_vec())).expect("four by three");
        near(test.chi_square, 4.5, 1e-9);
        near(test.f, 27.0 / 7.0, 1e-9);
        near(test.p, (1.0 + 9.0 / 7.0_f64).powi(-3), 1e-9);
    }

    #[test]
    fn ends_of_friedmans_test() {
        let alike = friedman(&[vec![1.0, 2.0, 3.0], vec![2.0, 5.0, 7.0]]).expect("two by three");
        assert_eq!((alike.p, alike.f), (0.0, f64::INFINITY));
        near(alike.chi_square, 4.0, 1e-9);
        let tied = friedman(&[vec![1.0, 1.0], vec![2.0, 2.0]]).expect("two by two");
        assert_eq!((tied.p, tied.f, tied.chi_square), (1.0, 0.0, 0.0));
        assert_eq!(friedman(&[]), None);
        assert_eq!(friedman(&[vec![1.0, 2.0]]), None);
        assert_eq!(friedman(&[vec![1.0], vec![2.0]]), None);
        assert_eq!(friedman(&[vec![1.0, 2.0], vec![2.0]]), None);
        assert_eq!(friedman(&[vec![1.0, f64::NAN], vec![2.0, 1.0]]), None);
    }

    #[test]
    fn demsars_critical_values() {
        // Table 5: quantiles divided by the root of 2, of 2 to 10 methods.
        let at_5 = [1.960, 2.343, 2.569, 2.728, 2.850, 2.949, 3.031, 3.102, 3.164];
        let at_10 = [1.645, 2.052, 2.291, 2.459, 2.589, 2.693, 2.780, 2.855, 2.920];
        for (alpha, expected) in [(0.05, at_5), (0.10, at_10)] {
            for (methods, expected) in (2..).zip(expected) {
                let found = studentised_range(methods, alpha).expect("some") / 2_f64.sqrt();
                near(found, expected, 1.1e-3); // his last digit is not always rounded
            }
        }
    }

    #[test]
    fn ranges_of_many_numbers() {
        // Two numbers differ by a normal number of variance 2; of more there are tables.
        near(range_below(2, 2_f64.sqrt() * 1.959_964), 0.95, 1e-6);
        near(studentised_range(20, 0.05).expect("some"), 5.012, 2e-3);
        near(studentised_range(100, 0.05).expect("some"), 6.085, 2e-3);
        for methods in 2..200 {
            near(range_below(methods, 40.0), 1.0, 1e-12);
        }
        assert_eq!(studentised_range(1, 0.05), None);
        for alpha in [0.0, 1.0, f64::NAN] {
            assert_eq!(studentised_range(3, alpha), None);
        }
        assert_eq!(critical_difference(3, 0, 0.05), None);
    }

    #[test]
    fn groups_are_maximal_and_may_overlap() {
        let mean_ranks = [5.0, 1.0, 2.0, 2.8, 9.0];
        assert_eq!(groups(&mean_ranks, 2.5), [vec![1, 2, 3], vec![3, 0]]);
        assert_eq!(groups(&mean_ranks, 1.0), [vec![2, 3]]); // exactly 1 apart is apart
        assert_eq!(groups(&mean_ranks, 100.0), [vec![1, 2, 3, 0, 4]]);
        assert!(groups(&mean_ranks, 0.0).is_empty());
        assert!(groups(&[], 1.0).is_empty());
    }
}
