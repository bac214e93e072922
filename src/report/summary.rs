//! Records -> what they say, in numbers.

use std::collections::HashSet;
use std::hash::Hash;

use serde::Serialize;

use crate::record::{Record, RunDescription, Timing, kind, status};
use crate::report::agreement::Agreement;
use crate::report::contest::{Contest, contests};
use crate::report::detection::{self, DetectionSummary};
use crate::report::grasps::{self, GraspSummary};
use crate::report::records::is_scored;
use crate::report::refinement::{self, Answer, RefinementSummary, answers};
use crate::stats;

/// What a run's records say; RUN/summary.json.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Scenes that could not be read, each with its reason.
    pub unreadable: Vec<Unreadable>,
    /// One per camera and pipeline, in the order of the records.
    pub methods: Vec<MethodSummary>,
    /// Those of them that were given the same, beside each other.
    pub contests: Vec<Contest>,
    /// Methods beside each other on pictures of one's own whose corners nobody knows.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub agreements: Vec<Agreement>,
    /// What pipelines took, where that was measured. Times are never the same twice: they are not in the file.
    #[serde(skip)]
    pub timing: Option<Timing>,
}

/// A scene that could not be read.
#[derive(Clone, Debug, Serialize)]
pub struct Unreadable {
    /// Its name.
    pub scene: String,
    /// Why.
    pub reason: String,
}

/// What the records say of one pipeline and camera.
#[derive(Clone, Debug, Serialize)]
pub struct MethodSummary {
    /// Its name.
    pub method: String,
    /// The camera.
    pub camera: String,
    /// What reports call both: the method's name alone where there is one camera; behind it how many photographs are
    /// unanswered.
    pub label: String,
    /// Photographs, of all cameras, to which another program of it gave no answer.
    pub unanswered: usize,
    /// What is judged, as records have it.
    pub track: String,
    /// Detector and version; none on the refinement track.
    pub detector: Option<String>,
    /// Refiner and version.
    pub refiner: String,
    /// The disc of the seeds, if they were given \[px\].
    pub seed_disc_px: Option<f64>,
    /// Over all scenes.
    pub corners: CornerSummary,
    /// Over all scenes: corners against the rest.
    pub detection: DetectionSummary,
    /// Over all scenes: what the refiner made of the corners that were found.
    pub refinement: RefinementSummary,
    /// Over all scenes; none of a pipeline that ends with corners.
    pub grasps: Option<GraspSummary>,
    /// Scene by scene.
    pub scenes: Vec<SceneSummary>,
}

/// One scene and pipeline.
#[derive(Clone, Debug, Serialize)]
pub struct SceneSummary {
    /// Its name.
    pub scene: String,
    /// Share of the target's image area that nothing hides.
    pub target_visible_fraction: Option<f64>,
    /// Its corners.
    pub corners: CornerSummary,
    /// What became of the grasp.
    pub grasp_status: String,
    /// Why, where the status alone does not say it.
    pub grasp_reason: Option<String>,
    /// Whether the least occluded face was chosen; none where no face was.
    pub face_is_right: Option<bool>,
    /// Distance of the grasp point from the true face's centre \[mm\].
    pub grasp_error_mm: Option<f64>,
    /// Its part along the optical axis \[mm\].
    pub grasp_axial_error_mm: Option<f64>,
    /// Its part across the optical axis \[mm\].
    pub grasp_lateral_error_mm: Option<f64>,
}

/// Corners asked for, found, missed, false, and how far the found ones are off.
#[derive(Clone, Debug, Default, Serialize)]
pub struct CornerSummary {
    /// Visible corners: those asked for.
    pub visible: usize,
    /// Visible corners that were found.
    pub found: usize,
    /// Visible corners that were not.
    pub missed: usize,
    /// Answers where no corner is.
    pub false_corners: usize,
    /// Answers at occluded corners, neither right nor wrong.
    pub ignored: usize,
    /// Found corners that the refiner gave an answer for; the others keep the detector's position.
    pub refined: usize,
    /// Found corners whose refined position is closer to the truth than the detector's.
    pub improved: usize,
    /// The detector's errors over the found corners.
    pub detected: Option<Errors>,
    /// The refiner's errors over the same corners.
    pub refined_errors: Option<Errors>,
}

