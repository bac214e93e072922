//! Methods that were given the same, in words.

use serde::Serialize;

use super::refiners::refinement;
use super::{Words, between, probability};
use crate::report::compare::{Comparison, Verdict};
use crate::report::contest::Contest;
use crate::report::refinement::Estimate;
use crate::report::summary::Summary;

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
            match method.unanswered_more {
                more @ 1.. => format!("{}, {more} more unanswered", method.verdict.words()),
                _ => method.verdict.words().to_owned(),
            },
        ]
    });
    Words { header: header.map(str::to_owned).to_vec(), rows: rows.collect() }
}
