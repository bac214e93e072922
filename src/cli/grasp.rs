//! `cornerbench grasp`: the grasps of a run carried out in physics, scene by scene; resumable, what failed is a row.

mod asked;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde::Deserialize;

use self::asked::AskedGrasps;

use super::environment::{Purpose, present_python, python};
use super::progress::Progress;
use super::script::Script;
use super::{Ended, Global, command_line, print_line, project};
use crate::error::{Error, Result};
use crate::plan::read_table;
use crate::record::read_run;
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

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let root = project::root()?;
    let recipes = project::recipes(global)?;
    read_table(&recipes, "grippers", &options.gripper)?;
    read_table(&recipes, "robots", &options.robot)?;
    if let Some(jobs) = options.jobs {
        crate::registry::in_range("command line", "--jobs", jobs, 1..=1024)?;
    }
    let dataset = Dataset::open(&options.dataset)?;
    let grasps = AskedGrasps::read(&options.run, &dataset, &options.method)?;
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
        let place = grasps.place(scene, options.method.first(), dataset.folder())?;
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
    let rows =
        grasps.attempts(&folder.join("scenes"), &failures, [&options.gripper, &options.robot])?;
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
