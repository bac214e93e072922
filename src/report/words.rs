//! Numbers as people read them, and what they say.

use crate::report::summary::{MethodSummary, SceneSummary};

/// A length in pixels; "-" of nothing.
pub fn px(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"))
}

/// A length in millimetres; "-" of nothing.
pub fn mm(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.1}"))
}

/// A share as a percentage; "-" of nothing.
pub fn percent(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{:.0} %", 100.0 * value))
}

/// What became of the choice of a face.
pub fn face(scene: &SceneSummary) -> &'static str {
    match (scene.grasp_status.as_str(), scene.face_is_right) {
        (_, Some(true)) => "right",
        (_, Some(false)) => "wrong",
        ("no_target", _) => "no target",
        ("no_corner", _) => "no corner",
        _ => "none whole",
    }
}

/// What the numbers say, in sentences; every number in them stands in the summary.
pub fn findings(method: &MethodSummary) -> Vec<String> {
    let corners = &method.corners;
    let grasps = &method.grasps;
    let mut sentences = Vec::new();
    if let (Some(before), Some(after)) = (corners.detected, corners.refined_errors) {
        sentences.push(format!(
            "of {} visible corners {} were found; refinement moved {} of them closer to the truth \
             and {} not: median error {} px before, {} px after, root mean square {} and {} px",
            corners.visible,
            corners.found,
            corners.improved,
            corners.found - corners.improved,
            px(Some(before.median_px)),
            px(Some(after.median_px)),
            px(Some(before.rmse_px)),
            px(Some(after.rmse_px)),
        ));
    }
    sentences.push(format!(
        "{} of {} answers were no corner of the target",
        corners.false_corners,
        corners.false_corners + corners.found + corners.ignored,
    ));
    sentences.push(if grasps.answered == 0 {
        format!("no grasp point was computed in {} scenes", grasps.asked)
    } else {
        format!(
            "a grasp point was computed in {} of {} scenes, the least occluded face was chosen in {}; \
             median error {} mm: {} along the optical axis, {} across it",
            grasps.answered,
            grasps.asked,
            grasps.face_right,
            mm(grasps.median_error_mm),
            mm(grasps.median_axial_error_mm),
            mm(grasps.median_lateral_error_mm),
        )
    });
    sentences
}

/// What the numbers say of the paper's conclusion ("the corner coordinates obtained through
/// sub-pixel level detection are more accurate and can reflect the exact position of the object").
pub fn verdict(method: &MethodSummary) -> String {
    let corners = &method.corners;
    let (Some(before), Some(after)) = (corners.detected, corners.refined_errors) else {
        return "No visible corner was found, so these scenes say nothing about the paper's \
                conclusion."
            .to_owned();
    };
    let share = 100.0 * f64::from(u32::try_from(corners.improved).unwrap_or(0))
        / f64::from(u32::try_from(corners.found).unwrap_or(1));
    let direction = if after.median_px < before.median_px { "holds" } else { "does not hold" };
    format!(
        "The paper concludes that the refined coordinates are more accurate and reflect the exact \
         position. With truth: \"more accurate\" {direction} in the median ({} px after refinement, {} \
         px before) and for {share:.0} % of the found corners. \"Exact\" does not: after refinement \
         the root mean square error is {} px and the largest {} px.",
        px(Some(after.median_px)),
        px(Some(before.median_px)),
        px(Some(after.rmse_px)),
        px(Some(after.max_px)),
    )
}
