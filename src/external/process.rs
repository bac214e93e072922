//! A program that is sent lines and answers with lines, each within a time; it ends with all that it started.
//!
//! Who asks reads and writes by itself, as every thread between would cost the program's turn a tenth of a millisecond. A
//! guard ends the program at its deadline: then reading ends, too, even where something that it started cannot be ended and
//! has its pipes still.

use std::collections::VecDeque;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Write};
use std::process::{ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

#[cfg(windows)]
use process_wrap::std::JobObject;
#[cfg(unix)]
use process_wrap::std::ProcessGroup;
use process_wrap::std::{ChildWrapper, CommandWrap};

use super::log::Log;

/// The longest line that is read \[bytes\]: some hundred thousand corners.
pub(super) const LONGEST_LINE: usize = 32 << 20;
/// Of what a program says on standard error so much is remembered \[bytes\].
const REMEMBERED: usize = 4096;
/// How long a program that was told to end may take.
const ENDING: Duration = Duration::from_secs(5);
/// How long the guard may take to end a program.
const GRACE: Duration = Duration::from_millis(200);
/// So many bytes a pipe takes at once when it takes any.
const PART: usize = 4096;
/// How often the guard looks at the clock.
const TICK: Duration = Duration::from_millis(5);
/// The variable by which everything is found that a program started, wherever it has gone.
const MARK: &str = "CORNERBENCH_PROGRAM";

/// Why there is no answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum NoLine {
    /// The program ended: how.
    Ended(String),
    /// There was none in time; so many bytes of a line that did not end.
    Late(usize),
    /// More bytes than [`LONGEST_LINE`] without an end of line.
    Endless,
}

/// A running program.
pub(super) struct Process {
    guard: Arc<Guard>,
    id: u32,
    /// None once it was told to end.
    input: Option<ChildStdin>,
    output: Option<BufReader<ChildStdout>>,
    complaint: Arc<Mutex<VecDeque<u8>>>,
    /// Listens to its complaints.
    listener: Option<JoinHandle<()>>,
}

/// What may end a program.
struct Guard {
    child: Mutex<Box<dyn ChildWrapper>>,
    mark: OsString,
    /// When it ends it.
    deadline: Mutex<Option<Instant>>,
    /// Whether it did.
    has_ended_it: AtomicBool,
    /// Whether there is nothing left to guard.
    is_over: AtomicBool,
}

impl Process {
    /// Starts a program, as the head of a group of its own with all that it starts.
    pub fn start(mut command: Command, log: &Arc<Log>) -> std::io::Result<Self> {
        static STARTED: AtomicU64 = AtomicU64::new(0);
        let number = STARTED.fetch_add(1, Ordering::Relaxed);
        let mark = format!("{}-{number}", std::process::id());
        command.env(MARK, &mark);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut command = CommandWrap::from(command);
        #[cfg(unix)]
        command.wrap(ProcessGroup::leader());
        #[cfg(windows)]
        command.wrap(JobObject);
        let mut child = command.spawn()?;
        let complaint = Arc::default();
        let listener = child.stderr().take().map(|stderr| {
            let (complaint, log) = (Arc::clone(&complaint), Arc::clone(log));
            thread::spawn(move || remember(stderr, &complaint, &log))
        });
        let (id, input) = (child.id(), child.stdin().take());
        let output = child.stdout().take().map(BufReader::new);
        let guard = Arc::new(Guard {
            child: Mutex::new(child),
            mark: format!("{MARK}={mark}").into(),
            deadline: Mutex::default(),
            has_ended_it: AtomicBool::new(false),
            is_over: AtomicBool::new(false),
        });
        let guarding = Arc::clone(&guard);
        thread::spawn(move || guarding.watch());
        Ok(Self { guard, id, input, output, complaint, listener })
    }

    /// The number by which the operating system knows it.
    pub fn id(&self) -> u32 {
        self.id
    }

    /// Sends a line and waits for the next one.
    pub fn ask(&mut self, mut line: Vec<u8>, limit: Duration) -> Result<Vec<u8>, NoLine> {
        line.push(b'\n');
        self.guard.set(Some(limit));
        let deadline = Instant::now() + limit;
        for part in line.chunks(PART) {
            // Where it has ended nobody takes the line, and its output says so.
            let Some(input) = &mut self.input else { break };
            if !pipe::takes(input, deadline) || input.write_all(part).is_err() {
                break;
            }
        }
        self.line_until(deadline)
    }

