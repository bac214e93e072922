//! `cornerbench render`: the renderer's process, what it says, how it ends.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde::Deserialize;

use super::environment::{Purpose, present_python, python};
use super::estimate::Estimate;
use super::progress::Progress;
use super::script::Script;
use super::{Ended, Global, default_output, print_line, project};
use crate::error::{Error, Result};
use crate::plan::read_table;

#[derive(clap::Args, Default)]
pub(super) struct Options {
    /// The suite; `cornerbench list suites` names them.
    suite: String,
    /// Where to: a folder, or an address that fsspec opens, such as s3://bucket/name;
    /// out/SUITE/dataset where this is not given. Several machines must share it.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Worker processes; they share the cores. One a core where this is not given.
    #[arg(short, long, value_name = "N")]
    jobs: Option<usize>,
    /// Only these scenes of the suite: from number A, counted from 0, up to but without number B;
    /// or one scene's name.
    #[arg(long, value_name = "A..B")]
    scenes: Option<String>,
    /// Only every N-th scene of the suite, from number I, 0 to N - 1: for N machines with one folder.
    #[arg(long, value_name = "I/N")]
    shard: Option<String>,
    /// Render on the machines of a Ray cluster that runs already: at this address of its head, or
    /// else where RAY_ADDRESS says, or the one that this machine is part of. A worker has one core.
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = "")]
    ray: Option<String>,
    /// Say what time and disk it would take, and end. For that some scenes of each family are
    /// rendered at few of their samples, which takes a minute or two.
    #[arg(long)]
    estimate: bool,
    /// A Mitsuba variant to use instead of the fastest one.
    #[arg(long, value_name = "NAME")]
    variant: Option<String>,
}

impl Options {
    /// Those for a whole suite in a folder.
    pub(super) fn whole(suite: &str, folder: &Path) -> Self {
        Self { suite: suite.to_owned(), output: Some(folder.to_owned()), ..Self::default() }
    }
}

/// What the renderer says, one JSON object a line.
#[derive(Debug, Deserialize)]
#[serde(tag = "event", rename_all = "lowercase")]
enum Event {
    Start { scenes: u64, missing: u64 },
    Slow { message: String },
    Probed { scene: String },
    Estimate(Estimate),
    Rendering { scene: String },
    Done { scene: String, visible_fraction: f64, seconds: f64, left_s: Option<f64> },
    Failed { scene: String, key: String, message: String, left_s: Option<f64> },
    Interrupted { there: u64 },
    Error { message: String },
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let place = place(options)?;
    let ended = render(global, options)?;
    if ended != Ended::Interrupted && !options.estimate {
        global.say(format!("dataset: {}", place.display()));
    }
    Ok(ended)
}

/// Where the dataset is: an address as it was given, a folder in full.
fn place(options: &Options) -> Result<PathBuf> {
    let default = || default_output(&options.suite).join("dataset");
    let place = options.output.clone().unwrap_or_else(default);
    if place.to_string_lossy().contains("://") {
        return Ok(place);
    }
    std::path::absolute(&place).map_err(Error::io(&place, "find"))
}

/// Renders what is missing.
pub(super) fn render(global: &Global, options: &Options) -> Result<Ended> {
    let root = project::root()?;
    let recipes = project::recipes(global)?;
    read_table(&recipes, "suites", &options.suite)?;
    if let Some(jobs) = options.jobs {
        crate::registry::in_range("command line", "--jobs", jobs, 1..=1024)?;
    }
    let program = match options.ray {
        None => python(&root, Purpose::Rendering, &|line| global.say(line))?,
        Some(_) => present_python(&root, Purpose::Ray)?.ok_or_else(|| {
            Error::Other("--ray: Ray is not set up here; run cornerbench setup --ray".to_owned())
        })?,
    };
    let arguments = arguments(global, options, &recipes, &place(options)?);
    let mut command = Command::new(program);
    command.args(["-m", "cornerscenes.render"]).args(&arguments).current_dir(root.join("scripts"));
    let renderer = Script::start("the renderer", command)?;
    follow(global, renderer, options)
}

