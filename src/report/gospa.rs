//! Records -> how far all answers together are from the corners asked for: near ones, missed ones and false ones in
//! one number, and how many are right within gates of several widths.
//!
//! GOSPA with p = 2 and alpha = 2 (Rahmathullah, Garcia-Fernandez & Svensson 2017, proposition 1). Who belongs to whom
//! is what the records say, decided once by the detector's position within the plan's gate.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;

use crate::record::{Record, kind, status, track};
use crate::report::refinement::{Estimate, estimate, is_answered, log};
use crate::stats::{OperatingPoint, average_precision, precision_recall};

/// From so far on an answer is of another point \[px\].
pub const CUTOFF_PX: f64 = 3.0;

/// What a corner without an answer costs, and an answer without a corner \[px^2\].
const ALONE_PX2: f64 = 0.5 * CUTOFF_PX * CUTOFF_PX;

/// Gates: within each of them an answer may be right \[px\].
pub const GATES_PX: [f64; 6] = [0.25, 0.5, 1.0, 2.0, 3.0, 5.0];

/// What one corner asked for, or one answer, adds to squared distances \[px^2\]. Sums of these are sums over corners.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Cost {
    /// Squared distance of a pair.
    pub localisation_px2: f64,
    /// Half the squared cutoff for a corner without an answer.
    pub missed_px2: f64,
    /// Half the squared cutoff for an answer without a corner.
    pub false_px2: f64,
    /// 1 for a corner asked for.
    pub asked: f64,
}

impl Cost {
    /// The cost of a record: all 0 of what is neither a corner asked for nor a false answer.
    ///
    /// A pair as far apart as the cutoff, or farther, is a missed corner and a false answer. So is a given corner
    /// that its refiner declined: there is no other answer to it.
    pub fn of(record: &Record) -> Self {
        let asked = Self { asked: 1.0, ..Self::default() };
        match (record.kind.as_str(), record.status.as_str()) {
            (kind::CORNER, status::OK) => match distance_px(record) {
                Some(px) if px < CUTOFF_PX => Self { localisation_px2: px * px, ..asked },
                _ => Self { missed_px2: ALONE_PX2, false_px2: ALONE_PX2, ..asked },
            },
            (kind::CORNER, status::MISSED) => Self::without_answer(record),
            (kind::FALSE_CORNER, status::FALSE) => Self { false_px2: ALONE_PX2, ..Self::default() },
            _ => Self::default(),
        }
    }

    /// The cost of a record whose answer is taken away: a corner asked for is missed.
    pub fn without_answer(record: &Record) -> Self {
        let is_asked = record.kind == kind::CORNER
            && [status::OK, status::MISSED].contains(&record.status.as_str());
        let missed = Self { missed_px2: ALONE_PX2, asked: 1.0, ..Self::default() };
        if is_asked { missed } else { Self::default() }
    }

    /// All of it.
    pub fn square_px2(self) -> f64 {
        self.localisation_px2 + self.missed_px2 + self.false_px2
    }
}

/// How far the answer to a corner is from it \[px\]: the refiner's, or the detector's where the refiner declined. None
/// where seeds were given and the refiner declined, and where it gave no answer at all.
fn distance_px(record: &Record) -> Option<f64> {
    if is_answered(record) {
        return record.refined_error_px;
    }
    // What a program did not answer is no answer of the detector's: else to fail could pay.
    let is_failed = record.refine_status.as_deref() == Some("failed");
    record.detected_error_px.filter(|_| record.track != track::REFINEMENT && !is_failed)
}

/// GOSPA over all photographs.
#[derive(Clone, Debug, Serialize)]
pub struct GospaSummary {
    /// The distance from which two points are not of one corner \[px\].
    pub cutoff_px: f64,
    /// Photographs.
    pub photographs: usize,
    /// Corners asked for in them.
    pub asked: usize,
    /// The headline: the root of the mean square over the corners asked for \[px\]. No answer at all is 2.12 px.
    pub per_corner_px: Option<Estimate>,
    /// Root mean square over photographs of the distance in each \[px\].
    pub per_photograph_px: Option<Estimate>,
    /// What found corners add to the square of `per_corner_px` \[px^2\].
    pub localisation_px2: Option<Estimate>,
    /// What missed corners add to it \[px^2\].
    pub missed_px2: Option<Estimate>,
    /// What false answers add to it \[px^2\].
    pub false_px2: Option<Estimate>,
}

