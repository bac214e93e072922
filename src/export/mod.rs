//! Exports: a rendered dataset in the formats that other people's tools read.
//!
//! The files and each format's half-pixel convention are described in `scenes/FORMAT.md`.

mod bop;
mod coco;

use std::fs;
use std::path::Path;

use image::{ImageBuffer, PixelWithColorType, RgbImage};
use nalgebra::Point3;
use serde::Serialize;

use crate::error::{Error, Result};
use crate::files::{refuse_foreign, write_json, write_whole};
use crate::image::Plane;
use crate::scene::{Dataset, Description, Scene};
use crate::sensor::{CameraModel, Photographer};

/// A format to export to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// The BOP challenge's: poses, models, masks, depth; read by `bop_toolkit`.
    Bop,
    /// COCO keypoints: annotations of corners and visible masks; read by pycocotools.
    Coco,
}

impl Format {
    /// The name, as on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bop => "bop",
            Self::Coco => "coco",
        }
    }
}

/// What to export, and by which camera its pictures are taken.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// The format.
    pub format: Format,
    /// Name of the camera.
    pub camera: &'a str,
    /// The camera.
    pub photographer: &'a Photographer,
    /// The command line, for the record.
    pub command: &'a str,
}

/// What was exported: `export.json`, beside the format's own files.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Exported {
    /// Version of this program.
    pub cornerbench_version: String,
    /// The format.
    pub format: Format,
    /// The suite.
    pub suite: String,
    /// Name of the camera.
    pub camera: String,
    /// The camera.
    pub camera_model: CameraModel,
    /// The command line.
    pub command: String,
    /// The scenes that are there.
    pub scenes: Vec<ExportedScene>,
    /// The scenes that could not be read.
    pub unreadable: Vec<Unreadable>,
}

/// A scene of an export.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ExportedScene {
    /// Its place in the dataset, from 0, unreadable ones included; the format's ids count by it.
    pub place: usize,
    /// Its name in the dataset.
    pub name: String,
    /// Hash of what it was rendered from.
    pub recipe_sha256: String,
}

/// A scene that could not be read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Unreadable {
    /// Its name.
    pub scene: String,
    /// Why.
    pub reason: String,
}

/// The file by which an export is known.
const MANIFEST: &str = "export.json";

/// A format's own files, written scene by scene.
trait Writer {
    /// Adds the scene at `place` of the dataset, with its photograph.
    fn add(&mut self, place: usize, scene: &Scene, picture: &RgbImage) -> Result<()>;

    /// Writes what stands for all scenes.
    fn finish(&mut self) -> Result<()>;
}

