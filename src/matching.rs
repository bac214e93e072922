//! One-to-one assignment of answers to truth.
//!
//! The most matches within the gate first, then the least sum of squared distances. Squares, not
//! distances, because they make the assignment the most likely one under isotropic Gaussian errors
//! and the one that minimises the error reported beside it, a root mean square. Or, where a match has
//! its price, the cheapest.

use pathfinding::kuhn_munkres::kuhn_munkres;
use pathfinding::matrix::Matrix;

use crate::geometry::ImagePoint;

/// Who belongs to whom; both lists say the same.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Assignment {
    /// For each truth point, the index of its answer.
    pub answer_of_truth: Vec<Option<usize>>,
    /// For each answer, the index of its truth point.
    pub truth_of_answer: Vec<Option<usize>>,
}

impl Assignment {
    /// How many pairs there are.
    pub fn matches(&self) -> usize {
        self.answer_of_truth.iter().flatten().count()
    }
}

/// The resolution of costs, relative to the largest within the gate; equal below it.
const RESOLUTION: f64 = (1_i64 << 30) as f64;

/// The resolution of prices: finer, as no match more has to outweigh their sum.
const PRICE_RESOLUTION: f64 = (1_i64 << 52) as f64;

/// Assigns `answers` to `truth` points one to one, never further apart than `gate_px`.
///
/// Points that are not finite are never matched. Equally good assignments are decided by the order
/// of the points, the same way every time.
pub fn assign(truth: &[ImagePoint], answers: &[ImagePoint], gate_px: f64) -> Assignment {
    let pairs = truth.iter().flat_map(|t| answers.iter().map(|a| t.distance_px(*a)));
    let within = pairs.filter(|distance_px| distance_px.is_finite() && *distance_px <= gate_px);
    let largest_px = within.fold(0.0, f64::max);
    let largest_px2 = (largest_px * largest_px).max(f64::MIN_POSITIVE);
    // One match more outweighs whatever all the costs can sum to.
    #[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "small counts")]
    let one_match = (truth.len().min(answers.len()) as i64 + 1) * RESOLUTION as i64;
    heaviest(truth, answers, |distance_px| {
        #[allow(clippy::cast_possible_truncation, reason = "at most the resolution")]
        let cost = (distance_px * distance_px / largest_px2 * RESOLUTION).round() as i64;
        (distance_px <= gate_px).then_some(one_match - cost)
    })
}

/// Assigns `answers` to `truth` points one to one so that the sum of the squared distances of the pairs is
/// the least, where each pair that there is not costs `price_px` squared: none is further apart than that,
/// but of two near pairs one may be given up where the other is closer for it.
///
/// The price is finite and positive. Points that are not finite are never matched.
pub fn assign_cheapest(truth: &[ImagePoint], answers: &[ImagePoint], price_px: f64) -> Assignment {
    heaviest(truth, answers, |distance_px| {
        let saved = 1.0 - (distance_px / price_px).powi(2);
        #[allow(clippy::cast_possible_truncation, reason = "at most the resolution")]
        let weight = (saved * PRICE_RESOLUTION).round() as i64;
        (distance_px < price_px).then_some(weight)
    })
}

/// The one-to-one assignment whose pairs weigh most; `weight` is of their distance \[px\], not negative,
/// `None` of those that may not be.
fn heaviest(
    truth: &[ImagePoint],
    answers: &[ImagePoint],
    weight: impl Fn(f64) -> Option<i64>,
) -> Assignment {
    let mut assignment = Assignment {
        answer_of_truth: vec![None; truth.len()],
        truth_of_answer: vec![None; answers.len()],
    };
    // Kuhn and Munkres want no more rows than columns.
    let truth_in_rows = truth.len() <= answers.len();
    let (rows, columns) = if truth_in_rows { (truth, answers) } else { (answers, truth) };
    if rows.is_empty() {
        return assignment;
    }

    let weight = |row: usize, column: usize| {
        Some(rows[row].distance_px(columns[column])).filter(|px| px.is_finite()).and_then(&weight)
    };
    // No match weighs nothing.
    let weights = Matrix::from_fn(rows.len(), columns.len(), |(row, column)| {
        weight(row, column).unwrap_or(0)
    });
    let (_, column_of_row) = kuhn_munkres(&weights);

    for (row, column) in column_of_row.into_iter().enumerate() {
        if weight(row, column).is_some() {
            let (t, a) = if truth_in_rows { (row, column) } else { (column, row) };
            assignment.answer_of_truth[t] = Some(a);
            assignment.truth_of_answer[a] = Some(t);
        }
    }
    assignment
}

