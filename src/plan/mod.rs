//! What to measure: cameras and pipelines, each a chain of named algorithms with parameters.

mod alternatives;
mod drawn;
mod file;
mod recipes;
mod stage;

use std::path::Path;
use std::sync::Arc;

use schemars::Schema;
use serde::{Deserialize, Serialize};
use toml::Table;

use crate::detect::{DETECTORS, Detector};
use crate::error::{Error, Result};
use crate::external::{AnswerFile, Program, Task};
use crate::grasp::{ESTIMATORS, FaceSelector, GraspEstimator, SELECTORS};
use crate::metrics::CornerRule;
use crate::refine::{REFINERS, Refiner};
use crate::registry;
use crate::sensor::{Photographer, RangeSensor};
use crate::target::{EXTRACTORS, TargetExtractor};

use alternatives::OfOne;
use file::{Names, PipelineFile, PlanFile, SeedsFile};

pub use drawn::{Cell, Factors, Kind, Surface};
pub use recipes::{read_camera, read_range_sensor, read_table, recipe_names};
pub use stage::{Algorithm, AnyStage, OwnStage, Stage};

/// What to measure, read and checked.
pub struct Plan {
    /// Its name: the file's.
    pub name: String,
    /// One line for `cornerbench list`.
    pub summary: String,
    /// The cameras, each with its name.
    pub cameras: Vec<Photographer>,
    /// Junctions to draw instead of a rendered dataset, if there are any.
    pub cells: Vec<Cell>,
    /// Families of the scenes to measure; none is all.
    pub families: Vec<String>,
    /// How each of them photographs a scene.
    pub shots: Shots,
    /// Name of the range sensor.
    pub range_sensor: String,
    /// The range sensor.
    pub range_sensor_model: RangeSensor,
    /// What is asked for, and how near an answer must be.
    pub corner_rule: CornerRule,
    /// The pipelines, in the order of the file.
    pub pipelines: Vec<Pipeline>,
}

/// How often and where a camera photographs a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shots {
    /// Places of the pixels' grid on the image.
    pub phases: u32,
    /// Photographs at each, every one with noise of its own.
    pub repeats: u32,
}

impl Shots {
    /// Where in the film's image the centre of pixel (0, 0) is at a phase \[px\]: the first at (0, 0), the others
    /// evenly spread about it, however many (Roberts 2018, The Unreasonable Effectiveness of Quasirandom Sequences).
    pub fn phase_px(phase: u32) -> [f64; 2] {
        // The plastic number's powers: the least regular steps in two dimensions.
        const STEPS: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3];
        STEPS.map(|step| (0.5 + f64::from(phase) * step).fract() - 0.5)
    }
}

/// A chain of algorithms from an exposure to corners, and perhaps on to a grasp.
pub struct Pipeline {
    /// Its name; column `method` of the records.
    pub name: String,
    /// Where candidates come from.
    pub seeds: Seeds,
    /// Candidates to corners.
    pub refine: AnyStage<dyn Refiner>,
    /// Corners to a grasp; it ends with the corners where there is none.
    pub grasp: Option<GraspStages>,
}

/// Where candidates come from: which of the two tracks a pipeline is on.
pub enum Seeds {
    /// End to end: a detector finds them, or not, and others besides.
    Detected {
        /// Exposure to target region; the whole image is searched where there is none.
        target: Option<OwnStage<dyn TargetExtractor>>,
        /// Region to corner candidates.
        detect: AnyStage<dyn Detector>,
    },
    /// Refinement: about each corner that is asked for, anywhere in a disc; the refiner alone is judged.
    Disc {
        /// The disc's radius \[px\].
        radius_px: f64,
    },
    /// End to end: corners were computed elsewhere, and are not refined here.
    Elsewhere(Arc<AnswerFile>),
}

impl Seeds {
    /// The target extractor, if there is one.
    pub fn target(&self) -> Option<&OwnStage<dyn TargetExtractor>> {
        match self {
            Self::Detected { target, .. } => target.as_ref(),
            Self::Disc { .. } | Self::Elsewhere(_) => None,
        }
    }
}

/// A chain of algorithms from corners to a grasp.
pub struct GraspStages {
    /// Corners to the face to grasp; None on the refinement track, where it is known which corner is which.
    pub face: Option<OwnStage<dyn FaceSelector>>,
    /// Face to grasp point.
    pub point: AnyStage<dyn GraspEstimator>,
}

