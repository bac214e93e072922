//! What a run's folder says of it beside the records: run.json, and what reports draw.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::geometry::{ImagePoint, Origin};
use crate::sensor::{CameraModel, RangeSensor, Transfer};

/// How a run came about; stands in RUN/run.json.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RunDescription {
    /// Version of cornerbench.
    pub cornerbench_version: String,
    /// Name of the plan.
    pub plan: String,
    /// Every pipeline with its algorithms' names, versions and parameters, defaults included.
    pub pipelines: Vec<serde_json::Value>,
    /// The cameras by name.
    pub cameras: BTreeMap<String, CameraModel>,
    /// Places of the pixels' grid on the image.
    pub phases: u32,
    /// Photographs at each.
    pub repeats: u32,
    /// Of drawn junctions the cells, each with all that sets it apart.
    pub cells: Vec<serde_json::Value>,
    /// The suite that was measured; "drawn"; of pictures of one's own their folder's name.
    pub suite: String,
    /// Its scenes, or those of one split, in the order of the records; of drawn junctions the cells, each by a camera.
    /// Of a shard too, which has only some.
    pub scenes: Vec<String>,
    /// Which of them were measured, where not all: every N-th from number I, "I/N".
    pub shard: Option<String>,
    /// Scenes of which something could not be read or photographed.
    pub unreadable: Vec<String>,
    /// Hash of all that decides what is measured: runs of one hash can be merged.
    pub identity_sha256: String,
    /// The range sensor's values.
    pub range_sensor_model: RangeSensor,
    /// Name of the range sensor.
    pub range_sensor: String,
    /// How far a detection may lie from the corner it is matched to \[px\].
    pub gate_px: f64,
    /// How far two edges of a corner must be seen for it to be asked for \[px\].
    pub least_edge_px: f64,
    /// The largest bound on a corner's place with which it is asked for \[px\].
    pub most_bound_px: f64,
    /// The command line.
    pub command: String,
    /// Operating system and processor architecture.
    pub machine: String,
    /// The scenes' renderers: "mitsuba 3.9.1 llvm_ad_rgb".
    pub renderers: Vec<String>,
    /// The other programs in the pipelines: how they are started and what they said of themselves.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub programs: Vec<serde_json::Value>,
    /// How often pipelines with them had no answer, and why.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failures: Vec<FailureCount>,
    /// What is known of pictures of one's own, if that is what was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pictures: Option<PicturesDescription>,
}

/// How often a method had no answer, for another program gave none, or did not end well; stands in RUN/run.json.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FailureCount {
    /// The method.
    pub method: String,
    /// What went wrong, as records have it: "timed_out".
    pub status: String,
    /// Photographs, or ends of the program.
    pub count: usize,
    /// The scenes, each once; of an end of the program none.
    pub scenes: Vec<String>,
    /// Why, the first time.
    pub reason: String,
}

impl FailureCount {
    /// Whether it is of the program's end, when all photographs were answered or not.
    pub fn is_of_the_end(&self) -> bool {
        self.scenes.is_empty()
    }

    /// In a sentence.
    pub fn words(&self) -> String {
        let Self { method, status, count, scenes, reason } = self;
        if self.is_of_the_end() {
            return format!("{method} did not end well ({status}): {reason}");
        }
        let times = if *count == 1 { "once".to_owned() } else { format!("{count} times") };
        let shown: Vec<&str> = scenes.iter().take(3).map(String::as_str).collect();
        let more = scenes.len() - shown.len();
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        format!("{method} had no answer {times} of {}{more} ({status}): {reason}", shown.join(", "))
    }
}

impl RunDescription {
    /// Photographs to which other programs of a method gave no answer.
    pub fn unanswered(&self, method: &str) -> usize {
        let own = self.failures.iter().filter(|failure| failure.method == method);
        own.filter(|failure| !failure.is_of_the_end()).map(|failure| failure.count).sum()
    }
}

/// What is known of pictures of one's own; stands in RUN/run.json.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct PicturesDescription {
    /// Those in which nobody knows a corner, by name.
    pub without_known_corners: Vec<String>,
    /// What the known corners were taken to be counted from.
    pub origin: Origin,
    /// The curve from light to samples that was given, if any.
    pub transfer: Option<Transfer>,
    /// The value of full scale that was given, if any.
    pub white: Option<f64>,
}

/// Reads RUN/run.json.
///
/// # Errors
/// When it is missing or not one.
pub fn read_run(run: &Path) -> Result<RunDescription> {
    read_json(&run.join("run.json"))
}

/// Reads what a report draws of one scene and method of a run.
///
/// # Errors
/// When it is missing or not one.
pub fn read_sketch(run: &Path, scene: &str, camera: &str, method: &str) -> Result<Sketch> {
    read_json(&pictures_folder(run, scene, camera).join(format!("{method}.json")))
}

/// Where a run keeps what a report draws of a scene's first photograph by a camera.
pub fn pictures_folder(run: &Path, scene: &str, camera: &str) -> PathBuf {
    run.join("scenes").join(scene).join(camera)
}

pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let bytes = std::fs::read(path).map_err(Error::io(path, "read"))?;
    serde_json::from_slice(&bytes).map_err(|error| Error::malformed(path, error))
}

/// What a report draws of one scene and method, beside its records; RUN/scenes/SCENE/CAMERA/METHOD.json.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Sketch {
    /// The scene.
    pub scene: String,
    /// Size of the exposure \[px\].
    pub width: u32,
    /// Size of the exposure \[px\].
    pub height: u32,
    /// Nearest and farthest depth of the depth picture \[m\].
    pub depth_range_m: [f64; 2],
    /// The true cuboid's edges that face the camera, as drawn by the projection \[px\].
    pub true_edges: Vec<[ImagePoint; 2]>,
    /// The least occluded true face \[px\].
    pub true_face: Option<[ImagePoint; 4]>,
    /// The true centre of the face that the grasp was scored against \[px\].
    pub true_grasp: Option<ImagePoint>,
    /// The circumscribed quadrilateral \[px\].
    pub quadrilateral: Option<[ImagePoint; 4]>,
    /// Columns and rows of the target: first column, first row, last column, last row \[px\].
    pub target_range: Option<[u32; 4]>,
    /// Pixels of the target.
    pub target_pixels: u32,
    /// The chosen face \[px\].
    pub face: Option<[ImagePoint; 4]>,
    /// The image point whose range was looked up \[px\].
    pub grasp: Option<ImagePoint>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failures_name_how_often_and_the_first_scenes_and_an_end_is_no_photograph() {
        let failure = |count: usize, scenes: &[&str]| FailureCount {
            method: "mine".into(),
            status: "crashed".into(),
            count,
            scenes: scenes.iter().map(|&scene| scene.to_owned()).collect(),
            reason: "gone".into(),
        };
        for (failure, words) in [
            (failure(1, &["a"]), "mine had no answer once of a (crashed): gone"),
            (
                failure(7, &["a", "b", "c", "d"]),
                "mine had no answer 7 times of a, b, c and 1 more (crashed): gone",
            ),
            (failure(1, &[]), "mine did not end well (crashed): gone"),
        ] {
            assert_eq!(failure.words(), words);
        }
    }
}
