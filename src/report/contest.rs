//! Records -> which of several methods is better, and whether that is certain.
//!
//! Methods are compared on the same photographs, the unit being the scene: its logarithm of the root mean square error
//! over the corners that both answered.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::report::refinement::{Answer, Estimate, Key, Refined};
use crate::report::summary::MethodSummary;
use crate::stats::{Bootstrap, critical_difference, friedman, groups, holm, sign_flips};

/// Methods that were given the same: of one camera, one track, seeds of one disc.
#[derive(Clone, Debug, Serialize)]
pub struct Contest {
    /// The camera.
    pub camera: String,
    /// What is judged, as records have it.
    pub track: String,
    /// The disc of the seeds, if they were given \[px\].
    pub seed_disc_px: Option<f64>,
    /// Who takes part, the best first: by the error on the corners that all of them answered.
    pub methods: Vec<Contestant>,
    /// Who answered less than half of what was asked for, and is not compared.
    pub left_out: Vec<String>,
    /// Corners that all who take part answered.
    pub corners: usize,
    /// Scenes with such corners.
    pub scenes: usize,
    /// How often ranks differ as much where all methods are equally good (Friedman; Iman & Davenport).
    pub p_of_ranks: Option<f64>,
    /// Mean ranks farther apart than this differ (Nemenyi, 5 %).
    pub critical_difference: Option<f64>,
    /// Methods that cannot be told apart by their ranks.
    pub alike: Vec<Vec<String>>,
    /// What a reader must know.
    pub warning: Option<String>,
}

/// A method in a contest.
#[derive(Clone, Debug, Serialize)]
pub struct Contestant {
    /// Its name.
    pub method: String,
    /// On the corners that all answered.
    pub common: Refined,
    /// Its error over that of the best, by the scenes in which both answered: the geometric mean.
    pub over_best: Option<Estimate>,
    /// How often that is as far from 1 where both are equally good, by random signs, after Holm's correction.
    pub p: Option<f64>,
    /// Its mean rank over the scenes, 1 being the best.
    pub mean_rank: Option<f64>,
}

/// With fewer scenes intervals cover less than they say.
const ENOUGH_SCENES: usize = 20;

/// A method and what it answered for the corners that it was given.
type Given<'a> = (&'a MethodSummary, &'a [Answer]);

/// Answers by corner.
pub(super) type Answers<'a> = BTreeMap<Key<'a>, &'a Answer>;

/// Compares methods that were given the same, each with its answers; nothing where there are not two of them.
pub fn contests(methods: &[MethodSummary], answers: &[Vec<Answer>]) -> Vec<Contest> {
    let mut found: Vec<(String, Vec<Given>)> = Vec::new();
    for (method, answers) in methods.iter().zip(answers).filter(|(_, answers)| !answers.is_empty())
    {
        let name = format!("{} {} {:?}", method.camera, method.track, method.seed_disc_px);
        match found.iter_mut().find(|(other, _)| *other == name) {
            Some((_, methods)) => methods.push((method, answers)),
            None => found.push((name, vec![(method, answers)])),
        }
    }
    found.iter().filter_map(|(name, methods)| contest(name, methods)).collect()
}

