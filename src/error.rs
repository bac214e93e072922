//! The one error type: what failed, where, what was found, what is allowed, and the next step.

use std::fmt::{Display, Write as _};
use std::path::{Path, PathBuf};

/// What the crate's fallible functions return.
pub type Result<T> = std::result::Result<T, Error>;

/// Why something could not be done.
///
/// Algorithms never return this: once built they answer, or decline one item with a status.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused a file operation.
    #[error("{}: cannot {action}", .path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was attempted: "read", "create", "rename".
        action: &'static str,
        /// The operating system's answer.
        #[source]
        source: std::io::Error,
    },
    /// A file is there but is not what its name says.
    #[error("{}: {problem}", .path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
    },
    /// A value in a file or on the command line is outside its range.
    #[error("{place}: {key} is {found}, must be {allowed}")]
    OutOfRange {
        /// The file, or the command-line option.
        place: String,
        /// The key, dotted.
        key: String,
        /// The value given.
        found: String,
        /// The values possible.
        allowed: String,
    },
    /// A key or a name that nothing answers to.
    #[error("{}", unknown_name(.place, .kind, .found, .known))]
    UnknownName {
        /// The file, or the command-line option.
        place: String,
        /// What the name should be: "detector", "key of \[detect\]".
        kind: String,
        /// The name given.
        found: String,
        /// Every name that would have been right.
        known: Vec<String>,
    },
    /// A file of a dataset is not the one that was rendered.
    #[error("{}: SHA-256 is {found}, the dataset's manifest says {expected}; render the scene again: \
             cornerbench render {suite} -o {}", .path.display(), .dataset.display())]
    Altered {
        /// The file.
        path: PathBuf,
        /// The dataset's folder.
        dataset: PathBuf,
        /// The suite it was rendered from.
        suite: String,
        /// The hash of the manifest.
        expected: String,
        /// The hash of the file as it is, or "no file".
        found: String,
    },
    /// Another program failed.
    #[error("{program}: {problem}")]
    Program {
        /// The program's name.
        program: String,
        /// What it did, and the last it said.
        problem: String,
    },
    /// A sentence of its own; the rarer cases.
    #[error("{0}")]
    Other(String),
    /// What was being done when the source happened.
    #[error("{doing}")]
    Context {
        /// What was being done.
        doing: String,
        /// What went wrong.
        #[source]
        source: Box<Error>,
    },
}

impl Error {
    /// [`Error::OutOfRange`]: where, which key, what was found, what is allowed.
    pub fn out_of_range(
        place: impl Display,
        key: impl Into<String>,
        found: impl Display,
        allowed: impl Into<String>,
    ) -> Self {
        Self::OutOfRange {
            place: place.to_string(),
            key: key.into(),
            found: found.to_string(),
            allowed: allowed.into(),
        }
    }

    /// An I/O failure on `path`; `action` completes "cannot ...".
    pub fn io(path: &Path, action: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { path, action, source }
    }

    /// A file that is not what its name says.
    pub fn malformed(path: &Path, problem: impl ToString) -> Self {
        Self::Malformed { path: path.to_owned(), problem: problem.to_string() }
    }

    /// Adds what was being done, keeping the cause.
    #[must_use]
    pub fn while_doing(self, doing: impl ToString) -> Self {
        Self::Context { doing: doing.to_string(), source: Box::new(self) }
    }

    /// The whole chain on one line, outermost first.
    pub fn chain(&self) -> String {
        let mut line = self.to_string();
        let mut cause = std::error::Error::source(self);
        while let Some(inner) = cause {
            let _ = write!(line, ": {inner}");
            cause = inner.source();
        }
        line
    }
}

fn unknown_name(place: &str, kind: &str, found: &str, known: &[String]) -> String {
    let nearest = known
        .iter()
        .map(|name| (strsim::damerau_levenshtein(name, found), name))
        .min()
        .filter(|(distance, name)| *distance <= 1 + name.len() / 3);
    let hint = match nearest {
        Some((_, name)) => format!("; did you mean {name:?}?"),
        None => ";".to_owned(),
    };
    format!("{place}: unknown {kind} {found:?}{hint} known: {}", known.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_name_suggests_the_nearest() {
        let error = Error::UnknownName {
            place: "plan.toml".into(),
            kind: "detector".into(),
            found: "haris".into(),
            known: vec!["fast".into(), "harris".into()],
        };
        assert_eq!(
            error.to_string(),
            "plan.toml: unknown detector \"haris\"; did you mean \"harris\"? known: fast, harris"
        );
    }

    #[test]
    fn chain_prints_causes_in_order() {
        let error = Error::Other("inner".into()).while_doing("outer");
        assert_eq!(error.chain(), "outer: inner");
    }
}
