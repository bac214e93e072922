//! Records -> what a refiner made of the corners that were found.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::record::{Record, kind, status};
use crate::report::summary::Errors;
use crate::stats;

/// What a refiner made of the corners that were found.
#[derive(Clone, Debug, Serialize)]
pub struct RefinementSummary {
    /// All of them.
    pub all: Refined,
    /// Those with nothing before them within [`CLEAR_PX`].
    pub clear: Refined,
    /// How many had each status.
    pub statuses: BTreeMap<String, usize>,
    /// The squared error over the refiner's own covariance, median of those that have one: 1.39 where that is
    /// right and the errors are normal.
    pub median_normed_square: Option<f64>,
}

/// Corners that a refiner was asked for.
#[derive(Clone, Debug, Serialize)]
pub struct Refined {
    /// How many.
    pub asked: usize,
    /// How many it answered, and did not decline.
    pub answered: usize,
    /// Of the answers.
    pub errors: Option<Errors>,
    /// Their root mean square error over that of the bounds from the pixels within 10 px.
    pub rmse_over_bound: Option<f64>,
}

/// A corner is clear of what is nearer to the camera by so much \[px\].
pub const CLEAR_PX: f64 = 20.0;

/// Summarises the records of one method.
pub fn summarise(records: &[&Record]) -> RefinementSummary {
    let found: Vec<&Record> = records
        .iter()
        .copied()
        .filter(|record| record.kind == kind::CORNER && record.status == status::OK)
        .collect();
    let is_clear = |record: &Record| record.nearest_occluder_px.is_none_or(|px| px > CLEAR_PX);
    let clear: Vec<&Record> = found.iter().copied().filter(|record| is_clear(record)).collect();
    let mut statuses = BTreeMap::new();
    for record in &found {
        *statuses.entry(record.refine_status.clone().unwrap_or_default()).or_insert(0) += 1;
    }
    let normed: Vec<f64> =
        found.iter().filter(|r| is_answered(r)).filter_map(|r| normed_square(r)).collect();
    RefinementSummary {
        all: refined(&found),
        clear: refined(&clear),
        statuses,
        median_normed_square: stats::median(&normed),
    }
}

fn is_answered(record: &Record) -> bool {
    matches!(record.refine_status.as_deref(), Some("ok" | "max_iterations"))
}

fn refined(records: &[&Record]) -> Refined {
    let answered: Vec<&&Record> = records.iter().filter(|record| is_answered(record)).collect();
    let errors: Vec<f64> = answered.iter().filter_map(|record| record.refined_error_px).collect();
    let of_bounded: Vec<(f64, f64)> = answered
        .iter()
        .filter_map(|record| Some((record.refined_error_px?, record.bound_r10_px?)))
        .collect();
    let rms = |of: &dyn Fn(&(f64, f64)) -> f64| {
        stats::root_mean_square(&of_bounded.iter().map(of).collect::<Vec<_>>())
    };
    Refined {
        asked: records.len(),
        answered: answered.len(),
        errors: Errors::of(&errors),
        rmse_over_bound: rms(&|pair| pair.0)
            .zip(rms(&|pair| pair.1))
            .map(|(error_px, bound_px)| error_px / bound_px),
    }
}

/// e^T C^-1 e.
fn normed_square(record: &Record) -> Option<f64> {
    let x = record.refined_x_px? - record.true_x_px?;
    let y = record.refined_y_px? - record.true_y_px?;
    let (xx, xy, yy) =
        (record.covariance_xx_px2?, record.covariance_xy_px2?, record.covariance_yy_px2?);
    let determinant = xx * yy - xy * xy;
    (determinant > 0.0).then(|| (x * x * yy - 2.0 * x * y * xy + y * y * xx) / determinant)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner(error_px: f64, occluder_px: Option<f64>, refine_status: &str) -> Record {
        Record {
            kind: kind::CORNER.into(),
            status: status::OK.into(),
            nearest_occluder_px: occluder_px,
            refine_status: Some(refine_status.into()),
            refined_error_px: Some(error_px),
            bound_r10_px: Some(0.1),
            true_x_px: Some(5.0),
            true_y_px: Some(5.0),
            refined_x_px: Some(5.0 + error_px),
            refined_y_px: Some(5.0),
            covariance_xx_px2: Some(0.04),
            covariance_xy_px2: Some(0.0),
            covariance_yy_px2: Some(0.09),
            ..Record::default()
        }
    }

    #[test]
    fn errors_are_those_of_answers_and_clear_corners_are_told_apart() {
        let records = [
            corner(0.3, None, "ok"),
            corner(0.4, Some(3.0), "max_iterations"),
            corner(9.0, Some(30.0), "diverged"),
        ];
        let records: Vec<&Record> = records.iter().collect();
        let summary = summarise(&records);
        assert_eq!((summary.all.asked, summary.all.answered), (3, 2));
        assert_eq!((summary.clear.asked, summary.clear.answered), (2, 1));
        let rmse_px = summary.all.errors.expect("two").rmse_px;
        assert!((rmse_px - 0.125_f64.sqrt()).abs() < 1e-12);
        assert!((summary.all.rmse_over_bound.expect("two") - 10.0 * rmse_px).abs() < 1e-9);
        assert_eq!(summary.statuses["diverged"], 1);
        // (0.09 + 0.16) / 0.04 / 2 as the median of two.
        assert!((summary.median_normed_square.expect("two") - 3.125).abs() < 1e-9);
    }
}
