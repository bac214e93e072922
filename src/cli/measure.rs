//! `cornerbench measure`: a plan over a dataset.

use std::path::{Path, PathBuf};

use super::{Ended, Global, command_line, print, print_line, project};
use crate::error::Result;
use crate::plan::Plan;
use crate::report::{self, terminal};
use crate::run;
use crate::scene::{Dataset, Split};

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
    /// The run's folder; out/PLAN-SUITE, with the split behind it, where this is not given.
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
    let output = options.output.clone().unwrap_or_else(|| {
        let split = split.map_or(String::new(), |split| format!("-{}", split.name()));
        PathBuf::from("out").join(format!("{}-{}{split}", options.plan, dataset.suite()))
    });
    measure(global, &options.plan, &dataset, split, &output)
}

/// Measures, reports, and prints the table.
pub(super) fn measure(
    global: &Global,
    plan: &str,
    dataset: &Dataset,
    split: Option<Split>,
    output: &Path,
) -> Result<Ended> {
    let plan = Plan::read(&project::recipes(global)?, plan)?;
    let outcome = run::measure(&plan, dataset, split, output, &command_line(), &|_| {})?;
    let (summary, page) = report::write(output)?;
    if global.json {
        print_line(serde_json::json!(summary))?;
    } else {
        print(terminal::tables(&summary))?;
        print_line(format_args!("open {}", page.display()))?;
    }
    Ok(if outcome.unreadable == 0 { Ended::Well } else { Ended::Partly })
}