fn contest(name: &str, all: &[Given]) -> Option<Contest> {
    let takes_part = |(method, _): &&Given| {
        let all = &method.refinement.all;
        2 * all.answered >= all.asked
    };
    let (some, others): (Vec<_>, Vec<_>) = all.iter().partition(takes_part);
    if some.len() < 2 {
        return None;
    }
    let answers: Vec<Answers> = some.iter().map(|(_, answers)| answered(*answers)).collect();
    let is_common = |key: &&Key| answers.iter().all(|answers| answers.contains_key(*key));
    let common: Vec<Key> = answers[0].keys().filter(is_common).copied().collect();
    let mut methods: Vec<(Contestant, &Answers)> = some
        .iter()
        .zip(&answers)
        .map(|((method, _), answers)| {
            let contestant = Contestant {
                method: method.method.clone(),
                common: Refined::of(common.iter().map(|key| answers[key])),
                over_best: None,
                p: None,
                mean_rank: None,
            };
            (contestant, answers)
        })
        .collect();
    let error = |contestant: &Contestant| {
        contestant.common.rmse_px.map_or(f64::INFINITY, |estimate| estimate.value)
    };
    methods.sort_by(|a, b| error(&a.0).total_cmp(&error(&b.0)));

    let best = methods[0].1;
    let mut p_values = Vec::new();
    for (contestant, answers) in &mut methods[1..] {
        let (over_best, p) = compared(best, answers, &[name, &contestant.method]);
        contestant.over_best = over_best;
        contestant.p = p;
        p_values.push(p.unwrap_or(1.0));
    }
    for ((contestant, _), p) in methods[1..].iter_mut().zip(holm(&p_values)) {
        contestant.p = contestant.p.map(|_| p);
    }

    // Of each scene the errors of all, on the corners that all answered.
    let mut of_scenes: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    let scenes: Vec<BTreeMap<&str, f64>> =
        methods.iter().map(|(_, answers)| errors(common.iter().map(|key| answers[key]))).collect();
    for scene in scenes[0].keys() {
        of_scenes.insert(scene, scenes.iter().map(|errors| errors[scene]).collect());
    }
    let table: Vec<Vec<f64>> = of_scenes.into_values().collect();
    let ranks = friedman(&table);
    let difference = critical_difference(methods.len(), table.len(), 0.05);
    let mut alike = Vec::new();
    if let (Some(ranks), Some(difference)) = (&ranks, difference) {
        for ((contestant, _), rank) in methods.iter_mut().zip(&ranks.mean_ranks) {
            contestant.mean_rank = Some(*rank);
        }
        let name = |index: usize| methods[index].0.method.clone();
        let groups = groups(&ranks.mean_ranks, difference).into_iter();
        alike = groups.map(|group| group.into_iter().map(name).collect()).collect();
    }
    let first = &all[0];
    Some(Contest {
        camera: first.0.camera.clone(),
        track: first.0.track.clone(),
        seed_disc_px: first.0.seed_disc_px,
        methods: methods.into_iter().map(|(contestant, _)| contestant).collect(),
        left_out: others.iter().map(|(method, _)| method.method.clone()).collect(),
        corners: common.len(),
        scenes: table.len(),
        p_of_ranks: ranks.map(|ranks| ranks.p),
        critical_difference: difference,
        alike,
        warning: warning(table.len()),
    })
}

/// What few scenes cannot say.
pub(super) fn warning(scenes: usize) -> Option<String> {
    (scenes < ENOUGH_SCENES).then(|| {
        format!(
            "{scenes} scenes: too few for intervals that hold 95 % and for small p; {ENOUGH_SCENES} or \
             more say something"
        )
    })
}

/// The answers that were not declined.
pub(super) fn answered<'a>(answers: impl IntoIterator<Item = &'a Answer>) -> Answers<'a> {
    let answered = answers.into_iter().filter(|answer| answer.error_px.is_some());
    answered.map(|answer| (answer.key(), answer)).collect()
}

/// Of each scene the logarithm of the root mean square error.
fn errors<'a>(answers: impl Iterator<Item = &'a Answer>) -> BTreeMap<&'a str, f64> {
    // An error of exactly 0 has no logarithm; none is known to less.
    const LEAST_PX: f64 = 1e-6;
    let mut sums: BTreeMap<&str, (f64, f64)> = BTreeMap::new();
    for answer in answers {
        let sum = sums.entry(&answer.scene).or_default();
        let error_px = answer.error_px.unwrap_or(f64::INFINITY);
        *sum = (sum.0 + error_px * error_px, sum.1 + 1.0);
    }
    let log = |(square, count): (f64, f64)| (square / count).sqrt().max(LEAST_PX).ln();
    sums.into_iter().map(|(scene, sum)| (scene, log(sum))).collect()
}

