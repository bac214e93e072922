//! Two runs -> what became better, what worse, and whether that is certain.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::Serialize;

use crate::error::{Error, Result};
use crate::record::{RunDescription, read_run};
use crate::report::contest::{Answers, answered, compared, warning};
use crate::report::records::RunRecords;
use crate::report::refinement::{Answer, Estimate, Key, answers};
use crate::stats::{Bootstrap, holm, sign_flips};

/// The methods of two runs beside each other.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Those that both have.
    pub methods: Vec<Compared>,
    /// Those that only one of them has.
    pub only_in_first: Vec<String>,
    /// Those that only one of them has.
    pub only_in_second: Vec<String>,
    /// Scenes that both have.
    pub scenes: usize,
    /// What a reader must know.
    pub warning: Option<String>,
}

/// A method in two runs: on the same corners of the same photographs.
#[derive(Clone, Debug, Serialize)]
pub struct Compared {
    /// The camera.
    pub camera: String,
    /// The method.
    pub method: String,
    /// Corners that both were given.
    pub corners: usize,
    /// The second run's error over the first's, by the scenes in which both answered: the geometric mean.
    pub error_ratio: Option<Estimate>,
    /// How often that is as far from 1 by chance, by random signs, after Holm's correction.
    pub p_of_error: Option<f64>,
    /// Share of corners that were declined or are more than 1 px off, second less first, the mean over scenes.
    pub failed_more: Option<Estimate>,
    /// How often that is as far from 0 by chance, after Holm's correction.
    pub p_of_failed: Option<f64>,
    /// Photographs more to which another program gave no answer: whatever else became better, that is worse.
    pub unanswered_more: i64,
    /// What that comes to.
    pub verdict: Verdict,
}

/// What became of a method.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every answer is the same.
    Same,
    /// Answers differ, but no more than by chance.
    NotToldApart,
    /// Errors or failures are fewer, and neither is more.
    Better,
    /// Errors or failures are more.
    Worse,
}

impl Verdict {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Same => "the same",
            Self::NotToldApart => "not told apart",
            Self::Better => "better",
            Self::Worse => "worse",
        }
    }
}

/// What is more than chance.
const SIGNIFICANT: f64 = 0.05;

/// A run as it is compared with another: what its methods answered for the corners that they were given.
pub struct Answered {
    run: RunDescription,
    methods: Methods,
}

/// Answers by camera and method.
type Methods = BTreeMap<(String, String), Vec<Answer>>;

impl Answered {
    /// Reads it.
    ///
    /// # Errors
    /// When the run's files are missing or cannot be read.
    pub fn read(folder: &Path) -> Result<Self> {
        let run = read_run(folder)?;
        let mut methods = Methods::new();
        RunRecords::open(&folder.join("records.parquet"))?.for_each_method(|rows| {
            let answers = answers(rows);
            if let Some(first) = rows.first().filter(|_| !answers.is_empty()) {
                methods.insert((first.camera.clone(), first.method.clone()), answers);
            }
            Ok(())
        })?;
        Ok(Self { run, methods })
    }
}

/// Compares two runs, method by method.
///
/// # Errors
/// When they are of different suites, or share no method or no scene.
pub fn compare(first: &Answered, second: &Answered) -> Result<Comparison> {
    if first.run.suite != second.run.suite {
        return Err(Error::Other(format!(
            "compare: the first run is of suite {}, the second of {}; only runs of the same scenes can be \
             compared",
            first.run.suite, second.run.suite
        )));
    }
    let (first_run, second_run) = (first, second);
    let (of_first, of_second) = (&first.methods, &second.methods);
    let label = |(camera, method): &(String, String)| format!("{method}, {camera}");
    let only = |of: &Methods, other: &Methods| {
        of.keys().filter(|name| !other.contains_key(*name)).map(label).collect::<Vec<_>>()
    };
    let (only_in_first, only_in_second) = (only(of_first, of_second), only(of_second, of_first));
    let mut scenes = BTreeSet::new();
    let mut methods = Vec::new();
    for (name, first) in of_first {
        let Some(second) = of_second.get(name) else { continue };
        let (first, second) = (by_corner(first), by_corner(second));
        let both = first.keys().filter(|key| second.contains_key(*key));
        scenes.extend(both.map(|key| key.0.to_owned()));
        let mut compared = compared_method((&name.0, &name.1), &first, &second);
        let [before, after] = [first_run, second_run]
            .map(|of| i64::try_from(of.run.unanswered(&name.1)).unwrap_or(i64::MAX));
        compared.unanswered_more = after - before;
        if compared.unanswered_more > 0 {
            compared.verdict = Verdict::Worse;
        }
        methods.push(compared);
    }
    if methods.is_empty() || scenes.is_empty() {
        return Err(Error::Other(format!(
            "compare: the runs share no {}; the first has {}, the second {}",
            if methods.is_empty() { "method" } else { "corner" },
            of_first.keys().map(label).collect::<Vec<_>>().join("; "),
            of_second.keys().map(label).collect::<Vec<_>>().join("; "),
        )));
    }
    // What is the same asks no question.
    let mut changed: Vec<&mut Compared> =
        methods.iter_mut().filter(|method| method.verdict != Verdict::Same).collect();
    let p_values: Vec<f64> = changed
        .iter()
        .flat_map(|method| [method.p_of_error.unwrap_or(1.0), method.p_of_failed.unwrap_or(1.0)])
        .collect();
    for (method, p) in changed.iter_mut().zip(holm(&p_values).chunks_exact(2)) {
        method.p_of_error = method.p_of_error.map(|_| p[0]);
        method.p_of_failed = method.p_of_failed.map(|_| p[1]);
        method.judge();
    }
    let warning = warning(scenes.len());
    Ok(Comparison { methods, only_in_first, only_in_second, scenes: scenes.len(), warning })
}

