//! What pipelines answer: they see an exposure, a rig and a range image; no truth.

use std::borrow::Cow;

use crate::detect::Detection;
use crate::external::{Asked, Failure, Reply};
use crate::grasp::{Face, Grasp, GraspEstimator, NoFace, NoGrasp};
use crate::plan::{AnyStage, GraspStages, Pipeline, Seeds};
use crate::refine::{Corner, RefineStatus};
use crate::sensor::{Exposure, RangeImage, Rig};
use crate::target::{NoTarget, TargetRegion};

/// The target's region, or why there is none.
pub(super) type Region = Result<TargetRegion, NoTarget>;

/// What a pipeline answered to one exposure, stage by stage.
pub(super) struct Answers {
    /// `None` of a pipeline that searches the whole image.
    pub region: Option<Region>,
    pub corners: Vec<Corner>,
    /// `None` of a pipeline that ends with corners.
    pub grasp: Option<GraspAnswer>,
    /// What went wrong with another program: then there are no corners, or they are the seeds, or there is no grasp.
    pub failure: Option<Failure>,
}

/// What the first stages gave: the target's region, where one is looked for, and the candidates, found or given.
pub(super) struct Begun<'a> {
    pub region: Option<Region>,
    pub seeds: Asked<Cow<'a, [Detection]>>,
}

/// How far a pipeline came on the way to a grasp.
pub(super) enum GraspAnswer {
    NoTarget(NoTarget),
    NoCorner,
    NoFace(NoFace),
    NoGrasp(Face, NoGrasp),
    /// Another program failed.
    Failed(Face, Failure),
    Grasp(Face, Box<Grasp>),
}

impl Answers {
    /// Runs the pipeline; `given` are the seeds of one on the refinement track, `true_face` tells the face of their answers.
    pub fn of(
        pipeline: &Pipeline,
        exposure: &Exposure,
        rig: &Rig,
        range: &RangeImage,
        given: &[Detection],
        true_face: &TrueFaceOf,
    ) -> Self {
        let Self { region, corners, failure, .. } = Self::of_corners(pipeline, exposure, given);
        if failure.is_some() {
            let grasp = pipeline.grasp.as_ref().map(|_| GraspAnswer::NoCorner);
            return Self { region, corners, grasp, failure };
        }
        let faces = Faces { exposure, region: region.as_ref(), true_face: Some(true_face) };
        let grasp = grasp(pipeline, &faces, &corners, rig, range);
        let grasp = grasp.map(|reply| reply.answer);
        let failure = match &grasp {
            Some(GraspAnswer::Failed(_, failure)) => Some(failure.clone()),
            _ => None,
        };
        Self { region, corners, grasp, failure }
    }

    /// What was computed elsewhere.
    pub fn from_elsewhere(answers: Result<Vec<Corner>, Failure>) -> Self {
        let (corners, failure) = match answers {
            Ok(corners) => (corners, None),
            Err(failure) => (Vec::new(), Some(failure)),
        };
        Self { region: None, corners, grasp: None, failure }
    }

    /// Runs the pipeline as far as corners.
    pub fn of_corners(pipeline: &Pipeline, exposure: &Exposure, given: &[Detection]) -> Self {
        let Begun { region, seeds } = begin(pipeline, exposure, given);
        let (corners, failure) = match seeds {
            Err(failure) => (Vec::new(), Some(failure)),
            Ok(seeds) => match pipeline.refine.refine(exposure, &seeds.answer) {
                Ok(reply) => (reply.answer, None),
                Err(failure) => {
                    let left = |seed: &Detection| Corner::at_seed(*seed, 0, RefineStatus::Failed);
                    (seeds.answer.iter().map(left).collect(), Some(failure))
                }
            },
        };
        Self { region, corners, grasp: None, failure }
    }
}

/// Runs the first stages.
pub(super) fn begin<'a>(
    pipeline: &Pipeline,
    exposure: &Exposure,
    given: &'a [Detection],
) -> Begun<'a> {
    let Seeds::Detected { target, detect } = &pipeline.seeds else {
        return Begun { region: None, seeds: Ok(Reply::own(Cow::Borrowed(given))) };
    };
    let region = target.as_ref().map(|target| target.algorithm.extract(exposure));
    let found = match &region {
        None => detect.detect(exposure, None),
        Some(Ok(region)) => detect.detect(exposure, Some(region)),
        Some(Err(_)) => Ok(Reply::own(Vec::new())),
    };
    let owned = |Reply { answer, protocol_us }| Reply { answer: Cow::Owned(answer), protocol_us };
    Begun { region, seeds: found.map(owned) }
}

/// Tells which of the corners that were given make a face.
pub(super) type TrueFaceOf<'a> = dyn Fn(&[Corner]) -> Result<Face, NoFace> + 'a;

/// What faces are chosen by.
pub(super) struct Faces<'a> {
    pub exposure: &'a Exposure,
    /// Where the target was looked for.
    pub region: Option<&'a Region>,
    /// On the refinement track.
    pub true_face: Option<&'a TrueFaceOf<'a>>,
}

/// The last stages: from corners to a grasp; `None` of a pipeline that ends with corners.
pub(super) fn grasp(
    pipeline: &Pipeline,
    faces: &Faces,
    corners: &[Corner],
    rig: &Rig,
    range: &RangeImage,
) -> Option<Reply<GraspAnswer>> {
    let GraspStages { face, point } = pipeline.grasp.as_ref()?;
    let chosen = match (face, faces.region) {
        (None, _) => faces.true_face?(corners),
        (Some(_), None) => return None,
        (Some(_), Some(Err(reason))) => return Some(Reply::own(GraspAnswer::NoTarget(*reason))),
        (Some(_), Some(Ok(_))) if corners.is_empty() => {
            return Some(Reply::own(GraspAnswer::NoCorner));
        }
        (Some(face), Some(Ok(region))) => {
            face.algorithm.select(faces.exposure, region, corners, rig, range)
        }
    };
    Some(match chosen {
        Err(reason) => Reply::own(GraspAnswer::NoFace(reason)),
        Ok(face) => GraspAnswer::of(face, point, rig, range),
    })
}

impl GraspAnswer {
    fn of(
        face: Face,
        point: &AnyStage<dyn GraspEstimator>,
        rig: &Rig,
        range: &RangeImage,
    ) -> Reply<Self> {
        match point.estimate(&face, rig, range) {
            Err(failure) => Reply::own(Self::Failed(face, failure)),
            Ok(Reply { answer, protocol_us }) => {
                let answer = match answer {
                    Err(reason) => Self::NoGrasp(face, reason),
                    Ok(grasp) => Self::Grasp(face, Box::new(grasp)),
                };
                Reply { answer, protocol_us }
            }
        }
    }

    /// The face that was chosen.
    pub fn face(&self) -> Option<&Face> {
        match self {
            Self::NoGrasp(face, _) | Self::Grasp(face, _) | Self::Failed(face, _) => Some(face),
            _ => None,
        }
    }
}
