//! `cornerbench measure`: a plan over a dataset, over pictures of one's own, or over what it draws.

use std::path::{Path, PathBuf};

use indicatif::HumanDuration;

use super::own::PictureOptions;
use super::progress::counting;
use super::{Ended, Global, command_line, print, print_line, programs, project};
use crate::error::{Error, Result};
use crate::picture::{EXTENSIONS, find_pictures};
use crate::plan::{Pipeline, Plan, Seeds};
use crate::report::{self, terminal};
use crate::run::{Album, Choice, Outcome, Run, Shard};
use crate::scene::{Dataset, Split};

#[derive(clap::Args)]
pub(super) struct Options {
    /// The plan; `cornerbench list plans` names them.
    plan: String,
    /// The folder of a dataset or of pictures of one's own, out/quick/dataset where none is given; of a plan that draws
    /// its junctions none.
    #[arg(value_name = "FOLDER")]
    dataset: Option<PathBuf>,
    /// Only the scenes of one split, dev or test; pictures, sorted by name, take turns.
    #[arg(long)]
    split: Option<SplitName>,
    /// Only every N-th scene, from number I, 0 to N - 1: for N machines, whose runs `merge` makes one.
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Say what would be measured and how long it may take, and end. One scene is measured for that.
    #[arg(long)]
    list: bool,
    /// Leave out the times that pipelines take, measured after all else on one thread.
    #[arg(long)]
    no_timing: bool,
    /// Algorithms that are other programs, beside the plan's own in every stage that does what they do: their names
    /// (`cornerbench list programs`), "all", or the file of one's own: a program, a TOML file, or a CSV or JSON file of
    /// corners that were computed elsewhere (scripts/PROTOCOL.md).
    #[arg(long, value_name = "NAME|FILE")]
    with: Vec<String>,
    /// The run's folder; out/PLAN-SUITE, with split and shard behind it, where this is not given.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    own: PictureOptions,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum SplitName {
    Dev,
    Test,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let programs = programs::open(global, &options.with)?;
    programs::say(global, &programs);
    let mut plan = Plan::read_with(&project::recipes(global)?, &options.plan, &programs)?;
    for file in programs::answers(&options.with)? {
        plan.add_answers(file)?;
    }
    let split = options.split.map(|name| match name {
        SplitName::Dev => Split::Dev,
        SplitName::Test => Split::Test,
    });
    let choice = Choice { split, shard: options.shard };
    if !plan.cells.is_empty() {
        check_drawn(&plan, options)?;
        return run_one(global, options, &plan, &Run::of_drawn(&plan, options.shard), None);
    }
    let given = options.dataset.clone();
    let folder = given.unwrap_or_else(|| PathBuf::from("out/quick/dataset"));
    if folder.is_file() {
        return Err(Error::Other(format!(
            "{}: is a file; name the folder of a dataset or of pictures",
            folder.display()
        )));
    }
    if !folder.is_dir() || folder.join("dataset.json").is_file() {
        let dataset = Dataset::open(&folder)?;
        check_dataset(&dataset, options)?;
        let run = Run::new(&plan, &dataset, choice)?;
        return run_one(global, options, &plan, &run, Some(dataset.suite()));
    }
    check_pictures(&folder)?;
    let camera = options.own.read_camera(global)?;
    let making = options.own.making(camera.as_ref());
    let known = options.own.known.as_deref();
    let album = Album::open(&folder, making, known, options.own.origin())?;
    let run = Run::of_album(&plan, &album, choice)?;
    say_what_is_left_out(global, &plan, &album, known.is_some());
    run_one(global, options, &plan, &run, Some(album.suite()))
}

/// Measures a run, or says what it would be.
fn run_one(
    global: &Global,
    options: &Options,
    plan: &Plan,
    run: &Run,
    suite: Option<&str>,
) -> Result<Ended> {
    if options.list {
        return list(global, plan, run);
    }
    let output = options.output.clone().unwrap_or_else(|| {
        let suite = suite.map_or(String::new(), |suite| format!("-{suite}"));
        let split = match options.split {
            None => "",
            Some(SplitName::Dev) => "-dev",
            Some(SplitName::Test) => "-test",
        };
        let shard = options
            .shard
            .map_or(String::new(), |Shard { first, count }| format!("-{first}of{count}"));
        PathBuf::from("out").join(format!("{}{suite}{split}{shard}", options.plan))
    });
    measure(global, run, &output, options.shard.is_some(), !options.no_timing)
}

/// Refuses what drawn junctions have nothing of.
fn check_drawn(plan: &Plan, options: &Options) -> Result<()> {
    if options.dataset.is_some() || options.split.is_some() {
        return Err(Error::Other(format!(
            "plan {}: draws its junctions, which are no dataset and have no split; leave out both",
            plan.name
        )));
    }
    match options.own.given() {
        Some(name) => Err(Error::Other(format!(
            "plan {}: draws its junctions, and {name} is of pictures of one's own; leave it out, or take a plan without \
             [[drawn]]",
            plan.name
        ))),
        None => Ok(()),
    }
}

/// Refuses what a dataset knows itself.
fn check_dataset(dataset: &Dataset, options: &Options) -> Result<()> {
    match options.own.given() {
        Some(name) => Err(Error::Other(format!(
            "{}: is a dataset, whose corners are known and which the plan's cameras photograph, and {name} is of pictures \
             of one's own; leave it out, or name a folder of pictures",
            dataset.folder().display()
        ))),
        None => Ok(()),
    }
}

