//! `cornerbench measure`: a plan over a dataset.

use std::path::{Path, PathBuf};

use indicatif::HumanDuration;

use super::progress::counting;
use super::{Ended, Global, command_line, print, print_line, project};
use crate::error::{Error, Result};
use crate::plan::Plan;
use crate::report::{self, terminal};
use crate::run::{Choice, Outcome, Run, Shard};
use crate::scene::{Dataset, Split};
use crate::sensor::Photographer;

#[derive(clap::Args)]
pub(super) struct Options {
    /// The plan; `cornerbench list plans` names them.
    plan: String,
    /// The dataset's folder, out/quick/dataset where none is given; of a plan that draws its junctions none.
    dataset: Option<PathBuf>,
    /// Only the scenes of one split, dev or test.
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
    /// The run's folder; out/PLAN-SUITE, with split and shard behind it, where this is not given.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum SplitName {
    Dev,
    Test,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let plan = Plan::read(&project::recipes(global)?, &options.plan)?;
    let split = options.split.map(|name| match name {
        SplitName::Dev => Split::Dev,
        SplitName::Test => Split::Test,
    });
    let dataset = match (&options.dataset, plan.cells.is_empty()) {
        (given, true) => {
            let folder = given.clone().unwrap_or_else(|| PathBuf::from("out/quick/dataset"));
            Some(Dataset::open(&folder)?)
        }
        (None, false) if split.is_none() => None,
        (..) => {
            return Err(Error::Other(format!(
                "plan {}: draws its junctions, which are no dataset and have no split; leave out both",
                plan.name
            )));
        }
    };
    let run = match &dataset {
        Some(dataset) => Run::new(&plan, dataset, Choice { split, shard: options.shard }),
        None => Run::of_drawn(&plan, options.shard),
    };
    if options.list {
        return list(global, &plan, &run);
    }
    let suite = dataset.as_ref().map_or(String::new(), |dataset| format!("-{}", dataset.suite()));
    let output = options.output.clone().unwrap_or_else(|| {
        let split = split.map_or(String::new(), |split| format!("-{}", split.name()));
        let shard = options
            .shard
            .map_or(String::new(), |Shard { first, count }| format!("-{first}of{count}"));
        PathBuf::from("out").join(format!("{}{suite}{split}{shard}", options.plan))
    });
    measure(global, &run, &output, options.shard.is_some(), !options.no_timing)
}

/// Measures all scenes of a dataset by a plan, reports, and prints the table.
pub(super) fn measure_all(
    global: &Global,
    plan: &str,
    dataset: &Dataset,
    output: &Path,
) -> Result<Ended> {
    let plan = Plan::read(&project::recipes(global)?, plan)?;
    measure(global, &Run::new(&plan, dataset, Choice::default()), output, false, true)
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
        return Ok(if outcome.unreadable == 0 { Ended::Well } else { Ended::Partly });
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
    Ok(if outcome.unreadable == 0 { Ended::Well } else { Ended::Partly })
}

/// Says what would be measured.
fn list(global: &Global, plan: &Plan, run: &Run) -> Result<Ended> {
    let extent = run.extent();
    let threads = rayon::current_num_threads();
    let cameras: Vec<&str> = plan.cameras.iter().map(Photographer::name).collect();
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
    let unit = if cells.is_empty() { "scene" } else { "cell" };
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
