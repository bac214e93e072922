//! Photographs of a dataset, as files: to look at, or to use elsewhere.

use std::fs;
use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, FlatSamples, Image, Layer, LayerAttributes, WritableImage,
};
use image::{ImageBuffer, Luma, Rgb};
use rayon::prelude::*;
use serde::Serialize;

use super::pictures::{write_depth, write_exposure};
use super::scene::range_image;
use crate::error::{Error, Result};
use crate::files::{refuse_foreign, write_json, write_whole};
use crate::geometry::{Camera, ImagePoint, Pose, PoseRows};
use crate::image::Plane;
use crate::junction::Junction;
use crate::scene::{Dataset, Scene, Visibility};
use crate::sensor::{
    CameraModel, Colour, Demosaic, Exposure, PhotographBuffers, Photographer, RangeImage,
    RangeSensor, Shot, Transfer,
};

/// The file that tells such a folder from any other.
const MANIFEST: &str = "photographs.json";

/// What to photograph.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// Phases: where in the film's image the centre of pixel (0, 0) is \[px\].
    pub phases_px: Vec<[f64; 2]>,
    /// Photographs at each phase, each with noise of its own.
    pub repeats: u32,
    /// A range image beside each photograph: name and model of the sensor.
    pub range_sensor: Option<(String, RangeSensor)>,
}

/// `photographs.json`: what is in a folder of photographs.
#[derive(Clone, Debug, Serialize)]
pub struct Photographs {
    /// Version of this program.
    pub cornerbench_version: String,
    /// The suite.
    pub suite: String,
    /// Name of the camera.
    pub camera: String,
    /// The camera.
    pub camera_model: CameraModel,
    /// The range sensor, by name.
    pub range_sensor: Option<(String, RangeSensor)>,
    /// The command line.
    pub command: String,
    /// The scenes that are there.
    pub scenes: Vec<String>,
    /// Scenes that could not be photographed, and why.
    pub failed: Vec<(String, String)>,
}

/// `exposures.json`: the photographs of one scene.
#[derive(Serialize)]
struct SceneFile {
    /// The curve from linear light to encoded value.
    transfer: Transfer,
    /// The largest sample.
    full_scale_dn: f64,
    /// The sample without light.
    black_dn: f64,
    /// The camera in the world: the upper rows of the matrix.
    world_from_camera: PoseRows,
    exposures: Vec<ExposureEntry>,
    /// The range sensor: intrinsics and pose.
    #[serde(skip_serializing_if = "Option::is_none")]
    range: Option<RangeEntry>,
}

#[derive(Serialize)]
struct RangeEntry {
    camera: Camera,
    world_from_range: PoseRows,
}

#[derive(Serialize)]
struct ExposureEntry {
    picture: String,
    light: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    range: Option<String>,
    /// Intrinsics and distortion, phase included.
    camera: Camera,
    saturated_pixels: usize,
    corners: Vec<CornerEntry>,
}

#[derive(Serialize)]
struct CornerEntry {
    index: usize,
    visibility: Visibility,
    junction: Option<Junction>,
    image_point_px: ImagePoint,
}

