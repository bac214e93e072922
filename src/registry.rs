//! Algorithms by name: one entry each, parameters checked once, when they are built.

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

/// Reads a struct of parameters from a table. Keys that `P` does not have are errors that name the
/// nearest one it has; missing keys take the values of `P::default()`.
///
/// # Errors
/// [`Error::UnknownName`] for an unknown key, [`Error::Other`] for a value of the wrong type.
pub fn parameters<P>(place: &str, table: &Table) -> Result<P>
where
    P: Default + Serialize + DeserializeOwned,
{
    let defaults = Table::try_from(P::default())
        .map_err(|error| Error::Other(format!("{place}: defaults: {error}")))?;
    reject_unknown_keys(place, "", table, &defaults)?;
    serde_path_to_error::deserialize(Value::Table(table.clone())).map_err(|error| {
        Error::Other(format!("{place}: {} {}", error.path(), error.inner().to_string().trim_end()))
    })
}

fn reject_unknown_keys(place: &str, path: &str, table: &Table, known: &Table) -> Result<()> {
    for (key, value) in table {
        match (known.get(key), value) {
            (None, _) => {
                return Err(Error::UnknownName {
                    place: place.to_owned(),
                    kind: if path.is_empty() { "key".into() } else { format!("key of {path}") },
                    found: key.clone(),
                    known: known.keys().cloned().collect(),
                });
            }
            // An empty default table is one whose keys somebody else checks.
            (Some(Value::Table(inner_known)), Value::Table(inner)) if !inner_known.is_empty() => {
                reject_unknown_keys(place, key, inner, inner_known)?;
            }
            _ => {}
        }
    }
    Ok(())
}

/// The default values of a struct of parameters, as a table.
pub fn defaults<P: Default + Serialize>() -> Table {
    // A struct of numbers, texts and booleans always is a table.
    Table::try_from(P::default()).unwrap_or_default()
}

/// Checks that `value` lies in `allowed`, and says so in the words of a range when it does not.
///
/// # Errors
/// [`Error::OutOfRange`].
pub fn in_range<N>(
    place: &str,
    key: &str,
    value: N,
    allowed: impl std::ops::RangeBounds<N> + std::fmt::Debug,
) -> Result<N>
where
    N: PartialOrd + std::fmt::Display + Copy,
{
    if allowed.contains(&value) {
        Ok(value)
    } else {
        Err(Error::OutOfRange {
            place: place.to_owned(),
            key: key.to_owned(),
            found: value.to_string(),
            allowed: format!("in {allowed:?}"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    #[serde(default)]
    struct Harris {
        k: f64,
        sigma_i: f64,
    }

    impl Default for Harris {
        fn default() -> Self {
            Self { k: 0.04, sigma_i: 1.5 }
        }
    }

    fn read(text: &str) -> Result<Harris> {
        parameters("plan.toml: [detect]", &text.parse().expect("valid TOML"))
    }

    #[test]
    fn missing_keys_take_the_defaults() {
        assert_eq!(read("k = 0.06").expect("valid"), Harris { k: 0.06, sigma_i: 1.5 });
    }

    #[test]
    fn an_unknown_key_is_named_with_the_nearest_known_one() {
        let error = read("sigma = 2.0").expect_err("unknown key");
        assert_eq!(
            error.to_string(),
            "plan.toml: [detect]: unknown key \"sigma\"; did you mean \"sigma_i\"? known: k, sigma_i"
        );
    }

    #[test]
    fn a_wrong_type_names_the_key() {
        let error = read("k = \"big\"").expect_err("wrong type");
        assert!(error.to_string().starts_with("plan.toml: [detect]: k invalid type"), "{error}");
    }

    #[test]
    fn a_value_out_of_range_names_found_and_allowed() {
        let error = in_range("plan.toml", "k", 0.3, 0.0..0.25).expect_err("too big");
        assert_eq!(error.to_string(), "plan.toml: k is 0.3, must be in 0.0..0.25");
    }
}
