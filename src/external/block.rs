//! How a program is started and what it is: one table of a TOML file, or the program's file alone.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use schemars::{JsonSchema, Schema};
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::needs::Needs;
use super::protocol::Task;
use crate::error::{Error, Result};
use crate::files::sha256_hex;
use crate::registry;

/// What a program finds around it.
pub struct Surroundings<'a> {
    /// The folder of Python's modules for such programs; none where it is not known.
    pub modules: Option<&'a Path>,
    /// The Python of an environment that holds what the one of this name does; "" is any. None where it is not set up.
    pub python: &'a dyn Fn(&str) -> Option<PathBuf>,
}

/// How a program is started and what it is.
#[derive(Clone, Debug)]
pub struct Block {
    /// What plans and records call it.
    pub name: String,
    /// The file that says so, or is the program.
    pub file: PathBuf,
    /// One line for `cornerbench list`.
    pub summary: String,
    /// The work it comes from: author, year, equation.
    pub reference: String,
    /// What it does; none where only the program itself says it.
    pub does: Vec<Task>,
    /// What it is given.
    pub needs: Needs,
    /// What is sent to it at the start.
    pub parameters: Table,
    /// How it is started, as the file says.
    pub command: Vec<String>,
    pub(super) version_command: Vec<String>,
    pub(super) variables: BTreeMap<String, String>,
    /// How long an answer may take \[s\].
    pub time_limit_s: f64,
    /// How long it may take to start \[s\].
    pub start_limit_s: f64,
    /// How it is installed.
    pub install: String,
}

/// A table of the file.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(title = "Algorithm", extend("required" = ["command"]))]
struct BlockFile {
    /// One line for `cornerbench list`.
    summary: String,
    /// The work it comes from: author, year, equation.
    reference: String,
    /// What it does: "detect", "refine" or "grasp", or a list; where this is missing the program says so itself.
    does: OneOrSeveral,
    /// The program and its arguments, started in the file's folder. {python} stands for the project's Python, where it is
    /// set up, and {python:peers} for one with the packages of that environment.
    #[schemars(length(min = 1))]
    command: Vec<String>,
    /// A program that prints a version as its first line; without one the program says it when it is greeted.
    version_command: Vec<String>,
    /// What it is given of an exposure.
    needs: Needs,
    /// Sent to it when it starts.
    #[schemars(with = "serde_json::Map<String, serde_json::Value>")]
    parameters: Table,
    /// Environment variables for it.
    variables: BTreeMap<String, String>,
    /// How long an answer may take \[s\].
    #[schemars(range(min = 0.001, max = 86_400.0))]
    time_limit_s: f64,
    /// How long it may take from its start to its first line \[s\].
    #[schemars(range(min = 0.001, max = 86_400.0))]
    start_limit_s: f64,
    /// What to do where it cannot be started: a command, say.
    install: String,
}

/// A task, or several.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "must be \"detect\", \"refine\" or \"grasp\", or a list of these")]
enum OneOrSeveral {
    One(Task),
    Several(Vec<Task>),
}

impl Default for BlockFile {
    fn default() -> Self {
        Self {
            summary: String::new(),
            reference: String::new(),
            does: OneOrSeveral::Several(Vec::new()),
            command: Vec::new(),
            version_command: Vec::new(),
            needs: Needs::default(),
            parameters: Table::new(),
            variables: BTreeMap::new(),
            time_limit_s: 10.0,
            start_limit_s: 60.0,
            install: String::new(),
        }
    }
}

/// The JSON Schema of a file of such tables.
pub fn schema() -> Schema {
    let mut block = registry::schema::<BlockFile>();
    block.remove("$schema");
    schemars::json_schema!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Algorithms that are other programs",
        "type": "object",
        "additionalProperties": block,
    })
}

/// The blocks of a file: every table of a TOML file, or the one that starts the program that the file is.
///
/// # Errors
/// When it cannot be read, or a table has an unknown key or a value out of range.
pub fn blocks(file: &Path) -> Result<Vec<Block>> {
    let file = std::path::absolute(file).map_err(Error::io(file, "find"))?;
    if file.extension().is_none_or(|extension| extension != "toml") {
        return Ok(vec![of_program(&file)?]);
    }
    let text = fs::read_to_string(&file).map_err(Error::io(&file, "read"))?;
    let table: Table = text
        .parse()
        .map_err(|error: toml::de::Error| Error::malformed(&file, error.to_string()))?;
    table.iter().map(|(name, value)| of_table(&file, name, value)).collect()
}

/// A program given by its file alone: it says itself what it does and needs.
fn of_program(file: &Path) -> Result<Block> {
    if !file.is_file() {
        return Err(Error::io(file, "find")(std::io::ErrorKind::NotFound.into()));
    }
    let path = file.display().to_string();
    let is_python = file.extension().is_some_and(|extension| extension == "py");
    let command = if is_python { vec!["{python}".to_owned(), path] } else { vec![path] };
    let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(block(file, &name, BlockFile { command, ..BlockFile::default() }))
}

fn of_table(file: &Path, name: &str, value: &Value) -> Result<Block> {
    let place = format!("{}: [{name}]", file.display());
    let Value::Table(table) = value else {
        return Err(Error::Other(format!(
            "{}: {name} is no table; each algorithm is one: [{name}]",
            file.display()
        )));
    };
    let read: BlockFile = registry::parameters(&place, table)?;
    if read.command.first().is_none_or(String::is_empty) {
        return Err(Error::Other(format!("{place}: command is missing, the program to start")));
    }
    read.needs.check(&place)?;
    Ok(block(file, name, read))
}

