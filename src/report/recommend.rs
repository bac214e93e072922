//! Runs -> which method to use: the best within a time budget, chosen on scenes of split dev, confirmed on those of
//! split test, which had no part in the choice.
//!
//! The figure is the root mean square error over the corners asked for, as GOSPA has it: lost corners count as the
//! cutoff, so declining does not pay.

mod front;
mod pages;
mod words;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::error::{Error, Result};
use crate::record::{
    Record, RunDescription, Timing, kind, read_records, read_run, read_timing, track,
};
use crate::report::contest::warning;
use crate::report::gospa::{Cost, root_mean};
use crate::report::refinement::Estimate;
use crate::stats::{Bootstrap, holm, sign_flips};

pub use pages::write;
pub use words::{table, unit_words};

/// What is not more than chance is not better.
const SIGNIFICANT: f64 = 0.05;

/// All scenes together.
pub const ALL: &str = "all";

/// A run to choose from.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Its folder.
    pub folder: PathBuf,
    /// How it came about.
    pub run: RunDescription,
    /// Its records.
    pub records: Vec<Record>,
    /// What its pipelines took, where that was measured.
    pub timing: Option<Timing>,
}

impl Measured {
    /// Reads a run's folder.
    ///
    /// # Errors
    /// When its files are missing or not what their names say.
    pub fn read(folder: &Path) -> Result<Self> {
        Ok(Self {
            folder: folder.to_owned(),
            run: read_run(folder)?,
            records: read_records(&folder.join("records.parquet"))?,
            timing: read_timing(folder)?,
        })
    }
}

/// What scenes, or corners, are told apart by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ClassBy {
    /// The family that a scene was drawn from.
    #[default]
    Family,
    /// The camera's pose.
    Pose,
    /// What a corner looks like; on the refinement track only, for a false answer looks like nothing.
    Junction,
}

impl ClassBy {
    fn of(self, record: &Record) -> Option<&str> {
        match self {
            Self::Family => Some(&record.family),
            Self::Pose => Some(&record.pose),
            Self::Junction if record.track == track::REFINEMENT => record.junction.as_deref(),
            Self::Junction => None,
        }
    }
}

/// Which methods to use.
#[derive(Clone, Debug, Serialize)]
pub struct Recommendation {
    /// The runs that were chosen from.
    pub runs: Vec<PathBuf>,
    /// The most time that a method may take: end to end per photograph, of a refiner alone per corner \[us\].
    pub budget_us: Option<f64>,
    /// What classes are.
    pub class_by: ClassBy,
    /// One for each camera, track and class; of each camera and track that of all scenes first.
    pub choices: Vec<Choice>,
    /// The pipelines that are best over all scenes, as plans have them.
    pub pipelines: BTreeMap<String, String>,
    /// What a reader must know.
    pub warnings: Vec<String>,
}

/// The best method for one camera, track and class.
#[derive(Clone, Debug, Serialize)]
pub struct Choice {
    /// The camera.
    pub camera: String,
    /// What is judged, as records have it.
    pub track: String,
    /// The disc of the seeds, if they were given \[px\].
    pub seed_disc_px: Option<f64>,
    /// The class; "all" of all scenes.
    pub class: String,
    /// Scenes of split dev.
    pub dev_scenes: usize,
    /// Scenes of split test.
    pub test_scenes: usize,
    /// The methods, the least error on dev first.
    pub candidates: Vec<Candidate>,
    /// The one to use; none where none keeps the budget.
    pub chosen: Option<String>,
    /// Those that keep the budget and are better than it on test, not by chance; the best first.
    pub better_on_test: Vec<String>,
    /// All that in words.
    pub words: String,
}

/// A method to choose.
#[derive(Clone, Debug, Serialize)]
pub struct Candidate {
    /// Its name.
    pub method: String,
    /// What it takes: end to end per photograph, of a refiner alone per corner \[us\].
    pub time_us: Option<f64>,
    /// Whether that is within the budget; without a budget it is.
    pub keeps_budget: bool,
    /// Whether none is as fast and nearer, by the errors on dev.
    pub is_on_front: bool,
    /// Root mean square error per corner asked for on dev \[px\].
    pub dev_px: Estimate,
    /// The same on test \[px\].
    pub test_px: Estimate,
    /// Its error over that of the chosen one on test: the geometric mean over scenes.
    pub over_chosen: Option<Estimate>,
    /// How often that is as far from 1 by chance, by random signs, after Holm's correction; of those that keep the
    /// budget.
    pub p: Option<f64>,
}

