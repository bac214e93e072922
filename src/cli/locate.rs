//! `cornerbench locate`: detectors and refiners on pictures of one's own.

mod output;

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use toml::Table;

use super::own::PictureOptions;
use super::progress::counting;
use super::{Ended, Global, programs, project};
use crate::detect::{DETECTORS, Detection, Detector};
use crate::error::{Error, Result};
use crate::external::{Asked, Task as Does};
use crate::geometry::ImagePoint;
use crate::picture::{KnownCorner, KnownCorners, Located, Making, find_pictures, read_picture};
use crate::plan::{AnyStage, Plan, Seeds};
use crate::refine::{REFINERS, Refiner};

#[derive(clap::Args)]
pub(super) struct Options {
    /// Pictures, or folders of pictures: PNG, JPEG, TIFF, BMP or OpenEXR, by 8 or 16 bits or floats.
    #[arg(required = true, value_name = "IMAGE|FOLDER")]
    images: Vec<PathBuf>,
    /// A point to refine instead of detected ones, in pixels: the centre of the top-left pixel is
    /// 0,0. May be given many times.
    #[arg(long, value_name = "X,Y", value_parser = parse_point, allow_hyphen_values = true)]
    at: Vec<ImagePoint>,
    /// A file of points to refine, X,Y a line; where neither these nor a detector are asked for, known corners are the
    /// seeds.
    #[arg(long, value_name = "FILE")]
    points: Option<PathBuf>,
    /// The detector, with its defaults, instead of the plan's; `cornerbench list detectors` names them.
    #[arg(long, value_name = "NAME", conflicts_with_all = ["at", "points"])]
    detector: Option<String>,
    /// Refiners, with their defaults, instead of the plan's, side by side; "all" is every one.
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    refiner: Vec<String>,
    /// Algorithms that are other programs, to name as --detector or --refiner: their names, or the file of one's own.
    #[arg(long, value_name = "NAME|FILE")]
    with: Vec<String>,
    /// The plan whose first pipeline names detector and refiner.
    #[arg(long, default_value = "paper")]
    plan: String,
    /// A CSV file for all corners.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    own: PictureOptions,
}

/// What to do with each picture.
struct Task {
    /// None where seeds are given.
    detector: Option<AnyStage<dyn Detector>>,
    refiners: Vec<AnyStage<dyn Refiner>>,
    /// Seeds that were given; no detector is asked then.
    points: Option<Vec<ImagePoint>>,
    known: Option<KnownCorners>,
    /// Whether seeds are the known corners.
    seeds_known: bool,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let task = task(global, options)?;
    let camera = options.own.read_camera(global)?;
    let making = options.own.making(camera.as_ref());
    let pictures = pictures(&options.images)?;
    let known = match &task.known {
        Some(known) => known.of_pictures(&pictures)?,
        None => vec![Vec::new(); pictures.len()],
    };
    let bar = (pictures.len() > 1).then(|| counting(global, pictures.len()));
    let tried: Vec<Result<Located>> = pictures
        .par_iter()
        .zip(known)
        .map(|(path, known)| {
            let located = task.locate(path, known, &making);
            bar.iter().for_each(|bar| bar.inc(1));
            located
        })
        .collect();
    bar.iter().for_each(indicatif::ProgressBar::finish_and_clear);
    let mut located = Vec::new();
    let mut failures = Vec::new();
    for tried in tried {
        match tried {
            Ok(picture) => located.push(picture),
            Err(error) => failures.push(error),
        }
    }
    if located.is_empty() && !failures.is_empty() {
        return Err(failures.swap_remove(0));
    }
    for failure in &failures {
        eprintln!("skipped: {}", failure.chain());
    }
    output::show(global, options, &task, &located)?;
    Ok(if failures.is_empty() { Ended::Well } else { Ended::Partly })
}