/// A scene's sums.
const LOCALISATION: usize = 0;
const MISSED: usize = 1;
const FALSE: usize = 2;
const ASKED: usize = 3;
const PHOTOGRAPHS: usize = 4;

/// Summarises the records of one method; answers that do not pass are as if they were not there.
#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "counts far below 2^52"
)]
pub fn summarise(records: &[&Record], passes: impl Fn(&Record) -> bool) -> GospaSummary {
    let mut scenes: BTreeMap<&str, ([f64; 5], BTreeSet<Option<i32>>)> = BTreeMap::new();
    for record in records {
        let (sums, exposures) = scenes.entry(&record.scene).or_default();
        let cost = if passes(record) { Cost::of(record) } else { Cost::without_answer(record) };
        let Cost { localisation_px2, missed_px2, false_px2, asked } = cost;
        let more = [localisation_px2, missed_px2, false_px2, asked];
        sums.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
        exposures.insert(record.exposure);
    }
    let sums: Vec<[f64; 5]> = scenes
        .values()
        .map(|([near, missed, wrong, asked, _], exposures)| {
            [*near, *missed, *wrong, *asked, exposures.len() as f64]
        })
        .collect();
    let root = |of: usize| {
        let square = |sums: &[f64; 5]| sums[LOCALISATION] + sums[MISSED] + sums[FALSE];
        root_mean(&sums, &square, &|sums| sums[of])
    };
    let part = |part: usize| estimate(&sums, &|sums| ratio(sums[part], sums[ASKED]));
    let count = |of: usize| sums.iter().map(|sums| sums[of]).sum::<f64>() as usize;
    GospaSummary {
        cutoff_px: CUTOFF_PX,
        photographs: count(PHOTOGRAPHS),
        asked: count(ASKED),
        per_corner_px: root(ASKED),
        per_photograph_px: root(PHOTOGRAPHS),
        localisation_px2: part(LOCALISATION),
        missed_px2: part(MISSED),
        false_px2: part(FALSE),
    }
}

fn ratio(part: f64, whole: f64) -> Option<f64> {
    (whole > 0.0).then(|| part / whole)
}

/// The root of the ratio of two sums over scenes; its interval is that of the logarithm. Nothing of nothing.
pub(super) fn root_mean<const K: usize>(
    scenes: &[[f64; K]],
    square: &dyn Fn(&[f64; K]) -> f64,
    count: &dyn Fn(&[f64; K]) -> f64,
) -> Option<Estimate> {
    let of_log = estimate(scenes, &|sums| log(ratio(square(sums), count(sums))));
    let is_exact = scenes.iter().any(|sums| count(sums) > 0.0);
    let exact = is_exact.then_some(Estimate { value: 0.0, low: None, high: None });
    of_log.map(|of_log| of_log.map(|log| (0.5 * log).exp())).or(exact)
}

/// Right answers within a gate: an answer farther from its corner is a missed corner and a false answer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Gate {
    /// How near an answer must be \[px\].
    pub gate_px: f64,
    /// Area under the curve of precision over recall, as steps.
    pub average_precision: f64,
    /// Where the harmonic mean of precision and recall is largest.
    pub best: Option<OperatingPoint>,
}

