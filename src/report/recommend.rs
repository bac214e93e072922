//! Runs -> which method to use: the best within a time budget, chosen on scenes of split dev, confirmed on those of
//! split test, which had no part in the choice.
//!
//! The figure is the root mean square error over the corners asked for, as GOSPA has it: lost corners count as the
//! cutoff, so declining does not pay.

mod choose;
mod front;
mod gather;
mod pages;
mod words;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::error::{Error, Result};
use crate::record::{RecordFile, RunDescription, Timing, read_run, read_timing, track};
use crate::report::contest::warning;
use crate::report::refinement::Estimate;

use choose::choose;
use gather::{Group, Heading, Methods};

pub use gather::Tally;
pub use pages::write;
pub use words::{table, unit_words};

/// All scenes together.
pub const ALL: &str = "all";

/// A run to choose from.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Its folder.
    pub folder: PathBuf,
    /// How it came about.
    pub run: RunDescription,
    /// What its records come to.
    pub tally: Tally,
    /// What its pipelines took, where that was measured.
    pub timing: Option<Timing>,
}

impl Measured {
    /// Reads a run's folder.
    ///
    /// # Errors
    /// When its files are missing or not what their names say.
    pub fn read(folder: &Path) -> Result<Self> {
        let file = RecordFile::open(&folder.join("records.parquet"))?;
        let mut tally = Tally::default();
        for group in 0..file.groups() {
            file.read(group, &gather::COLUMNS)?.iter().for_each(|record| tally.add(record));
        }
        Ok(Self {
            folder: folder.to_owned(),
            run: read_run(folder)?,
            tally,
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
    fn of(self, heading: &Heading) -> Option<&str> {
        match self {
            Self::Family => Some(&heading.family),
            Self::Pose => Some(&heading.pose),
            Self::Junction if heading.track == track::REFINEMENT => heading.junction.as_deref(),
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
    /// Whether it leaves given seeds where they are: their error is the plan's, so it is no method to choose.
    pub is_control: bool,
    /// Whether its time is within the budget; without a budget it is.
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
    let pipelines = gather::pipelines(runs)?;
    gather::refuse_twice(runs)?;
    if budget_us.is_some() && runs.iter().all(|one| one.timing.is_none()) {
        return Err(Error::Other(format!(
            "{}: no timing.json, so nothing is known to keep a budget; measure again without --no-timing, or leave \
             the budget out",
            gather::folders(runs)
        )));
    }
    for (split, other) in [("dev", "confirmed"), ("test", "chosen")] {
        gather::refuse_without(runs, split, other)?;
    }
    let mut groups = gather::collect(runs, class_by);
    if groups.is_empty() {
        return Err(Error::Other(format!(
            "{}: no corner is known, so no method can be told to be better; measure pictures of one's own again with \
             --known FILE",
            gather::folders(runs)
        )));
    }
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
    let failed: BTreeSet<&str> = gather::failed(runs).collect();
    if !failed.is_empty() {
        let failed = failed.into_iter().collect::<Vec<_>>().join(", ");
        warnings.insert(format!(
            "left out, for they had no answer to some photographs: {failed}; the run's report says why"
        ));
    }
    let mut choices = Vec::new();
    for (group, methods) in groups.iter().filter(|(group, _)| !is_all_there_is(group)) {
        let is_control = |method: &str| {
            let refiner = pipelines.get(method).map(|pipeline| &pipeline["refine"]["algorithm"]);
            group.track == track::REFINEMENT && refiner.is_some_and(|refiner| refiner == "none")
        };
        let (choice, warned) =
            choose(group, methods, budget_us, &is_control, &|method| times(&group.camera, method));
        warnings.extend(warned);
        choices.extend(choice);
    }
    // In one line: most classes have few.
    let is_small = |choice: &&Choice| {
        choice.class != ALL && warning(choice.dev_scenes.min(choice.test_scenes)).is_some()
    };
    let small: BTreeSet<&str> =
        choices.iter().filter(is_small).map(|choice| choice.class.as_str()).collect();
    if !small.is_empty() {
        let small = small.into_iter().collect::<Vec<_>>().join(", ");
        warnings.insert(format!(
            "too few scenes of dev or test to be sure of a choice of their own: {small}"
        ));
    }
    if runs.iter().all(|one| one.timing.is_none()) {
        warnings.insert(
            "no timing.json: no front of error against time; measure without --no-timing for one"
                .into(),
        );
    }
    let best = choices.iter().filter(|choice| choice.class == ALL);
    let best: BTreeSet<&String> = best.filter_map(|choice| choice.chosen.as_ref()).collect();
    let toml = |name: &String| {
        let pipeline = pipelines.get(name.as_str());
        pipeline.map(|pipeline| Ok((name.clone(), words::toml_of(pipeline)?)))
    };
    Ok(Recommendation {
        runs: runs.iter().map(|one| one.folder.clone()).collect(),
        budget_us,
        class_by,
        pipelines: best.into_iter().filter_map(toml).collect::<Result<_>>()?,
        choices,
        warnings: warnings.into_iter().collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{Record, kind, status};

    /// A corner of one of 24 scenes of a split, by a method alone, that far off.
    fn row(method: &str, split: &str, scene: u8, error_px: f64) -> Record {
        Record {
            suite: "suite".into(),
            scene: format!("{split}-{scene:02}"),
            family: if scene.is_multiple_of(2) { "wall" } else { "paper" }.into(),
            split: Some(split.into()),
            camera: "ideal".into(),
            exposure: Some(0),
            method: method.into(),
            track: track::REFINEMENT.into(),
            seed_disc_px: Some(1.0),
            kind: kind::CORNER.into(),
            status: status::OK.into(),
            corner_index: Some(0),
            junction: Some("L".into()),
            refine_status: Some("ok".into()),
            refined_error_px: Some(error_px),
            ..Record::default()
        }
    }

    /// Methods with their errors on dev and on test \[px\] and their times \[us\].
    fn measured(methods: &[(&str, f64, f64, f64)], is_timed: bool) -> Measured {
        measured_if(methods, is_timed, |_| true)
    }

    /// The records that pass.
    fn measured_if(
        methods: &[(&str, f64, f64, f64)],
        is_timed: bool,
        mut passes: impl FnMut(&mut Record) -> bool,
    ) -> Measured {
        let mut records = Vec::new();
        for (name, dev_px, test_px, _) in methods {
            for scene in 0..24 {
                let hard = 1.0 + 0.1 * f64::from(scene % 5);
                records.push(row(name, "dev", scene, dev_px * hard));
                records.push(row(name, "test", scene, test_px * hard));
            }
        }
        let mut tally = Tally::default();
        for mut record in records {
            if passes(&mut record) {
                tally.add(&record);
            }
        }
        let pipeline = |(name, ..): &(&str, f64, f64, f64)| {
            serde_json::json!({
                "name": name,
                "seeds": { "disc_px": 1.0 },
                "target": null,
                "refine": { "algorithm": name, "version": 1, "parameters": { "seeds": 60, "k": 4.0 } },
            })
        };
        let run = serde_json::json!({
            "cornerbench_version": "", "plan": "plan", "cameras": {}, "phases": 1, "repeats": 1,
            "pipelines": methods.iter().map(pipeline).collect::<Vec<_>>(),
            "cells": [], "suite": "suite", "scenes": [], "shard": null, "unreadable": [], "identity_sha256": "",
            "range_sensor_model": {}, "range_sensor": "", "gate_px": 5.0, "least_edge_px": 3.0,
            "most_bound_px": 0.5, "command": "", "machine": "", "renderers": [],
        });
        let time = |(name, _, _, us): &(&str, f64, f64, f64)| {
            let spread = |us: &f64| serde_json::json!({ "median": us, "lower_quartile": us, "upper_quartile": us });
            serde_json::json!({
                "camera": "ideal", "method": name, "photographs": 1, "corners": 2.0,
                "detect_us": spread(&0.0), "refine_us": spread(&(2.0 * us)),
                "grasp_us": spread(&0.0), "whole_us": spread(&(2.0 * us)),
            })
        };
        let timing = serde_json::json!({
            "cornerbench_version": "", "machine": "", "threads": 1, "clock_resolution_us": 0.02,
            "rounds": 5, "scenes": [], "methods": methods.iter().map(time).collect::<Vec<_>>(),
        });
        Measured {
            folder: "RUN".into(),
            run: serde_json::from_value(run).expect("a run"),
            tally,
            timing: is_timed.then(|| serde_json::from_value(timing).expect("times")),
        }
    }

    fn all(methods: &[(&str, f64, f64, f64)], budget_us: Option<f64>) -> Choice {
        let found = recommend(&[measured(methods, true)], budget_us, ClassBy::Family);
        found.expect("a choice").choices.swap_remove(0)
    }

    const METHODS: [(&str, f64, f64, f64); 4] = [
        ("fast", 0.4, 0.4, 1.0),
        ("dominated", 0.5, 0.5, 10.0),
        ("middle", 0.2, 0.2, 20.0),
        ("slow", 0.1, 0.1, 500.0),
    ];

    #[test]
    fn the_front_has_no_method_that_another_beats_in_both() {
        let choice = all(&METHODS, None);
        let front = choice.candidates.iter().filter(|one| one.is_on_front);
        let front: Vec<&str> = front.map(|one| one.method.as_str()).collect();
        assert_eq!(front, ["slow", "middle", "fast"]);
        assert_eq!((choice.dev_scenes, choice.test_scenes), (24, 24));
        assert_eq!(choice.chosen.as_deref(), Some("slow"));
        assert!(choice.better_on_test.is_empty());
        // Per corner: half of what the two of a photograph take.
        assert_eq!(choice.candidates[0].time_us, Some(500.0));
        let (table, left_out) = table(&choice);
        assert_eq!(table.rows.len(), 3);
        assert!(left_out.expect("one").starts_with("1 other"));
    }

    #[test]
    fn the_best_that_keeps_the_budget_is_chosen_and_confirmed() {
        let choice = all(&METHODS, Some(20.0));
        assert_eq!(choice.chosen.as_deref(), Some("middle"));
        let words = "us a corner. On test nothing that keeps the budget is surely better.";
        assert!(choice.words.starts_with("middle: 0.2"), "{}", choice.words);
        assert!(choice.words.ends_with(words), "{}", choice.words);
        let nothing = all(&METHODS, Some(0.5));
        assert_eq!(nothing.chosen, None);
        assert!(nothing.words.contains("the fastest is fast, 1.00 us"), "{}", nothing.words);
    }

    #[test]
    fn what_is_better_on_dev_and_worse_on_test_does_not_carry_over() {
        let choice = all(&[("lucky", 0.1, 0.4, 1.0), ("steady", 0.2, 0.2, 1.0)], None);
        assert_eq!(choice.chosen.as_deref(), Some("lucky"));
        assert_eq!(choice.better_on_test, ["steady"]);
        assert!(
            choice.words.contains("On test steady is better by 50 % (p < 0.001)"),
            "{}",
            choice.words
        );
    }

    #[test]
    fn declining_does_not_pay_and_families_have_a_choice_each() {
        let methods = [("shy", 0.1, 0.1, 1.0), ("steady", 0.2, 0.2, 1.0)];
        let run = measured_if(&methods, true, |record| {
            if record.method == "shy" && record.family == "wall" {
                record.refine_status = Some("singular".into());
            }
            true
        });
        let found = recommend(&[run], None, ClassBy::Family).expect("a choice");
        let chosen: Vec<(&str, Option<&str>)> = found
            .choices
            .iter()
            .map(|choice| (choice.class.as_str(), choice.chosen.as_deref()))
            .collect();
        let wanted = [(ALL, Some("steady")), ("paper", Some("shy")), ("wall", Some("steady"))];
        assert_eq!(chosen, wanted);
        let few = "choice of their own: paper, wall";
        assert!(found.warnings.iter().any(|warning| warning.ends_with(few)));
        assert!(!found.warnings.iter().any(|warning| warning.starts_with("dev")));
        let toml = &found.pipelines["steady"];
        assert!(toml.starts_with("[[pipelines]]\nname = \"steady\""), "{toml}");
        let plan: toml::Table = toml.parse().expect("TOML");
        let stage = &plan["pipelines"][0]["refine"];
        assert_eq!(stage["algorithm"].as_str(), Some("steady"));
        assert_eq!((stage["seeds"].as_integer(), stage["k"].as_float()), (Some(60), Some(4.0)));
        assert_eq!(plan["pipelines"][0].get("target"), None);
    }

    #[test]
    fn to_fail_does_not_pay() {
        let mut run = measured(&[("lazy", 0.1, 0.1, 1.0), ("steady", 0.2, 0.2, 1.0)], true);
        run.run.failures.push(crate::record::FailureCount {
            method: "lazy".into(),
            status: "crashed".into(),
            count: 1,
            scenes: vec!["dev-00".into()],
            reason: "ended".into(),
        });
        let found = recommend(&[run], None, ClassBy::Family).expect("a choice");
        assert!(found.choices.iter().all(|choice| choice.chosen.as_deref() == Some("steady")));
        let words = "left out, for they had no answer to some photographs: lazy";
        assert!(found.warnings.iter().any(|warning| warning.starts_with(words)));
    }

    #[test]
    fn to_end_badly_when_all_is_answered_leaves_no_method_out() {
        let mut run = measured(&[("rude", 0.1, 0.1, 1.0), ("steady", 0.2, 0.2, 1.0)], true);
        run.run.failures.push(crate::record::FailureCount {
            method: "rude".into(),
            status: "crashed".into(),
            count: 1,
            scenes: Vec::new(),
            reason: "ended".into(),
        });
        let found = recommend(&[run], None, ClassBy::Family).expect("a choice");
        assert!(found.choices.iter().all(|choice| choice.chosen.as_deref() == Some("rude")));
    }

    #[test]
    fn to_leave_seeds_where_they_are_is_no_choice_but_is_said() {
        let choice = all(&[("none", 0.1, 0.1, 0.1), ("steady", 0.2, 0.2, 1.0)], None);
        assert_eq!(choice.chosen.as_deref(), Some("steady"));
        assert!(choice.better_on_test.is_empty());
        assert!(choice.words.contains("Seeds left where they are"), "{}", choice.words);
    }

    #[test]
    fn runs_that_cannot_be_taken_together_say_why() {
        let whole = measured(&METHODS, true);
        let words = |runs: &[Measured], budget_us: Option<f64>| {
            recommend(runs, budget_us, ClassBy::Family).expect_err("an error").chain()
        };
        let of_split = |split: &str| {
            let is_its = |record: &mut Record| record.split.as_deref() == Some(split);
            Measured { folder: split.into(), ..measured_if(&METHODS, true, is_its) }
        };
        let [dev, test] = ["dev", "test"].map(of_split);
        let without_test = words(std::slice::from_ref(&dev), None);
        assert!(without_test.contains("no scenes of split test"), "{without_test}");
        assert!(without_test.contains("measure plan DATASET --split test"), "{without_test}");
        assert!(words(std::slice::from_ref(&test), None).contains("no scenes of split dev"));
        assert!(words(&[whole.clone(), dev.clone()], None).contains("both have scene dev-00 by"));
        assert!(recommend(&[dev, test], None, ClassBy::Family).is_ok());

        let untimed = measured(&METHODS, false);
        assert!(words(&[untimed], Some(1.0)).contains("measure again without --no-timing"));
        let untimed = recommend(&[measured(&METHODS, false)], None, ClassBy::Junction);
        let untimed = untimed.expect("a choice");
        assert!(untimed.warnings[0].contains("no front"), "{:?}", untimed.warnings);
        assert_eq!(untimed.choices.len(), 1, "a class that is all there is says no more");

        let mut other = Measured { folder: "OTHER".into(), ..whole.clone() };
        other.run.pipelines[0]["refine"]["parameters"]["k"] = 5.0.into();
        assert!(words(&[whole.clone(), other], None).contains("two pipelines are called \"fast\""));
        let mut other = Measured { folder: "OTHER".into(), ..whole.clone() };
        other.run.gate_px = 3.0;
        assert!(words(&[whole, other], None).contains("ask for the same corners"));
    }

    #[test]
    fn a_picture_is_drawn_of_times_only() {
        let choice = all(&METHODS, None);
        let svg = front::draw(&choice, Some(20.0)).expect("a picture").expect("times");
        assert!(svg.contains("middle") && !svg.contains("dominated"));
        let untimed = recommend(&[measured(&METHODS, false)], None, ClassBy::Family);
        let choice = &untimed.expect("a choice").choices[0];
        assert!(front::draw(choice, None).expect("no picture").is_none());
        assert_eq!(table(choice).0.header, ["method", "dev px", "test px (95 %)"]);
    }
}
