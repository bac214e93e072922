//! How far the rendering is: one bar on a terminal, a line for each scene elsewhere.

use std::fmt::Write;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{HumanDuration, ProgressBar, ProgressState, ProgressStyle};

use super::Global;

/// A bar that counts scenes as they are done, shown on a terminal only.
pub(super) fn counting(global: &Global, scenes: usize) -> ProgressBar {
    if global.quiet {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{bar:30} {pos} of {len} (left: {eta})  {wide_msg}");
    let bar = ProgressBar::new(scenes as u64);
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

/// The progress of a number of scenes.
pub(super) struct Progress<'a> {
    global: &'a Global,
    bar: ProgressBar,
    /// When all will be done, as far as that is known.
    end: Arc<Mutex<Option<Instant>>>,
    running: Vec<String>,
}

impl<'a> Progress<'a> {
    /// Before it is known how many there are.
    pub(super) fn new(global: &'a Global) -> Self {
        let bar = if global.quiet { ProgressBar::hidden() } else { ProgressBar::no_length() };
        let style = ProgressStyle::with_template("{spinner} {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()));
        bar.enable_steady_tick(Duration::from_millis(200));
        Self { global, bar, end: Arc::default(), running: Vec::new() }
    }

    /// Says what is going on before there is anything to count.
    pub(super) fn doing(&self, what: &str) {
        self.bar.set_message(what.to_owned());
    }

    /// Begins to count: so many scenes, of which some are there.
    pub(super) fn start(&self, scenes: u64, there: u64) {
        let end = Arc::clone(&self.end);
        let left = move |_: &ProgressState, text: &mut dyn Write| {
            let end = *end.lock().unwrap_or_else(PoisonError::into_inner);
            // What is written into a string cannot fail.
            let _ = text.write_str(&end.map(left_until).unwrap_or_default());
        };
        let style = ProgressStyle::with_template("{bar:30} {pos} of {len}{left}  {wide_msg}");
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        self.bar.set_style(style.with_key("left", left));
        self.bar.set_message("");
        self.bar.set_length(scenes);
        self.bar.set_position(there);
        self.bar.reset_eta();
    }

    /// A scene is begun with.
    pub(super) fn begin(&mut self, scene: String) {
        self.running.push(scene);
        self.bar.set_message(self.running.join(", "));
    }

    /// A scene is done or has failed; `left_s` is the time that the others will take \[s\].
    pub(super) fn end(&mut self, scene: &str, left_s: Option<f64>) {
        self.running.retain(|running| running != scene);
        self.bar.set_message(self.running.join(", "));
        let left = left_s.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        *self.end.lock().unwrap_or_else(PoisonError::into_inner) =
            left.map(|left| Instant::now() + left);
        self.bar.inc(1);
    }

    /// Says what became of a scene, where no bar shows it: "17 of 200, about 35 minutes left".
    pub(super) fn tell_done(&self, what: &str) {
        if self.bar.is_hidden() {
            let end = *self.end.lock().unwrap_or_else(PoisonError::into_inner);
            self.global.say(format!(
                "{what} ({} of {}{})",
                self.bar.position(),
                self.bar.length().unwrap_or_default(),
                end.map(left_until).unwrap_or_default(),
            ));
        }
    }

    /// Says what a person should know, whether or not there is a bar.
    pub(super) fn tell(&self, what: &str) {
        self.bar.suspend(|| self.global.say(what));
    }

    /// Says what went wrong, even where nothing else is to be said.
    pub(super) fn tell_failure(&self, what: &str) {
        self.bar.suspend(|| eprintln!("{what}"));
    }
}

impl Drop for Progress<'_> {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

fn left_until(end: Instant) -> String {
    let left = end.saturating_duration_since(Instant::now());
    if left < Duration::from_secs(1) {
        String::new()
    } else {
        format!(", about {} left", HumanDuration(left))
    }
}
