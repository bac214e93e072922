//! `cornerbench locate`: a detector and a refiner on a picture of one's own.

use std::path::PathBuf;

use super::{Ended, Global, print_line, project};
use crate::detect::Detection;
use crate::error::{Error, Result};
use crate::geometry::ImagePoint;
use crate::plan::{Plan, Seeds};
use crate::sensor::Exposure;

#[derive(clap::Args)]
pub(super) struct Options {
    /// A PNG, JPEG, TIFF or BMP picture; more than 8 bits per sample are rounded to 8.
    image: PathBuf,
    /// A point to refine instead of detected ones, in pixels: the centre of the top-left pixel is
    /// 0,0. May be given many times.
    #[arg(long, value_name = "X,Y", value_parser = parse_point, allow_hyphen_values = true)]
    at: Vec<ImagePoint>,
    /// A file of points to refine, X,Y a line.
    #[arg(long, value_name = "FILE")]
    points: Option<PathBuf>,
    /// The plan whose first pipeline names detector and refiner.
    #[arg(long, default_value = "paper")]
    plan: String,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let plan = Plan::read(&project::recipes(global)?, &options.plan)?;
    let pipeline = &plan.pipelines[0];
    let picture = image::open(&options.image)
        .map_err(|error| Error::malformed(&options.image, error))?
        .into_rgb8();
    let exposure = Exposure::from_picture(&picture);
    let mut points = options.at.clone();
    if let Some(path) = &options.points {
        let text = std::fs::read_to_string(path).map_err(Error::io(path, "read"))?;
        for (index, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
            let point = parse_point(line).map_err(|problem| {
                Error::malformed(path, format!("line {}: {problem}", index + 1))
            })?;
            points.push(point);
        }
    }
    let seeds: Vec<Detection> = if options.at.is_empty() && options.points.is_none() {
        let Seeds::Detected { detect, .. } = &pipeline.seeds else {
            return Err(Error::Other(format!(
                "plan {}: its first pipeline has no detector; choose another --plan, or give --at X,Y",
                options.plan
            )));
        };
        detect.algorithm.detect(&exposure, None)
    } else {
        points.into_iter().map(|point| Detection::new(point, 0.0)).collect()
    };
    for corner in pipeline.refine.algorithm.refine(&exposure, &seeds) {
        let (seed, at) = (corner.seed.point, corner.position);
        if global.json {
            print_line(serde_json::json!({
                "seed_px": seed,
                "position_px": at,
                "status": corner.status.name(),
                "iterations": corner.iterations,
                "response": corner.seed.response,
            }))?;
        } else {
            print_line(format_args!(
                "({:.3}, {:.3}) -> ({:.4}, {:.4})  {}",
                seed.x,
                seed.y,
                at.x,
                at.y,
                corner.status.name()
            ))?;
        }
    }
    Ok(Ended::Well)
}

pub(super) fn parse_point(text: &str) -> std::result::Result<ImagePoint, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(|part| part.trim().parse::<f64>())
        .collect::<std::result::Result<_, _>>()
        .map_err(|error| format!("{text:?} is no point ({error}), must be X,Y"))?;
    match numbers[..] {
        [x, y] if x.is_finite() && y.is_finite() => Ok(ImagePoint::new(x, y)),
        _ => Err(format!("{text:?} is no point, must be two finite numbers X,Y")),
    }
}
