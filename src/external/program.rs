//! A program that is an algorithm: greeted, asked, ended, started again.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde::Serialize;
use serde_json::json;

use super::block::{Block, Invocation, Surroundings};
use super::log::Log;
use super::needs::Needs;
use super::process::{NoLine, Process};
use super::protocol::{Answer, Greeting, Image, PROTOCOL, Question, Ready, Task, read};
use crate::detect::{Detection, is_near_region};
use crate::error::{Error, Result};
use crate::geometry::ImagePoint;
use crate::grasp::{Face, Grasp, NoGrasp};
use crate::refine::Corner;
use crate::sensor::{Exposure, RangeImage, Rig};
use crate::target::TargetRegion;

/// After so many failures in a row, no answer between them, it is not started again.
const MOST_IN_A_ROW: u32 = 20;
/// How far around the region a detector searches, as own ones do \[px\].
const MARGIN_PX: f64 = 3.0;
/// ENOEXEC: Unix's number of the error that a file is none that can be executed.
const NO_PROGRAM: i32 = 8;

/// What went wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FailureKind {
    /// It cannot be started, or says no version.
    NotAvailable,
    /// It ended.
    Crashed,
    /// It did not answer in time.
    TimedOut,
    /// What it answered is none.
    InvalidAnswer,
    /// It said that it failed.
    Failed,
    /// When it was started again it was another one.
    VersionChanged,
}

impl FailureKind {
    /// The name used in records.
    pub fn name(self) -> &'static str {
        match self {
            Self::NotAvailable => "not_available",
            Self::Crashed => "crashed",
            Self::TimedOut => "timed_out",
            Self::InvalidAnswer => "invalid_answer",
            Self::Failed => "failed",
            Self::VersionChanged => "version_changed",
        }
    }
}

/// Why there is no answer to an exposure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// In a word.
    pub kind: FailureKind,
    /// In a sentence that names the program.
    pub reason: String,
}

/// An answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Reply<T> {
    /// The answer.
    pub answer: T,
    /// What asking took beside what the program took by its own clock \[us\]: 0 of an own algorithm, and of a program
    /// that does not say.
    pub protocol_us: f64,
}

impl<T> Reply<T> {
    /// The answer of an own algorithm.
    pub fn own(answer: T) -> Self {
        Self { answer, protocol_us: 0.0 }
    }
}

/// What a program is asked.
pub type Asked<T> = std::result::Result<Reply<T>, Failure>;

/// A program that is an algorithm. One process answers one question at a time, whoever asks.
pub struct Program {
    block: Block,
    does: Vec<Task>,
    needs: Needs,
    /// How it is started, and what it said then; or why it cannot be.
    opened: std::result::Result<Opened, Failure>,
    /// What it says on standard error, each time that it is started.
    log: Arc<Log>,
    state: Mutex<State>,
}

/// A program that was greeted.
struct Opened {
    start: Invocation,
    version: Version,
    /// Of its code.
    sha256: String,
}

/// What it says of itself.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Version {
    version: String,
    libraries: BTreeMap<String, String>,
}

impl std::fmt::Display for Version {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{}", self.version)?;
        let libraries: Vec<String> =
            self.libraries.iter().map(|(name, version)| format!("{name} {version}")).collect();
        if libraries.is_empty() {
            return Ok(());
        }
        write!(formatter, " ({})", libraries.join(", "))
    }
}

#[derive(Default)]
struct State {
    process: Option<Process>,
    picture: Option<Picture>,
    asked: u64,
    failed_in_a_row: u32,
    /// Why it is not started any more.
    gone: Option<Failure>,
}

/// The file in which a program finds the samples of an exposure.
struct Picture {
    file: tempfile::NamedTempFile,
    bytes: Vec<u8>,
}

