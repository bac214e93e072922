//! Numbers as people read them, and what they say.

use serde::Serialize;

use crate::record::MethodTime;
use crate::report::compare::{Comparison, Verdict};
use crate::report::contest::Contest;
use crate::report::detection::{Cause, DetectionSummary, Stratum};
use crate::report::refinement::{Estimate, RefinedStratum, RefinementSummary};
use crate::report::summary::{GraspSummary, MethodSummary, SceneSummary, Summary};

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
    methods.sort_by(|a, b| per_corner_px(a).total_cmp(&per_corner_px(b)));
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
        .chain(summary.timing.as_ref().map(|timing| {
            let time = timing.of(&method.camera, &method.method);
            three_digits(time.map(|time| 1e-3 * time.whole_us.median))
        }))
        .collect()
    });
    let last = ["mean AP"].into_iter().chain(summary.timing.as_ref().map(|_| "ms a photograph"));
    Words {
        header: header.into_iter().chain(of_gates).chain(last.map(str::to_owned)).collect(),
        rows: rows.collect(),
    }
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

/// Refiners beside each other, the least error where nothing is before the corner first; `None` where all methods
/// have the same.
pub fn refinement(summary: &Summary) -> Option<Words> {
    let first = summary.methods.first()?;
    if summary.methods.iter().all(|method| method.refiner == first.refiner) {
        return None;
    }
    let header = [
        "method",
        "answered",
        "rms error px (95 %)",
        "median",
        "within 0.1, 0.25, 0.5 px",
        "over bound (95 %)",
        "over bound, median",
        "bias along, across px",
        "failed",
        "NEES",
        "clear: rms error px (95 %)",
        "over bound",
        "declined",
    ];
    let rows = by_refined_error(summary).into_iter().map(|method| {
        let RefinementSummary { all, clear, statuses, .. } = &method.refinement;
        let declined: Vec<String> = statuses
            .iter()
            .filter(|(status, _)| !matches!(status.as_str(), "ok" | "max_iterations"))
            .map(|(status, count)| format!("{count} {}", status.replace('_', " ")))
            .collect();
        vec![
            method.label.clone(),
            format!("{} of {}", all.answered, all.asked),
            between(all.rmse_px, 3),
            of_estimate(all.median_px, 3),
            within(&all.within),
            between(all.rmse_over_bound, 1),
            between(all.median_over_bound, 1),
            format!(
                "{}, {}",
                of_estimate(all.bias_along_px, 3),
                of_estimate(all.bias_across_px, 3)
            ),
            percent(all.failed.map(|failed| failed.value)),
            of_estimate(all.nees, 1),
            between(clear.rmse_px, 3),
            of_estimate(clear.rmse_over_bound, 1),
            if declined.is_empty() { "-".to_owned() } else { declined.join(", ") },
        ]
        .into_iter()
        .chain(summary.timing.as_ref().map(|timing| {
            let time = timing.of(&method.camera, &method.method);
            three_digits(time.and_then(MethodTime::refine_us_per_corner))
        }))
        .collect()
    });
    let time = summary.timing.as_ref().map(|_| "us a corner");
    let header = header.into_iter().chain(time).map(str::to_owned);
    Some(Words { header: header.collect(), rows: rows.collect() })
}

/// "12, 40, 63 %".
fn within(shares: &[Option<Estimate>]) -> String {
    if shares.iter().all(Option::is_none) {
        return "-".to_owned();
    }
    let percent = |share: &Option<Estimate>| {
        share.map_or_else(|| "-".to_owned(), |share| format!("{:.0}", 100.0 * share.value))
    };
    format!("{} %", shares.iter().map(percent).collect::<Vec<_>>().join(", "))
}

