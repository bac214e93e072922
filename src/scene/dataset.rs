//! A dataset's folder: its manifest, and scenes read from it with their hashes checked.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use nalgebra::Point3;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};
use crate::files::sha256_hex;
use crate::geometry::Camera;
use crate::image::Plane;
use crate::scene::layers::Layers;
use crate::scene::{Coverage, Description, Film, Geometry, RangeRays, Truth};

/// The version of the dataset format that this program reads.
pub const FORMAT: u32 = 3;

/// A rendered suite on disk.
#[derive(Clone, Debug)]
pub struct Dataset {
    folder: PathBuf,
    manifest: Manifest,
}

#[derive(Clone, Debug, Deserialize)]
struct Manifest {
    format: u32,
    suite: String,
    #[serde(deserialize_with = "in_file_order")]
    scenes: Vec<(String, SceneEntry)>,
}

#[derive(Clone, Debug, Deserialize)]
struct SceneEntry {
    recipe_sha256: String,
    renderer: Renderer,
    files: BTreeMap<String, FileEntry>,
}

#[derive(Clone, Debug, Deserialize)]
struct FileEntry {
    sha256: String,
}

/// What rendered a scene.
#[derive(Clone, Debug, Deserialize)]
pub struct Renderer {
    /// Its name.
    pub name: String,
    /// Its version.
    pub version: String,
    /// Its variant, which decides how it computes.
    pub variant: String,
}

/// A rendered scene, read.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Its name.
    pub name: String,
    /// Hash of what it was rendered from.
    pub recipe_sha256: String,
    /// All that was resolved.
    pub description: Description,
    /// What is true of it. Only what scores may see this.
    pub truth: Truth,
    /// Its radiance.
    pub film: Film,
    /// What each pixel's central ray meets.
    pub geometry: Geometry,
    /// What the range sensor's rays meet.
    pub range: RangeRays,
}