impl Plan {
    /// Adds a pipeline for corners that were computed elsewhere.
    ///
    /// # Errors
    /// When the plan draws its junctions, of which nobody has a photograph, or a pipeline is called the same.
    pub fn add_answers(&mut self, file: AnswerFile) -> Result<()> {
        let place = file.path().display().to_string();
        if !self.cells.is_empty() {
            return Err(Error::Other(format!(
                "{place}: plan {} draws its junctions, and nobody has photographs of them to answer; take a plan without \
                 [[drawn]]",
                self.name
            )));
        }
        self.pipelines.push(Pipeline {
            name: file.name().to_owned(),
            seeds: Seeds::Elsewhere(Arc::new(file)),
            refine: AnyStage::choose(&place, REFINERS, &[], Task::Refine, "none", Table::new())?,
            grasp: None,
        });
        refuse_twice(&place, "pipelines", self.pipelines.iter().map(|one| one.name.as_str()))
    }

    /// Refuses corners that were computed elsewhere for photographs that there are not.
    ///
    /// # Errors
    /// For the first of them.
    pub fn check_answers(&self, scenes: &[&str], cameras: &[&str]) -> Result<()> {
        let mut files = self.pipelines.iter().filter_map(|pipeline| match &pipeline.seeds {
            Seeds::Elsewhere(file) => Some(file),
            _ => None,
        });
        files.try_for_each(|file| file.check(scenes, cameras))
    }

    /// The other programs in its pipelines, each once.
    pub fn programs(&self) -> Vec<&Arc<Program>> {
        let mut found: Vec<&Arc<Program>> = Vec::new();
        for program in self.pipelines.iter().flat_map(Pipeline::programs) {
            if !found.iter().any(|one| Arc::ptr_eq(one, program)) {
                found.push(program);
            }
        }
        found
    }

    /// The JSON Schema of `plans/NAME.toml`.
    pub fn schema() -> Schema {
        registry::schema::<PlanFile>()
    }

    /// Reads `plans/NAME.toml` in the folder of recipes, and the cameras that it names.
    ///
    /// # Errors
    /// For an unknown name or key, or a value out of range: with file, key, found, allowed.
    pub fn read(recipes: &Path, name: &str) -> Result<Self> {
        Self::read_with(recipes, name, &[])
    }

    /// The same with other programs, each in every stage that does what it does: where the plan has a refiner, a program
    /// that refines is one more.
    ///
    /// # Errors
    /// The same; and for a program that does nothing which the plan has a stage for.
    pub fn read_with(recipes: &Path, name: &str, programs: &[Arc<Program>]) -> Result<Self> {
        let (place, table) = read_table(recipes, "plans", name)?;
        let file: PlanFile = registry::parameters(&place, &table)?;
        let cameras = match file.camera {
            Names::One(name) => vec![name],
            Names::Several(names) => names,
        };
        let cameras =
            cameras.iter().map(|name| read_camera(recipes, name)).collect::<Result<Vec<_>>>()?;
        if cameras.is_empty() {
            return Err(Error::Other(format!("{place}: camera is an empty list; name one")));
        }
        let range_sensor_model = read_range_sensor(recipes, &file.range_sensor)?;
        let pipelines = pipelines(&place, &file.pipelines, programs)?;
        if pipelines.is_empty() {
            return Err(Error::Other(format!("{place}: no pipelines; add a [[pipelines]] table")));
        }
        check_joined(&place, &pipelines, programs)?;
        check_families(&place, recipes, &file.families)?;
        let cells = drawn::cells(&place, &file.drawn)?;
        if !cells.is_empty() {
            if !file.families.is_empty() {
                return Err(Error::Other(format!(
                    "{place}: families are of rendered scenes, and junctions are drawn; leave out `families`, or \
                     [[drawn]]"
                )));
            }
            check_drawn(&place, &pipelines)?;
            check_noise(&place, &cells, &cameras)?;
        }
        refuse_twice(&place, "cells", cells.iter().map(|one| one.name.as_str()))?;
        refuse_twice(&place, "pipelines", pipelines.iter().map(|one| one.name.as_str()))?;
        refuse_twice(&place, "cameras", cameras.iter().map(Photographer::name))?;
        Ok(Self {
            name: name.to_owned(),
            summary: file.summary,
            cameras,
            cells,
            families: file.families,
            shots: Shots { phases: file.phases, repeats: file.repeats },
            range_sensor: file.range_sensor,
            range_sensor_model,
            corner_rule: CornerRule {
                gate_px: file.gate_px,
                least_edge_px: file.least_edge_px,
                most_bound_px: file.most_bound_px,
            },
            pipelines,
        })
    }
}

