//! `cornerbench measure`: a plan over a dataset.

use std::path::{Path, PathBuf};

use super::{Ended, Global, command_line, print, print_line, project};
use crate::error::Result;
use crate::plan::Plan;
use crate::report::{self, terminal};
use crate::run;
use crate::scene::Dataset;

#[derive(clap::Args)]
pub(super) struct Options {
    /// The plan; `cornerbench list plans` names them.
    plan: String,
    /// The dataset's folder.
    #[arg(default_value = "out/quick/dataset")]
    dataset: PathBuf,
    /// The run's folder; out/PLAN-SUITE where this is not given.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let dataset = Dataset::open(&options.dataset)?;
    let output = options.output.clone().unwrap_or_else(|| {
        PathBuf::from("out").join(format!("{}-{}", options.plan, dataset.suite()))
    });
    measure(global, &options.plan, &dataset, &output)
}

/// Measures, reports, and prints the table.
pub(super) fn measure(
    global: &Global,
    plan: &str,
    dataset: &Dataset,
    output: &Path,
) -> Result<Ended> {
    let plan = Plan::read(&project::recipes(global)?, plan)?;
    let outcome = run::measure(&plan, dataset, output, &command_line(), &|_| {})?;
    let (summary, page) = report::write(output)?;
    if global.json {
        print_line(serde_json::json!(summary))?;
    } else {
        print(terminal::tables(&summary))?;
        print_line(format_args!("open {}", page.display()))?;
    }
    Ok(if outcome.unreadable == 0 { Ended::Well } else { Ended::Partly })
}
