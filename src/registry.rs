//! Algorithms by name: one entry each, parameters checked once, when they are built.

use std::fmt::Display;
use std::ops::{Bound, RangeBounds};

use schemars::generate::SchemaSettings;
use schemars::transform::RecursiveTransform;
use schemars::{JsonSchema, Schema};
use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::{Table, Value};

use crate::error::{Error, Result};

/// One selectable algorithm of one stage.
pub struct Entry<T: ?Sized> {
    /// What plans and records call it.
    pub name: &'static str,
    /// One line for `cornerbench list`.
    pub summary: &'static str,
    /// The work it comes from: author, year, equation.
    pub reference: &'static str,
    /// Raised whenever its numbers change; stored in every record.
    pub version: u32,
    /// Its parameters' default values.
    pub defaults: fn() -> Table,
    /// The JSON Schema of its parameters.
    pub schema: fn() -> Schema,
    /// Builds it from a table of parameters; `place` names the file and table for messages.
    pub build: fn(place: &str, parameters: &Table) -> Result<Box<T>>,
}

/// The entry called `name`, or an error that names the nearest one.
///
/// # Errors
/// [`Error::UnknownName`].
pub fn find<'a, T: ?Sized>(
    entries: &'a [Entry<T>],
    kind: &str,
    name: &str,
    place: &str,
) -> Result<&'a Entry<T>> {
    entries.iter().find(|entry| entry.name == name).ok_or_else(|| Error::UnknownName {
        place: place.to_owned(),
        kind: kind.to_owned(),
        found: name.to_owned(),
        known: entries.iter().map(|entry| entry.name.to_owned()).collect(),
    })
}

/// Reads a struct of parameters from a table. Keys that `P`'s schema does not have are errors that
/// name the nearest one it has, in tables within the table, too; missing keys take the values of
/// `P::default()`. Numbers are finite and lie in the range of the schema, `#[schemars(range(...))]`.
///
/// # Errors
/// [`Error::UnknownName`] for an unknown key, [`Error::OutOfRange`] for a value out of range,
/// [`Error::Other`] for one of the wrong type.
pub fn parameters<P>(place: &str, table: &Table) -> Result<P>
where
    P: DeserializeOwned + JsonSchema,
{
    let schema = schema::<P>();
    check_keys(place, "", table, schema.as_value())?;
    let parameters =
        serde_path_to_error::deserialize(Value::Table(table.clone())).map_err(|error| {
            let problem = error.inner().to_string();
            Error::Other(format!("{place}: {} {}", error.path(), problem.trim_end()))
        })?;
    check_ranges(place, "", table, schema.as_value())?;
    Ok(parameters)
}

/// The schema of a table's keys, behind "or null"; `None` where somebody else checks them.
fn keys_of(schema: &serde_json::Value) -> Option<&serde_json::Map<String, serde_json::Value>> {
    let alternatives = schema.get("anyOf").and_then(|any| any.as_array());
    let mut schemas = alternatives.into_iter().flatten().chain([schema]);
    schemas.find_map(|schema| schema.get("properties")?.as_object())
}

