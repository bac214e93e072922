//! Which corners are found, how far the answers are from them, and what the other answers are.

use geo::{Distance, Euclidean, LineString, Point};

use crate::bound::CornerBounds;
use crate::geometry::{Camera, ImagePoint};
use crate::matching::{assign, first_matched};
use crate::refine::Corner;
use crate::scene::{Cause, Scene, Surface, TrueCorner, Truth, Visibility};
use crate::sensor::Rig;

/// What is asked for, and how near to it an answer must be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CornerRule {
    /// How far an answer may be from what it belongs to \[px\].
    pub gate_px: f64,
    /// How far two edges of a corner must be seen from it \[px\]: where less is, it is not asked for.
    pub least_edge_px: f64,
    /// The largest bound on a corner's place with which it is asked for \[px\].
    pub most_bound_px: f64,
}

/// What became of a true corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It was asked for, and an answer was matched to it.
    Found,
    /// It was asked for, and none was.
    Missed,
    /// It is not visible: not asked for.
    Hidden,
    /// It is visible, but too little of its edges is: not asked for.
    TooSmall,
    /// It is visible, but noise hides where: not asked for.
    TooUncertain,
}

/// A true corner and its answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CornerScore {
    /// What became of it.
    pub fate: Fate,
    /// Index of the answer.
    pub answer: Option<usize>,
    /// The largest threshold on the response with which it is found, whichever answer within the gate finds
    /// it.
    pub found_at_response: Option<f64>,
    /// Distance of the detector's position from the truth \[px\].
    pub detected_error_px: Option<f64>,
    /// Distance of the refiner's position from the truth \[px\].
    pub refined_error_px: Option<f64>,
}

/// Where an answer lies that belongs to no corner asked for: at the nearest of what is known within the
/// gate; of corners not asked for only where none asked for is within it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// At a corner asked for that has another answer.
    Duplicate,
    /// At a corner hidden by another object: neither right nor wrong.
    HiddenCorner,
    /// At a corner of whose edges too little is seen: neither right nor wrong.
    SmallCorner,
    /// At a corner that noise hides: neither right nor wrong.
    UncertainCorner,
    /// At what looks like a corner of the target and is none.
    FalseJunction(Cause),
    /// At a part of an edge of the target that is seen.
    Edge,
    /// Elsewhere on the target.
    Target,
    /// On another object.
    Object,
    /// On floor or wall.
    Background,
}

impl Place {
    /// The name used in records.
    pub fn name(self) -> &'static str {
        match self {
            Self::Duplicate => "duplicate",
            Self::HiddenCorner => "hidden corner",
            Self::SmallCorner => "small corner",
            Self::UncertainCorner => "uncertain corner",
            Self::FalseJunction(cause) => cause.name(),
            Self::Edge => "edge",
            Self::Target => "target",
            Self::Object => "object",
            Self::Background => "background",
        }
    }

    /// Whether an answer there is neither right nor wrong.
    pub fn is_ignored(self) -> bool {
        matches!(self, Self::HiddenCorner | Self::SmallCorner | Self::UncertainCorner)
    }
}

/// An answer that belongs to no corner asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OtherScore {
    /// Its index.
    pub answer: usize,
    /// Where it lies.
    pub place: Place,
    /// Distance of the detector's position from the nearest corner asked for \[px\].
    pub nearest_corner_px: Option<f64>,
}

/// What became of the true corners, the answers and the false junctions of one exposure.
#[derive(Clone, Debug, PartialEq)]
pub struct CornerScores {
    /// Of each true corner, in the order of their index.
    pub corners: Vec<CornerScore>,
    /// Of each answer that belongs to no corner asked for, in the answers' order.
    pub others: Vec<OtherScore>,
    /// Of each false junction, in the truth's order, the strongest response of the answers there.
    pub false_junctions: Vec<Option<f64>>,
}

