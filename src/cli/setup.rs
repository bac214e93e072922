//! `cornerbench setup`: the Python environment alone.

use super::environment::{Purpose, python};
use super::{Ended, Global, print_line, project};
use crate::error::Result;

#[derive(clap::Args)]
pub(super) struct Options {
    /// Set up what the Python tests and linters need, too.
    #[arg(long)]
    dev: bool,
    /// Set up another environment, with Ray: for `render --ray`, and for the cluster's machines.
    #[arg(long, conflicts_with = "dev")]
    ray: bool,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let purpose = match options {
        Options { dev: true, .. } => Purpose::Development,
        Options { ray: true, .. } => Purpose::Ray,
        _ => Purpose::Rendering,
    };
    let program = python(&project::root()?, purpose, &|line| global.say(line))?;
    if global.json {
        print_line(serde_json::json!({ "python": program }))?;
    } else {
        print_line(program.display())?;
    }
    Ok(Ended::Well)
}
