//! Executes a plan over a dataset: every scene photographed, every pipeline run, every answer scored.

mod pictures;
mod score;

use std::fs;
use std::path::Path;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::files::write_whole;
use crate::plan::{Pipeline, Plan};
use crate::record::{RECORD_VERSION, Record, Sketch, kind, status, write_records};
use crate::scene::{Dataset, Scene};
use crate::sensor::{Exposure, RangeImage, Rig, expose};

/// How a run came about; stands in RUN/run.json.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RunDescription {
    /// Version of cornerbench.
    pub cornerbench_version: String,
    /// Name of the plan.
    pub plan: String,
    /// The suite that was measured.
    pub suite: String,
    /// Name of the camera model.
    pub camera: String,
    /// How far a detection may lie from the corner it is matched to \[px\].
    pub gate_px: f64,
    /// The command line.
    pub command: String,
    /// Operating system and processor architecture.
    pub machine: String,
    /// The scenes' renderers: "mitsuba 3.9.1 llvm_ad_rgb".
    pub renderers: Vec<String>,
}

/// What a run did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Scenes that were measured.
    pub scenes: usize,
    /// Scenes that could not be read.
    pub unreadable: usize,
}

/// Measures every scene of `dataset` by every pipeline of `plan` and writes the run's folder:
/// run.json, records.parquet and scenes/. Scenes are done in parallel; the rows' order is the
/// plan's, whatever the number of threads. `on_scene` is called as each is done.
///
/// # Errors
/// When the folder cannot be written. A scene that cannot be read is a row, not an error.
pub fn measure(
    plan: &Plan,
    dataset: &Dataset,
    output: &Path,
    command: &str,
    on_scene: &(dyn Fn(&str) + Sync),
) -> Result<Outcome> {
    let pictures = output.join("scenes");
    if pictures.exists() {
        fs::remove_dir_all(&pictures).map_err(Error::io(&pictures, "replace"))?;
    }
    fs::create_dir_all(&pictures).map_err(Error::io(&pictures, "create"))?;
    let scenes: Vec<&str> = dataset.scenes().collect();
    let rows: Vec<Vec<Record>> = scenes
        .par_iter()
        .map(|name| {
            let rows = match dataset.read(name) {
                Ok(scene) => measure_scene(plan, dataset, &scene, &pictures.join(name)),
                Err(error) => Ok(vec![unreadable(plan, dataset, name, &error)]),
            };
            on_scene(name);
            rows
        })
        .collect::<Result<_>>()?;
    let records: Vec<Record> = rows.into_iter().flatten().collect();
    write_whole(&output.join("records.parquet"), |path| write_records(path, &records))?;
    let mut renderers: Vec<String> = scenes
        .iter()
        .filter_map(|name| dataset.renderer(name))
        .map(|renderer| format!("{} {} {}", renderer.name, renderer.version, renderer.variant))
        .collect();
    renderers.sort();
    renderers.dedup();
    let description = RunDescription {
        cornerbench_version: env!("CARGO_PKG_VERSION").to_owned(),
        plan: plan.name.clone(),
        suite: dataset.suite().to_owned(),
        camera: plan.camera.clone(),
        gate_px: plan.gate_px,
        command: command.to_owned(),
        machine: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        renderers,
    };
    write_json(&output.join("run.json"), &description)?;
    let unreadable = records.iter().filter(|record| record.kind == kind::SCENE).count();
    Ok(Outcome { scenes: scenes.len() - unreadable, unreadable })
}

fn measure_scene(
    plan: &Plan,
    dataset: &Dataset,
    scene: &Scene,
    folder: &Path,
) -> Result<Vec<Record>> {
    let exposure = expose(&scene.film, &plan.camera_model);
    let rig = Rig {
        camera: scene.description.camera,
        world_from_camera: scene.description.world_from_camera,
    };
    let range =
        RangeImage { camera: scene.description.range_camera, points: scene.range_points.clone() };
    fs::create_dir_all(folder).map_err(Error::io(folder, "create"))?;
    pictures::write_exposure(&folder.join("exposure.png"), &exposure)?;
    let depth_range_m = pictures::write_depth(&folder.join("depth.png"), &scene.geometry.depth_m)?;
    let mut records = Vec::new();
    for pipeline in &plan.pipelines {
        let answers = Answers::of(pipeline, &exposure, &rig, &range);
        let template = template(plan, pipeline, dataset, scene);
        records.extend(score::records(&template, &scene.truth, &answers, &rig, plan.gate_px));
        let sketch = score::sketch(scene, &answers, depth_range_m);
        if let Ok(region) = &answers.region {
            let path = folder.join(format!("{}-target.png", pipeline.name));
            pictures::write_target(&path, &exposure, region)?;
        }
        write_json(&folder.join(format!("{}.json", pipeline.name)), &sketch)?;
    }
    Ok(records)
}

