//! RUN/recommendation/: the page, its pictures, and all of it as JSON.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::json;

use super::{ALL, Choice, Recommendation, front, words};
use crate::error::{Error, Result};
use crate::files::{write_json, write_whole};
use crate::report::html;

/// Writes the folder `recommendation` into a run's folder, in place of an earlier one, and returns its page.
///
/// # Errors
/// When it cannot be written.
pub fn write(run: &Path, recommendation: &Recommendation) -> Result<PathBuf> {
    let of_all = recommendation.choices.iter().filter(|choice| choice.class == ALL);
    let mut sections = Vec::new();
    let mut pictures = Vec::new();
    for choice in of_all {
        let picture = front::draw(choice, recommendation.budget_us)?.map(|svg| (file(choice), svg));
        let (table, left_out) = words::table(choice);
        let is_same = |other: &&Choice| {
            other.class != ALL
                && (&other.camera, &other.track, other.seed_disc_px)
                    == (&choice.camera, &choice.track, choice.seed_disc_px)
        };
        let classes: Vec<&Choice> = recommendation.choices.iter().filter(is_same).collect();
        sections.push(json!({
            "given": choice.given(),
            "words": choice.words,
            "table": table,
            "left_out": left_out,
            "picture": picture.as_ref().map(|(file, _)| file),
            "classes": classes,
        }));
        pictures.extend(picture);
    }
    let content = json!({
        "sections": sections,
        "pipelines": recommendation.pipelines.values().collect::<Vec<_>>(),
        "warnings": recommendation.warnings,
        "budget": recommendation.budget_us.map(words::time_words),
        "runs": recommendation.runs,
    });
    let page = html::page(html::RECOMMENDATION, &content)?;
    let folder = run.join("recommendation");
    write_whole(&folder, |folder| {
        fs::create_dir(folder).map_err(Error::io(folder, "create"))?;
        write_json(&folder.join("recommendation.json"), recommendation)?;
        let page = ("index.html".to_owned(), page);
        for (file, text) in pictures.iter().chain([&page]) {
            let path = folder.join(file);
            fs::write(&path, text).map_err(Error::io(&path, "write"))?;
        }
        Ok(())
    })?;
    Ok(folder.join("index.html"))
}

/// The name of a choice's picture.
fn file(choice: &Choice) -> String {
    let disc = choice.seed_disc_px.map_or_else(String::new, |disc_px| format!("-{disc_px}px"));
    format!("pareto-{}-{}{disc}.svg", choice.camera, choice.track)
}
