//! Where the recipes and the renderer's scripts are.

use std::path::{Path, PathBuf};

use super::Global;
use crate::error::{Error, Result};

/// The project's folder: the nearest one at or above the current folder that holds `scenes/suites`
/// and `scripts/cornerscenes`, else the one that this program was built in.
///
/// # Errors
/// When neither holds them.
pub(super) fn root() -> Result<PathBuf> {
    let is_project = |folder: &Path| {
        folder.join("scenes/suites").is_dir() && folder.join("scripts/cornerscenes").is_dir()
    };
    let here = std::env::current_dir().map_err(Error::io(Path::new("."), "read"))?;
    here.ancestors()
        .chain([Path::new(env!("CARGO_MANIFEST_DIR"))])
        .find(|folder| is_project(folder))
        .map(Path::to_owned)
        .ok_or_else(|| {
            Error::Other(
                "no scenes/suites and scripts/cornerscenes here or in a folder above; run \
                 cornerbench inside its repository"
                    .to_owned(),
            )
        })
}

/// The folder of recipes: the one given, else the project's own.
pub(super) fn recipes(global: &Global) -> Result<PathBuf> {
    match &global.recipes {
        Some(folder) => std::path::absolute(folder).map_err(Error::io(folder, "find")),
        None => Ok(root()?.join("scenes")),
    }
}
