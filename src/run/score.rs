//! From a pipeline's answers and the truth to records.

use nalgebra::Point3;

use super::answers::{Answers, GraspAnswer, Region};
use crate::bound::CornerBounds;
use crate::error::Error;
use crate::external::Failure;
use crate::geometry::ImagePoint;
use crate::grasp::{Grasp, NoGrasp};
use crate::metrics::{
    CornerRule, CornerScore, Fate, OtherScore, Seen, approach_error, covered_face, grasp_error,
    pose_error, score_corners, score_seeded,
};
use crate::plan::{Pipeline, Seeds, Stage};
use crate::record::{RECORD_VERSION, Record, Sketch, kind, status, track};
use crate::refine::Corner;
use crate::scene::{FalseJunction, Scene, TrueCorner, TrueFace, Truth, Visibility};
use crate::sensor::Rig;

/// What answers to one exposure are compared with.
pub(super) struct Scorer<'a> {
    pub seen: Seen<'a>,
    pub rig: &'a Rig,
    pub rule: CornerRule,
    /// Full scale per unit of radiance.
    pub gain: f64,
}

impl Scorer<'_> {
    /// The rows of one photograph and method: corners, other answers, false junctions, then the grasp.
    pub(super) fn records(
        &self,
        template: &Record,
        pipeline: &Pipeline,
        answers: &Answers,
    ) -> Vec<Record> {
        let truth = self.seen.truth;
        let template = &with_reason(template, answers.failure.as_ref());
        let scores = match pipeline.seeds {
            Seeds::Detected { .. } | Seeds::Elsewhere(_) => {
                score_corners(&self.seen, &answers.corners, self.rule)
            }
            Seeds::Disc { .. } => score_seeded(&self.seen, &answers.corners, self.rule),
        };
        let no_target = without_target(answers.region.as_ref());
        let mut records = Vec::new();
        for (corner, score) in truth.corners.iter().zip(&scores.corners) {
            let answer = score.answer.map(|index| &answers.corners[index]);
            let mut record = self.corner_record(template, corner, score, answer);
            if score.fate == Fate::Missed && record.reason.is_none() {
                record.reason.clone_from(&no_target);
            }
            records.push(record);
        }
        let others = scores.others.iter();
        records.extend(others.map(|o| other_record(template, o, &answers.corners[o.answer])));
        let junctions = truth.false_junctions.iter().zip(&scores.false_junctions);
        records.extend(junctions.map(|(j, response)| junction_record(template, j, *response)));
        let grasp = answers.grasp.as_ref();
        let count = answers.corners.len();
        records.extend(grasp.map(|grasp| grasp_record(template, truth, grasp, count, self.rig)));
        records.extend(answers.failure.as_ref().map(|failure| failure_record(template, failure)));
        records
    }

    fn corner_record(
        &self,
        template: &Record,
        corner: &TrueCorner,
        score: &CornerScore,
        answer: Option<&Corner>,
    ) -> Record {
        let is_visible = corner.visibility == Visibility::Visible;
        let contrast = corner.second_contrast().map(|radiance| self.gain * radiance);
        let own = answer.and_then(|answer| {
            let [x, y] = corner.bisector(self.rule.least_edge_px)?;
            let (at, truth) = (answer.position, corner.image_point_px);
            let (dx, dy) = (at.x - truth.x, at.y - truth.y);
            Some([dx * x + dy * y, dy * x - dx * y])
        });
        let bounds =
            if is_visible { self.seen.bounds[corner.index] } else { CornerBounds::default() };
        Record {
            kind: kind::CORNER.to_owned(),
            status: match score.fate {
                Fate::Found => status::OK,
                Fate::Missed => status::MISSED,
                Fate::Hidden => status::HIDDEN,
                Fate::TooSmall => status::TOO_SMALL,
                Fate::TooUncertain => status::TOO_UNCERTAIN,
            }
            .to_owned(),
            corner_index: i32::try_from(corner.index).ok(),
            visibility: Some(visibility_name(corner.visibility).to_owned()),
            junction: corner.junction.map(|junction| junction.name().to_owned()),
            junction_angle_deg: corner
                .smallest_angle_deg(self.rule.least_edge_px)
                .filter(|_| is_visible),
            second_edge_px: is_visible.then(|| corner.second_edge_px()),
            contrast_fraction: contrast.filter(|_| is_visible),
            nearest_occluder_px: corner.nearest_occluder_px,
            bound_px: bounds.closed_px,
            bound_r5_px: bounds.local_px[0],
            bound_r10_px: bounds.local_px[1],
            bound_r15_px: bounds.local_px[2],
            bound_edges_px: bounds.edges_px,
            bound_object_px: bounds.object_px,
            render_noise_floor_px: corner.render_noise_floor_px,
            true_x_px: Some(corner.image_point_px.x),
            true_y_px: Some(corner.image_point_px.y),
            found_at_response: score.found_at_response,
            detected_error_px: score.detected_error_px,
            refined_error_px: score.refined_error_px,
            refined_along_px: own.map(|[along, _]| along),
            refined_across_px: own.map(|[_, across]| across),
            ..answer.map_or_else(|| template.clone(), |answer| with_answer(template, answer))
        }
    }
}