fn by_corner(answers: &[Answer]) -> Answers<'_> {
    answers.iter().map(|answer| (answer.key(), answer)).collect()
}

fn compared_method((camera, method): (&str, &str), first: &Answers, second: &Answers) -> Compared {
    let name = ["compare", camera, method];
    let (before, after) = (answered(first.values().copied()), answered(second.values().copied()));
    let (error_ratio, p_of_error) = compared(&before, &after, &name);
    let common: Vec<(&Key, &Answer, &Answer)> =
        first.iter().filter_map(|(key, answer)| Some((key, *answer, *second.get(key)?))).collect();
    // Of each scene: failures more, of how many.
    let mut scenes: BTreeMap<&str, (f64, f64)> = BTreeMap::new();
    for (key, before, after) in &common {
        let sum = scenes.entry(key.0).or_default();
        sum.0 += f64::from(after.is_failed()) - f64::from(before.is_failed());
        sum.1 += 1.0;
    }
    let more: Vec<f64> = scenes.values().map(|(more, of)| more / of).collect();
    let rows: Vec<[f64; 2]> = more.iter().map(|share| [*share, 1.0]).collect();
    let mean = |[sum, count]: &[f64; 2]| (*count > 0.0).then(|| sum / count);
    let interval = Bootstrap::named(&name).of_sums(&rows, mean).ok();
    let failed = sign_flips(&more, &name);
    let is_same = common.iter().all(|(_, before, after)| before.is_same(after));
    Compared {
        camera: camera.to_owned(),
        method: method.to_owned(),
        corners: common.len(),
        error_ratio,
        p_of_error,
        failed_more: failed.map(|test| Estimate::of(test.mean, interval)),
        p_of_failed: failed.map(|test| test.p),
        unanswered_more: 0,
        verdict: if is_same { Verdict::Same } else { Verdict::NotToldApart },
    }
}

