//! Records -> precision and recall over thresholds, and what answers were where no corner is.
//!
//! Nothing runs again: each answer's response is in its row, and each corner's row has the largest
//! threshold with which it is found.

use std::collections::{BTreeMap, HashMap};

use serde::Serialize;

use crate::record::{Record, kind, status};
use crate::report::gospa::{self, Gate, GospaSummary};
use crate::stats::{OperatingPoint, average_precision, mean, precision_recall};

/// How well a method tells corners from the rest.
#[derive(Clone, Debug, Serialize)]
pub struct DetectionSummary {
    /// Corners asked for.
    pub asked: usize,
    /// Answers, those at corners not asked for left out.
    pub answers: usize,
    /// One for each way to choose a threshold.
    pub sweeps: Vec<Sweep>,
    /// Recall by what corners look like.
    pub recall_by: Vec<Strata>,
    /// Answers where no corner asked for is, and false junctions, by their cause.
    pub causes: Vec<Cause>,
    /// Near, missed and false ones in one number, of all answers.
    pub gospa: GospaSummary,
    /// The same of the answers that pass the best share of the strongest.
    pub gospa_at_best: GospaSummary,
    /// Right answers by how near they are; of a threshold on the share of the strongest.
    pub gates: Vec<Gate>,
    /// The mean of the gates' average precision; none where the plan's gate is narrower than all.
    pub mean_average_precision: Option<f64>,
}

/// How a threshold is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Rule {
    /// On the response itself.
    Response,
    /// On the response as a share of the strongest one of its exposure.
    ShareOfStrongest,
    /// On the answer's place among those of its exposure, the strongest being the first; as a negative
    /// number, so that more passes a lower threshold here, too.
    Place,
}

/// Precision and recall over a threshold.
#[derive(Clone, Debug, Serialize)]
pub struct Sweep {
    /// How the threshold is chosen.
    pub rule: Rule,
    /// Area under the curve, as steps.
    pub average_precision: f64,
    /// Where the harmonic mean of precision and recall is largest.
    pub best: Option<OperatingPoint>,
    /// The curve, the highest threshold first; long ones thinned out.
    pub curve: Vec<OperatingPoint>,
}

/// Recall by one property of corners.
#[derive(Clone, Debug, Serialize)]
pub struct Strata {
    /// The property.
    pub by: &'static str,
    /// Its values, those without a corner left out.
    pub strata: Vec<Stratum>,
}

/// Corners that are alike.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Stratum {
    /// What they are.
    pub name: String,
    /// How many were asked for.
    pub asked: usize,
    /// How many were found among all answers.
    pub found: usize,
    /// How many at the best share of the strongest.
    pub found_at_best: usize,
}

/// Answers where no corner asked for is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cause {
    /// Where they lie.
    pub cause: String,
    /// How many.
    pub answers: usize,
    /// How many at the best share of the strongest.
    pub answers_at_best: usize,
    /// False junctions of this cause.
    pub junctions: usize,
    /// How many of them have an answer.
    pub answered: usize,
    /// How many at the best share of the strongest.
    pub answered_at_best: usize,
}

/// Bounds of strata: each holds what is less than its bound.
const ANGLES_DEG: [(f64, &str); 5] = [
    (60.0, "below 60\u{b0}"),
    (90.0, "60 to 90\u{b0}"),
    (120.0, "90 to 120\u{b0}"),
    (150.0, "120 to 150\u{b0}"),
    (f64::INFINITY, "150\u{b0} and more"),
];
const CONTRASTS: [(f64, &str); 4] = [
    (0.05, "below 5 %"),
    (0.1, "5 to 10 %"),
    (0.2, "10 to 20 %"),
    (f64::INFINITY, "20 % and more"),
];
const OCCLUDERS_PX: [(f64, &str); 3] =
    [(5.0, "below 5 px"), (20.0, "5 to 20 px"), (f64::INFINITY, "20 to 64 px")];

/// Points of a curve that are kept.
const MOST_POINTS: usize = 200;

