//! Reading OpenEXR: named planes of float32 or uint32, nothing guessed.

use std::io::Cursor;
use std::path::Path;

use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};

use crate::error::{Error, Result};
use crate::image::Plane;

/// A plane as it stands in a file.
#[derive(Clone, Debug)]
pub(crate) enum FilePlane {
    Float(Plane<f32>),
    Whole(Plane<u32>),
}

/// The layers of one file: (layer, channel, plane).
pub(crate) struct Layers<'a> {
    path: &'a Path,
    planes: Vec<(String, String, FilePlane)>,
}

impl<'a> Layers<'a> {
    /// Decodes the bytes of the file at `path`.
    pub(crate) fn decode(path: &'a Path, bytes: &[u8]) -> Result<Self> {
        let picture = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .all_layers()
            .all_attributes()
            // Others are read beside it: threads of its own would only add to theirs.
            .non_parallel()
            .from_buffered(Cursor::new(bytes))
            .map_err(|error| Error::malformed(path, error))?;
        let mut planes = Vec::new();
        for layer in picture.layer_data {
            let name = layer.attributes.layer_name.map(|text| text.to_string()).unwrap_or_default();
            let (width, height) = (layer.size.width(), layer.size.height());
            for channel in layer.channel_data.list {
                let plane = match channel.sample_data {
                    FlatSamples::F32(samples) => {
                        FilePlane::Float(Plane::from_samples(width, height, samples))
                    }
                    FlatSamples::U32(samples) => {
                        FilePlane::Whole(Plane::from_samples(width, height, samples))
                    }
                    FlatSamples::F16(_) => {
                        let problem =
                            format!("{name}.{} is half float, must be float", channel.name);
                        return Err(Error::malformed(path, problem));
                    }
                };
                planes.push((name.clone(), channel.name.to_string(), plane));
            }
        }
        Ok(Self { path, planes })
    }

    fn take(&mut self, layer: &str, channel: &str, size: (usize, usize)) -> Result<FilePlane> {
        let place = self.planes.iter().position(|(l, c, _)| l == layer && c == channel);
        let (_, _, plane) = place.map(|place| self.planes.swap_remove(place)).ok_or_else(|| {
            Error::malformed(self.path, format!("channel {channel} of layer {layer} is missing"))
        })?;
        let found = match &plane {
            FilePlane::Float(plane) => (plane.width(), plane.height()),
            FilePlane::Whole(plane) => (plane.width(), plane.height()),
        };
        if found == size {
            return Ok(plane);
        }
        let problem = format!(
            "{layer}.{channel} is {} x {}, scene.json says {} x {}",
            found.0, found.1, size.0, size.1
        );
        Err(Error::malformed(self.path, problem))
    }

    /// Takes a float32 plane of the size (width, height), all of it finite.
    pub(crate) fn floats(
        &mut self,
        layer: &str,
        channel: &str,
        size: (usize, usize),
    ) -> Result<Plane<f32>> {
        match self.take(layer, channel, size)? {
            FilePlane::Float(plane) if plane.samples().iter().all(|value| value.is_finite()) => {
                Ok(plane)
            }
            FilePlane::Float(_) => {
                let problem = format!("{layer}.{channel} holds values that are not finite");
                Err(Error::malformed(self.path, problem))
            }
            FilePlane::Whole(_) => {
                let problem = format!("{layer}.{channel} is uint, must be float");
                Err(Error::malformed(self.path, problem))
            }
        }
    }

    /// Takes a uint32 plane of the size (width, height).
    pub(crate) fn whole_numbers(
        &mut self,
        layer: &str,
        channel: &str,
        size: (usize, usize),
    ) -> Result<Plane<u32>> {
        match self.take(layer, channel, size)? {
            FilePlane::Whole(plane) => Ok(plane),
            FilePlane::Float(_) => {
                let problem = format!("{layer}.{channel} is float, must be uint");
                Err(Error::malformed(self.path, problem))
            }
        }
    }
}
