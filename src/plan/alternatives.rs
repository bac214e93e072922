//! Alternatives: where a pipeline gives several values, each combination is a pipeline of its own.

use std::sync::Arc;

use toml::{Table, Value};

use crate::detect::DETECTORS;
use crate::error::{Error, Result};
use crate::external::Program;
use crate::grasp::{ESTIMATORS, SELECTORS};
use crate::refine::REFINERS;
use crate::target::EXTRACTORS;

/// No table stands for more pipelines.
const MOST: usize = 10_000;

/// The stages, in the order in which they run, and the names of the algorithms of each.
fn stages() -> [(&'static str, Vec<&'static str>); 6] {
    [
        ("seeds", Vec::new()),
        ("target", EXTRACTORS.iter().map(|entry| entry.name).collect()),
        ("detect", DETECTORS.iter().map(|entry| entry.name).collect()),
        ("refine", REFINERS.iter().map(|entry| entry.name).collect()),
        ("face", SELECTORS.iter().map(|entry| entry.name).collect()),
        ("grasp", ESTIMATORS.iter().map(|entry| entry.name).collect()),
    ]
}

/// A table with one value of each, and what tells it from the others.
#[derive(Clone, Debug, Default)]
struct Alternative {
    labels: Vec<String>,
    table: Table,
    /// The programs that joined.
    joined: Vec<String>,
    /// Whether a label says more than who joined.
    is_labelled: bool,
}

/// The table of one pipeline.
#[derive(Debug)]
pub(super) struct OfOne {
    pub table: Table,
    /// The programs that joined, as its name where no other pipeline has the same ones.
    pub joined: Option<String>,
}

/// All pipelines that a pipeline's table stands for, each with a name of its own: the table's, then what was
/// chosen, in the order of the stages; where there is neither, its algorithms. A stage is a table, or an
/// algorithm's name alone, or a list of these; a value of a stage's table may be a list; the algorithm "all" is
/// every one. A program is one more of every stage that does what it does.
///
/// # Errors
/// When it stands for more than ten thousand.
pub(super) fn pipelines(
    place: &str,
    table: &Table,
    programs: &[Arc<Program>],
) -> Result<Vec<OfOne>> {
    let mut found = vec![Alternative { table: table.clone(), ..Alternative::default() }];
    for (stage, names) in stages() {
        let Some(value) = table.get(stage) else { continue };
        let mut choices = of_stage(value, &names);
        choices.extend(joining(stage, &choices, programs));
        if found.len() * choices.len() > MOST {
            return Err(Error::Other(format!(
                "{place}: stands for more than {MOST} pipelines; give {stage} fewer values, or \
                 divide it into several plans"
            )));
        }
        let with = |before: &Alternative, choice: &Choice| {
            let mut next = before.clone();
            next.labels.extend(choice.labels.iter().cloned());
            next.table.insert(stage.to_owned(), choice.value.clone());
            if choice.has_joined {
                next.joined.extend(choice.labels.iter().cloned());
            }
            next.is_labelled |= !choice.has_joined && !choice.labels.is_empty();
            next
        };
        found = found
            .iter()
            .flat_map(|before| choices.iter().map(move |choice| with(before, choice)))
            .collect();
    }
    let named = |Alternative { labels, mut table, joined, is_labelled }: Alternative| {
        let own = table.get("name").and_then(Value::as_str).filter(|name| !name.is_empty());
        let is_nameless = own.is_none() && !is_labelled;
        let mut words: Vec<String> = own.map(str::to_owned).into_iter().chain(labels).collect();
        if is_nameless {
            words = stages().iter().filter_map(|(stage, _)| algorithm(&table, stage)).collect();
        }
        if !words.is_empty() {
            table.insert("name".to_owned(), words.join("-").into());
        }
        OfOne { table, joined: (!joined.is_empty()).then(|| joined.join("-")) }
    };
    Ok(found.into_iter().map(named).collect())
}

/// The programs that do what a stage does and are not yet in it. Where the plan wants nothing done they do nothing.
fn joining(stage: &str, choices: &[Choice], programs: &[Arc<Program>]) -> Vec<Choice> {
    let named = |choice: &Choice| Some(choice.value.get("algorithm")?.as_str()?.to_owned());
    let there: Vec<String> = choices.iter().filter_map(named).collect();
    if there.iter().all(|name| name == "none") {
        return Vec::new();
    }
    let joins = |program: &&Arc<Program>| {
        let mut does = program.does().iter().map(|task| task.name());
        does.any(|task| task == stage) && !there.iter().any(|name| name == program.name())
    };
    let choice = |program: &Arc<Program>| Choice {
        labels: vec![program.name().to_owned()],
        value: Value::Table(Table::from_iter([("algorithm".to_owned(), program.name().into())])),
        has_joined: true,
    };
    programs.iter().filter(joins).map(choice).collect()
}

/// The algorithm of a stage.
fn algorithm(table: &Table, stage: &str) -> Option<String> {
    table.get(stage)?.get("algorithm")?.as_str().map(str::to_owned)
}

/// A value of a stage, and what tells it from the others.
#[derive(Clone, Debug)]
struct Choice {
    labels: Vec<String>,
    value: Value,
    /// Whether it is a program that joined.
    has_joined: bool,
}

