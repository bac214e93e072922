//! What every algorithm promises, tried on drawn pictures whose corners are known: for `cornerbench verify ALGORITHM`.
//!
//! Findings are in words that somebody can act on. Some are told and neither right nor wrong: what a refiner does with
//! bad seeds is its own affair, and good to know.

mod detector;
mod pictures;
mod refiner;

use serde::Serialize;

use crate::error::Result;
use crate::geometry::ImagePoint;

pub use detector::try_detector;
pub use refiner::try_refiner;

/// Pictures that are drawn, of twelve corners each.
const PICTURES: usize = 8;
/// Answers that are farther from a corner are not meant for it \[px\].
const GATE_PX: f64 = 5.0;
/// By how much answers may differ that should be the same \[px\].
const SAME_PX: f64 = 0.05;

/// What was found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// What was tried.
    pub what: &'static str,
    /// Whether that is as it should be; `None` of what is only told.
    pub passed: Option<bool>,
    /// What was found, and what to do about it.
    pub words: String,
}

impl Finding {
    /// Something to know.
    pub fn told(what: &'static str, words: String) -> Self {
        Self { what, passed: None, words }
    }

    fn tried(what: &'static str, words: std::result::Result<String, String>) -> Self {
        match words {
            Ok(words) => Self { what, passed: Some(true), words },
            Err(words) => Self { what, passed: Some(false), words },
        }
    }
}

/// What another origin of coordinates, or their order, makes of answers.
///
/// # Errors
/// What is wrong, and how it is put right.
fn convention(pairs: &[[ImagePoint; 2]]) -> std::result::Result<String, String> {
    let rms_px = |turn: fn(ImagePoint) -> ImagePoint| {
        let squares = pairs.iter().map(|[truth, answer]| truth.distance_px(turn(*answer)).powi(2));
        (squares.sum::<f64>() / pairs.len() as f64).sqrt()
    };
    if pairs.len() < 8 {
        return Ok(format!("{} answers are too few to tell", pairs.len()));
    }
    let (plain_px, swapped_px) = (rms_px(|p| p), rms_px(|p| ImagePoint::new(p.y, p.x)));
    if swapped_px < 0.2 * plain_px {
        return Err(format!(
            "x and y look swapped: answers are {plain_px:.1} px off, and {swapped_px:.2} px the other way round; give x, \
             to the right, before y, downwards (rows of an array are y)"
        ));
    }
    let errors = pairs.iter().map(|[truth, answer]| [answer.x - truth.x, answer.y - truth.y]);
    let (x, x_error) = mean(errors.clone().map(|[x, _]| x));
    let (y, y_error) = mean(errors.map(|[_, y]| y));
    let words = format!(
        "answers are shifted by ({x:+.3}, {y:+.3}) px on average, +- ({x_error:.3}, {y_error:.3})"
    );
    let is_at =
        |value: f64, by_px: f64, error: f64| (value - by_px).abs() < 0.15_f64.max(3.0 * error);
    let known = [
        (
            0.5,
            "they look shifted by (+0.5, +0.5), as if counted from the pixel's corner: subtract 0.5 from x and y",
        ),
        (-0.5, "they look shifted by (-0.5, -0.5): half a pixel is taken off once too often"),
        (1.0, "they look shifted by (+1, +1), as if counted from 1: subtract 1 from x and y"),
        (-1.0, "they look shifted by (-1, -1): 1 is taken off once too often"),
    ];
    if is_at(x, 0.0, x_error) && is_at(y, 0.0, y_error) {
        return Ok(words);
    }
    match known.iter().find(|(by_px, _)| is_at(x, *by_px, x_error) && is_at(y, *by_px, y_error)) {
        Some((_, advice)) => {
            Err(format!("{words}; {advice}. The centre of the top-left pixel is (0, 0)"))
        }
        None => Err(format!(
            "{words}, over corners turned all ways; the centre of the top-left pixel is (0, 0), x to the right"
        )),
    }
}

/// The mean of values and its standard error.
fn mean(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let count = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / count;
    let variance = values.map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    (mean, (variance / count).sqrt())
}

/// The middle one of values, 0 of none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Pictures for all that is tried.
fn pictures() -> Result<Vec<pictures::Picture>> {
    pictures::Picture::all(PICTURES)
}
