//! `cornerbench compare`: two runs, what became better and what worse; a gate for continuous integration.

use std::path::PathBuf;

use super::{Ended, Global, print, print_line};
use crate::error::Result;
use crate::report::compare::{Answered, Verdict, compare};
use crate::report::{terminal, words};

#[derive(clap::Args)]
pub(super) struct Options {
    /// The run before.
    first: PathBuf,
    /// The run after, of the same scenes.
    second: PathBuf,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let [first, second] = [&options.first, &options.second];
    let comparison = compare(&Answered::read(first)?, &Answered::read(second)?)?;
    let count = |wanted: Verdict| {
        comparison.methods.iter().filter(|method| method.verdict == wanted).count()
    };
    if global.json {
        print_line(serde_json::json!(comparison))?;
    } else {
        print(terminal::table_of(&words::compared(&comparison)))?;
        print_line(format_args!(
            "\n{} better, {} worse, {} not told apart, {} the same, over {} scenes (errors paired by scene on the \
             corners that both answered; p by random signs, Holm's correction, 5 %)",
            count(Verdict::Better),
            count(Verdict::Worse),
            count(Verdict::NotToldApart),
            count(Verdict::Same),
            comparison.scenes,
        ))?;
        if let Some(warning) = &comparison.warning {
            print_line(warning)?;
        }
        for (folder, only) in
            [(first, &comparison.only_in_first), (second, &comparison.only_in_second)]
        {
            if !only.is_empty() {
                print_line(format_args!("only in {}: {}", folder.display(), only.join("; ")))?;
            }
        }
    }
    Ok(if count(Verdict::Worse) == 0 { Ended::Well } else { Ended::Partly })
}
