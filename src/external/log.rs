//! All that a program says on standard error, in a file.

use std::fs::OpenOptions;
use std::io::Write;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// So much of it is kept \[bytes\].
const KEPT: usize = 1 << 20;

/// What a program says on standard error: kept in memory until it is known where, then in a file.
#[derive(Default)]
pub(super) struct Log {
    kept: Mutex<Kept>,
}

#[derive(Default)]
struct Kept {
    file: Option<PathBuf>,
    waiting: Vec<u8>,
    count: usize,
}

impl Log {
    /// Keeps what it said, and what it will say, behind what is in the file.
    pub fn keep_in(&self, file: PathBuf) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.file = Some(file);
        kept.write();
    }

    pub fn hear(&self, bytes: &[u8]) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let left = KEPT - kept.count;
        let bytes = &bytes[..bytes.len().min(left)];
        kept.count += bytes.len();
        kept.waiting.extend_from_slice(bytes);
        kept.write();
    }
}

impl Kept {
    /// No log is no reason to measure nothing: what cannot be written is let go.
    fn write(&mut self) {
        let Some(path) = self.file.as_deref().filter(|_| !self.waiting.is_empty()) else { return };
        let folder = path.parent().map_or(Ok(()), std::fs::create_dir_all);
        let file = folder.and_then(|()| OpenOptions::new().append(true).create(true).open(path));
        let _ = file.and_then(|mut file| file.write_all(&self.waiting));
        self.waiting.clear();
    }
}

#[cfg(test)]
mod tests {
    use std::fs::read;

    use super::*;

    #[test]
    fn what_was_said_before_is_first_in_the_file_and_all_is_no_more_than_is_kept() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("programs/mine.log");
        let log = Log::default();
        log.hear(b"before, ");
        log.keep_in(file.clone());
        assert_eq!(read(&file).expect("a file"), b"before, ");
        log.hear(b"after");
        assert_eq!(read(&file).expect("a file"), b"before, after");
        log.hear(&vec![b'.'; KEPT]);
        log.hear(b"too much");
        assert_eq!(read(&file).expect("a file").len(), KEPT);
    }
}
