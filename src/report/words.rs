//! Numbers as people read them, and what they say.

mod contests;
mod refiners;

use std::cmp::Ordering;

use serde::Serialize;

use crate::record::{MethodTime, Spread};
use crate::report::detection::{Cause, DetectionSummary, Stratum};
use crate::report::grasps::{GOOD, GraspSummary};
use crate::report::refinement::Estimate;
use crate::report::summary::{MethodSummary, SceneSummary, Summary};

pub use contests::{ContestWords, compared, contests};
pub(in crate::report) use refiners::by_refined_error;
pub use refiners::{families, refinement, results, shifts};

/// A length in pixels; "-" of nothing.
pub fn px(value: Option<f64>) -> String {
    two_digits(value)
}

/// A number with two digits behind the point; "-" of nothing.
pub fn two_digits(value: Option<f64>) -> String {
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
        "{} of {} answers were no corner of the target{}",
        corners.false_corners,
        corners.false_corners + corners.found + corners.ignored,
        where_they_lie(&method.detection.causes),
    ));
    sentences.extend(method.grasps.as_ref().map(of_grasps));
    sentences
}

/// ": 40 at its edges, 12 at T junctions, ..."; nothing of nothing.
fn where_they_lie(causes: &[Cause]) -> String {
    let parts: Vec<String> = causes
        .iter()
        .filter(|cause| cause.answers > 0)
        .map(|cause| format!("{} {}", cause.answers, place(&cause.cause)))
        .collect();
    if parts.is_empty() { String::new() } else { format!(": {}", parts.join(", ")) }
}

/// Where an answer lies, from its record's cause.
pub fn place(cause: &str) -> String {
    match cause {
        "duplicate" => "at corners that have another answer".to_owned(),
        "T" => "at T junctions".to_owned(),
        "shadow" => "at corners of the shadow".to_owned(),
        "texture" => "at corners of texture".to_owned(),
        "distractor" => "at corners of a distractor".to_owned(),
        "room" => "at corners of the room".to_owned(),
        "edge" => "at edges of the target".to_owned(),
        "target" => "elsewhere on the target".to_owned(),
        "object" => "on other objects".to_owned(),
        "background" => "on floor and walls".to_owned(),
        "hidden corner" => "at hidden corners".to_owned(),
        "small corner" => "at corners too little is seen of".to_owned(),
        "uncertain corner" => "at corners that noise hides".to_owned(),
        other => other.to_owned(),
    }
}

fn of_grasps(grasps: &GraspSummary) -> String {
    if grasps.answered == 0 {
        return format!("no grasp point was computed in {} scenes", grasps.asked);
    }
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
}

/// The grasps of all methods beside each other; None of fewer than two methods that grasp.
pub fn grasps(summary: &Summary) -> Option<Words> {
    let mut methods: Vec<(&MethodSummary, &GraspSummary)> = summary
        .methods
        .iter()
        .filter_map(|method| Some((method, method.grasps.as_ref()?)))
        .collect();
    if methods.len() < 2 {
        return None;
    }
    let good = |grasps: &GraspSummary| {
        let share = |place: usize| grasps.good[place].map_or(-1.0, |share| share.value);
        [share(2), share(3)]
    };
    methods.sort_by(|a, b| {
        let [of_a, of_b] = [good(a.1), good(b.1)];
        whole_first(a.0, b.0)
            .then(of_b[0].total_cmp(&of_a[0]))
            .then(of_b[1].total_cmp(&of_a[1]))
            .then(b.1.answered.cmp(&a.1.answered))
    });
    let header = [
        "method",
        "answered",
        "right face",
        "error mm (95 %)",
        "in face, normal",
        "approach deg (95 %)",
        "jaws deg",
    ];
    let of_good = GOOD.map(|[mm, deg]| format!("{mm} mm, {deg}\u{b0}"));
    let last = ["NEES", "vertices mm", "px", "none"];
    let header =
        header.map(str::to_owned).into_iter().chain(of_good).chain(last.map(str::to_owned));
    let rows = methods.into_iter().map(|(method, grasps)| {
        let share = |share: Option<Estimate>| percent(share.map(|share| share.value));
        let reasons: Vec<String> =
            grasps.reasons.iter().map(|(reason, count)| format!("{count} {reason}")).collect();
        let first = [
            method.label.clone(),
            format!("{} of {}", grasps.answered, grasps.asked),
            percent(Some(grasps.face_right as f64 / grasps.asked as f64)),
            between(grasps.error_mm, 2),
            format!(
                "{}, {}",
                two_digits(grasps.median_in_face_error_mm),
                two_digits(grasps.median_normal_error_mm)
            ),
            between(grasps.approach_error_deg, 2),
            two_digits(grasps.median_jaw_error_deg),
        ];
        let last = [
            two_digits(grasps.median_nees),
            two_digits(grasps.median_mssd_mm),
            two_digits(grasps.median_mspd_px),
            if reasons.is_empty() { "-".to_owned() } else { reasons.join(", ") },
        ];
        first.into_iter().chain(grasps.good.map(share)).chain(last).collect()
    });
    Some(Words { header: header.collect(), rows: rows.collect() })
}

