//! How far answers are from the corners they belong to, and which corners have none.

use crate::geometry::ImagePoint;
use crate::matching::assign;
use crate::refine::Corner;
use crate::scene::{Truth, Visibility};

/// What became of a true corner or of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// A visible corner with the answer that was matched to it.
    Found,
    /// A visible corner without one.
    Missed,
    /// A corner that is not visible.
    Hidden,
    /// An answer that belongs to no corner.
    False,
    /// An answer at a corner that is occluded: neither right nor wrong.
    Ignored,
}

/// One true corner, or one answer that belongs to none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CornerScore {
    /// What became of it.
    pub fate: Fate,
    /// Index of the true corner.
    pub corner: Option<usize>,
    /// Index of the answer.
    pub answer: Option<usize>,
    /// Distance of the detector's position from the truth \[px\].
    pub detected_error_px: Option<f64>,
    /// Distance of the refiner's position from the truth \[px\].
    pub refined_error_px: Option<f64>,
}

/// Matches answers to true corners and measures them: first a row per true corner, in the order of
/// their index, then a row per answer that belongs to no visible corner.
///
/// The detector's position decides which corner an answer belongs to. Thus the refiner changes no
/// match: its errors are measured on the same corners as the detector's, and a refiner that moves
/// far away is charged with the whole distance instead of losing the match.
pub fn score_corners(truth: &Truth, answers: &[Corner], gate_px: f64) -> Vec<CornerScore> {
    let positions = |wanted: Visibility| -> (Vec<usize>, Vec<ImagePoint>) {
        let of_kind = truth.corners.iter().filter(|corner| corner.visibility == wanted);
        of_kind.map(|corner| (corner.index, corner.image_point_px)).unzip()
    };
    let detected: Vec<_> = answers.iter().map(|corner| corner.seed.point).collect();
    let (visible, visible_points) = positions(Visibility::Visible);
    let matched = assign(&visible_points, &detected, gate_px);

    let mut scores: Vec<CornerScore> = truth
        .corners
        .iter()
        .map(|corner| {
            let place = visible.iter().position(|index| *index == corner.index);
            let answer = place.and_then(|place| matched.answer_of_truth[place]);
            let error = |point: ImagePoint| point.distance_px(corner.image_point_px);
            CornerScore {
                fate: match (place, answer) {
                    (Some(_), Some(_)) => Fate::Found,
                    (Some(_), None) => Fate::Missed,
                    (None, _) => Fate::Hidden,
                },
                corner: Some(corner.index),
                answer,
                detected_error_px: answer.map(|index| error(answers[index].seed.point)),
                refined_error_px: answer.map(|index| error(answers[index].position)),
            }
        })
        .collect();

    let (_, occluded_points) = positions(Visibility::Occluded);
    let left_over: Vec<usize> =
        (0..answers.len()).filter(|index| matched.truth_of_answer[*index].is_none()).collect();
    let left_over_points: Vec<_> = left_over.iter().map(|index| detected[*index]).collect();
    let at_occluded = assign(&occluded_points, &left_over_points, gate_px);
    scores.extend(left_over.iter().zip(&at_occluded.truth_of_answer).map(|(index, occluded)| {
        CornerScore {
            fate: if occluded.is_some() { Fate::Ignored } else { Fate::False },
            corner: None,
            answer: Some(*index),
            detected_error_px: None,
            refined_error_px: None,
        }
    }));
    scores
}