/// All pipelines of a plan's tables, and those that programs join.
fn pipelines(place: &str, tables: &[Table], programs: &[Arc<Program>]) -> Result<Vec<Pipeline>> {
    let mut all: Vec<(String, OfOne)> = Vec::new();
    for (index, table) in tables.iter().enumerate() {
        let place = format!("{place}: pipelines.{index}");
        for one in alternatives::pipelines(&place, table, programs)? {
            // Tables that differ in what a program takes the place of are the same with it.
            if one.joined.is_none() || !all.iter().any(|(_, other)| is_same(&one, other)) {
                all.push((place.clone(), one));
            }
        }
    }
    let build = |(place, one): &(String, OfOne)| {
        let same = all.iter().filter(|(_, other)| other.joined == one.joined).count();
        let mut table = one.table.clone();
        // A name that is clear without the others is the shorter one.
        if let Some(short) = one.joined.as_ref().filter(|_| same == 1) {
            table.insert("name".to_owned(), short.clone().into());
        }
        Pipeline::build(place, &table, programs)
    };
    all.iter().map(build).collect()
}

/// Whether two tables differ in their names alone.
fn is_same(one: &OfOne, other: &OfOne) -> bool {
    let keys = |table: &Table| table.keys().filter(|key| *key != "name").count();
    let mut own = one.table.iter().filter(|(key, _)| *key != "name");
    keys(&one.table) == keys(&other.table)
        && own.all(|(key, value)| other.table.get(key) == Some(value))
}

/// Refuses programs that take part in nothing.
fn check_joined(place: &str, pipelines: &[Pipeline], programs: &[Arc<Program>]) -> Result<()> {
    let takes_part = |one: &&Arc<Program>| {
        pipelines.iter().any(|pipeline| pipeline.programs().any(|p| Arc::ptr_eq(p, one)))
    };
    match programs.iter().find(|program| !takes_part(program)) {
        Some(program) => {
            let does: Vec<&str> = program.does().iter().map(|task| task.name()).collect();
            Err(Error::Other(format!(
                "{place}: {} does {}, and no pipeline has that stage for it to join; take another plan: cornerbench list plans",
                program.name(),
                does.join(" and ")
            )))
        }
        None => Ok(()),
    }
}

/// Refuses families that there are none of.
fn check_families(place: &str, recipes: &Path, families: &[String]) -> Result<()> {
    let known = recipe_names(recipes, "families");
    match families.iter().find(|family| !known.contains(family)) {
        Some(family) => Err(Error::UnknownName {
            place: place.to_owned(),
            kind: "family".to_owned(),
            found: family.clone(),
            known,
        }),
        None => Ok(()),
    }
}

/// Refuses noise of cells where a camera has no sensor that could have it.
fn check_noise(place: &str, cells: &[Cell], cameras: &[Photographer]) -> Result<()> {
    let noisy = cells.iter().find(|cell| cell.factors.contrast_over_noise.is_some());
    let ideal = cameras.iter().find(|camera| camera.model().sensor.is_none());
    match noisy.zip(ideal) {
        Some((cell, camera)) => Err(Error::Other(format!(
            "{place}: cell {:?} has contrast_over_noise, and camera {:?} has no sensor; leave it out, or take a \
             camera with a sensor, as \"bench\"",
            cell.name,
            camera.name()
        ))),
        None => Ok(()),
    }
}

/// Refuses pipelines that drawn junctions have nothing for.
fn check_drawn(place: &str, pipelines: &[Pipeline]) -> Result<()> {
    match pipelines.iter().find(|one| one.seeds.target().is_some() || one.grasp.is_some()) {
        Some(pipeline) => Err(Error::Other(format!(
            "{place}: pipeline {:?} has a target or a grasp, and drawn junctions are no targets; leave \
             out `target`, `face` and `grasp`",
            pipeline.name
        ))),
        None => Ok(()),
    }
}

/// Refuses two things of one name.
fn refuse_twice<'a>(place: &str, kind: &str, names: impl Iterator<Item = &'a str>) -> Result<()> {
    let mut names: Vec<&str> = names.collect();
    names.sort_unstable();
    match names.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(twice) => Err(Error::Other(format!("{place}: two {kind} are called {:?}", twice[0]))),
        None => Ok(()),
    }
}

impl Pipeline {
    /// The other programs in it.
    pub fn programs(&self) -> impl Iterator<Item = &Arc<Program>> {
        let detect = match &self.seeds {
            Seeds::Detected { detect, .. } => detect.program(),
            Seeds::Disc { .. } | Seeds::Elsewhere(_) => None,
        };
        let grasp = self.grasp.as_ref().and_then(|stages| stages.point.program());
        detect.into_iter().chain(self.refine.program()).chain(grasp)
    }

    /// Whether it has a way from a target to a grasp that is worth a picture.
    pub fn draws_a_grasp(&self) -> bool {
        self.grasp.as_ref().is_some_and(|stages| stages.face.is_some())
    }