fn block(file: &Path, name: &str, read: BlockFile) -> Block {
    Block {
        name: legal(name),
        file: file.to_owned(),
        summary: read.summary,
        reference: read.reference,
        does: match read.does {
            OneOrSeveral::One(task) => vec![task],
            OneOrSeveral::Several(tasks) => tasks,
        },
        needs: read.needs,
        parameters: read.parameters,
        command: read.command,
        version_command: read.version_command,
        variables: read.variables,
        time_limit_s: read.time_limit_s,
        start_limit_s: read.start_limit_s,
        install: read.install,
    }
}

/// A name that can be part of a pipeline's, hence of file names and addresses.
pub(super) fn legal(name: &str) -> String {
    let is_legal = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_.".contains(c);
    let lower = name.chars().map(|c| c.to_ascii_lowercase());
    let name: String = lower.map(|c| if is_legal(c) { c } else { '_' }).collect();
    if name.is_empty() { "program".to_owned() } else { name }
}

/// A command with everything in its place.
#[derive(Clone, Debug)]
pub(super) struct Invocation {
    program: PathBuf,
    arguments: Vec<String>,
    folder: PathBuf,
    variables: Vec<(String, OsString)>,
}

impl Invocation {
    /// The command, ready to be started.
    pub fn command(&self) -> Command {
        let mut command = Command::new(&self.program);
        command.args(&self.arguments).current_dir(&self.folder);
        command.envs(self.variables.iter().map(|(name, value)| (name, value)));
        command
    }

    /// What is started.
    pub fn program(&self) -> &Path {
        &self.program
    }
}

impl Block {
    /// How it is started.
    ///
    /// # Errors
    /// Which Python is missing.
    pub(super) fn start(&self, around: &Surroundings) -> std::result::Result<Invocation, String> {
        self.invocation(&self.command, around)
    }

    /// How it is asked for its version, where that is another command.
    ///
    /// # Errors
    /// Which Python is missing.
    pub(super) fn version(
        &self,
        around: &Surroundings,
    ) -> std::result::Result<Option<Invocation>, String> {
        if self.version_command.is_empty() {
            return Ok(None);
        }
        self.invocation(&self.version_command, around).map(Some)
    }

    /// A hash of its code as far as the file says where that is: the first file that the command names, relative to the
    /// file's folder, or a module behind `-m` there. Later ones may be what it writes.
    pub(super) fn sha256(&self) -> String {
        let folder = self.file.parent().unwrap_or(Path::new("."));
        let named = self.command.iter().enumerate().map(|(place, word)| match place {
            1.. if self.command[place - 1] == "-m" => folder.join(format!("{word}.py")),
            _ => folder.join(word),
        });
        // What cannot be read has no content; to start it will say why.
        let first = named.into_iter().find(|path| path.is_file());
        let code = first.and_then(|path| fs::read(path).ok()).unwrap_or_default();
        sha256_hex(&[code, format!("{:?}", self.variables).into_bytes()].concat())
    }

    fn invocation(
        &self,
        words: &[String],
        around: &Surroundings,
    ) -> std::result::Result<Invocation, String> {
        let folder = self.file.parent().unwrap_or(Path::new("."));
        let words = words.iter().map(|word| with_python(word, around));
        let mut words = words.collect::<std::result::Result<Vec<String>, String>>()?;
        let program = words.remove(0);
        // Relative to the file's folder, as everything else.
        let is_path = program.contains(std::path::MAIN_SEPARATOR) || program.contains('/');
        let program = if is_path { folder.join(program) } else { program.into() };
        // One thread, as own algorithms are timed; `variables` may say otherwise.
        let mut variables: Vec<(String, OsString)> =
            ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"]
                .map(|name| (name.to_owned(), "1".into()))
                .into();
        if let Some(modules) = around.modules {
            let others = std::env::var_os("PYTHONPATH").unwrap_or_default();
            let others = std::env::split_paths(&others).filter(|path| !path.as_os_str().is_empty());
            // A folder whose name holds the separator cannot be said; the program will complain.
            if let Ok(paths) = std::env::join_paths([modules.to_owned()].into_iter().chain(others))
            {
                variables.push(("PYTHONPATH".to_owned(), paths));
            }
        }
        variables.push(("PYTHONDONTWRITEBYTECODE".to_owned(), "1".into()));
        let own = self.variables.iter().map(|(name, value)| (name.clone(), value.into()));
        variables.extend(own);
        Ok(Invocation { program, arguments: words, folder: folder.to_owned(), variables })
    }
}

/// A word of a command with the path of a Python in place of its name.
fn with_python(word: &str, around: &Surroundings) -> std::result::Result<String, String> {
    let Some((before, rest)) = word.split_once("{python") else { return Ok(word.to_owned()) };
    let Some((environment, after)) = rest.split_once('}') else { return Ok(word.to_owned()) };
    let environment = environment.trim_start_matches(':');
    let path = match (around.python)(environment) {
        Some(path) => path.display().to_string(),
        None if environment.is_empty() => "python3".to_owned(),
        None => {
            return Err(format!(
                "its Python environment is not set up: cornerbench setup --{environment}"
            ));
        }
    };
    Ok(format!("{before}{path}{after}"))
}