/// Distances from the truth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Errors {
    /// Root mean square \[px\].
    pub rmse_px: f64,
    /// Median \[px\].
    pub median_px: f64,
    /// Largest \[px\].
    pub max_px: f64,
}

/// Summarises records whose answers were matched within `gate_px`.
pub fn summarise(records: &[Record], gate_px: f64) -> Summary {
    let unreadable = records
        .iter()
        .filter(|record| record.kind == kind::SCENE)
        .map(|record| Unreadable {
            scene: record.scene.clone(),
            reason: record.reason.clone().unwrap_or_default(),
        })
        .collect();
    let measured = || records.iter().filter(|record| is_scored(record));
    let methods = distinct(measured().map(|r| (r.camera.as_str(), r.method.as_str())));
    let cameras = distinct(measured().map(|record| record.camera.as_str()));
    let of_method = |&(camera, method): &(&str, &str)| {
        let rows: Vec<&Record> =
            measured().filter(|r| r.method == method && r.camera == camera).collect();
        (summarise_method(&rows, &cameras, gate_px), answers(&rows))
    };
    let (methods, answers): (Vec<_>, Vec<_>) = methods.iter().map(of_method).unzip();
    Summary::of(unreadable, methods, &answers)
}

impl Summary {
    /// Of methods, each with its answers for the corners that it was given.
    pub(super) fn of(
        unreadable: Vec<Unreadable>,
        methods: Vec<MethodSummary>,
        answers: &[Vec<Answer>],
    ) -> Self {
        let contests = contests(&methods, answers);
        Self { unreadable, methods, contests, agreements: Vec::new(), timing: None }
    }
}

/// Summarises the records of one method; `cameras` are those of the run.
pub(super) fn summarise_method(
    records: &[&Record],
    cameras: &[&str],
    gate_px: f64,
) -> MethodSummary {
    let scenes = distinct(records.iter().map(|record| record.scene.as_str()))
        .iter()
        .map(|scene| {
            let of_scene: Vec<&Record> =
                records.iter().copied().filter(|record| record.scene == *scene).collect();
            let grasp = of_scene.iter().find(|record| record.kind == kind::GRASP);
            SceneSummary {
                scene: (*scene).to_owned(),
                target_visible_fraction: grasp.and_then(|g| g.target_visible_fraction),
                corners: corners(&of_scene),
                grasp_status: grasp.map(|g| g.status.clone()).unwrap_or_default(),
                grasp_reason: grasp.and_then(|g| g.reason.clone()),
                face_is_right: grasp.and_then(|g| g.face_is_right),
                grasp_error_mm: grasp.and_then(|g| g.grasp_error_mm),
                grasp_axial_error_mm: grasp.and_then(|g| g.grasp_axial_error_mm),
                grasp_lateral_error_mm: grasp.and_then(|g| g.grasp_lateral_error_mm),
            }
        })
        .collect();
    let of_first = |value: fn(&Record) -> &String| {
        records.first().map(|record| value(record).clone()).unwrap_or_default()
    };
    let (method, camera) = (of_first(|record| &record.method), of_first(|record| &record.camera));
    MethodSummary {
        label: if cameras.len() == 1 { method.clone() } else { format!("{method}, {camera}") },
        unanswered: 0,
        method,
        camera,
        track: of_first(|record| &record.track),
        detector: records.first().and_then(|record| record.detector.clone()),
        refiner: of_first(|record| &record.refiner),
        seed_disc_px: records.first().and_then(|record| record.seed_disc_px),
        corners: corners(records),
        detection: detection::summarise(records, gate_px),
        refinement: refinement::summarise(records),
        grasps: grasps::summarise(records),
        scenes,
    }
}

