//! Records -> what a refiner made of the corners that it was given, each number with its interval.
//!
//! What is drawn anew for an interval is a scene, with all its corners and photographs: those of one scene are off
//! together.

mod answer;

use std::collections::BTreeMap;

use serde::Serialize;

use crate::geometry::shift_words;
use crate::record::Record;
use crate::report::gospa::root_mean;
use crate::stats::{self, Bootstrap, Interval};

pub use answer::{Answer, answers};
pub(super) use answer::{Answers, Key, is_answered, is_given};

/// What a refiner made of the corners that it was given.
#[derive(Clone, Debug, Serialize)]
pub struct RefinementSummary {
    /// All of them.
    pub all: Refined,
    /// Those with nothing before them within [`CLEAR_PX`].
    pub clear: Refined,
    /// How many had each status.
    pub statuses: BTreeMap<String, usize>,
    /// Those of each split.
    pub splits: Vec<RefinedStratum>,
    /// Those of each family of scenes.
    pub families: Vec<RefinedStratum>,
    /// What all answers look shifted by, where it is what another origin of coordinates makes.
    pub shift: Option<&'static str>,
}

/// Corners that a refiner was given. Errors are of its answers; how many these are stands beside how many were asked
/// for.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Refined {
    /// How many.
    pub asked: usize,
    /// How many it answered, and did not decline.
    pub answered: usize,
    /// Scenes with answers.
    pub scenes: usize,
    /// Share of all that were declined, or are off by more than [`FAILED_PX`].
    pub failed: Option<Estimate>,
    /// Of all the shares that were answered within each of [`WITHIN_PX`].
    pub within: [Option<Estimate>; WITHIN_PX.len()],
    /// Root mean square \[px\].
    pub rmse_px: Option<Estimate>,
    /// Median \[px\].
    pub median_px: Option<Estimate>,
    /// 19 of 20 errors are at most so large \[px\].
    pub p95_px: Option<Estimate>,
    /// 99 of 100 errors are at most so large \[px\].
    pub p99_px: Option<Estimate>,
    /// Largest \[px\].
    pub max_px: Option<f64>,
    /// Mean error along the bisector of the corner's smallest angle, positive into the angle \[px\].
    pub bias_along_px: Option<Estimate>,
    /// Mean error across that \[px\].
    pub bias_across_px: Option<Estimate>,
    /// Median error along x and along y \[px\]: a few answers far off say nothing of where coordinates start.
    pub offset_px: [Option<Estimate>; 2],
    /// Root mean square error about the means in the corner's own frame, of both coordinates \[px\].
    pub spread_px: Option<Estimate>,
    /// Root mean square error over that of the bounds from the pixels within 10 px, of the corners that these bound to
    /// [`MOST_BOUND_PX`].
    pub rmse_over_bound: Option<Estimate>,
    /// Median error over the bound, of the same corners: 0.83 at the limit, where that is the same in all directions.
    pub median_over_bound: Option<Estimate>,
    /// Mean square of these bounds over that of the errors: 1 at the limit.
    pub efficiency: Option<Estimate>,
    /// Mean squared error over the refiner's own covariance: 2 where that is right.
    pub nees: Option<Estimate>,
    /// The median of the same: 1.39 where that is right and errors are normal.
    pub median_normed_square: Option<f64>,
}

/// A number, and the interval that holds the true one in 95 of 100 cases.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// The number itself.
    pub value: f64,
    /// The interval's ends; none where there is a single scene.
    pub low: Option<f64>,
    /// The interval's ends; none where there is a single scene.
    pub high: Option<f64>,
}

impl Estimate {
    /// With its interval, if there is one.
    pub fn of(value: f64, interval: Option<Interval>) -> Self {
        Self { value, low: interval.map(|i| i.low), high: interval.map(|i| i.high) }
    }

