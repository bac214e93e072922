//! Records -> what became of the corners that a refiner was given, as much as statistics ask.

use std::sync::Arc;

use super::{FAILED_PX, MOST_BOUND_PX};
use crate::record::{Record, kind, status};

/// What became of a corner that a refiner was given, as far as statistics ask.
#[derive(Clone, Debug)]
pub struct Answer {
    pub(in crate::report) scene: Arc<str>,
    exposure: Option<i32>,
    corner_index: Option<i32>,
    pub(super) refine_status: Arc<str>,
    /// Of an answer that was not declined.
    pub(in crate::report) error_px: Option<f64>,
    pub(super) off_px: [f64; 2],
    pub(super) own_frame_px: Option<[f64; 2]>,
    pub(super) bound_px: Option<f64>,
    pub(super) normed_square: Option<f64>,
}

/// A corner of a photograph: scene, exposure, corner.
pub(in crate::report) type Key<'a> = (&'a str, Option<i32>, Option<i32>);

impl Answer {
    fn of(record: &Record, scene: Arc<str>, refine_status: Arc<str>) -> Self {
        let off = |at: Option<f64>, truth: Option<f64>| at.zip(truth).map_or(0.0, |(a, b)| a - b);
        let own_frame = record.refined_along_px.zip(record.refined_across_px);
        Self {
            scene,
            exposure: record.exposure,
            corner_index: record.corner_index,
            refine_status,
            error_px: record.refined_error_px.filter(|_| is_answered(record)),
            off_px: [
                off(record.refined_x_px, record.true_x_px),
                off(record.refined_y_px, record.true_y_px),
            ],
            own_frame_px: own_frame.map(|(along_px, across_px)| [along_px, across_px]),
            bound_px: record.bound_r10_px.filter(|bound_px| *bound_px <= MOST_BOUND_PX),
            normed_square: normed_square(record).filter(|_| is_answered(record)),
        }
    }

    /// Which corner.
    pub(in crate::report) fn key(&self) -> Key<'_> {
        (&self.scene, self.exposure, self.corner_index)
    }

    /// Whether it was declined, or is off by more than [`FAILED_PX`].
    pub(in crate::report) fn is_failed(&self) -> bool {
        self.error_px.is_none_or(|error_px| error_px > FAILED_PX)
    }

    /// Whether another says just the same.
    #[allow(clippy::float_cmp, reason = "the same to the bit")]
    pub(in crate::report) fn is_same(&self, other: &Self) -> bool {
        (self.off_px, self.error_px) == (other.off_px, other.error_px)
            && self.refine_status == other.refine_status
    }

    /// The error over its bound.
    pub(super) fn over_bound(&self) -> Option<f64> {
        self.error_px.zip(self.bound_px).map(|(error_px, bound_px)| error_px / bound_px)
    }
}

/// Answers, as they are collected from rows.
#[derive(Default)]
pub(in crate::report) struct Answers {
    /// So far.
    pub all: Vec<Answer>,
}

impl Answers {
    /// Adds the answer of a row, if it is of a corner that a refiner was given.
    pub fn add(&mut self, record: &Record) {
        if !is_given(record) {
            return;
        }
        // Those of one scene come one after the other, most with the status of the one before.
        let last = self.all.last();
        let shared = |of_last: fn(&Answer) -> &Arc<str>, text: &str| {
            let known = last.map(of_last).filter(|known| ***known == *text);
            known.cloned().unwrap_or_else(|| text.into())
        };
        let scene = shared(|last| &last.scene, &record.scene);
        let status = record.refine_status.as_deref().unwrap_or_default();
        let refine_status = shared(|last| &last.refine_status, status);
        self.all.push(Answer::of(record, scene, refine_status));
    }
}

/// The answers for the corners that a refiner was given.
pub fn answers(records: &[&Record]) -> Vec<Answer> {
    let mut answers = Answers::default();
    records.iter().for_each(|record| answers.add(record));
    answers.all
}

/// Whether a refiner was given this corner.
pub(in crate::report) fn is_given(record: &Record) -> bool {
    record.kind == kind::CORNER && record.status == status::OK
}

/// Whether a refiner answered, and did not decline.
pub(in crate::report) fn is_answered(record: &Record) -> bool {
    matches!(record.refine_status.as_deref(), Some("ok" | "max_iterations"))
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
