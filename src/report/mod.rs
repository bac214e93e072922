//! Records -> terminal, page and pictures. Reads a run's folder; runs no algorithm.

pub mod agreement;
pub mod attempts;
mod axis;
pub mod compare;
pub mod contest;
mod curves;
pub mod detection;
pub mod drawn;
mod figures;
pub mod gospa;
pub mod grasps;
mod html;
mod misses;
pub mod recommend;
mod records;
pub mod refinement;
mod splice;
pub mod summary;
mod svg;
pub mod terminal;
pub mod words;

use std::fs;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::json;

use crate::error::{Error, Result};
use crate::files::{replace_folder, write_json, write_whole};
use crate::record::{
    FailureCount, Record, RunDescription, kind, read_records, read_run, read_sketch, read_timing,
};
use crate::report::drawn::DrawnSummary;
use crate::report::figures::Figure;
use crate::report::records::RunRecords;
use crate::report::refinement::answers;
use crate::report::summary::{MethodSummary, SceneSummary, Summary, summarise_method};
use crate::report::words::Words;

/// A run's report.
pub struct Report {
    /// How the run came about.
    pub run: RunDescription,
    /// What its records say.
    pub content: Content,
    /// The page.
    pub page: PathBuf,
}

/// What must be said of pictures of one's own; nothing of a dataset.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Notes {
    /// That known corners look as if counted from another place.
    pub origin: Option<String>,
    /// That nobody knows the corners of some.
    pub unknown: Option<String>,
}

impl Notes {
    /// What must be said of answers, or of known corners, that look shifted.
    fn shifts(&self, summary: &Summary) -> Vec<String> {
        match &self.origin {
            // It is the corners that are off, not the answers.
            Some(note) => vec![note.clone()],
            None => words::shifts(summary),
        }
    }
}

/// What a run's records say.
pub enum Content {
    /// Of a rendered dataset, or of pictures of one's own, and what must be said of these.
    Rendered(Box<Summary>, Notes),
    /// Of drawn junctions.
    Drawn(DrawnSummary),
}

impl Report {
    /// What stands in summary.json.
    pub fn json(&self) -> serde_json::Value {
        match &self.content {
            Content::Rendered(summary, _) => json!(summary),
            Content::Drawn(summary) => json!(summary),
        }
    }

    /// The tables by name, as [`splice`](Self::splice) knows them.
    fn tables(&self) -> Vec<(&'static str, Words)> {
        match &self.content {
            Content::Rendered(summary, _) => [
                Some(("detectors", words::comparison(summary))),
                Some(("gospa", words::gospa(summary))),
                words::refinement(summary).map(|words| ("refiners", words)),
                words::results(summary).map(|words| ("results", words)),
                words::families(summary).map(|words| ("families", words)),
            ]
            .into_iter()
            .flatten()
            .collect(),
            Content::Drawn(summary) => {
                let cells = words::joined(drawn::words::cells(summary));
                let locks = drawn::words::locks(summary).map(|words| ("phases", words));
                let known = [("cells", cells), ("methods", drawn::words::methods(summary))];
                known.into_iter().chain(locks).collect()
            }
        }
    }

    /// Puts the run's tables into a Markdown file, with the command that made them: between each
    /// `<!-- results of PLAN: TABLE -->` of this run's plan and the `<!-- end of results -->` behind it.
    ///
    /// # Errors
    /// When the file has no such marks, names a table that this run has not, or cannot be read or written.
    pub fn splice(&self, path: &Path) -> Result<()> {
        let tables = self.tables().into_iter().map(|(name, table)| (name.to_owned(), table));
        splice::splice(path, &self.run.plan, &self.run.command, &tables.collect::<Vec<_>>())
    }
}

