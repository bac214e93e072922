//! `cornerbench verify`: of a dataset that image and truth agree, of an algorithm that it keeps what all promise.

mod dataset;

use std::path::Path;
use std::sync::Arc;

use serde_json::json;
use toml::Table;

use super::{Ended, Global, print_line, programs};
use crate::contract::{Finding, try_detector, try_refiner};
use crate::detect::DETECTORS;
use crate::error::{Error, Result};
use crate::external::{Program, Task};
use crate::plan::AnyStage;
use crate::refine::REFINERS;

#[derive(clap::Args)]
pub(super) struct Options {
    /// The folder of a dataset; or a detector, a refiner, or another program by its name (`cornerbench list`) or file.
    #[arg(value_name = "DATASET|ALGORITHM", default_value = "out/quick/dataset")]
    what: String,
    /// Of a dataset: the camera by which answers are scored that are known beforehand; one with noise.
    #[arg(long, value_name = "NAME", default_value = "industrial-colour")]
    camera: String,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let path = Path::new(&options.what);
    if !path.exists() && path.components().count() > 1 && path.extension().is_some() {
        let words = "there is no such file, and no such dataset";
        return Err(Error::Other(format!("verify: {}: {words}", options.what)));
    }
    // What looks like a path and is no file is a dataset that may be missing, which that says itself.
    let is_dataset = path.is_dir() || (!path.is_file() && path.components().count() > 1);
    if is_dataset { dataset::run(global, options) } else { algorithm(global, &options.what) }
}

/// What was found of one task of an algorithm.
struct Tried {
    task: Task,
    label: String,
    findings: Vec<Finding>,
}

fn algorithm(global: &Global, name: &str) -> Result<Ended> {
    let mut tried = Vec::new();
    if DETECTORS.iter().any(|entry| entry.name == name) {
        tried.push(detector(name, &[])?);
    }
    if REFINERS.iter().any(|entry| entry.name == name) {
        tried.push(refiner(name, &[])?);
    }
    if programs::is_answers(name) {
        return Err(Error::Other(format!(
            "{name}: is a file of corners, of which nothing can be tried; measure it, and the report says if its coordinates look \
             shifted: cornerbench measure PLAN DATASET --with {name}"
        )));
    }
    if tried.is_empty() {
        tried = of_programs(&open(global, name)?)?;
    }
    let is_well = |one: &Tried| one.findings.iter().all(|finding| finding.passed != Some(false));
    let passed = tried.iter().all(is_well);
    if global.json {
        let of_one = |one: &Tried| json!({ "algorithm": one.label, "task": one.task, "findings": one.findings, "passed": is_well(one) });
        print_line(json!(tried.iter().map(of_one).collect::<Vec<_>>()))?;
    } else {
        for one in &tried {
            show(one)?;
        }
    }
    Ok(if passed { Ended::Well } else { Ended::Partly })
}

/// Starts a program, or says what might have been meant.
fn open(global: &Global, name: &str) -> Result<Vec<Arc<Program>>> {
    programs::open(global, &[name.to_owned()]).map_err(|error| match error {
        Error::UnknownName { found, known, place, .. } if place == programs::PLACE => {
            let own = DETECTORS.iter().map(|entry| entry.name);
            let own = own.chain(REFINERS.iter().map(|entry| entry.name)).map(str::to_owned);
            Error::UnknownName {
                place: "verify".to_owned(),
                kind: "algorithm, file or dataset".to_owned(),
                found,
                known: own.chain(known).collect(),
            }
        }
        other => other,
    })
}

fn of_programs(programs: &[Arc<Program>]) -> Result<Vec<Tried>> {
    let mut tried = Vec::new();
    for program in programs {
        if let Some(failure) = program.not_available() {
            return Err(Error::Other(failure.reason.clone()));
        }
        for task in program.does() {
            tried.push(match task {
                Task::Detect => detector(program.name(), programs)?,
                Task::Refine => refiner(program.name(), programs)?,
                Task::Grasp => {
                    let words = "nothing is tried of a grasp estimator; measure it by a plan that grasps: paper";
                    let findings = vec![Finding::told("grasp", words.to_owned())];
                    let label = format!("{} {}", program.name(), program.version());
                    Tried { task: Task::Grasp, label, findings }
                }
            });
        }
        if let Err(failure) = program.end()
            && let Some(last) = tried.last_mut()
        {
            last.findings.push(Finding { what: "end", passed: Some(false), words: failure.reason });
        }
    }
    Ok(tried)
}

fn detector(name: &str, programs: &[Arc<Program>]) -> Result<Tried> {
    let none = Table::new();
    let stage = AnyStage::choose("verify", DETECTORS, programs, Task::Detect, name, none)?;
    Ok(Tried { task: Task::Detect, label: stage.label(), findings: try_detector(&stage)? })
}

fn refiner(name: &str, programs: &[Arc<Program>]) -> Result<Tried> {
    let none = Table::new();
    let stage = AnyStage::choose("verify", REFINERS, programs, Task::Refine, name, none)?;
    Ok(Tried { task: Task::Refine, label: stage.label(), findings: try_refiner(&stage)? })
}

fn show(one: &Tried) -> Result<()> {
    print_line(format_args!("{}, {}", one.label, one.task.doer()))?;
    let width = one.findings.iter().map(|finding| finding.what.len()).max().unwrap_or(0);
    for Finding { what, passed, words } in &one.findings {
        let mark = match passed {
            Some(true) => "passed",
            Some(false) => "FAILED",
            None => "      ",
        };
        print_line(format_args!("  {what:width$}  {mark}  {words}"))?;
    }
    Ok(())
}
