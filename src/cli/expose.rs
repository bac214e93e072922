//! `cornerbench expose`: photographs of a dataset.

use std::path::PathBuf;

use super::progress::counting;
use super::{Ended, Global, command_line, default_output, print_line, project};
use crate::error::Result;
use crate::geometry::ImagePoint;
use crate::plan::{read_camera, read_range_sensor};
use crate::run::{Wanted, photograph};
use crate::scene::Dataset;

#[derive(clap::Args)]
pub(super) struct Options {
    /// The dataset's folder.
    #[arg(default_value = "out/quick/dataset")]
    dataset: PathBuf,
    /// The camera; `cornerbench list cameras` names them.
    #[arg(short, long, value_name = "NAME")]
    camera: String,
    /// A range sensor to take a range image with each; `cornerbench list range-sensors` names them.
    #[arg(long, value_name = "NAME")]
    range_sensor: Option<String>,
    /// The folder of photographs; out/SUITE/CAMERA where this is not given.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Where in the rendered image the centre of pixel (0, 0) is, in pixels; may be repeated.
    #[arg(
        long = "phase", value_name = "X,Y", value_parser = super::locate::parse_point,
        allow_hyphen_values = true, default_value = "0,0"
    )]
    phases: Vec<ImagePoint>,
    /// Photographs at each phase, each with noise of its own.
    #[arg(long, value_name = "N", default_value_t = 1)]
    repeats: u32,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    crate::registry::in_range("command line", "--repeats", options.repeats, 1..=100_000)?;
    for phase in &options.phases {
        for value in [phase.x, phase.y] {
            crate::registry::in_range("command line", "--phase", value, -16.0..=16.0)?;
        }
    }
    let dataset = Dataset::open(&options.dataset)?;
    let recipes = project::recipes(global)?;
    let photographer = read_camera(&recipes, &options.camera)?;
    let range_sensor = match &options.range_sensor {
        Some(name) => Some((name.clone(), read_range_sensor(&recipes, name)?)),
        None => None,
    };
    let wanted = Wanted {
        phases_px: options.phases.iter().map(|phase| [phase.x, phase.y]).collect(),
        repeats: options.repeats,
        range_sensor,
    };
    let output = options
        .output
        .clone()
        .unwrap_or_else(|| default_output(dataset.suite()).join(&options.camera));
    let bar = counting(global, dataset.scenes().count());
    let found =
        photograph(&dataset, &photographer, &wanted, &output, &command_line(), &|name, error| {
            bar.inc(1);
            bar.set_message(name.to_owned());
            if let Some(error) = error {
                bar.suspend(|| eprintln!("{name} skipped: {}", error.chain()));
            }
        });
    bar.finish_and_clear();
    let found = found?;
    if global.json {
        print_line(serde_json::json!({ "output": output, "photographs": found }))?;
    } else {
        print_line(format_args!(
            "photographed {} of {} scenes: {}",
            found.scenes.len(),
            dataset.scenes().count(),
            output.display()
        ))?;
    }
    Ok(if found.failed.is_empty() { Ended::Well } else { Ended::Partly })
}
