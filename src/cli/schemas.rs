//! `cornerbench schemas`: what editors complete and check recipes by.

use std::path::PathBuf;
use std::process::Command;

use super::environment::{Purpose, python};
use super::{Ended, Global, project};
use crate::error::{Error, Result};
use crate::files::write_json;
use crate::plan::Plan;
use crate::registry::schema;
use crate::sensor::{CameraModel, RangeSensor};

#[derive(clap::Args)]
pub(super) struct Options {
    /// Where to; the folder schemas among the recipes where this is not given.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let root = project::root()?;
    let folder = match &options.output {
        Some(folder) => std::path::absolute(folder).map_err(Error::io(folder, "find"))?,
        None => project::recipes(global)?.join("schemas"),
    };
    write_json(&folder.join("plan.json"), &Plan::schema())?;
    write_json(&folder.join("programs.json"), &crate::external::schema())?;
    write_json(&folder.join("camera.json"), &schema::<CameraModel>())?;
    write_json(&folder.join("range-sensor.json"), &schema::<RangeSensor>())?;
    // What Python reads has its schemas from there.
    let python = python(&root, Purpose::Rendering, &|line| global.say(line))?;
    for module in ["cornerscenes.schemas", "cornergrasps.schemas"] {
        let failed = |problem: String| Error::Program { program: module.into(), problem };
        let output = Command::new(&python)
            .args(["-m", module])
            .arg(&folder)
            .current_dir(root.join("scripts"))
            .output()
            .map_err(|error| failed(format!("cannot start: {error}")))?;
        if !output.status.success() {
            let complaint = String::from_utf8_lossy(&output.stderr);
            let last = complaint.lines().last().unwrap_or_default();
            return Err(failed(format!("ended with {}: {last}", output.status)));
        }
    }
    global.say(format!("schemas: {}", folder.display()));
    Ok(Ended::Well)
}
