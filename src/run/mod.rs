//! Executes a plan over a dataset: every scene photographed, every pipeline run, every answer scored.

pub mod limits;
mod photographs;
mod pictures;
mod score;

use std::fs;
use std::path::Path;

use rayon::prelude::*;

use crate::bound::{Seeing, corner_bounds};
use crate::error::{Error, Result};
use crate::files::{replace_folder, write_json, write_whole};
use crate::grasp::{Face, Grasp, NoFace, NoGrasp};
use crate::metrics::Seen;
use crate::plan::{GraspStages, Pipeline, Plan, Stage};
use crate::record::{RECORD_VERSION, Record, RunDescription, kind, status, write_records};
use crate::refine::Corner;
use crate::scene::{Dataset, Description, Scene, Split};
use crate::sensor::{Exposure, RangeImage, RangeSensor, Rig};
use crate::target::{NoTarget, TargetRegion};

use score::Scorer;

pub use photographs::{Photographs, Wanted, photograph};

/// What a run did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Scenes that were measured.
    pub scenes: usize,
    /// Scenes that could not be read.
    pub unreadable: usize,
}

/// Measures every scene of `dataset`, or of one split of it, by every pipeline of `plan` and writes
/// the run's folder:
/// run.json, records.parquet and scenes/. Scenes are done in parallel; the rows' order is the
/// plan's, whatever the number of threads. `on_scene` is called as each is done.
///
/// # Errors
/// When the folder cannot be written. A scene that cannot be read is a row, not an error.
pub fn measure(
    plan: &Plan,
    dataset: &Dataset,
    split: Option<Split>,
    output: &Path,
    command: &str,
    on_scene: &(dyn Fn(&str) + Sync),
) -> Result<Outcome> {
    let pictures = output.join("scenes");
    if !output.join("run.json").exists() && (pictures.exists() || output.join("report").exists()) {
        return Err(Error::Other(format!(
            "{}: holds scenes or report, but no run.json: it is not a run and would be overwritten; \
             choose another folder with -o",
            output.display()
        )));
    }
    replace_folder(&pictures)?;
    // A scene whose description cannot be read is no less unreadable for belonging to either split.
    let is_wanted = |name: &&str| {
        split
            .is_none_or(|wanted| dataset.describe(name).map_or(true, |scene| scene.split == wanted))
    };
    let scenes: Vec<&str> = dataset.scenes().filter(is_wanted).collect();
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
        pipelines: plan.pipelines.iter().map(Pipeline::description).collect(),
        camera_model: plan.photographer.model().clone(),
        suite: dataset.suite().to_owned(),
        camera: plan.camera.clone(),
        range_sensor_model: plan.range_sensor_model.clone(),
        range_sensor: plan.range_sensor.clone(),
        gate_px: plan.corner_rule.gate_px,
        least_edge_px: plan.corner_rule.least_edge_px,
        most_bound_px: plan.corner_rule.most_bound_px,
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
    let film_camera = scene.description.camera;
    let name = [dataset.suite(), &scene.name, "0"];
    let photograph = match plan.photographer.take(&scene.film, &film_camera, [0.0, 0.0], &name) {
        Ok(photograph) => photograph,
        // The lens folds this scene's image, not necessarily another's.
        Err(error) => return Ok(vec![unreadable(plan, dataset, &scene.name, &error)]),
    };
    let truth = scene.truth.seen_by(&film_camera, &photograph.camera);
    let noise_free = plan.photographer.noise_free(&photograph);
    let exposure = photograph.exposure;
    let rig =
        Rig { camera: photograph.camera, world_from_camera: scene.description.world_from_camera };
    let range = match range_image(&plan.range_sensor_model, scene, &name) {
        Ok(range) => range,
        Err(error) => return Ok(vec![unreadable(plan, dataset, &scene.name, &error)]),
    };
    fs::create_dir_all(folder).map_err(Error::io(folder, "create"))?;
    pictures::write_exposure(&folder.join("exposure.png"), &exposure)?;
    let depth_range_m = pictures::write_depth(&folder.join("depth.png"), &scene.geometry.depth_m)?;
    let colour = plan.photographer.model().colour;
    let seeing = Seeing { exposure: &noise_free, colour, blur_px: photograph.blur_px };
    let bounds = corner_bounds(&truth, &rig, &seeing);
    let scorer = Scorer {
        seen: Seen::new(scene, &truth, bounds, &rig),
        rig: &rig,
        rule: plan.corner_rule,
        gain: plan.photographer.model().gain,
    };
    let mut records = Vec::new();
    for pipeline in &plan.pipelines {
        let answers = Answers::of(pipeline, &exposure, &rig, &range);
        let template = template(plan, pipeline, dataset, scene);
        records.extend(scorer.records(&template, &answers));
        // What a report draws: the way to a grasp.
        if pipeline.grasp.is_none() {
            continue;
        }
        let sketch = score::sketch(scene, &truth, &answers, depth_range_m);
        if let Some(Ok(region)) = &answers.region {
            let path = folder.join(format!("{}-target.png", pipeline.name));
            pictures::write_target(&path, &exposure, region)?;
        }
        write_json(&folder.join(format!("{}.json", pipeline.name)), &sketch)?;
    }
    Ok(records)
}

