//! `cornerbench render`: the renderer's process, its progress, its failures.

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use indicatif::{ProgressBar, ProgressStyle};
use serde::Deserialize;

use super::environment::{Purpose, python};
use super::{Ended, Global, default_output, project};
use crate::error::{Error, Result};
use crate::plan::read_table;

#[derive(clap::Args)]
pub(super) struct Options {
    /// The suite; `cornerbench list suites` names them.
    suite: String,
    /// Where to; out/SUITE/dataset where this is not given.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// A Mitsuba variant to use instead of the fastest one.
    #[arg(long, value_name = "NAME")]
    variant: Option<String>,
}

/// What the renderer says, one JSON object a line.
#[derive(Debug, Deserialize)]
#[serde(tag = "event", rename_all = "lowercase")]
enum Event {
    Start { scenes: u64, missing: u64 },
    Slow { message: String },
    Rendering { scene: String },
    Done { scene: String, visible_fraction: f64, seconds: f64 },
    Failed { scene: String, message: String },
    Error { message: String },
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let folder =
        options.output.clone().unwrap_or_else(|| default_output(&options.suite).join("dataset"));
    let ended = render(global, &options.suite, &folder, options.variant.as_deref())?;
    global.say(format!("dataset: {}", folder.display()));
    Ok(ended)
}

/// Renders what is missing of a suite into `folder`.
pub(super) fn render(
    global: &Global,
    suite: &str,
    folder: &Path,
    variant: Option<&str>,
) -> Result<Ended> {
    let root = project::root()?;
    let recipes = project::recipes(global)?;
    read_table(&recipes, "suites", suite)?;
    let program = python(&root, Purpose::Rendering, &|line| global.say(line))?;
    let folder = std::path::absolute(folder).map_err(Error::io(folder, "find"))?;
    let mut command = Command::new(program);
    command
        .args(["-m", "cornerscenes.render", suite, "--recipes"])
        .arg(&recipes)
        .arg("--output")
        .arg(&folder)
        .current_dir(root.join("scripts"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    if let Some(variant) = variant {
        command.args(["--variant", variant]);
    }
    let failed = |problem: String| Error::Program { program: "the renderer".into(), problem };
    let child = command.spawn().map_err(|error| failed(format!("cannot start: {error}")))?;
    let mut child = Guarded(child);
    let stdout = child.0.stdout.take().ok_or_else(|| failed("has no output".into()))?;
    let mut stderr = child.0.stderr.take().ok_or_else(|| failed("has no output".into()))?;
    let complaints = std::thread::spawn(move || {
        let mut text = Vec::new();
        // What cannot be read of the complaints is not worth an error of its own.
        let _ = stderr.read_to_end(&mut text);
        String::from_utf8_lossy(&text).into_owned()
    });

    let bar = bar(global);
    let mut ended = Ended::Well;
    let mut said_slow = false;
    let mut refused = None;
    for line in BufReader::new(stdout).lines() {
        let line = line.map_err(|error| failed(format!("its output broke off: {error}")))?;
        let event: Event = serde_json::from_str(&line)
            .map_err(|error| failed(format!("said what is no event ({error}): {line}")))?;
        match event {
            Event::Start { scenes, missing } => {
                bar.set_length(missing);
                let there = scenes - missing;
                global.say(format!("suite {suite}: {there} of {scenes} scenes are rendered"));
            }
            Event::Slow { message } if !said_slow => {
                said_slow = true;
                bar.suspend(|| global.say(message));
            }
            Event::Slow { .. } => {}
            Event::Rendering { scene } => bar.set_message(scene),
            Event::Done { scene, visible_fraction, seconds } => {
                bar.inc(1);
                bar.suspend(|| {
                    global.say(format!(
                        "rendered {scene} in {seconds:.1} s, {:.0} % of the target seen",
                        100.0 * visible_fraction
                    ));
                });
            }
            Event::Failed { scene, message } => {
                bar.inc(1);
                ended = Ended::Partly;
                bar.suspend(|| eprintln!("{scene} failed: {message}"));
            }
            Event::Error { message } => refused = Some(message),
        }
    }
    bar.finish_and_clear();
    let status =
        child.0.wait().map_err(|error| failed(format!("cannot be waited for: {error}")))?;
    let complaints = complaints.join().unwrap_or_default();
    match (refused, status.code()) {
        (Some(message), _) => Err(Error::Other(message)),
        (None, Some(0)) => Ok(ended),
        (None, Some(1)) if ended == Ended::Partly => Ok(ended),
        _ => {
            let last: Vec<&str> = complaints.lines().rev().take(3).collect();
            let last: Vec<&str> = last.into_iter().rev().collect();
            Err(failed(format!("ended with {status}: {}", last.join(" | "))))
        }
    }
}

/// A process that does not outlive its use.
struct Guarded(Child);

impl Drop for Guarded {
    fn drop(&mut self) {
        // Both fail when it has ended already, which is the usual case.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A progress bar with the time that is left; hidden where standard error is no terminal.
pub(super) fn bar(global: &Global) -> ProgressBar {
    if global.quiet {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg} {elapsed} (left: {eta})");
    let bar = ProgressBar::new(0);
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.enable_steady_tick(std::time::Duration::from_millis(200));
    bar
}