/// Refiners by split, those from given seeds first, of these the one with most answers near on test, with the time that a corner takes where that is known: what one
/// shows to others. `None` where there is but one split, or one refiner.
pub fn results(summary: &Summary) -> Option<Words> {
    refinement(summary)?;
    let of_split = |method: &MethodSummary, name: &str| {
        method.refinement.splits.iter().find(|split| split.name == name).cloned()
    };
    let mut methods: Vec<(&MethodSummary, RefinedStratum, RefinedStratum)> = summary
        .methods
        .iter()
        .filter_map(|one| Some((one, of_split(one, "dev")?, of_split(one, "test")?)))
        .collect();
    if methods.is_empty() {
        return None;
    }
    let near = |stratum: &RefinedStratum| stratum.within[1].map_or(0.0, |share| share.value);
    methods.sort_by(|a, b| {
        let is_detected = a.0.detector.is_some().cmp(&b.0.detector.is_some());
        is_detected.then(near(&b.2).total_cmp(&near(&a.2)))
    });
    let header = [
        "method",
        "dev: within 0.1, 0.25, 0.5 px",
        "rms error px (95 %)",
        "test: within 0.1, 0.25, 0.5 px",
        "rms error px (95 %)",
        "over bound, median (95 %)",
        "answered",
        "failed",
    ];
    let time = summary.timing.as_ref().map(|_| "us a corner");
    let rows = methods.iter().map(|(method, dev, test)| {
        let time = summary.timing.as_ref().map(|timing| {
            let time = timing.of(&method.camera, &method.method);
            three_digits(time.and_then(MethodTime::refine_us_per_corner))
        });
        let cells = [
            method.label.clone(),
            within(&dev.within),
            between(dev.rmse_px, 3),
            within(&test.within),
            between(test.rmse_px, 3),
            between(test.median_over_bound, 1),
            format!("{} of {}", test.answered, test.asked),
            percent(test.failed.map(|failed| failed.value)),
        ];
        cells.into_iter().chain(time).collect()
    });
    Some(Words {
        header: header.into_iter().chain(time).map(str::to_owned).collect(),
        rows: rows.collect(),
    })
}

/// Refiners by family of scenes: error, in brackets over the bound; `None` where there is but one family, or one refiner.
pub fn families(summary: &Summary) -> Option<Words> {
    refinement(summary)?;
    let methods = by_refined_error(summary);
    let mut names: Vec<&str> = Vec::new();
    for family in methods.iter().flat_map(|method| &method.refinement.families) {
        if !names.contains(&family.name.as_str()) {
            names.push(&family.name);
        }
    }
    names.sort_unstable();
    if names.len() < 2 {
        return None;
    }
    let row = |method: &&MethodSummary| {
        let of_family = |name: &&str| {
            let family = method.refinement.families.iter().find(|family| family.name == *name);
            family.map_or_else(
                || "-".to_owned(),
                |family| {
                    let error_px = of_estimate(family.rmse_px, 3);
                    match family.rmse_over_bound {
                        Some(ratio) => format!("{error_px} ({:.1})", ratio.value),
                        None => error_px,
                    }
                },
            )
        };
        std::iter::once(method.label.clone()).chain(names.iter().map(of_family)).collect()
    };
    let header = std::iter::once("method").chain(names.iter().copied()).map(str::to_owned);
    Some(Words { header: header.collect(), rows: methods.iter().map(row).collect() })
}

