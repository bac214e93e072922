//! `cornerbench limits`: refiners on drawn junctions, beside the Cramér-Rao bound.

use std::fmt::Write;
use std::path::PathBuf;

use super::progress::counting;
use super::{Ended, Global, command_line, print, print_line};
use crate::detect::{DETECTORS, Detector};
use crate::error::{Error, Result};
use crate::files::write_whole;
use crate::refine::REFINERS;
use crate::run::limits::{Cell, Contestant, FAILED_PX, Row, Score, Seeds, measure_cell};

#[derive(clap::Args)]
pub(super) struct Options {
    /// Corners in each cell of the table.
    #[arg(long, value_name = "N", default_value_t = 2500)]
    count: usize,
    /// Refiners to compare, all that know such corners where none is given; `cornerbench list refiners` names them.
    #[arg(value_name = "REFINER")]
    refiners: Vec<String>,
    /// A Markdown file whose part between `<!-- limits -->` and `<!-- end of limits -->` becomes the table.
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
}

const BEGIN: &str = "<!-- limits -->";
const END: &str = "<!-- end of limits -->";

/// Kinds of junctions: name, directions, levels.
const KINDS: [(&str, &[f64], [f64; 3]); 6] = [
    ("L 60", &[0.0, 60.0], [0.8, 0.2, 0.0]),
    ("L 90", &[0.0, 90.0], [0.8, 0.2, 0.0]),
    ("L 120", &[0.0, 120.0], [0.8, 0.2, 0.0]),
    ("L 150", &[0.0, 150.0], [0.8, 0.2, 0.0]),
    ("Y", &[0.0, 120.0, 240.0], [0.8, 0.5, 0.3]),
    ("arrow", &[0.0, 60.0, 120.0], [0.9, 0.5, 0.15]),
];

/// The tables: what they show, and their cells.
fn tables() -> Vec<(&'static str, Vec<Cell>)> {
    let cell = |(name, angles_deg, levels): (&'static str, &'static [f64], [f64; 3])| Cell {
        name,
        angles_deg,
        levels,
        blur_px: 1.0,
        contrast_over_noise: 50.0,
        ramp_per_px: 0.0,
        seeds: Seeds::Disc(1.0),
    };
    let each = |change: &dyn Fn(Cell) -> Vec<Cell>| -> Vec<Cell> {
        KINDS.into_iter().flat_map(|kind| change(cell(kind))).collect()
    };
    let blurred = |blur_px: f64| {
        each(&|cell| {
            let of = |contrast_over_noise| Cell { blur_px, contrast_over_noise, ..cell.clone() };
            [20.0, 50.0, 100.0].map(of).to_vec()
        })
    };
    vec![
        ("A blur of half a pixel, seeds up to 1 px off", blurred(0.5)),
        ("A blur of a pixel, seeds up to 1 px off", blurred(1.0)),
        ("A blur of a pixel and a half, seeds up to 1 px off", blurred(1.5)),
        (
            "Ramps in all sectors, seeds up to 1 px off",
            each(&|cell| {
                [0.0067, 0.033].map(|ramp_per_px| Cell { ramp_per_px, ..cell.clone() }).to_vec()
            }),
        ),
        ("Seeds up to 3 px off", each(&|cell| vec![Cell { seeds: Seeds::Disc(3.0), ..cell }])),
        ("Seeds from Harris itself", each(&|cell| vec![Cell { seeds: Seeds::Detector, ..cell }])),
    ]
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    crate::registry::in_range("command line", "--count", options.count, 2..=1_000_000)?;
    let contestants = contestants(&options.refiners)?;
    let detector = default_detector()?;
    // Read first: a file without the marks is an error before an hour of work, not after it.
    let parts = options.write.as_ref().map(|path| split(path).map(|parts| (path, parts)));
    let parts = parts.transpose()?;
    let tables = tables();
    let bar = counting(global, tables.iter().map(|(_, cells)| cells.len()).sum());
    let measured: Vec<(&str, Vec<Row>)> = tables
        .iter()
        .map(|(title, cells)| {
            let rows = cells.iter().map(|cell| {
                bar.set_message(cell.name);
                let row = measure_cell(cell, options.count, &contestants, detector.as_ref());
                bar.inc(1);
                row
            });
            (*title, rows.collect())
        })
        .collect();
    bar.finish_and_clear();
    let text = markdown(&measured, options.count);
    if let Some((path, [before, after])) = parts {
        let whole = format!("{before}{BEGIN}\n\n{text}\n{END}{after}");
        write_whole(path, |path| std::fs::write(path, &whole).map_err(Error::io(path, "write")))?;
    }
    if global.json {
        let tables: Vec<_> = measured
            .iter()
            .map(|(title, rows)| serde_json::json!({ "title": title, "rows": rows }))
            .collect();
        print_line(serde_json::json!(tables))?;
    } else {
        print(&text)?;
    }
    Ok(Ended::Well)
}

/// Refiners that are for something else: a whole cuboid, X corners.
const ELSEWHERE: [&str; 2] = ["cuboid_fit", "saddle_polynomial"];