/// What a range sensor tells of a scene; `name` names its noise.
fn range_image(sensor: &RangeSensor, scene: &Scene, name: &[&str]) -> Result<RangeImage> {
    let Description { range_camera, world_from_range, .. } = &scene.description;
    sensor.measure(&scene.range, range_camera, *world_from_range, name)
}

/// What a pipeline answered to one exposure, stage by stage.
struct Answers {
    /// `None` of a pipeline that searches the whole image.
    region: Option<std::result::Result<TargetRegion, NoTarget>>,
    corners: Vec<Corner>,
    /// `None` of a pipeline that ends with corners.
    grasp: Option<GraspAnswer>,
}

/// How far a pipeline came on the way to a grasp.
enum GraspAnswer {
    NoTarget(NoTarget),
    NoCorner,
    NoFace(NoFace),
    NoRange(Face, NoGrasp),
    Grasp(Face, Grasp),
}

impl Answers {
    /// Runs the pipeline. It sees the exposure, the rig and the range image; no truth.
    fn of(pipeline: &Pipeline, exposure: &Exposure, rig: &Rig, range: &RangeImage) -> Self {
        let region = pipeline.target.as_ref().map(|target| target.algorithm.extract(exposure));
        let detect = |region| {
            let detections = pipeline.detect.algorithm.detect(exposure, region);
            pipeline.refine.algorithm.refine(exposure, &detections)
        };
        let corners = match &region {
            None => detect(None),
            Some(Ok(region)) => detect(Some(region)),
            Some(Err(_)) => Vec::new(),
        };
        let grasp = match (&pipeline.grasp, &region) {
            (Some(_), Some(Err(reason))) => Some(GraspAnswer::NoTarget(*reason)),
            (Some(stages), Some(Ok(region))) => {
                Some(GraspAnswer::of(stages, exposure, region, &corners, rig, range))
            }
            _ => None,
        };
        Self { region, corners, grasp }
    }
}

impl GraspAnswer {
    fn of(
        stages: &GraspStages,
        exposure: &Exposure,
        region: &TargetRegion,
        corners: &[Corner],
        rig: &Rig,
        range: &RangeImage,
    ) -> Self {
        if corners.is_empty() {
            return Self::NoCorner;
        }
        match stages.face.algorithm.select(exposure, region, corners) {
            Err(reason) => Self::NoFace(reason),
            Ok(face) => match stages.point.algorithm.estimate(&face, rig, range) {
                Err(reason) => Self::NoRange(face, reason),
                Ok(grasp) => Self::Grasp(face, grasp),
            },
        }
    }

    /// The face that was chosen.
    fn face(&self) -> Option<&Face> {
        match self {
            Self::NoRange(face, _) | Self::Grasp(face, _) => Some(face),
            _ => None,
        }
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
        split: Some(scene.description.split.name().to_owned()),
        camera: plan.camera.clone(),
        method: pipeline.name.clone(),
        target_extractor: pipeline.target.as_ref().map(Stage::label),
        detector: pipeline.detect.label(),
        refiner: pipeline.refine.label(),
        face_selector: pipeline.grasp.as_ref().map(|grasp| grasp.face.label()),
        grasp_estimator: pipeline.grasp.as_ref().map(|grasp| grasp.point.label()),
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