impl Compared {
    /// What it comes to, once chances are corrected for how many there are.
    fn judge(&mut self) {
        let sign = |p: Option<f64>, change: Option<f64>| match (p, change) {
            (Some(p), Some(change)) if p <= SIGNIFICANT => change.partial_cmp(&0.0),
            _ => None,
        };
        let changes = [
            sign(self.p_of_error, self.error_ratio.map(|ratio| ratio.value.ln())),
            sign(self.p_of_failed, self.failed_more.map(|more| more.value)),
        ];
        let is_worse = changes.contains(&Some(Ordering::Greater)) || self.unanswered_more > 0;
        self.verdict = if is_worse {
            Verdict::Worse
        } else if changes.contains(&Some(Ordering::Less)) {
            Verdict::Better
        } else {
            Verdict::NotToldApart
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Record, kind, status};

    /// Thirty scenes of four corners; `off` says how far each answer is off, nothing where it is declined.
    fn rows(method: &str, off: impl Fn(u8, u8) -> Option<f64>) -> Vec<Record> {
        let corner = |scene: u8, corner: u8| {
            let error_px = off(scene, corner);
            Record {
                scene: format!("{scene:02}"),
                camera: "ideal".into(),
                method: method.into(),
                exposure: Some(0),
                kind: kind::CORNER.into(),
                status: status::OK.into(),
                corner_index: Some(corner.into()),
                refine_status: Some(if error_px.is_some() { "ok" } else { "singular" }.into()),
                refined_x_px: error_px,
                refined_error_px: Some(error_px.unwrap_or(2.0)),
                ..Record::default()
            }
        };
        (0..30)
            .flat_map(|scene| (0..4).map(move |index| (scene, index)))
            .map(|(s, c)| corner(s, c))
            .collect()
    }

    fn hard(scene: u8, corner: u8) -> f64 {
        0.05 * (1.0 + f64::from(scene % 7)) + 0.01 * f64::from(corner)
    }

    fn verdict(second: &[Record]) -> Compared {
        let first = rows("a", |scene, corner| Some(hard(scene, corner)));
        let of = |rows: &[Record]| answers(&rows.iter().collect::<Vec<_>>());
        let (first, second) = (of(&first), of(second));
        let mut compared = compared_method(("ideal", "a"), &by_corner(&first), &by_corner(&second));
        if compared.verdict != Verdict::Same {
            compared.judge();
        }
        compared
    }

    #[test]
    fn a_tenth_less_error_everywhere_is_better_and_more_is_worse() {
        let better = verdict(&rows("a", |scene, corner| Some(0.9 * hard(scene, corner))));
        assert_eq!(better.verdict, Verdict::Better);
        assert!((better.error_ratio.expect("a ratio").value - 0.9).abs() < 1e-9);
        let worse = verdict(&rows("a", |scene, corner| Some(1.1 * hard(scene, corner))));
        assert_eq!(worse.verdict, Verdict::Worse);
    }

    #[test]
    fn the_same_answers_are_the_same_and_chance_is_not_told_apart() {
        let same = verdict(&rows("a", |scene, corner| Some(hard(scene, corner))));
        assert_eq!(same.verdict, Verdict::Same);
        let chance = |scene: u8, corner: u8| {
            let sign = if (scene * 5 + corner * 3).is_multiple_of(2) { 1.0 } else { -1.0 };
            Some(hard(scene, corner) * (1.0 + 0.05 * sign))
        };
        assert_eq!(verdict(&rows("a", chance)).verdict, Verdict::NotToldApart);
    }

    #[test]
    fn more_failures_are_worse_however_small_the_errors_of_the_rest() {
        let half = |scene: u8, corner: u8| {
            (scene + corner).is_multiple_of(2).then(|| 0.5 * hard(scene, corner))
        };
        let compared = verdict(&rows("a", half));
        assert_eq!(compared.verdict, Verdict::Worse);
        assert!((compared.failed_more.expect("a share").value - 0.5).abs() < 1e-9);
    }

    #[test]
    fn photographs_without_an_answer_are_worse_however_much_better_the_rest() {
        let mut compared = verdict(&rows("a", |scene, corner| Some(0.5 * hard(scene, corner))));
        assert_eq!(compared.verdict, Verdict::Better);
        compared.unanswered_more = 1;
        compared.judge();
        assert_eq!(compared.verdict, Verdict::Worse);
    }

    /// A run of method a in which another program did not answer so many photographs, and so often did not end well.
    fn run(unanswered: usize, ends: usize, rows: &[Record]) -> Answered {
        let failure = |count: usize, scenes: &[&str]| {
            serde_json::json!({
                "method": "a", "status": "crashed", "count": count, "scenes": scenes, "reason": "gone",
            })
        };
        let run = serde_json::json!({
            "cornerbench_version": "", "plan": "plan", "cameras": {}, "phases": 1, "repeats": 1,
            "pipelines": [], "cells": [], "suite": "suite", "scenes": [], "shard": null, "unreadable": [],
            "identity_sha256": "", "range_sensor_model": {}, "range_sensor": "", "gate_px": 5.0,
            "least_edge_px": 3.0, "most_bound_px": 0.5, "command": "", "machine": "", "renderers": [],
            "failures": [failure(unanswered, &["00"]), failure(ends, &[])],
        });
        let answers = answers(&rows.iter().collect::<Vec<_>>());
        Answered {
            run: serde_json::from_value(run).expect("a run"),
            methods: [(("ideal".to_owned(), "a".to_owned()), answers)].into(),
        }
    }

    #[test]
    fn photographs_more_without_an_answer_are_counted_and_ends_are_not() {
        let times = |factor: f64| rows("a", |scene, corner| Some(factor * hard(scene, corner)));
        let first = run(1, 0, &times(1.0));
        for (factor, unanswered, ends, more, verdict) in [
            (1.0, 3, 0, 2, Verdict::Worse),
            (0.5, 3, 0, 2, Verdict::Worse),
            (1.0, 1, 4, 0, Verdict::Same),
            (0.5, 0, 4, -1, Verdict::Better),
        ] {
            let second = run(unanswered, ends, &times(factor));
            let found = compare(&first, &second).expect("the same scenes");
            assert_eq!(found.methods[0].unanswered_more, more, "{unanswered} {ends}");
            assert_eq!(found.methods[0].verdict, verdict, "{factor} {unanswered} {ends}");
        }
    }
}