/// What a pipeline answered to one exposure, stage by stage.
struct Answers {
    region: std::result::Result<crate::target::TargetRegion, crate::target::NoTarget>,
    corners: Vec<crate::refine::Corner>,
    face: Option<std::result::Result<crate::grasp::Face, crate::grasp::NoFace>>,
    grasp: Option<std::result::Result<crate::grasp::Grasp, crate::grasp::NoGrasp>>,
}

impl Answers {
    /// Runs the pipeline. It sees the exposure, the rig and the range image; no truth.
    fn of(pipeline: &Pipeline, exposure: &Exposure, rig: &Rig, range: &RangeImage) -> Self {
        let region = pipeline.target.algorithm.extract(exposure);
        let corners = region.as_ref().map_or_else(
            |_| Vec::new(),
            |region| {
                let detections = pipeline.detect.algorithm.detect(exposure, Some(region));
                pipeline.refine.algorithm.refine(exposure, &detections)
            },
        );
        let face = match &region {
            Ok(region) if !corners.is_empty() => {
                Some(pipeline.face.algorithm.select(exposure, region, &corners))
            }
            _ => None,
        };
        let grasp = match &face {
            Some(Ok(face)) => Some(pipeline.grasp.algorithm.estimate(face, rig, range)),
            _ => None,
        };
        Self { region, corners, face, grasp }
    }
}

/// A record with everything that is the same for all rows of a scene and method.
fn template(plan: &Plan, pipeline: &Pipeline, dataset: &Dataset, scene: &Scene) -> Record {
    Record {
        record_version: RECORD_VERSION,
        cornerbench_version: env!("CARGO_PKG_VERSION").to_owned(),
        suite: dataset.suite().to_owned(),
        scene: scene.name.clone(),
        scene_recipe_sha256: scene.recipe_sha256.clone(),
        family: scene.description.family.clone(),
        pose: scene.description.pose.clone(),
        camera: plan.camera.clone(),
        method: pipeline.name.clone(),
        detector: pipeline.detect.label(),
        refiner: pipeline.refine.label(),
        target_visible_fraction: Some(scene.truth.target_visible_fraction),
        ..Record::default()
    }
}

fn unreadable(plan: &Plan, dataset: &Dataset, scene: &str, error: &Error) -> Record {
    Record {
        record_version: RECORD_VERSION,
        cornerbench_version: env!("CARGO_PKG_VERSION").to_owned(),
        suite: dataset.suite().to_owned(),
        scene: scene.to_owned(),
        camera: plan.camera.clone(),
        kind: kind::SCENE.to_owned(),
        status: status::UNREADABLE.to_owned(),
        reason: Some(error.chain()),
        ..Record::default()
    }
}

/// Reads the sketch of one scene and method of a run.
///
/// # Errors
/// When it is missing or not one.
pub fn read_sketch(run: &Path, scene: &str, method: &str) -> Result<Sketch> {
    let path = run.join("scenes").join(scene).join(format!("{method}.json"));
    let bytes = fs::read(&path).map_err(Error::io(&path, "read"))?;
    serde_json::from_slice(&bytes).map_err(|error| Error::malformed(&path, error))
}

/// Writes `content` as JSON, whole or not at all.
///
/// # Errors
/// [`Error::Io`].
pub fn write_json(path: &Path, content: &impl Serialize) -> Result<()> {
    let mut text =
        serde_json::to_string_pretty(content).map_err(|error| Error::malformed(path, error))?;
    text.push('\n');
    write_whole(path, |temporary| {
        fs::write(temporary, &text).map_err(Error::io(temporary, "write"))
    })
}
