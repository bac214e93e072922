//! `cornerbench grasp`: the grasps of a run carried out in physics, scene by scene; resumable, what failed is a row.

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde::{Deserialize, Serialize};

use super::environment::{Purpose, present_python, python};
use super::progress::Progress;
use super::script::Script;
use super::{Ended, Global, command_line, print_line, project};
use crate::error::{Error, Result};
use crate::files::write_whole;
use crate::plan::read_table;
use crate::record::{Attempt, Record, RecordFile, kind, outcome, read_run, status};
use crate::report::attempts::{self, AttemptSummary};
use crate::report::terminal;
use crate::scene::Dataset;

#[derive(clap::Args)]
pub(super) struct Options {
    /// The dataset's folder.
    dataset: PathBuf,
    /// The folder of a run on it, whose plan ends with grasps.
    run: PathBuf,
    /// The gripper; `cornerbench list grippers` names them.
    #[arg(long, value_name = "NAME", default_value = "parallel-160")]
    gripper: String,
    /// The robot; `cornerbench list robots` names them. "flying" is the gripper alone, which gets everywhere.
    #[arg(long, value_name = "NAME", default_value = "flying")]
    robot: String,
    /// Only the grasps of these methods, as the run's report names them.
    #[arg(long, value_name = "NAME")]
    method: Vec<String>,
    /// Worker processes; one a core where this is not given.
    #[arg(short, long, value_name = "N")]
    jobs: Option<usize>,
    /// A Markdown file to put the tables into: between `<!-- results of PLAN: GRIPPER-ROBOT -->`, or `GRIPPER-ROBOT moved`,
    /// and `<!-- end of results -->`.
    #[arg(long, value_name = "FILE")]
    into: Option<PathBuf>,
    /// Draw a strip of pictures, and a clip, of this scene instead: of the method that is named, else of the true grasp.
    #[arg(long, value_name = "SCENE")]
    show: Option<String>,
}

/// What the physics says, one JSON object a line.
#[derive(Debug, Deserialize)]
#[serde(tag = "event", rename_all = "lowercase")]
enum Event {
    Start { scenes: u64, missing: u64 },
    Grasping { scene: String },
    Done { scene: String, grasps: u64, succeeded: u64, left_s: Option<f64> },
    Failed { scene: String, message: String, left_s: Option<f64> },
    Drawing { picture: u64, of: u64 },
    Drawn { path: PathBuf, words: String },
    Interrupted { there: u64 },
    Error { message: String },
}

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

/// What became of the grasps of a scene, as the physics writes it.
#[derive(Debug, Deserialize)]
struct SceneOutcomes {
    controls: BTreeMap<String, Came>,
    outcomes: Vec<Came>,
}

/// What became of a grasp.
#[derive(Clone, Debug, Deserialize)]
struct Came {
    outcome: String,
    executed: bool,
    pushed_mm: Option<f64>,
    slip_mm: Option<f64>,
    slip_deg: Option<f64>,
}