/// The truth of one exposure, as its camera sees it.
pub struct Seen<'a> {
    /// What is true.
    pub truth: &'a Truth,
    /// Of each corner the bounds on its place.
    pub bounds: Vec<CornerBounds>,
    /// What is seen of the target's edges \[px\].
    edges: Vec<LineString<f64>>,
    /// What a point of the image shows.
    surface_at: Box<dyn Fn(ImagePoint) -> Surface + 'a>,
}

impl<'a> Seen<'a> {
    /// The truth of an exposure of `scene` by `rig`; `truth` is the scene's, as that camera sees it, and
    /// `bounds` are those of its corners.
    pub fn new(
        scene: &'a Scene,
        truth: &'a Truth,
        bounds: Vec<CornerBounds>,
        rig: &'a Rig,
    ) -> Self {
        const STEP_PX: f64 = 4.0; // a lens bends an edge by far less than a pixel on the way
        let edges = truth.seen_edges(&rig.camera, &rig.world_from_camera, STEP_PX);
        let line = |points: Vec<ImagePoint>| points.iter().map(|p| (p.x, p.y)).collect();
        let film: &Camera = &scene.description.camera;
        let target_id = scene.description.target.object_id;
        let surface_at = move |point| {
            let on_film = film.project(&rig.camera.unproject(point, 1.0)).unwrap_or(point);
            scene.geometry.surface_at(on_film, target_id)
        };
        Self {
            truth,
            bounds,
            edges: edges.into_iter().map(line).collect(),
            surface_at: Box::new(surface_at),
        }
    }

    /// Where an answer lies that belongs to no corner asked for, and the index of the false junction.
    fn place(&self, point: ImagePoint, rule: CornerRule) -> (Place, Option<usize>) {
        let truth = self.truth;
        let corners = truth.corners.iter().filter_map(|corner| {
            let place = match self.unasked(corner, rule) {
                None => Place::Duplicate,
                Some(Fate::TooSmall) => Place::SmallCorner,
                Some(Fate::TooUncertain) => Place::UncertainCorner,
                Some(_) if corner.visibility == Visibility::Occluded => Place::HiddenCorner,
                Some(_) => return None,
            };
            Some((point.distance_px(corner.image_point_px), place, None))
        });
        let junctions = truth.false_junctions.iter().enumerate().map(|(index, junction)| {
            let place = Place::FalseJunction(junction.cause);
            (point.distance_px(junction.image_point_px), place, Some(index))
        });
        let near: Vec<_> = corners
            .chain(junctions)
            .filter(|(distance_px, ..)| *distance_px <= rule.gate_px)
            .collect();
        let is_asked_for = near.iter().any(|(_, place, _)| *place == Place::Duplicate);
        let nearest = near
            .into_iter()
            .filter(|(_, place, _)| !(is_asked_for && place.is_ignored()))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((_, place, junction)) = nearest {
            return (place, junction);
        }
        let here = Point::new(point.x, point.y);
        let at_edge = |line: &LineString<f64>| Euclidean.distance(&here, line) <= rule.gate_px;
        let place = if self.edges.iter().any(at_edge) {
            Place::Edge
        } else {
            match (self.surface_at)(point) {
                Surface::Target => Place::Target,
                Surface::Object => Place::Object,
                Surface::Background => Place::Background,
            }
        };
        (place, None)
    }

    /// The corners asked for, in the order of their index.
    pub fn asked(&self, rule: CornerRule) -> impl Iterator<Item = &'a TrueCorner> {
        let corners = self.truth.corners.iter();
        corners.filter(move |corner| self.unasked(corner, rule).is_none())
    }

    /// Why a corner is not asked for; `None` where it is.
    fn unasked(&self, corner: &TrueCorner, rule: CornerRule) -> Option<Fate> {
        if corner.visibility != Visibility::Visible {
            Some(Fate::Hidden)
        } else if corner.second_edge_px() < rule.least_edge_px {
            Some(Fate::TooSmall)
        } else if self.bounds[corner.index].closed_px.is_none_or(|bound| bound > rule.most_bound_px)
        {
            Some(Fate::TooUncertain)
        } else {
            None
        }
    }
}

