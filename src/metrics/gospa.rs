//! How far a set of answers is from a set of true points: near ones, missed ones and false ones in one
//! number that is a metric.

use crate::geometry::ImagePoint;
use crate::matching::assign_cheapest;

/// The usual distance from which two points are not of the same corner \[px\].
pub const CUTOFF_PX: f64 = 3.0;

/// A distance between two sets of points and what it is made of: its square is the sum of the parts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gospa {
    /// The distance \[px\].
    pub distance_px: f64,
    /// The sum of the squared distances of the pairs \[px^2\].
    pub localisation_px2: f64,
    /// What true points without an answer cost, half a squared cutoff each \[px^2\].
    pub missed_px2: f64,
    /// What answers without a true point cost, the same each \[px^2\].
    pub false_px2: f64,
    /// How many pairs there are.
    pub pairs: usize,
    /// How many true points have no answer.
    pub missed: usize,
    /// How many answers have no true point.
    pub false_answers: usize,
}

/// The generalised optimal sub-pattern assignment metric with alpha = 2 and p = 2 (Rahmathullah,
/// Garcia-Fernandez & Svensson 2017, Generalized optimal sub-pattern assignment metric, proposition 1):
/// the least, over all one-to-one assignments, of the sum of the pairs' squared distances and half of
/// `cutoff_px` squared for each point without a partner; of this the root.
///
/// No pair is as far apart as the cutoff, which is positive. A point that is not finite has no partner.
#[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
pub fn gospa(truth: &[ImagePoint], answers: &[ImagePoint], cutoff_px: f64) -> Gospa {
    let assignment = assign_cheapest(truth, answers, cutoff_px);
    let pairs = assignment.matches();
    let of_truth = truth.iter().zip(&assignment.answer_of_truth);
    let squares = of_truth.filter_map(|(t, a)| Some(t.distance_px(answers[(*a)?]).powi(2)));
    let localisation_px2 = squares.fold(0.0, |sum, square| sum + square);
    let (missed, false_answers) = (truth.len() - pairs, answers.len() - pairs);
    let alone_px2 = 0.5 * cutoff_px * cutoff_px;
    let (missed_px2, false_px2) = (missed as f64 * alone_px2, false_answers as f64 * alone_px2);
    Gospa {
        distance_px: (localisation_px2 + missed_px2 + false_px2).sqrt(),
        localisation_px2,
        missed_px2,
        false_px2,
        pairs,
        missed,
        false_answers,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn points(coordinates: &[[f64; 2]]) -> Vec<ImagePoint> {
        coordinates.iter().copied().map(ImagePoint::from).collect()
    }

    #[test]
    fn a_pair_a_missed_one_and_two_false_ones_by_hand() {
        let truth = points(&[[0.0, 0.0], [50.0, 0.0]]);
        let answers = points(&[[0.6, 0.8], [20.0, 0.0], [30.0, 0.0]]);
        let found = gospa(&truth, &answers, CUTOFF_PX);
        assert!((found.localisation_px2 - 1.0).abs() < 1e-12);
        assert_eq!((found.missed_px2, found.false_px2), (4.5, 9.0));
        assert_eq!((found.pairs, found.missed, found.false_answers), (1, 1, 2));
        assert!((found.distance_px - 14.5_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn the_cutoff_is_where_a_pair_costs_as_much_as_two_alone() {
        let at = |x: f64| gospa(&points(&[[0.0, 0.0]]), &points(&[[x, 0.0]]), 3.0);
        assert!((at(2.999).distance_px - 2.999).abs() < 1e-12);
        assert_eq!((at(2.999).pairs, at(3.0).pairs, at(80.0).pairs), (1, 0, 0));
        assert_eq!((at(3.0).distance_px, at(80.0).distance_px), (3.0, 3.0));
    }

    #[test]
    fn two_far_pairs_are_worse_than_a_near_one_and_two_alone() {
        // In a row 0, 2.9, with answers -2.8, 0.1: 2 * 2.8^2 = 15.68, or 0.01 + 9.
        let truth = points(&[[0.0, 0.0], [2.9, 0.0]]);
        let found = gospa(&truth, &points(&[[-2.8, 0.0], [0.1, 0.0]]), 3.0);
        assert_eq!((found.pairs, found.missed, found.false_answers), (1, 1, 1));
        assert!((found.distance_px - 9.01_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn nothing_and_what_is_not_finite() {
        assert_eq!(gospa(&[], &[], 3.0).distance_px.to_bits(), 0);
        let odd = points(&[[f64::NAN, 0.0], [f64::INFINITY, 1.0]]);
        let distances_px = (gospa(&odd, &[], 3.0).distance_px, gospa(&odd, &odd, 3.0).distance_px);
        assert_eq!(distances_px, (3.0, 18_f64.sqrt()));
    }

    fn some_points() -> impl Strategy<Value = Vec<ImagePoint>> {
        let point = (0.0..6.0, 0.0..6.0).prop_map(|(x, y)| ImagePoint::new(x, y));
        proptest::collection::vec(point, 0..=6)
    }

    proptest! {
        #[test]
        fn it_is_a_metric(a in some_points(), b in some_points(), c in some_points()) {
            let distance_px = |from: &[_], to: &[_]| gospa(from, to, CUTOFF_PX).distance_px;
            prop_assert_eq!(distance_px(&a, &a).to_bits(), 0);
            prop_assert!(distance_px(&a, &b) > 0.0 || a == b);
            prop_assert!((distance_px(&a, &b) - distance_px(&b, &a)).abs() < 1e-9);
            let detour_px = distance_px(&a, &c) + distance_px(&c, &b);
            prop_assert!(distance_px(&a, &b) <= detour_px + 1e-9);
        }

        #[test]
        fn the_order_does_not_matter_and_parts_sum_up(a in some_points(), b in some_points()) {
            let found = gospa(&a, &b, CUTOFF_PX);
            let mut reversed = a.clone();
            reversed.reverse();
            prop_assert!((gospa(&reversed, &b, CUTOFF_PX).distance_px - found.distance_px).abs() < 1e-9);
            let sum_px2 = found.localisation_px2 + found.missed_px2 + found.false_px2;
            prop_assert!((found.distance_px.powi(2) - sum_px2).abs() < 1e-9);
        }
    }
}