/// Summarises the records of one method, whose answers were matched within `gate_px`.
pub fn summarise(records: &[&Record], gate_px: f64) -> DetectionSummary {
    let method = Method::new(records);
    let gates = method.gates(gate_px);
    let precisions: Vec<f64> = gates.iter().map(|gate| gate.average_precision).collect();
    let rules = [Rule::ShareOfStrongest, Rule::Response, Rule::Place];
    let sweeps = rules.map(|rule| method.sweep(rule));
    let best = sweeps[0].best.map(|point| point.threshold);
    DetectionSummary {
        asked: method.corners().count(),
        answers: method.answers().count(),
        recall_by: method.recall_by(best),
        causes: method.causes(best),
        sweeps: sweeps.into(),
        gospa: gospa::summarise(records, |_| true),
        gospa_at_best: gospa::summarise(records, |r| method.passes(r, r.response, best)),
        gates,
        mean_average_precision: mean(&precisions),
    }
}

/// The records of one method.
struct Method<'a> {
    records: &'a [&'a Record],
    /// The responses in each exposure, the strongest first.
    responses: HashMap<&'a str, Vec<f64>>,
}

impl<'a> Method<'a> {
    fn new(records: &'a [&'a Record]) -> Self {
        let mut responses: HashMap<&str, Vec<f64>> = HashMap::new();
        for record in records.iter().filter(|record| record.kind != kind::FALSE_JUNCTION) {
            responses.entry(&record.scene).or_default().extend(record.response);
        }
        for of_exposure in responses.values_mut() {
            of_exposure.sort_by(|a, b| b.total_cmp(a));
        }
        Self { records, responses }
    }

    /// The rows of corners asked for.
    fn corners(&self) -> impl Iterator<Item = &'a Record> {
        let is_asked = |status: &str| status == status::OK || status == status::MISSED;
        self.of_kind(kind::CORNER).filter(move |record| is_asked(&record.status))
    }

    /// The rows of answers that are right or wrong.
    fn answers(&self) -> impl Iterator<Item = &'a Record> {
        let right = self.of_kind(kind::CORNER).filter(|record| record.status == status::OK);
        right.chain(self.wrong())
    }

    /// The rows of answers that are wrong.
    fn wrong(&self) -> impl Iterator<Item = &'a Record> {
        self.of_kind(kind::FALSE_CORNER).filter(|record| record.status == status::FALSE)
    }

    fn of_kind(&self, kind: &'static str) -> impl Iterator<Item = &'a Record> {
        self.records.iter().copied().filter(move |record| record.kind == kind)
    }

    /// A response in a record's exposure on the scale of a rule.
    #[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
    fn score(&self, rule: Rule, record: &Record, response: f64) -> f64 {
        let all = self.responses.get(record.scene.as_str()).map_or(&[][..], Vec::as_slice);
        match (rule, all.first()) {
            (Rule::Response, _) => response,
            (Rule::ShareOfStrongest, Some(strongest)) if *strongest > 0.0 => response / strongest,
            (Rule::ShareOfStrongest, _) => 0.0,
            (Rule::Place, _) => -1.0 - all.partition_point(|other| *other > response) as f64,
        }
    }

    fn sweep(&self, rule: Rule) -> Sweep {
        let answers: Vec<f64> = self
            .answers()
            .filter_map(|record| Some(self.score(rule, record, record.response?)))
            .collect();
        let right: Vec<f64> = self
            .corners()
            .filter_map(|record| Some(self.score(rule, record, record.found_at_response?)))
            .collect();
        let curve = precision_recall(&answers, &right, self.corners().count());
        Sweep {
            rule,
            average_precision: average_precision(&curve),
            best: OperatingPoint::best(&curve),
            curve: thinned(&curve),
        }
    }

    /// Right answers by how near they are, where answers are of a threshold on the share of the strongest.
    fn gates(&self, gate_px: f64) -> Vec<Gate> {
        let score =
            |record: &Record| Some(self.score(Rule::ShareOfStrongest, record, record.response?));
        let answers: Vec<f64> = self.answers().filter_map(score).collect();
        let pairs: Vec<(f64, &Record)> = self
            .corners()
            .filter(|record| record.status == status::OK)
            .filter_map(|record| Some((score(record)?, record)))
            .collect();
        gospa::gates(&answers, &pairs, self.corners().count(), gate_px)
    }

    /// Whether a response passes a threshold on the share of the strongest.
    fn passes(&self, record: &Record, response: Option<f64>, threshold: Option<f64>) -> bool {
        let score = |response| self.score(Rule::ShareOfStrongest, record, response);
        matches!((response.map(score), threshold), (Some(score), Some(least)) if score >= least)
    }

    fn recall_by(&self, best: Option<f64>) -> Vec<Strata> {
        let bin = |value: Option<f64>, bounds: &[(f64, &str)], nothing: &str| {
            let below = |value| bounds.iter().find(move |(bound, _)| value < *bound);
            value.and_then(below).map_or_else(|| nothing.to_owned(), |(_, name)| (*name).to_owned())
        };
        let junction =
            |record: &Record| record.junction.clone().unwrap_or_else(|| "not told".to_owned());
        vec![
            self.strata("junction", &["L", "Y", "arrow", "X", "edge end"], &junction, best),
            self.strata(
                "angle",
                &names(&ANGLES_DEG),
                &|r| bin(r.junction_angle_deg, &ANGLES_DEG, "one edge"),
                best,
            ),
            self.strata(
                "contrast",
                &names(&CONTRASTS),
                &|r| bin(r.contrast_fraction, &CONTRASTS, "not known"),
                best,
            ),
            self.strata(
                "nearest occluder",
                &names(&OCCLUDERS_PX),
                &|r| bin(r.nearest_occluder_px, &OCCLUDERS_PX, "none within 64 px"),
                best,
            ),
        ]
    }

    /// Corners that are alike in what `name_of` tells; those of `order` first.
    fn strata(
        &self,
        by: &'static str,
        order: &[&str],
        name_of: &dyn Fn(&Record) -> String,
        best: Option<f64>,
    ) -> Strata {
        let empty = |name: String| Stratum { name, asked: 0, found: 0, found_at_best: 0 };
        let mut strata: Vec<_> = order.iter().map(|name| empty((*name).to_owned())).collect();
        for record in self.corners() {
            let name = name_of(record);
            let index = strata.iter().position(|one| one.name == name).unwrap_or_else(|| {
                strata.push(empty(name));
                strata.len() - 1
            });
            let stratum = &mut strata[index];
            stratum.asked += 1;
            stratum.found += usize::from(record.found_at_response.is_some());
            stratum.found_at_best +=
                usize::from(self.passes(record, record.found_at_response, best));
        }
        strata.retain(|stratum| stratum.asked > 0);
        Strata { by, strata }
    }

    /// Those with most answers first, equals by name.
    fn causes(&self, best: Option<f64>) -> Vec<Cause> {
        let mut causes: BTreeMap<&str, Cause> = BTreeMap::new();
        for record in self.wrong().chain(self.of_kind(kind::FALSE_JUNCTION)) {
            let name = record.cause.as_deref().unwrap_or_default();
            let cause = causes.entry(name).or_insert_with(|| Cause {
                cause: name.to_owned(),
                answers: 0,
                answers_at_best: 0,
                junctions: 0,
                answered: 0,
                answered_at_best: 0,
            });
            let passes = usize::from(self.passes(record, record.response, best));
            if record.kind == kind::FALSE_JUNCTION {
                cause.junctions += 1;
                cause.answered += usize::from(record.status == status::ANSWERED);
                cause.answered_at_best += passes;
            } else {
                cause.answers += 1;
                cause.answers_at_best += passes;
            }
        }
        let mut causes: Vec<Cause> = causes.into_values().collect();
        causes.sort_by_key(|cause| std::cmp::Reverse(cause.answers));
        causes
    }
}