impl Program {
    /// Starts a program and greets it. Where that fails, or it says no version, every question has that failure for an
    /// answer.
    ///
    /// # Errors
    /// When neither the block nor the program says what it does.
    pub fn open(block: Block, around: &Surroundings) -> Result<Self> {
        let mut program = Self {
            does: block.does.clone(),
            needs: block.needs,
            opened: Err(Failure { kind: FailureKind::NotAvailable, reason: String::new() }),
            log: Arc::default(),
            state: Mutex::default(),
            block,
        };
        match program.first_start(around) {
            Ok((opened, ready)) => {
                // The program knows best.
                program.does = ready.does.unwrap_or(program.does);
                if let Some(needs) = ready.needs {
                    needs.check(&program.block.name)?;
                    program.needs = needs;
                }
                program.opened = Ok(opened);
            }
            Err(reason) => {
                let reason = program.named(&program.with_hint(reason));
                program.opened = Err(Failure { kind: FailureKind::NotAvailable, reason });
            }
        }
        if program.does.is_empty() {
            let file = program.block.file.display();
            return Err(Error::Other(match &program.opened {
                Err(failure) => format!("{file}: {}", failure.reason),
                Ok(_) => format!(
                    "{file}: does not say what it does; add does = \"refine\" to its table, or to what it answers when it is \
                     greeted (scripts/PROTOCOL.md)"
                ),
            }));
        }
        Ok(program)
    }

    fn first_start(&self, around: &Surroundings) -> std::result::Result<(Opened, Ready), String> {
        let start = self.block.start(around)?;
        let own = match self.block.version(around)? {
            Some(invocation) => Some(self.version_of(&invocation)?),
            None => None,
        };
        let (process, ready) = self.greet(&start)?;
        let version = own.or_else(|| ready.version.clone().filter(|text| !text.is_empty()));
        let Some(version) = version else {
            return Err("says no version, and without one nothing is measured".to_owned());
        };
        self.state().process = Some(process);
        let version = Version { version, libraries: ready.libraries.clone() };
        Ok((Opened { start, version, sha256: self.block.sha256() }, ready))
    }

    /// The first line that the command for the version prints.
    fn version_of(&self, invocation: &Invocation) -> std::result::Result<String, String> {
        let mut process = self.spawn(invocation)?;
        let line =
            process.line(self.start_limit()).map_err(|no_line| self.why(&process, no_line))?;
        let line = String::from_utf8_lossy(&line).trim().to_owned();
        process.end().map_err(|how| format!("its version command {how}"))?;
        if line.is_empty() { Err("its version command says nothing".to_owned()) } else { Ok(line) }
    }

    fn spawn(&self, invocation: &Invocation) -> std::result::Result<Process, String> {
        Process::start(invocation.command(), &self.log).map_err(|error| {
            use std::io::ErrorKind;
            let program = invocation.program().display();
            match error.kind() {
                ErrorKind::NotFound => format!("{program} is not there"),
                ErrorKind::PermissionDenied => format!(
                    "{program} may not be executed: chmod +x it, or give a table with its command (scripts/PROTOCOL.md)"
                ),
                _ if error.raw_os_error() == Some(NO_PROGRAM) => format!(
                    "{program} is no program and names no interpreter in its first line; give a table with its command \
                     (scripts/PROTOCOL.md)"
                ),
                _ => format!("{program} cannot be started: {error}"),
            }
        })
    }

    fn greet(&self, start: &Invocation) -> std::result::Result<(Process, Ready), String> {
        let mut process = self.spawn(start)?;
        let greeting = Greeting { protocol: PROTOCOL, parameters: &self.block.parameters };
        let line = serde_json::to_vec(&greeting).map_err(|error| error.to_string())?;
        let line = process.ask(line, self.start_limit()).map_err(|no_line| {
            let why = self.why(&process, no_line);
            format!("when it was greeted it {why}")
        })?;
        let ready: Ready = read(&line)
            .map_err(|problem| process.with_complaint(format!("when it was greeted: {problem}")))?;
        if ready.protocol != PROTOCOL {
            return Err(format!(
                "speaks version {} of the protocol, this program {PROTOCOL} (scripts/PROTOCOL.md)",
                ready.protocol
            ));
        }
        Ok((process, ready))
    }