    /// The same in another unit; `map` increases.
    pub fn map(self, map: impl Fn(f64) -> f64) -> Self {
        Self { value: map(self.value), low: self.low.map(&map), high: self.high.map(&map) }
    }
}

/// A corner is clear of what is nearer to the camera by so much \[px\].
pub const CLEAR_PX: f64 = 20.0;

/// An answer is a failure that is off by more \[px\].
pub const FAILED_PX: f64 = 1.0;

/// How near an answer is wanted \[px\].
pub const WITHIN_PX: [f64; 3] = [0.1, 0.25, 0.5];

/// Beyond it a bound says nothing: where noise keeps a corner from being found at all, one near the seed is below it
/// \[px\].
pub const MOST_BOUND_PX: f64 = 0.5;

/// Summarises the records of one method.
pub fn summarise(records: &[&Record]) -> RefinementSummary {
    let found: Vec<&Record> = records.iter().copied().filter(|record| is_given(record)).collect();
    let answers = answers(&found);
    let is_clear = |record: &Record| record.nearest_occluder_px.is_none_or(|px| px > CLEAR_PX);
    let clear = found.iter().zip(&answers).filter(|(record, _)| is_clear(record));
    let mut statuses = BTreeMap::new();
    for answer in &answers {
        *statuses.entry(answer.refine_status.to_string()).or_insert(0) += 1;
    }
    let all = Refined::of(&answers);
    let shift = shift(&all);
    let strata = |name: fn(&Record) -> Option<&str>| {
        strata(
            found.iter().zip(&answers).filter_map(|(record, answer)| Some((name(record)?, answer))),
        )
    };
    RefinementSummary {
        all,
        clear: Refined::of(clear.map(|(_, answer)| answer)),
        statuses,
        splits: strata(|record| record.split.as_deref()),
        families: strata(|record| Some(&record.family)),
        shift,
    }
}

/// Corners of scenes that have something in common.
#[derive(Clone, Debug, Serialize)]
pub struct RefinedStratum {
    /// What it is.
    pub name: String,
    /// How many corners the refiner was given.
    pub asked: usize,
    /// How many it answered.
    pub answered: usize,
    /// Share of all that were declined, or are off by more than [`FAILED_PX`].
    pub failed: Option<Estimate>,
    /// Of all the shares that were answered within each of [`WITHIN_PX`].
    pub within: [Option<Estimate>; WITHIN_PX.len()],
    /// Root mean square error of the answers \[px\].
    pub rmse_px: Option<Estimate>,
    /// The same over that of the bounds from the pixels within 10 px, of the corners that these bound to
    /// [`MOST_BOUND_PX`].
    pub rmse_over_bound: Option<Estimate>,
    /// Median error over the bound, of the same corners: 0.83 at the limit, where that is the same in all directions.
    pub median_over_bound: Option<Estimate>,
}

/// Answers apart by name, sorted.
fn strata<'a>(answers: impl Iterator<Item = (&'a str, &'a Answer)>) -> Vec<RefinedStratum> {
    let mut apart: BTreeMap<&str, BTreeMap<&str, (Sums, Vec<f64>)>> = BTreeMap::new();
    for (name, answer) in answers {
        let scenes = apart.entry(name).or_default();
        let (sums, ratios) = scenes.entry(&answer.scene).or_insert(([0.0; SUMS], Vec::new()));
        sums.iter_mut().zip(sums_of(answer)).for_each(|(sum, more)| *sum += more);
        ratios.extend(answer.over_bound());
    }
    let stratum = |(name, scenes): (&str, BTreeMap<&str, (Sums, Vec<f64>)>)| {
        let (sums, ratios): (Vec<Sums>, Vec<Vec<f64>>) = scenes.into_values().unzip();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "counts")]
        let count = |sum: Sum| sums.iter().map(|sums| of(sums, sum)).sum::<f64>() as usize;
        RefinedStratum {
            name: name.to_owned(),
            asked: count(Sum::Asked),
            answered: count(Sum::Answered),
            failed: estimate(&sums, &|sums| ratio(sums, Sum::Failed, Sum::Asked)),
            within: within(&sums),
            rmse_px: rms(&sums, Sum::Square, Sum::Answered),
            rmse_over_bound: rms(&sums, Sum::SquareOfBounded, Sum::BoundSquare),
            median_over_bound: quantile(&ratios, 0.5),
        }
    };
    apart.into_iter().map(stratum).collect()
}