fn names<'a>(bounds: &[(f64, &'a str)]) -> Vec<&'a str> {
    bounds.iter().map(|(_, name)| *name).collect()
}

/// At most [`MOST_POINTS`] of a curve, evenly spread over its steps, the first and the last among them.
fn thinned(curve: &[OperatingPoint]) -> Vec<OperatingPoint> {
    if curve.len() <= MOST_POINTS {
        return curve.to_vec();
    }
    let last = curve.len() - 1;
    (0..MOST_POINTS).map(|index| curve[index * last / (MOST_POINTS - 1)]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(scene: &str, junction: &str, found_at: Option<f64>) -> Record {
        Record {
            scene: scene.into(),
            kind: kind::CORNER.into(),
            status: if found_at.is_some() { status::OK } else { status::MISSED }.into(),
            junction: Some(junction.into()),
            response: found_at,
            found_at_response: found_at,
            ..Record::default()
        }
    }

    fn wrong(scene: &str, cause: &str, response: f64) -> Record {
        Record {
            scene: scene.into(),
            kind: kind::FALSE_CORNER.into(),
            status: status::FALSE.into(),
            cause: Some(cause.into()),
            response: Some(response),
            ..Record::default()
        }
    }

    /// Two exposures, one ten times as bright: two corners found of three, three answers wrong.
    fn rows() -> Vec<Record> {
        let junction = |response: Option<f64>| Record {
            kind: kind::FALSE_JUNCTION.into(),
            status: if response.is_some() { status::ANSWERED } else { status::SILENT }.into(),
            ..wrong("dim", "T", response.unwrap_or(f64::NAN))
        };
        vec![
            corner("dim", "L", Some(1.0)),
            corner("dim", "Y", None),
            wrong("dim", "T", 0.5),
            corner("bright", "L", Some(8.0)),
            wrong("bright", "T", 10.0),
            wrong("bright", "edge", 2.0),
            Record { status: status::IGNORED.into(), ..wrong("dim", "hidden corner", 0.9) },
            Record { status: status::HIDDEN.into(), ..corner("dim", "L", None) },
            junction(Some(0.5)),
            Record { response: None, ..junction(None) },
        ]
    }

    fn summary() -> DetectionSummary {
        let rows = rows();
        summarise(&rows.iter().collect::<Vec<_>>(), 5.0)
    }

    #[test]
    fn ignored_answers_and_corners_not_asked_for_do_not_count() {
        let summary = summary();
        assert_eq!((summary.asked, summary.answers), (3, 5));
    }

    #[test]
    fn each_rule_sorts_answers_by_its_own_scale() {
        let points = |rule| {
            let sweep = summary().sweeps.into_iter().find(|sweep| sweep.rule == rule);
            let curve = sweep.expect("the rule").curve;
            curve.iter().map(|p| (p.threshold, p.precision)).collect::<Vec<_>>()
        };
        assert_eq!(
            points(Rule::Response),
            [(10.0, 0.0), (8.0, 0.5), (2.0, 1.0 / 3.0), (1.0, 0.5), (0.5, 0.4)]
        );
        assert_eq!(
            points(Rule::ShareOfStrongest),
            [(1.0, 0.5), (0.8, 2.0 / 3.0), (0.5, 0.5), (0.2, 0.4)]
        );
        // The strongest of each exposure, the two strongest, the three strongest; the ignored one has
        // a place, too.
        assert_eq!(points(Rule::Place), [(-1.0, 0.5), (-2.0, 2.0 / 3.0), (-3.0, 0.4)]);
    }

    #[test]
    fn recall_and_causes_count_what_passes_the_best_threshold() {
        let summary = summary();
        let best = summary.sweeps[0].best.expect("answers");
        assert_eq!((best.threshold, best.recall), (0.8, 2.0 / 3.0));
        let stratum = |name: &str, asked, found| Stratum {
            name: name.into(),
            asked,
            found,
            found_at_best: found,
        };
        assert_eq!(summary.recall_by[0].strata, [stratum("L", 2, 2), stratum("Y", 1, 0)]);
        let t = &summary.causes[0];
        assert_eq!((t.cause.as_str(), t.answers, t.answers_at_best), ("T", 2, 1));
        assert_eq!((t.junctions, t.answered, t.answered_at_best), (2, 1, 0));
        assert_eq!(summary.causes.len(), 2, "those of ignored answers are none");
    }

    #[test]
    fn a_thinned_curve_keeps_its_ends() {
        let point = |threshold| OperatingPoint { threshold, precision: 1.0, recall: 0.0 };
        let curve: Vec<_> = (0..5000).map(|index| point(-f64::from(index))).collect();
        let thin = thinned(&curve);
        assert_eq!(
            (thin.len(), thin[0], thin[MOST_POINTS - 1]),
            (MOST_POINTS, curve[0], curve[4999])
        );
    }
}
