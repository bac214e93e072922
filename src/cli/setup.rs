//! `cornerbench setup`: the Python environment alone.

use super::environment::{Purpose, python};
use super::{Ended, Global, project};
use crate::error::Result;

#[derive(clap::Args)]
pub(super) struct Options {
    /// Set up what the Python tests and linters need, too.
    #[arg(long)]
    dev: bool,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let purpose = if options.dev { Purpose::Development } else { Purpose::Rendering };
    let program = python(&project::root()?, purpose, &|line| global.say(line))?;
    if global.json {
        println!("{}", serde_json::json!({ "python": program }));
    } else {
        println!("{}", program.display());
    }
    Ok(Ended::Well)
}