/// Of each scene the squared error of all corners \[px^2\], and the corners asked for.
type Scenes = BTreeMap<String, [f64; 2]>;

/// A method's scenes of dev and of test.
#[derive(Clone, Debug, Default)]
struct Splits {
    dev: Scenes,
    test: Scenes,
}

/// What is judged together: camera, track, disc, class.
#[derive(Clone, Debug, PartialEq)]
struct Group {
    camera: String,
    track: String,
    seed_disc_px: Option<f64>,
    class: String,
}

/// Chooses among the methods of all runs together; a method may have been measured on dev in one run and on test in
/// another.
///
/// # Errors
/// When runs do not fit together, when there are no scenes of dev or of test, and for a budget without times.
pub fn recommend(
    runs: &[Measured],
    budget_us: Option<f64>,
    class_by: ClassBy,
) -> Result<Recommendation> {
    let pipelines = pipelines(runs)?;
    refuse_twice(runs)?;
    if budget_us.is_some() && runs.iter().all(|one| one.timing.is_none()) {
        return Err(Error::Other(format!(
            "{}: no timing.json, so nothing is known to keep a budget; measure again without --no-timing, or leave \
             the budget out",
            folders(runs)
        )));
    }
    for (split, other) in [("dev", "confirmed"), ("test", "chosen")] {
        refuse_without(runs, split, other)?;
    }
    let mut groups = collect(runs, class_by);
    let order = |group: &Group| {
        let disc = group.seed_disc_px.map(f64::to_bits);
        (group.camera.clone(), group.track.clone(), disc, group.class != ALL, group.class.clone())
    };
    groups.sort_by_key(|(group, _)| order(group));
    // A class that is all there is says nothing more.
    let is_all_there_is = |group: &Group| {
        let same = |(other, _): &&(Group, Methods)| {
            (&other.camera, &other.track, other.seed_disc_px)
                == (&group.camera, &group.track, group.seed_disc_px)
        };
        group.class != ALL && groups.iter().filter(same).count() == 2
    };
    let times = |camera: &str, method: &str| -> Option<f64> {
        let times = runs.iter().filter_map(|one| one.timing.as_ref()?.of(camera, method));
        let is_given = |pipeline: &&serde_json::Value| !pipeline["seeds"].is_null();
        let per_corner = pipelines.get(method).is_some_and(is_given);
        times
            .filter_map(|time| match per_corner {
                true => time.refine_us_per_corner(),
                false => Some(time.whole_us.median),
            })
            .next()
    };
    let mut warnings = BTreeSet::new();
    let mut choices = Vec::new();
    for (group, methods) in groups.iter().filter(|(group, _)| !is_all_there_is(group)) {
        let (choice, warned) =
            choose(group, methods, budget_us, &|method| times(&group.camera, method));
        warnings.extend(warned);
        choices.extend(choice);
    }
    if runs.iter().all(|one| one.timing.is_none()) {
        warnings.insert(
            "no timing.json: no front of error against time; measure without --no-timing for one"
                .into(),
        );
    }
    let best = choices.iter().filter(|choice| choice.class == ALL);
    let best: BTreeSet<&String> = best.filter_map(|choice| choice.chosen.as_ref()).collect();
    let toml = |name: &String| Ok((name.clone(), words::toml_of(&pipelines[name.as_str()])?));
    Ok(Recommendation {
        runs: runs.iter().map(|one| one.folder.clone()).collect(),
        budget_us,
        class_by,
        pipelines: best.into_iter().map(toml).collect::<Result<_>>()?,
        choices,
        warnings: warnings.into_iter().collect(),
    })
}

fn folders(runs: &[Measured]) -> String {
    runs.iter().map(|one| one.folder.display().to_string()).collect::<Vec<_>>().join(", ")
}

