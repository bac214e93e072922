//! `scene.json`: all that was resolved about a scene.

use serde::{Deserialize, Serialize};

use crate::geometry::{Camera, Pose, PoseRows, pose_from_rows};

/// What of scene.json the harness needs; keys that it does not know are for people.
#[derive(Clone, Debug, Deserialize)]
pub struct Description {
    /// Version of the dataset format.
    pub format: u32,
    /// The family the scene was drawn from.
    pub family: String,
    /// Whether it is to develop on or to test on.
    pub split: Split,
    /// The name of the camera's pose.
    pub pose: String,
    /// The colour camera.
    pub camera: Camera,
    /// Its pose.
    #[serde(deserialize_with = "pose")]
    pub world_from_camera: Pose,
    /// Its lens; a pinhole where there is none.
    pub lens: Option<Lens>,
    /// The range sensor.
    pub range_camera: Camera,
    /// Rays per cell of the range sensor and direction, beside the one through its centre.
    pub range_oversampling: u32,
    /// Its pose.
    #[serde(deserialize_with = "pose")]
    pub world_from_range: Pose,
    /// The film.
    pub film: FilmDescription,
    /// The target.
    pub target: TargetDescription,
}

/// What a scene is for; scenes of the two splits share no material, light or background.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// To develop on.
    Dev,
    /// To test on.
    Test,
}

impl Split {
    /// The name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dev => "dev",
            Self::Test => "test",
        }
    }
}

/// A thin lens.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct Lens {
    /// Radius of the aperture \[m\].
    pub aperture_radius_m: f64,
    /// Distance of the plane in focus \[m\].
    pub focus_distance_m: f64,
}

/// How the film was rendered.
#[derive(Clone, Debug, Deserialize)]
pub struct FilmDescription {
    /// Film cells per pixel and direction.
    pub oversampling: u32,
    /// Where the film is fine: first column, first row, one past the last column and row \[px\].
    pub fovea_px: [u32; 4],
}

/// The target.
#[derive(Clone, Debug, Deserialize)]
pub struct TargetDescription {
    /// Its id in the geometry buffer.
    pub object_id: u32,
    /// What it is.
    pub kind: TargetKind,
    /// Dimensions along its own axes \[m\].
    pub size_m: [f64; 3],
    /// Radius of its rounded edges \[m\], 0 where they are sharp.
    pub bevel_radius_m: f64,
    /// Where it stands.
    #[serde(deserialize_with = "pose")]
    pub world_from_target: Pose,
}

/// What carries the true corners.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TargetKind {
    /// A cuboid.
    Cuboid,
    /// A checkerboard.
    Board,
}

impl TargetKind {
    /// The name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cuboid => "cuboid",
            Self::Board => "board",
        }
    }
}

fn pose<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Pose, D::Error> {
    let rows = PoseRows::deserialize(deserializer)?;
    pose_from_rows(&rows)
        .ok_or_else(|| serde::de::Error::custom("not a rotation and a translation: not a pose"))
}
