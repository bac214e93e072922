//! `cornerbench measure`: a plan over a dataset.

use std::path::{Path, PathBuf};
use std::time::Duration;

use indicatif::HumanDuration;

use super::progress::counting;
use super::{Ended, Global, command_line, print, print_line, project};
use crate::error::Result;
use crate::plan::Plan;
use crate::report::{self, terminal};
use crate::run::{Choice, Outcome, Run, Shard};
use crate::scene::{Dataset, Split};
use crate::sensor::Photographer;

#[derive(clap::Args)]
pub(super) struct Options {
    /// The plan; `cornerbench list plans` names them.
    plan: String,
    /// The dataset's folder.
    #[arg(default_value = "out/quick/dataset")]
    dataset: PathBuf,
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
    let dataset = Dataset::open(&options.dataset)?;
    let split = options.split.map(|name| match name {
        SplitName::Dev => Split::Dev,
        SplitName::Test => Split::Test,
    });
    let choice = Choice { split, shard: options.shard };
    if options.list {
        return list(global, &options.plan, &dataset, choice);
    }
    let output = options.output.clone().unwrap_or_else(|| {
        let split = split.map_or(String::new(), |split| format!("-{}", split.name()));
        let shard = options
            .shard
            .map_or(String::new(), |Shard { first, count }| format!("-{first}of{count}"));
        PathBuf::from("out").join(format!("{}-{}{split}{shard}", options.plan, dataset.suite()))
    });
    measure(global, &options.plan, &dataset, choice, !options.no_timing, &output)
}

/// Measures, reports, and prints the table.
pub(super) fn measure(
    global: &Global,
    plan: &str,
    dataset: &Dataset,
    choice: Choice,
    is_timed: bool,
    output: &Path,
) -> Result<Ended> {
    let plan = Plan::read(&project::recipes(global)?, plan)?;
    let run = Run::new(&plan, dataset, choice);
    let bar = counting(global, run.own().len());
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
    if choice.shard.is_some() {
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
    let (summary, page) = report::write(output)?;
    if global.json {
        print_line(serde_json::json!(summary))?;
    } else {
        print(terminal::tables(&summary))?;
        print_line(format_args!("open {}", page.display()))?;
    }
    Ok(if outcome.unreadable == 0 { Ended::Well } else { Ended::Partly })
}

/// Says what would be measured.
fn list(global: &Global, plan: &str, dataset: &Dataset, choice: Choice) -> Result<Ended> {
    let plan = Plan::read(&project::recipes(global)?, plan)?;
    let extent = Run::new(&plan, dataset, choice).extent();
    let threads = rayon::current_num_threads();
    let left_s = extent.one_scene.map(|one| {
        // With fewer scenes than threads some have nothing to do.
        one.as_secs_f64() * extent.scenes.div_ceil(threads) as f64
    });
    let cameras: Vec<&str> = plan.cameras.iter().map(Photographer::name).collect();
    let methods: Vec<&str> = plan.pipelines.iter().map(|one| one.name.as_str()).collect();
    if global.json {
        print_line(serde_json::json!({
            "scenes": extent.scenes,
            "cameras": cameras,
            "exposures_per_scene": extent.exposures,
            "methods": methods,
            "one_scene_s": extent.one_scene.map(|one| one.as_secs_f64()),
            "expected_s": left_s,
        }))?;
        return Ok(Ended::Well);
    }
    for method in &methods {
        print_line(method)?;
    }
    print_line(format_args!(
        "{} methods on {} photographs of each of {} scenes ({})",
        methods.len(),
        extent.exposures,
        extent.scenes,
        cameras.join(", "),
    ))?;
    let about = left_s.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    if let Some(about) = about {
        let one_s = extent.one_scene.unwrap_or_default().as_secs_f64();
        print_line(format_args!(
            "about {} on {threads} threads (the first scene takes {one_s:.1} s on one)",
            HumanDuration(about)
        ))?;
    }
    Ok(Ended::Well)
}