/// For each truth point the answer with which it is first matched when answers are added one by one, in
/// their order, and each time as many truth points as possible are matched to answers of their own within
/// the gate; `None` where it never is.
///
/// A point that is matched once stays matched, to another answer perhaps. So of the first n answers
/// exactly those points are matched whose answer is among them, and they are as many as [`assign`]
/// would match: answers in descending order of their responses sweep a threshold in one pass. (Kuhn's
/// augmenting paths, 1955, The Hungarian method for the assignment problem.)
pub fn first_matched(
    truth: &[ImagePoint],
    answers: &[ImagePoint],
    gate_px: f64,
) -> Vec<Option<usize>> {
    let near: Vec<Vec<usize>> = answers.iter().map(|a| within(truth, *a, gate_px)).collect();
    let mut matching = Matching { near: &near, answer_of_truth: vec![None; truth.len()] };
    let mut first = vec![None; truth.len()];
    for answer in 0..answers.len() {
        if let Some(added) = matching.add(answer, &mut vec![false; truth.len()]) {
            first[added] = Some(answer);
        }
    }
    first
}

/// The points within the gate of another one, the nearest first.
fn within(points: &[ImagePoint], centre: ImagePoint, gate_px: f64) -> Vec<usize> {
    let distance_px = |index: &usize| points[*index].distance_px(centre);
    let is_near = |index: &usize| distance_px(index).is_finite() && distance_px(index) <= gate_px;
    let mut near: Vec<usize> = (0..points.len()).filter(is_near).collect();
    near.sort_by(|a, b| distance_px(a).total_cmp(&distance_px(b)));
    near
}

/// As many pairs as possible of the answers so far.
struct Matching<'a> {
    /// For each answer the truth points that it may have.
    near: &'a [Vec<usize>],
    answer_of_truth: Vec<Option<usize>>,
}