/// What another origin of coordinates shifts answers by, where these are so, to a tenth of a pixel, and surely.
fn shift(refined: &Refined) -> Option<&'static str> {
    const NEAR_PX: f64 = 0.1;
    let [Some(x), Some(y)] = refined.offset_px else { return None };
    let is_sure = |offset: Estimate| {
        offset.low.zip(offset.high).is_some_and(|(low, high)| high - low < 2.0 * NEAR_PX)
    };
    shift_words([x.value, y.value], [NEAR_PX; 2]).filter(|_| is_sure(x) && is_sure(y))
}

/// What one answer adds to a scene's sums, or a corner that has none.
#[derive(Clone, Copy)]
enum Sum {
    Asked,
    Failed,
    WithinA,
    WithinB,
    WithinC,
    Answered,
    Square,
    Framed,
    FramedSquare,
    Along,
    Across,
    Bounded,
    SquareOfBounded,
    BoundSquare,
    Normed,
    NormedSquare,
}

/// One for each of [`WITHIN_PX`].
const WITHIN: [Sum; WITHIN_PX.len()] = [Sum::WithinA, Sum::WithinB, Sum::WithinC];

const SUMS: usize = Sum::NormedSquare as usize + 1;

/// A scene's sums.
type Sums = [f64; SUMS];

fn of(sums: &Sums, sum: Sum) -> f64 {
    sums[sum as usize]
}

/// The ratio of two sums; nothing of nothing.
fn ratio(sums: &Sums, part: Sum, whole: Sum) -> Option<f64> {
    let whole = of(sums, whole);
    (whole > 0.0).then(|| of(sums, part) / whole)
}

fn sums_of(answer: &Answer) -> Sums {
    let mut sums = [0.0; SUMS];
    let mut add = |sum: Sum, value: f64| sums[sum as usize] += value;
    add(Sum::Asked, 1.0);
    add(Sum::Failed, f64::from(answer.is_failed()));
    let Some(error_px) = answer.error_px else { return sums };
    add(Sum::Answered, 1.0);
    for (sum, within_px) in WITHIN.into_iter().zip(WITHIN_PX) {
        add(sum, f64::from(error_px <= within_px));
    }
    add(Sum::Square, error_px * error_px);
    if let Some([along_px, across_px]) = answer.own_frame_px {
        add(Sum::Framed, 1.0);
        add(Sum::FramedSquare, error_px * error_px);
        add(Sum::Along, along_px);
        add(Sum::Across, across_px);
    }
    if let Some(bound_px) = answer.bound_px {
        add(Sum::Bounded, 1.0);
        add(Sum::SquareOfBounded, error_px * error_px);
        add(Sum::BoundSquare, bound_px * bound_px);
    }
    if let Some(normed) = answer.normed_square {
        add(Sum::Normed, 1.0);
        add(Sum::NormedSquare, normed);
    }
    sums
}

