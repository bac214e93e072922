//! `cornerbench merge`: the shards of a run made one.

use std::path::PathBuf;

use super::{Ended, Global, command_line, measure};
use crate::error::Result;
use crate::run;

#[derive(clap::Args)]
pub(super) struct Options {
    /// The folders of all shards, in any order.
    #[arg(required = true, value_name = "SHARD")]
    shards: Vec<PathBuf>,
    /// The folder of the run that they become.
    #[arg(short, long, value_name = "RUN")]
    output: PathBuf,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let outcome = run::merge(&options.shards, &options.output, &command_line())?;
    measure::show(global, &options.output, outcome)
}