impl Dataset {
    /// Reads the manifest of a dataset's folder.
    ///
    /// # Errors
    /// When there is none, or it is not one of this format.
    pub fn open(folder: &Path) -> Result<Self> {
        let path = folder.join("dataset.json");
        let bytes = fs::read(&path).map_err(|error| match error.kind() {
            ErrorKind::NotFound => Error::Other(format!(
                "{}: no dataset here (dataset.json is missing); render one: \
                 cornerbench render SUITE -o {}",
                folder.display(),
                folder.display()
            )),
            _ => Error::io(&path, "read")(error),
        })?;
        let manifest: Manifest = parse(&path, &bytes)?;
        if manifest.format != FORMAT {
            let problem = format!(
                "format is {}, this program reads {FORMAT}; render it again: \
                 cornerbench render {} -o {}",
                manifest.format,
                manifest.suite,
                folder.display()
            );
            return Err(Error::malformed(&path, problem));
        }
        let legal = |name: &str| {
            !name.is_empty()
                && !name.starts_with('.')
                && name.chars().all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c))
        };
        let names = manifest
            .scenes
            .iter()
            .flat_map(|(name, entry)| std::iter::once(name).chain(entry.files.keys()));
        if let Some(name) = names.into_iter().find(|name| !legal(name)) {
            let problem = format!("{name:?} is no name of a scene or file: letters, digits, - _ .");
            return Err(Error::malformed(&path, problem));
        }
        Ok(Self { folder: folder.to_owned(), manifest })
    }

    /// Its folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The suite it was rendered from.
    pub fn suite(&self) -> &str {
        &self.manifest.suite
    }

    /// The names of its scenes, in the suite's order.
    pub fn scenes(&self) -> impl Iterator<Item = &str> {
        self.manifest.scenes.iter().map(|(name, _)| name.as_str())
    }

    /// What rendered a scene.
    pub fn renderer(&self, scene: &str) -> Option<&Renderer> {
        self.entry(scene).map(|entry| &entry.renderer)
    }

    /// The hash of what a scene was rendered from.
    pub fn recipe_sha256(&self, scene: &str) -> Option<&str> {
        self.entry(scene).map(|entry| entry.recipe_sha256.as_str())
    }

    /// A hash of all that a scene's files hold; `None` of one that the manifest does not name.
    pub fn fingerprint(&self, scene: &str) -> Option<String> {
        let mut text = String::new();
        for (name, file) in &self.entry(scene)?.files {
            // Writing into a string cannot fail.
            let _ = writeln!(text, "{name} {}", file.sha256);
        }
        Some(sha256_hex(text.as_bytes()))
    }

    fn entry(&self, scene: &str) -> Option<&SceneEntry> {
        self.manifest.scenes.iter().find(|(name, _)| name == scene).map(|(_, entry)| entry)
    }

    /// Reads one scene whole, every file's hash checked.
    ///
    /// # Errors
    /// [`Error::Altered`] for a file that is missing or not the one that was rendered,
    /// [`Error::Malformed`] for one that is, but does not hold what it should.
    pub fn read(&self, scene: &str) -> Result<Scene> {
        let entry = self.known(scene)?;
        let folder = self.folder.join(scene);
        let description = self.describe(scene)?;
        // What is read for people alone is checked, too.
        const READ: [&str; 5] =
            ["scene.json", "truth.json", "film.exr", "geometry.exr", "range.exr"];
        for name in entry.files.keys().filter(|name| !READ.contains(&name.as_str())) {
            self.checked(entry, &folder.join(name))?;
        }
        let oversampling = description.film.oversampling;
        let size = |camera: &Camera, scale: u32| {
            (camera.width as usize * scale as usize, camera.height as usize * scale as usize)
        };

        let path = folder.join("truth.json");
        let truth: Truth = parse(&path, &self.checked(entry, &path)?)?;
        if !truth.is_consistent() {
            return Err(Error::malformed(&path, "corners, edges and faces do not fit together"));
        }

        let path = folder.join("film.exr");
        let bytes = self.checked(entry, &path)?;
        let mut layers = Layers::decode(&path, &bytes)?;
        let mut plane = |c| layers.floats("radiance", c, size(&description.camera, oversampling));
        let film = Film { oversampling, radiance: [plane("R")?, plane("G")?, plane("B")?] };

        let path = folder.join("geometry.exr");
        let bytes = self.checked(entry, &path)?;
        let mut layers = Layers::decode(&path, &bytes)?;
        let sensor = size(&description.camera, 1);
        let geometry = Geometry {
            depth_m: layers.floats("geometry", "depth.Z", sensor)?,
            object_id: layers.whole_numbers("geometry", "object.id", sensor)?,
            face_id: layers.whole_numbers("geometry", "face.id", sensor)?,
        };

        let path = folder.join("range.exr");
        let bytes = self.checked(entry, &path)?;
        let mut layers = Layers::decode(&path, &bytes)?;
        let mut plane = |c| layers.floats("range", c, size(&description.range_camera, 1));
        let (x, y, z) = (plane("X")?, plane("Y")?, plane("Z")?);
        let points = Plane::from_fn(x.width(), x.height(), |column, row| {
            let at = |plane: &Plane<f32>| f64::from(plane.at(column, row));
            (at(&z) > 0.0).then(|| Point3::new(at(&x), at(&y), at(&z)))
        });
        let finer = size(&description.range_camera, description.range_oversampling);
        let depth_m = layers.floats("footprints", "Z", finer)?;

        Ok(Scene {
            name: scene.to_owned(),
            recipe_sha256: entry.recipe_sha256.clone(),
            description,
            truth,
            film,
            geometry,
            range: RangeRays { points, depth_m },
        })
    }

    fn known(&self, scene: &str) -> Result<&SceneEntry> {
        self.entry(scene).ok_or_else(|| Error::UnknownName {
            place: self.folder.display().to_string(),
            kind: "scene".to_owned(),
            found: scene.to_owned(),
            known: self.scenes().map(str::to_owned).collect(),
        })
    }

    /// Reads what was resolved about one scene, and nothing else of it.
    ///
    /// # Errors
    /// As [`Dataset::read`].
    pub fn describe(&self, scene: &str) -> Result<Description> {
        let entry = self.known(scene)?;
        let path = self.folder.join(scene).join("scene.json");
        let description: Description = parse(&path, &self.checked(entry, &path)?)?;
        if description.format != FORMAT {
            let problem = format!("format is {}, this program reads {FORMAT}", description.format);
            return Err(Error::malformed(&path, problem));
        }
        check_camera(&path, "camera", &description.camera)?;
        check_camera(&path, "range_camera", &description.range_camera)?;
        let out_of_range = |key: &str, found: String, allowed: String| {
            Error::out_of_range(path.display(), key, found, allowed)
        };
        if !(1..=64).contains(&description.range_oversampling) {
            let found = description.range_oversampling.to_string();
            return Err(out_of_range("range_oversampling", found, "in 1..=64".to_owned()));
        }
        let film = &description.film;
        if !(1..=16).contains(&film.oversampling) {
            let (found, allowed) = (film.oversampling.to_string(), "in 1..=16".to_owned());
            return Err(out_of_range("film.oversampling", found, allowed));
        }
        let [x0, y0, x1, y1] = film.fovea_px;
        let (width, height) = (description.camera.width, description.camera.height);
        if x0 > x1 || y0 > y1 || x1 > width || y1 > height {
            let allowed = format!("a part of {width} x {height} px");
            return Err(out_of_range("film.fovea_px", format!("{:?}", film.fovea_px), allowed));
        }
        Ok(description)
    }

    /// Reads the coverage of a scene that was read; `None` where the target is not in the image.
    ///
    /// # Errors
    /// As [`Dataset::read`].
    pub fn read_coverage(&self, scene: &Scene) -> Result<Option<Coverage>> {
        let film = &scene.description.film;
        let [x0, y0, x1, y1] = film.fovea_px;
        if x0 == x1 || y0 == y1 {
            return Ok(None);
        }
        let path = self.folder.join(&scene.name).join("coverage.exr");
        let bytes = self.checked(self.known(&scene.name)?, &path)?;
        let mut layers = Layers::decode(&path, &bytes)?;
        let size = [x1 - x0, y1 - y0].map(|side| (side * film.oversampling) as usize);
        let mut plane = |c| layers.floats("coverage", c, (size[0], size[1]));
        Ok(Some(Coverage {
            fovea_px: film.fovea_px,
            oversampling: film.oversampling,
            regions: [plane("R")?, plane("G")?, plane("B")?],
        }))
    }

    /// The bytes of a scene's file, when they are those that were rendered.
    fn checked(&self, entry: &SceneEntry, path: &Path) -> Result<Vec<u8>> {
        let name = path.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
        let expected = entry.files.get(name.as_ref()).map(|file| file.sha256.clone());
        let altered = |found: String| Error::Altered {
            path: path.to_owned(),
            dataset: self.folder.clone(),
            suite: self.manifest.suite.clone(),
            expected: expected.clone().unwrap_or_else(|| "nothing".to_owned()),
            found,
        };
        let bytes = fs::read(path).map_err(|error| match error.kind() {
            ErrorKind::NotFound => altered("no file".to_owned()),
            _ => Error::io(path, "read")(error),
        })?;
        let found = sha256_hex(&bytes);
        if expected.as_ref() == Some(&found) { Ok(bytes) } else { Err(altered(found)) }
    }
}