fn of_stage(value: &Value, names: &[&str]) -> Vec<Choice> {
    match value {
        Value::String(name) => {
            let table = Table::from_iter([("algorithm".to_owned(), name.clone().into())]);
            of_table(&table, names)
        }
        Value::Table(table) => of_table(table, names),
        Value::Array(values) => {
            let each = |value: &Value| {
                let mut choices = of_stage(value, names);
                for choice in &mut choices {
                    let algorithm = choice.value.get("algorithm").and_then(Value::as_str);
                    if let Some(name) = algorithm.filter(|name| !is_first(&choice.labels, name)) {
                        choice.labels.insert(0, name.to_owned());
                    }
                }
                choices
            };
            values.iter().flat_map(each).collect()
        }
        other => vec![Choice { labels: Vec::new(), value: other.clone(), has_joined: false }],
    }
}

fn is_first(labels: &[String], name: &str) -> bool {
    labels.first().is_some_and(|label| label == name)
}

/// Each value of one key of a table with each of the others, and the words that tell them apart; `first` is the key
/// that comes first and whose value needs no name.
///
/// # Errors
/// When these are more than ten thousand.
pub(super) fn values(place: &str, table: &Table, first: &str) -> Result<Vec<(Vec<String>, Table)>> {
    let counts = table.values().map(|value| value.as_array().map_or(1, Vec::len));
    if counts.fold(1, usize::saturating_mul) > MOST {
        return Err(Error::Other(format!(
            "{place}: stands for more than {MOST} combinations; give fewer values, or divide it \
             into several plans"
        )));
    }
    Ok(combinations(table, first, &[])
        .into_iter()
        .map(|Alternative { labels, table, .. }| (labels, table))
        .collect())
}

/// Each value of one key with each of the others.
fn of_table(table: &Table, names: &[&str]) -> Vec<Choice> {
    combinations(table, "algorithm", names)
        .into_iter()
        .map(|Alternative { labels, table, .. }| Choice {
            labels,
            value: Value::Table(table),
            has_joined: false,
        })
        .collect()
}

/// The key `lead` first; its value "all" is each of `names`.
fn combinations(table: &Table, lead: &str, names: &[&str]) -> Vec<Alternative> {
    let mut found = vec![Alternative::default()];
    let first = table.get_key_value(lead);
    let others = table.iter().filter(|(key, _)| *key != lead);
    for (key, value) in first.into_iter().chain(others) {
        let every: Vec<Value> = names.iter().map(|name| Value::from(*name)).collect();
        let (values, is_choice) = match value {
            Value::Array(values) => (values.clone(), true),
            Value::String(all) if key == lead && all == "all" => (every, true),
            one => (vec![one.clone()], false),
        };
        let with = |before: &Alternative, value: &Value| {
            let mut next = before.clone();
            if is_choice {
                let shown = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
                let is_name = key == lead;
                next.labels.push(if is_name { shown } else { format!("{key}={shown}") });
            }
            next.table.insert(key.clone(), value.clone());
            next
        };
        found = found
            .iter()
            .flat_map(|before| values.iter().map(move |value| with(before, value)))
            .collect();
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(text: &str) -> Vec<String> {
        let table: Table = text.parse().expect("TOML");
        let name = |one: &OfOne| one.table["name"].as_str().expect("a name").to_owned();
        pipelines("plan", &table, &[]).expect("few").iter().map(name).collect()
    }

    #[test]
    fn a_table_without_lists_is_one_pipeline_of_its_own_name() {
        assert_eq!(names("name = 'a'\ndetect.algorithm = 'harris'"), ["a"]);
    }

    #[test]
    fn every_value_of_a_list_goes_with_every_other() {
        let text = "name = 'a'\nseeds.disc_px = [0.5, 1]\nrefine = ['foerstner', { algorithm = \
                    'corner_sub_pix', half_window_px = [3, 5] }]";
        assert_eq!(
            names(text),
            [
                "a-disc_px=0.5-foerstner",
                "a-disc_px=0.5-corner_sub_pix-half_window_px=3",
                "a-disc_px=0.5-corner_sub_pix-half_window_px=5",
                "a-disc_px=1-foerstner",
                "a-disc_px=1-corner_sub_pix-half_window_px=3",
                "a-disc_px=1-corner_sub_pix-half_window_px=5",
            ]
        );
    }

    #[test]
    fn without_a_name_what_was_chosen_is_the_name() {
        assert_eq!(
            names("detect = ['harris', 'fast']\nrefine = 'none'"),
            ["harris", "fast"],
            "a single refiner tells nothing apart"
        );
        assert_eq!(names("detect = 'harris'\nrefine = 'none'"), ["harris-none"]);
        let all = names("seeds.disc_px = 1\nrefine.algorithm = 'all'");
        assert_eq!(all.len(), REFINERS.len());
        assert_eq!(all[0], REFINERS[0].name);
    }

    #[test]
    fn too_many_combinations_are_refused() {
        let many: Vec<String> = (0..101).map(|value| value.to_string()).collect();
        let many = many.join(", ");
        let text = format!("name = 'a'\nseeds.disc_px = [{many}]\nrefine.epsilon_px = [{many}]");
        let table: Table = text.parse().expect("TOML");
        let error = pipelines("plan", &table, &[]).expect_err("10,201").to_string();
        assert!(error.contains("more than 10000 pipelines"), "{error}");
    }
}
