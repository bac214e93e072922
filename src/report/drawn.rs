//! Records of drawn junctions -> what they say, cell by cell: curves, tables, maps.
//!
//! A cell's rows are a group of their own in the file and are read one group after the other: memory does not grow
//! with the plan.

mod curves;
mod lock;
mod page;
mod sheet;
pub mod words;

use std::collections::HashMap;
use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Map, Value};

use crate::error::Result;
use crate::record::{Record, RecordFile, RunDescription, kind, status};
use crate::report::records::read;
use crate::report::refinement::{Answers, Refined};
use crate::stats;

pub use lock::Lock;
use lock::Places;
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
    let cells = read(records, groups, |file, group| summarise_cell(file, group, run))?;
    Ok(DrawnSummary { cells: cells.into_iter().flatten().collect() })
}

fn summarise_cell(
    file: &RecordFile,
    group: usize,
    run: &RunDescription,
) -> Result<Option<CellSummary>> {
    let described = |cell: &str| run.cells.iter().find(|one| one["name"] == cell);
    let mut summary: Option<CellSummary> = None;
    let mut bounds = Vec::new();
    let mut methods: Vec<Collected> = Vec::new();
    // All of them answer to each junction in turn.
    let mut places: HashMap<String, usize> = HashMap::new();
    file.for_each(
        group,
        COLUMNS,
        |_, _| true,
        |record| {
            let Some(cell) = &record.cell else { return };
            let described = described(cell);
            if summary.is_none() {
                let given = described.and_then(|cell| cell["given"].as_object());
                summary = Some(CellSummary {
                    cell: cell.clone(),
                    camera: record.camera.clone(),
                    table: described.and_then(|cell| cell["table"].as_u64()).unwrap_or_default(),
                    factors: given.cloned().unwrap_or_default(),
                    bound_px: None,
                    methods: Vec::new(),
                });
            }
            let place = places.get(&record.method).copied().unwrap_or_else(|| {
                let grid = described.and_then(|cell| cell["factors"]["phase_grid"].as_u64());
                methods.push(Collected::new(
                    &record,
                    grid.and_then(|grid| usize::try_from(grid).ok()),
                ));
                places.insert(record.method.clone(), methods.len() - 1);
                methods.len() - 1
            });
            if place == 0 && record.kind == kind::CORNER {
                bounds.extend(record.bound_r10_px);
            }
            methods[place].add(&record);
        },
    )?;
    Ok(summary.map(|summary| CellSummary {
        bound_px: stats::root_mean_square(&bounds),
        methods: methods.par_iter().map(Collected::summary).collect(),
        ..summary
    }))
}

/// What a method made of a cell, as it is collected from rows.
struct Collected {
    method: String,
    detector: Option<String>,
    seed_disc_px: Option<f64>,
    missed: usize,
    false_answers: usize,
    answers: Answers,
    places: Option<Places>,
}

impl Collected {
    fn new(first: &Record, grid: Option<usize>) -> Self {
        Self {
            method: first.method.clone(),
            // Without its version.
            detector: first
                .detector
                .as_deref()
                .and_then(|one| one.split(' ').next())
                .map(str::to_owned),
            seed_disc_px: first.seed_disc_px,
            missed: 0,
            false_answers: 0,
            answers: Answers::default(),
            places: grid.map(Places::new),
        }
    }

    fn add(&mut self, record: &Record) {
        match (record.kind.as_str(), record.status.as_str()) {
            (kind::CORNER, status::MISSED) => self.missed += 1,
            (kind::FALSE_CORNER, status::FALSE) => self.false_answers += 1,
            (kind::CORNER, status::OK) => {
                self.answers.add(record);
                self.places.iter_mut().for_each(|places| places.add(record));
            }
            _ => {}
        }
    }

    fn summary(&self) -> DrawnMethod {
        let Self { method, detector, seed_disc_px, missed, false_answers, answers, places } = self;
        DrawnMethod {
            series: series(method, detector.as_deref()),
            detector: detector.clone(),
            method: method.clone(),
            seed_disc_px: *seed_disc_px,
            missed: *missed,
            false_answers: *false_answers,
            refined: Refined::of(&answers.all),
            lock: places.as_ref().and_then(Places::lock),
        }
    }
}

/// A method's name without where its seeds come from: a disc, or a detector, whose name may have several parts.
fn series(method: &str, detector: Option<&str>) -> String {
    let parts: Vec<&str> = method.split('-').collect();
    let seeds: Vec<&str> = detector.map_or(Vec::new(), |detector| detector.split('-').collect());
    let is_disc = |part: &str| detector.is_none() && part.starts_with("disc_px=");
    let begin = parts.windows(seeds.len().max(1)).position(|some| some == seeds);
    let is_detector =
        |place: usize| begin.is_some_and(|begin| (begin..begin + seeds.len()).contains(&place));
    let others = (0..parts.len()).filter(|place| !is_detector(*place) && !is_disc(parts[*place]));
    let others: Vec<&str> = others.map(|place| parts[place]).collect();
    if others.is_empty() { method.to_owned() } else { others.join("-") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_series_has_the_name_of_its_method_without_where_seeds_come_from() {
        for (method, detector, wanted) in [
            (
                "harris-corner_sub_pix-half_window_px=5",
                Some("harris"),
                "corner_sub_pix-half_window_px=5",
            ),
            ("found-opencv-lsd-none", Some("opencv-lsd"), "found-none"),
            ("given-disc_px=2-junction_fit", None, "given-junction_fit"),
            ("junction_fit", None, "junction_fit"),
            ("harris", Some("harris"), "harris"),
            ("opencv-fast", Some("opencv-lsd"), "opencv-fast"),
        ] {
            assert_eq!(series(method, detector), wanted);
        }
    }
}