    /// Waits for its next line.
    pub fn line(&mut self, limit: Duration) -> Result<Vec<u8>, NoLine> {
        self.guard.set(Some(limit));
        self.line_until(Instant::now() + limit)
    }

    fn line_until(&mut self, deadline: Instant) -> Result<Vec<u8>, NoLine> {
        let mut line = Vec::new();
        let read = match &mut self.output {
            Some(output) => read_line(output, &mut line, deadline + GRACE),
            None => Read::Ended,
        };
        self.guard.set(None);
        match read {
            Read::Line => Ok(line),
            Read::Endless => Err(NoLine::Endless),
            Read::Ended if self.guard.has_ended_it() => Err(NoLine::Late(line.len())),
            Read::Ended => Err(NoLine::Ended(self.how_it_ended())),
        }
    }

    /// Tells it that nothing more comes, and waits for its end.
    ///
    /// # Errors
    /// How it ended, unless by itself, in time, and well.
    pub fn end(mut self) -> Result<(), String> {
        self.input = None;
        self.guard.set(Some(ENDING));
        // What it still says answers no question.
        let deadline = Instant::now() + ENDING;
        while let Some(output) = &mut self.output {
            let mut line = Vec::new();
            if matches!(read_line(output, &mut line, deadline + GRACE), Read::Ended) {
                break;
            }
        }
        let status = self.wait(ENDING);
        self.guard.set(None);
        match status.filter(|_| !self.guard.has_ended_it()) {
            Some(status) if status.success() => Ok(()),
            Some(status) => Err(self.with_complaint(said(status))),
            None => {
                let limit_s = ENDING.as_secs();
                Err(self
                    .with_complaint(format!("did not end within {limit_s} s when its input ended")))
            }
        }
    }

    /// Its words, and behind them the last that it said on standard error.
    pub fn with_complaint(&self, words: String) -> String {
        let kept = locked(&self.complaint);
        let bytes: Vec<u8> = kept.iter().copied().collect();
        let text = String::from_utf8_lossy(&bytes);
        match text.lines().rev().map(str::trim).find(|line| !line.is_empty()) {
            Some(complaint) => format!("{words}; the last it said: {complaint}"),
            None => words,
        }
    }

    /// How it ended that closed its output.
    fn how_it_ended(&mut self) -> String {
        match self.wait(Duration::from_secs(1)) {
            Some(status) => said(status),
            None => "closed its standard output".to_owned(),
        }
    }

    /// How it ended, within a time; by then all is heard that it said.
    fn wait(&mut self, limit: Duration) -> Option<ExitStatus> {
        let begun = Instant::now();
        let status = loop {
            match locked(&self.guard.child).try_wait() {
                Ok(Some(status)) => break status,
                _ if begun.elapsed() >= limit => return None,
                _ => {}
            }
            thread::sleep(Duration::from_millis(2));
        };
        // Not for ever: what it started may have its standard error still.
        let ended = Instant::now();
        while self.listener.as_ref().is_some_and(|listener| !listener.is_finished())
            && ended.elapsed() < Duration::from_millis(200)
        {
            thread::sleep(Duration::from_millis(2));
        }
        Some(status)
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.guard.is_over.store(true, Ordering::Relaxed);
        self.guard.end_all();
        // It was ended, so that this is soon over.
        let _ = locked(&self.guard.child).wait();
    }
}

impl Guard {
    fn set(&self, limit: Option<Duration>) {
        *locked(&self.deadline) = limit.map(|limit| Instant::now() + limit);
    }

    fn has_ended_it(&self) -> bool {
        self.has_ended_it.load(Ordering::Relaxed)
    }

    fn watch(&self) {
        while !self.is_over.load(Ordering::Relaxed) {
            thread::sleep(TICK);
            let mut deadline = locked(&self.deadline);
            let Some(at) = *deadline else { continue };
            let is_late = Instant::now() >= at;
            if is_late {
                self.has_ended_it.store(true, Ordering::Relaxed);
            }
            // What an ended program has started may have its output still, and it would be read for ever.
            let has_ended = matches!(locked(&self.child).try_wait(), Ok(Some(_)));
            if is_late || has_ended {
                self.end_all();
                *deadline = None;
            }
        }
    }

