//! Recipes: TOML files by folder and name.

use std::fs;
use std::path::Path;

use toml::Table;

use crate::error::{Error, Result};
use crate::registry;
use crate::sensor::{CameraModel, Photographer, RangeSensor};

/// Reads `cameras/NAME.toml` in the folder of recipes, and the files it names.
///
/// # Errors
/// For an unknown name or key, or a value out of range: with file, key, found, allowed.
pub fn read_camera(recipes: &Path, name: &str) -> Result<Photographer> {
    let (place, table) = read_table(recipes, "cameras", name)?;
    let model: CameraModel = registry::parameters(&place, &table)?;
    model.check(&place)?;
    let psf = model.read_psf(&recipes.join("cameras"))?;
    Ok(Photographer::new(name, &model, psf.as_ref()))
}

/// Reads `range-sensors/NAME.toml` in the folder of recipes.
///
/// # Errors
/// For an unknown name or key, or a value out of range: with file, key, found, allowed.
pub fn read_range_sensor(recipes: &Path, name: &str) -> Result<RangeSensor> {
    let (place, table) = read_table(recipes, "range-sensors", name)?;
    let sensor: RangeSensor = registry::parameters(&place, &table)?;
    sensor.check(&place)?;
    Ok(sensor)
}

/// The names of the recipes in a folder, sorted.
pub fn recipe_names(recipes: &Path, folder: &str) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(recipes.join(folder))
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .filter_map(|path| Some(path.file_stem()?.to_str()?.to_owned()))
        .collect();
    names.sort();
    names
}

/// The table of one recipe file, and the words that name the file in messages.
///
/// # Errors
/// For an unknown name, or a file that is not TOML.
pub fn read_table(recipes: &Path, folder: &str, name: &str) -> Result<(String, Table)> {
    let known = recipe_names(recipes, folder);
    if !known.iter().any(|one| one == name) {
        return Err(Error::UnknownName {
            place: recipes.join(folder).display().to_string(),
            kind: folder.trim_end_matches('s').replace('-', " "),
            found: name.to_owned(),
            known,
        });
    }
    let path = recipes.join(folder).join(format!("{name}.toml"));
    let text = fs::read_to_string(&path).map_err(Error::io(&path, "read"))?;
    let table = text
        .parse()
        .map_err(|error: toml::de::Error| Error::malformed(&path, error.to_string()))?;
    Ok((path.display().to_string(), table))
}