    /// Its algorithms with versions and parameters, for run.json.
    pub fn description(&self) -> serde_json::Value {
        serde_json::json!({
            "name": self.name,
            "seeds": match &self.seeds {
                Seeds::Disc { radius_px } => Some(serde_json::json!({ "disc_px": radius_px })),
                Seeds::Detected { .. } | Seeds::Elsewhere(_) => None,
            },
            "target": self.seeds.target().map(Stage::description),
            "detect": match &self.seeds {
                Seeds::Disc { .. } => None,
                Seeds::Detected { detect, .. } => Some(detect.description()),
                Seeds::Elsewhere(file) => Some(serde_json::json!({
                    "algorithm": file.name(),
                    "version": file.version(),
                    "sha256": file.sha256(),
                })),
            },
            "refine": self.refine.description(),
            "face": self
                .grasp
                .as_ref()
                .and_then(|grasp| grasp.face.as_ref())
                .map(Stage::description),
            "grasp": self.grasp.as_ref().map(|grasp| grasp.point.description()),
        })
    }

    /// The pipeline of a table that has one value of each.
    pub(crate) fn build(place: &str, table: &Table, programs: &[Arc<Program>]) -> Result<Self> {
        let file: PipelineFile = registry::parameters(place, table)?;
        // A pipeline's name is part of file names and addresses.
        let legal = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_=.".contains(c);
        if file.name.is_empty() || !file.name.chars().all(legal) {
            return Err(Error::out_of_range(
                place,
                "name",
                format!("{:?}", file.name),
                "one or more of a-z, 0-9, -, _, = and .",
            ));
        }
        let has_target = file.target.is_some();
        let seeds = Self::build_seeds(place, programs, file.seeds, file.target, file.detect)?;
        let unrefined = || Table::from_iter([("algorithm".to_owned(), "none".into())]);
        let refine = file.refine.unwrap_or_else(unrefined);
        let grasp = match (file.face, file.grasp) {
            (None, None) => None,
            (Some(_), Some(_)) if !has_target => {
                return Err(Error::Other(format!(
                    "{place}: a face is chosen in a target region, and there is no `target`; add \
                     it, or leave out `face` and `grasp`"
                )));
            }
            (None, Some(_)) if !matches!(seeds, Seeds::Disc { .. }) => {
                return Err(Error::Other(format!(
                    "{place}: there is `grasp` but no `face`; give both, or neither for a pipeline that ends with \
                     corners, or `grasp` alone and `seeds`: then it is known which corner is which"
                )));
            }
            (face, Some(point)) => {
                let place = |stage: &str| format!("{place}.{stage}");
                let build =
                    |face| OwnStage::build(&place("face"), "face selector", SELECTORS, face);
                let (point_place, task) = (place("grasp"), Task::Grasp);
                Some(GraspStages {
                    face: face.map(build).transpose()?,
                    point: AnyStage::build(&point_place, ESTIMATORS, programs, task, point)?,
                })
            }
            (Some(_), None) => {
                return Err(Error::Other(format!(
                    "{place}: there is `face` but no `grasp`; give both, or neither for a pipeline that ends with \
                     corners"
                )));
            }
        };
        Ok(Self {
            seeds,
            refine: AnyStage::build(
                &format!("{place}.refine"),
                REFINERS,
                programs,
                Task::Refine,
                refine,
            )?,
            grasp,
            name: file.name,
        })
    }
}

impl Pipeline {
    fn build_seeds(
        place: &str,
        programs: &[Arc<Program>],
        seeds: Option<Table>,
        target: Option<Table>,
        detect: Option<Table>,
    ) -> Result<Seeds> {
        match (seeds, detect) {
            (Some(seeds), None) if target.is_none() => {
                let file: SeedsFile = registry::parameters(&format!("{place}.seeds"), &seeds)?;
                Ok(Seeds::Disc { radius_px: file.disc_px })
            }
            (None, Some(detect)) => Ok(Seeds::Detected {
                target: target
                    .map(|table| {
                        let place = format!("{place}.target");
                        OwnStage::build(&place, "target extractor", EXTRACTORS, table)
                    })
                    .transpose()?,
                detect: AnyStage::build(
                    &format!("{place}.detect"),
                    DETECTORS,
                    programs,
                    Task::Detect,
                    detect,
                )?,
            }),
            (None, None) => Err(Error::Other(format!(
                "{place}: no candidates; give `detect`, or `seeds` about the true corners"
            ))),
            (Some(_), _) => Err(Error::Other(format!(
                "{place}: `seeds` are about the true corners, without `target` and `detect`; leave out \
                 either"
            ))),
        }
    }
}
