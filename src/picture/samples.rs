//! From the bytes of a picture file to planes of its own samples.

use std::io::Cursor;
use std::path::Path;

use exr::meta::MetaData;
use exr::prelude::{FlatSamples, Layer, ReadChannels, ReadLayers, read};
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use tiff::ColorType;
use tiff::decoder::{Decoder, DecodingResult};

use super::MOST_PIXELS;
use crate::error::{Error, Result};
use crate::image::Plane;

/// What a file holds.
pub(super) struct Samples {
    /// Red, green and blue; equal where it is grey.
    pub rgb: [Plane<f32>; 3],
    /// Bits of whole numbers; `None` of floats.
    pub bits: Option<u8>,
    /// Whether its orientation made rows of columns, or mirrored them.
    pub is_turned: bool,
}

/// Reads and decodes a file; what it is its first bytes say, not its name.
pub(super) fn decode(path: &Path) -> Result<Samples> {
    let bytes = std::fs::read(path).map_err(Error::io(path, "read"))?;
    match image::guess_format(&bytes).ok() {
        Some(ImageFormat::OpenExr) => open_exr(path, &bytes),
        Some(ImageFormat::Tiff) => match grey_float_tiff(path, &bytes)? {
            Some(samples) => Ok(samples),
            None => common(path, &bytes, ImageFormat::Tiff),
        },
        Some(format @ (ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::Bmp)) => {
            common(path, &bytes, format)
        }
        other => {
            let found = other.map_or_else(String::new, |format| format!(" but {format:?}"));
            let problem = format!(
                "is no picture that can be read{found}; must be PNG, JPEG, TIFF, BMP or OpenEXR"
            );
            Err(Error::malformed(path, problem))
        }
    }
}

fn check_size(path: &Path, width: u64, height: u64) -> Result<()> {
    let pixels = width.saturating_mul(height);
    if pixels == 0 || pixels > MOST_PIXELS {
        let problem = format!("is {width} x {height} px, must have 1 to {MOST_PIXELS} px");
        return Err(Error::malformed(path, problem));
    }
    Ok(())
}

/// PNG, JPEG, BMP and most of TIFF.
fn common(path: &Path, bytes: &[u8], format: ImageFormat) -> Result<Samples> {
    let malformed = |error: image::ImageError| Error::malformed(path, error);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    // Four floats for each pixel, and as much for the decoder.
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(32 * MOST_PIXELS);
    reader.limits(limits);
    let mut decoder = reader.into_decoder().map_err(malformed)?;
    let (width, height) = decoder.dimensions();
    check_size(path, width.into(), height.into())?;
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let mut picture = DynamicImage::from_decoder(decoder).map_err(malformed)?;
    picture.apply_orientation(orientation);
    let size = [picture.width() as usize, picture.height() as usize];
    let (rgb, bits) = match &picture {
        DynamicImage::ImageLuma8(buffer) => (planes(size, 1, buffer), Some(8)),
        DynamicImage::ImageLumaA8(buffer) => (planes(size, 2, buffer), Some(8)),
        DynamicImage::ImageRgb8(buffer) => (planes(size, 3, buffer), Some(8)),
        DynamicImage::ImageRgba8(buffer) => (planes(size, 4, buffer), Some(8)),
        DynamicImage::ImageLuma16(buffer) => (planes(size, 1, buffer), Some(16)),
        DynamicImage::ImageLumaA16(buffer) => (planes(size, 2, buffer), Some(16)),
        DynamicImage::ImageRgb16(buffer) => (planes(size, 3, buffer), Some(16)),
        DynamicImage::ImageRgba16(buffer) => (planes(size, 4, buffer), Some(16)),
        DynamicImage::ImageRgb32F(buffer) => (planes(size, 3, buffer), None),
        DynamicImage::ImageRgba32F(buffer) => (planes(size, 4, buffer), None),
        other => {
            let problem =
                format!("its samples are {:?}, must have 8 or 16 bits or be floats", other.color());
            return Err(Error::malformed(path, problem));
        }
    };
    Ok(Samples { rgb, bits, is_turned: orientation != Orientation::NoTransforms })
}

/// Planes of interleaved samples; of one or two in each pixel the first is grey.
fn planes<T: Copy + Into<f32>>(
    [width, height]: [usize; 2],
    each: usize,
    samples: &[T],
) -> [Plane<f32>; 3] {
    let channel = |c: usize| {
        let samples = samples.chunks_exact(each).map(|pixel| pixel[c].into()).collect();
        Plane::from_samples(width, height, samples)
    };
    if each < 3 { grey(channel(0)) } else { [channel(0), channel(1), channel(2)] }
}

