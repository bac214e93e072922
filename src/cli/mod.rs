//! The command line: one file per subcommand.

mod compare;
pub mod environment;
mod estimate;
mod export;
mod expose;
mod grasp;
mod interrupt;
mod list;
mod locate;
mod measure;
mod merge;
mod own;
mod programs;
mod progress;
mod project;
mod quickstart;
mod recommend;
mod render;
mod report;
mod schemas;
mod script;
mod setup;
mod verify;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::error::{Error, Result};

/// How good is a sub-pixel corner, really, and what does it buy a robot that has to grasp?
///
/// Exit code: 0 all done, 1 some of the work failed or a check did, 2 nothing could be started, 130
/// interrupted, with all that was finished kept.
#[derive(Parser)]
#[command(version, propagate_version = true, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    global: Global,
}

/// Options of every subcommand.
#[derive(clap::Args, Clone, Debug)]
pub struct Global {
    /// Print results as JSON, for programs.
    #[arg(long, global = true)]
    json: bool,
    /// Print results and errors only.
    #[arg(short, long, global = true)]
    quiet: bool,
    /// Threads to measure or to render with; all cores where this is not given.
    #[arg(long, global = true, value_name = "N")]
    threads: Option<usize>,
    /// Folder of suites, families, plans, cameras, range sensors, grippers and robots to use instead of the project's own.
    #[arg(long, global = true, value_name = "DIR")]
    recipes: Option<PathBuf>,
}

impl Global {
    /// Tells a person what is going on: a line on standard error, unless `--quiet`.
    fn say(&self, line: impl AsRef<str>) {
        if !self.quiet {
            eprintln!("{}", line.as_ref());
        }
    }
}

#[derive(Subcommand)]
enum Command {
    /// Render suite `quick`, measure it by the paper's pipeline, write out/quick/report/index.html.
    Quickstart(quickstart::Options),
    /// Set up the Python environment that renders.
    Setup(setup::Options),
    /// Render the scenes of a suite that are missing or whose recipe changed.
    Render(render::Options),
    /// Run a plan's pipelines over a rendered dataset, over pictures of one's own, or over junctions that it draws, and
    /// score them against truth.
    Measure(measure::Options),
    /// Carry out the grasps of a run in physics: a robot, a gripper, friction and gravity in the rendered scenes.
    Grasp(grasp::Options),
    /// Make the shards of a run one: the same records as an unsharded run has, byte for byte.
    Merge(merge::Options),
    /// Compare two runs of the same scenes: exit code 1 where a method became worse, and not by chance.
    Compare(compare::Options),
    /// Say which method to use, within a time budget: chosen on scenes of split dev, confirmed on those of test.
    Recommend(recommend::Options),
    /// Write the report of a run again, from its records.
    Report(report::Options),
    /// Check a dataset: its integrity, and that renderer, reader and projection agree to 0.01 px; or an algorithm, also one
    /// of one's own: that it counts its coordinates and answers as all do.
    Verify(verify::Options),
    /// Photograph a dataset by a camera: pictures to look at or to use elsewhere.
    Expose(expose::Options),
    /// Export a dataset to another format: BOP or COCO keypoints.
    Export(export::Options),
    /// Refine points of, or find corners in, a picture of one's own.
    Locate(locate::Options),
    /// List what can be named: suites, families, plans, cameras, range sensors, grippers, robots, algorithms.
    List(list::Options),
    /// Write the JSON Schemas by which editors complete and check the recipes.
    Schemas(schemas::Options),
}

/// What a subcommand came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ended {
    /// All done.
    Well,
    /// Some of the work failed, or a check did.
    Partly,
    /// Interrupted; what was finished is kept.
    Interrupted,
}

/// Runs the command line and returns the exit code.
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(Ended::Well) => ExitCode::SUCCESS,
        Ok(Ended::Partly) => ExitCode::from(1),
        Ok(Ended::Interrupted) => ExitCode::from(interrupt::EXIT_CODE),
        Err(error) => {
            eprintln!("cornerbench: {}", error.chain());
            ExitCode::from(2)
        }
    }
}

fn run(arguments: &Arguments) -> Result<Ended> {
    let global = &arguments.global;
    if let Some(threads) = global.threads {
        crate::registry::in_range("command line", "--threads", threads, 1..=1024)?;
        // Fails only when the pool exists already, and nothing has used it before this.
        let _ = rayon::ThreadPoolBuilder::new().num_threads(threads).build_global();
    }
    match &arguments.command {
        Command::Quickstart(options) => quickstart::run(global, options),
        Command::Setup(options) => setup::run(global, options),
        Command::Render(options) => render::run(global, options),
        Command::Measure(options) => measure::run(global, options),
        Command::Grasp(options) => grasp::run(global, options),
        Command::Merge(options) => merge::run(global, options),
        Command::Compare(options) => compare::run(global, options),
        Command::Recommend(options) => recommend::run(global, options),
        Command::Report(options) => report::run(global, options),
        Command::Verify(options) => verify::run(global, options),
        Command::Expose(options) => expose::run(global, options),
        Command::Export(options) => export::run(global, options),
        Command::Locate(options) => locate::run(global, options),
        Command::List(options) => list::run(global, options),
        Command::Schemas(options) => schemas::run(global, options),
    }
}

/// The folder of outputs where none is given: out/NAME, where this program was started.
fn default_output(name: &str) -> PathBuf {
    PathBuf::from("out").join(name)
}

/// Prints a result. A reader that has seen enough and closed the pipe is no failure.
fn print(text: impl std::fmt::Display) -> Result<()> {
    use std::io::Write as _;
    match write!(std::io::stdout().lock(), "{text}") {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::io(std::path::Path::new("standard output"), "write")(error))
        }
        _ => Ok(()),
    }
}

/// Prints a result on a line of its own.
fn print_line(text: impl std::fmt::Display) -> Result<()> {
    print(format_args!("{text}\n"))
}

/// The command line as it was given, for the record.
fn command_line() -> String {
    let mut words = vec!["cornerbench".to_owned()];
    words.extend(std::env::args().skip(1));
    words.join(" ")
}