fn task(global: &Global, options: &Options) -> Result<Task> {
    let plan = Plan::read(&project::recipes(global)?, &options.plan)?;
    let programs = programs::open(global, &options.with)?;
    // A plan has one at least.
    let pipeline = plan.pipelines.into_iter().next();
    let pipeline =
        pipeline.ok_or_else(|| Error::Other(format!("plan {}: no pipelines", options.plan)))?;
    let origin = options.own.origin();
    let known = options.own.known.as_ref().map(|path| KnownCorners::read(path, origin));
    let known = known.transpose()?;
    let points = points(options)?;
    let seeds_known = known.is_some() && points.is_none() && options.detector.is_none();
    let detector = match (&options.detector, pipeline.seeds) {
        _ if points.is_some() || seeds_known => None,
        (Some(name), _) => {
            let none = Table::new();
            Some(AnyStage::choose("--detector", DETECTORS, &programs, Does::Detect, name, none)?)
        }
        (None, Seeds::Detected { detect, .. }) => Some(detect),
        (None, Seeds::Disc { .. } | Seeds::Elsewhere(_)) => {
            return Err(Error::Other(format!(
                "plan {}: its first pipeline has no detector; give --detector, or another --plan",
                options.plan
            )));
        }
    };
    let names: Vec<&str> = if options.refiner.iter().any(|name| name == "all") {
        let refines = programs.iter().filter(|program| program.does().contains(&Does::Refine));
        let own = REFINERS.iter().map(|entry| entry.name);
        own.chain(refines.map(|program| program.name())).collect()
    } else {
        options.refiner.iter().map(String::as_str).collect()
    };
    let mut refiners = Vec::new();
    for (index, name) in names.iter().enumerate() {
        let none = Table::new();
        let refiner = AnyStage::choose("--refiner", REFINERS, &programs, Does::Refine, name, none)?;
        if !names[..index].contains(name) {
            refiners.push(refiner);
        }
    }
    if refiners.is_empty() {
        refiners.push(pipeline.refine);
    }
    Ok(Task { detector, refiners, points, known, seeds_known })
}

/// The points of the command line and of a file; `None` where neither was asked for.
fn points(options: &Options) -> Result<Option<Vec<ImagePoint>>> {
    let mut points = options.at.clone();
    if let Some(path) = &options.points {
        let text = std::fs::read_to_string(path).map_err(Error::io(path, "read"))?;
        for (index, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
            let point = parse_point(line).map_err(|problem| {
                Error::malformed(path, format!("line {}: {problem}", index + 1))
            })?;
            points.push(options.own.origin().point(point.into()));
        }
    }
    Ok((!options.at.is_empty() || options.points.is_some()).then_some(points))
}

/// The pictures, and those of the folders, in the order in which they are given.
fn pictures(given: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut pictures = Vec::new();
    for path in given {
        if path.is_dir() {
            pictures.extend(find_pictures(path)?);
        } else {
            pictures.push(path.clone());
        }
    }
    Ok(pictures)
}

impl Task {
    fn locate(&self, path: &Path, known: Vec<KnownCorner>, making: &Making) -> Result<Located> {
        let exposure = read_picture(path, making)?;
        if let Some(file) = &self.known {
            file.check_inside(&known, exposure.width(), exposure.height())?;
        }
        let at = |point: ImagePoint| Detection::new(point, 0.0);
        let seeds: Vec<Detection> = match (&self.points, &self.detector) {
            (Some(points), _) => points.iter().copied().map(at).collect(),
            (None, Some(detector)) => answered(path, detector.detect(&exposure, None))?,
            (None, None) => known.iter().map(|corner| at(corner.point)).collect(),
        };
        let refined =
            |refiner: &AnyStage<dyn Refiner>| answered(path, refiner.refine(&exposure, &seeds));
        let corners = self.refiners.iter().map(refined).collect::<Result<_>>()?;
        Ok(Located::new(path.to_owned(), corners, known))
    }
}

/// The answer, or which picture a program gave none to.
fn answered<T>(path: &Path, asked: Asked<T>) -> Result<T> {
    match asked {
        Ok(reply) => Ok(reply.answer),
        Err(failure) => Err(Error::Other(format!("{}: {}", path.display(), failure.reason))),
    }
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