impl Came {
    fn to(&self, attempt: Attempt) -> Attempt {
        Attempt {
            outcome: self.outcome.clone(),
            executed: self.executed,
            pushed_mm: self.pushed_mm,
            slip_mm: self.slip_mm,
            slip_deg: self.slip_deg,
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

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let root = project::root()?;
    let recipes = project::recipes(global)?;
    read_table(&recipes, "grippers", &options.gripper)?;
    read_table(&recipes, "robots", &options.robot)?;
    if let Some(jobs) = options.jobs {
        crate::registry::in_range("command line", "--jobs", jobs, 1..=1024)?;
    }
    let dataset = Dataset::open(&options.dataset)?;
    let grasps = Grasps::read(&options.run, &dataset, &options.method)?;
    let folder = options.run.join("grasps").join(format!("{}-{}", options.gripper, options.robot));
    let told = folder.join("grasps.jsonl");
    grasps.tell(&told)?;
    let program = match present_python(&root, Purpose::Development)? {
        Some(program) => program,
        None => python(&root, Purpose::Mujoco, &|line| global.say(line))?,
    };
    let absolute = |path: &Path| std::path::absolute(path).map_err(Error::io(path, "find"));
    let mut command = Command::new(program);
    command
        .args([
            "-m",
            if options.show.is_some() { "cornergrasps.strip" } else { "cornergrasps.run" },
        ])
        .args([absolute(dataset.folder())?, absolute(&told)?])
        .arg(absolute(&if options.show.is_some() {
            folder.clone()
        } else {
            folder.join("scenes")
        })?)
        .arg("--recipes")
        .arg(&recipes)
        .args(["--gripper", &options.gripper, "--robot", &options.robot])
        .current_dir(root.join("scripts"));
    if let Some(jobs) = options.jobs.or(global.threads) {
        command.args(["--jobs", &jobs.to_string()]);
    }
    if let Some(scene) = &options.show {
        let place = grasps.place(scene, &options.method, dataset.folder())?;
        command.args(["--scene", scene]);
        if let Some((place, method)) = place {
            command.args(["--grasp", &place.to_string(), "--name", &method]);
        }
    }
    let mut failures = BTreeMap::new();
    let ended = follow(global, Script::start("the physics", command)?, &mut failures)?;
    if ended == Ended::Interrupted || options.show.is_some() {
        return Ok(ended);
    }
    let rows = grasps.attempts(&folder.join("scenes"), &failures, options)?;
    let (scenes, reachable, methods) = attempts::summarise(&rows);
    let summary = AttemptSummary {
        dataset: options.dataset.clone(),
        gripper: options.gripper.clone(),
        robot: options.robot.clone(),
        command: command_line(),
        scenes,
        reachable,
        methods,
    };
    let page = attempts::write(&folder, &summary, &rows)?;
    if let Some(path) = &options.into {
        attempts::splice(path, &read_run(&options.run)?.plan, &summary)?;
    }
    if global.json {
        print_line(serde_json::json!(summary))?;
    } else {
        print_line(terminal::table_of(&attempts::table(&summary)))?;
        print_line(attempts::TABLE)?;
        print_line(attempts::finding(&summary))?;
        print_line(format_args!("open {}", page.display()))?;
    }
    Ok(ended)
}

/// Shows what the physics says, to its end; what fails goes to `failures` by scene.
fn follow(
    global: &Global,
    mut physics: Script<Event>,
    failures: &mut BTreeMap<String, String>,
) -> Result<Ended> {
    let mut progress = Progress::new(global);
    progress.doing("looking at what is there");
    let (mut ended, mut refused, mut of) = (Ended::Well, None, 0);
    while let Some(event) = physics.next_event()? {
        match event {
            Event::Start { scenes, missing } => {
                of = scenes;
                let there = scenes - missing;
                progress.tell(&format!("the grasps of {there} of {scenes} scenes are carried out"));
                progress.start(scenes, there);
            }
            Event::Grasping { scene } => progress.begin(scene),
            Event::Done { scene, grasps, succeeded, left_s } => {
                progress.end(&scene, left_s);
                progress.tell_done(&format!("{scene}: {succeeded} of {grasps} grasps succeeded"));
            }
            Event::Failed { scene, message, left_s } => {
                progress.end(&scene, left_s);
                ended = Ended::Partly;
                progress.tell_failure(&format!("{scene} failed: {message}"));
                failures.insert(scene, message);
            }
            Event::Drawing { picture, of } => {
                progress.doing(&format!("drawing picture {picture} of {of}"));
            }
            Event::Drawn { path, words } => {
                progress.tell(&words);
                print_line(format_args!("open {}", path.display()))?;
            }
            Event::Interrupted { there } => {
                ended = Ended::Interrupted;
                progress.tell_failure(&format!(
                    "interrupted: the grasps of {there} of {of} scenes are carried out and kept; the same command goes on"
                ));
            }
            Event::Error { message } => refused = Some(message),
        }
    }
    drop(progress);
    physics.end(refused, ended)
}

/// What is read of records.
const COLUMNS: [&str; 29] = [
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

/// The grasps of a run by scene, in the order of its records.
struct Grasps {
    scenes: Vec<(String, Vec<Record>)>,
    /// Sum of squares and number of the errors of a photograph's corners, by what tells it and its method apart.
    corners: HashMap<Photograph, (f64, usize)>,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Photograph {
    scene: String,
    camera: String,
    method: String,
    exposure: Option<i32>,
}

impl Photograph {
    fn of(record: &Record) -> Self {
        Self {
            scene: record.scene.clone(),
            camera: record.camera.clone(),
            method: record.method.clone(),
            exposure: record.exposure,
        }
    }
}

impl Grasps {
    /// Reads those of some methods; of all where none is named.
    fn read(run: &Path, dataset: &Dataset, methods: &[String]) -> Result<Self> {
        let path = run.join("records.parquet");
        let file = RecordFile::open(&path)?;
        let (mut scenes, mut places) = (Vec::<(String, Vec<Record>)>::new(), HashMap::new());
        let mut corners: HashMap<Photograph, (f64, usize)> = HashMap::new();
        let mut known: Vec<String> = Vec::new();
        for group in 0..file.groups() {
            file.for_each(
                group,
                &COLUMNS,
                |_, _| true,
                |record| {
                    let is_wanted = methods.is_empty() || methods.contains(&record.method);
                    if is_wanted && record.kind == kind::CORNER && record.status == status::OK {
                        if let Some(error_px) = record.refined_error_px {
                            let (sum, count) = corners.entry(Photograph::of(&record)).or_default();
                            *sum += error_px * error_px;
                            *count += 1;
                        }
                    } else if record.kind == kind::GRASP {
                        if !known.contains(&record.method) {
                            known.push(record.method.clone());
                        }
                        if is_wanted {
                            let place = *places.entry(record.scene.clone()).or_insert_with(|| {
                                scenes.push((record.scene.clone(), Vec::new()));
                                scenes.len() - 1
                            });
                            scenes[place].1.push(record);
                        }
                    }
                },
            )?;
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
        for (scene, records) in &scenes {
            let recipe = dataset.recipe_sha256(scene);
            let measured = records.first().map(|record| record.scene_recipe_sha256.as_str());
            if recipe != measured {
                return Err(Error::Other(format!(
                    "{}: scene {scene} is not as {} has it; name the dataset that the run is of, or measure again",
                    path.display(),
                    dataset.folder().display(),
                )));
            }
        }
        Ok(Self { scenes, corners })
    }

    /// Writes the file of grasps: a line for each scene.
    fn tell(&self, path: &Path) -> Result<()> {
        let mut text = String::new();
        for (scene, records) in &self.scenes {
            let grasps: Vec<Told> = records.iter().filter_map(Told::of).collect();
            text.push_str(&serde_json::json!({ "scene": scene, "grasps": grasps }).to_string());
            text.push('\n');
        }
        write_whole(path, |path| fs::write(path, text).map_err(Error::io(path, "write")))
    }

    /// Which grasp of a scene is the first of a method, and the method; `None` of none.
    fn place(
        &self,
        scene: &str,
        methods: &[String],
        dataset: &Path,
    ) -> Result<Option<(usize, String)>> {
        let Some((_, records)) = self.scenes.iter().find(|(name, _)| name == scene) else {
            return Err(Error::UnknownName {
                place: dataset.display().to_string(),
                kind: "scene".to_owned(),
                found: scene.to_owned(),
                known: self.scenes.iter().map(|(name, _)| name.clone()).collect(),
            });
        };
        let Some(method) = methods.first() else { return Ok(None) };
        let told = records.iter().filter(|record| Told::of(record).is_some());
        let place = told.enumerate().find(|(_, record)| record.method == *method);
        match place {
            Some((place, _)) => Ok(Some((place, method.clone()))),
            None => Err(Error::Other(format!("{method} has no grasp in scene {scene}"))),
        }
    }

    /// The rows: those of each scene in the order of the records, its controls before them.
    fn attempts(
        &self,
        folder: &Path,
        failures: &BTreeMap<String, String>,
        options: &Options,
    ) -> Result<Vec<Attempt>> {
        let mut rows = Vec::new();
        for (scene, records) in &self.scenes {
            let of_scene = if failures.contains_key(scene) {
                None
            } else {
                Some(read_outcomes(&folder.join(format!("{scene}.json")))?)
            };
            rows.extend(self.of_scene(records, of_scene.as_ref(), failures.get(scene), options)?);
        }
        Ok(rows)
    }

    fn of_scene(
        &self,
        records: &[Record],
        of_scene: Option<&SceneOutcomes>,
        failure: Option<&String>,
        options: &Options,
    ) -> Result<Vec<Attempt>> {
        let scene_is_reachable = of_scene.map(|of_scene| of_scene.controls.contains_key("best"));
        let with_robot = |attempt: Attempt| Attempt {
            gripper: options.gripper.clone(),
            robot: options.robot.clone(),
            scene_is_reachable,
            ..attempt
        };
        let mut rows = Vec::new();
        if let (Some(of_scene), Some(first)) = (of_scene, records.first()) {
            for (key, name) in CONTROLS {
                let Some(came) = of_scene.controls.get(key) else { continue };
                rows.push(with_robot(came.to(Attempt {
                    scene: first.scene.clone(),
                    family: first.family.clone(),
                    split: first.split.clone(),
                    method: name.to_owned(),
                    is_control: true,
                    ..Attempt::default()
                })));
            }
        }
        let mut outcomes = of_scene.map(|of_scene| of_scene.outcomes.iter());
        for record in records {
            let (sum, count) =
                self.corners.get(&Photograph::of(record)).copied().unwrap_or_default();
            let attempt = Attempt {
                corner_rmse_px: (count > 0).then(|| (sum / count as f64).sqrt()),
                ..Attempt::of(record)
            };
            let attempt = match (Told::of(record), &mut outcomes) {
                (None, _) => Attempt {
                    outcome: outcome::NO_GRASP.to_owned(),
                    reason: Some(record.reason.clone().unwrap_or_else(|| record.status.clone())),
                    ..attempt
                },
                (Some(_), None) => Attempt {
                    outcome: outcome::FAILED.to_owned(),
                    reason: failure.cloned(),
                    ..attempt
                },
                (Some(_), Some(outcomes)) => match outcomes.next() {
                    Some(came) => came.to(attempt),
                    None => {
                        return Err(Error::Other(format!(
                            "scene {}: fewer outcomes than grasps; remove the folder grasps of the run and carry them out \
                             again",
                            record.scene
                        )));
                    }
                },
            };
            rows.push(with_robot(attempt));
        }
        Ok(rows)
    }
}

fn read_outcomes(path: &Path) -> Result<SceneOutcomes> {
    let text = fs::read_to_string(path).map_err(Error::io(path, "read"))?;
    serde_json::from_str(&text).map_err(|error| Error::malformed(path, error))
}