/// The pipelines of all runs by name.
fn pipelines(runs: &[Measured]) -> Result<BTreeMap<&str, &serde_json::Value>> {
    let mut found: BTreeMap<&str, (&serde_json::Value, &Measured)> = BTreeMap::new();
    let rule = |run: &RunDescription| [run.gate_px, run.least_edge_px, run.most_bound_px];
    for one in runs {
        if rule(&one.run) != rule(&runs[0].run) {
            return Err(Error::Other(format!(
                "{} and {}: gate_px, least_edge_px and most_bound_px are {:?} and {:?}; only runs that ask for the \
                 same corners can be taken together",
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
fn refuse_twice(runs: &[Measured]) -> Result<()> {
    let mut seen: BTreeMap<(&str, &str, &str, &str), &Path> = BTreeMap::new();
    for one in runs {
        for record in one.records.iter().filter(|record| record.kind != kind::SCENE) {
            let key = (
                record.suite.as_str(),
                record.scene.as_str(),
                record.camera.as_str(),
                record.method.as_str(),
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
fn refuse_without(runs: &[Measured], split: &str, other: &str) -> Result<()> {
    let is_there = |record: &Record| record.split.as_deref() == Some(split);
    if runs.iter().flat_map(|one| &one.records).any(is_there) {
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
type Methods = Vec<(String, Splits)>;

/// The sums of each scene, by what is judged together and by method.
fn collect(runs: &[Measured], class_by: ClassBy) -> Vec<(Group, Methods)> {
    let mut found: Vec<(Group, BTreeMap<&str, Splits>)> = Vec::new();
    let is_judged =
        |record: &&Record| [kind::CORNER, kind::FALSE_CORNER].contains(&record.kind.as_str());
    for record in runs.iter().flat_map(|one| &one.records).filter(is_judged) {
        let cost = Cost::of(record);
        let scene = format!("{}/{}", record.suite, record.scene);
        for class in [Some(ALL), class_by.of(record)].into_iter().flatten() {
            let group = Group {
                camera: record.camera.clone(),
                track: record.track.clone(),
                seed_disc_px: record.seed_disc_px,
                class: class.to_owned(),
            };
            let index = found.iter().position(|(other, _)| *other == group).unwrap_or_else(|| {
                found.push((group, BTreeMap::new()));
                found.len() - 1
            });
            let splits = found[index].1.entry(&record.method).or_default();
            let scenes = match record.split.as_deref() {
                Some("dev") => &mut splits.dev,
                Some("test") => &mut splits.test,
                _ => continue,
            };
            let sums = scenes.entry(scene.clone()).or_default();
            sums[0] += cost.square_px2();
            sums[1] += cost.asked;
        }
    }
    let owned = |(name, splits): (&str, Splits)| (name.to_owned(), splits);
    found.into_iter().map(|(group, of)| (group, of.into_iter().map(owned).collect())).collect()
}

/// The choice among a group's methods, on the scenes that all of them have; none where there are no such scenes.
fn choose(
    group: &Group,
    methods: &Methods,
    budget_us: Option<f64>,
    time_us: &dyn Fn(&str) -> Option<f64>,
) -> (Option<Choice>, Vec<String>) {
    let mut warnings = Vec::new();
    let (some, others): (Vec<_>, Vec<_>) =
        methods.iter().partition(|(_, splits)| !splits.dev.is_empty() && !splits.test.is_empty());
    if !others.is_empty() && group.class == ALL {
        let names: Vec<&str> = others.iter().map(|(name, _)| name.as_str()).collect();
        warnings.push(format!("left out, for not measured on both splits: {}", names.join(", ")));
    }
    let [dev, test] = [|splits: &Splits| splits.dev.clone(), |splits: &Splits| splits.test.clone()]
        .map(|of| shared(&some.iter().map(|(_, splits)| of(splits)).collect::<Vec<_>>()));
    let count = |scenes: &[Scenes]| scenes.first().map_or(0, Scenes::len);
    let keeps = |time_us: Option<f64>| {
        budget_us.is_none_or(|budget_us| time_us.is_some_and(|time_us| time_us <= budget_us))
    };
    let mut candidates: Vec<(Candidate, &Scenes)> = some
        .iter()
        .zip(dev.iter().zip(&test))
        .filter_map(|((name, _), (dev, test))| {
            let time_us = time_us(name);
            let candidate = Candidate {
                method: name.clone(),
                time_us,
                keeps_budget: keeps(time_us),
                is_on_front: false,
                dev_px: figure(dev)?,
                test_px: figure(test)?,
                over_chosen: None,
                p: None,
            };
            Some((candidate, test))
        })
        .collect();
    if candidates.is_empty() {
        warnings.push(format!("{}: no corners on both splits", words::given(group)));
        return (None, warnings);
    }
    candidates.sort_by(|(a, _), (b, _)| a.dev_px.value.total_cmp(&b.dev_px.value));
    front::mark(&mut candidates.iter_mut().map(|(candidate, _)| candidate).collect::<Vec<_>>());
    let chosen = candidates.iter().position(|(candidate, _)| candidate.keeps_budget);
    if let Some(chosen) = chosen {
        confirm(&mut candidates, chosen, group);
    }
    let candidates: Vec<Candidate> = candidates.into_iter().map(|(one, _)| one).collect();
    let best_px = chosen.map_or(f64::INFINITY, |index| candidates[index].test_px.value);
    let is_better = |one: &&Candidate| {
        // Both the ratio over scenes and the figure itself: a few lost corners move one of them alone.
        one.p.is_some_and(|p| p <= SIGNIFICANT)
            && one.over_chosen.is_some_and(|ratio| ratio.value < 1.0)
            && one.test_px.value < best_px
    };
    let mut better: Vec<&Candidate> = candidates.iter().filter(is_better).collect();
    better.sort_by(|a, b| a.test_px.value.total_cmp(&b.test_px.value));
    let mut choice = Choice {
        camera: group.camera.clone(),
        track: group.track.clone(),
        seed_disc_px: group.seed_disc_px,
        class: group.class.clone(),
        dev_scenes: count(&dev),
        test_scenes: count(&test),
        chosen: chosen.map(|index| candidates[index].method.clone()),
        better_on_test: better.iter().map(|one| one.method.clone()).collect(),
        candidates,
        words: String::new(),
    };
    choice.words = words::sentence(&choice, budget_us);
    for (split, scenes) in [("dev", choice.dev_scenes), ("test", choice.test_scenes)] {
        let of_class = (group.class != ALL).then_some(group.class.as_str());
        let place = of_class.map_or_else(|| split.to_owned(), |class| format!("{class}, {split}"));
        warnings.extend(warning(scenes).map(|words| format!("{place}: {words}")));
    }
    (Some(choice), warnings)
}

/// Of each the scenes that all have.
fn shared(all: &[Scenes]) -> Vec<Scenes> {
    let mut shared = all.to_vec();
    for scenes in &mut shared {
        scenes.retain(|scene, _| all.iter().all(|other| other.contains_key(scene)));
    }
    shared
}

/// Root mean square error per corner asked for \[px\], with its interval over scenes.
fn figure(scenes: &Scenes) -> Option<Estimate> {
    let sums: Vec<[f64; 2]> = scenes.values().copied().collect();
    root_mean(&sums, &|sums| sums[0], &|sums| sums[1])
}

/// Compares all that keep the budget with the chosen one, scene by scene on test.
fn confirm(candidates: &mut [(Candidate, &Scenes)], chosen: usize, group: &Group) {
    // An error of exactly 0 has no logarithm; none is known to less.
    const LEAST_PX2: f64 = 1e-12;
    // A scene without corners has no error per corner.
    let logs = |scenes: &Scenes| -> Vec<f64> {
        let with_corners = scenes.values().filter(|sums| sums[1] > 0.0);
        with_corners.map(|sums| 0.5 * (sums[0] / sums[1]).max(LEAST_PX2).ln()).collect()
    };
    let of_chosen = logs(candidates[chosen].1);
    let mut compared = Vec::new();
    for (index, (candidate, scenes)) in candidates.iter_mut().enumerate() {
        if index == chosen || !candidate.keeps_budget {
            continue;
        }
        let differences: Vec<f64> =
            logs(scenes).iter().zip(&of_chosen).map(|(own, chosen)| own - chosen).collect();
        let name = ["recommend", group.camera.as_str(), candidate.method.as_str()];
        let Some(flips) = sign_flips(&differences, &name) else { continue };
        let rows: Vec<[f64; 2]> = differences.iter().map(|one| [*one, 1.0]).collect();
        let mean = |[sum, count]: &[f64; 2]| (*count > 0.0).then(|| sum / count);
        let interval = Bootstrap::named(&name).of_sums(&rows, mean).ok();
        candidate.over_chosen = Some(Estimate::of(flips.mean, interval).map(f64::exp));
        candidate.p = Some(flips.p);
        compared.push(index);
    }
    let p_values: Vec<f64> = compared.iter().filter_map(|index| candidates[*index].0.p).collect();
    for (index, p) in compared.into_iter().zip(holm(&p_values)) {
        candidates[index].0.p = Some(p);
    }
}