impl MethodSummary {
    /// It, with what its other programs did not answer in its run.
    pub(super) fn of_run(self, run: &RunDescription) -> Self {
        match run.unanswered(&self.method) {
            0 => self,
            unanswered => Self {
                label: format!("{}, {unanswered} unanswered", self.label),
                unanswered,
                ..self
            },
        }
    }
}

fn corners(records: &[&Record]) -> CornerSummary {
    let count = |kind: &str, status: &str| {
        records.iter().filter(|r| r.kind == kind && r.status == status).count()
    };
    let pairs: Vec<(f64, f64)> = records
        .iter()
        .filter_map(|record| Some((record.detected_error_px?, record.refined_error_px?)))
        .collect();
    let answered = |record: &&&Record| {
        record.kind == kind::CORNER
            && matches!(record.refine_status.as_deref(), Some("ok" | "max_iterations"))
    };
    let (found, missed) = (count(kind::CORNER, status::OK), count(kind::CORNER, status::MISSED));
    CornerSummary {
        visible: found + missed,
        found,
        missed,
        false_corners: count(kind::FALSE_CORNER, status::FALSE),
        ignored: count(kind::FALSE_CORNER, status::IGNORED),
        refined: records.iter().filter(answered).count(),
        improved: pairs.iter().filter(|(detected, refined)| refined < detected).count(),
        detected: Errors::of(&pairs.iter().map(|pair| pair.0).collect::<Vec<_>>()),
        refined_errors: Errors::of(&pairs.iter().map(|pair| pair.1).collect::<Vec<_>>()),
    }
}

impl Errors {
    /// Those of some distances \[px\]; `None` of none.
    pub fn of(distances_px: &[f64]) -> Option<Self> {
        Some(Self {
            rmse_px: stats::root_mean_square(distances_px)?,
            median_px: stats::median(distances_px)?,
            max_px: stats::quantile(distances_px, 1.0)?,
        })
    }
}

fn distinct<T: Copy + Eq + Hash>(values: impl Iterator<Item = T>) -> Vec<T> {
    let mut seen = HashSet::new();
    values.filter(|value| seen.insert(*value)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(status: &str, errors: Option<(f64, f64)>) -> Record {
        Record {
            scene: "a".into(),
            method: "paper".into(),
            kind: kind::CORNER.into(),
            status: status.into(),
            detected_error_px: errors.map(|pair| pair.0),
            refined_error_px: errors.map(|pair| pair.1),
            refine_status: errors.map(|_| "ok".into()),
            ..Record::default()
        }
    }

    #[test]
    fn errors_and_counts_are_those_of_the_rows() {
        let records = [
            corner(status::OK, Some((3.0, 1.0))),
            corner(status::OK, Some((1.0, 2.0))),
            corner(status::MISSED, None),
            corner(status::HIDDEN, None),
            Record { kind: kind::SCENE.into(), reason: Some("gone".into()), ..Record::default() },
        ];
        let summary = summarise(&records, 5.0);
        assert_eq!(summary.unreadable.len(), 1);
        let corners = &summary.methods[0].corners;
        assert_eq!((corners.visible, corners.found, corners.missed), (3, 2, 1));
        assert_eq!((corners.improved, corners.refined), (1, 2));
        let detected = corners.detected.expect("two");
        assert!((detected.rmse_px - 5.0_f64.sqrt()).abs() < 1e-12);
        assert!((detected.median_px - 2.0).abs() < 1e-12);
    }

    #[test]
    fn errors_of_no_found_corner_are_none() {
        let summary = summarise(&[corner(status::MISSED, None)], 5.0);
        assert_eq!(summary.methods[0].corners.detected, None);
    }
}
