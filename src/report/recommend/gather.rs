//! Runs -> the errors of each method in each scene, and that the runs fit together.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use super::{ALL, ClassBy, Measured};
use crate::error::{Error, Result};
use crate::record::{Record, RunDescription, kind, status};
use crate::report::gospa::Cost;

/// Of each scene the squared error of all corners \[px^2\], the corners asked for, and what false answers are of the
/// squared error \[px^2\].
pub(super) type Scenes = BTreeMap<String, [f64; 3]>;

/// A method's scenes of dev and of test.
#[derive(Clone, Debug, Default)]
pub(super) struct Splits {
    pub dev: Scenes,
    pub test: Scenes,
}

/// What is read of records.
pub(super) const COLUMNS: [&str; 16] = [
    "record_version",
    "suite",
    "scene",
    "family",
    "pose",
    "split",
    "camera",
    "method",
    "track",
    "seed_disc_px",
    "kind",
    "status",
    "junction",
    "detected_error_px",
    "refined_error_px",
    "refine_status",
];

/// What a run's records come to, by all that they are told apart by, in the order in which these come.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    places: HashMap<Heading, usize>,
    rows: Vec<(Heading, [f64; 3])>,
}

/// All that rows are told apart by.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct Heading {
    pub suite: String,
    pub scene: String,
    pub family: String,
    pub pose: String,
    pub split: Option<String>,
    pub camera: String,
    pub method: String,
    pub track: String,
    /// The bits of the disc's radius, if seeds were given.
    seed_disc: Option<u64>,
    pub junction: Option<String>,
    /// Whether it is a corner asked for or an answer of which something is known.
    is_judged: bool,
}

impl Heading {
    fn of(record: &Record) -> Self {
        let is_judged = [kind::CORNER, kind::FALSE_CORNER].contains(&record.kind.as_str())
            && record.status != status::UNKNOWN;
        Self {
            suite: record.suite.clone(),
            scene: record.scene.clone(),
            family: record.family.clone(),
            pose: record.pose.clone(),
            split: record.split.clone(),
            camera: record.camera.clone(),
            method: record.method.clone(),
            track: record.track.clone(),
            seed_disc: record.seed_disc_px.map(f64::to_bits),
            junction: record.junction.clone(),
            is_judged,
        }
    }
}

impl Tally {
    /// Adds a record.
    pub fn add(&mut self, record: &Record) {
        if [kind::SCENE, kind::FAILURE].contains(&record.kind.as_str()) {
            return;
        }
        let heading = Heading::of(record);
        let next = self.rows.len();
        let place = *self.places.entry(heading.clone()).or_insert(next);
        if place == next {
            self.rows.push((heading, [0.0; 3]));
        }
        let cost = Cost::of(record);
        let sums = &mut self.rows[place].1;
        sums[0] += cost.square_px2();
        sums[1] += cost.asked;
        sums[2] += cost.false_px2;
    }

    fn headings(&self) -> impl Iterator<Item = &Heading> {
        self.rows.iter().map(|(heading, _)| heading)
    }
}

/// What is judged together: camera, track, disc, class.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Group {
    pub camera: String,
    pub track: String,
    pub seed_disc_px: Option<f64>,
    pub class: String,
}

pub(super) fn folders(runs: &[Measured]) -> String {
    runs.iter().map(|one| one.folder.display().to_string()).collect::<Vec<_>>().join(", ")
}

/// The pipelines of all runs by name.
pub(super) fn pipelines(runs: &[Measured]) -> Result<BTreeMap<&str, &serde_json::Value>> {
    let mut found: BTreeMap<&str, (&serde_json::Value, &Measured)> = BTreeMap::new();
    let rule = |run: &RunDescription| {
        let RunDescription { gate_px, least_edge_px, most_bound_px, .. } = run;
        format!("{gate_px}, {least_edge_px} and {most_bound_px}")
    };
    for one in runs {
        if rule(&one.run) != rule(&runs[0].run) {
            return Err(Error::Other(format!(
                "{} and {}: gate_px, least_edge_px and most_bound_px are {} in the first, {} in the other; only \
                 runs that ask for the same corners can be taken together",
                runs[0].folder.display(),
                one.folder.display(),
                rule(&runs[0].run),
                rule(&one.run),
            )));
        }
        for pipeline in &one.run.pipelines {
            let Some(name) = pipeline["name"].as_str() else { continue };
            let (first, other) = *found.entry(name).or_insert((pipeline, one));
            if first != pipeline {
                return Err(Error::Other(format!(
                    "{} and {}: two pipelines are called {name:?}, with other algorithms or parameters; rename one \
                     of them in its plan and measure it again",
                    other.folder.display(),
                    one.folder.display(),
                )));
            }
        }
    }
    Ok(found.into_iter().map(|(name, (pipeline, _))| (name, pipeline)).collect())
}

