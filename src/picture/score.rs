//! Located corners beside known ones, and methods beside each other where nothing is known.

use std::path::PathBuf;

use serde::Serialize;

use super::KnownCorner;
use crate::geometry::{ImagePoint, Origin};
use crate::matching::assign;
use crate::refine::Corner;
use crate::stats::{median, quantile, root_mean_square};

/// What refiners made of one picture.
#[derive(Clone, Debug)]
pub struct Located {
    /// The picture.
    pub image: PathBuf,
    /// Of each refiner its answers, one for each seed.
    pub corners: Vec<Vec<Corner>>,
    /// The corners that are known.
    pub known: Vec<KnownCorner>,
    /// Of each refiner and answer the known corner that it is, if any: see [`Located::new`].
    pub known_of: Vec<Vec<Option<usize>>>,
}

impl Located {
    /// So far from a known corner an answer may lie \[px\].
    pub const GATE_PX: f64 = 5.0;

    /// Gives each refiner's answers to known corners, one to one, within the gate.
    pub fn new(image: PathBuf, corners: Vec<Vec<Corner>>, known: Vec<KnownCorner>) -> Self {
        let truth: Vec<ImagePoint> = known.iter().map(|corner| corner.point).collect();
        let known_of = corners.iter().map(|corners| given_to(&truth, corners)).collect();
        Self { image, corners, known, known_of }
    }

    /// How far a refiner's answer lies from the known corner that it is: x and y \[px\].
    pub fn offset_px(&self, refiner: usize, seed: usize) -> Option<[f64; 2]> {
        let known = self.known[self.known_of[refiner][seed]?].point;
        let at = self.corners[refiner][seed].position;
        Some([at.x - known.x, at.y - known.y])
    }
}

fn given_to(truth: &[ImagePoint], corners: &[Corner]) -> Vec<Option<usize>> {
    let is_near = |corner: &Corner| {
        let within = |known: &ImagePoint| known.distance_px(corner.position) <= Located::GATE_PX;
        corner.status.answered() && truth.iter().any(within)
    };
    // Only what may be given at all: an assignment's cost grows with the cube.
    let near: Vec<usize> = (0..corners.len()).filter(|&index| is_near(&corners[index])).collect();
    let answers: Vec<ImagePoint> = near.iter().map(|&index| corners[index].position).collect();
    let mut given = vec![None; corners.len()];
    for (index, known) in
        near.into_iter().zip(assign(truth, &answers, Located::GATE_PX).truth_of_answer)
    {
        given[index] = known;
    }
    given
}

/// Distances in a few numbers \[px\].
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Spread {
    /// Root mean square.
    pub rms_px: f64,
    /// Median.
    pub median_px: f64,
    /// The largest.
    pub largest_px: f64,
}

impl Spread {
    fn of(distances_px: &[f64]) -> Option<Self> {
        Some(Self {
            rms_px: root_mean_square(distances_px)?,
            median_px: median(distances_px)?,
            largest_px: quantile(distances_px, 1.0)?,
        })
    }
}

/// A refiner beside the known corners.
#[derive(Clone, Debug, Serialize)]
pub struct Score {
    /// Known corners.
    pub asked: usize,
    /// Those that were answered within [`Located::GATE_PX`].
    pub answered: usize,
    /// Other answers.
    pub elsewhere: usize,
    /// Distances from the known corners.
    pub error: Option<Spread>,
    /// Mean of answer less known corner \[px\].
    pub bias_px: Option<[f64; 2]>,
    /// What the refiner's covariances predict of `error.rms_px`, from the same answers.
    pub predicted_rms_px: Option<f64>,
}

/// Scores one refiner.
pub fn score(pictures: &[Located], refiner: usize) -> Score {
    let mut score = Score {
        asked: pictures.iter().map(|picture| picture.known.len()).sum(),
        answered: 0,
        elsewhere: 0,
        error: None,
        bias_px: None,
        predicted_rms_px: None,
    };
    let (mut offsets, mut predicted) = (Vec::new(), Vec::new());
    for picture in pictures {
        for (seed, corner) in picture.corners[refiner].iter().enumerate() {
            if let Some(offset) = picture.offset_px(refiner, seed) {
                offsets.push(offset);
                predicted.extend(deviation_px(corner));
            } else if corner.status.answered() {
                score.elsewhere += 1;
            }
        }
    }
    let distances: Vec<f64> = offsets.iter().map(|[dx, dy]| dx.hypot(*dy)).collect();
    score.answered = offsets.len();
    score.error = Spread::of(&distances);
    score.bias_px = mean_of(&offsets);
    score.predicted_rms_px = root_mean_square(&predicted);
    score
}