impl Refined {
    /// What a refiner's answers say.
    pub(super) fn of<'a>(answers: impl IntoIterator<Item = &'a Answer>) -> Self {
        let answers: Vec<&Answer> = answers.into_iter().collect();
        #[derive(Clone, Default)]
        struct Scene {
            sums: Sums,
            errors: Vec<f64>,
            ratios: Vec<f64>,
            off: [Vec<f64>; 2],
        }
        let mut scenes: BTreeMap<&str, Scene> = BTreeMap::new();
        for answer in &answers {
            let scene = scenes.entry(&answer.scene).or_default();
            scene.sums.iter_mut().zip(sums_of(answer)).for_each(|(sum, more)| *sum += more);
            scene.errors.extend(answer.error_px);
            scene.ratios.extend(answer.over_bound());
            if answer.error_px.is_some() {
                scene.off.iter_mut().zip(answer.off_px).for_each(|(all, px)| all.push(px));
            }
        }
        let with_answers = scenes.values().filter(|scene| of(&scene.sums, Sum::Answered) > 0.0);
        let sums: Vec<Sums> = scenes.values().map(|scene| scene.sums).collect();
        let errors: Vec<Vec<f64>> = scenes.values().map(|scene| scene.errors.clone()).collect();
        let ratios: Vec<Vec<f64>> = scenes.values().map(|scene| scene.ratios.clone()).collect();
        let of_sums = |statistic: &dyn Fn(&Sums) -> Option<f64>| estimate(&sums, statistic);
        let normed: Vec<f64> = answers.iter().filter_map(|answer| answer.normed_square).collect();
        let all = errors.iter().flatten().copied();
        Self {
            asked: answers.len(),
            answered: all.clone().count(),
            scenes: with_answers.count(),
            failed: of_sums(&|sums| ratio(sums, Sum::Failed, Sum::Asked)),
            within: within(&sums),
            rmse_px: rms(&sums, Sum::Square, Sum::Answered),
            median_px: quantile(&errors, 0.5),
            p95_px: quantile(&errors, 0.95),
            p99_px: quantile(&errors, 0.99),
            max_px: all.max_by(f64::total_cmp),
            bias_along_px: of_sums(&|sums| ratio(sums, Sum::Along, Sum::Framed)),
            bias_across_px: of_sums(&|sums| ratio(sums, Sum::Across, Sum::Framed)),
            offset_px: [0, 1].map(|axis| {
                let of_scenes = scenes.values().map(|scene| scene.off[axis].clone());
                quantile(&of_scenes.collect::<Vec<_>>(), 0.5)
            }),
            spread_px: of_sums(&|sums| {
                let along = ratio(sums, Sum::Along, Sum::Framed)?;
                let across = ratio(sums, Sum::Across, Sum::Framed)?;
                let square = ratio(sums, Sum::FramedSquare, Sum::Framed)?;
                Some((square - along * along - across * across).max(0.0).sqrt())
            }),
            rmse_over_bound: rms(&sums, Sum::SquareOfBounded, Sum::BoundSquare),
            median_over_bound: quantile(&ratios, 0.5),
            efficiency: of_sums(&|sums| log(ratio(sums, Sum::BoundSquare, Sum::SquareOfBounded)))
                .map(|estimate| estimate.map(f64::exp)),
            nees: of_sums(&|sums| ratio(sums, Sum::NormedSquare, Sum::Normed)),
            median_normed_square: stats::median(&normed),
        }
    }
}

/// The logarithm: on its scale squares are spread more evenly.
pub(super) fn log(value: Option<f64>) -> Option<f64> {
    value.filter(|value| *value > 0.0).map(f64::ln)
}

/// Of all the shares that were answered within each of [`WITHIN_PX`].
fn within(scenes: &[Sums]) -> [Option<Estimate>; WITHIN_PX.len()] {
    WITHIN.map(|sum| estimate(scenes, &|sums| ratio(sums, sum, Sum::Asked)))
}

/// A quantile of all scenes' numbers, with its interval.
pub(super) fn quantile(scenes: &[Vec<f64>], share: f64) -> Option<Estimate> {
    let all: Vec<f64> = scenes.iter().flatten().copied().collect();
    let interval = Bootstrap::named(&["quantile"]).of_quantile(scenes, share).ok();
    Some(Estimate::of(stats::quantile(&all, share)?, interval))
}

