//! A program of the project's scripts: it says what it does, one JSON object a line, until it ends.

use std::io::{BufRead, BufReader, Lines, Read};
use std::marker::PhantomData;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::thread::JoinHandle;

use serde::de::DeserializeOwned;

use super::Ended;
use super::interrupt::{self, Asking};
use crate::error::{Error, Result};

/// Its process. An interrupt asks it to stop; it does not outlive this.
pub(super) struct Script<Event> {
    name: &'static str,
    child: Child,
    events: Lines<BufReader<ChildStdout>>,
    complaints: Option<JoinHandle<String>>,
    _asking: Asking,
    _says: PhantomData<Event>,
}

impl<Event: DeserializeOwned> Script<Event> {
    /// Starts it; `name` is what errors call it.
    ///
    /// # Errors
    /// When it cannot be started.
    pub(super) fn start(name: &'static str, mut command: Command) -> Result<Self> {
        let failed = |problem: String| Error::Program { program: name.into(), problem };
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child =
            command.spawn().map_err(|error| failed(format!("cannot start: {error}")))?;
        let (Some(input), Some(output), Some(mut errors)) =
            (child.stdin.take(), child.stdout.take(), child.stderr.take())
        else {
            return Err(failed("has no input or output".into()));
        };
        let complaints = std::thread::spawn(move || {
            let mut text = Vec::new();
            // What cannot be read of the complaints is not worth an error of its own.
            let _ = errors.read_to_end(&mut text);
            String::from_utf8_lossy(&text).into_owned()
        });
        Ok(Self {
            name,
            child,
            events: BufReader::new(output).lines(),
            complaints: Some(complaints),
            _asking: Asking::through(input)?,
            _says: PhantomData,
        })
    }

    fn failed(&self, problem: String) -> Error {
        Error::Program { program: self.name.into(), problem }
    }

    /// What it says next; `None` when it says no more.
    ///
    /// # Errors
    /// When that is no event.
    pub(super) fn next_event(&mut self) -> Result<Option<Event>> {
        let Some(line) = self.events.next() else { return Ok(None) };
        let line = line.map_err(|error| self.failed(format!("its output broke off: {error}")))?;
        serde_json::from_str(&line)
            .map(Some)
            .map_err(|error| self.failed(format!("said what is no event ({error}): {line}")))
    }

    /// Waits for its end: an error where it refused, or ended as it never says; else `ended`, as its events had it.
    ///
    /// # Errors
    /// See above.
    pub(super) fn end(mut self, refused: Option<String>, ended: Ended) -> Result<Ended> {
        let status = self.child.wait();
        let status =
            status.map_err(|error| self.failed(format!("cannot be waited for: {error}")))?;
        if let Some(message) = refused {
            return Err(Error::Other(message));
        }
        match status.code() {
            Some(0 | 1) => Ok(ended),
            Some(code) if code == i32::from(interrupt::EXIT_CODE) => Ok(Ended::Interrupted),
            code => {
                let complaints = self.complaints.take().and_then(|thread| thread.join().ok());
                let complaints = complaints.unwrap_or_default();
                let lines: Vec<&str> = complaints.lines().collect();
                let last = lines[lines.len().saturating_sub(3)..].join(" | ");
                let code = code.map_or("a signal".to_owned(), |code| format!("exit code {code}"));
                Err(self.failed(format!("ended with {code}: {last}")))
            }
        }
    }
}

impl<Event> Drop for Script<Event> {
    fn drop(&mut self) {
        // Both fail when it has ended already, which is the usual case.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
