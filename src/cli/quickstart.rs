//! `cornerbench quickstart`: from a clone to a first table.

use super::measure::measure;
use super::render::render;
use super::{Ended, Global, default_output};
use crate::error::Result;
use crate::scene::Dataset;

const SUITE: &str = "quick";
const PLAN: &str = "paper";

#[derive(clap::Args)]
pub(super) struct Options {}

pub(super) fn run(global: &Global, _: &Options) -> Result<Ended> {
    let output = default_output(SUITE);
    let folder = output.join("dataset");
    let rendered = render(global, SUITE, &folder, None)?;
    let measured = measure(global, PLAN, &Dataset::open(&folder)?, None, &output)?;
    Ok(if rendered == Ended::Well { measured } else { rendered })
}