/// The columns that tell a pipeline from others.
pub(super) fn of_pipeline(pipeline: &Pipeline) -> Record {
    let (track, disc_px, detector) = match &pipeline.seeds {
        Seeds::Disc { radius_px } => (track::REFINEMENT, Some(*radius_px), None),
        Seeds::Detected { detect, .. } => (track::END_TO_END, None, Some(detect.label())),
        Seeds::Elsewhere(file) => {
            (track::END_TO_END, None, Some(format!("{} {}", file.name(), file.version())))
        }
    };
    Record {
        record_version: RECORD_VERSION,
        cornerbench_version: env!("CARGO_PKG_VERSION").to_owned(),
        method: pipeline.name.clone(),
        track: track.to_owned(),
        seed_disc_px: disc_px,
        target_extractor: pipeline.seeds.target().map(Stage::label),
        detector,
        refiner: pipeline.refine.label(),
        face_selector: pipeline
            .grasp
            .as_ref()
            .map(|grasp| grasp.face.as_ref().map_or("given".to_owned(), Stage::label)),
        grasp_estimator: pipeline.grasp.as_ref().map(|grasp| grasp.point.label()),
        ..Record::default()
    }
}

/// The same with the reason of a failure: all rows of a photograph to which a program gave no answer say why.
pub(super) fn with_reason(template: &Record, failure: Option<&Failure>) -> Record {
    Record { reason: failure.map(|failure| failure.reason.clone()), ..template.clone() }
}

/// The row of an exposure to which another program gave no answer.
pub(super) fn failure_record(template: &Record, failure: &Failure) -> Record {
    Record {
        kind: kind::FAILURE.to_owned(),
        status: failure.kind.name().to_owned(),
        reason: Some(failure.reason.clone()),
        ..template.clone()
    }
}

/// The columns of an answer.
pub(super) fn with_answer(template: &Record, answer: &Corner) -> Record {
    Record {
        detected_x_px: Some(answer.seed.point.x),
        detected_y_px: Some(answer.seed.point.y),
        response: Some(answer.seed.response),
        refined_x_px: Some(answer.position.x),
        refined_y_px: Some(answer.position.y),
        refine_status: Some(answer.status.name().to_owned()),
        covariance_xx_px2: answer.covariance_px2.map(|covariance| covariance[(0, 0)]),
        covariance_xy_px2: answer.covariance_px2.map(|covariance| covariance[(0, 1)]),
        covariance_yy_px2: answer.covariance_px2.map(|covariance| covariance[(1, 1)]),
        iterations: i32::try_from(answer.iterations).ok(),
        ..template.clone()
    }
}

/// The row of a corner that is asked for and whose place is known, with the answer that is its own, if any.
pub(super) fn known_corner(
    template: &Record,
    index: usize,
    truth: ImagePoint,
    answer: Option<&Corner>,
) -> Record {
    Record {
        kind: kind::CORNER.to_owned(),
        status: if answer.is_some() { status::OK } else { status::MISSED }.to_owned(),
        corner_index: i32::try_from(index).ok(),
        visibility: Some(visibility_name(Visibility::Visible).to_owned()),
        true_x_px: Some(truth.x),
        true_y_px: Some(truth.y),
        detected_error_px: answer.map(|answer| answer.seed.point.distance_px(truth)),
        refined_error_px: answer.map(|answer| answer.position.distance_px(truth)),
        ..answer.map_or_else(|| template.clone(), |answer| with_answer(template, answer))
    }
}

