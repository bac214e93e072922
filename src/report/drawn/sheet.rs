//! Cells in the order in which they are drawn and listed: one sheet for each table of the plan.

use serde_json::Value;

use super::{CellSummary, DrawnMethod, DrawnSummary};

/// Cells of one table of the plan: along x what has most values there, a panel for each combination of the rest.
pub(super) struct Sheet<'a> {
    /// What differs along x.
    pub x: &'static str,
    /// Its values, ascending where they are numbers.
    pub x_labels: Vec<String>,
    /// What else differs.
    pub others: Vec<&'static str>,
    /// One for each combination of these.
    pub panels: Vec<Panel<'a>>,
    /// The methods' names, without what differs along x.
    pub series: Vec<&'a str>,
}

/// Cells that differ in one thing.
pub(super) struct Panel<'a> {
    /// Of each of the sheet's `others` its value.
    pub values: Vec<String>,
    /// What was measured there.
    pub spots: Vec<Spot<'a>>,
}

/// What a method made of a cell.
pub(super) struct Spot<'a> {
    /// Which of the values along x.
    pub x: usize,
    /// Which of the series.
    pub series: usize,
    pub cell: &'a CellSummary,
    pub method: &'a DrawnMethod,
}

/// All that may differ; of two with as many values the first is along x.
const FACTORS: [&str; 14] = [
    "seed_disc_px",
    "contrast_over_noise",
    "ramp_per_px",
    "neighbour_px",
    "rounding_px",
    "gaussian_sigma_px",
    "defocus_radius_px",
    "airy_radius_px",
    "motion_length_px",
    "angle_deg",
    "camera",
    "junction",
    "surface",
    "phase_grid",
];

/// What reports call a factor.
pub(super) fn factor_name(factor: &str) -> &str {
    match factor {
        "seed_disc_px" => "seeds within px",
        "contrast_over_noise" => "contrast over noise",
        "ramp_per_px" => "ramp per px",
        "neighbour_px" => "neighbour px",
        "rounding_px" => "rounding px",
        "gaussian_sigma_px" => "Gaussian blur px",
        "defocus_radius_px" => "defocus px",
        "airy_radius_px" => "Airy radius px",
        "motion_length_px" => "motion px",
        "angle_deg" => "angle deg",
        other => other,
    }
}

/// The value of a factor: a number sorts by itself, words in the order in which they come.
fn value(factor: &str, cell: &CellSummary, method: &DrawnMethod) -> Value {
    match factor {
        "camera" => cell.camera.clone().into(),
        "seed_disc_px" => match method.seed_disc_px {
            Some(radius_px) => radius_px.into(),
            None => method.detector.clone().into(),
        },
        other => cell.factors.get(other).cloned().unwrap_or(Value::Null),
    }
}

pub(super) fn label(value: &Value) -> String {
    match value {
        Value::Null => "-".to_owned(),
        Value::String(text) => text.clone(),
        other => other.as_f64().map_or_else(|| other.to_string(), |number| number.to_string()),
    }
}

/// The sheets of a summary.
pub(super) fn sheets(summary: &DrawnSummary) -> Vec<Sheet<'_>> {
    let mut tables: Vec<u64> = summary.cells.iter().map(|cell| cell.table).collect();
    tables.dedup();
    let of_table = |table: &u64| {
        let cells: Vec<&CellSummary> =
            summary.cells.iter().filter(|cell| cell.table == *table).collect();
        sheet(&cells)
    };
    tables.iter().map(of_table).collect()
}

fn sheet<'a>(cells: &[&'a CellSummary]) -> Sheet<'a> {
    let all: Vec<(&CellSummary, &DrawnMethod)> =
        cells.iter().flat_map(|cell| cell.methods.iter().map(move |one| (*cell, one))).collect();
    let of_factor = |factor: &'static str| {
        let mut found: Vec<Value> = Vec::new();
        for (cell, method) in &all {
            let value = value(factor, cell, method);
            if !found.contains(&value) {
                found.push(value);
            }
        }
        // Stable: words stay in their order, behind numbers.
        found.sort_by(|a, b| {
            let key = |value: &Value| value.as_f64().unwrap_or(f64::INFINITY);
            key(a).total_cmp(&key(b))
        });
        (factor, found)
    };
    let differing: Vec<(&'static str, Vec<Value>)> =
        FACTORS.into_iter().map(of_factor).filter(|(_, values)| values.len() > 1).collect();
    let most = differing.iter().map(|(_, values)| values.len()).max().unwrap_or(0);
    let along = differing.iter().find(|(_, values)| values.len() == most);
    let (x, x_values) = along.cloned().unwrap_or(("junction", vec![Value::Null]));
    let others: Vec<&'static str> =
        differing.iter().map(|(factor, _)| *factor).filter(|factor| *factor != x).collect();
    let mut series: Vec<&str> = Vec::new();
    let mut panels: Vec<Panel> = Vec::new();
    for (cell, method) in all {
        let values: Vec<String> =
            others.iter().map(|factor| label(&value(factor, cell, method))).collect();
        let name = if x == "seed_disc_px" { &method.series } else { &method.method };
        let index = series.iter().position(|known| known == name).unwrap_or_else(|| {
            series.push(name);
            series.len() - 1
        });
        let at = value(x, cell, method);
        let spot = Spot {
            x: x_values.iter().position(|value| *value == at).unwrap_or(0),
            series: index,
            cell,
            method,
        };
        match panels.iter_mut().find(|panel| panel.values == values) {
            Some(panel) => panel.spots.push(spot),
            None => panels.push(Panel { values, spots: vec![spot] }),
        }
    }
    Sheet { x, x_labels: x_values.iter().map(label).collect(), others, panels, series }
}

impl Sheet<'_> {
    /// Whether a bound is known of any of its cells.
    pub fn has_bound(&self) -> bool {
        let mut spots = self.panels.iter().flat_map(|panel| &panel.spots);
        spots.any(|spot| spot.cell.bound_px.is_some())
    }

    /// Whether a value along x is one; numbers come before words.
    pub fn is_number(&self, x: usize) -> bool {
        self.x_labels.get(x).is_some_and(|label| label.parse::<f64>().is_ok())
    }

    /// What sets a panel apart, in words.
    pub fn title(&self, panel: &Panel) -> String {
        let words = self.others.iter().zip(&panel.values).map(|(factor, value)| match *factor {
            "junction" | "surface" | "camera" => value.clone(),
            factor => format!("{} {value}", factor_name(factor)),
        });
        words.collect::<Vec<_>>().join(", ")
    }
}

impl Spot<'_> {
    /// Share of the junctions asked for that no detection was near to, or the refiner declined or lost.
    pub fn failed(&self) -> f64 {
        let DrawnMethod { missed, refined, .. } = self.method;
        let failed = refined.failed.map_or(0.0, |failed| failed.value) * refined.asked as f64;
        (failed + *missed as f64) / ((refined.asked + missed).max(1)) as f64
    }
}