/// Writes summary.json and report/ of the run in `folder`, from its records and pictures.
///
/// # Errors
/// When the run's files are missing or the report cannot be written.
pub fn write(folder: &Path) -> Result<Report> {
    let run = read_run(folder)?;
    if !run.cells.is_empty() {
        let (summary, page) = drawn::write(folder, &run)?;
        return Ok(Report { run, content: Content::Drawn(summary), page });
    }
    let report = folder.join("report");
    replace_folder(&report)?;
    let path = folder.join("records.parquet");
    let records = RunRecords::open(&path)?;
    let cameras = records.cameras();
    // Misses are shown where there are refiners to choose from.
    let is_choice = run.pipelines.iter().any(|one| one["refine"] != run.pipelines[0]["refine"]);
    let (mut methods, mut given) = (Vec::new(), Vec::new());
    let (mut sections, mut misses) = (Vec::new(), Vec::new());
    records.for_each_method(|rows| {
        let method = summarise_method(rows, &cameras, run.gate_px).of_run(&run);
        // On the refinement track there is no way from a target to a grasp to draw.
        if method.detector.is_some() {
            sections.extend(grasp_sections(folder, &report, &method, rows)?);
        }
        if is_choice {
            misses.push(draw_misses(folder, &report, &method, rows)?);
        }
        methods.push(method);
        given.push(answers(rows));
        Ok(())
    })?;
    // Pictures of one's own are few.
    let own = if run.pictures.is_some() { read_records(&path)? } else { Vec::new() };
    let summary = Summary {
        timing: read_timing(folder)?,
        agreements: agreement::agreements(&own, &run),
        ..Summary::of(records.unreadable, methods, &given)
    };
    let notes =
        Notes { origin: agreement::origin_note(&own, &run), unknown: agreement::sentence(&run) };
    write_json(&folder.join("summary.json"), &summary)?;
    write_text(&report.join("precision-recall.svg"), &curves::draw(&summary)?)?;
    let refinement = words::refinement(&summary);
    let worst: Vec<_> = words::by_refined_error(&summary)
        .into_iter()
        .filter_map(|method| {
            let (_, figures) = misses.iter().find(|(label, _)| *label == method.label)?;
            Some(json!({ "method": method.label, "figures": figures }))
        })
        .collect();
    let content = json!({
        "run": run,
        "failures": run.failures.iter().map(FailureCount::words).collect::<Vec<_>>(),
        "summary": summary,
        "comparison": words::comparison(&summary),
        "gospa": words::gospa(&summary),
        "refinement": refinement,
        "grasps": words::grasps(&summary),
        "grasps_say": words::GRASPS,
        "results": words::results(&summary),
        "families": words::families(&summary),
        "notes": notes,
        "agreements": summary.agreements.iter().map(agreement::words).collect::<Vec<_>>(),
        "predicted": agreement::PREDICTED,
        "contests": words::contests(&summary),
        "shifts": notes.shifts(&summary),
        "worst": worst,
        "strata": words::strata(&summary),
        "causes": words::causes(&summary),
        "findings": summary.methods.iter().map(words::findings).collect::<Vec<_>>(),
        "verdicts": summary.methods.iter().map(words::verdict).collect::<Vec<_>>(),
        "sections": sections,
    });
    let path = report.join("index.html");
    write_text(&path, &html::page(html::RENDERED, &content)?)?;
    Ok(Report { run, content: Content::Rendered(Box::new(summary), notes), page: path })
}

/// The paper's figures and its Table 1 of each scene, of a method that ends with a grasp.
fn grasp_sections(
    folder: &Path,
    report: &Path,
    summary: &MethodSummary,
    rows: &[&Record],
) -> Result<Vec<serde_json::Value>> {
    let MethodSummary { method, camera, .. } = summary;
    let section = |scene: &SceneSummary| {
        let sketch = read_sketch(folder, &scene.scene, camera, method)?;
        // Drawn is the first photograph.
        let is_drawn = |record: &&Record| record.scene == scene.scene && record.exposure == Some(0);
        let rows: Vec<&Record> = rows.iter().copied().filter(is_drawn).collect();
        let figures = figures::draw(folder, camera, method, &sketch, &rows)?;
        for figure in &figures {
            write_text(&report.join(&figure.file), &figure.svg)?;
        }
        let grasp = rows.iter().find(|record| record.kind == kind::GRASP);
        Ok(json!({
            "method": method,
            "camera": camera,
            "scene": scene,
            "face": words::face(scene),
            "sketch": sketch,
            "figures": figures,
            "corners": table_one(&rows),
            "grasp": grasp.map(|record| json!({
                "image_error_px": record.grasp_image_error_px,
                "axial_mm": record.grasp_axial_error_mm,
                "lateral_mm": record.grasp_lateral_error_mm,
                "error_mm": record.grasp_error_mm,
                "world_m": [
                    record.grasp_world_x_m, record.grasp_world_y_m, record.grasp_world_z_m,
                ],
                "chosen_face": record.chosen_face,
            })),
        }))
    };
    let scenes = summary.scenes.iter().filter(|_| summary.grasps.is_some());
    scenes.map(section).collect()
}

/// Pictures of what a method's refiner misses most, beside the method's label.
fn draw_misses(
    folder: &Path,
    report: &Path,
    summary: &MethodSummary,
    rows: &[&Record],
) -> Result<(String, Vec<Figure>)> {
    let rows: Vec<&Record> =
        rows.iter().copied().filter(|record| record.exposure == Some(0)).collect();
    let figures = misses::draw(folder, &summary.method, &rows)?;
    for figure in &figures {
        write_text(&report.join(&figure.file), &figure.svg)?;
    }
    Ok((summary.label.clone(), figures))
}

fn write_text(path: &Path, text: &str) -> Result<()> {
    write_whole(path, |path| fs::write(path, text).map_err(Error::io(path, "write")))
}

/// The rows of the paper's Table 1 for one scene: found corners, then missed ones, then the rest.
fn table_one(rows: &[&Record]) -> Vec<serde_json::Value> {
    let order = |record: &Record| match record.status.as_str() {
        "ok" => 0,
        "missed" => 1,
        "false" => 2,
        "ignored" => 3,
        _ => 4,
    };
    let mut corners: Vec<&&Record> = rows
        .iter()
        .filter(|record| [kind::CORNER, kind::FALSE_CORNER].contains(&record.kind.as_str()))
        .collect();
    corners.sort_by_key(|record| order(record));
    corners
        .iter()
        .map(|record| {
            json!({
                "status": record.status,
                "visibility": record.visibility,
                "place": record.cause.as_deref().map(words::place),
                "index": record.corner_index,
                "detected": [record.detected_x_px, record.detected_y_px],
                "refined": [record.refined_x_px, record.refined_y_px],
                "truth": [record.true_x_px, record.true_y_px],
                "before": record.detected_error_px,
                "after": record.refined_error_px,
                "refine_status": record.refine_status,
            })
        })
        .collect()
}