/// The row of an answer that is no corner's.
pub(super) fn false_corner(
    template: &Record,
    answer: &Corner,
    cause: &str,
    nearest_corner_px: Option<f64>,
) -> Record {
    Record {
        kind: kind::FALSE_CORNER.to_owned(),
        status: status::FALSE.to_owned(),
        cause: Some(cause.to_owned()),
        nearest_corner_px,
        ..with_answer(template, answer)
    }
}

/// The row of a scene of which something could not be read or photographed.
pub(super) fn unreadable(suite: &str, scene: &str, camera: &str, error: &Error) -> Record {
    Record {
        record_version: RECORD_VERSION,
        cornerbench_version: env!("CARGO_PKG_VERSION").to_owned(),
        suite: suite.to_owned(),
        scene: scene.to_owned(),
        camera: camera.to_owned(),
        kind: kind::SCENE.to_owned(),
        status: status::UNREADABLE.to_owned(),
        reason: Some(error.chain()),
        ..Record::default()
    }
}

/// Why corners are missed, where no target is found.
pub(super) fn without_target(region: Option<&Region>) -> Option<String> {
    match region {
        Some(Err(reason)) => Some(format!("no target: {}", reason.name())),
        _ => None,
    }
}

fn other_record(template: &Record, score: &OtherScore, answer: &Corner) -> Record {
    let OtherScore { place, nearest_corner_px, .. } = *score;
    let status = if place.is_ignored() { status::IGNORED } else { status::FALSE }.to_owned();
    Record { status, ..false_corner(template, answer, place.name(), nearest_corner_px) }
}

fn junction_record(template: &Record, junction: &FalseJunction, response: Option<f64>) -> Record {
    Record {
        kind: kind::FALSE_JUNCTION.to_owned(),
        status: if response.is_some() { status::ANSWERED } else { status::SILENT }.to_owned(),
        response,
        cause: Some(junction.cause.name().to_owned()),
        true_x_px: Some(junction.image_point_px.x),
        true_y_px: Some(junction.image_point_px.y),
        ..template.clone()
    }
}

fn visibility_name(visibility: Visibility) -> &'static str {
    match visibility {
        Visibility::Visible => "visible",
        Visibility::SelfOccluded => "self-occluded",
        Visibility::Occluded => "occluded",
        Visibility::Outside => "outside",
    }
}

fn grasp_record(
    template: &Record,
    truth: &Truth,
    answer: &GraspAnswer,
    answers: usize,
    rig: &Rig,
) -> Record {
    let (status, reason) = match answer {
        GraspAnswer::NoTarget(reason) => (status::NO_TARGET, Some(reason.name())),
        GraspAnswer::NoCorner => (status::NO_CORNER, None),
        GraspAnswer::NoFace(reason) => (status::NO_FACE, Some(reason.name())),
        GraspAnswer::NoGrasp(_, NoGrasp::NoRange) => {
            (status::NO_RANGE, Some(NoGrasp::NoRange.name()))
        }
        GraspAnswer::NoGrasp(_, reason) => (status::NO_GRASP, Some(reason.name())),
        GraspAnswer::Failed(..) => (status::FAILED, None),
        GraspAnswer::Grasp(..) => (status::OK, None),
    };
    let index = |face: &TrueFace| i32::try_from(face.index).ok();
    let best = truth.least_occluded_face();
    let mut record = Record {
        kind: kind::GRASP.to_owned(),
        status: status.to_owned(),
        reason: reason.map(str::to_owned).or_else(|| template.reason.clone()),
        answers: i32::try_from(answers).ok(),
        least_occluded_face: best.and_then(index),
        ..template.clone()
    };
    let Some(face) = answer.face() else { return record };
    let chosen = covered_face(truth, &face.corners);
    record.chosen_face = chosen.and_then(index);
    record.face_is_right = Some(chosen.is_some_and(|face| truth.is_least_occluded(face)));
    record.face_gap_fraction = Some(face.gap_fraction);
    let recognition = face.recognition;
    record.face_hypotheses = recognition.and_then(|found| i32::try_from(found.hypotheses).ok());
    record.face_margin = recognition.map(|found| found.margin);
    if let GraspAnswer::Grasp(_, grasp) = answer {
        of_grasp(&mut record, grasp, chosen.or(best), truth, rig);
    }
    record
}