/// Exports `dataset` to the folder `output`, which appears whole or not at all and replaces an earlier
/// export. One scene at a time is in memory. `on_scene` is called as each is done, with what was wrong
/// where it could not be read; such a scene is left out.
///
/// # Errors
/// When `output` holds anything but an export, no scene can be read, or a file cannot be written.
pub fn export(
    dataset: &Dataset,
    request: &Request,
    output: &Path,
    on_scene: &mut dyn FnMut(&str, Option<&Error>),
) -> Result<Exported> {
    refuse_foreign(output, MANIFEST, "an export")?;
    if !request.photographer.model().optics.distortion.is_none() {
        return Err(Error::Other(format!(
            "camera {} distorts, and {} has no place for that; choose another with --camera",
            request.camera,
            request.format.name()
        )));
    }
    let mut exported = Exported {
        cornerbench_version: env!("CARGO_PKG_VERSION").to_owned(),
        format: request.format,
        suite: dataset.suite().to_owned(),
        camera: request.camera.to_owned(),
        camera_model: request.photographer.model().clone(),
        command: request.command.to_owned(),
        scenes: Vec::new(),
        unreadable: Vec::new(),
    };
    write_whole(output, |folder| {
        fs::create_dir(folder).map_err(Error::io(folder, "create"))?;
        let mut writer: Box<dyn Writer> = match request.format {
            Format::Bop => Box::new(bop::Bop::new(folder)),
            Format::Coco => Box::new(coco::Coco::new(folder, dataset.suite(), request.camera)),
        };
        for (place, name) in dataset.scenes().enumerate() {
            match read(dataset, name) {
                Ok(mut scene) => {
                    let film_camera = scene.description.camera;
                    let shot = [dataset.suite(), &scene.name, "0"];
                    let photograph =
                        request.photographer.take(&scene.film, &film_camera, [0.0, 0.0], &shot)?;
                    scene.truth = scene.truth.seen_by(&film_camera, &photograph.camera);
                    scene.description.camera = photograph.camera;
                    let picture = photograph.exposure.to_picture();
                    writer.add(place, &scene, &picture)?;
                    exported.scenes.push(ExportedScene {
                        place,
                        name: scene.name,
                        recipe_sha256: scene.recipe_sha256,
                    });
                    on_scene(name, None);
                }
                Err(error) => {
                    exported
                        .unreadable
                        .push(Unreadable { scene: name.to_owned(), reason: error.chain() });
                    on_scene(name, Some(&error));
                }
            }
        }
        if exported.scenes.is_empty() {
            return Err(Error::Other(format!(
                "{}: none of its {} scenes could be read; nothing was exported",
                dataset.folder().display(),
                exported.unreadable.len()
            )));
        }
        writer.finish()?;
        write_json(&folder.join(MANIFEST), &exported)
    })?;
    Ok(exported)
}

/// Reads a scene whose target is in front of the camera: only then do its corners have projections.
fn read(dataset: &Dataset, name: &str) -> Result<Scene> {
    let scene = dataset.read(name)?;
    if target_box(&scene.description).iter().all(|vertex| vertex.z > 0.0) {
        return Ok(scene);
    }
    let path = dataset.folder().join(name).join("scene.json");
    Err(Error::malformed(&path, "the target reaches behind the camera: it has no outline"))
}

/// The vertices of the target's box in the camera frame \[m\]: bit 0 of the index is the side along
/// x, bit 1 along y, bit 2 along z of the target's own frame, as with the corners of truth.json.
fn target_box(description: &Description) -> [Point3<f64>; 8] {
    let target = &description.target;
    let camera_from_target = description.world_from_camera.inverse() * target.world_from_target;
    let [length, width, height] = target.size_m;
    std::array::from_fn(|index| {
        let side = |axis: usize| if index >> axis & 1 == 1 { 1.0 } else { 0.0 };
        let vertex =
            Point3::new((side(0) - 0.5) * length, (side(1) - 0.5) * width, side(2) * height);
        camera_from_target * vertex
    })
}

/// True on the pixels whose central ray meets the target.
fn visible_mask(scene: &Scene) -> Plane<bool> {
    let target = scene.description.target.object_id;
    scene.geometry.object_id.map(|id| id == target)
}

/// Writes a picture, and the folder it stands in where that is missing.
fn save<P>(path: &Path, picture: &ImageBuffer<P, Vec<P::Subpixel>>) -> Result<()>
where
    P: PixelWithColorType,
    [P::Subpixel]: image::EncodableLayout,
{
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(Error::io(folder, "create"))?;
    picture
        .save(path)
        .map_err(|error| Error::malformed(path, format!("cannot write the picture: {error}")))
}

/// A picture of a plane's samples, each changed to its pixel's value.
fn grey<T: Copy, S: image::Primitive>(
    plane: &Plane<T>,
    value: impl Fn(T) -> S,
) -> ImageBuffer<image::Luma<S>, Vec<S>>
where
    image::Luma<S>: image::Pixel<Subpixel = S>,
{
    let pixel = |index: usize| u32::try_from(index).unwrap_or(u32::MAX);
    ImageBuffer::from_fn(pixel(plane.width()), pixel(plane.height()), |x, y| {
        image::Luma([value(plane.at(x as usize, y as usize))])
    })
}
