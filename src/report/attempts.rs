//! Attempts -> what grasps are worth: success of each method with its interval, why the others failed, and success over
//! the error of corners.

mod picture;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::json;

use crate::error::{Error, Result};
use crate::files::{write_json, write_whole};
use crate::record::{Attempt, outcome, write_attempts};
use crate::report::html;
use crate::report::refinement::{Estimate, estimate};
use crate::report::splice;
use crate::report::words::{Words, between, percent, two_digits};
use crate::stats::{self, Selective};

/// What became of the grasps of a run.
#[derive(Clone, Debug, Serialize)]
pub struct AttemptSummary {
    /// The dataset.
    pub dataset: PathBuf,
    /// Name of the gripper.
    pub gripper: String,
    /// Name of the robot.
    pub robot: String,
    /// The command that made it.
    pub command: String,
    /// Scenes.
    pub scenes: usize,
    /// Those in which the robot reaches a true grasp of a face in view.
    pub reachable: usize,
    /// Controls first, then the methods, the most successful first; then true corners that were moved, by estimator.
    pub methods: Vec<MethodAttempts>,
}

/// What became of the grasps of a camera and method, or of a control.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodAttempts {
    /// Its name.
    pub method: String,
    /// The camera; none of a control.
    pub camera: Option<String>,
    /// Whether it is made from the truth.
    pub is_control: bool,
    /// The disc of the seeds, if they were given \[px\].
    pub seed_disc_px: Option<f64>,
    /// The grasp estimator and its version; none of a control.
    pub grasp_estimator: Option<String>,
    /// Grasps asked for.
    pub asked: usize,
    /// Grasps that the robot began with.
    pub executed: usize,
    /// Share of all asked for that succeeded, with its interval over scenes.
    pub success: Option<Estimate>,
    /// The same of those in scenes in which the robot reaches a true grasp.
    pub success_of_reachable: Option<Estimate>,
    /// How often each outcome.
    pub outcomes: BTreeMap<String, usize>,
    /// Root mean square error of the corners that were answered \[px\].
    pub corner_rmse_px: Option<f64>,
    /// Share of the grasps carried out or planned that fail, over the share of those asked for, the ones first of whose
    /// point the method says that it is known best.
    pub risk_coverage: Vec<Selective>,
    /// Its mean up to where it ends: 0 where what fails is last.
    pub mean_risk: Option<f64>,
    /// Median distance of the grasp point from the true centre of the chosen face \[mm\].
    pub median_error_mm: Option<f64>,
    /// Median angle between approach and the true face's normal \[deg\].
    pub median_approach_error_deg: Option<f64>,
}

impl MethodAttempts {
    /// Whether its corners are the true ones, moved on purpose.
    fn is_moved(&self) -> bool {
        self.seed_disc_px.is_some()
    }
}

/// How many scenes there are and in how many of them the robot reaches a true grasp; and what became of the grasps of
/// each method.
pub fn summarise(attempts: &[Attempt]) -> (usize, usize, Vec<MethodAttempts>) {
    let mut groups: BTreeMap<(bool, Option<&str>, &str), Vec<&Attempt>> = BTreeMap::new();
    let mut scenes: BTreeMap<&str, bool> = BTreeMap::new();
    for attempt in attempts {
        let key = (!attempt.is_control, attempt.camera.as_deref(), attempt.method.as_str());
        groups.entry(key).or_default().push(attempt);
        *scenes.entry(&attempt.scene).or_default() |= attempt.scene_is_reachable == Some(true);
    }
    let mut methods: Vec<MethodAttempts> =
        groups.into_values().map(|own| of_method(&own)).collect();
    methods.sort_by(|a, b| {
        b.is_control.cmp(&a.is_control).then(a.is_moved().cmp(&b.is_moved())).then_with(|| {
            if a.is_control {
                return a.method.cmp(&b.method);
            }
            let of_seeds = |method: &MethodAttempts| method.seed_disc_px.unwrap_or(0.0);
            let value = |method: &MethodAttempts| method.success.map_or(-1.0, |s| s.value);
            (a.is_moved().then_some(&a.grasp_estimator))
                .cmp(&b.is_moved().then_some(&b.grasp_estimator))
                .then(of_seeds(a).total_cmp(&of_seeds(b)))
                .then(value(b).total_cmp(&value(a)))
        })
    });
    (scenes.len(), scenes.values().filter(|reachable| **reachable).count(), methods)
}