/// The standard deviation that a corner's covariance predicts of its distance from the truth \[px\]: the root of its trace.
pub fn deviation_px(corner: &Corner) -> Option<f64> {
    let variance = corner.covariance_px2.filter(|_| corner.status.answered())?.trace();
    (variance.is_finite() && variance >= 0.0).then(|| variance.sqrt())
}

fn mean_of(offsets: &[[f64; 2]]) -> Option<[f64; 2]> {
    let mean = |axis: usize| {
        crate::stats::mean(&offsets.iter().map(|offset| offset[axis]).collect::<Vec<_>>())
    };
    Some([mean(0)?, mean(1)?])
}

/// The origin from which the known corners look as if counted, where it is not the one that they were read with:
/// [`Origin::likely`] of the refiners. Answers that are their seeds say nothing.
pub fn likely_origin(pictures: &[Located], read_with: Origin) -> Option<Origin> {
    let count = pictures.first()?.corners.len();
    let offsets: Vec<Vec<[f64; 2]>> =
        (0..count).map(|refiner| moved_px(pictures, refiner)).collect();
    Origin::likely(&offsets, read_with)
}

/// The offsets of a refiner's answers that left their seeds \[px\].
fn moved_px(pictures: &[Located], refiner: usize) -> Vec<[f64; 2]> {
    let of_picture = |picture: &Located| {
        let moved = |&seed: &usize| {
            let corner = &picture.corners[refiner][seed];
            corner.position.distance_px(corner.seed.point) > 1e-9
        };
        let seeds = (0..picture.corners[refiner].len()).filter(moved);
        seeds.filter_map(|seed| picture.offset_px(refiner, seed)).collect::<Vec<_>>()
    };
    pictures.iter().flat_map(of_picture).collect()
}

/// Refiners beside each other.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    /// Distances between the answers of any two refiners to a seed.
    pub pairs: Option<Spread>,
    /// Of each refiner.
    pub refiners: Vec<Agreeing>,
}

/// A refiner beside the others.
#[derive(Clone, Debug, Serialize)]
pub struct Agreeing {
    /// Seeds.
    pub asked: usize,
    /// Those that were answered.
    pub answered: usize,
    /// Distances from the median, coordinate by coordinate, of all answers to a seed that has two or more.
    pub from_median: Option<Spread>,
    /// The distance from the truth that covariances predict, root mean square \[px\]; of methods that have one.
    pub predicted_rms_px: Option<f64>,
}

