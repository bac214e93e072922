//! From a pipeline's answers and the truth to records.

use super::Answers;
use crate::geometry::ImagePoint;
use crate::metrics::{CornerScore, Fate, covered_face, grasp_error, score_corners};
use crate::record::{Record, Sketch, kind, status};
use crate::refine::Corner;
use crate::scene::{Scene, TrueFace, Truth, Visibility};
use crate::sensor::Rig;

/// The rows of one scene and method: corners, false corners, then the grasp.
pub(super) fn records(
    template: &Record,
    truth: &Truth,
    answers: &Answers,
    rig: &Rig,
    gate_px: f64,
) -> Vec<Record> {
    let mut records: Vec<Record> = score_corners(truth, &answers.corners, gate_px)
        .iter()
        .map(|score| corner_record(template, truth, &answers.corners, score))
        .collect();
    records.push(grasp_record(template, truth, answers, rig));
    records
}

fn corner_record(
    template: &Record,
    truth: &Truth,
    answers: &[Corner],
    score: &CornerScore,
) -> Record {
    let corner = score.corner.map(|index| &truth.corners[index]);
    let answer = score.answer.map(|index| &answers[index]);
    let status = match score.fate {
        Fate::Found => status::OK,
        Fate::Missed => status::MISSED,
        Fate::Hidden => status::HIDDEN,
        Fate::False => status::FALSE,
        Fate::Ignored => status::IGNORED,
    };
    Record {
        kind: if corner.is_some() { kind::CORNER } else { kind::FALSE_CORNER }.to_owned(),
        status: status.to_owned(),
        corner_index: corner.and_then(|corner| i32::try_from(corner.index).ok()),
        visibility: corner.map(|corner| visibility_name(corner.visibility).to_owned()),
        junction: corner.and_then(|corner| corner.junction).map(|kind| kind.name().to_owned()),
        render_noise_floor_px: corner.and_then(|corner| corner.render_noise_floor_px),
        true_x_px: corner.map(|corner| corner.image_point_px.x),
        true_y_px: corner.map(|corner| corner.image_point_px.y),
        detected_x_px: answer.map(|answer| answer.seed.point.x),
        detected_y_px: answer.map(|answer| answer.seed.point.y),
        response: answer.map(|answer| answer.seed.response),
        refined_x_px: answer.map(|answer| answer.position.x),
        refined_y_px: answer.map(|answer| answer.position.y),
        refine_status: answer.map(|answer| answer.status.name().to_owned()),
        iterations: answer.and_then(|answer| i32::try_from(answer.iterations).ok()),
        detected_error_px: score.detected_error_px,
        refined_error_px: score.refined_error_px,
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

fn grasp_record(template: &Record, truth: &Truth, answers: &Answers, rig: &Rig) -> Record {
    let (status, reason) = match (&answers.region, &answers.face, &answers.grasp) {
        (Err(reason), _, _) => (status::NO_TARGET, Some(reason.name())),
        (Ok(_), None, _) => (status::NO_CORNER, None),
        (Ok(_), Some(Err(reason)), _) => (status::NO_FACE, Some(reason.name())),
        (Ok(_), Some(Ok(_)), Some(Err(reason))) => (status::NO_RANGE, Some(reason.name())),
        (Ok(_), Some(Ok(_)), _) => (status::OK, None),
    };
    let index = |face: &TrueFace| i32::try_from(face.index).ok();
    let best = truth.least_occluded_face();
    let mut record = Record {
        kind: kind::GRASP.to_owned(),
        status: status.to_owned(),
        reason: reason.map(str::to_owned),
        answers: i32::try_from(answers.corners.len()).ok(),
        least_occluded_face: best.and_then(index),
        ..template.clone()
    };
    let Some(Ok(face)) = &answers.face else { return record };
    let chosen = covered_face(truth, &face.corners);
    record.chosen_face = chosen.and_then(index);
    record.face_is_right = Some(chosen.is_some_and(|face| truth.is_least_occluded(face)));
    record.face_gap_fraction = Some(face.gap_fraction);
    let Some(Ok(grasp)) = &answers.grasp else { return record };
    record.grasp_x_px = Some(grasp.image_point.x);
    record.grasp_y_px = Some(grasp.image_point.y);
    record.grasp_world_x_m = Some(grasp.point_in_world.x);
    record.grasp_world_y_m = Some(grasp.point_in_world.y);
    record.grasp_world_z_m = Some(grasp.point_in_world.z);
    if let Some(meant) = chosen.or(best) {
        let error = grasp_error(&grasp.point_in_camera, meant, &rig.world_from_camera);
        record.grasp_image_error_px =
            Some(grasp.image_point.distance_px(meant.centre_image_point_px));
        record.grasp_error_mm = Some(error.distance_mm);
        record.grasp_axial_error_mm = Some(error.axial_mm);
        record.grasp_lateral_error_mm = Some(error.lateral_mm);
    }
    record
}

/// What a report draws of the scene and the answers, beside the records.
pub(super) fn sketch(
    scene: &Scene,
    truth: &Truth,
    answers: &Answers,
    depth_range_m: [f64; 2],
) -> Sketch {
    let region = answers.region.as_ref().ok();
    let face = answers.face.as_ref().and_then(|face| face.as_ref().ok());
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
        grasp: answers
            .grasp
            .as_ref()
            .and_then(|grasp| grasp.as_ref().ok())
            .map(|grasp| grasp.image_point),
    }
}
