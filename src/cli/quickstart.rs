//! `cornerbench quickstart`: from a clone to a first table.

use super::measure::measure;
use super::{Ended, Global, default_output, render};
use crate::error::Result;
use crate::run::Choice;
use crate::scene::Dataset;

const SUITE: &str = "quick";
const PLAN: &str = "paper";

#[derive(clap::Args)]
pub(super) struct Options {}

pub(super) fn run(global: &Global, _: &Options) -> Result<Ended> {
    let output = default_output(SUITE);
    let folder = output.join("dataset");
    let rendered = render::render(global, &render::Options::whole(SUITE, &folder))?;
    if rendered == Ended::Interrupted {
        return Ok(rendered);
    }
    let measured =
        measure(global, PLAN, &Dataset::open(&folder)?, Choice::default(), true, &output)?;
    Ok(if rendered == Ended::Well { measured } else { rendered })
}
