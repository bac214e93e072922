//! One photograph: film radiance integrated over pixels, encoded, quantised.

use std::sync::OnceLock;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::{Camera, Pose};
use crate::image::Plane;
use crate::scene::Film;
use crate::sensor::Transfer;

/// How a camera turns radiance into digital numbers.
///
/// The ideal camera of the paper's simulator: no noise, no optics but the pixel's own area.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(title = "Camera")]
pub struct CameraModel {
    /// Encoded full scale per unit of radiance.
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub gain: f64,
    /// Bits per sample.
    #[schemars(range(min = 8, max = 16))]
    pub bit_depth: u8,
    /// The curve from linear light to encoded value.
    pub transfer: Transfer,
    /// One line for `cornerbench list`.
    pub summary: String,
}

impl Default for CameraModel {
    fn default() -> Self {
        Self { gain: 1.0, bit_depth: 8, transfer: Transfer::Srgb, summary: String::new() }
    }
}

/// How the samples of an exposure are to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoding {
    /// Bits per sample; samples are whole numbers from 0 to 2^`bit_depth` - 1.
    pub bit_depth: u8,
    /// The curve from linear light to encoded value.
    pub transfer: Transfer,
}

impl Encoding {
    /// The largest sample \[DN\].
    pub fn full_scale_dn(self) -> f64 {
        (2.0_f64).powi(i32::from(self.bit_depth)) - 1.0
    }
}

/// A photograph as an algorithm may see it.
#[derive(Clone, Debug)]
pub struct Exposure {
    /// Red, green and blue \[DN\], whole numbers.
    rgb: [Plane<f32>; 3],
    encoding: Encoding,
    luma: OnceLock<Plane<f32>>,
}

impl Exposure {
    /// An exposure of three equally large planes of digital numbers.
    ///
    /// # Panics
    /// When the planes differ in size: a mistake of the caller's code.
    pub fn new(rgb: [Plane<f32>; 3], encoding: Encoding) -> Self {
        let size = |plane: &Plane<f32>| (plane.width(), plane.height());
        assert!(size(&rgb[0]) == size(&rgb[1]) && size(&rgb[0]) == size(&rgb[2]));
        Self { rgb, encoding, luma: OnceLock::new() }
    }

    /// An 8-bit sRGB exposure of a colour picture.
    pub fn from_picture(picture: &image::RgbImage) -> Self {
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let channel = |c: usize| {
            Plane::from_samples(
                width,
                height,
                picture.pixels().map(|p| f32::from(p.0[c])).collect(),
            )
        };
        let encoding = Encoding { bit_depth: 8, transfer: Transfer::Srgb };
        Self::new([channel(0), channel(1), channel(2)], encoding)
    }

    /// The exposure as an 8-bit picture, for people.
    pub fn to_picture(&self) -> image::RgbImage {
        let scale = 255.0 / self.encoding.full_scale_dn();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in 0..=255")]
        image::RgbImage::from_fn(
            u32::try_from(self.width()).unwrap_or(u32::MAX),
            u32::try_from(self.height()).unwrap_or(u32::MAX),
            |x, y| {
                let at = |c: usize| self.rgb[c].at(x as usize, y as usize);
                image::Rgb([0, 1, 2].map(|c| (f64::from(at(c)) * scale).round() as u8))
            },
        )
    }

    /// Columns \[px\].
    pub fn width(&self) -> usize {
        self.rgb[0].width()
    }

    /// Rows \[px\].
    pub fn height(&self) -> usize {
        self.rgb[0].height()
    }

    /// Red, green and blue \[DN\].
    pub fn rgb(&self) -> &[Plane<f32>; 3] {
        &self.rgb
    }

    /// How to read the samples.
    pub fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// Grey value \[DN\]: the encoded channels weighted by 0.299, 0.587, 0.114 (Rec. 601) and rounded
    /// to a whole number, halves upwards. OpenCV's `cvtColor` rounds its weights to fixed point: it
    /// differs by one in about one pixel of a thousand.
    pub fn luma(&self) -> &Plane<f32> {
        self.luma.get_or_init(|| {
            let [red, green, blue] = &self.rgb;
            let samples = red
                .samples()
                .iter()
                .zip(green.samples())
                .zip(blue.samples())
                .map(|((r, g), b)| (0.299 * r + 0.587 * g + 0.114 * b).round())
                .collect();
            Plane::from_samples(self.width(), self.height(), samples)
        })
    }
}

/// What a user knows of the camera that took an exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rig {
    /// The colour camera's intrinsics.
    pub camera: Camera,
    /// Where it stands.
    pub world_from_camera: Pose,
}

/// Photographs `film`: each pixel is the mean radiance of its film cells, multiplied by the gain,
/// clipped to \[0, 1\], encoded and rounded to the bit depth.
pub fn expose(film: &Film, model: &CameraModel) -> Exposure {
    let encoding = Encoding { bit_depth: model.bit_depth, transfer: model.transfer };
    let full_scale = encoding.full_scale_dn();
    let rgb = [0, 1, 2].map(|channel| {
        film.binned(channel).map(|radiance| {
            let light = (f64::from(radiance) * model.gain).clamp(0.0, 1.0);
            #[allow(clippy::cast_possible_truncation, reason = "whole numbers below 2^16")]
            let dn = (model.transfer.encode(light) * full_scale).round() as f32;
            dn
        })
    });
    Exposure::new(rgb, encoding)
}