/// The root of the ratio of two sums over scenes; its interval is that of the logarithm.
fn rms(scenes: &[Sums], part: Sum, whole: Sum) -> Option<Estimate> {
    root_mean(scenes, &|sums| of(sums, part), &|sums| of(sums, whole))
}

/// A statistic of the sums over scenes, with its interval.
pub(super) fn estimate<const K: usize>(
    scenes: &[[f64; K]],
    statistic: &dyn Fn(&[f64; K]) -> Option<f64>,
) -> Option<Estimate> {
    let mut all = [0.0; K];
    for scene in scenes {
        all.iter_mut().zip(scene).for_each(|(sum, value)| *sum += value);
    }
    let value = statistic(&all)?;
    let interval = Bootstrap::named(&["sums"]).of_sums(scenes, statistic).ok();
    Some(Estimate::of(value, interval))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{kind, status};

    fn corner(scene: &str, error_px: f64, occluder_px: Option<f64>, refine_status: &str) -> Record {
        Record {
            scene: scene.into(),
            kind: kind::CORNER.into(),
            status: status::OK.into(),
            nearest_occluder_px: occluder_px,
            refine_status: Some(refine_status.into()),
            refined_error_px: Some(error_px),
            refined_along_px: Some(error_px),
            refined_across_px: Some(0.0),
            bound_r10_px: Some(0.1),
            true_x_px: Some(5.0),
            true_y_px: Some(5.0),
            refined_x_px: Some(5.0 + error_px),
            refined_y_px: Some(5.0),
            covariance_xx_px2: Some(0.04),
            covariance_xy_px2: Some(0.0),
            covariance_yy_px2: Some(0.09),
            ..Record::default()
        }
    }

    fn value(estimate: Option<Estimate>) -> f64 {
        estimate.expect("a number").value
    }

    #[test]
    fn errors_are_those_of_answers_and_clear_corners_are_told_apart() {
        let records = [
            corner("a", 0.3, None, "ok"),
            corner("a", 0.4, Some(3.0), "max_iterations"),
            corner("b", 9.0, Some(30.0), "diverged"),
        ];
        let records: Vec<&Record> = records.iter().collect();
        let RefinementSummary { all, clear, statuses, .. } = summarise(&records);
        assert_eq!((all.asked, all.answered, all.scenes), (3, 2, 1));
        assert_eq!((clear.asked, clear.answered), (2, 1));
        let near = |found: Option<Estimate>, wanted: f64| {
            assert!((value(found) - wanted).abs() < 1e-12, "{found:?}, not {wanted}");
        };
        near(all.rmse_px, 0.125_f64.sqrt());
        near(all.rmse_over_bound, 10.0 * 0.125_f64.sqrt());
        near(all.efficiency, 0.01 / 0.125);
        near(all.median_over_bound, 3.5);
        near(all.failed, 1.0 / 3.0);
        near(all.bias_along_px, 0.35);
        near(all.spread_px, 0.05);
        near(all.median_px, 0.35);
        near(all.within[1], 0.0);
        near(all.within[2], 2.0 / 3.0);
        // (0.09 + 0.16) / 0.04 / 2, as mean and as median of two.
        near(all.nees, 3.125);
        assert!((all.median_normed_square.expect("two") - 3.125).abs() < 1e-9);
        assert_eq!(statuses["diverged"], 1);
    }

    #[test]
    fn what_noise_hides_has_no_part_in_the_ratio_to_the_bound() {
        let clear = corner("a", 0.3, None, "ok");
        let hidden = Record { bound_r10_px: Some(130.0), ..corner("b", 0.5, None, "ok") };
        let all = summarise(&[&clear, &hidden]).all;
        assert!((value(all.rmse_over_bound) - 3.0).abs() < 1e-12, "{:?}", all.rmse_over_bound);
        assert!((value(all.efficiency) - 1.0 / 9.0).abs() < 1e-12);
        assert!((value(all.median_over_bound) - 3.0).abs() < 1e-12);
        assert!((value(all.rmse_px) - 0.17_f64.sqrt()).abs() < 1e-12, "its error counts");
    }

    #[test]
    fn splits_and_families_are_told_apart() {
        let of = |scene: &str, split: &str, family: &str, error_px: f64| Record {
            split: Some(split.into()),
            family: family.into(),
            ..corner(scene, error_px, None, "ok")
        };
        let records = [
            of("a", "dev", "bare", 0.1),
            of("b", "test", "bare", 0.3),
            of("b", "test", "bare", 0.3),
            of("c", "test", "wall", 2.0),
        ];
        let summary = summarise(&records.iter().collect::<Vec<_>>());
        let of = |strata: &[RefinedStratum]| -> Vec<(String, usize, f64)> {
            let row = |one: &RefinedStratum| (one.name.clone(), one.answered, value(one.rmse_px));
            strata.iter().map(row).collect()
        };
        let splits = of(&summary.splits);
        assert_eq!((splits[0].0.as_str(), splits[0].1), ("dev", 1));
        assert!((splits[0].2 - 0.1).abs() < 1e-9, "{splits:?}");
        let families = of(&summary.families);
        assert_eq!((families[0].0.as_str(), families[0].1), ("bare", 3));
        assert!((families[0].2 - (0.19_f64 / 3.0).sqrt()).abs() < 1e-9, "{families:?}");
        assert!((value(summary.families[1].failed) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn intervals_are_of_scenes_not_of_corners() {
        // Twenty scenes, each with fifty corners that are off alike.
        let rows: Vec<Record> = (0..20)
            .flat_map(|scene| {
                let error_px = 0.1 + 0.01 * f64::from(scene);
                (0..50).map(move |_| corner(&scene.to_string(), error_px, None, "ok"))
            })
            .collect();
        let all = summarise(&rows.iter().collect::<Vec<_>>()).all;
        let Estimate { value, low, high } = all.bias_along_px.expect("a mean");
        let (low, high) = (low.expect("an end"), high.expect("an end"));
        // The standard error of twenty evenly spread numbers, 0.0132, times Student's 2.09.
        assert!((value - 0.195).abs() < 1e-9);
        assert!((high - low - 2.0 * 2.09 * 0.0132).abs() < 0.006, "{low} {high}");
    }

    #[test]
    fn errors_of_nothing_at_all_are_zero_and_half_a_pixel_is_recognised() {
        let exact: Vec<Record> =
            (0..9).map(|scene| corner(&scene.to_string(), 0.0, None, "ok")).collect();
        let summary = summarise(&exact.iter().collect::<Vec<_>>());
        assert!(value(summary.all.rmse_px).abs() < 1e-12);
        assert_eq!(summary.shift, None);
        let shifted = |by_px: f64| -> Option<&str> {
            let rows: Vec<Record> = exact
                .iter()
                .enumerate()
                .map(|(index, record)| {
                    let noise_px = 0.02 * (index % 3) as f64;
                    let at = |truth: Option<f64>| truth.map(|truth| truth + by_px + noise_px);
                    Record {
                        refined_x_px: at(record.true_x_px),
                        refined_y_px: at(record.true_y_px),
                        ..record.clone()
                    }
                })
                .collect();
            summarise(&rows.iter().collect::<Vec<_>>()).shift
        };
        assert!(shifted(0.48).is_some_and(|words| words.contains("pixel's corner")));
        assert!(shifted(-1.02).is_some_and(|words| words.contains("(-1, -1)")));
        assert_eq!(shifted(0.25), None);
    }

    #[test]
    fn a_single_scene_has_no_interval() {
        let record = corner("a", 0.3, None, "ok");
        let all = summarise(&[&record, &record]).all;
        assert_eq!(all.rmse_px.map(|estimate| estimate.low), Some(None));
        assert_eq!(summarise(&[]).all.rmse_px, None);
    }
}