fn of_method(own: &[&Attempt]) -> MethodAttempts {
    let first = own[0];
    let mut outcomes = BTreeMap::new();
    for attempt in own {
        *outcomes.entry(attempt.outcome.clone()).or_insert(0) += 1;
    }
    let median = |value: &dyn Fn(&Attempt) -> Option<f64>| {
        stats::median(&own.iter().filter_map(|attempt| value(attempt)).collect::<Vec<_>>())
    };
    let answers: Vec<(f64, bool)> = own
        .iter()
        .filter(|attempt| attempt.outcome != outcome::NO_GRASP)
        .map(|attempt| {
            let stated_mm = attempt.grasp_sigma_mm.unwrap_or(f64::INFINITY);
            (stated_mm, attempt.outcome != outcome::SUCCESS)
        })
        .collect();
    let risk_coverage = stats::risk_coverage(&answers, own.len());
    let squares: Vec<f64> = own.iter().filter_map(|a| a.corner_rmse_px).map(|e| e * e).collect();
    MethodAttempts {
        method: first.method.clone(),
        camera: first.camera.clone(),
        is_control: first.is_control,
        seed_disc_px: first.seed_disc_px,
        grasp_estimator: first.grasp_estimator.clone(),
        asked: own.len(),
        executed: own.iter().filter(|attempt| attempt.executed).count(),
        success: success(own.iter().copied()),
        success_of_reachable: success(
            own.iter().copied().filter(|attempt| attempt.scene_is_reachable == Some(true)),
        ),
        outcomes,
        mean_risk: stats::mean_risk(&risk_coverage),
        risk_coverage,
        corner_rmse_px: (!squares.is_empty())
            .then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()),
        median_error_mm: median(&|attempt| attempt.grasp_error_mm),
        median_approach_error_deg: median(&|attempt| attempt.approach_error_deg),
    }
}

/// The share that succeeded, with its interval over scenes.
fn success<'a>(attempts: impl Iterator<Item = &'a Attempt>) -> Option<Estimate> {
    let mut scenes: BTreeMap<&str, [f64; 2]> = BTreeMap::new();
    for attempt in attempts {
        let [good, all] = scenes.entry(&attempt.scene).or_default();
        *good += f64::from(u8::from(attempt.outcome == outcome::SUCCESS));
        *all += 1.0;
    }
    let scenes: Vec<[f64; 2]> = scenes.into_values().collect();
    estimate(&scenes, &|[good, all]| (*all > 0.0).then(|| good / all))
}

/// The methods beside each other: px, mm, success, and why not.
pub fn table(summary: &AttemptSummary) -> Words {
    table_of(summary, |_| true)
}

/// Puts tables into a Markdown file, with the command that made them: between `<!-- results of PLAN: GRIPPER-ROBOT -->`
/// and `<!-- end of results -->` the controls and the methods, behind `GRIPPER-ROBOT moved` the corners that were moved.
///
/// # Errors
/// When the file has no such marks, names another table, or cannot be read or written.
pub fn splice(path: &Path, plan: &str, summary: &AttemptSummary) -> Result<()> {
    let name = format!("{}-{}", summary.gripper, summary.robot);
    let tables = [
        (name.clone(), table_of(summary, |method| !method.is_moved())),
        (format!("{name} moved"), table_of(summary, MethodAttempts::is_moved)),
    ];
    splice::splice(path, plan, &summary.command, &tables)
}

fn table_of(summary: &AttemptSummary, is_row: impl Fn(&MethodAttempts) -> bool) -> Words {
    let shown: Vec<&str> = outcome::CAUSES
        .into_iter()
        .filter(|cause| summary.methods.iter().any(|method| method.outcomes.contains_key(*cause)))
        .collect();
    let cameras = summary.methods.iter().filter_map(|method| method.camera.as_deref());
    let is_one_camera = cameras.collect::<std::collections::BTreeSet<_>>().len() < 2;
    let header = [
        "method",
        "corners px",
        "error mm",
        "approach deg",
        "success (95 %)",
        "of reachable (95 %)",
        "begun",
    ];
    let header = header.iter().chain(&shown).map(|name| name.replace('_', " "));
    let rows = summary.methods.iter().filter(|method| is_row(method)).map(|method| {
        let name = match &method.camera {
            Some(camera) if !is_one_camera => format!("{}, {camera}", method.method),
            _ => method.method.clone(),
        };
        let share = |share: Option<Estimate>| {
            between(share.map(|share| share.map(|share| 100.0 * share)), 0)
        };
        let first = [
            name,
            two_digits(method.corner_rmse_px),
            two_digits(method.median_error_mm),
            two_digits(method.median_approach_error_deg),
            share(method.success),
            share(method.success_of_reachable),
            format!("{} of {}", method.executed, method.asked),
        ];
        let counts = shown.iter().map(|cause| {
            method.outcomes.get(*cause).map_or_else(|| "-".to_owned(), usize::to_string)
        });
        first.into_iter().chain(counts).collect()
    });
    Words { header: header.collect(), rows: rows.collect() }
}

