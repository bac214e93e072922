//! Summary -> a table for a terminal.

use comfy_table::{Cell, CellAlignment, ContentArrangement, LineStyle, Table, TableStyle, presets};

use crate::report::drawn::{DrawnSummary, words as drawn};
use crate::report::grasps::GraspSummary;
use crate::report::summary::{MethodSummary, Summary};
use crate::report::words::{self, Words};
use crate::report::{Content, Notes, Report, agreement};

/// The summary as text; its tables fit the terminal, where standard output is one.
pub fn tables(report: &Report) -> String {
    let mut text = match &report.content {
        Content::Rendered(summary, notes) => {
            of_rendered(summary, notes, !report.run.programs.is_empty())
        }
        Content::Drawn(summary) => of_drawn(summary),
    };
    text.extend(report.run.failures.iter().map(|failure| format!("! {}\n", failure.words())));
    text
}

fn of_drawn(summary: &DrawnSummary) -> String {
    let mut text = String::new();
    for cells in drawn::cells(summary) {
        text.push_str(&format!("{}\n", table_of(&cells)));
    }
    text.push_str(&format!("{}\n", drawn::CELLS));
    if let Some(locks) = drawn::locks(summary) {
        text.push_str(&format!("{}\n{}\n", table_of(&locks), drawn::LOCKS));
    }
    text.push_str(&format!("{}\n", table_of(&drawn::methods(summary))));
    text
}

fn of_rendered(summary: &Summary, notes: &Notes, has_programs: bool) -> String {
    let mut text = String::new();
    text.extend(notes.unknown.iter().map(|sentence| format!("{sentence}\n")));
    for agreement in &summary.agreements {
        let (given, [methods, pairs]) = agreement::words(agreement);
        text.push_str(&format!("\n{given}\n{}\n", table_of(&methods)));
        if !pairs.rows.is_empty() {
            text.push_str(&format!("{}\n{}\n", table_of(&pairs), agreement::PREDICTED));
        }
    }
    let of_detectors = words::comparison(summary);
    let is_grasp_alone = summary.methods.len() == 1 && summary.methods[0].grasps.is_some();
    if !of_detectors.rows.is_empty() && !is_grasp_alone {
        text.push_str(&table_of(&of_detectors).to_string());
        text.push_str(
            "\nprecision and recall are those of the best threshold on the response, as a share of an \
             image's strongest\n",
        );
        text.push_str(&table_of(&words::gospa(summary)).to_string());
        text.push_str(
            "\nGOSPA: root mean square over the corners asked for, (95 %) over scenes; off, missed, false: what its \
             square is made of (a corner missed and a false answer count 4.5 px^2 each); no answer at all is 2.12 px; \
             AP: average precision where right is only what is so near\n",
        );
    }
    if let Some(refinement) = words::refinement(summary) {
        text.push_str(&table_of(&refinement).to_string());
        text.push_str(
            "\nof the corners given, errors of the answers; (95 %): over scenes; within: of all that were given; bound: \
             Cram\u{e9}r-Rao, from the pixels within 10 px, of corners that these bound to 0.5 px; along: into the \
             corner's angle; failed: declined or more than 1 px off; NEES: squared error \
             over the refiner's own covariance, 2 is right; clear: nothing before the corner within 20 px\n",
        );
        if has_programs {
            text.push_str(
                "times of other programs are by their own clock, + what asking them took\n",
            );
        }
    }
    text.extend(notes.shifts(summary).iter().map(|shift| format!("! {shift}\n")));
    for contest in words::contests(summary) {
        text.push_str(&format!("\n{}\n{}\n", contest.given, table_of(&contest.table)));
        for sentence in contest.sentences {
            text.push_str(&format!("- {sentence}\n"));
        }
    }
    let grasps = words::grasps(summary);
    if let Some(grasps) = &grasps {
        text.push_str(&format!("\n{}\n{}\n", table_of(grasps), words::GRASPS));
    }
    // Of one method its scenes; of several the page has these.
    let of_scenes = summary.methods.iter().filter(|_| grasps.is_none());
    for (method, grasps) in of_scenes.filter_map(|m| Some((m, m.grasps.as_ref()?))) {
        text.push_str(&format!(
            "{}: {}, then {}\n",
            method.label,
            method.detector.as_deref().unwrap_or("seeds about the truth"),
            method.refiner
        ));
        text.push_str(&scene_table(method, grasps).to_string());
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

/// Lines above and below, and below the header.
const RULES: TableStyle = presets::UTF8_HORIZONTAL_ONLY.row_separator(LineStyle::none());

/// A table; numbers, all that starts with a digit or a dash, stand to the right.
pub(crate) fn table_of(words: &Words) -> Table {
    let mut table = Table::new();
    table.load_style(RULES).set_content_arrangement(ContentArrangement::Dynamic);
    table.set_header(&words.header);
    for row in &words.rows {
        table.add_row(row.iter().map(|text| {
            let is_number = text.starts_with(|c: char| c.is_ascii_digit() || c == '-');
            Cell::new(text).set_alignment(if is_number {
                CellAlignment::Right
            } else {
                CellAlignment::Left
            })
        }));
    }
    table
}

fn scene_table(method: &MethodSummary, grasps: &GraspSummary) -> Table {
    let header = [
        "scene",
        "target seen",
        "corners found",
        "false",
        "detected error px",
        "refined error px",
        "face",
        "grasp error mm",
    ];
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
        format!("{} of {} right", grasps.face_right, grasps.asked),
        words::mm(grasps.median_error_mm),
    ];
    table_of(&Words {
        header: header.map(str::to_owned).to_vec(),
        rows: rows.chain([all]).map(Vec::from).collect(),
    })
}
