//! What pipelines answer: they see an exposure, a rig and a range image; no truth.

use std::borrow::Cow;

use crate::detect::Detection;
use crate::grasp::{Face, Grasp, NoFace, NoGrasp};
use crate::plan::{GraspStages, Pipeline, Seeds};
use crate::refine::Corner;
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
        let (region, seeds) = seeds(pipeline, exposure, given);
        let corners = pipeline.refine.algorithm.refine(exposure, &seeds);
        let grasp = grasp(pipeline, exposure, region.as_ref(), &corners, rig, range);
        Self { region, corners, grasp }
    }
}

/// The first stages: the target's region, where one is looked for, and the candidates, found or given.
pub(super) fn seeds<'a>(
    pipeline: &Pipeline,
    exposure: &Exposure,
    given: &'a [Detection],
) -> (Option<Region>, Cow<'a, [Detection]>) {
    let Seeds::Detected { target, detect } = &pipeline.seeds else {
        return (None, Cow::Borrowed(given));
    };
    let region = target.as_ref().map(|target| target.algorithm.extract(exposure));
    let detect = |region| detect.algorithm.detect(exposure, region);
    let found = match &region {
        None => detect(None),
        Some(Ok(region)) => detect(Some(region)),
        Some(Err(_)) => Vec::new(),
    };
    (region, Cow::Owned(found))
}

/// The last stages: from corners to a grasp; `None` of a pipeline that ends with corners.
pub(super) fn grasp(
    pipeline: &Pipeline,
    exposure: &Exposure,
    region: Option<&Region>,
    corners: &[Corner],
    rig: &Rig,
    range: &RangeImage,
) -> Option<GraspAnswer> {
    match (&pipeline.grasp, region) {
        (Some(_), Some(Err(reason))) => Some(GraspAnswer::NoTarget(*reason)),
        (Some(stages), Some(Ok(region))) => {
            Some(GraspAnswer::of(stages, exposure, region, corners, rig, range))
        }
        _ => None,
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