    /// Ends the program's group, even where the program itself has ended, and what has left the group.
    fn end_all(&self) {
        // Of a group of which nobody is left this fails, and nothing is to be done.
        let _ = locked(&self.child).start_kill();
        end_marked(&self.mark);
    }
}

/// Ends all processes that have the mark: a daemon has its starter's environment, if neither its group nor its session.
#[cfg(target_os = "linux")]
fn end_marked(mark: &std::ffi::OsStr) {
    use std::os::unix::ffi::OsStrExt;

    use rustix::process::{Pid, Signal, kill_process};

    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let numbers = processes.filter_map(|entry| entry.file_name().to_str()?.parse::<i32>().ok());
    for number in numbers {
        // Others' environments cannot be read, and are not ours to end.
        let Ok(environment) = std::fs::read(format!("/proc/{number}/environ")) else { continue };
        if environment.split(|byte| *byte == 0).any(|variable| variable == mark.as_bytes())
            && let Some(id) = Pid::from_raw(number)
        {
            let _ = kill_process(id, Signal::KILL);
        }
    }
}

#[cfg(not(target_os = "linux"))]
fn end_marked(_: &std::ffi::OsStr) {}

/// Pipes that are not waited for any longer than until a time.
#[cfg(unix)]
mod pipe {
    use std::os::fd::AsFd;
    use std::time::Instant;

    use rustix::event::{PollFd, PollFlags, Timespec, poll};

    /// Whether something can be read, or never again.
    pub(super) fn gives(pipe: &impl AsFd, deadline: Instant) -> bool {
        is_ready(pipe, PollFlags::IN, deadline)
    }

    /// Whether something can be written, or never again.
    pub(super) fn takes(pipe: &impl AsFd, deadline: Instant) -> bool {
        is_ready(pipe, PollFlags::OUT, deadline)
    }

    fn is_ready(pipe: &impl AsFd, what: PollFlags, deadline: Instant) -> bool {
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let left = Timespec::try_from(left).ok();
            match poll(&mut [PollFd::new(pipe, what)], left.as_ref()) {
                Ok(count) => return count > 0,
                Err(rustix::io::Errno::INTR) => {}
                Err(_) => return false,
            }
        }
    }
}

/// Where a job ends with everything in it no pipe is left.
#[cfg(not(unix))]
mod pipe {
    use std::time::Instant;

    pub(super) fn gives<T>(_: &T, _: Instant) -> bool {
        true
    }

    pub(super) fn takes<T>(_: &T, _: Instant) -> bool {
        true
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn said(status: ExitStatus) -> String {
    match status.code() {
        Some(code) => format!("ended with exit code {code}"),
        None => format!("ended: {status}"),
    }
}

/// What reading came to.
enum Read {
    Line,
    Ended,
    Endless,
}

/// Reads a line without its end, no longer than [`LONGEST_LINE`].
fn read_line(output: &mut BufReader<ChildStdout>, line: &mut Vec<u8>, deadline: Instant) -> Read {
    loop {
        if output.buffer().is_empty() && !pipe::gives(output.get_ref(), deadline) {
            return Read::Ended;
        }
        let bytes = match output.fill_buf() {
            Ok([]) | Err(_) => return Read::Ended,
            Ok(bytes) => bytes,
        };
        let end = bytes.iter().position(|byte| *byte == b'\n');
        line.extend_from_slice(&bytes[..end.unwrap_or(bytes.len())]);
        let taken = end.map_or(bytes.len(), |end| end + 1);
        output.consume(taken);
        if end.is_some() {
            return Read::Line;
        }
        if line.len() > LONGEST_LINE {
            return Read::Endless;
        }
    }
}

/// Keeps the last of what a program says, and logs it.
fn remember(mut stderr: impl std::io::Read, kept: &Mutex<VecDeque<u8>>, log: &Log) {
    let mut bytes = [0; 1024];
    while let Ok(count @ 1..) = stderr.read(&mut bytes) {
        log.hear(&bytes[..count]);
        let mut kept = locked(kept);
        kept.extend(&bytes[..count]);
        let excess = kept.len().saturating_sub(REMEMBERED);
        kept.drain(..excess);
    }
}
