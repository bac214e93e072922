//! The choice among methods: on scenes of dev, confirmed on those of test.

use super::gather::{Group, Methods, Scenes, Splits};
use super::{ALL, Candidate, Choice, front, words};
use crate::record::track;
use crate::report::contest::warning;
use crate::report::gospa::root_mean;
use crate::report::refinement::Estimate;
use crate::stats::{Bootstrap, holm, sign_flips};

/// What is not more than chance is not better.
const SIGNIFICANT: f64 = 0.05;

/// The choice among a group's methods, on the scenes that all of them have; none where there are no such scenes.
pub(super) fn choose(
    group: &Group,
    methods: &Methods,
    budget_us: Option<f64>,
    is_control: &dyn Fn(&str) -> bool,
    time_us: &dyn Fn(&str) -> Option<f64>,
) -> (Option<Choice>, Vec<String>) {
    let mut warnings = Vec::new();
    let (some, others): (Vec<_>, Vec<_>) =
        methods.iter().partition(|(_, splits)| !splits.dev.is_empty() && !splits.test.is_empty());
    if !others.is_empty() && group.class == ALL {
        let names: Vec<&str> = others.iter().map(|(name, _)| name.as_str()).collect();
        warnings.push(format!("left out, for not measured on both splits: {}", names.join(", ")));
    }
    let [dev, test] = [|splits: &Splits| splits.dev.clone(), |splits: &Splits| splits.test.clone()]
        .map(|of| shared(&some.iter().map(|(_, splits)| of(splits)).collect::<Vec<_>>()));
    let count = |scenes: &[Scenes]| scenes.first().map_or(0, Scenes::len);
    let keeps = |time_us: Option<f64>| {
        budget_us.is_none_or(|budget_us| time_us.is_some_and(|time_us| time_us <= budget_us))
    };
    let mut candidates: Vec<(Candidate, &Scenes)> = some
        .iter()
        .zip(dev.iter().zip(&test))
        .filter_map(|((name, _), (dev, test))| {
            let time_us = time_us(name);
            let candidate = Candidate {
                method: name.clone(),
                time_us,
                is_control: is_control(name),
                keeps_budget: keeps(time_us),
                is_on_front: false,
                dev_px: figure(dev)?,
                test_px: figure(test)?,
                over_chosen: None,
                p: None,
            };
            Some((candidate, test))
        })
        .collect();
    if candidates.is_empty() {
        if group.class == ALL {
            warnings.push(format!("{}: no corners on both splits", words::given(group)));
        }
        return (None, warnings);
    }
    candidates.sort_by(|(a, _), (b, _)| a.dev_px.value.total_cmp(&b.dev_px.value));
    front::mark(&mut candidates.iter_mut().map(|(candidate, _)| candidate).collect::<Vec<_>>());
    let chosen = candidates.iter().position(|(candidate, _)| candidate.can_be_chosen());
    if let Some(chosen) = chosen {
        confirm(&mut candidates, chosen, group);
        warnings.extend(mostly_false(&candidates[chosen], group));
    }
    let candidates: Vec<Candidate> = candidates.into_iter().map(|(one, _)| one).collect();
    let best_px = chosen.map_or(f64::INFINITY, |index| candidates[index].test_px.value);
    let is_better = |one: &&Candidate| {
        // Both the ratio over scenes and the figure itself: a few lost corners move one of them alone.
        one.p.is_some_and(|p| p <= SIGNIFICANT)
            && one.over_chosen.is_some_and(|ratio| ratio.value < 1.0)
            && one.test_px.value < best_px
    };
    let mut better: Vec<&Candidate> = candidates.iter().filter(is_better).collect();
    better.sort_by(|a, b| a.test_px.value.total_cmp(&b.test_px.value));
    let mut choice = Choice {
        camera: group.camera.clone(),
        track: group.track.clone(),
        seed_disc_px: group.seed_disc_px,
        class: group.class.clone(),
        dev_scenes: count(&dev),
        test_scenes: count(&test),
        chosen: chosen.map(|index| candidates[index].method.clone()),
        better_on_test: better.iter().map(|one| one.method.clone()).collect(),
        candidates,
        words: String::new(),
    };
    choice.words = words::sentence(&choice, budget_us);
    if group.class == ALL {
        for (split, scenes) in [("dev", choice.dev_scenes), ("test", choice.test_scenes)] {
            warnings.extend(warning(scenes).map(|words| format!("{split}: {words}")));
        }
    }
    (Some(choice), warnings)
}

impl Candidate {
    fn can_be_chosen(&self) -> bool {
        self.keeps_budget && !self.is_control
    }
}

/// Of each the scenes that all have.
fn shared(all: &[Scenes]) -> Vec<Scenes> {
    let mut shared = all.to_vec();
    for scenes in &mut shared {
        scenes.retain(|scene, _| all.iter().all(|other| other.contains_key(scene)));
    }
    shared
}

/// Root mean square error per corner asked for \[px\], with its interval over scenes.
fn figure(scenes: &Scenes) -> Option<Estimate> {
    let sums: Vec<[f64; 3]> = scenes.values().copied().collect();
    root_mean(&sums, &|sums| sums[0], &|sums| sums[1])
}

/// Says where false answers hide what methods differ by.
fn mostly_false((chosen, test): &(Candidate, &Scenes), group: &Group) -> Option<String> {
    let sum = |of: usize| test.values().map(|sums| sums[of]).sum::<f64>();
    let share = sum(2) / sum(0);
    let is_worth_saying = group.class == ALL && group.track == track::END_TO_END && share > 0.5;
    is_worth_saying.then(|| {
        format!(
            "{}: {:.0} % of the squared error of {} are false answers; with a higher threshold its detector would \
             gain more than by any refiner",
            words::given(group),
            100.0 * share,
            chosen.method
        )
    })
}

/// Compares all that keep the budget with the chosen one, scene by scene on test.
fn confirm(candidates: &mut [(Candidate, &Scenes)], chosen: usize, group: &Group) {
    // An error of exactly 0 has no logarithm; none is known to less.
    const LEAST_PX2: f64 = 1e-12;
    // A scene without corners has no error per corner.
    let logs = |scenes: &Scenes| -> Vec<f64> {
        let with_corners = scenes.values().filter(|sums| sums[1] > 0.0);
        with_corners.map(|sums| 0.5 * (sums[0] / sums[1]).max(LEAST_PX2).ln()).collect()
    };
    let of_chosen = logs(candidates[chosen].1);
    let mut compared = Vec::new();
    for (index, (candidate, scenes)) in candidates.iter_mut().enumerate() {
        if index == chosen || !candidate.can_be_chosen() {
            continue;
        }
        let differences: Vec<f64> =
            logs(scenes).iter().zip(&of_chosen).map(|(own, chosen)| own - chosen).collect();
        let name = ["recommend", group.camera.as_str(), candidate.method.as_str()];
        let Some(flips) = sign_flips(&differences, &name) else { continue };
        let rows: Vec<[f64; 2]> = differences.iter().map(|one| [*one, 1.0]).collect();
        let mean = |[sum, count]: &[f64; 2]| (*count > 0.0).then(|| sum / count);
        let interval = Bootstrap::named(&name).of_sums(&rows, mean).ok();
        candidate.over_chosen = Some(Estimate::of(flips.mean, interval).map(f64::exp));
        candidate.p = Some(flips.p);
        compared.push(index);
    }
    let p_values: Vec<f64> = compared.iter().filter_map(|index| candidates[*index].0.p).collect();
    for (index, p) in compared.into_iter().zip(holm(&p_values)) {
        candidates[index].0.p = Some(p);
    }
}
