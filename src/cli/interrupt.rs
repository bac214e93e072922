//! Ctrl-C and termination while another program works: that program is asked to come to an end.

use std::process::ChildStdin;
use std::sync::{Mutex, MutexGuard, Once, PoisonError};

use crate::error::{Error, Result};

/// The exit code of a program that was interrupted.
pub(super) const EXIT_CODE: u8 = 130;

static INPUT: Mutex<Option<ChildStdin>> = Mutex::new(None);

fn input() -> MutexGuard<'static, Option<ChildStdin>> {
    INPUT.lock().unwrap_or_else(PoisonError::into_inner)
}

/// As long as this lives, an interrupt closes a program's standard input, which it takes as the wish
/// to stop, and a second one ends this process. So does the end of this process in any other way.
pub(super) struct Asking(());

impl Asking {
    /// Takes the input of the program that is to be asked.
    ///
    /// # Errors
    /// When the operating system does not let signals be handled.
    pub(super) fn through(program_input: ChildStdin) -> Result<Self> {
        static HANDLED: Once = Once::new();
        let mut handled = Ok(());
        HANDLED.call_once(|| {
            handled = ctrlc::set_handler(|| {
                if input().take().is_none() {
                    std::process::exit(i32::from(EXIT_CODE));
                }
            });
        });
        handled.map_err(|error| Error::Other(format!("cannot handle interrupts: {error}")))?;
        *input() = Some(program_input);
        Ok(Self(()))
    }
}

impl Drop for Asking {
    fn drop(&mut self) {
        input().take();
    }
}
