//! The grasps that a run asks for, and what came of them.

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::files::write_whole;
use crate::record::{Attempt, Record, RecordFile, kind, outcome, status};
use crate::scene::Dataset;

/// A grasp as the physics is told it.
#[derive(Debug, Serialize)]
struct Told {
    point_m: [f64; 3],
    approach: Option<[f64; 3]>,
    jaw: Option<[f64; 3]>,
    opening_m: Option<f64>,
}

impl Told {
    /// That of a record; `None` where it has no point.
    fn of(record: &Record) -> Option<Self> {
        let of = |[x, y, z]: [Option<f64>; 3]| Some([x?, y?, z?]);
        Some(Self {
            point_m: of([record.grasp_world_x_m, record.grasp_world_y_m, record.grasp_world_z_m])?,
            approach: of([
                record.approach_world_x,
                record.approach_world_y,
                record.approach_world_z,
            ]),
            jaw: of([record.jaw_world_x, record.jaw_world_y, record.jaw_world_z]),
            opening_m: record.opening_m,
        })
    }
}

/// A grasp that a record asks for.
struct Asked {
    /// What is known of it before it is carried out.
    attempt: Attempt,
    /// What is carried out, or why there is nothing.
    told: std::result::Result<Told, String>,
}

impl Asked {
    fn of(record: Record) -> Self {
        let attempt = Attempt::of(&record);
        let told = Told::of(&record).ok_or_else(|| record.reason.unwrap_or(record.status));
        Self { attempt, told }
    }
}

/// Those of a scene, in the order of its records.
struct OfScene {
    name: String,
    recipe_sha256: String,
    asked: Vec<Asked>,
}

/// What became of the grasps of a scene, as the physics writes it.
#[derive(Debug, Deserialize)]
struct SceneOutcomes {
    controls: BTreeMap<String, Came>,
    outcomes: Vec<Came>,
}

impl SceneOutcomes {
    fn read(path: &Path) -> Result<Self> {
        let text = fs::read_to_string(path).map_err(Error::io(path, "read"))?;
        serde_json::from_str(&text).map_err(|error| Error::malformed(path, error))
    }
}

/// What became of a grasp.
#[derive(Clone, Debug, Deserialize)]
struct Came {
    outcome: String,
    executed: bool,
    pushed_mm: Option<f64>,
    slip_mm: Option<f64>,
    slip_deg: Option<f64>,
    reason: Option<String>,
}

impl Came {
    fn to(&self, attempt: Attempt) -> Attempt {
        Attempt {
            outcome: self.outcome.clone(),
            executed: self.executed,
            pushed_mm: self.pushed_mm,
            slip_mm: self.slip_mm,
            slip_deg: self.slip_deg,
            reason: self.reason.clone(),
            ..attempt
        }
    }
}

/// The controls, as the physics names them, and as rows do.
const CONTROLS: [(&str, &str); 3] = [
    ("least_occluded", "true: least occluded"),
    ("best", "true: reachable"),
    ("wrong", "true: moved 30 mm"),
];

/// What is read of records.
const COLUMNS: [&str; 30] = [
    "record_version",
    "scene",
    "scene_recipe_sha256",
    "family",
    "split",
    "camera",
    "exposure",
    "method",
    "kind",
    "status",
    "reason",
    "seed_disc_px",
    "grasp_estimator",
    "refined_error_px",
    "grasp_error_mm",
    "grasp_sigma_mm",
    "approach_error_deg",
    "face_is_right",
    "grasp_world_x_m",
    "grasp_world_y_m",
    "grasp_world_z_m",
    "approach_world_x",
    "approach_world_y",
    "approach_world_z",
    "jaw_world_x",
    "jaw_world_y",
    "jaw_world_z",
    "opening_m",
    "track",
    "cornerbench_version",
];

/// What tells a photograph and the method that looked at it from others.
#[derive(PartialEq, Eq, Hash)]
struct Photograph {
    scene: String,
    camera: Option<String>,
    exposure: Option<i32>,
    method: String,
}

impl Photograph {
    fn of(attempt: &Attempt) -> Self {
        Self {
            scene: attempt.scene.clone(),
            camera: attempt.camera.clone(),
            exposure: attempt.exposure,
            method: attempt.method.clone(),
        }
    }
}

/// Mean of squares, as it grows.
#[derive(Clone, Copy, Default)]
struct Squares {
    sum: f64,
    count: usize,
}

/// The grasps of a run by scene, in the order of its records.
pub(super) struct AskedGrasps {
    scenes: Vec<OfScene>,
    /// Errors of the corners that were answered \[px\].
    corners: HashMap<Photograph, Squares>,
}

