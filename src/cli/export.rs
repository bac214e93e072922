//! `cornerbench export`: a dataset in another format.

use std::path::PathBuf;

use super::progress::counting;
use super::{Ended, Global, command_line, default_output, print_line, project};
use crate::error::Result;
use crate::export::{Format, Request, export};
use crate::plan::read_camera;
use crate::scene::Dataset;

#[derive(clap::Args)]
pub(super) struct Options {
    /// The dataset's folder.
    #[arg(default_value = "out/quick/dataset")]
    dataset: PathBuf,
    /// The format.
    #[arg(short, long)]
    format: Format,
    /// The export's folder; out/SUITE/FORMAT where this is not given. An earlier export is replaced.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// The camera that takes the pictures; `cornerbench list cameras` names them.
    #[arg(long, value_name = "NAME", default_value = "ideal")]
    camera: String,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let dataset = Dataset::open(&options.dataset)?;
    let photographer = read_camera(&project::recipes(global)?, &options.camera)?;
    let request = Request {
        format: options.format,
        camera: &options.camera,
        photographer: &photographer,
        command: &command_line(),
    };
    let output = options
        .output
        .clone()
        .unwrap_or_else(|| default_output(dataset.suite()).join(options.format.name()));
    let bar = counting(global, dataset.scenes().count());
    let exported = export(&dataset, &request, &output, &mut |name, error| {
        bar.inc(1);
        bar.set_message(name.to_owned());
        if let Some(error) = error {
            bar.suspend(|| eprintln!("{name} skipped: {}", error.chain()));
        }
    });
    bar.finish_and_clear();
    let exported = exported?;
    if global.json {
        print_line(serde_json::json!({ "output": output, "export": exported }))?;
    } else {
        print_line(format_args!(
            "exported {} of {} scenes: {}",
            exported.scenes.len(),
            dataset.scenes().count(),
            output.display()
        ))?;
    }
    Ok(if exported.unreadable.is_empty() { Ended::Well } else { Ended::Partly })
}