/// The renderer's command line.
fn arguments(global: &Global, options: &Options, recipes: &Path, place: &Path) -> Vec<String> {
    let mut words = vec![
        options.suite.clone(),
        "--recipes".to_owned(),
        recipes.to_string_lossy().into_owned(),
        "--output".to_owned(),
        place.to_string_lossy().into_owned(),
    ];
    let mut option = |name: &str, value: Option<String>| {
        words.extend(value.map(|value| format!("{name}={value}")));
    };
    option("--scenes", options.scenes.clone());
    option("--shard", options.shard.clone());
    option("--variant", options.variant.clone());
    option("--jobs", options.jobs.map(|jobs| jobs.to_string()));
    option("--ray", options.ray.clone());
    option("--threads", global.threads.map(|threads| threads.to_string()));
    if options.estimate {
        words.push("--estimate".to_owned());
    }
    words
}

/// Shows what the renderer says, to its end.
fn follow(global: &Global, mut renderer: Script<Event>, options: &Options) -> Result<Ended> {
    let suite = &options.suite;
    let mut progress = Progress::new(global);
    progress.doing("looking at what is there");
    let mut ended = Ended::Well;
    let (mut refused, mut estimate) = (None, None);
    let mut chosen = 0;
    while let Some(event) = renderer.next_event()? {
        match event {
            Event::Start { scenes, missing } => {
                chosen = scenes;
                let there = scenes - missing;
                progress.tell(&format!("suite {suite}: {there} of {scenes} scenes are rendered"));
                if !options.estimate {
                    progress.start(scenes, there);
                }
            }
            Event::Probed { scene } => {
                progress.end(&scene, None);
                progress.tell(&format!("probed {scene}"));
            }
            Event::Estimate(found) => estimate = Some(found),
            Event::Slow { message } => progress.tell(&message),
            Event::Rendering { scene } => progress.begin(scene),
            Event::Done { scene, visible_fraction, seconds, left_s } => {
                progress.end(&scene, left_s);
                progress.tell_done(&format!(
                    "rendered {scene} in {seconds:.1} s, {:.0} % of the target seen",
                    100.0 * visible_fraction
                ));
            }
            Event::Failed { scene, key, message, left_s } => {
                progress.end(&scene, left_s);
                ended = Ended::Partly;
                let alone = again(global, options, Some(&scene));
                progress.tell_failure(&format!(
                    "{scene} failed: {message}; its seeds are those of {key:?}; to render it \
                     alone: {alone}"
                ));
            }
            Event::Interrupted { there } => {
                ended = Ended::Interrupted;
                let again = again(global, options, None);
                progress.tell_failure(&format!(
                    "interrupted: {there} of {chosen} scenes are rendered and kept; to go on: \
                     {again}"
                ));
            }
            Event::Error { message } => refused = Some(message),
        }
    }
    drop(progress);
    match estimate {
        Some(estimate) if global.json => print_line(serde_json::json!(estimate))?,
        Some(estimate) => print_line(estimate)?,
        None => {}
    }
    renderer.end(refused, ended)
}

/// The command that renders the same again, or one scene of it alone.
fn again(global: &Global, options: &Options, scene: Option<&str>) -> String {
    let mut words = vec!["cornerbench render".to_owned(), options.suite.clone()];
    let path = |path: &PathBuf| path.to_string_lossy().into_owned();
    let mut option = |name: &str, value: Option<String>| {
        words.extend(value.map(|value| format!("{name} {value}").trim_end().to_owned()));
    };
    option("-o", options.output.as_ref().map(path));
    option("--recipes", global.recipes.as_ref().map(path));
    option("--variant", options.variant.clone());
    option("--ray", options.ray.clone());
    match scene {
        Some(scene) => option("--scenes", Some(scene.to_owned())),
        None => {
            option("--scenes", options.scenes.clone());
            option("--shard", options.shard.clone());
            option("--jobs", options.jobs.map(|jobs| jobs.to_string()));
            if options.estimate {
                words.push("--estimate".to_owned());
            }
        }
    }
    words.join(" ")
}
