//! `cornerbench verify`: a dataset is whole, and its image is where its truth says.

use std::path::PathBuf;

use super::{Ended, Global};
use crate::convention::{CornerOffset, corner_offsets, mean_offset};
use crate::error::{Error, Result};
use crate::scene::Dataset;

/// The largest mean offset that passes \[px\].
const LARGEST_OFFSET_PX: f64 = 0.01;

#[derive(clap::Args)]
pub(super) struct Options {
    /// The dataset's folder.
    #[arg(default_value = "out/quick/dataset")]
    dataset: PathBuf,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let dataset = Dataset::open(&options.dataset)?;
    let mut offsets: Vec<CornerOffset> = Vec::new();
    let mut unreadable = 0;
    let mut rows = Vec::new();
    for name in dataset.scenes() {
        match dataset.read(name) {
            Ok(scene) => {
                let found = corner_offsets(&scene);
                if !global.json {
                    for corner in &found {
                        println!(
                            "{name} corner {}: offset ({:+.4}, {:+.4}) px +- ({:.4}, {:.4})",
                            corner.corner,
                            corner.offset_px[0],
                            corner.offset_px[1],
                            corner.standard_error_px[0],
                            corner.standard_error_px[1],
                        );
                    }
                }
                rows.extend(found.iter().map(|corner| {
                    serde_json::json!({
                        "scene": name,
                        "corner": corner.corner,
                        "offset_px": corner.offset_px,
                        "standard_error_px": corner.standard_error_px,
                    })
                }));
                offsets.extend(found);
            }
            Err(error) => {
                unreadable += 1;
                eprintln!("{name} skipped: {}", error.chain());
            }
        }
    }
    let mean = mean_offset(&offsets).ok_or_else(|| {
        Error::Other(format!(
            "{}: {} clean corners, at least 2 are needed to measure the offset",
            options.dataset.display(),
            offsets.len()
        ))
    })?;
    let passed = mean.length_px <= LARGEST_OFFSET_PX;
    if global.json {
        println!("{}", serde_json::json!({ "corners": rows, "mean": mean, "passed": passed }));
    } else {
        println!(
            "mean offset of {} clean corners: ({:+.4}, {:+.4}) px +- ({:.4}, {:.4}), length {:.4} \
             px: {} (at most {LARGEST_OFFSET_PX} px)",
            mean.corners,
            mean.mean_px[0],
            mean.mean_px[1],
            mean.standard_error_px[0],
            mean.standard_error_px[1],
            mean.length_px,
            if passed { "renderer, reader and projection agree" } else { "FAILED" },
        );
    }
    Ok(if passed && unreadable == 0 { Ended::Well } else { Ended::Partly })
}