/// What its columns are.
pub const GRASPS: &str = "Medians of the grasps that were computed, against the chosen face's centre, normal and shorter side; shares are of \
     all that were asked for, as near and turned as little as that; NEES: squared error over the method's own covariance, \
     2.37 in the middle where that is right; vertices: the farthest of the cuboid's, least over its symmetries; none: why";

/// A table as people read it.
#[derive(Clone, Debug, Serialize)]
pub struct Words {
    /// Its columns.
    pub header: Vec<String>,
    /// Its rows.
    pub rows: Vec<Vec<String>>,
}

/// Tables as one, of all their columns; a table that has not all leaves them empty.
pub fn joined(tables: Vec<Words>) -> Words {
    let mut header: Vec<String> = Vec::new();
    for name in tables.iter().flat_map(|table| &table.header) {
        if !header.contains(name) {
            header.push(name.clone());
        }
    }
    // What stands before the first column that all have comes first.
    let is_common = |name: &String| tables.iter().all(|table| table.header.contains(name));
    header.sort_by_key(is_common);
    let of_row = |table: &Words, row: &Vec<String>| -> Vec<String> {
        let at = |name: &String| table.header.iter().position(|own| own == name);
        header.iter().map(|name| at(name).map_or_else(String::new, |at| row[at].clone())).collect()
    };
    let rows = tables.iter().flat_map(|table| table.rows.iter().map(|row| of_row(table, row)));
    let rows = rows.collect();
    Words { header, rows }
}

/// Methods beside each other, the best average precision first.
pub fn comparison(summary: &Summary) -> Words {
    let header = [
        "method",
        "detector",
        "average precision",
        "precision",
        "recall",
        "threshold",
        "found at any",
        "median error px",
    ];
    let share =
        |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"));
    let rows = by_average_precision(summary).into_iter().map(|method| {
        let sweep = &method.detection.sweeps[0];
        vec![
            method.label.clone(),
            method.detector.clone().unwrap_or_default(),
            format!("{:.3}", sweep.average_precision),
            share(sweep.best.map(|best| best.precision)),
            share(sweep.best.map(|best| best.recall)),
            sweep.best.map_or_else(|| "-".to_owned(), |best| significant(best.threshold)),
            format!("{} of {}", method.corners.found, method.corners.visible),
            px(method.corners.detected.map(|errors| errors.median_px)),
        ]
    });
    Words { header: header.map(str::to_owned).to_vec(), rows: rows.collect() }
}

/// How far all answers of each method are from the corners, all in all, and how many are right within gates; the least
/// GOSPA first.
pub fn gospa(summary: &Summary) -> Words {
    let mut methods = by_average_precision(summary);
    let per_corner_px = |method: &MethodSummary| {
        method.detection.gospa.per_corner_px.map_or(f64::INFINITY, |estimate| estimate.value)
    };
    methods.sort_by(|a, b| whole_first(a, b).then(per_corner_px(a).total_cmp(&per_corner_px(b))));
    let gates = methods.first().map_or(&[][..], |first| &first.detection.gates);
    let header = ["method", "GOSPA px (95 %)", "off", "missed", "false", "at best threshold"];
    let header = header.map(str::to_owned);
    let of_gates = gates.iter().map(|gate| format!("AP {} px", gate.gate_px));
    let rows = methods.iter().map(|method| {
        let DetectionSummary { gospa, gospa_at_best, gates, mean_average_precision, .. } =
            &method.detection;
        let all_px2 = gospa.per_corner_px.map(|all| all.value * all.value);
        let share = |part: Option<Estimate>| {
            let all_px2 = all_px2.filter(|all_px2| *all_px2 > 0.0);
            percent(part.zip(all_px2).map(|(part, all_px2)| part.value / all_px2))
        };
        let precision = |value: f64| format!("{value:.3}");
        [
            method.label.clone(),
            between(gospa.per_corner_px, 3),
            share(gospa.localisation_px2),
            share(gospa.missed_px2),
            share(gospa.false_px2),
            of_estimate(gospa_at_best.per_corner_px, 3),
        ]
        .into_iter()
        .chain(gates.iter().map(|gate| precision(gate.average_precision)))
        .chain([mean_average_precision.map_or_else(|| "-".to_owned(), precision)])
        .chain(time_of(summary, method, |time| {
            let ms = |us: Spread| 1e-3 * us.median;
            let protocol_ms = time.protocol_us.map_or(0.0, |stages| stages.map(ms).iter().sum());
            Some([ms(time.whole_us), protocol_ms])
        }))
        .collect()
    });
    let last = ["mean AP"].into_iter().chain(summary.timing.as_ref().map(|_| "ms a photograph"));
    Words {
        header: header.into_iter().chain(of_gates).chain(last.map(str::to_owned)).collect(),
        rows: rows.collect(),
    }
}

