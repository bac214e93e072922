//! Attempt: a grasp that was carried out in physics, one flat row; beside the records, which it is made from.

use std::path::Path;

use parquet_derive::ParquetRecordWriter;

use super::{Record, write_rows};
use crate::error::Result;

/// What became of it: the words of column `outcome`.
pub mod outcome {
    /// Approached, closed, lifted, held.
    pub const SUCCESS: &str = "success";
    /// There was no grasp to carry out.
    pub const NO_GRASP: &str = "no_grasp";
    /// The gripper does not open so far.
    pub const TOO_WIDE: &str = "too_wide";
    /// The robot cannot get there from anywhere: out of reach, or its own platform is in the way.
    pub const UNREACHABLE: &str = "unreachable";
    /// It would bump into the floor.
    pub const GROUND: &str = "ground";
    /// It would bump into, or drags the target along, a wall.
    pub const WALL: &str = "wall";
    /// The same of what stands around.
    pub const CLUTTER: &str = "clutter";
    /// It bumped into the target before the jaws closed.
    pub const TARGET: &str = "target";
    /// The jaws closed on nothing.
    pub const NO_CONTACT: &str = "no_contact";
    /// The target moved between the jaws.
    pub const SLIPPED: &str = "slipped";
    /// It fell out of them, or did not rise.
    pub const DROPPED: &str = "dropped";
    /// The scene could not be rebuilt, its process died, or the simulation diverged.
    pub const FAILED: &str = "failed";

    /// All but success and what was never carried out, in the order in which things go wrong.
    pub const CAUSES: [&str; 11] = [
        NO_GRASP,
        TOO_WIDE,
        UNREACHABLE,
        GROUND,
        WALL,
        CLUTTER,
        TARGET,
        NO_CONTACT,
        SLIPPED,
        DROPPED,
        FAILED,
    ];
}

/// One row of RUN/grasps/NAME/attempts.parquet: a grasp of a run, or a control.
#[derive(Clone, Debug, Default, PartialEq, ParquetRecordWriter)]
pub struct Attempt {
    /// The scene.
    pub scene: String,
    /// The family the scene was drawn from.
    pub family: String,
    /// "dev" or "test".
    pub split: Option<String>,
    /// Name of the camera model; none of a control.
    pub camera: Option<String>,
    /// Which of the camera's photographs of the scene; none of a control.
    pub exposure: Option<i32>,
    /// Name of the pipeline, or of the control: the true grasp of the least occluded face, "true: least occluded"; the
    /// first true one that the robot reaches, "true: reachable"; that one moved by 3 cm, "true: moved 30 mm".
    pub method: String,
    /// Whether it is made from the truth.
    pub is_control: bool,
    /// On the refinement track the radius of the disc about the true corner in which seeds are \[px\].
    pub seed_disc_px: Option<f64>,
    /// Grasp estimator and its version; none of a control.
    pub grasp_estimator: Option<String>,
    /// Name of the gripper.
    pub gripper: String,
    /// Name of the robot.
    pub robot: String,
    /// One of [`outcome`].
    pub outcome: String,
    /// Why there was none, where the outcome alone does not say it.
    pub reason: Option<String>,
    /// Whether the robot moved at all: nothing hindered it that it knew before.
    pub executed: bool,
    /// Whether the robot reaches a true grasp of any face in view.
    pub scene_is_reachable: Option<bool>,
    /// Root mean square error of the photograph's corners that were answered \[px\].
    pub corner_rmse_px: Option<f64>,
    /// Distance of the grasp point from the true centre of the chosen face \[mm\].
    pub grasp_error_mm: Option<f64>,
    /// What the method says of that error \[mm\].
    pub grasp_sigma_mm: Option<f64>,
    /// Between the approach and the true face's normal \[deg\].
    pub approach_error_deg: Option<f64>,
    /// Whether the chosen face is the least occluded one.
    pub face_is_right: Option<bool>,
    /// How far the target was moved before the jaws closed \[mm\].
    pub pushed_mm: Option<f64>,
    /// How far it moved between the jaws from when they had closed to the end \[mm\].
    pub slip_mm: Option<f64>,
    /// How far it turned there \[deg\].
    pub slip_deg: Option<f64>,
}

impl Attempt {
    /// The attempt of a record of kind grasp, to which nothing has happened yet.
    pub fn of(record: &Record) -> Self {
        Self {
            scene: record.scene.clone(),
            family: record.family.clone(),
            split: record.split.clone(),
            camera: Some(record.camera.clone()),
            exposure: record.exposure,
            method: record.method.clone(),
            seed_disc_px: record.seed_disc_px,
            grasp_estimator: record.grasp_estimator.clone(),
            grasp_error_mm: record.grasp_error_mm,
            grasp_sigma_mm: record.grasp_sigma_mm,
            approach_error_deg: record.approach_error_deg,
            face_is_right: record.face_is_right,
            ..Self::default()
        }
    }
}

/// Writes attempts as one Parquet file.
///
/// # Errors
/// [`Error::Io`](crate::error::Error::Io), or [`Error::Malformed`](crate::error::Error::Malformed) from the encoder.
pub fn write_attempts(path: &Path, attempts: &[Attempt]) -> Result<()> {
    write_rows(path, attempts)
}
