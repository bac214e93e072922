//! Summary -> a table for a terminal.

use comfy_table::{Cell, CellAlignment, ContentArrangement, Table, presets};

use crate::report::summary::{MethodSummary, Summary};
use crate::report::words;

/// The summary as text; its tables fit the terminal, where standard output is one.
pub fn tables(summary: &Summary) -> String {
    let mut text = String::new();
    for method in &summary.methods {
        text.push_str(&format!(
            "{}: {}, then {}\n",
            method.method, method.detector, method.refiner
        ));
        text.push_str(&scene_table(method).to_string());
        text.push('\n');
        for sentence in words::findings(method) {
            text.push_str(&format!("- {sentence}\n"));
        }
    }
    for scene in &summary.unreadable {
        text.push_str(&format!("skipped {}: {}\n", scene.scene, scene.reason));
    }
    text
}

fn scene_table(method: &MethodSummary) -> Table {
    let mut table = Table::new();
    table
        .load_style(presets::UTF8_HORIZONTAL_ONLY)
        .set_content_arrangement(ContentArrangement::Dynamic);
    table.set_header([
        "scene",
        "target seen",
        "corners found",
        "false",
        "detected error px",
        "refined error px",
        "face",
        "grasp error mm",
    ]);
    let rows = method.scenes.iter().map(|scene| {
        [
            scene.scene.clone(),
            words::percent(scene.target_visible_fraction),
            format!("{} of {}", scene.corners.found, scene.corners.visible),
            scene.corners.false_corners.to_string(),
            words::px(scene.corners.detected.map(|errors| errors.median_px)),
            words::px(scene.corners.refined_errors.map(|errors| errors.median_px)),
            words::face(scene).to_owned(),
            words::mm(scene.grasp_error_mm),
        ]
    });
    let corners = &method.corners;
    let all = [
        "all".to_owned(),
        String::new(),
        format!("{} of {}", corners.found, corners.visible),
        corners.false_corners.to_string(),
        words::px(corners.detected.map(|errors| errors.median_px)),
        words::px(corners.refined_errors.map(|errors| errors.median_px)),
        format!("{} of {} right", method.grasps.face_right, method.grasps.asked),
        words::mm(method.grasps.median_error_mm),
    ];
    for row in rows.chain([all]) {
        table.add_row(row.iter().enumerate().map(|(column, text)| {
            let numeric = !matches!(column, 0 | 6);
            Cell::new(text).set_alignment(if numeric {
                CellAlignment::Right
            } else {
                CellAlignment::Left
            })
        }));
    }
    table
}
