//! What every algorithm promises, tried on drawn pictures whose corners are known: for `cornerbench verify ALGORITHM`.
//!
//! Findings are in words that somebody can act on. Some are told and neither right nor wrong: what a refiner does with
//! bad seeds is its own affair, and good to know.

mod detector;
mod pictures;
mod refiner;

use serde::Serialize;

use crate::error::Result;
use crate::geometry::{ImagePoint, shift_words};
use crate::stats::{mean, root_mean_square, standard_error};

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

/// What another origin of coordinates, or their order, makes of answers: pairs of a corner and its answer.
fn convention(pairs: &[[ImagePoint; 2]]) -> Finding {
    const WHAT: &str = "coordinates";
    let distances_px = |turn: fn(ImagePoint) -> ImagePoint| -> Vec<f64> {
        pairs.iter().map(|[truth, answer]| truth.distance_px(turn(*answer))).collect()
    };
    let errors_px = |of: fn(&ImagePoint) -> f64| -> Vec<f64> {
        pairs.iter().map(|[truth, answer]| of(answer) - of(truth)).collect()
    };
    let (plain, swapped) = (distances_px(|p| p), distances_px(|p| ImagePoint::new(p.y, p.x)));
    let (x, y) = (errors_px(|p| p.x), errors_px(|p| p.y));
    let (Some(plain_px), Some(swapped_px), Some([x_px, x_error]), Some([y_px, y_error])) =
        (root_mean_square(&plain), root_mean_square(&swapped), located(&x), located(&y))
    else {
        return Finding::told(WHAT, format!("{} answers are too few to tell", pairs.len()));
    };
    if swapped_px < 0.2 * plain_px {
        return Finding::tried(
            WHAT,
            Err(format!(
                "x and y look swapped: answers are {plain_px:.1} px off, and {swapped_px:.2} px the other way round; {SWAPPED}"
            )),
        );
    }
    let words = format!(
        "answers are shifted by ({x_px:+.3}, {y_px:+.3}) px on average, +- ({x_error:.3}, {y_error:.3})"
    );
    let near_px = [x_error, y_error].map(|error| 0.15_f64.max(3.0 * error));
    let is_none = x_px.abs() < near_px[0] && y_px.abs() < near_px[1];
    Finding::tried(
        WHAT,
        match shift_words([x_px, y_px], near_px) {
            _ if is_none => Ok(words),
            Some(advice) => {
                Err(format!("{words}; {advice}. The centre of the top-left pixel is (0, 0)"))
            }
            None => Err(format!(
                "{words}, over corners turned all ways; the centre of the top-left pixel is (0, 0), x to the right"
            )),
        },
    )
}

/// What to do about coordinates the wrong way round.
const SWAPPED: &str = "give x, to the right, before y, downwards (rows of an array are y)";

/// The mean of values and its standard error, of no fewer than eight.
fn located(values: &[f64]) -> Option<[f64; 2]> {
    Some([mean(values)?, standard_error(values)?]).filter(|_| values.len() >= 8)
}

/// Pictures for all that is tried.
fn pictures() -> Result<Vec<pictures::Picture>> {
    pictures::Picture::all(PICTURES)
}