impl AskedGrasps {
    /// Reads those of some methods; of all where none is named.
    pub(super) fn read(run: &Path, dataset: &Dataset, methods: &[String]) -> Result<Self> {
        let path = run.join("records.parquet");
        let file = RecordFile::open(&path)?;
        let (mut scenes, mut places) = (Vec::<OfScene>::new(), HashMap::new());
        let mut corners: HashMap<Photograph, Squares> = HashMap::new();
        let mut known: Vec<String> = Vec::new();
        let mut take = |record: Record| {
            let is_wanted = methods.is_empty() || methods.contains(&record.method);
            if record.kind == kind::GRASP {
                if !known.contains(&record.method) {
                    known.push(record.method.clone());
                }
                if is_wanted {
                    let place = *places.entry(record.scene.clone()).or_insert_with(|| {
                        scenes.push(OfScene {
                            name: record.scene.clone(),
                            recipe_sha256: record.scene_recipe_sha256.clone(),
                            asked: Vec::new(),
                        });
                        scenes.len() - 1
                    });
                    scenes[place].asked.push(Asked::of(record));
                }
            } else if is_wanted
                && record.kind == kind::CORNER
                && record.status == status::OK
                && let Some(error_px) = record.refined_error_px
            {
                let of = corners.entry(Photograph::of(&Attempt::of(&record))).or_default();
                of.sum += error_px * error_px;
                of.count += 1;
            }
        };
        for group in 0..file.groups() {
            file.for_each(group, &COLUMNS, |_, _| true, &mut take)?;
        }
        if let Some(unknown) = methods.iter().find(|name| !known.contains(name)) {
            return Err(Error::UnknownName {
                place: "--method".to_owned(),
                kind: "method".to_owned(),
                found: unknown.clone(),
                known,
            });
        }
        if scenes.is_empty() {
            return Err(Error::Other(format!(
                "{}: has no grasps; measure a plan whose pipelines end with grasp, such as grasps",
                path.display()
            )));
        }
        for scene in &scenes {
            if dataset.recipe_sha256(&scene.name) != Some(scene.recipe_sha256.as_str()) {
                return Err(Error::Other(format!(
                    "{}: scene {} is not as {} has it; name the dataset that the run is of, or measure again",
                    path.display(),
                    scene.name,
                    dataset.folder().display(),
                )));
            }
        }
        Ok(Self { scenes, corners })
    }

    /// Writes the file of grasps: a line for each scene.
    pub(super) fn tell(&self, path: &Path) -> Result<()> {
        let mut text = String::new();
        for scene in &self.scenes {
            let grasps: Vec<&Told> =
                scene.asked.iter().filter_map(|asked| asked.told.as_ref().ok()).collect();
            let line = serde_json::json!({ "scene": scene.name, "grasps": grasps });
            text.push_str(&line.to_string());
            text.push('\n');
        }
        write_whole(path, |path| fs::write(path, text).map_err(Error::io(path, "write")))
    }

    /// Which grasp of a scene is the first of a method, and the method; `None` of none.
    pub(super) fn place(
        &self,
        scene: &str,
        method: Option<&String>,
        dataset: &Path,
    ) -> Result<Option<(usize, String)>> {
        let Some(of_scene) = self.scenes.iter().find(|of_scene| of_scene.name == scene) else {
            return Err(Error::UnknownName {
                place: dataset.display().to_string(),
                kind: "scene".to_owned(),
                found: scene.to_owned(),
                known: self.scenes.iter().map(|of_scene| of_scene.name.clone()).collect(),
            });
        };
        let Some(method) = method else { return Ok(None) };
        let mut told = of_scene.asked.iter().filter(|asked| asked.told.is_ok());
        match told.position(|asked| asked.attempt.method == *method) {
            Some(place) => Ok(Some((place, method.clone()))),
            None => Err(Error::Other(format!("{method} has no grasp in scene {scene}"))),
        }
    }

    /// The rows: those of each scene in the order of the records, its controls before them.
    pub(super) fn attempts(
        self,
        folder: &Path,
        failures: &BTreeMap<String, String>,
        [gripper, robot]: [&str; 2],
    ) -> Result<Vec<Attempt>> {
        let mut rows = Vec::new();
        for scene in self.scenes {
            let came = match failures.get(&scene.name) {
                Some(failure) => Err(failure.as_str()),
                None => Ok(SceneOutcomes::read(&folder.join(format!("{}.json", scene.name)))?),
            };
            let is_reachable = came.as_ref().ok().map(|came| came.controls.contains_key("best"));
            rows.extend(scene.rows(came)?.into_iter().map(|attempt| {
                Attempt {
                    gripper: gripper.to_owned(),
                    robot: robot.to_owned(),
                    scene_is_reachable: is_reachable,
                    corner_rmse_px: self
                        .corners
                        .get(&Photograph::of(&attempt))
                        .map(|squares| (squares.sum / squares.count as f64).sqrt()),
                    ..attempt
                }
            }));
        }
        Ok(rows)
    }
}

impl OfScene {
    /// The rows of what came of them, or of why nothing did.
    fn rows(self, came: std::result::Result<SceneOutcomes, &str>) -> Result<Vec<Attempt>> {
        let mut rows = Vec::new();
        if let (Ok(came), Some(first)) = (&came, self.asked.first()) {
            for (key, name) in CONTROLS {
                rows.extend(came.controls.get(key).map(|came| {
                    came.to(Attempt {
                        scene: self.name.clone(),
                        family: first.attempt.family.clone(),
                        split: first.attempt.split.clone(),
                        method: name.to_owned(),
                        is_control: true,
                        ..Attempt::default()
                    })
                }));
            }
        }
        let mut outcomes = came.map(|came| came.outcomes.into_iter());
        for Asked { attempt, told } in self.asked {
            let ended = |outcome: &str, reason: &str| Attempt {
                outcome: outcome.to_owned(),
                reason: Some(reason.to_owned()),
                ..attempt.clone()
            };
            rows.push(match (&told, &mut outcomes) {
                (Err(reason), _) => ended(outcome::NO_GRASP, reason),
                (Ok(_), Err(failure)) => ended(outcome::FAILED, failure),
                (Ok(_), Ok(outcomes)) => outcomes
                    .next()
                    .ok_or_else(|| {
                        Error::Other(format!(
                            "scene {}: fewer outcomes than grasps; remove the folder grasps of the run and carry them \
                             out again",
                            self.name
                        ))
                    })?
                    .to(attempt),
            });
        }
        Ok(rows)
    }
}
