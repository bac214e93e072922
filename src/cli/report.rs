//! `cornerbench report`: a run's report, from its records.

use std::path::PathBuf;

use super::{Ended, Global, print, print_line};
use crate::error::Result;
use crate::report::{self, terminal};

#[derive(clap::Args)]
pub(super) struct Options {
    /// The run's folder.
    #[arg(default_value = "out/quick")]
    run: PathBuf,
    /// A Markdown file to put the run's tables into: between `<!-- results of PLAN: TABLE -->` and `<!-- end of results
    /// -->`.
    #[arg(long, value_name = "FILE")]
    into: Option<PathBuf>,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let report = report::write(&options.run)?;
    if let Some(path) = &options.into {
        report.splice(path)?;
    }
    if global.json {
        print_line(report.json())?;
    } else {
        print(terminal::tables(&report))?;
        print_line(format_args!("open {}", report.page.display()))?;
    }
    Ok(Ended::Well)
}