/// Photographs every scene of `dataset` into the folder `output`: SCENE/exposure-N.png (.exr where
/// samples are not rounded) with SCENE/preview-N.png where that is not what people expect to see,
/// SCENE/light-P.exr, the light on the pixels without noise at phase P,
/// SCENE/range-N.exr where a range sensor is wanted, and SCENE/exposures.json with the camera and the
/// true corners in each. A scene's folder appears whole or not at all. Scenes are
/// done in parallel; `on_scene` is called as each is done, with what was wrong.
///
/// # Errors
/// When `output` holds anything but photographs, or cannot be written. A scene that cannot be read is
/// named in what is returned.
pub fn photograph(
    dataset: &Dataset,
    photographer: &Photographer,
    wanted: &Wanted,
    output: &Path,
    command: &str,
    on_scene: &(dyn Fn(&str, Option<&Error>) + Sync),
) -> Result<Photographs> {
    refuse_foreign(output, MANIFEST, "a folder of photographs")?;
    let mut found = Photographs {
        cornerbench_version: env!("CARGO_PKG_VERSION").to_owned(),
        suite: dataset.suite().to_owned(),
        camera: photographer.name().to_owned(),
        camera_model: photographer.model().clone(),
        range_sensor: wanted.range_sensor.clone(),
        command: command.to_owned(),
        scenes: Vec::new(),
        failed: Vec::new(),
    };
    // First: from now on the folder is known to be one of photographs, whatever happens.
    write_json(&output.join(MANIFEST), &found)?;
    let names: Vec<&str> = dataset.scenes().collect();
    let done: Vec<Option<Error>> = names
        .par_iter()
        .map_init(PhotographBuffers::default, |buffers, name| {
            let done = dataset.read(name).and_then(|scene: Scene| {
                write_whole(&output.join(name), |folder| {
                    scene_into(folder, dataset.suite(), &scene, photographer, wanted, buffers)
                })
            });
            on_scene(name, done.as_ref().err());
            done.err()
        })
        .collect();
    for (name, problem) in names.iter().zip(done) {
        match problem {
            None => found.scenes.push((*name).to_owned()),
            Some(error) => found.failed.push(((*name).to_owned(), error.chain())),
        }
    }
    write_json(&output.join(MANIFEST), &found)?;
    Ok(found)
}

fn scene_into(
    folder: &Path,
    suite: &str,
    scene: &Scene,
    photographer: &Photographer,
    wanted: &Wanted,
    buffers: &mut PhotographBuffers,
) -> Result<()> {
    fs::create_dir(folder).map_err(Error::io(folder, "create"))?;
    let camera = &scene.description.camera;
    let bent = photographer.through_lens(&scene.film, camera)?;
    let film = bent.as_ref().unwrap_or(&scene.film);
    let (mut exposures, mut range) = (Vec::new(), None);
    let output = &photographer.model().output;
    for (phase, place) in wanted.phases_px.iter().enumerate() {
        let kernel = photographer.kernel(film.oversampling, *place);
        let light = format!("light-{phase}.exr");
        for _ in 0..wanted.repeats {
            let number = exposures.len();
            let name = [suite, &scene.name, &number.to_string()];
            let shot = Shot { name: &name, window: None };
            let taken = photographer.expose(film, camera, &kernel, &shot, buffers);
            let kind = if output.rounded { "png" } else { "exr" };
            let picture = format!("exposure-{number}.{kind}");
            let path = folder.join(&picture);
            if output.rounded {
                write_picture(&path, &taken.exposure, photographer.model())?;
            } else {
                let count = if is_grey(photographer.model()) { 1 } else { 3 };
                let planes = &taken.exposure.rgb()[..count];
                write_planes(&path, "exposure", channels_of(planes), planes)?;
            }
            // 16-bit files of 12-bit samples look black, and linear ones dark.
            if !output.rounded || output.bit_depth > 8 || output.curve() == Transfer::Linear {
                let path = folder.join(format!("preview-{number}.png"));
                write_exposure(&path, &taken.exposure)?;
            }
            if number % wanted.repeats as usize == 0 {
                write_planes(
                    &folder.join(&light),
                    "light",
                    channels_of(&taken.light),
                    &taken.light,
                )?;
            }
            let mut range_file = None;
            if let Some((_, sensor)) = &wanted.range_sensor {
                let image = range_image(sensor, scene, &name)?;
                let file = format!("range-{number}.exr");
                write_range(folder, &file, &image)?;
                range_file = Some(file);
                range = Some(RangeEntry {
                    camera: image.camera,
                    world_from_range: rows(&image.world_from_range),
                });
            }
            let truth = scene.truth.seen_by(camera, &taken.camera);
            exposures.push(ExposureEntry {
                picture,
                light: light.clone(),
                range: range_file,
                camera: taken.camera,
                saturated_pixels: count(taken.exposure.saturated()),
                corners: truth
                    .corners
                    .iter()
                    .map(|corner| CornerEntry {
                        index: corner.index,
                        visibility: corner.visibility,
                        junction: corner.junction,
                        image_point_px: corner.image_point_px,
                    })
                    .collect(),
            });
        }
    }
    let described = SceneFile {
        transfer: output.curve(),
        full_scale_dn: 2.0_f64.powi(output.bit_depth.into()) - 1.0,
        black_dn: output.black_dn,
        world_from_camera: rows(&scene.description.world_from_camera),
        exposures,
        range,
    };
    write_json(&folder.join("exposures.json"), &described)
}