/// A time of a method, to three digits, where times were measured: its own, and what asking another program took beside
/// it: "1.23 + 0.120".
fn time_of(
    summary: &Summary,
    method: &MethodSummary,
    of: impl Fn(&MethodTime) -> Option<[f64; 2]>,
) -> Option<String> {
    let timing = summary.timing.as_ref()?;
    let time = timing.of(&method.camera, &method.method);
    Some(match time.and_then(|time| Some((time, of(time)?))) {
        Some((_, [own, protocol])) if protocol > 0.0 => {
            format!("{} + {}", three_digits(Some(own)), three_digits(Some(protocol)))
        }
        one => three_digits(one.map(|(_, [own, _])| own)),
    })
}

/// A number to three digits; "-" of nothing.
pub fn three_digits(value: Option<f64>) -> String {
    let Some(value) = value else { return "-".to_owned() };
    match value.abs() {
        size if size >= 99.95 => format!("{value:.0}"),
        size if size >= 9.995 => format!("{value:.1}"),
        size if size >= 0.9995 => format!("{value:.2}"),
        _ => format!("{value:.3}"),
    }
}

/// A number without its interval; "-" of nothing.
fn of_estimate(estimate: Option<Estimate>, digits: usize) -> String {
    estimate.map_or_else(|| "-".to_owned(), |estimate| format!("{:.digits$}", estimate.value))
}

/// A number with its interval: "0.312 (0.280 to 0.344)"; "-" of nothing.
pub fn between(estimate: Option<Estimate>, digits: usize) -> String {
    let Some(Estimate { value, low, high }) = estimate else { return "-".to_owned() };
    match low.zip(high) {
        Some((low, high)) => format!("{value:.digits$} ({low:.digits$} to {high:.digits$})"),
        None => format!("{value:.digits$}"),
    }
}

/// A probability, no smaller than what it is known to.
pub(super) fn probability(p: f64) -> String {
    if p < 0.001 { "< 0.001".to_owned() } else { format!("{p:.3}") }
}

/// The methods that detect, the best average precision first.
pub(super) fn by_average_precision(summary: &Summary) -> Vec<&MethodSummary> {
    let mut methods: Vec<&MethodSummary> =
        summary.methods.iter().filter(|method| method.detector.is_some()).collect();
    let score = |method: &MethodSummary| method.detection.sweeps[0].average_precision;
    methods.sort_by(|a, b| whole_first(a, b).then(score(b).total_cmp(&score(a))));
    methods
}

/// Methods with unanswered photographs come last: their figures are of others.
fn whole_first(a: &MethodSummary, b: &MethodSummary) -> Ordering {
    (a.unanswered > 0).cmp(&(b.unanswered > 0))
}

/// A number to two significant digits.
fn significant(value: f64) -> String {
    if value >= 0.1 { format!("{value:.2}") } else { format!("{value:.1e}") }
}

/// Recall by what corners look like, a table for each property: how many are found at each method's
/// best threshold.
pub fn strata(summary: &Summary) -> Vec<(&'static str, Words)> {
    let Some(first) = summary.methods.first() else { return Vec::new() };
    let tables = first.detection.recall_by.iter().enumerate().map(|(index, strata)| {
        let name = |stratum: &Stratum| format!("{} ({})", stratum.name, stratum.asked);
        let header = std::iter::once("method".to_owned()).chain(strata.strata.iter().map(name));
        let row = |method: &MethodSummary| {
            let found = method.detection.recall_by[index].strata.iter();
            let found = found.map(|one| share_of(one.found_at_best, one.asked));
            std::iter::once(method.label.clone()).chain(found).collect()
        };
        let rows = by_average_precision(summary).into_iter().map(row).collect();
        (strata.by, Words { header: header.collect(), rows })
    });
    tables.collect()
}

fn share_of(count: usize, all: usize) -> String {
    let number = |value: usize| f64::from(u32::try_from(value).unwrap_or(u32::MAX));
    percent((all > 0).then(|| number(count) / number(all)))
}

/// What answers are that are no corner, at each method's best threshold; of false junctions, how many
/// of them have an answer.
pub fn causes(summary: &Summary) -> Words {
    let methods = by_average_precision(summary);
    let mut names: Vec<&str> = Vec::new();
    for cause in methods.iter().flat_map(|method| &method.detection.causes) {
        if !names.contains(&cause.cause.as_str()) {
            names.push(&cause.cause);
        }
    }
    let header = std::iter::once("method".to_owned()).chain(names.iter().map(|name| place(name)));
    let cell = |method: &MethodSummary, name: &str| {
        let cause = method.detection.causes.iter().find(|cause| cause.cause == name);
        cause.map_or_else(
            || "0".to_owned(),
            |cause| match cause.junctions {
                0 => cause.answers_at_best.to_string(),
                all => format!(
                    "{} ({} of {all} have one)",
                    cause.answers_at_best, cause.answered_at_best
                ),
            },
        )
    };
    let row = |method: &MethodSummary| {
        let cells = names.iter().map(|name| cell(method, name));
        std::iter::once(method.label.clone()).chain(cells).collect()
    };
    let rows = methods.iter().map(|method| row(method)).collect();
    Words { header: header.collect(), rows }
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