fn dotted(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

fn check_keys(place: &str, path: &str, table: &Table, schema: &serde_json::Value) -> Result<()> {
    let none = serde_json::Map::new();
    // A struct without fields has no properties; a table whose keys somebody else checks neither.
    let keys = match keys_of(schema) {
        Some(keys) => keys,
        None if path.is_empty() => &none,
        None => return Ok(()),
    };
    for (key, value) in table {
        let Some(schema) = keys.get(key) else {
            return Err(Error::UnknownName {
                place: place.to_owned(),
                kind: if path.is_empty() { "key".into() } else { format!("key of {path}") },
                found: key.clone(),
                known: keys.keys().cloned().collect(),
            });
        };
        if let Value::Table(inner) = value {
            check_keys(place, &dotted(path, key), inner, schema)?;
        }
    }
    Ok(())
}

fn check_ranges(place: &str, path: &str, table: &Table, schema: &serde_json::Value) -> Result<()> {
    let Some(keys) = keys_of(schema) else { return Ok(()) };
    for (key, value) in table {
        let Some(schema) = keys.get(key) else { continue };
        let number = match value {
            Value::Integer(number) => *number as f64,
            Value::Float(number) => *number,
            Value::Table(inner) => {
                check_ranges(place, &dotted(path, key), inner, schema)?;
                continue;
            }
            _ => continue,
        };
        let bound = |name: &str| schema.get(name)?.as_f64();
        let lower = match (bound("minimum"), bound("exclusiveMinimum")) {
            (Some(least), _) => Bound::Included(least),
            (None, below) => Bound::Excluded(below.unwrap_or(f64::NEG_INFINITY)),
        };
        let upper = match (bound("exclusiveMaximum"), bound("maximum")) {
            (None, Some(most)) => Bound::Included(most),
            (above, _) => Bound::Excluded(above.unwrap_or(f64::INFINITY)),
        };
        in_range(place, &dotted(path, key), number, (lower, upper))?;
    }
    Ok(())
}

/// The JSON Schema of a struct of parameters: what an editor completes and checks. A key's
/// description is its doc comment, its range its `#[schemars(range(...))]`.
pub fn schema<P: JsonSchema>() -> Schema {
    SchemaSettings::draft2020_12()
        .with(|settings| settings.inline_subschemas = true)
        .with_transform(RecursiveTransform(for_people))
        .into_generator()
        .into_root_schema_for::<P>()
}

/// Refuses unknown keys, and drops what is Rust's alone.
fn for_people(schema: &mut Schema) {
    if schema.get("properties").is_some() {
        schema.insert("additionalProperties".into(), false.into());
    }
    schema.remove("format");
    let is_empty = |value: &serde_json::Value| {
        value.as_str().is_some_and(str::is_empty)
            || value.as_array().is_some_and(Vec::is_empty)
            || value.as_object().is_some_and(serde_json::Map::is_empty)
    };
    if schema.get("default").is_some_and(is_empty) {
        schema.remove("default");
    }
    if let Some(serde_json::Value::String(text)) = schema.get_mut("description") {
        *text = text.replace(['\\', '`'], "").replace('\n', " ");
    }
}

/// The default values of a struct of parameters, as a table.
pub fn defaults<P: Default + Serialize>() -> Table {
    // A struct of numbers, texts and booleans always is a table.
    Table::try_from(P::default()).unwrap_or_default()
}

/// Checks that `value` lies in `allowed`, and names the range when it does not.
///
/// # Errors
/// [`Error::OutOfRange`].
pub fn in_range<N>(place: &str, key: &str, value: N, allowed: impl RangeBounds<N>) -> Result<N>
where
    N: PartialOrd + Display + Copy,
{
    if allowed.contains(&value) {
        Ok(value)
    } else {
        Err(Error::out_of_range(place, key, value, format!("in {}", interval(&allowed))))
    }
}

/// A range as mathematics writes it: "[0, 0.25)".
fn interval<N: Display>(range: &impl RangeBounds<N>) -> String {
    let lower = match range.start_bound() {
        Bound::Included(least) => format!("[{least}"),
        Bound::Excluded(below) => format!("({below}"),
        Bound::Unbounded => "(-inf".into(),
    };
    match range.end_bound() {
        Bound::Included(most) => format!("{lower}, {most}]"),
        Bound::Excluded(above) => format!("{lower}, {above})"),
        Bound::Unbounded => format!("{lower}, inf)"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
    #[serde(default)]
    struct Harris {
        #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 0.25))]
        k: f64,
        /// Scale of the
        /// window \[px\].
        #[schemars(range(min = 0.5, max = 8.0))]
        sigma_i: f64,
        threshold: f64,
    }

    impl Default for Harris {
        fn default() -> Self {
            Self { k: 0.04, sigma_i: 1.5, threshold: 0.0 }
        }
    }

    fn read(text: &str) -> Result<Harris> {
        parameters("plan.toml: [detect]", &text.parse().expect("valid TOML"))
    }

    #[test]
    fn missing_keys_take_the_defaults() {
        let expected = Harris { k: 0.06, ..Harris::default() };
        assert_eq!(read("k = 0.06").expect("valid"), expected);
    }

    #[test]
    fn an_unknown_key_is_named_with_the_nearest_known_one() {
        let error = read("sigma = 2.0").expect_err("unknown key");
        assert_eq!(
            error.to_string(),
            "plan.toml: [detect]: unknown key \"sigma\"; did you mean \"sigma_i\"? known: k, \
             sigma_i, threshold"
        );
    }

    #[test]
    fn a_wrong_type_names_the_key() {
        let error = read("k = \"big\"").expect_err("wrong type");
        assert!(error.to_string().starts_with("plan.toml: [detect]: k invalid type"), "{error}");
    }

    #[test]
    fn a_value_out_of_range_names_found_and_allowed() {
        for (text, problem) in [
            ("k = 0.3", "k is 0.3, must be in [0, 0.25)"),
            ("k = 0.25", "k is 0.25, must be in [0, 0.25)"),
            ("sigma_i = 9", "sigma_i is 9, must be in [0.5, 8]"),
            ("threshold = inf", "threshold is inf, must be in (-inf, inf)"),
            ("k = nan", "k is NaN, must be in [0, 0.25)"),
        ] {
            let error = read(text).expect_err("out of range").to_string();
            assert_eq!(error, format!("plan.toml: [detect]: {problem}"));
        }
        assert!(read("k = 0\nsigma_i = 8.0").is_ok());
    }

    #[test]
    fn a_schema_says_what_may_be_written() {
        let expected = serde_json::json!({
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": "Harris",
            "type": "object",
            "properties": {
                "k": {"type": "number", "default": 0.04, "minimum": 0.0, "exclusiveMaximum": 0.25},
                "sigma_i": {
                    "description": "Scale of the window [px].",
                    "type": "number", "default": 1.5, "minimum": 0.5, "maximum": 8.0,
                },
                "threshold": {"type": "number", "default": 0.0},
            },
            "additionalProperties": false,
        });
        assert_eq!(schema::<Harris>().to_value(), expected);
    }
}
