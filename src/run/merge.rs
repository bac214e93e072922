//! Shards of a run made one.

use std::fs;
use std::path::{Path, PathBuf};

use super::{Outcome, Shard, failures};
use crate::error::{Error, Result};
use crate::files::{write_json, write_whole};
use crate::record::{RecordFile, RunDescription, TIMING_FILE, join_records, read_run};

/// Merges the shards of a run, all of them, into the run that one machine would have made: the same records,
/// byte for byte.
///
/// # Errors
/// When a folder is no run, they are not shards of one run, one is missing or given twice, or the output cannot be
/// written.
pub fn merge(shards: &[PathBuf], output: &Path, command: &str) -> Result<Outcome> {
    if output.join("records.parquet").exists() || output.join("unfinished.json").exists() {
        return Err(Error::Other(format!(
            "{}: holds a run already; choose another folder with -o",
            output.display()
        )));
    }
    let runs = shards
        .iter()
        .map(|folder| Ok((folder.as_path(), read_run(folder)?)))
        .collect::<Result<Vec<(&Path, RunDescription)>>>()?;
    let Some((first_folder, first)) = runs.first() else {
        return Err(Error::Other("merge: no runs; name the folders of all shards".into()));
    };
    let mut found: Vec<Option<&Path>> = Vec::new();
    for (folder, run) in &runs {
        if run.identity_sha256 != first.identity_sha256 {
            return Err(Error::Other(format!(
                "{}: is not a shard of the run of {}: plan, cameras, scenes or program differ",
                folder.display(),
                first_folder.display()
            )));
        }
        let shard = run.shard.as_deref().and_then(|text| text.parse::<Shard>().ok());
        let Some(Shard { first, count }) = shard else {
            return Err(Error::Other(format!(
                "{}: is a whole run, not a shard; `measure --shard I/N` makes those",
                folder.display()
            )));
        };
        if found.is_empty() {
            found.resize(count, None);
        }
        if found.len() != count {
            return Err(Error::Other(format!(
                "{}: is one of {count} shards, {} one of {}",
                folder.display(),
                first_folder.display(),
                found.len()
            )));
        }
        if let Some(other) = found[first].replace(folder) {
            return Err(Error::Other(format!(
                "{} and {} are both shard {first}/{count}",
                other.display(),
                folder.display()
            )));
        }
    }
    if let Some(missing) = found.iter().position(Option::is_none) {
        return Err(Error::Other(format!(
            "shard {missing}/{} is missing; measure it, or name its folder",
            found.len()
        )));
    }
    let folders: Vec<&Path> = found.into_iter().flatten().collect();
    let records: Vec<PathBuf> =
        folders.iter().map(|folder| folder.join("records.parquet")).collect();
    let groups = (0..first.scenes.len())
        .map(|scene| (records[scene % records.len()].as_path(), scene / records.len()));
    // Behind its scenes a shard may have rows of what went wrong when all of them were measured.
    let of_scenes = |shard: usize| (first.scenes.len() + records.len() - 1 - shard) / records.len();
    let mut at_end = Vec::new();
    for (shard, path) in records.iter().enumerate() {
        let groups = RecordFile::open(path)?.groups();
        at_end.extend((of_scenes(shard)..groups).map(|group| (path.as_path(), group)));
    }
    write_whole(&output.join("records.parquet"), |path| join_records(path, groups.chain(at_end)))?;
    for folder in &folders {
        copy_pictures(&folder.join("scenes"), &output.join("scenes"))?;
    }
    // Times are those of the first shard: other machines' are others.
    if let Some(timing) = folders.first().map(|folder| folder.join(TIMING_FILE))
        && timing.is_file()
    {
        write_whole(&output.join(TIMING_FILE), |path| {
            fs::copy(&timing, path).map(|_| ()).map_err(Error::io(&timing, "copy"))
        })?;
    }
    // In the order of the scenes, as one run has them.
    let is_unreadable =
        |scene: &&String| runs.iter().any(|(_, run)| run.unreadable.contains(scene));
    let unreadable: Vec<String> = first.scenes.iter().filter(is_unreadable).cloned().collect();
    let failures = failures::sum(runs.iter().flat_map(|(_, run)| run.failures.clone()));
    let outcome = Outcome {
        scenes: first.scenes.len() - unreadable.len(),
        unreadable: unreadable.len(),
        resumed: 0,
        failed: failures::total(&failures),
    };
    let command = command.to_owned();
    let merged = RunDescription { shard: None, command, unreadable, failures, ..first.clone() };
    write_json(&output.join("run.json"), &merged)?;
    Ok(outcome)
}

/// Copies what reports draw; links do not count.
fn copy_pictures(from: &Path, to: &Path) -> Result<()> {
    fs::create_dir_all(to).map_err(Error::io(to, "create"))?;
    let entries = match fs::read_dir(from) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(Error::io(from, "read")(error)),
    };
    for entry in entries {
        let entry = entry.map_err(Error::io(from, "read"))?;
        let kind = entry.file_type().map_err(Error::io(from, "read"))?;
        let (from, to) = (entry.path(), to.join(entry.file_name()));
        if kind.is_dir() {
            copy_pictures(&from, &to)?;
        } else if kind.is_file() {
            fs::copy(&from, &to).map_err(Error::io(&from, "copy"))?;
        }
    }
    Ok(())
}