/// Matches answers to the corners asked for and measures them.
///
/// The detector's position decides which corner an answer belongs to. Thus the refiner changes no
/// match: its errors are measured on the same corners as the detector's, and a refiner that moves
/// far away is charged with the whole distance instead of losing the match.
pub fn score_corners(seen: &Seen<'_>, answers: &[Corner], rule: CornerRule) -> CornerScores {
    let truth = seen.truth;
    let asked: Vec<&TrueCorner> = seen.asked(rule).collect();
    let asked_points: Vec<_> = asked.iter().map(|corner| corner.image_point_px).collect();
    let detected: Vec<_> = answers.iter().map(|corner| corner.seed.point).collect();
    let matched = assign(&asked_points, &detected, rule.gate_px);
    let found_at = found_at_responses(&asked_points, answers, rule.gate_px);

    let mut scores = CornerScores {
        corners: truth
            .corners
            .iter()
            .map(|corner| {
                let place = asked.iter().position(|one| one.index == corner.index);
                let answer = place.and_then(|place| matched.answer_of_truth[place]);
                let error_px = |point: ImagePoint| point.distance_px(corner.image_point_px);
                CornerScore {
                    fate: match answer {
                        Some(_) => Fate::Found,
                        None => seen.unasked(corner, rule).unwrap_or(Fate::Missed),
                    },
                    answer,
                    found_at_response: place.and_then(|place| found_at[place]),
                    detected_error_px: answer.map(|index| error_px(answers[index].seed.point)),
                    refined_error_px: answer.map(|index| error_px(answers[index].position)),
                }
            })
            .collect(),
        others: Vec::new(),
        false_junctions: vec![None; truth.false_junctions.len()],
    };
    for (answer, point) in detected.iter().enumerate() {
        if matched.truth_of_answer[answer].is_some() {
            continue;
        }
        let (place, junction) = seen.place(*point, rule);
        if let Some(junction) = junction {
            let strongest = &mut scores.false_junctions[junction];
            let response = answers[answer].seed.response;
            *strongest = Some(strongest.map_or(response, |other| other.max(response)));
        }
        let distances_px = asked_points.iter().map(|corner| corner.distance_px(*point));
        let nearest_corner_px = distances_px.min_by(f64::total_cmp);
        scores.others.push(OtherScore { answer, place, nearest_corner_px });
    }
    scores
}

/// Measures answers to seeds that were given: one for each of the corners that [`Seen::asked`] names, in its order.
pub fn score_seeded(seen: &Seen<'_>, answers: &[Corner], rule: CornerRule) -> CornerScores {
    let mut given = answers.iter().enumerate();
    let corners = seen.truth.corners.iter().map(|corner| {
        let unasked = seen.unasked(corner, rule);
        let answer = if unasked.is_none() { given.next() } else { None };
        let error_px = |point: ImagePoint| point.distance_px(corner.image_point_px);
        CornerScore {
            fate: unasked.unwrap_or(if answer.is_some() { Fate::Found } else { Fate::Missed }),
            answer: answer.map(|(index, _)| index),
            found_at_response: None,
            detected_error_px: answer.map(|(_, answer)| error_px(answer.seed.point)),
            refined_error_px: answer.map(|(_, answer)| error_px(answer.position)),
        }
    });
    CornerScores { corners: corners.collect(), others: Vec::new(), false_junctions: Vec::new() }
}

/// Of each corner the largest threshold on the response with which it is found, whichever answer within the gate finds
/// it.
pub fn found_at_responses(
    corners: &[ImagePoint],
    answers: &[Corner],
    gate_px: f64,
) -> Vec<Option<f64>> {
    let mut strongest_first: Vec<&Corner> = answers.iter().collect();
    strongest_first.sort_by(|a, b| b.seed.response.total_cmp(&a.seed.response));
    let points: Vec<_> = strongest_first.iter().map(|corner| corner.seed.point).collect();
    first_matched(corners, &points, gate_px)
        .into_iter()
        .map(|answer| answer.map(|index| strongest_first[index].seed.response))
        .collect()
}
