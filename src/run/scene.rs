//! One scene: photographed by every camera, answered by every pipeline, scored.

use std::fs;
use std::path::Path;

use super::answers::Answers;
use super::given;
use super::pictures;
use super::score::{Scorer, of_pipeline, sketch, unreadable};
use crate::bound::{Seeing, corner_bounds};
use crate::detect::Detection;
use crate::error::{Error, Result};
use crate::files::write_json;
use crate::geometry::ImagePoint;
use crate::metrics::Seen;
use crate::plan::{Pipeline, Plan, Seeds, Shots};
use crate::random::Stream;
use crate::record::Record;
use crate::refine::Corner;
use crate::scene::{Description, Film, Scene, TrueCorner, Truth};
use crate::sensor::{
    Exposure, Kernel, PhotographBuffers, Photographer, RangeImage, RangeSensor, Rig, Shot,
};

/// The rows of a scene. What a report draws of each camera's first photograph goes into `folder`/CAMERA.
///
/// # Errors
/// When these cannot be written. What cannot be photographed is a row.
pub(super) fn measure(
    plan: &Plan,
    suite: &str,
    scene: &Scene,
    folder: Option<&Path>,
) -> Result<Vec<Record>> {
    let mut records = Vec::new();
    let mut buffers = PhotographBuffers::default();
    for camera in &plan.cameras {
        let folder = folder.map(|folder| folder.join(camera.name()));
        let bent = match camera.through_lens(&scene.film, &scene.description.camera) {
            Ok(bent) => bent,
            // The lens folds this scene's image, not necessarily another's.
            Err(error) => {
                records.push(unreadable(suite, &scene.name, camera.name(), &error));
                continue;
            }
        };
        let film = bent.as_ref().unwrap_or(&scene.film);
        for phase in 0..plan.shots.phases {
            let phase_px = Shots::phase_px(phase);
            let kernel = camera.kernel(film.oversampling, phase_px);
            let station = Station { plan, suite, scene, camera, kernel: &kernel, phase };
            for repeat in 0..plan.shots.repeats {
                let number = phase * plan.shots.repeats + repeat;
                let folder = folder.as_deref().filter(|_| number == 0);
                match station.rows(film, number, folder, &mut buffers) {
                    Ok(rows) => records.extend(rows),
                    Err(Failure::Photograph(error)) => {
                        records.push(unreadable(suite, &scene.name, camera.name(), &error));
                    }
                    Err(Failure::Output(error)) => return Err(error),
                }
            }
        }
    }
    Ok(records)
}

/// What went wrong: with this scene, or with all that is to be written.
enum Failure {
    Photograph(Error),
    Output(Error),
}

/// Where photographs of one scene are taken from: a camera at a phase.
pub(super) struct Station<'a> {
    pub plan: &'a Plan,
    pub suite: &'a str,
    pub scene: &'a Scene,
    pub camera: &'a Photographer,
    pub kernel: &'a Kernel,
    pub phase: u32,
}

/// What a photograph shows, and what is asked for in it.
pub(super) struct Shown<'a> {
    pub exposure: &'a Exposure,
    pub rig: &'a Rig,
    pub truth: &'a Truth,
    pub scorer: &'a Scorer<'a>,
    /// The corners asked for.
    pub asked: &'a [&'a TrueCorner],
    /// What names this photograph.
    pub name: [&'a str; 3],
    pub blur_px: f64,
}

