//! A recommendation in words, in tables, and as a pipeline of a plan.

use toml::{Table, Value};

use super::{ALL, Candidate, Choice, Group};
use crate::error::{Error, Result};
use crate::record::track;
use crate::report::refinement::Estimate;
use crate::report::words::{Words, probability, three_digits};

/// What a time is of.
pub fn unit_words(track: &str) -> &'static str {
    if track == track::REFINEMENT { "corner" } else { "photograph" }
}

/// A time as people read it: "28.1 us", "3.20 ms".
pub(super) fn time_words(time_us: f64) -> String {
    match time_us {
        us if us < 1e3 => format!("{} us", three_digits(Some(us))),
        us if us < 1e6 => format!("{} ms", three_digits(Some(1e-3 * us))),
        us => format!("{} s", three_digits(Some(1e-6 * us))),
    }
}

/// What a group was given.
pub(super) fn given(group: &Group) -> String {
    let Group { camera, track, seed_disc_px, class } = group;
    let class = if class == ALL { String::new() } else { format!(", {class}") };
    format!("{}{class}", given_of(camera, track, *seed_disc_px))
}

fn given_of(camera: &str, track: &str, seed_disc_px: Option<f64>) -> String {
    match (track, seed_disc_px) {
        (track::REFINEMENT, Some(disc_px)) => {
            format!("{camera}, refiners alone, seeds up to {disc_px} px off")
        }
        (track::REFINEMENT, None) => format!("{camera}, refiners alone"),
        _ => format!("{camera}, end to end"),
    }
}

impl Choice {
    /// What its methods were given: "webcam, end to end".
    pub fn given(&self) -> String {
        given_of(&self.camera, &self.track, self.seed_disc_px)
    }
}

/// The choice and what the test says of it, in sentences.
pub(super) fn sentence(choice: &Choice, budget_us: Option<f64>) -> String {
    let unit = unit_words(&choice.track);
    let of_name = |name: &str| choice.candidates.iter().find(|one| one.method == name);
    let Some(chosen) = choice.chosen.as_deref().and_then(of_name) else {
        let budget = budget_us.map_or_else(String::new, |us| format!(" {}", time_words(us)));
        let others = choice.candidates.iter().filter(|one| !one.is_control);
        let times = others.filter_map(|one| Some((one.time_us?, &one.method)));
        let fastest = times.min_by(|a, b| a.0.total_cmp(&b.0)).map_or_else(
            || "no time of any is known".to_owned(),
            |(us, name)| format!("the fastest is {name}, {}", time_words(us)),
        );
        return format!("no method keeps{budget} a {unit}; {fastest}");
    };
    let time =
        chosen.time_us.map_or_else(String::new, |us| format!("; {} a {unit}", time_words(us)));
    let keeps = if budget_us.is_some() { " that keeps the budget" } else { "" };
    let verdict = match choice.better_on_test.first().and_then(|name| of_name(name)) {
        None => format!("On test nothing{keeps} is surely better."),
        Some(other) => {
            let ratio = other.over_chosen.map_or(1.0, |ratio| ratio.value);
            format!(
                "On test {} is better by {:.0} % (p {}): the choice does not carry over, measure more scenes.",
                other.method,
                100.0 * (1.0 - ratio),
                probability(other.p.unwrap_or(1.0)),
            )
        }
    };
    let control = choice.candidates.iter().find(|one| one.is_control);
    let control = control.filter(|control| control.dev_px.value < chosen.dev_px.value);
    let control = control.map_or_else(String::new, |control| {
        let px = three_digits(Some(control.dev_px.value));
        format!(" Seeds left where they are: {px} px on dev: lost corners cost more than it gains.")
    });
    format!(
        "{}: {} px on dev, {} on test{time}. {verdict}{control}",
        chosen.method,
        three_digits(Some(chosen.dev_px.value)),
        interval(chosen.test_px),
    )
}

/// "0.085 px (0.071 to 0.102)".
fn interval(estimate: Estimate) -> String {
    let value = three_digits(Some(estimate.value));
    match estimate.low.zip(estimate.high) {
        Some((low, high)) => {
            format!("{value} px ({} to {})", three_digits(Some(low)), three_digits(Some(high)))
        }
        None => format!("{value} px"),
    }
}

/// Rows of a table of methods without times.
const MOST_ROWS: usize = 10;

/// The front, the fastest first, with the chosen method where it is not on it; where no time is known, the methods
/// nearest on dev. With what is left out, in words.
pub fn table(choice: &Choice) -> (Words, Option<String>) {
    let is_chosen = |one: &Candidate| choice.chosen.as_ref() == Some(&one.method);
    let has_front = choice.candidates.iter().any(|one| one.is_on_front);
    let mut shown: Vec<&Candidate> = if has_front {
        choice.candidates.iter().filter(|one| one.is_on_front || is_chosen(one)).collect()
    } else {
        choice.candidates.iter().take(MOST_ROWS).collect()
    };
    if has_front {
        shown.sort_by(|a, b| a.time_us.unwrap_or(0.0).total_cmp(&b.time_us.unwrap_or(0.0)));
    }
    let left_out = choice.candidates.len() - shown.len();
    let more = if left_out == 1 { "1 other".to_owned() } else { format!("{left_out} others") };
    let words = if has_front {
        format!(
            "{more} not shown: no faster and no nearer on dev than one of these, or without a time"
        )
    } else {
        format!("{more} not shown: farther off on dev")
    };
    let row = |one: &&Candidate| {
        let time = one.time_us.map_or_else(|| "-".to_owned(), time_words);
        [format!("{}{}", one.method, if is_chosen(one) { " *" } else { "" })]
            .into_iter()
            .chain(has_front.then_some(time))
            .chain([three_digits(Some(one.dev_px.value)), interval(one.test_px).replace(" px", "")])
            .collect()
    };
    let time = format!("time a {}", unit_words(&choice.track));
    let header = [
        Some("method"),
        has_front.then_some(time.as_str()),
        Some("dev px"),
        Some("test px (95 %)"),
    ];
    let header = header.into_iter().flatten().map(str::to_owned).collect();
    let table = Words { header, rows: shown.iter().map(row).collect() };
    (table, (left_out > 0).then_some(words))
}

/// A pipeline of run.json as a plan has it.
///
/// # Errors
/// When it holds what TOML has no word for.
pub(super) fn toml_of(pipeline: &serde_json::Value) -> Result<String> {
    let failed = |error: &dyn std::fmt::Display| {
        Error::Other(format!("run.json: pipeline {}: {error}", pipeline["name"]))
    };
    let mut table = Table::new();
    for (key, value) in pipeline.as_object().into_iter().flatten() {
        let value = match value.get("parameters") {
            Some(parameters) => {
                let mut stage = parameters.as_object().cloned().unwrap_or_default();
                stage.insert("algorithm".to_owned(), value["algorithm"].clone());
                serde_json::Value::Object(stage)
            }
            None => value.clone(),
        };
        if !value.is_null() {
            let value = Value::try_from(value).map_err(|error| failed(&error))?;
            table.insert(key.clone(), value);
        }
    }
    let plan = Table::from_iter([("pipelines".to_owned(), Value::Array(vec![table.into()]))]);
    toml::to_string(&plan).map_err(|error| failed(&error))
}
