//! Tables of drawn junctions as people read them.

use super::sheet::{factor_name, sheets};
use super::{CellSummary, DrawnMethod, DrawnSummary};
use crate::report::words::Words;

/// A table for each table of the plan: a row for each cell, a column for each method.
pub fn cells(summary: &DrawnSummary) -> Vec<Words> {
    let of_sheet = |sheet: &super::sheet::Sheet| {
        let has_bound = summary.cells.iter().any(|cell| cell.bound_px.is_some());
        let mut header: Vec<String> =
            sheet.others.iter().map(|factor| factor_name(factor).to_owned()).collect();
        if sheet.x_labels.len() > 1 {
            header.push(factor_name(sheet.x).to_owned());
        }
        if has_bound {
            header.push("bound px".to_owned());
        }
        header.extend(sheet.series.iter().map(|&name| name.to_owned()));
        let mut rows = Vec::new();
        for panel in &sheet.panels {
            for (x, label) in sheet.x_labels.iter().enumerate() {
                let spots: Vec<_> = panel.spots.iter().filter(|spot| spot.x == x).collect();
                let Some(first) = spots.first() else { continue };
                let mut row = panel.values.clone();
                if sheet.x_labels.len() > 1 {
                    row.push(label.clone());
                }
                if has_bound {
                    row.push(number(first.cell.bound_px));
                }
                row.extend((0..sheet.series.len()).map(|series| {
                    let spot = spots.iter().find(|spot| spot.series == series);
                    spot.map_or_else(
                        || "-".to_owned(),
                        |spot| result(spot.cell, spot.method, spot.failed()),
                    )
                }));
                rows.push(row);
            }
        }
        Words { header, rows }
    };
    sheets(summary).iter().map(of_sheet).collect()
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.4}"))
}

/// Error, error over bound, failures.
fn result(cell: &CellSummary, method: &DrawnMethod, failed: f64) -> String {
    let Some(rmse_px) = method.refined.rmse_px else { return "declines all".to_owned() };
    let mut text = number(Some(rmse_px.value));
    if let (Some(_), Some(ratio)) = (cell.bound_px, method.refined.rmse_over_bound) {
        text.push_str(&format!(" ({:.2})", ratio.value));
    }
    if failed >= 0.0005 {
        text.push_str(&format!(", {:.1} %", 100.0 * failed));
    }
    text
}

/// What `cells` shows.
pub const CELLS: &str = "rms error px of all answers; in brackets over the bound from the pixels within 10 px, with levels, \
                         ramps, directions and blur unknown; %: not found, declined or more than 1 px off";

/// A row for each method: over all cells.
pub fn methods(summary: &DrawnSummary) -> Words {
    let mut names: Vec<&str> = Vec::new();
    for method in summary.cells.iter().flat_map(|cell| &cell.methods) {
        if !names.contains(&method.method.as_str()) {
            names.push(&method.method);
        }
    }
    let header = [
        "method",
        "error over bound, median",
        "largest",
        "rms error px, median",
        "largest",
        "squared error over covariance (2)",
        "declined",
        "off by 1 px",
    ];
    let row = |name: &&str| {
        let own: Vec<&DrawnMethod> = summary
            .cells
            .iter()
            .flat_map(|cell| cell.methods.iter().filter(|method| method.method == *name))
            .collect();
        let sorted = |value: &dyn Fn(&DrawnMethod) -> Option<f64>| {
            let mut values: Vec<f64> = own.iter().filter_map(|method| value(method)).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let ratios = sorted(&|one| one.refined.rmse_over_bound.map(|estimate| estimate.value));
        let errors = sorted(&|one| one.refined.rmse_px.map(|estimate| estimate.value));
        let nees = sorted(&|one| one.refined.nees.map(|estimate| estimate.value));
        let of = |values: &[f64], at: usize, digits: usize| {
            values.get(at).map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
        };
        let last = |values: &[f64], digits| of(values, values.len().wrapping_sub(1), digits);
        let asked: usize = own.iter().map(|one| one.refined.asked).sum();
        let answered: usize = own.iter().map(|one| one.refined.answered).sum();
        let failed: f64 = own
            .iter()
            .filter_map(|one| Some(one.refined.failed?.value * one.refined.asked as f64))
            .sum();
        let declined = (asked - answered) as f64;
        let share = |part: f64| format!("{:.2} %", 100.0 * part / (asked.max(1)) as f64);
        vec![
            (*name).to_owned(),
            of(&ratios, ratios.len() / 2, 2),
            last(&ratios, 2),
            of(&errors, errors.len() / 2, 4),
            last(&errors, 4),
            match nees.first().zip(nees.last()) {
                Some((least, most)) => format!("{least:.2} to {most:.2}"),
                None => "-".to_owned(),
            },
            share(declined),
            share((failed - declined).max(0.0)),
        ]
    };
    Words { header: header.map(str::to_owned).to_vec(), rows: names.iter().map(row).collect() }
}

/// How errors depend on the vertex's place in its pixel: a row for each cell; nothing where that was not measured.
pub fn locks(summary: &DrawnSummary) -> Option<Words> {
    let first = summary.cells.iter().find(|cell| cell.methods.iter().any(|m| m.lock.is_some()))?;
    let mut header = vec!["cell".to_owned()];
    header.extend(first.methods.iter().map(|method| method.method.clone()));
    let row = |cell: &CellSummary| {
        let of_method = |method: &DrawnMethod| {
            method.lock.as_ref().map_or_else(
                || "-".to_owned(),
                |lock| format!("{:.4} ({:.4})", lock.amplitude_px, lock.harmonic_px),
            )
        };
        let mut row = vec![cell.cell.clone()];
        row.extend(cell.methods.iter().map(of_method));
        row
    };
    Some(Words { header, rows: summary.cells.iter().map(row).collect() })
}

/// What `locks` shows.
pub const LOCKS: &str = "px, root mean square of the mean error by the vertex's place in its pixel, about its mean; in \
                         brackets the amplitude of its first harmonic along x";
