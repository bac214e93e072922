//! Corners that were computed elsewhere: a CSV or JSON file of answers to photographs.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use nalgebra::Matrix2;
use serde::Deserialize;

use super::block::legal;
use super::program::{Failure, FailureKind};
use crate::detect::Detection;
use crate::error::{Error, Result};
use crate::files::sha256_hex;
use crate::geometry::ImagePoint;
use crate::refine::{Corner, RefineStatus};

/// Corners that were computed elsewhere.
#[derive(Debug)]
pub struct AnswerFile {
    name: String,
    path: PathBuf,
    version: String,
    sha256: String,
    /// By camera, where the file names any, scene and exposure; with its first row.
    photographs: HashMap<Photograph, (usize, Vec<Corner>)>,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Photograph {
    camera: Option<String>,
    scene: String,
    exposure: u32,
}

/// One answer as files have it; one without a place says that nothing was found.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    scene: String,
    version: String,
    x_px: Option<f64>,
    y_px: Option<f64>,
    #[serde(default)]
    camera: Option<String>,
    /// A whole number: pandas writes 0.0 where others are missing.
    #[serde(default)]
    exposure: Option<f64>,
    #[serde(default)]
    response: Option<f64>,
    #[serde(default)]
    covariance_xx_px2: Option<f64>,
    #[serde(default)]
    covariance_xy_px2: Option<f64>,
    #[serde(default)]
    covariance_yy_px2: Option<f64>,
}

/// Whether a file is one of answers by its name.
pub fn is_answer_file(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "csv" || extension == "json")
}