/// The refiners that take part: those named, with their defaults, or all that know such corners, and OpenCV's with a
/// larger window.
fn contestants(names: &[String]) -> Result<Vec<Contestant>> {
    let place = "command line";
    let build = |name: &str, key: &str, value: Option<(&str, i64)>| {
        let entry = REFINERS.iter().find(|entry| entry.name == key);
        let entry = entry.ok_or_else(|| {
            let known = REFINERS.iter().map(|entry| entry.name.to_owned()).collect();
            Error::UnknownName {
                place: place.to_owned(),
                kind: "refiner".to_owned(),
                found: key.to_owned(),
                known,
            }
        })?;
        let mut table = toml::Table::new();
        if let Some((key, value)) = value {
            table.insert(key.to_owned(), value.into());
        }
        Ok(Contestant { name: name.to_owned(), refiner: (entry.build)(place, &table)? })
    };
    if !names.is_empty() {
        return names.iter().map(|name| build(name, name, None)).collect();
    }
    let mut all = Vec::new();
    for entry in REFINERS.iter().filter(|entry| !ELSEWHERE.contains(&entry.name)) {
        all.push(build(entry.name, entry.name, None)?);
        if entry.name == "corner_sub_pix" {
            let name = "corner_sub_pix, half window 10";
            all.push(build(name, entry.name, Some(("half_window_px", 10)))?);
        }
    }
    Ok(all)
}

fn default_detector() -> Result<Box<dyn Detector>> {
    let harris = DETECTORS.iter().find(|entry| entry.name == "harris");
    let entry = harris.ok_or_else(|| Error::Other("no detector harris".to_owned()))?;
    (entry.build)("harris", &(entry.defaults)())
}

/// What stands before and after the marks of a file.
fn split(path: &std::path::Path) -> Result<[String; 2]> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path, "read"))?;
    let parts = text.split_once(BEGIN).and_then(|(before, rest)| {
        rest.split_once(END).map(|(_, after)| [before.to_owned(), after.to_owned()])
    });
    parts.ok_or_else(|| {
        Error::malformed(path, format!("a line {BEGIN} and after it a line {END} must be there"))
    })
}

fn markdown(tables: &[(&str, Vec<Row>)], count: usize) -> String {
    let mut text = String::new();
    let mut line = |words: std::fmt::Arguments| {
        // What is written into a string cannot fail.
        let _ = writeln!(text, "{words}");
    };
    line(format_args!(
        "`{}`: {count} corners in each cell. Root mean square error in px of all answers, in brackets over the bound \
         with ramps unknown; failures are corners declined and answers more than {FAILED_PX} px off.\n",
        command_line()
    ));
    for (title, rows) in tables {
        line(format_args!("### {title}\n"));
        line(format_args!(
            "| junction | blur | noise | ramp | bound | with ramps | {} |",
            names(rows).join(" | ")
        ));
        line(format_args!("|---|--:|--:|--:|--:|--:|{}", "--:|".repeat(names(rows).len())));
        for row in rows {
            let cells: Vec<String> = row.scores.iter().map(cell).collect();
            line(format_args!(
                "| {} | {} px | 1/{} | {:.2} %/px | {:.4} | {:.4} | {} |",
                row.junction,
                row.blur_px,
                row.contrast_over_noise,
                100.0 * row.ramp_per_px,
                row.bound_px,
                row.bound_with_ramps_px,
                cells.join(" | "),
            ));
        }
        line(format_args!(""));
    }
    line(format_args!("### All of these cells\n"));
    line(format_args!(
        "| refiner | error over bound, median | largest | bias without noise, median px | largest px | \
         squared error over covariance (2) | declined | off by {FAILED_PX} px |"
    ));
    line(format_args!("|---|--:|--:|--:|--:|--:|--:|--:|"));
    let rows: Vec<&Row> = tables.iter().flat_map(|(_, rows)| rows).collect();
    for index in 0..rows.first().map_or(0, |row| row.scores.len()) {
        let scores: Vec<&Score> = rows.iter().map(|row| &row.scores[index]).collect();
        line(format_args!("{}", overall(&scores)));
    }
    text
}

fn names(rows: &[Row]) -> Vec<&str> {
    rows.first().map_or_else(Vec::new, |row| {
        row.scores.iter().map(|score| score.refiner.as_str()).collect()
    })
}

/// Error, error over bound, failures.
fn cell(score: &Score) -> String {
    let (Some(rmse_px), Some(ratio)) = (score.rmse_px, score.rmse_over_bound) else {
        return "declines all".to_owned();
    };
    let mut text = format!("{rmse_px:.4} ({ratio:.2})");
    let failed = 100.0 * (score.asked - score.located) as f64 / score.asked as f64;
    if failed > 0.0 {
        let _ = write!(text, ", {failed:.1} % fail");
    }
    text
}

/// A refiner's row over all cells.
fn overall(scores: &[&Score]) -> String {
    let sorted = |value: &dyn Fn(&Score) -> Option<f64>| {
        let mut values: Vec<f64> = scores.iter().filter_map(|score| value(score)).collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let ratios = sorted(&|score| score.rmse_over_bound);
    let biases = sorted(&|score| score.bias_px);
    let nees = sorted(&|score| score.nees);
    let of = |values: &[f64], at: usize, decimals: usize| {
        values.get(at).map_or_else(|| "-".to_owned(), |value| format!("{value:.decimals$}"))
    };
    let range = match (nees.first(), nees.last()) {
        (Some(least), Some(most)) => format!("{least:.2} to {most:.2}"),
        _ => "-".to_owned(),
    };
    let sum =
        |count: &dyn Fn(&Score) -> usize| scores.iter().map(|score| count(score)).sum::<usize>();
    let asked = sum(&|score| score.asked) as f64;
    let declined = sum(&|score| score.declined) as f64;
    let far = sum(&|score| score.asked - score.located - score.declined) as f64;
    format!(
        "| {} | {} | {} | {} | {} | {range} | {:.2} % | {:.2} % |",
        scores.first().map_or("", |score| score.refiner.as_str()),
        of(&ratios, ratios.len() / 2, 2),
        of(&ratios, ratios.len().wrapping_sub(1), 2),
        of(&biases, biases.len() / 2, 4),
        of(&biases, biases.len().wrapping_sub(1), 4),
        100.0 * declined / asked,
        100.0 * far / asked,
    )
}