impl Station<'_> {
    /// Takes a photograph and shows it.
    pub fn show<T>(
        &self,
        film: &Film,
        number: u32,
        buffers: &mut PhotographBuffers,
        shown: impl FnOnce(&Shown) -> T,
    ) -> T {
        let Self { plan, suite, scene, camera, kernel, .. } = *self;
        let text = number.to_string();
        let name = [suite, scene.name.as_str(), &text];
        let film_camera = scene.description.camera;
        let shot = Shot { name: &name, window: None };
        let mut photograph = camera.expose(film, &film_camera, kernel, &shot, buffers);
        // As a data sheet has it: only programs that say that they need it are told.
        photograph.exposure = photograph.exposure.with_object_size(scene.description.target.size_m);
        let truth = scene.truth.seen_by(&film_camera, &photograph.camera);
        let noise_free = camera.noise_free(&photograph);
        let world_from_camera = scene.description.world_from_camera;
        let object_size_m = photograph.exposure.object_size_m();
        let rig = Rig { camera: photograph.camera, world_from_camera, object_size_m };
        let colour = camera.model().colour;
        let blur_px = photograph.blur_px;
        let seeing = Seeing { exposure: &noise_free, colour, blur_px };
        let bounds = corner_bounds(&truth, &rig, &seeing);
        let scorer = Scorer {
            seen: Seen::new(scene, &truth, bounds, &rig),
            rig: &rig,
            rule: plan.corner_rule,
            gain: camera.model().gain,
        };
        let asked: Vec<&TrueCorner> = scorer.seen.asked(plan.corner_rule).collect();
        shown(&Shown {
            exposure: &photograph.exposure,
            rig: &rig,
            truth: &truth,
            scorer: &scorer,
            asked: &asked,
            name,
            blur_px,
        })
    }

    /// The rows of one photograph.
    fn rows(
        &self,
        film: &Film,
        number: u32,
        folder: Option<&Path>,
        buffers: &mut PhotographBuffers,
    ) -> std::result::Result<Vec<Record>, Failure> {
        self.show(film, number, buffers, |shown| self.rows_of(shown, number, folder))
    }

    fn rows_of(
        &self,
        shown: &Shown,
        number: u32,
        folder: Option<&Path>,
    ) -> std::result::Result<Vec<Record>, Failure> {
        let Self { plan, scene, .. } = *self;
        let Shown { exposure, rig, truth, scorer, asked, name, blur_px } = *shown;
        let range =
            range_image(&plan.range_sensor_model, scene, &name).map_err(Failure::Photograph)?;
        let depth_range_m = match folder {
            Some(folder) => self.write_pictures(folder, exposure).map_err(Failure::Output)?,
            None => [0.0; 2],
        };
        let mut records = Vec::new();
        for pipeline in &plan.pipelines {
            let given = match pipeline.seeds {
                Seeds::Disc { radius_px } => seeds_in_disc(points(asked), radius_px, &name),
                Seeds::Detected { .. } | Seeds::Elsewhere(_) => Vec::new(),
            };
            let answers = match &pipeline.seeds {
                Seeds::Elsewhere(file) => {
                    Answers::from_elsewhere(file.answers(self.camera.name(), &scene.name, number))
                }
                _ => {
                    let true_face = |corners: &[Corner]| given::face(truth, asked, corners);
                    Answers::of(pipeline, exposure, rig, &range, &given, &true_face)
                }
            };
            let template = self.template(pipeline, number, blur_px);
            records.extend(scorer.records(&template, pipeline, &answers));
            // What a report draws: the way to a grasp.
            let Some(folder) = folder.filter(|_| pipeline.draws_a_grasp()) else { continue };
            let sketch = sketch(scene, truth, &answers, depth_range_m);
            let written = || -> Result<()> {
                if let Some(Ok(region)) = &answers.region {
                    let path = folder.join(format!("{}-target.png", pipeline.name));
                    pictures::write_target(&path, exposure, region)?;
                }
                write_json(&folder.join(format!("{}.json", pipeline.name)), &sketch)
            };
            written().map_err(Failure::Output)?;
        }
        Ok(records)
    }

    /// What a report draws of a photograph: depth on the way to a grasp only.
    fn write_pictures(&self, folder: &Path, exposure: &Exposure) -> Result<[f64; 2]> {
        fs::create_dir_all(folder).map_err(Error::io(folder, "create"))?;
        pictures::write_exposure(&folder.join("exposure.png"), exposure)?;
        if !self.plan.pipelines.iter().any(Pipeline::draws_a_grasp) {
            return Ok([0.0; 2]);
        }
        pictures::write_depth(&folder.join("depth.png"), &self.scene.geometry.depth_m)
    }

    /// A record with everything that is the same for all rows of a photograph and method.
    pub fn template(&self, pipeline: &Pipeline, number: u32, blur_px: f64) -> Record {
        let [phase_x_px, phase_y_px] = Shots::phase_px(self.phase);
        let Description { family, pose, split, .. } = &self.scene.description;
        Record {
            suite: self.suite.to_owned(),
            scene: self.scene.name.clone(),
            scene_recipe_sha256: self.scene.recipe_sha256.clone(),
            family: family.clone(),
            pose: pose.clone(),
            split: Some(split.name().to_owned()),
            camera: self.camera.name().to_owned(),
            exposure: i32::try_from(number).ok(),
            phase_x_px: Some(phase_x_px),
            phase_y_px: Some(phase_y_px),
            blur_px: Some(blur_px),
            target_visible_fraction: Some(self.scene.truth.target_visible_fraction),
            ..of_pipeline(pipeline)
        }
    }
}

/// A seed of each corner, anywhere in a disc about it. A corner has one place in the disc of every radius.
pub(super) fn seeds_in_disc(
    corners: impl Iterator<Item = (usize, ImagePoint)>,
    radius_px: f64,
    name: &[&str],
) -> Vec<Detection> {
    let seed = |(index, truth): (usize, ImagePoint)| {
        let [x, y] = Stream::named(&[name, &["seed", &index.to_string()]].concat()).in_disc();
        Detection::new(ImagePoint::new(truth.x + radius_px * x, truth.y + radius_px * y), 1.0)
    };
    corners.map(seed).collect()
}

/// The indices and places of corners.
pub(super) fn points(corners: &[&TrueCorner]) -> impl Iterator<Item = (usize, ImagePoint)> {
    corners.iter().map(|corner| (corner.index, corner.image_point_px))
}

/// What a range sensor tells of a scene; `name` names its noise.
pub(super) fn range_image(
    sensor: &RangeSensor,
    scene: &Scene,
    name: &[&str],
) -> Result<RangeImage> {
    let Description { range_camera, world_from_range, .. } = &scene.description;
    sensor.measure(&scene.range, range_camera, *world_from_range, name)
}

/// The rows of a scene that no camera can photograph.
pub(super) fn unreadable_by_all(
    plan: &Plan,
    suite: &str,
    scene: &str,
    error: &Error,
) -> Vec<Record> {
    plan.cameras.iter().map(|camera| unreadable(suite, scene, camera.name(), error)).collect()
}