impl Matching<'_> {
    /// Gives an answer a truth point, others moving where they can; the point that had none before.
    fn add(&mut self, answer: usize, tried: &mut [bool]) -> Option<usize> {
        let near = self.near;
        for truth in &near[answer] {
            if std::mem::replace(&mut tried[*truth], true) {
                continue;
            }
            let added = match self.answer_of_truth[*truth] {
                None => Some(*truth),
                Some(other) => self.add(other, tried),
            };
            if added.is_some() {
                self.answer_of_truth[*truth] = Some(answer);
                return added;
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn points(coordinates: &[[f64; 2]]) -> Vec<ImagePoint> {
        coordinates.iter().copied().map(ImagePoint::from).collect()
    }

    fn cost_px2(truth: &[ImagePoint], answers: &[ImagePoint], assignment: &Assignment) -> f64 {
        let pairs = assignment.answer_of_truth.iter().enumerate();
        pairs.filter_map(|(t, a)| Some(truth[t].distance_px(answers[(*a)?]).powi(2))).sum()
    }

    /// The best (matches, cost) of all one-to-one assignments from truth point `t` on.
    fn brute_force(
        truth: &[ImagePoint],
        answers: &[ImagePoint],
        gate_px: f64,
        taken: &mut Vec<bool>,
    ) -> (usize, f64) {
        let Some((first, rest)) = truth.split_first() else { return (0, 0.0) };
        let mut best = brute_force(rest, answers, gate_px, taken);
        for a in 0..answers.len() {
            let distance_px = first.distance_px(answers[a]);
            if taken[a] || distance_px > gate_px {
                continue;
            }
            taken[a] = true;
            let (matches, cost) = brute_force(rest, answers, gate_px, taken);
            taken[a] = false;
            let candidate = (matches + 1, cost + distance_px * distance_px);
            if candidate.0 > best.0 || (candidate.0 == best.0 && candidate.1 < best.1) {
                best = candidate;
            }
        }
        best
    }

    /// What matches save at most, not positive, of all one-to-one assignments.
    fn cheapest(
        truth: &[ImagePoint],
        answers: &[ImagePoint],
        price_px: f64,
        taken: &mut Vec<bool>,
    ) -> f64 {
        let Some((first, rest)) = truth.split_first() else { return 0.0 };
        let mut best = cheapest(rest, answers, price_px, taken);
        for a in 0..answers.len() {
            if !std::mem::replace(&mut taken[a], true) {
                let saved = first.distance_px(answers[a]).powi(2) - price_px * price_px;
                best = best.min(saved + cheapest(rest, answers, price_px, taken));
                taken[a] = false;
            }
        }
        best
    }

    #[test]
    fn nothing_is_assigned_to_nothing() {
        let one = points(&[[1.0, 2.0]]);
        assert_eq!(assign(&[], &[], 1.0).matches(), 0);
        assert_eq!(assign(&one, &[], 1.0).answer_of_truth, [None]);
        assert_eq!(assign(&[], &one, 1.0).truth_of_answer, [None]);
    }

    #[test]
    fn one_match_more_is_worth_any_distance() {
        // The nearest pair (truth 0, answer 1) would leave truth 1 alone.
        let truth = points(&[[0.0, 0.0], [3.0, 0.0]]);
        let answers = points(&[[-2.0, 0.0], [1.0, 0.0]]);
        assert_eq!(assign(&truth, &answers, 2.5).answer_of_truth, [Some(0), Some(1)]);
    }

    #[test]
    fn one_match_more_may_be_too_dear() {
        // Both pairs cost 4 + 4, the nearest alone 1 and the price.
        let truth = points(&[[0.0, 0.0], [3.0, 0.0]]);
        let answers = points(&[[-2.0, 0.0], [1.0, 0.0]]);
        let alone = assign_cheapest(&truth, &answers, 2.5);
        assert_eq!(alone.answer_of_truth, [Some(1), None]);
        let both = assign_cheapest(&truth, &answers, 2.7);
        assert_eq!(both.answer_of_truth, [Some(0), Some(1)]);
    }

    #[test]
    fn a_duplicate_answer_stays_alone() {
        let truth = points(&[[5.0, 5.0]]);
        let answers = points(&[[5.5, 5.0], [5.1, 5.0]]);
        let assignment = assign(&truth, &answers, 1.0);
        assert_eq!(assignment.answer_of_truth, [Some(1)]);
        assert_eq!(assignment.truth_of_answer, [None, Some(0)]);
    }

    #[test]
    fn the_gate_is_inclusive_and_may_be_zero() {
        let truth = points(&[[0.0, 0.0]]);
        assert_eq!(assign(&truth, &points(&[[3.0, 4.0]]), 5.0).matches(), 1);
        assert_eq!(assign(&truth, &points(&[[3.0, 4.0]]), 4.999).matches(), 0);
        assert_eq!(assign(&truth, &points(&[[0.0, 0.0]]), 0.0).matches(), 1);
    }

    #[test]
    fn what_is_not_finite_is_never_matched() {
        let odd = points(&[[f64::NAN, 0.0], [f64::INFINITY, 0.0]]);
        let assignment = assign(&points(&[[0.0, 0.0]]), &odd, f64::INFINITY);
        assert_eq!(assignment.truth_of_answer, [None, None]);
        assert_eq!(assign(&odd, &odd, f64::NAN).matches(), 0);
        assert_eq!(first_matched(&odd, &odd, f64::INFINITY), [None, None]);
        // Nor does it hide which of the others is nearest.
        let truth = points(&[[0.0, 0.0], [f64::INFINITY, 0.0]]);
        let assignment =
            assign(&truth, &points(&[[2.0, 0.0], [1.0, 0.0], [3.0, 0.0]]), f64::INFINITY);
        assert_eq!(assignment.answer_of_truth, [Some(1), None]);
        assert_eq!(assign_cheapest(&odd, &odd, 3.0).matches(), 0);
    }

    fn some_points() -> impl Strategy<Value = Vec<ImagePoint>> {
        let point = (0.0..6.0, 0.0..6.0).prop_map(|(x, y)| ImagePoint::new(x, y));
        proptest::collection::vec(point, 0..=6)
    }

    proptest! {
        #[test]
        fn assignment_is_one_to_one_and_within_the_gate(
            truth in some_points(), answers in some_points(), gate_px in 0.1..5.0,
        ) {
            let assignment = assign(&truth, &answers, gate_px);
            for (t, a) in assignment.answer_of_truth.iter().enumerate() {
                if let Some(a) = *a {
                    prop_assert_eq!(assignment.truth_of_answer[a], Some(t));
                    prop_assert!(truth[t].distance_px(answers[a]) <= gate_px);
                }
            }
            prop_assert_eq!(assignment.truth_of_answer.iter().flatten().count(), assignment.matches());
        }

        #[test]
        fn assignment_is_as_good_as_brute_force(
            truth in some_points(), answers in some_points(), gate_px in 0.1..5.0,
        ) {
            let assignment = assign(&truth, &answers, gate_px);
            let (matches, cost) =
                brute_force(&truth, &answers, gate_px, &mut vec![false; answers.len()]);
            prop_assert_eq!(assignment.matches(), matches);
            prop_assert!((cost_px2(&truth, &answers, &assignment) - cost).abs() < 1e-6);
        }

        #[test]
        fn the_cheapest_assignment_is_as_cheap_as_brute_force(
            truth in some_points(), answers in some_points(), price_px in 0.1..5.0,
        ) {
            let assignment = assign_cheapest(&truth, &answers, price_px);
            let most = truth.len().min(answers.len());
            let price = |matches: usize, cost: f64| cost + (most - matches) as f64 * price_px * price_px;
            let found = price(assignment.matches(), cost_px2(&truth, &answers, &assignment));
            let best = cheapest(&truth, &answers, price_px, &mut vec![false; answers.len()]);
            prop_assert!((found - price(0, best)).abs() < 1e-9);
        }

        #[test]
        fn one_pass_over_the_answers_matches_as_many_as_each_prefix_by_itself(
            truth in some_points(), answers in some_points(), gate_px in 0.1..5.0,
        ) {
            let first = first_matched(&truth, &answers, gate_px);
            for count in 0..=answers.len() {
                let matched = first.iter().flatten().filter(|answer| **answer < count).count();
                prop_assert_eq!(matched, assign(&truth, &answers[..count], gate_px).matches());
            }
        }

        #[test]
        fn the_order_of_the_answers_does_not_matter(
            truth in some_points(),
            (answers, shuffled) in some_points().prop_flat_map(|answers| {
                (Just(answers.clone()), Just(answers).prop_shuffle())
            }),
            gate_px in 0.1..5.0,
        ) {
            let point_of_truth = |answers: &[ImagePoint]| -> Vec<Option<ImagePoint>> {
                let assignment = assign(&truth, answers, gate_px);
                assignment.answer_of_truth.iter().map(|a| a.map(|a| answers[a])).collect()
            };
            prop_assert_eq!(point_of_truth(&answers), point_of_truth(&shuffled));
        }
    }
}