/// What a record has of a grasp; `meant` is the face that it is scored against.
fn of_grasp(
    record: &mut Record,
    grasp: &Grasp,
    meant: Option<&TrueFace>,
    truth: &Truth,
    rig: &Rig,
) {
    record.grasp_x_px = Some(grasp.image_point.x);
    record.grasp_y_px = Some(grasp.image_point.y);
    record.grasp_world_x_m = Some(grasp.point_in_world.x);
    record.grasp_world_y_m = Some(grasp.point_in_world.y);
    record.grasp_world_z_m = Some(grasp.point_in_world.z);
    record.grasp_sigma_mm = grasp.covariance_m2.map(|covariance| 1e3 * covariance.trace().sqrt());
    if let Some(approach) = &grasp.approach {
        let [normal, jaw] = [approach.normal, approach.jaw]
            .map(|direction| rig.world_from_camera * direction.into_inner());
        (record.approach_world_x, record.jaw_world_x) = (Some(normal.x), Some(jaw.x));
        (record.approach_world_y, record.jaw_world_y) = (Some(normal.y), Some(jaw.y));
        (record.approach_world_z, record.jaw_world_z) = (Some(normal.z), Some(jaw.z));
        record.opening_m = Some(approach.opening_m);
        record.approach_sigma_deg = approach.normal_sigma_rad.map(f64::to_degrees);
    }
    let Some(meant) = meant else { return };
    let error = grasp_error(grasp, meant, &rig.world_from_camera);
    let centre_px = meant.centre_image_point_px;
    record.grasp_image_error_px = Some(grasp.image_point.distance_px(centre_px));
    record.grasp_error_mm = Some(error.distance_mm);
    record.grasp_axial_error_mm = Some(error.axial_mm);
    record.grasp_lateral_error_mm = Some(error.lateral_mm);
    record.grasp_normal_error_mm = Some(error.normal_mm);
    record.grasp_in_face_error_mm = Some(error.in_face_mm);
    record.grasp_nees = error.nees;
    if let Some(approach) = &grasp.approach {
        let error = approach_error(approach, meant, truth, &rig.world_from_camera);
        record.approach_error_deg = Some(error.normal_deg);
        record.jaw_error_deg = Some(error.jaw_deg);
        record.opening_error_mm = Some(error.opening_mm);
    }
    let camera_from_world = rig.world_from_camera.inverse();
    let vertices: Vec<Point3<f64>> = truth
        .corners
        .iter()
        .map(|corner| camera_from_world * Point3::from(corner.position_m))
        .collect();
    let error = grasp.pose.zip(<&[_; 8]>::try_from(&vertices[..]).ok());
    let error = error.and_then(|(pose, vertices)| pose_error(&pose, vertices, &rig.camera));
    record.pose_add_mm = error.map(|error| error.add_mm);
    record.pose_add_s_mm = error.map(|error| error.add_s_mm);
    record.pose_mssd_mm = error.map(|error| error.mssd_mm);
    record.pose_mspd_px = error.map(|error| error.mspd_px);
}

/// What a report draws of the scene and the answers, beside the records.
pub(super) fn sketch(
    scene: &Scene,
    truth: &Truth,
    answers: &Answers,
    depth_range_m: [f64; 2],
) -> Sketch {
    let region = answers.region.as_ref().and_then(|region| region.as_ref().ok());
    let face = answers.grasp.as_ref().and_then(GraspAnswer::face);
    let meant = face
        .and_then(|face| covered_face(truth, &face.corners))
        .or_else(|| truth.least_occluded_face());
    let whole = |value: usize| u32::try_from(value).unwrap_or(u32::MAX);
    Sketch {
        scene: scene.name.clone(),
        width: scene.description.camera.width,
        height: scene.description.camera.height,
        depth_range_m,
        true_edges: truth
            .edges
            .iter()
            .filter(|edge| edge.faces.iter().any(|face| truth.faces[*face].facing))
            .map(|edge| edge.corners.map(|index| truth.corners[index].image_point_px))
            .collect::<Vec<[ImagePoint; 2]>>(),
        true_face: truth.least_occluded_face().map(|face| truth.face_corners(face)),
        true_grasp: meant.map(|face| face.centre_image_point_px),
        quadrilateral: region.map(|region| region.quadrilateral),
        target_range: region.map(|region| {
            let range = region.range;
            [whole(range.x0), whole(range.y0), whole(range.x1 - 1), whole(range.y1 - 1)]
        }),
        target_pixels: whole(region.map_or(0, |region| region.pixels)),
        face: face.map(|face| face.corners),
        grasp: match &answers.grasp {
            Some(GraspAnswer::Grasp(_, grasp)) => Some(grasp.image_point),
            _ => None,
        },
    }
}
