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
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let (summary, page) = report::write(&options.run)?;
    if global.json {
        print_line(serde_json::json!(summary))?;
    } else {
        print(terminal::tables(&summary))?;
        print_line(format_args!("open {}", page.display()))?;
    }
    Ok(Ended::Well)
}