/// Right answers within each gate up to the plan's: `answers` are the scores of all that are right or wrong within
/// that, `pairs` the score and the corner's record of those that belong to a corner asked for.
pub(super) fn gates(
    answers: &[f64],
    pairs: &[(f64, &Record)],
    asked: usize,
    most_px: f64,
) -> Vec<Gate> {
    let of_gate = |gate_px: f64| {
        let is_near =
            |record: &Record| distance_px(record).is_some_and(|distance| distance <= gate_px);
        let right = pairs.iter().filter(|(_, record)| is_near(record)).map(|(score, _)| *score);
        let curve = precision_recall(answers, &right.collect::<Vec<_>>(), asked);
        Gate {
            gate_px,
            average_precision: average_precision(&curve),
            best: OperatingPoint::best(&curve),
        }
    };
    GATES_PX.into_iter().filter(|gate_px| *gate_px <= most_px).map(of_gate).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(scene: &str, kind: &str, status: &str, error_px: Option<f64>) -> Record {
        Record {
            scene: scene.into(),
            exposure: Some(0),
            track: track::END_TO_END.into(),
            kind: kind.into(),
            status: status.into(),
            refine_status: error_px.map(|_| "ok".into()),
            refined_error_px: error_px,
            detected_error_px: error_px.map(|_| 2.0),
            ..Record::default()
        }
    }

    fn near(found: Option<Estimate>, wanted: f64) {
        let found = found.expect("a number").value;
        assert!((found - wanted).abs() < 1e-12, "{found}, not {wanted}");
    }

    #[test]
    fn near_missed_and_false_ones_by_hand() {
        let rows = [
            row("a", kind::CORNER, status::OK, Some(1.0)),
            row("a", kind::CORNER, status::MISSED, None),
            row("a", kind::FALSE_CORNER, status::FALSE, None),
            row("a", kind::FALSE_CORNER, status::IGNORED, None),
            row("a", kind::CORNER, status::HIDDEN, None),
            // As far as the cutoff: missed and false.
            row("b", kind::CORNER, status::OK, Some(3.0)),
            // Declined: the detector's position counts.
            Record {
                refine_status: Some("diverged".into()),
                ..row("b", kind::CORNER, status::OK, Some(9.0))
            },
        ];
        let summary = summarise(&rows.iter().collect::<Vec<_>>(), |_| true);
        assert_eq!((summary.photographs, summary.asked), (2, 4));
        near(summary.localisation_px2, (1.0 + 4.0) / 4.0);
        near(summary.missed_px2, 9.0 / 4.0);
        near(summary.false_px2, 9.0 / 4.0);
        near(summary.per_corner_px, (23.0_f64 / 4.0).sqrt());
        near(summary.per_photograph_px, (23.0_f64 / 2.0).sqrt());
    }

    #[test]
    fn to_decline_a_given_corner_is_to_lose_it() {
        let given = |refine_status: &str| Record {
            track: track::REFINEMENT.into(),
            refine_status: Some(refine_status.into()),
            ..row("a", kind::CORNER, status::OK, Some(0.1))
        };
        near(summarise(&[&given("singular")], |_| true).per_corner_px, CUTOFF_PX);
        near(summarise(&[&given("ok")], |_| true).per_corner_px, 0.1);
    }

    #[test]
    fn what_a_program_did_not_answer_is_missed_where_the_detectors_position_would_count() {
        let found = |refine_status: &str| Record {
            refine_status: Some(refine_status.into()),
            ..row("a", kind::CORNER, status::OK, Some(2.0))
        };
        near(summarise(&[&found("singular")], |_| true).per_corner_px, 2.0);
        let lost = summarise(&[&found("failed")], |_| true).per_corner_px;
        assert!(lost.expect("a number").value >= CUTOFF_PX);
    }

    #[test]
    fn nothing_asked_has_no_number_and_no_error_is_zero() {
        assert_eq!(summarise(&[], |_| true).per_corner_px, None);
        let wrong = row("a", kind::FALSE_CORNER, status::FALSE, None);
        assert_eq!(summarise(&[&wrong], |_| true).per_corner_px, None);
        near(summarise(&[&wrong], |_| true).per_photograph_px, 4.5_f64.sqrt());
        let exact = row("a", kind::CORNER, status::OK, Some(0.0));
        near(summarise(&[&exact], |_| true).per_corner_px, 0.0);
        near(summarise(&[&exact, &wrong], |_| false).per_corner_px, 4.5_f64.sqrt());
    }

    #[test]
    fn a_wider_gate_lets_more_through() {
        let found = [0.2, 0.8].map(|px| row("a", kind::CORNER, status::OK, Some(px)));
        let pairs = [(9.0, &found[0]), (5.0, &found[1])];
        // A wrong answer lies between them; three were asked for.
        let gates = gates(&[9.0, 7.0, 5.0], &pairs, 3, 2.0);
        let values: Vec<(f64, f64)> =
            gates.iter().map(|gate| (gate.gate_px, gate.average_precision)).collect();
        let (one, two) = (1.0 / 3.0, 1.0 / 3.0 + 2.0 / 9.0);
        assert_eq!(values.len(), 4);
        for ((gate_px, found), wanted) in values.into_iter().zip([one, one, two, two]) {
            assert!((found - wanted).abs() < 1e-12, "{gate_px}: {found}, not {wanted}");
        }
        assert!((gates[0].best.expect("a point").precision - 1.0).abs() < 1e-12);
    }
}