    fn start_limit(&self) -> Duration {
        Duration::from_secs_f64(self.block.start_limit_s)
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What plans and records call it.
    pub fn name(&self) -> &str {
        &self.block.name
    }

    /// How it is started and what it was said to be.
    pub fn block(&self) -> &Block {
        &self.block
    }

    /// What it does.
    pub fn does(&self) -> &[Task] {
        &self.does
    }

    /// What it is given.
    pub fn needs(&self) -> Needs {
        self.needs
    }

    /// Its version and those of its libraries; "none" where it is not available.
    pub fn version(&self) -> String {
        self.opened.as_ref().map_or("none".to_owned(), |opened| opened.version.to_string())
    }

    /// Why it is not available.
    pub fn not_available(&self) -> Option<&Failure> {
        self.opened.as_ref().err()
    }

    /// A hash of the first file that its command names; none where it is not available.
    pub fn sha256(&self) -> Option<&str> {
        self.opened.as_ref().ok().map(|opened| opened.sha256.as_str())
    }

    /// Keeps what it says on standard error in a folder's file NAME.log, which is not there while it says nothing.
    pub fn log_to(&self, folder: &Path) {
        self.log.keep_in(folder.join(format!("{}.log", self.block.name)));
    }

    /// What run.json has of it.
    pub fn description(&self) -> serde_json::Value {
        json!({
            "name": self.block.name,
            "version": self.version(),
            "sha256": self.sha256(),
            "does": self.does,
            "needs": self.needs,
            "parameters": self.block.parameters,
            "command": self.block.command,
            "time_limit_s": self.block.time_limit_s,
            "not_available": self.not_available().map(|failure| &failure.reason),
        })
    }

    /// The number by which the operating system knows its process, where it runs.
    pub fn process_id(&self) -> Option<u32> {
        self.state().process.as_ref().map(Process::id)
    }

    /// Candidates of an exposure, strongest first.
    pub fn detect(
        &self,
        exposure: &Exposure,
        region: Option<&TargetRegion>,
    ) -> Asked<Vec<Detection>> {
        let mut question = Question::new(Task::Detect);
        if let Some(region) = region {
            let [width, height] = [exposure.width(), exposure.height()];
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "3")]
            let range = region.range.grown(MARGIN_PX as usize, width, height);
            question = question.of_region(range);
        }
        let mut reply = self.ask(question, Some(exposure), Answer::detections)?;
        if let Some(region) = region {
            reply.answer.retain(|found| is_near_region(region, MARGIN_PX, found.point));
        }
        Ok(reply)
    }

    /// A corner for each seed.
    pub fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Asked<Vec<Corner>> {
        if seeds.is_empty() && self.opened.is_ok() {
            return Ok(Reply::own(Vec::new()));
        }
        let points: Vec<ImagePoint> = seeds.iter().map(|seed| seed.point).collect();
        let question = Question { seeds: Some(points), ..Question::new(Task::Refine) };
        self.ask(question, Some(exposure), |answer| answer.corners(seeds))
    }

    /// A grasp point, or that there is none.
    pub fn grasp(
        &self,
        face: &Face,
        rig: &Rig,
        range: &RangeImage,
    ) -> Asked<std::result::Result<Grasp, NoGrasp>> {
        let question = Question::new(Task::Grasp).of_face(face, rig, range);
        let reply = self.ask(question, None, |answer| answer.grasp(rig))?;
        let answer = reply.answer.ok_or(NoGrasp::NoRange);
        Ok(Reply { answer, protocol_us: reply.protocol_us })
    }

    /// Asks, and checks the answer.
    fn ask<T>(
        &self,
        question: Question,
        exposure: Option<&Exposure>,
        check: impl FnOnce(Answer) -> std::result::Result<T, String>,
    ) -> Asked<T> {
        let begun = Instant::now();
        let opened = self.opened.as_ref().map_err(Clone::clone)?;
        let mut state = self.state();
        if let Some(gone) = &state.gone {
            return Err(gone.clone());
        }
        let asked = self.ask_once(opened, &mut state, question, exposure);
        let reply = asked.and_then(|(answer, took_us)| match check(answer) {
            Ok(answer) => {
                let passed_us = 1e6 * begun.elapsed().as_secs_f64();
                Ok(Reply {
                    answer,
                    protocol_us: took_us.map_or(0.0, |took_us| passed_us - took_us),
                })
            }
            Err(problem) => Err(self.failure(FailureKind::InvalidAnswer, problem)),
        });
        match &reply {
            Ok(_) => state.failed_in_a_row = 0,
            Err(failure) => {
                state.failed_in_a_row += 1;
                let is_over = failure.kind == FailureKind::VersionChanged;
                if is_over || state.failed_in_a_row >= MOST_IN_A_ROW {
                    state.process = None;
                    let after = if is_over {
                        String::new()
                    } else {
                        format!("; not asked again after {MOST_IN_A_ROW} failures in a row")
                    };
                    let reason = format!("{}{after}", failure.reason);
                    state.gone = Some(Failure { reason, ..failure.clone() });
                }
            }
        }
        reply
    }

    fn ask_once(
        &self,
        opened: &Opened,
        state: &mut State,
        question: Question,
        exposure: Option<&Exposure>,
    ) -> std::result::Result<(Answer, Option<f64>), Failure> {
        if let Some(unmet) = exposure.and_then(|exposure| self.needs.unmet_by(exposure)) {
            return Err(self.failure(FailureKind::NotAvailable, unmet));
        }
        let mut process = match state.process.take() {
            Some(process) => process,
            None => self.start_again(opened)?,
        };
        state.asked += 1;
        let id = state.asked;
        let question = Question { id, ..question };
        let line = match exposure {
            Some(exposure) => {
                let picture = self.show(exposure, &mut state.picture)?;
                let needs = self.needs;
                let question = Question {
                    image: Some(Image::new(picture.file.path(), exposure, needs)),
                    camera: exposure.camera().copied().filter(|_| needs.intrinsics),
                    object_size_m: exposure.object_size_m().filter(|_| needs.object_size),
                    ..question
                };
                serde_json::to_vec(&question)
            }
            None => serde_json::to_vec(&question),
        };
        let line = line.map_err(|error| self.failure(FailureKind::InvalidAnswer, error))?;
        let limit = Duration::from_secs_f64(self.block.time_limit_s);
        let begun = Instant::now();
        let answered = process.ask(line, limit);
        let waited_us = 1e6 * begun.elapsed().as_secs_f64();
        // From here on a process that is not put back ends with all its children.
        let line = answered.map_err(|no_line| {
            let kind = match no_line {
                NoLine::Ended(_) => FailureKind::Crashed,
                NoLine::Late(_) => FailureKind::TimedOut,
                NoLine::Endless => FailureKind::InvalidAnswer,
            };
            self.failure(kind, self.why(&process, no_line))
        })?;
        let invalid = |problem: String| {
            self.failure(FailureKind::InvalidAnswer, process.with_complaint(problem))
        };
        let answer: Answer = read(&line).map_err(invalid)?;
        if answer.id != id {
            return Err(invalid(format!("answered question {} when asked {id}", answer.id)));
        }
        let took_us = answer.took_us;
        if took_us.is_some_and(|took_us| !(0.0..=waited_us).contains(&took_us)) {
            let took_us = took_us.unwrap_or_default();
            return Err(invalid(format!(
                "says that it took {took_us} us, and answered within {waited_us:.0}"
            )));
        }
        let error = answer.error.clone();
        state.process = Some(process);
        match error {
            Some(error) => Err(self.failure(FailureKind::Failed, error)),
            None => Ok((answer, took_us)),
        }
    }

    /// Starts it once more, the same as before.
    fn start_again(&self, opened: &Opened) -> std::result::Result<Process, Failure> {
        let (process, ready) = self
            .greet(&opened.start)
            .map_err(|reason| self.failure(FailureKind::Crashed, reason))?;
        if self.block.sha256() != opened.sha256 {
            let reason = "is another file than when it was first started: measure it again";
            return Err(self.failure(FailureKind::VersionChanged, reason));
        }
        let before = &opened.version;
        let is_same = ready.libraries == before.libraries
            && (!self.block.version_command.is_empty()
                || ready.version.as_ref() == Some(&before.version));
        if is_same {
            return Ok(process);
        }
        let now =
            Version { version: ready.version.unwrap_or_default(), libraries: ready.libraries };
        let reason = format!("was version {before} and is {now} when started again");
        Err(self.failure(FailureKind::VersionChanged, reason))
    }

    /// Writes the samples of an exposure where the program finds them.
    fn show<'a>(
        &self,
        exposure: &Exposure,
        picture: &'a mut Option<Picture>,
    ) -> std::result::Result<&'a Picture, Failure> {
        let failed = |error: std::io::Error| {
            self.failure(
                FailureKind::NotAvailable,
                format!("its picture cannot be written: {error}"),
            )
        };
        let picture = match picture {
            Some(picture) => picture,
            None => {
                picture.insert(Picture { file: shared_file().map_err(failed)?, bytes: Vec::new() })
            }
        };
        self.needs.write(exposure, &mut picture.bytes);
        // Never shortened: a program may have it mapped.
        write_at_start(picture.file.as_file(), &picture.bytes).map_err(failed)?;
        Ok(picture)
    }

    /// Tells a running process that all is asked.
    ///
    /// # Errors
    /// When it then did not end by itself, in time, and well.
    pub fn end(&self) -> std::result::Result<(), Failure> {
        match self.state().process.take() {
            Some(process) => process.end().map_err(|how| {
                self.failure(FailureKind::Crashed, format!("when all was asked it {how}"))
            }),
            None => Ok(()),
        }
    }

    fn why(&self, process: &Process, no_line: NoLine) -> String {
        let Block { time_limit_s, .. } = self.block;
        process.with_complaint(match no_line {
            NoLine::Ended(how) => how,
            NoLine::Late(0) => format!("gave no answer within {time_limit_s} s"),
            NoLine::Late(bytes) => format!(
                "gave no whole line within {time_limit_s} s: {bytes} bytes without a line's end"
            ),
            NoLine::Endless => format!(
                "wrote more than {} MiB without a line's end",
                super::process::LONGEST_LINE >> 20
            ),
        })
    }

    fn with_hint(&self, reason: String) -> String {
        // A missing environment is said with the way to it.
        if self.block.install.is_empty() || reason.ends_with(&self.block.install) {
            reason
        } else {
            format!("{reason}; to install it: {}", self.block.install)
        }
    }

    fn named(&self, reason: &str) -> String {
        format!("{}: {reason}", self.block.name)
    }

    fn failure(&self, kind: FailureKind, reason: impl std::fmt::Display) -> Failure {
        Failure { kind, reason: self.named(&reason.to_string()) }
    }
}

/// A file in memory where the system has such, else a temporary one.
fn shared_file() -> std::io::Result<tempfile::NamedTempFile> {
    let builder = || {
        let mut builder = tempfile::Builder::new();
        builder.prefix("cornerbench-").suffix(".image");
        builder
    };
    let memory = PathBuf::from("/dev/shm");
    match builder().tempfile_in(memory) {
        Ok(file) => Ok(file),
        Err(_) => builder().tempfile(),
    }
}

fn write_at_start(mut file: &File, bytes: &[u8]) -> std::io::Result<()> {
    use std::io::Seek;
    file.rewind()?;
    file.write_all(bytes)
}