/// Refuses a folder without pictures.
fn check_pictures(folder: &Path) -> Result<()> {
    if find_pictures(folder).is_ok() {
        return Ok(());
    }
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder, "read"))?;
    let mut names: Vec<String> =
        entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    let found = match &names[..] {
        [] => "nothing".to_owned(),
        [one] => one.clone(),
        [first, others @ ..] => format!("{first} and {} more", others.len()),
    };
    Err(Error::Other(format!(
        "{}: no dataset here (dataset.json is missing) and no picture; there is {found}, and the name of a picture ends in \
         .{}; name another folder, or render a dataset: cornerbench render SUITE -o {}",
        folder.display(),
        EXTENSIONS.join(", ."),
        folder.display()
    )))
}

/// Says what of a plan, or of pictures, is not measured.
fn say_what_is_left_out(global: &Global, plan: &Plan, album: &Album, has_known: bool) {
    if plan.pipelines.iter().any(|pipeline| pipeline.grasp.is_some()) {
        global.say("pictures have no range image: pipelines end with their corners, without face and grasp");
    }
    if album.camera().is_none() {
        global.say(super::own::NO_CAMERA);
    }
    let unknown = album.without_known_corners().count();
    if has_known && unknown > 0 {
        global.say(format!("no corner is known of {unknown} of {} pictures", album.len()));
    }
    let is_given = |pipeline: &&Pipeline| matches!(pipeline.seeds, Seeds::Disc { .. });
    let given = plan.pipelines.iter().filter(is_given).count();
    if unknown > 0 && given > 0 {
        global.say(format!(
            "{given} of {} pipelines are given seeds about known corners: left out where none is known",
            plan.pipelines.len()
        ));
    }
}

/// Measures all scenes of a dataset by a plan, reports, and prints the table.
pub(super) fn measure_all(
    global: &Global,
    plan: &str,
    dataset: &Dataset,
    output: &Path,
) -> Result<Ended> {
    let plan = Plan::read(&project::recipes(global)?, plan)?;
    measure(global, &Run::new(&plan, dataset, Choice::default())?, output, false, true)
}

fn measure(
    global: &Global,
    run: &Run,
    output: &Path,
    is_shard: bool,
    is_timed: bool,
) -> Result<Ended> {
    let bar = counting(global, run.len());
    let outcome = run.measure(output, &command_line(), &|_| bar.inc(1));
    bar.finish_and_clear();
    let outcome = outcome?;
    // Times are no reason to lose what was measured.
    if is_timed && let Err(error) = run.time(output) {
        global.say(format!("no times: {}", error.chain()));
    }
    if outcome.resumed > 0 {
        let all = outcome.scenes + outcome.unreadable;
        global.say(format!("{} of {all} scenes had been measured already", outcome.resumed));
    }
    if is_shard {
        global.say(format!(
            "{}: a shard; cornerbench merge SHARD... -o RUN makes all of them one run",
            output.display()
        ));
        return Ok(ended(outcome));
    }
    show(global, output, outcome)
}

/// Reports on a run, and prints the table.
pub(super) fn show(global: &Global, output: &Path, outcome: Outcome) -> Result<Ended> {
    let report = report::write(output)?;
    if global.json {
        print_line(report.json())?;
    } else {
        print(terminal::tables(&report))?;
        print_line(format_args!("open {}", report.page.display()))?;
    }
    Ok(ended(outcome))
}

fn ended(outcome: Outcome) -> Ended {
    if outcome.unreadable == 0 && outcome.failed == 0 { Ended::Well } else { Ended::Partly }
}

/// Says what would be measured.
fn list(global: &Global, plan: &Plan, run: &Run) -> Result<Ended> {
    let extent = run.extent();
    let threads = rayon::current_num_threads();
    let cameras = run.camera_names();
    let methods: Vec<&str> = plan.pipelines.iter().map(|one| one.name.as_str()).collect();
    let cells: Vec<&str> = plan.cells.iter().map(|cell| cell.name.as_str()).collect();
    if global.json {
        print_line(serde_json::json!({
            "scenes": extent.scenes,
            "cells": cells,
            "cameras": cameras,
            "exposures": extent.exposures,
            "methods": methods,
            "one_scene_s": extent.one_scene.map(|one| one.as_secs_f64()),
            "expected_s": extent.expected.map(|expected| expected.as_secs_f64()),
        }))?;
        return Ok(Ended::Well);
    }
    for line in methods.iter().chain(&cells) {
        print_line(line)?;
    }
    let unit = run.unit();
    print_line(format_args!(
        "{} methods on {} photographs of {} {unit}s ({})",
        methods.len(),
        extent.exposures,
        extent.scenes,
        cameras.join(", "),
    ))?;
    if let Some((one, expected)) = extent.one_scene.zip(extent.expected) {
        let by = if cells.is_empty() { " on one" } else { "" };
        print_line(format_args!(
            "about {} on {threads} threads (the first {unit} takes {:.1} s{by})",
            HumanDuration(expected),
            one.as_secs_f64()
        ))?;
    }
    Ok(Ended::Well)
}
