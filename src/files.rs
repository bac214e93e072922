//! Files that appear whole or not at all.

use std::path::Path;

use serde::Serialize;
use sha2::{Digest, Sha256};

use crate::error::{Error, Result};

/// Has `write` make a temporary file or folder beside `path`, then renames it to `path`, in place of the
/// file or folder that may be there.
///
/// # Errors
/// What `write` returns, or [`Error::Io`]; then `path` is as it was.
pub fn write_whole(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(Error::io(folder, "create"))?;
    let temporary = tempfile::Builder::new()
        .prefix(".unfinished-")
        .tempdir_in(folder)
        .map_err(Error::io(folder, "write into"))?;
    let name = path.file_name().unwrap_or_default();
    let unfinished = temporary.path().join(name);
    write(&unfinished)?;
    // A folder cannot be renamed onto one that holds something: the old one steps aside first.
    let aside = temporary.path().join(".replaced");
    let replaces = path.is_dir();
    if replaces {
        std::fs::rename(path, &aside).map_err(Error::io(path, "replace"))?;
    }
    std::fs::rename(&unfinished, path).map_err(|error| {
        if replaces {
            // Where this fails, too, nothing more can be done for it.
            let _ = std::fs::rename(&aside, path);
        }
        Error::io(path, "write")(error)
    })
}

/// SHA-256 in hexadecimal.
pub fn sha256_hex(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Writes `content` as JSON, whole or not at all.
///
/// # Errors
/// [`Error::Io`].
pub fn write_json(path: &Path, content: &impl Serialize) -> Result<()> {
    let mut text =
        serde_json::to_string_pretty(content).map_err(|error| Error::malformed(path, error))?;
    text.push('\n');
    write_whole(path, |temporary| {
        std::fs::write(temporary, &text).map_err(Error::io(temporary, "write"))
    })
}

/// Refuses a folder that holds something, but not the file `manifest` which marks it as what this
/// program writes, `kind`: "an export".
///
/// # Errors
/// When it is such a folder: it would be overwritten.
pub fn refuse_foreign(folder: &Path, manifest: &str, kind: &str) -> Result<()> {
    let is_free = match std::fs::read_dir(folder) {
        Ok(mut entries) => entries.next().is_none() || folder.join(manifest).is_file(),
        Err(error) => error.kind() == std::io::ErrorKind::NotFound,
    };
    if is_free {
        return Ok(());
    }
    Err(Error::Other(format!(
        "{}: is there, but holds no {manifest}: it is not {kind} and would be overwritten; choose \
         another folder with -o",
        folder.display()
    )))
}

/// Makes `path` a new, empty folder in place of the one that may be there.
///
/// # Errors
/// [`Error::Io`].
pub fn replace_folder(path: &Path) -> Result<()> {
    if path.exists() {
        std::fs::remove_dir_all(path).map_err(Error::io(path, "replace"))?;
    }
    std::fs::create_dir_all(path).map_err(Error::io(path, "create"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a.json");
        write_whole(&path, |file| std::fs::write(file, "old").map_err(Error::io(file, "write")))
            .expect("written");
        let failed = write_whole(&path, |file| {
            std::fs::write(file, "half").map_err(Error::io(file, "write"))?;
            Err(Error::Other("interrupted".into()))
        });
        assert!(failed.is_err());
        assert_eq!(std::fs::read_to_string(&path).expect("there"), "old");
        assert_eq!(std::fs::read_dir(folder.path()).expect("there").count(), 1);
    }

    #[test]
    fn a_folder_is_replaced_whole_or_stays() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a");
        let with = |name: &'static str| {
            move |folder: &Path| {
                std::fs::create_dir(folder).map_err(Error::io(folder, "create"))?;
                std::fs::write(folder.join(name), "").map_err(Error::io(folder, "write"))
            }
        };
        write_whole(&path, with("old")).expect("written");
        let failed = write_whole(&path, |folder| {
            with("half")(folder)?;
            Err(Error::Other("interrupted".into()))
        });
        assert!(failed.is_err());
        assert!(path.join("old").is_file() && !path.join("half").exists());
        write_whole(&path, with("new")).expect("written");
        assert!(path.join("new").is_file() && !path.join("old").exists());
        assert_eq!(std::fs::read_dir(folder.path()).expect("there").count(), 1);
    }
}
