//! `cornerbench list`: what can be named.

use clap::ValueEnum;

use super::{Ended, Global, print_line, project};
use crate::detect::DETECTORS;
use crate::error::Result;
use crate::grasp::{ESTIMATORS, SELECTORS};
use crate::plan::{read_table, recipe_names};
use crate::refine::REFINERS;
use crate::registry::Entry;
use crate::target::EXTRACTORS;

#[derive(clap::Args)]
pub(super) struct Options {
    /// What to list.
    kind: Kind,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Kind {
    Suites,
    Families,
    Plans,
    Cameras,
    RangeSensors,
    Grippers,
    Robots,
    Targets,
    Detectors,
    Refiners,
    Faces,
    Grasps,
    Programs,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let rows = match options.kind {
        Kind::Suites => recipes(global, "suites")?,
        Kind::Families => recipes(global, "families")?,
        Kind::Plans => recipes(global, "plans")?,
        Kind::Cameras => recipes(global, "cameras")?,
        Kind::RangeSensors => recipes(global, "range-sensors")?,
        Kind::Grippers => recipes(global, "grippers")?,
        Kind::Robots => recipes(global, "robots")?,
        Kind::Targets => entries(EXTRACTORS),
        Kind::Detectors => entries(DETECTORS),
        Kind::Refiners => entries(REFINERS),
        Kind::Faces => entries(SELECTORS),
        Kind::Grasps => entries(ESTIMATORS),
        Kind::Programs => programs()?,
    };
    if global.json {
        let rows: Vec<_> = rows
            .iter()
            .map(|(name, summary)| serde_json::json!({ "name": name, "summary": summary }))
            .collect();
        print_line(serde_json::json!(rows))?;
    } else {
        let width = rows.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
        for (name, summary) in rows {
            print_line(format_args!("{name:width$}  {summary}"))?;
        }
    }
    Ok(Ended::Well)
}

fn entries<T: ?Sized>(entries: &[Entry<T>]) -> Vec<(String, String)> {
    entries.iter().map(|entry| (entry.name.to_owned(), entry.summary.to_owned())).collect()
}

fn recipes(global: &Global, folder: &str) -> Result<Vec<(String, String)>> {
    let recipes = project::recipes(global)?;
    recipe_names(&recipes, folder)
        .into_iter()
        .map(|name| {
            let (_, table) = read_table(&recipes, folder, &name)?;
            let summary = table.get("summary").and_then(|value| value.as_str());
            Ok((name, summary.unwrap_or_default().to_owned()))
        })
        .collect()
}

/// Programs that are known, with what they do.
fn programs() -> Result<Vec<(String, String)>> {
    let row = |block: crate::external::Block| {
        let does: Vec<&str> = block.does.iter().map(|task| task.name()).collect();
        (block.name, format!("{}: {}", does.join(", "), block.summary))
    };
    Ok(super::programs::known()?.into_iter().map(row).collect())
}