/// Compares refiners; of those not in `counted` the answers are in no pair and no median.
pub fn agreement(pictures: &[Located], counted: &[bool]) -> Agreement {
    let mut pairs = Vec::new();
    let mut from_median = vec![Vec::new(); counted.len()];
    for picture in pictures {
        for seed in 0..picture.corners.first().map_or(0, Vec::len) {
            let answers: Vec<(usize, ImagePoint)> = (0..counted.len())
                .filter(|&refiner| counted[refiner])
                .map(|refiner| (refiner, &picture.corners[refiner][seed]))
                .filter(|(_, corner)| corner.status.answered())
                .map(|(refiner, corner)| (refiner, corner.position))
                .collect();
            if answers.len() < 2 {
                continue;
            }
            let middle = |of: fn(&ImagePoint) -> f64| {
                median(&answers.iter().map(|(_, at)| of(at)).collect::<Vec<_>>())
                    .unwrap_or_default()
            };
            let middle = ImagePoint::new(middle(|at| at.x), middle(|at| at.y));
            for (index, (refiner, at)) in answers.iter().enumerate() {
                from_median[*refiner].push(at.distance_px(middle));
                pairs.extend(answers[..index].iter().map(|(_, other)| at.distance_px(*other)));
            }
        }
    }
    let refiners = from_median.iter().enumerate().map(|(refiner, distances)| {
        let corners = || pictures.iter().flat_map(|picture| &picture.corners[refiner]);
        let predicted: Vec<f64> = corners().filter_map(deviation_px).collect();
        Agreeing {
            asked: corners().count(),
            answered: corners().filter(|corner| corner.status.answered()).count(),
            from_median: Spread::of(distances),
            predicted_rms_px: root_mean_square(&predicted),
        }
    });
    Agreement { refiners: refiners.collect(), pairs: Spread::of(&pairs) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::Detection;
    use crate::refine::RefineStatus;

    /// Answers to seeds at the known corners, each so far from its own.
    fn located(offsets: &[[f64; 2]]) -> Located {
        let seeds: Vec<ImagePoint> =
            (0..offsets.len()).map(|index| ImagePoint::new(20.0 * index as f64, 10.0)).collect();
        let known =
            seeds.iter().map(|&point| KnownCorner { point, label: None, place: String::new() });
        let answered = |(seed, offset): (&ImagePoint, &[f64; 2])| Corner {
            position: ImagePoint::new(seed.x + offset[0], seed.y + offset[1]),
            ..Corner::at_seed(Detection::new(*seed, 0.0), 1, RefineStatus::Ok)
        };
        let corners: Vec<Corner> = seeds.iter().zip(offsets).map(answered).collect();
        Located::new("a.png".into(), vec![corners], known.collect())
    }

    #[test]
    fn errors_bias_and_answers_elsewhere_are_those_of_the_offsets() {
        let mut picture = located(&[[0.3, 0.4], [-0.3, 0.4], [6.0, 0.0], [0.0, 0.0]]);
        let declined = picture.corners[0][3];
        picture.corners[0][3] = Corner::at_seed(declined.seed, 0, RefineStatus::Singular);
        let picture = Located::new(picture.image, picture.corners, picture.known);
        let score = score(&[picture], 0);
        assert_eq!((score.asked, score.answered, score.elsewhere), (4, 2, 1));
        let error = score.error.expect("two answers");
        assert!((error.rms_px - 0.5).abs() < 1e-9 && (error.largest_px - 0.5).abs() < 1e-9);
        let [dx, dy] = score.bias_px.expect("two answers");
        assert!(dx.abs() < 1e-9 && (dy - 0.4).abs() < 1e-9);
    }

    #[test]
    fn an_origin_is_recognised_by_the_offset_it_makes() {
        for (offset, read_with, wanted) in [
            (-0.5, Origin::PixelCentre, Some(Origin::PixelCorner)),
            (-1.05, Origin::PixelCentre, Some(Origin::Matlab)),
            (0.45, Origin::PixelCorner, Some(Origin::PixelCentre)),
            (0.5, Origin::Matlab, Some(Origin::PixelCorner)),
            (0.02, Origin::PixelCentre, None),
            (-0.25, Origin::PixelCentre, None),
        ] {
            let picture = located(&[[offset, offset + 0.01]; 5]);
            assert_eq!(likely_origin(&[picture], read_with), wanted, "{offset} {read_with:?}");
        }
        // One axis only, too few, too uncertain, and answers that are their seeds.
        let unclear = [[-0.9, -0.1], [-0.1, -0.9], [-1.4, 0.4], [0.4, -1.4]];
        for offsets in [&[[-0.5, 0.0]; 5][..], &[[-0.5, -0.5]; 3], &unclear, &[[0.0; 2]; 5], &[]] {
            assert_eq!(
                likely_origin(&[located(offsets)], Origin::PixelCentre),
                None,
                "{offsets:?}"
            );
        }
    }

    #[test]
    fn agreement_is_of_counted_refiners_that_answer() {
        let mut picture = located(&[[0.0, 0.0], [0.0, 0.0]]);
        let others = [located(&[[0.3, 0.0], [9.0, 0.0]]), located(&[[0.0, 0.4], [0.0, 0.0]])];
        picture.corners.extend(others.iter().map(|other| other.corners[0].clone()));
        picture.corners[1][1] =
            Corner::at_seed(picture.corners[1][1].seed, 0, RefineStatus::Singular);
        picture.corners.push(located(&[[2.0, 2.0]; 2]).corners[0].clone());
        let found = agreement(&[picture], &[true, true, true, false]);
        let pairs = found.pairs.expect("pairs");
        assert!((pairs.largest_px - 0.5).abs() < 1e-9);
        // 0.3, 0.4 and 0.5 at the first, 0 at the second.
        assert!((pairs.rms_px - (0.5_f64 / 4.0).sqrt()).abs() < 1e-9, "{pairs:?}");
        assert_eq!((found.refiners[1].answered, found.refiners[1].asked), (1, 2));
        assert!((found.refiners[1].from_median.expect("one").rms_px - 0.3).abs() < 1e-9);
        assert!(found.refiners[3].from_median.is_none());
    }
}
