//! What pipelines answer: they see an exposure, a rig and a range image; no truth.

use crate::detect::Detection;
use crate::grasp::{Face, Grasp, NoFace, NoGrasp};
use crate::plan::{GraspStages, Pipeline, Seeds};
use crate::refine::Corner;
use crate::sensor::{Exposure, RangeImage, Rig};
use crate::target::{NoTarget, TargetRegion};

/// What a pipeline answered to one exposure, stage by stage.
pub(super) struct Answers {
    /// `None` of a pipeline that searches the whole image.
    pub region: Option<Result<TargetRegion, NoTarget>>,
    pub corners: Vec<Corner>,
    /// `None` of a pipeline that ends with corners.
    pub grasp: Option<GraspAnswer>,
}

/// How far a pipeline came on the way to a grasp.
pub(super) enum GraspAnswer {
    NoTarget(NoTarget),
    NoCorner,
    NoFace(NoFace),
    NoRange(Face, NoGrasp),
    Grasp(Face, Grasp),
}

impl Answers {
    /// Runs the pipeline; `given` are the seeds of one on the refinement track.
    pub fn of(
        pipeline: &Pipeline,
        exposure: &Exposure,
        rig: &Rig,
        range: &RangeImage,
        given: &[Detection],
    ) -> Self {
        let refine = |seeds: &[Detection]| pipeline.refine.algorithm.refine(exposure, seeds);
        let Seeds::Detected { target, detect } = &pipeline.seeds else {
            return Self { region: None, corners: refine(given), grasp: None };
        };
        let region = target.as_ref().map(|target| target.algorithm.extract(exposure));
        let detect = |region| refine(&detect.algorithm.detect(exposure, region));
        let corners = match &region {
            None => detect(None),
            Some(Ok(region)) => detect(Some(region)),
            Some(Err(_)) => Vec::new(),
        };
        let grasp = match (&pipeline.grasp, &region) {
            (Some(_), Some(Err(reason))) => Some(GraspAnswer::NoTarget(*reason)),
            (Some(stages), Some(Ok(region))) => {
                Some(GraspAnswer::of(stages, exposure, region, &corners, rig, range))
            }
            _ => None,
        };
        Self { region, corners, grasp }
    }
}

impl GraspAnswer {
    fn of(
        stages: &GraspStages,
        exposure: &Exposure,
        region: &TargetRegion,
        corners: &[Corner],
        rig: &Rig,
        range: &RangeImage,
    ) -> Self {
        if corners.is_empty() {
            return Self::NoCorner;
        }
        match stages.face.algorithm.select(exposure, region, corners) {
            Err(reason) => Self::NoFace(reason),
            Ok(face) => match stages.point.algorithm.estimate(&face, rig, range) {
                Err(reason) => Self::NoRange(face, reason),
                Ok(grasp) => Self::Grasp(face, grasp),
            },
        }
    }

    /// The face that was chosen.
    pub fn face(&self) -> Option<&Face> {
        match self {
            Self::NoRange(face, _) | Self::Grasp(face, _) => Some(face),
            _ => None,
        }
    }
}