fn check_camera(path: &Path, key: &str, camera: &Camera) -> Result<()> {
    let sides = [camera.width, camera.height];
    let focal = [camera.fx_px, camera.fy_px];
    let centre = [camera.cx_px, camera.cy_px];
    // A film is a pinhole's: lenses belong to the cameras that photograph it.
    let right = camera.distortion.is_none()
        && sides.iter().all(|side| (1..=16384).contains(side))
        && focal.iter().all(|f| f.is_finite() && *f > 0.0)
        && centre.iter().all(|c| c.is_finite());
    if right {
        Ok(())
    } else {
        Err(Error::malformed(path, format!("{key} is no camera: {camera:?}")))
    }
}

fn parse<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T> {
    let mut reader = serde_json::Deserializer::from_slice(bytes);
    serde_path_to_error::deserialize(&mut reader)
        .map_err(|error| Error::malformed(path, format!("{}: {}", error.path(), error.inner())))
}

/// A JSON object as a list, in the order of the file.
fn in_file_order<'de, D: serde::Deserializer<'de>>(
    deserializer: D,
) -> std::result::Result<Vec<(String, SceneEntry)>, D::Error> {
    struct Pairs;
    impl<'de> serde::de::Visitor<'de> for Pairs {
        type Value = Vec<(String, SceneEntry)>;

        fn expecting(&self, formatter: &mut std::fmt::Formatter) -> std::fmt::Result {
            formatter.write_str("an object of scenes")
        }

        fn visit_map<A: serde::de::MapAccess<'de>>(
            self,
            mut map: A,
        ) -> std::result::Result<Self::Value, A::Error> {
            let mut pairs = Vec::new();
            while let Some(pair) = map.next_entry()? {
                pairs.push(pair);
            }
            Ok(pairs)
        }
    }
    deserializer.deserialize_map(Pairs)
}
