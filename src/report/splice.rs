//! Tables of a run in a Markdown file, between marks.

use std::path::Path;

use crate::error::{Error, Result};
use crate::report::words::Words;
use crate::report::write_text;

const END: &str = "<!-- end of results -->";

/// Fills all marks of a plan, each with the command that made its table, as it was given.
///
/// # Errors
/// When the file has none, one names a table that is not there or has no end, or the file cannot be read or written.
pub(super) fn splice(
    path: &Path,
    plan: &str,
    given: &str,
    tables: &[(String, Words)],
) -> Result<()> {
    let text = std::fs::read_to_string(path).map_err(Error::io(path, "read"))?;
    let begin = format!("<!-- results of {plan}: ");
    let mut whole = String::new();
    let mut rest = text.as_str();
    let mut filled = 0;
    while let Some((before, after)) = rest.split_once(&begin) {
        let named = after.split_once(" -->");
        let Some((name, after)) = named.filter(|(name, _)| !name.contains('\n')) else {
            return Err(Error::malformed(
                path,
                format!("a mark {begin:?} does not end with \" -->\""),
            ));
        };
        let Some((_, table)) = tables.iter().find(|(known, _)| known == name) else {
            return Err(Error::UnknownName {
                place: path.display().to_string(),
                kind: "table".into(),
                found: name.to_owned(),
                known: tables.iter().map(|(known, _)| known.clone()).collect(),
            });
        };
        let Some((_, after)) = after.split_once(END) else {
            return Err(Error::malformed(path, format!("behind {begin}{name} --> no {END} is")));
        };
        whole.push_str(before);
        let (command, table) = (command(given), markdown(table));
        whole.push_str(&format!("{begin}{name} -->\n\n`{command}`\n\n{table}\n{END}"));
        rest = after;
        filled += 1;
    }
    if filled == 0 {
        let known: Vec<&str> = tables.iter().map(|(known, _)| known.as_str()).collect();
        return Err(Error::malformed(
            path,
            format!(
                "a line {begin}TABLE --> must be there, and behind it a line {END}; TABLE is one of {}",
                known.join(", ")
            ),
        ));
    }
    whole.push_str(rest);
    write_text(path, &whole)
}

/// A command without where to: that is no part of what it gave.
fn command(given: &str) -> String {
    let mut words = given.split(' ');
    let mut kept = Vec::new();
    while let Some(word) = words.next() {
        match word {
            "-o" | "--output" | "--into" => drop(words.next()),
            word if word.starts_with("--output=") || word == "--quiet" => {}
            word => kept.push(word),
        }
    }
    kept.join(" ")
}

/// A table as Markdown has it; all but the first column stand to the right.
fn markdown(table: &Words) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let rule = format!("|---|{}\n", "--:|".repeat(table.header.len().saturating_sub(1)));
    let rows: String = table.rows.iter().map(|row| line(row)).collect();
    format!("{}{rule}{rows}", line(&table.header))
}
