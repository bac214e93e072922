//! Algorithms that are other programs: those that the project knows, and the user's own.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::environment::python_with;
use super::{Global, project};
use crate::error::{Error, Result};
use crate::external::{AnswerFile, Block, Program, Surroundings, blocks, is_answer_file};

/// Where adapters and the tables that describe them are.
const FOLDER: &str = "scripts/external";
/// Where unknown names stand.
pub(super) const PLACE: &str = "--with";

/// The programs that the project knows, by name.
///
/// # Errors
/// When a file that describes them cannot be read.
pub(super) fn known() -> Result<Vec<Block>> {
    let folder = project::root()?.join(FOLDER);
    let entries = std::fs::read_dir(&folder).map_err(Error::io(&folder, "read"))?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    files.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    files.sort();
    let mut found = Vec::new();
    for file in files {
        found.extend(blocks(&file)?);
    }
    found.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(found)
}

/// Whether what is given is a file of corners that were computed elsewhere.
pub(super) fn is_answers(given: &str) -> bool {
    let path = Path::new(given);
    is_answer_file(path) && path.is_file()
}

/// The files among what is given of corners that were computed elsewhere.
///
/// # Errors
/// For a file that is none.
pub(super) fn answers(given: &[String]) -> Result<Vec<AnswerFile>> {
    let files = given.iter().filter(|one| is_answers(one));
    files.map(|file| AnswerFile::read(Path::new(file))).collect()
}

/// Starts and greets the programs of these names or files; "all" is every one that the project knows and that is
/// available.
///
/// # Errors
/// For a name that nothing answers to, a file that cannot be read, two programs of one name, and a program that does not
/// say what it does.
pub(super) fn open(global: &Global, given: &[String]) -> Result<Vec<Arc<Program>>> {
    if given.is_empty() {
        return Ok(Vec::new());
    }
    let mut chosen: Vec<Block> = Vec::new();
    for one in given.iter().filter(|one| !is_answers(one)) {
        chosen.extend(find(one)?);
    }
    for (index, block) in chosen.iter().enumerate() {
        if let Some(other) = chosen[..index].iter().find(|other| other.name == block.name) {
            return Err(Error::Other(format!(
                "--with: {} and {} are both called {:?}; give one another name",
                other.file.display(),
                block.file.display(),
                block.name
            )));
        }
    }
    let root = project::root()?;
    let modules = root.join(FOLDER);
    let around = Surroundings {
        modules: Some(&modules),
        python: &|environment| python_with(&root, environment),
    };
    let all = given.iter().any(|one| one == "all");
    let opened = chosen.into_iter().map(|block| Program::open(block, &around).map(Arc::new));
    let mut opened = opened.collect::<Result<Vec<_>>>()?;
    if all {
        // Who asks for all means all that there are.
        for program in &opened {
            if let Some(failure) = program.not_available() {
                global.say(format!("left out: {}", failure.reason));
            }
        }
        opened.retain(|program| program.not_available().is_none());
    }
    Ok(opened)
}

fn find(name: &str) -> Result<Vec<Block>> {
    let path = Path::new(name);
    if path.is_file() {
        return blocks(path);
    }
    let known = known()?;
    if name == "all" {
        return Ok(known);
    }
    match known.iter().find(|block| block.name == name) {
        Some(block) => Ok(vec![block.clone()]),
        None => Err(Error::UnknownName {
            place: PLACE.to_owned(),
            kind: "program or file".to_owned(),
            found: name.to_owned(),
            known: known.into_iter().map(|block| block.name).collect(),
        }),
    }
}

/// Says which programs take part, and which are not there.
pub(super) fn say(global: &Global, programs: &[Arc<Program>]) {
    for program in programs {
        global.say(match program.not_available() {
            Some(failure) => format!("not available: {}", failure.reason),
            None => format!("{} {}", program.name(), program.version()),
        });
    }
}