impl AnswerFile {
    /// Reads a file.
    ///
    /// CSV (RFC 4180), its first line the names of its columns in any order, or JSON, an array of objects with these
    /// keys: `scene`, `version`, `x_px`, `y_px`, and if need be `camera`, `exposure` (0 where it is missing), `response`
    /// and `covariance_xx_px2`, `covariance_xy_px2`, `covariance_yy_px2`.
    ///
    /// # Errors
    /// With file and row, what was found and what is allowed.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = std::fs::read(path).map_err(Error::io(path, "read"))?;
        let rows: Vec<Row> = if path.extension().is_some_and(|extension| extension == "json") {
            serde_json::from_slice(&bytes).map_err(|error| Error::malformed(path, error))?
        } else {
            csv_rows(path, &bytes)?
        };
        let Some(version) = rows.first().map(|row| row.version.clone()) else {
            return Err(Error::malformed(path, "holds no answer"));
        };
        let mut photographs: HashMap<Photograph, (usize, Vec<Corner>)> = HashMap::new();
        for (number, row) in rows.into_iter().enumerate() {
            let place = format!("{}: row {}", path.display(), number + 1);
            if row.version != version || version.is_empty() {
                let found = format!("{:?}", row.version);
                let allowed = "one and the same text in all rows: what computed these answers";
                return Err(Error::out_of_range(place, "version", found, allowed));
            }
            let photograph = Photograph {
                camera: row.camera.clone().filter(|camera| !camera.is_empty()),
                scene: row.scene.clone(),
                exposure: row.exposure(&place)?,
            };
            let (_, corners) = photographs.entry(photograph).or_insert((number + 1, Vec::new()));
            corners.extend(row.corner(&place)?);
        }
        for (_, corners) in photographs.values_mut() {
            corners.sort_by(|a, b| b.seed.response.total_cmp(&a.seed.response));
        }
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let sha256 = sha256_hex(&bytes);
        Ok(Self { name: legal(&name), path: path.to_owned(), version, sha256, photographs })
    }

    /// What plans and records call it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What computed it.
    pub fn version(&self) -> &str {
        &self.version
    }

    /// Hash of its content.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }

    /// Where it was read from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Refuses answers to photographs that there are not.
    ///
    /// # Errors
    /// With the first such row, and the nearest name.
    pub fn check(&self, scenes: &[&str], cameras: &[&str]) -> Result<()> {
        let mut photographs: Vec<(&Photograph, usize)> =
            self.photographs.iter().map(|(photograph, (row, _))| (photograph, *row)).collect();
        photographs.sort_by_key(|(_, row)| *row);
        for (photograph, row) in photographs {
            let unknown = |kind: &str, found: &str, known: &[&str]| Error::UnknownName {
                place: format!("{}: row {row}", self.path.display()),
                kind: kind.to_owned(),
                found: found.to_owned(),
                known: known.iter().map(|&name| name.to_owned()).collect(),
            };
            if !scenes.contains(&photograph.scene.as_str()) {
                return Err(unknown("scene", &photograph.scene, scenes));
            }
            match &photograph.camera {
                Some(camera) if !cameras.contains(&camera.as_str()) => {
                    return Err(unknown("camera", camera, cameras));
                }
                None if cameras.len() > 1 => {
                    return Err(Error::Other(format!(
                        "{}: row {row} names no camera, and there are several: {}; add a column camera",
                        self.path.display(),
                        cameras.join(", ")
                    )));
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// The answers to a photograph, strongest first.
    ///
    /// # Errors
    /// When the file has none, not even that nothing was found.
    pub fn answers(
        &self,
        camera: &str,
        scene: &str,
        exposure: u32,
    ) -> std::result::Result<Vec<Corner>, Failure> {
        let scene = scene.to_owned();
        let of = |camera: Option<String>| {
            self.photographs.get(&Photograph { camera, scene: scene.clone(), exposure })
        };
        let found = of(Some(camera.to_owned())).or_else(|| of(None));
        found.map(|(_, corners)| corners.clone()).ok_or_else(|| Failure {
            kind: FailureKind::NotAvailable,
            reason: format!(
                "{}: the file says nothing of scene {scene}, camera {camera}, exposure {exposure}; where nothing was found \
                 add a row without x_px and y_px",
                self.name
            ),
        })
    }
}

/// The rows of a CSV file.
fn csv_rows(path: &Path, bytes: &[u8]) -> Result<Vec<Row>> {
    let malformed = |error: csv::Error| Error::malformed(path, error);
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(bytes);
    let columns = reader.headers().map_err(malformed)?.clone();
    let mut rows = Vec::new();
    for (number, record) in reader.records().enumerate() {
        let record = record.map_err(malformed)?;
        let row = record.deserialize(Some(&columns)).map_err(|error| {
            let csv::ErrorKind::Deserialize { err, .. } = error.kind() else {
                return malformed(error);
            };
            let field = err.field().and_then(|field| usize::try_from(field).ok());
            let place = field.and_then(|field| columns.get(field).zip(record.get(field)));
            let place = place.map(|(column, found)| format!("{column} is {found:?}: "));
            let place = format!("row {}: {}", number + 1, place.unwrap_or_default());
            Error::malformed(path, format!("{place}{}", err.kind()))
        });
        rows.push(row?);
    }
    Ok(rows)
}

impl Row {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked")]
    fn exposure(&self, place: &str) -> Result<u32> {
        let exposure = self.exposure.unwrap_or(0.0);
        if exposure.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&exposure) {
            return Ok(exposure as u32);
        }
        Err(Error::out_of_range(place, "exposure", exposure, "a whole number from 0 on"))
    }

    fn corner(&self, place: &str) -> Result<Option<Corner>> {
        let refuse = |key: &str, found: String, allowed: &str| {
            Err(Error::out_of_range(place, key, found, allowed))
        };
        let (x, y) = match (self.x_px, self.y_px) {
            (None, None) => return Ok(None),
            (Some(x), Some(y)) => (x, y),
            (x, _) => {
                let missing = if x.is_none() { "x_px" } else { "y_px" };
                return refuse(missing, "missing".to_owned(), "there, or neither");
            }
        };
        let response = self.response.unwrap_or(0.0);
        for (key, value) in [("x_px", x), ("y_px", y), ("response", response)] {
            if !value.is_finite() {
                return refuse(key, value.to_string(), "a finite number");
            }
        }
        let covariance_px2 =
            match (self.covariance_xx_px2, self.covariance_xy_px2, self.covariance_yy_px2) {
                (None, None, None) => None,
                (Some(xx), Some(xy), Some(yy)) => Some(Matrix2::new(xx, xy, xy, yy)),
                _ => return refuse("covariance", "not whole".to_owned(), "xx, xy and yy, or none"),
            };
        if covariance_px2.is_some_and(|m| !(m.determinant() >= 0.0 && m.trace() > 0.0)) {
            return refuse("covariance", "none".to_owned(), "such that xx yy is at least xy^2");
        }
        let position = ImagePoint::new(x, y);
        Ok(Some(Corner {
            seed: Detection::new(position, response),
            position,
            covariance_px2,
            iterations: 0,
            status: RefineStatus::Ok,
        }))
    }
}
