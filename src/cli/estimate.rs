//! What rendering would take, as the renderer measured it, in words.

use std::fmt::{self, Display};
use std::time::Duration;

use comfy_table::{Cell, CellAlignment, ContentArrangement, Table, presets};
use indicatif::{DecimalBytes, HumanDuration};
use serde::{Deserialize, Serialize};

/// Time and disk that the missing scenes of a suite would take; of nothing where none is missing.
#[derive(Debug, Default, Deserialize, Serialize)]
#[serde(default)]
pub(super) struct Estimate {
    missing: u64,
    variant: String,
    workers: u64,
    threads_per_worker: u64,
    seconds: Sum,
    bytes: Sum,
    free_bytes: Option<u64>,
    families: Vec<Family>,
}

/// A sum with its uncertainty: in 19 of 20 cases it should lie between low and high.
#[derive(Debug, Default, Deserialize, Serialize)]
struct Sum {
    expected: f64,
    low: f64,
    high: f64,
}

/// What one scene of a family takes, and from how many that were probed that is known.
#[derive(Debug, Deserialize, Serialize)]
struct Family {
    family: String,
    scenes: u64,
    probed: u64,
    seconds: f64,
    bytes: f64,
}

impl Display for Estimate {
    fn fmt(&self, text: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.missing == 0 {
            return write!(text, "nothing is missing");
        }
        let mut table = Table::new();
        table
            .load_style(presets::UTF8_HORIZONTAL_ONLY)
            .set_content_arrangement(ContentArrangement::Dynamic);
        table.set_header(["family", "scenes", "time each", "disk each", "known from"]);
        for family in &self.families {
            let known = match family.probed {
                0 => "the other families".to_owned(),
                probed => count(probed, "probe"),
            };
            let right = |text: String| Cell::new(text).set_alignment(CellAlignment::Right);
            table.add_row([
                Cell::new(&family.family),
                right(family.scenes.to_string()),
                right(format!("{:.1} s", family.seconds)),
                right(bytes(family.bytes)),
                Cell::new(known),
            ]);
        }
        writeln!(text, "{table}")?;
        writeln!(
            text,
            "{} scenes by {} of {}, {}",
            self.missing,
            count(self.workers, "worker"),
            count(self.threads_per_worker, "thread"),
            self.variant
        )?;
        let Sum { expected, low, high } = self.seconds;
        writeln!(text, "time: {}, {} to {}", time(expected), time(low), time(high))?;
        let Sum { expected, low, high } = self.bytes;
        write!(text, "disk: {}, {} to {}", bytes(expected), bytes(low), bytes(high))?;
        match self.free_bytes {
            #[expect(clippy::cast_precision_loss, reason = "for people to read")]
            Some(free) if free as f64 > high => write!(text, "; free: {}", DecimalBytes(free)),
            Some(free) => write!(text, "; NOT ENOUGH, free: {}", DecimalBytes(free)),
            None => Ok(()),
        }
    }
}

fn count(number: u64, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}

fn time(seconds: f64) -> String {
    let duration = Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX);
    HumanDuration(duration).to_string()
}

fn bytes(size: f64) -> String {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    DecimalBytes(size as u64).to_string()
}
