//! What a run has done so far: a file of each scene, until all are there.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use serde::{Deserialize, Serialize};

use super::Shard;
use crate::error::{Error, Result};
use crate::files::write_json;
use crate::record::TIMING_FILE;

/// Says what a folder of parts is of.
const MANIFEST: &str = "unfinished.json";
/// Where they are.
const FOLDER: &str = "parts";
/// Where is what other programs said on standard error.
pub(super) const LOGS: &str = "programs";
/// What a run's folder has beside them.
const FOLDERS: [&str; 4] = ["scenes", "report", "recommendation", LOGS];
const FILES: [&str; 4] = ["run.json", "records.parquet", "summary.json", TIMING_FILE];

/// What decides whether parts may be taken over.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Manifest {
    identity_sha256: String,
    shard: Option<String>,
    /// Size and time of the program's file: another build may measure otherwise.
    program: String,
}

/// The parts of a run.
pub(super) struct Parts {
    output: PathBuf,
}

impl Parts {
    /// Takes over the parts in a run's folder that are of the same run, or begins anew.
    ///
    /// # Errors
    /// When the folder is not a run's, or cannot be written.
    pub fn open(output: &Path, identity: &str, shard: Option<Shard>) -> Result<Self> {
        let manifest = output.join(MANIFEST);
        let is_run = manifest.is_file() || output.join("run.json").is_file();
        if let Some(other) = FOLDERS.iter().find(|name| !is_run && output.join(name).exists()) {
            return Err(Error::Other(format!(
                "{}: holds {other}, but no run.json: it is not a run and would be overwritten; choose \
                 another folder with -o",
                output.display()
            )));
        }
        let wanted = Manifest {
            identity_sha256: identity.to_owned(),
            shard: shard.map(|shard| shard.to_string()),
            program: program(),
        };
        let found = fs::read(&manifest).ok();
        let found = found.and_then(|bytes| serde_json::from_slice::<Manifest>(&bytes).ok());
        if found.as_ref() != Some(&wanted) {
            for name in FOLDERS.into_iter().chain([FOLDER]) {
                let path = output.join(name);
                if path.exists() {
                    fs::remove_dir_all(&path).map_err(Error::io(&path, "replace"))?;
                }
            }
            for name in FILES {
                let path = output.join(name);
                if path.exists() {
                    fs::remove_file(&path).map_err(Error::io(&path, "replace"))?;
                }
            }
            write_json(&manifest, &wanted)?;
        }
        Ok(Self { output: output.to_owned() })
    }

    /// The file of what went wrong when all scenes were measured. No scene's name has a dot at its beginning.
    pub fn end_path(&self) -> PathBuf {
        self.output.join(FOLDER).join(".end.parquet")
    }

    /// The file of a scene's rows.
    pub fn path(&self, scene: &str) -> PathBuf {
        self.output.join(FOLDER).join(format!("{scene}.parquet"))
    }

    /// Removes them: all is in one file.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn close(self) -> Result<()> {
        let manifest = self.output.join(MANIFEST);
        fs::remove_file(&manifest).map_err(Error::io(&manifest, "remove"))?;
        let folder = self.output.join(FOLDER);
        if folder.exists() {
            fs::remove_dir_all(&folder).map_err(Error::io(&folder, "remove"))?;
        }
        Ok(())
    }
}

fn program() -> String {
    let metadata = std::env::current_exe().and_then(fs::metadata);
    let changed = |metadata: &fs::Metadata| {
        let since = metadata.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
        Some(since.as_nanos())
    };
    metadata.map_or_else(
        |_| String::new(),
        |metadata| format!("{} bytes, {:?}", metadata.len(), changed(&metadata)),
    )
}
