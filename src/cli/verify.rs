//! `cornerbench verify`: a dataset is whole, and its image is where its truth says.

use std::path::PathBuf;

use serde_json::json;

use super::{Ended, Global, print_line};
use crate::convention::{CornerOffset, corner_offsets, mean_offset};
use crate::error::{Error, Result};
use crate::scene::Dataset;

/// The largest mean offset that passes \[px\].
const LARGEST_OFFSET_PX: f64 = 0.01;
/// A single corner fails when it is off by more than this and five standard errors \[px\].
const FAR_PX: f64 = 0.02;

#[derive(clap::Args)]
pub(super) struct Options {
    /// The dataset's folder.
    #[arg(default_value = "out/quick/dataset")]
    dataset: PathBuf,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let dataset = Dataset::open(&options.dataset)?;
    let mut offsets: Vec<(&str, CornerOffset)> = Vec::new();
    let mut unreadable = Vec::new();
    for name in dataset.scenes() {
        match dataset.read(name) {
            Ok(scene) => {
                offsets.extend(corner_offsets(&scene).into_iter().map(|offset| (name, offset)));
            }
            Err(error) => {
                eprintln!("{name} skipped: {}", error.chain());
                unreadable.push(json!({ "scene": name, "reason": error.chain() }));
            }
        }
    }
    let of_all: Vec<CornerOffset> = offsets.iter().map(|(_, offset)| offset.clone()).collect();
    let mean = mean_offset(&of_all).ok_or_else(|| {
        Error::Other(format!(
            "{}: {} clean corners, at least 2 are needed to measure the offset",
            options.dataset.display(),
            offsets.len()
        ))
    })?;
    let far = offsets.iter().filter(|(_, offset)| is_far(offset)).count();
    let passed = mean.length_px <= LARGEST_OFFSET_PX && far == 0 && unreadable.is_empty();
    if global.json {
        let rows: Vec<_> = offsets
            .iter()
            .map(|(scene, offset)| {
                json!({
                    "scene": scene,
                    "corner": offset.corner,
                    "offset_px": offset.offset_px,
                    "standard_error_px": offset.standard_error_px,
                    "far": is_far(offset),
                })
            })
            .collect();
        print_line(json!({
            "corners": rows, "mean": mean, "far": far, "unreadable": unreadable, "passed": passed,
        }))?;
    } else {
        for (scene, offset) in &offsets {
            let ([x, y], [x_error, y_error]) = (offset.offset_px, offset.standard_error_px);
            print_line(format_args!(
                "{scene} corner {}: offset ({x:+.4}, {y:+.4}) px +- ({x_error:.4}, {y_error:.4}){}",
                offset.corner,
                if is_far(offset) { " FAR" } else { "" },
            ))?;
        }
        let ([x, y], [x_error, y_error]) = (mean.mean_px, mean.standard_error_px);
        print_line(format_args!(
            "mean offset of {} clean corners: ({x:+.4}, {y:+.4}) px +- ({x_error:.4}, {y_error:.4}), \
             length {:.4} px (at most {LARGEST_OFFSET_PX}), {far} corners far off, {} scenes \
             unreadable: {}",
            mean.corners,
            mean.length_px,
            unreadable.len(),
            if passed { "renderer, reader and projection agree" } else { "FAILED" },
        ))?;
    }
    Ok(if passed { Ended::Well } else { Ended::Partly })
}

/// Whether a corner's own offset is larger than its uncertainty explains.
fn is_far(offset: &CornerOffset) -> bool {
    let pairs = offset.offset_px.iter().zip(&offset.standard_error_px);
    pairs.into_iter().any(|(offset, error)| offset.abs() > FAR_PX + 5.0 * error)
}
