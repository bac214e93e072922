//! Records of drawn junctions -> what they say, cell by cell: curves, tables, maps.
//!
//! A cell's rows are a group of their own in the file and are read one group after the other: memory does not grow
//! with the plan.

mod curves;
mod lock;
mod page;
mod sheet;
pub mod words;

use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Map, Value};

use crate::error::Result;
use crate::record::{Record, RecordFile, RunDescription, kind, status};
use crate::report::refinement::{Refined, answers};
use crate::stats;

pub use lock::Lock;
pub(super) use page::write;

/// What a run's records of drawn junctions say; RUN/summary.json.
#[derive(Clone, Debug, Serialize)]
pub struct DrawnSummary {
    /// The cells, each by a camera, in the order of the plan.
    pub cells: Vec<CellSummary>,
}

/// A cell of drawn junctions by a camera.
#[derive(Clone, Debug, Serialize)]
pub struct CellSummary {
    /// Its name.
    pub cell: String,
    /// The camera.
    pub camera: String,
    /// Which of the plan's tables it stands in.
    pub table: u64,
    /// What sets it apart: the values that its table gives.
    pub factors: Map<String, Value>,
    /// Root mean square of the bounds from the pixels within 10 px; none where there is no noise, and of junctions that
    /// the bound does not know \[px\].
    pub bound_px: Option<f64>,
    /// The methods, in the order of the plan.
    pub methods: Vec<DrawnMethod>,
}

/// What a method made of a cell.
#[derive(Clone, Debug, Serialize)]
pub struct DrawnMethod {
    /// Its name.
    pub method: String,
    /// Its name without where seeds come from: methods of one name here differ by that alone.
    pub series: String,
    /// The detector; none on the refinement track.
    pub detector: Option<String>,
    /// On the refinement track the radius of the disc of seeds \[px\].
    pub seed_disc_px: Option<f64>,
    /// Junctions that no detection was near to.
    pub missed: usize,
    /// Answers elsewhere.
    pub false_answers: usize,
    /// Of those that the refiner was given.
    pub refined: Refined,
    /// How the error depends on the vertex's place in its pixel; of junctions on a grid of places.
    pub lock: Option<Lock>,
}

/// The columns that are read.
const COLUMNS: &[&str] = &[
    "record_version",
    "scene",
    "camera",
    "cell",
    "exposure",
    "method",
    "detector",
    "seed_disc_px",
    "kind",
    "status",
    "corner_index",
    "nearest_occluder_px",
    "true_x_px",
    "true_y_px",
    "refined_x_px",
    "refined_y_px",
    "refine_status",
    "covariance_xx_px2",
    "covariance_xy_px2",
    "covariance_yy_px2",
    "refined_error_px",
    "refined_along_px",
    "refined_across_px",
    "bound_r10_px",
];

/// Summarises the records of a run of drawn junctions.
///
/// # Errors
/// When the file cannot be read.
pub fn summarise(records: &Path, run: &RunDescription) -> Result<DrawnSummary> {
    let groups = RecordFile::open(records)?.groups();
    // Each thread has a place of its own in the file.
    let cells = (0..groups)
        .into_par_iter()
        .map_init(
            || RecordFile::open(records),
            |file, group| match file {
                Ok(file) => Ok(summarise_cell(&file.read(group, COLUMNS)?, run)),
                // Said again, by an error of its own.
                Err(_) => RecordFile::open(records).map(|_| None),
            },
        )
        .collect::<Result<Vec<Option<CellSummary>>>>()?;
    Ok(DrawnSummary { cells: cells.into_iter().flatten().collect() })
}

fn summarise_cell(records: &[Record], run: &RunDescription) -> Option<CellSummary> {
    let first = records.first()?;
    let cell = first.cell.clone()?;
    let described = run.cells.iter().find(|one| one["name"] == cell.as_str());
    let given = described.and_then(|cell| cell["given"].as_object()).cloned().unwrap_or_default();
    let grid = described.and_then(|cell| cell["factors"]["phase_grid"].as_u64());
    let table = described.and_then(|cell| cell["table"].as_u64()).unwrap_or_default();
    let mut names: Vec<&str> = Vec::new();
    for record in records {
        if !names.contains(&record.method.as_str()) {
            names.push(&record.method);
        }
        // All of them answer to each junction in turn.
        if record.exposure > Some(0) {
            break;
        }
    }
    let of_method = |name: &&str| {
        let rows: Vec<&Record> = records.iter().filter(|record| record.method == *name).collect();
        DrawnMethod::of(&rows, grid.and_then(|grid| usize::try_from(grid).ok()))
    };
    let of_first = names.first().copied().unwrap_or_default();
    let bounds: Vec<f64> = records
        .iter()
        .filter(|record| record.kind == kind::CORNER && record.method == of_first)
        .filter_map(|record| record.bound_r10_px)
        .collect();
    Some(CellSummary {
        cell,
        camera: first.camera.clone(),
        table,
        factors: given,
        bound_px: stats::root_mean_square(&bounds),
        methods: names.par_iter().map(of_method).collect(),
    })
}

impl DrawnMethod {
    fn of(rows: &[&Record], grid: Option<usize>) -> Self {
        let count = |kind: &str, status: &str| {
            rows.iter().filter(|row| row.kind == kind && row.status == status).count()
        };
        let given: Vec<&Record> = rows
            .iter()
            .copied()
            .filter(|row| row.kind == kind::CORNER && row.status == status::OK)
            .collect();
        let method = rows.first().map(|row| row.method.clone()).unwrap_or_default();
        // Without its version.
        let detector = rows.first().and_then(|row| row.detector.as_deref()?.split(' ').next());
        let is_of_seeds = |word: &&str| {
            detector.map_or(word.starts_with("disc_px="), |detector| *word == detector)
        };
        let words: Vec<&str> = method.split('-').filter(|word| !is_of_seeds(word)).collect();
        Self {
            series: if words.is_empty() { method.clone() } else { words.join("-") },
            detector: detector.map(str::to_owned),
            method,
            seed_disc_px: rows.first().and_then(|row| row.seed_disc_px),
            missed: count(kind::CORNER, status::MISSED),
            false_answers: count(kind::FALSE_CORNER, status::FALSE),
            refined: Refined::of(&answers(&given)),
            lock: grid.and_then(|grid| Lock::of(&given, grid)),
        }
    }
}
