//! The page of drawn junctions.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::{ImageFormat, Rgb, RgbImage};
use serde_json::json;

use super::curves::{self, Quantity};
use super::sheet::sheets;
use super::{DrawnSummary, Lock, summarise, words};
use crate::error::{Error, Result};
use crate::files::{replace_folder, write_json};
use crate::record::{FailureCount, RunDescription};
use crate::report::{html, write_text};

/// Writes summary.json and report/ of a run of drawn junctions, and returns the summary and the page.
///
/// # Errors
/// When the run's files are missing or the report cannot be written.
pub(in crate::report) fn write(
    folder: &Path,
    run: &RunDescription,
) -> Result<(DrawnSummary, PathBuf)> {
    let summary = summarise(&folder.join("records.parquet"), run)?;
    write_json(&folder.join("summary.json"), &summary)?;
    let report = folder.join("report");
    replace_folder(&report)?;
    let has_bound = summary.cells.iter().any(|cell| cell.bound_px.is_some());
    let mut figures = Vec::new();
    for (index, sheet) in sheets(&summary).iter().enumerate() {
        let quantities = [
            Some((Quantity::Error, "error")),
            (!has_bound).then_some((Quantity::Bias, "bias")),
            Some((Quantity::Failed, "failed")),
        ];
        for (quantity, name) in quantities.into_iter().flatten() {
            let file = format!("{name}-{index}.svg");
            write_text(&report.join(&file), &curves::draw(sheet, quantity)?)?;
            let x = super::sheet::factor_name(sheet.x);
            let caption = format!("{}, over {x}", quantity.name());
            figures.push(json!({ "file": file, "caption": caption }));
        }
    }
    let content = json!({
        "run": run,
        "failures": run.failures.iter().map(FailureCount::words).collect::<Vec<_>>(),
        "figures": figures,
        "cells": words::cells(&summary),
        "cells_say": words::CELLS,
        "methods": words::methods(&summary),
        "locks": words::locks(&summary),
        "locks_say": words::LOCKS,
        "maps": maps(&summary)?,
        "has_bound": has_bound,
    });
    let path = report.join("index.html");
    write_text(&path, &html::page(html::DRAWN, &content)?)?;
    Ok((summary, path))
}

/// Maps of the mean error over the pixel: of each cell one for each method.
fn maps(summary: &DrawnSummary) -> Result<Vec<serde_json::Value>> {
    let mut rows = Vec::new();
    for cell in &summary.cells {
        let mut maps = Vec::new();
        for method in &cell.methods {
            if let Some(lock) = &method.lock {
                maps.push(json!({ "method": method.method, "picture": picture(lock)? }));
            }
        }
        if !maps.is_empty() {
            rows.push(json!({ "cell": cell.cell, "maps": maps }));
        }
    }
    Ok(rows)
}

/// A picture of a map, one pixel for each place: how far the mean error there is from the mean of all, from dark at
/// none to light at the farthest.
fn picture(lock: &Lock) -> Result<String> {
    let known: Vec<[f64; 2]> = lock.bias_px.iter().copied().flatten().collect();
    let mean = [0, 1].map(|axis: usize| {
        known.iter().map(|bias| bias[axis]).sum::<f64>() / known.len().max(1) as f64
    });
    let far_px = |bias: &[f64; 2]| (bias[0] - mean[0]).hypot(bias[1] - mean[1]);
    let most_px = known.iter().map(far_px).fold(1e-12, f64::max);
    let size = u32::try_from(lock.grid).unwrap_or(u32::MAX);
    let picture = RgbImage::from_fn(size, size, |x, y| {
        let place = y as usize * lock.grid + x as usize;
        match lock.bias_px.get(place).copied().flatten() {
            Some(bias) => {
                let share = far_px(&bias) / most_px;
                #[allow(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "in [0, 255]"
                )]
                let level = |from: f64, to: f64| (from + share * (to - from)).round() as u8;
                Rgb([level(20.0, 255.0), level(30.0, 215.0), level(90.0, 60.0)])
            }
            None => Rgb([128; 3]),
        }
    });
    let mut bytes = Cursor::new(Vec::new());
    picture
        .write_to(&mut bytes, ImageFormat::Png)
        .map_err(|error| Error::Other(format!("a map of errors: {error}")))?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(bytes.into_inner())))
}
