//! `scene.json`: all that was resolved about a scene.

use serde::Deserialize;

use crate::geometry::{Camera, Pose, PoseRows, pose_from_rows};

/// What of scene.json the harness needs; keys that it does not know are for people.
#[derive(Clone, Debug, Deserialize)]
pub struct Description {
    /// Version of the dataset format.
    pub format: u32,
    /// The family the scene was drawn from.
    pub family: String,
    /// The name of the camera's pose.
    pub pose: String,
    /// The colour camera.
    pub camera: Camera,
    /// The range sensor; it shares the colour camera's pose.
    pub range_camera: Camera,
    /// Pose of both.
    #[serde(deserialize_with = "pose")]
    pub world_from_camera: Pose,
    /// The film.
    pub film: FilmDescription,
    /// The target.
    pub target: TargetDescription,
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
    /// Dimensions along its own axes \[m\].
    pub size_m: [f64; 3],
    /// Where it stands.
    #[serde(deserialize_with = "pose")]
    pub world_from_cuboid: Pose,
}

fn pose<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<Pose, D::Error> {
    let rows = PoseRows::deserialize(deserializer)?;
    pose_from_rows(&rows)
        .ok_or_else(|| serde::de::Error::custom("not a rotation and a translation: not a pose"))
}