fn grey(plane: Plane<f32>) -> [Plane<f32>; 3] {
    [plane.clone(), plane.clone(), plane]
}

/// Grey floats, which `image` does not know; `None` of any other TIFF, and where it is none: `image` says why.
fn grey_float_tiff(path: &Path, bytes: &[u8]) -> Result<Option<Samples>> {
    let Ok(mut decoder) = Decoder::new(Cursor::new(bytes)) else { return Ok(None) };
    let Ok(ColorType::Gray(32 | 64)) = decoder.colortype() else { return Ok(None) };
    let malformed = |error: tiff::TiffError| Error::malformed(path, error);
    let (width, height) = decoder.dimensions().map_err(malformed)?;
    check_size(path, width.into(), height.into())?;
    let mut limits = tiff::decoder::Limits::default();
    // Eight bytes for each pixel.
    limits.decoding_buffer_size = usize::try_from(8 * MOST_PIXELS).unwrap_or(usize::MAX);
    limits.intermediate_buffer_size = limits.decoding_buffer_size;
    let mut decoder = decoder.with_limits(limits);
    #[allow(clippy::cast_possible_truncation, reason = "samples are f32")]
    let samples = match decoder.read_image().map_err(malformed)? {
        DecodingResult::F32(samples) => samples,
        DecodingResult::F64(samples) => samples.into_iter().map(|sample| sample as f32).collect(),
        _ => {
            let problem = "its samples are whole numbers of more than 16 bits, must have 8 or 16 or be floats";
            return Err(Error::malformed(path, problem));
        }
    };
    let (width, height) = (width as usize, height as usize);
    if samples.len() != width * height {
        let problem = format!("has {} samples for {width} x {height} px", samples.len());
        return Err(Error::malformed(path, problem));
    }
    let rgb = grey(Plane::from_samples(width, height, samples));
    Ok(Some(Samples { rgb, bits: None, is_turned: false }))
}

/// The first layer that has channels R, G and B, or Y, or one channel alone.
fn open_exr(path: &Path, bytes: &[u8]) -> Result<Samples> {
    let malformed = |error: exr::error::Error| Error::malformed(path, error);
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(malformed)?;
    let mut samples = 0_u64;
    for header in &meta.headers {
        let (width, height) = (header.layer_size.0 as u64, header.layer_size.1 as u64);
        check_size(path, width, height)?;
        samples = samples.saturating_add(width * height * header.channels.list.len() as u64);
    }
    if samples > 4 * MOST_PIXELS {
        let problem =
            format!("has {samples} samples in all layers, must have at most {}", 4 * MOST_PIXELS);
        return Err(Error::malformed(path, problem));
    }
    let picture = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        // Others are read beside it: threads of its own would only add to theirs.
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(malformed)?;
    let rgb = picture.layer_data.iter().find_map(colours).ok_or_else(|| {
        let layers = picture.layer_data.iter();
        let names: Vec<String> = layers
            .flat_map(|layer| {
                layer.channel_data.list.iter().map(|channel| channel.name.to_string())
            })
            .collect();
        let problem =
            format!("no layer has channels R, G and B, or Y; there are: {}", names.join(", "));
        Error::malformed(path, problem)
    })?;
    Ok(Samples { rgb, bits: None, is_turned: false })
}

fn colours(layer: &Layer<exr::prelude::AnyChannels<FlatSamples>>) -> Option<[Plane<f32>; 3]> {
    let (width, height) = (layer.size.width(), layer.size.height());
    let list = &layer.channel_data.list;
    let plane = |name: &str| {
        let channel = list.iter().find(|channel| channel.name.to_string() == name)?;
        let samples: Vec<f32> = channel.sample_data.values_as_f32().collect();
        // What is not sampled at each pixel is no plane.
        (samples.len() == width * height).then(|| Plane::from_samples(width, height, samples))
    };
    // "R" itself before "diffuse.R".
    let mut names: Vec<String> = list.iter().map(|channel| channel.name.to_string()).collect();
    names.sort_by_key(String::len);
    let of_suffix = |suffix: &str| {
        names.iter().find_map(|name| {
            let before = name.strip_suffix(suffix)?;
            (before.is_empty() || before.ends_with('.')).then_some(before)
        })
    };
    let rgb = of_suffix("R").and_then(|before| {
        let [red, green, blue] = ["R", "G", "B"].map(|name| plane(&format!("{before}{name}")));
        Some([red?, green?, blue?])
    });
    let alone = || (names.len() == 1).then_some(names[0].as_str());
    rgb.or_else(|| {
        let grey_name = of_suffix("Y").map(|before| format!("{before}Y"));
        plane(&grey_name.or_else(|| alone().map(str::to_owned))?).map(grey)
    })
}