/// What its columns are.
pub const TABLE: &str = "success: of all that were asked for, in percent, (95 %) over scenes; of reachable: in scenes in \
     which the robot reaches a true grasp of some face in view; corners: root mean square error of those answered; error \
     and approach: medians against the chosen face; behind: how often each thing went wrong; true: made from the truth, \
     as the robot would have to know it";

/// What all of it comes to, in a sentence.
pub fn finding(summary: &AttemptSummary) -> String {
    let share = percent(Some(summary.reachable as f64 / summary.scenes.max(1) as f64));
    let best = summary.methods.iter().find(|method| !method.is_control && !method.is_moved());
    let best = best.map_or_else(String::new, |best| {
        let success = percent(best.success.map(|success| success.value));
        format!("; the best of the methods, {}, succeeds in {success} of all", best.method)
    });
    format!(
        "{} with {} reaches a true grasp in {} of {} scenes ({share}){best}",
        summary.robot, summary.gripper, summary.reachable, summary.scenes
    )
}

/// Writes the rows, their summary, the picture and the page into a folder, and returns the page.
///
/// # Errors
/// When they cannot be written.
pub fn write(folder: &Path, summary: &AttemptSummary, attempts: &[Attempt]) -> Result<PathBuf> {
    write_whole(&folder.join("attempts.parquet"), |path| write_attempts(path, attempts))?;
    write_json(&folder.join("summary.json"), summary)?;
    let text = |name: &str, text: &str| {
        write_whole(&folder.join(name), |path| {
            fs::write(path, text).map_err(Error::io(path, "write"))
        })
    };
    let picture = picture::success(summary)?;
    if let Some(picture) = &picture {
        text("success.svg", picture)?;
    }
    let risk = picture::risk(summary)?;
    if let Some(picture) = &risk {
        text("risk.svg", picture)?;
    }
    let content = json!({
        "finding": finding(summary),
        "summary": summary,
        "table_words": table(summary),
        "words": TABLE,
        "has_picture": picture.is_some(),
        "has_risk": risk.is_some(),
    });
    text("index.html", &html::page(html::ATTEMPTS, &content)?)?;
    Ok(folder.join("index.html"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attempt(scene: &str, method: &str, came_to: &str, reachable: bool) -> Attempt {
        Attempt {
            scene: scene.into(),
            method: method.into(),
            camera: Some("ideal".into()),
            outcome: came_to.into(),
            scene_is_reachable: Some(reachable),
            corner_rmse_px: Some(if scene == "a" { 3.0 } else { 4.0 }),
            ..Attempt::default()
        }
    }

    #[test]
    fn success_is_of_all_asked_for_and_apart_of_what_can_be_reached() {
        let control =
            Attempt { is_control: true, camera: None, ..attempt("a", "true", "success", true) };
        let attempts = [
            control,
            attempt("a", "m", outcome::SUCCESS, true),
            attempt("b", "m", outcome::NO_GRASP, true),
            attempt("c", "m", outcome::WALL, false),
            attempt("a", "n", outcome::SUCCESS, true),
            attempt("b", "n", outcome::SUCCESS, true),
            attempt("c", "n", outcome::DROPPED, false),
        ];
        let (scenes, reachable, methods) = summarise(&attempts);
        assert_eq!((scenes, reachable), (3, 2));
        let names: Vec<&str> = methods.iter().map(|method| method.method.as_str()).collect();
        assert_eq!(names, ["true", "n", "m"]);
        let m = &methods[2];
        assert_eq!(m.success.map(|share| share.value), Some(1.0 / 3.0));
        assert_eq!(m.success_of_reachable.map(|share| share.value), Some(0.5));
        assert_eq!(m.outcomes[outcome::WALL], 1);
        // Of two answers, which state nothing of themselves, one is wrong; nothing is answered of scene b.
        assert_eq!(m.risk_coverage, [Selective { coverage: 2.0 / 3.0, risk: 0.5 }]);
        let rmse_px = m.corner_rmse_px.expect("corners");
        assert!((rmse_px - (41.0_f64 / 3.0).sqrt()).abs() < 1e-12, "{rmse_px}");
    }
}