/// Refuses a scene that was measured twice by one method.
pub(super) fn refuse_twice(runs: &[Measured]) -> Result<()> {
    let mut seen: BTreeMap<(&str, &str, &str, &str), &Path> = BTreeMap::new();
    for one in runs {
        for heading in one.tally.headings() {
            let key = (
                heading.suite.as_str(),
                heading.scene.as_str(),
                heading.camera.as_str(),
                heading.method.as_str(),
            );
            let first = *seen.entry(key).or_insert(&one.folder);
            if !std::ptr::eq(first, one.folder.as_path()) {
                return Err(Error::Other(format!(
                    "{} and {}: both have scene {} by {}, {}; name one of them only",
                    first.display(),
                    one.folder.display(),
                    key.1,
                    key.3,
                    key.2,
                )));
            }
        }
    }
    Ok(())
}

/// Refuses runs without a scene of a split.
pub(super) fn refuse_without(runs: &[Measured], split: &str, other: &str) -> Result<()> {
    let is_there = |heading: &Heading| heading.split.as_deref() == Some(split);
    if runs.iter().flat_map(|one| one.tally.headings()).any(is_there) {
        return Ok(());
    }
    let plan = runs.first().map_or("PLAN", |one| one.run.plan.as_str());
    Err(Error::Other(format!(
        "{}: no scenes of split {split}; what is {other} on one split must be {} on the other. Measure these, too: \
         cornerbench measure {plan} DATASET --split {split} -o OTHER; then cornerbench recommend {} OTHER",
        folders(runs),
        if other == "chosen" { "confirmed" } else { "chosen" },
        runs.iter().map(|one| one.folder.display().to_string()).collect::<Vec<_>>().join(" "),
    )))
}

/// The methods of a group.
pub(super) type Methods = Vec<(String, Splits)>;

/// The methods that had no answer to some photograph: what they missed by that costs less than wrong answers, so nobody
/// could tell whether they are better.
pub(super) fn failed(runs: &[Measured]) -> impl Iterator<Item = &str> {
    let all = runs.iter().flat_map(|one| &one.run.failures);
    all.filter(|failure| !failure.is_of_the_end()).map(|failure| failure.method.as_str())
}

/// The sums of each scene, by what is judged together and by method.
pub(super) fn collect(runs: &[Measured], class_by: ClassBy) -> Vec<(Group, Methods)> {
    let mut found: Vec<(Group, BTreeMap<&str, Splits>)> = Vec::new();
    let failed: Vec<&str> = failed(runs).collect();
    let rows = runs.iter().flat_map(|one| &one.tally.rows);
    let is_wanted =
        |heading: &Heading| heading.is_judged && !failed.contains(&heading.method.as_str());
    for (heading, added) in rows.filter(|(heading, _)| is_wanted(heading)) {
        let scene = format!("{}/{}", heading.suite, heading.scene);
        for class in [Some(ALL), class_by.of(heading)].into_iter().flatten() {
            let group = Group {
                camera: heading.camera.clone(),
                track: heading.track.clone(),
                seed_disc_px: heading.seed_disc.map(f64::from_bits),
                class: class.to_owned(),
            };
            let index = found.iter().position(|(other, _)| *other == group).unwrap_or_else(|| {
                found.push((group, BTreeMap::new()));
                found.len() - 1
            });
            let splits = found[index].1.entry(&heading.method).or_default();
            let scenes = match heading.split.as_deref() {
                Some("dev") => &mut splits.dev,
                Some("test") => &mut splits.test,
                _ => continue,
            };
            let sums = scenes.entry(scene.clone()).or_default();
            sums.iter_mut().zip(added).for_each(|(sum, added)| *sum += added);
        }
    }
    let owned = |(name, splits): (&str, Splits)| (name.to_owned(), splits);
    found.into_iter().map(|(group, of)| (group, of.into_iter().map(owned).collect())).collect()
}