/// The upper rows of a pose's matrix.
fn rows(pose: &Pose) -> PoseRows {
    let matrix = pose.to_homogeneous();
    std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)]))
}

/// X, Y, Z of every cell, 0 where it tells nothing, and a picture of the depth beside it.
fn write_range(folder: &Path, file: &str, image: &RangeImage) -> Result<()> {
    #[allow(clippy::cast_possible_truncation, reason = "files hold f32")]
    let planes = [0, 1, 2]
        .map(|axis| image.points.map(|point| point.map_or(0.0, |point| point.coords[axis] as f32)));
    write_planes(&folder.join(file), "range", &["X", "Y", "Z"], &planes)?;
    write_depth(&folder.join(file).with_extension("png"), &planes[2]).map(|_| ())
}

fn count(mask: &Plane<bool>) -> usize {
    mask.samples().iter().filter(|&&inside| inside).count()
}

/// Samples as they are, in 8 bits or 16; one channel where the camera sees no colour.
fn write_picture(path: &Path, exposure: &Exposure, model: &CameraModel) -> Result<()> {
    let (width, height) = (pixels(exposure.width()), pixels(exposure.height()));
    let at = |c: usize, x: u32, y: u32| exposure.rgb()[c].at(x as usize, y as usize).round();
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole numbers")]
    let saved = match (is_grey(model), model.output.bit_depth > 8) {
        (true, false) => {
            ImageBuffer::from_fn(width, height, |x, y| Luma([at(0, x, y) as u8])).save(path)
        }
        (true, true) => {
            ImageBuffer::from_fn(width, height, |x, y| Luma([at(0, x, y) as u16])).save(path)
        }
        (false, false) => {
            ImageBuffer::from_fn(width, height, |x, y| Rgb([0, 1, 2].map(|c| at(c, x, y) as u8)))
                .save(path)
        }
        (false, true) => {
            ImageBuffer::from_fn(width, height, |x, y| Rgb([0, 1, 2].map(|c| at(c, x, y) as u16)))
                .save(path)
        }
    };
    saved.map_err(|error| Error::malformed(path, format!("cannot write the picture: {error}")))
}

/// Whether a camera's pictures have one channel.
fn is_grey(model: &CameraModel) -> bool {
    match model.colour {
        Colour::Rgb => false,
        Colour::Mono => true,
        Colour::Rggb => model.output.demosaic == Demosaic::Raw,
    }
}

fn pixels(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

/// The channels' names of one plane, or of red, green and blue.
fn channels_of(planes: &[Plane<f32>]) -> &'static [&'static str] {
    if planes.len() == 1 { &["Y"] } else { &["R", "G", "B"] }
}

/// Planes by name as float32.
fn write_planes(path: &Path, layer: &str, names: &[&str], planes: &[Plane<f32>]) -> Result<()> {
    let channels = names
        .iter()
        .zip(planes)
        .map(|(name, plane)| AnyChannel::new(*name, FlatSamples::F32(plane.samples().to_vec())));
    let size = (planes[0].width(), planes[0].height());
    let layer = Layer::new(
        size,
        LayerAttributes::named(layer),
        exr::prelude::Encoding::SMALL_LOSSLESS,
        AnyChannels::sort(channels.collect()),
    );
    Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_file(path)
        .map_err(|error| Error::malformed(path, format!("cannot write it: {error}")))
}
