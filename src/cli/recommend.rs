//! `cornerbench recommend`: which method to use.

use std::path::PathBuf;

use super::{Ended, Global, print_line};
use crate::error::Result;
use crate::registry::in_range;
use crate::report::recommend::{ALL, Choice, ClassBy, Measured, recommend, table, write};
use crate::report::terminal::table_of;

#[derive(clap::Args)]
pub(super) struct Options {
    /// The runs to choose from, taken together; the page goes into the first one's folder.
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// The most time that a method may take, in microseconds: end to end for a photograph, of refiners alone for a
    /// corner.
    #[arg(long, value_name = "N")]
    budget_us: Option<f64>,
    /// The same in milliseconds.
    #[arg(long, value_name = "N", conflicts_with = "budget_us")]
    budget_ms: Option<f64>,
    /// What scenes, or corners, are told apart by; each class has a choice of its own.
    #[arg(long, value_name = "CLASS", default_value = "family")]
    class: Class,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Class {
    /// The family that a scene was drawn from.
    Family,
    /// The camera's pose.
    Pose,
    /// What a corner looks like; of refiners alone.
    Junction,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let budget = [(options.budget_us, "--budget-us", 1.0), (options.budget_ms, "--budget-ms", 1e3)];
    let mut budget_us = None;
    for (value, name, us) in budget {
        let Some(value) = value else { continue };
        budget_us = Some(us * in_range("command line", name, value, f64::MIN_POSITIVE..=1e12)?);
    }
    let class_by = match options.class {
        Class::Family => ClassBy::Family,
        Class::Pose => ClassBy::Pose,
        Class::Junction => ClassBy::Junction,
    };
    let runs =
        options.runs.iter().map(|folder| Measured::read(folder)).collect::<Result<Vec<_>>>()?;
    let found = recommend(&runs, budget_us, class_by)?;
    let page = write(&options.runs[0], &found)?;
    if global.json {
        print_line(serde_json::json!(found))?;
        return Ok(Ended::Well);
    }
    for choice in &found.choices {
        if choice.class == ALL {
            show(choice)?;
        } else {
            print_line(format_args!("- {}: {}", choice.class, choice.words))?;
        }
    }
    for pipeline in found.pipelines.values() {
        print_line(format_args!("\n{}", pipeline.trim_end()))?;
    }
    print_line("")?;
    for warning in &found.warnings {
        print_line(format_args!("! {warning}"))?;
    }
    print_line(format_args!("open {}", page.display()))?;
    Ok(Ended::Well)
}

/// The choice among all scenes.
fn show(choice: &Choice) -> Result<()> {
    let (table, left_out) = table(choice);
    print_line(format_args!("\n{}", choice.given()))?;
    print_line(&choice.words)?;
    print_line(table_of(&table))?;
    if let Some(left_out) = left_out {
        print_line(left_out)?;
    }
    Ok(())
}