/// What must be said of refiners beside their numbers.
pub fn shifts(summary: &Summary) -> Vec<String> {
    let of_method = |method: &MethodSummary| {
        method.refinement.shift.map(|words| format!("{}: {words}", method.label))
    };
    summary.methods.iter().filter_map(of_method).collect()
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

/// A comparison of methods that were given the same, in words.
#[derive(Clone, Debug, Serialize)]
pub struct ContestWords {
    /// What they were given.
    pub given: String,
    /// The methods, the best first.
    pub table: Words,
    /// What can be said of them.
    pub sentences: Vec<String>,
}

/// Methods that were given the same, beside the best of them; nothing where all have one refiner.
pub fn contests(summary: &Summary) -> Vec<ContestWords> {
    if refinement(summary).is_none() {
        return Vec::new();
    }
    summary.contests.iter().map(of_contest).collect()
}

fn of_contest(contest: &Contest) -> ContestWords {
    let header = [
        "method",
        "rms error px (95 %)",
        "over bound (95 %)",
        "times the best's (95 %)",
        "p",
        "rank",
    ];
    let rows = contest.methods.iter().map(|method| {
        vec![
            method.method.clone(),
            between(method.common.rmse_px, 3),
            between(method.common.rmse_over_bound, 2),
            between(method.over_best, 2),
            method.p.map_or_else(|| "-".to_owned(), probability),
            method.mean_rank.map_or_else(|| "-".to_owned(), |rank| format!("{rank:.1}")),
        ]
    });
    let mut sentences = Vec::new();
    if let Some((p, difference)) = contest.p_of_ranks.zip(contest.critical_difference) {
        sentences.push(format!(
            "ranks differ with p = {}; mean ranks {difference:.1} apart tell two methods apart",
            probability(p)
        ));
    }
    let alike = contest.alike.iter().map(|group| group.join(", "));
    sentences.extend(alike.map(|group| format!("cannot be told apart by rank: {group}")));
    if !contest.left_out.is_empty() {
        let others = contest.left_out.join(", ");
        sentences.push(format!("left out, for they answered less than half: {others}"));
    }
    sentences.extend(contest.warning.clone());
    let seeds = match contest.seed_disc_px {
        Some(disc_px) => format!("seeds up to {disc_px} px off"),
        None => "corners that were detected".to_owned(),
    };
    ContestWords {
        given: format!(
            "{}, {seeds}: {} corners in {} scenes that all answered",
            contest.camera, contest.corners, contest.scenes
        ),
        table: Words { header: header.map(str::to_owned).to_vec(), rows: rows.collect() },
        sentences,
    }
}

/// Two runs beside each other, what became worse first.
pub fn compared(comparison: &Comparison) -> Words {
    let header = [
        "method",
        "camera",
        "corners",
        "error, times before (95 %)",
        "p",
        "failed, more (95 %)",
        "p",
        "verdict",
    ];
    let order = [Verdict::Worse, Verdict::Better, Verdict::NotToldApart, Verdict::Same];
    let methods = order.into_iter().flat_map(|verdict| {
        comparison.methods.iter().filter(move |method| method.verdict == verdict)
    });
    let share = |more: Option<Estimate>| {
        let of_hundred = more.map(|more| more.map(|share| 100.0 * share));
        of_hundred.map_or_else(|| "-".to_owned(), |_| format!("{} %", between(of_hundred, 1)))
    };
    let chance = |p: Option<f64>| p.map_or_else(|| "-".to_owned(), probability);
    let rows = methods.map(|method| {
        vec![
            method.method.clone(),
            method.camera.clone(),
            method.corners.to_string(),
            between(method.error_ratio, 3),
            chance(method.p_of_error),
            share(method.failed_more),
            chance(method.p_of_failed),
            method.verdict.words().to_owned(),
        ]
    });
    Words { header: header.map(str::to_owned).to_vec(), rows: rows.collect() }
}

/// A probability, no smaller than what it is known to.
pub(super) fn probability(p: f64) -> String {
    if p < 0.001 { "< 0.001".to_owned() } else { format!("{p:.3}") }
}

/// The methods, the least error of refined corners that are clear of occluders first.
pub(super) fn by_refined_error(summary: &Summary) -> Vec<&MethodSummary> {
    let mut methods: Vec<&MethodSummary> = summary.methods.iter().collect();
    let rmse_px = |method: &MethodSummary| {
        method.refinement.clear.rmse_px.map_or(f64::INFINITY, |estimate| estimate.value)
    };
    methods.sort_by(|a, b| rmse_px(a).total_cmp(&rmse_px(b)));
    methods
}

/// The methods that detect, the best average precision first.
pub(super) fn by_average_precision(summary: &Summary) -> Vec<&MethodSummary> {
    let mut methods: Vec<&MethodSummary> =
        summary.methods.iter().filter(|method| method.detector.is_some()).collect();
    let score = |method: &MethodSummary| method.detection.sweeps[0].average_precision;
    methods.sort_by(|a, b| score(b).total_cmp(&score(a)));
    methods
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