/// How many times as large the second's error is as the first's, scene by scene on what both answered, and how often
/// it is as far from 1 by chance.
pub(super) fn compared(
    first: &Answers,
    second: &Answers,
    name: &[&str],
) -> (Option<Estimate>, Option<f64>) {
    fn both<'a>(of: &Answers<'a>, with: &Answers) -> BTreeMap<&'a str, f64> {
        errors(of.iter().filter(|(key, _)| with.contains_key(*key)).map(|(_, answer)| *answer))
    }
    let (first, second) = (both(first, second), both(second, first));
    let differences: Vec<f64> = second.iter().map(|(scene, log)| log - first[scene]).collect();
    let Some(test) = sign_flips(&differences, name) else { return (None, None) };
    let rows: Vec<[f64; 2]> = differences.iter().map(|difference| [*difference, 1.0]).collect();
    let mean = |[sum, count]: &[f64; 2]| (*count > 0.0).then(|| sum / count);
    let interval = Bootstrap::named(name).of_sums(&rows, mean).ok();
    (Some(Estimate::of(test.mean, interval).map(f64::exp)), Some(test.p))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Record, kind, status, track};
    use crate::report::summary::summarise;

    fn row(method: &str, scene: u8, corner: u8, error_px: f64) -> Record {
        Record {
            scene: format!("{scene:02}"),
            camera: "ideal".into(),
            exposure: Some(0),
            method: method.into(),
            track: track::REFINEMENT.into(),
            seed_disc_px: Some(1.0),
            kind: kind::CORNER.into(),
            status: status::OK.into(),
            corner_index: Some(corner.into()),
            refine_status: Some(if error_px < 5.0 { "ok" } else { "diverged" }.into()),
            refined_error_px: Some(error_px),
            ..Record::default()
        }
    }

    /// Three methods on 30 scenes: `b` is twice as far off as `a`, `c` as far as `a` but for chance.
    fn rows() -> Vec<Record> {
        let mut rows = Vec::new();
        for (name, factor) in [("b", 2.0), ("a", 1.0), ("c", 1.0)] {
            for scene in 0..30 {
                for corner in 0..4 {
                    let hard = 0.05 * (1.0 + f64::from(scene % 7));
                    let chance = 1.0 + 0.1 * (f64::from((scene * 7 + corner * 3) % 5) - 2.0);
                    let chance = if name == "c" { 2.0 - chance } else { chance };
                    rows.push(row(name, scene, corner, hard * factor * chance));
                }
            }
        }
        rows
    }

    #[test]
    fn who_is_better_is_found_with_its_ratio_and_chance_is_not() {
        let rows = rows();
        let contests = summarise(&rows, 5.0).contests;
        assert_eq!(contests.len(), 1);
        let contest = &contests[0];
        assert_eq!((contest.corners, contest.scenes), (120, 30));
        let of = |name: &str| {
            contest.methods.iter().find(|method| method.method == name).expect("it takes part")
        };
        let Estimate { value, low, high } = of("b").over_best.expect("a ratio");
        assert!((value - 2.0).abs() < 0.2, "{value}");
        assert!(low.expect("an end") < value && value < high.expect("an end"));
        assert!(of("b").p.expect("p") < 0.001);
        let chance = if contest.methods[0].method == "a" { "c" } else { "a" };
        assert!(of(chance).p.expect("p") > 0.05, "{:?}", of(chance));
        assert_eq!(contest.methods[2].method, "b");
        let mut alike = contest.alike.clone();
        alike.iter_mut().for_each(|group| group.sort());
        assert_eq!(alike, [["a", "c"]]);
        assert_eq!(contest.warning, None);
    }

    #[test]
    fn what_one_declined_counts_for_none_and_who_answers_little_is_left_out() {
        let mut rows = rows();
        for record in &mut rows {
            let is_hard = record.scene == "03" && record.method == "a";
            if is_hard || (record.method == "c" && record.scene.as_str() < "20") {
                record.refine_status = Some("diverged".into());
            }
        }
        let contest = &summarise(&rows, 5.0).contests[0];
        assert_eq!((contest.corners, contest.scenes), (116, 29));
        assert_eq!(contest.left_out, ["c"]);
    }

    #[test]
    fn few_scenes_are_warned_of() {
        let rows: Vec<Record> = rows().into_iter().filter(|r| r.scene.as_str() < "05").collect();
        let warning = summarise(&rows, 5.0).contests[0].warning.clone().expect("five scenes");
        assert!(warning.starts_with("5 scenes: too few"), "{warning}");
    }
}
