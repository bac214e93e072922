//! Refiners: what their answers are worth, beside each other.

use super::{Words, between, of_estimate, percent, time_of, whole_first};
use crate::record::MethodTime;
use crate::report::refinement::{Estimate, RefinedStratum, RefinementSummary};
use crate::report::summary::{MethodSummary, Summary};

/// The refiner's time per corner, and what asking another program took beside it \[us\].
fn a_corner(time: &MethodTime) -> Option<[f64; 2]> {
    let protocol_us = time.protocol_us.map_or(0.0, |[_, refine, _]| refine.median);
    Some([time.refine_us_per_corner()?, protocol_us / time.corners])
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
        .chain(time_of(summary, method, a_corner))
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
        whole_first(a.0, b.0).then(is_detected).then(near(&b.2).total_cmp(&near(&a.2)))
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
        let time = time_of(summary, method, a_corner);
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

/// The methods, the least error of refined corners that are clear of occluders first.
pub(in crate::report) fn by_refined_error(summary: &Summary) -> Vec<&MethodSummary> {
    let mut methods: Vec<&MethodSummary> = summary.methods.iter().collect();
    let rmse_px = |method: &MethodSummary| {
        method.refinement.clear.rmse_px.map_or(f64::INFINITY, |estimate| estimate.value)
    };
    methods.sort_by(|a, b| whole_first(a, b).then(rmse_px(a).total_cmp(&rmse_px(b))));
    methods
}
