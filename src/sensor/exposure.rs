//! One photograph as an algorithm may see it.

use std::sync::{LazyLock, OnceLock};

use crate::error::{Error, Result};
use crate::geometry::{Camera, Pose};
use crate::image::Plane;
use crate::sensor::mosaic::filter;
use crate::sensor::{Sensor, Transfer};

/// How the samples of an exposure are to be read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encoding {
    /// Bits per sample: full scale is 2^`bit_depth` - 1. Samples are whole numbers, unless the camera
    /// does not round.
    pub bit_depth: u8,
    /// The curve from linear light to encoded value.
    pub transfer: Transfer,
    /// The sample without light.
    pub black_dn: f64,
}

impl Encoding {
    /// The largest sample \[DN\].
    pub fn full_scale_dn(self) -> f64 {
        (2.0_f64).powi(i32::from(self.bit_depth)) - 1.0
    }
}

/// What a data sheet says of the noise in an exposure.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseModel {
    /// The sensor.
    pub sensor: Sensor,
    /// Light of full scale, before the curve, per raw digital number above black, in each channel.
    pub light_per_dn: [f64; 3],
}

/// A photograph as an algorithm may see it.
#[derive(Clone, Debug)]
pub struct Exposure {
    /// Red, green and blue \[DN\]; equal where the camera sees no colour, or gives the raw mosaic.
    rgb: [Plane<f32>; 3],
    encoding: Encoding,
    saturated: Plane<bool>,
    noise: Option<NoiseModel>,
    camera: Option<Camera>,
    object_size_m: Option<[f64; 3]>,
    /// Where the first pixel lies in the mosaic that the colours are made of.
    mosaic: Option<[usize; 2]>,
    luma: OnceLock<Plane<f32>>,
    red_difference: OnceLock<Plane<f32>>,
    is_grey: OnceLock<bool>,
}

impl Exposure {
    /// An exposure of three equally large planes of digital numbers. Where one of them is at full
    /// scale the pixel is saturated.
    ///
    /// # Errors
    /// When the planes differ in size, or a sample is not finite: no algorithm ever sees one that is not.
    pub fn new(rgb: [Plane<f32>; 3], encoding: Encoding) -> Result<Self> {
        let [(width, height), others @ ..] =
            rgb.each_ref().map(|plane| (plane.width(), plane.height()));
        if let Some(other) = others.iter().find(|other| **other != (width, height)) {
            return Err(Error::Other(format!(
                "an exposure's planes must be of one size, found {width} x {height} and {} x {} px",
                other.0, other.1
            )));
        }
        for (name, plane) in ["red", "green", "blue"].iter().zip(&rgb) {
            if let Some(at) = plane.samples().iter().position(|sample| !sample.is_finite()) {
                let place =
                    format!("an exposure's {name} sample at ({}, {})", at % width, at / width);
                let found = plane.samples()[at];
                return Err(Error::Other(format!("{place} is {found}, must be a finite number")));
            }
        }
        Ok(Self::of_finite(rgb, encoding))
    }

    /// An exposure of three equally large planes of finite samples.
    pub(super) fn of_finite(rgb: [Plane<f32>; 3], encoding: Encoding) -> Self {
        #[allow(clippy::cast_possible_truncation, reason = "at most 65535")]
        let full = encoding.full_scale_dn() as f32;
        let [red, green, blue] = rgb.each_ref().map(Plane::samples);
        let saturated = red
            .iter()
            .zip(green)
            .zip(blue)
            .map(|((red, green), blue)| red.max(*green).max(*blue) >= full)
            .collect();
        let saturated = Plane::from_samples(rgb[0].width(), rgb[0].height(), saturated);
        Self::photographed(rgb, encoding, saturated, None)
    }

    /// An exposure of a camera that knows which pixels are saturated, whatever their samples say, and
    /// its noise.
    pub(super) fn photographed(
        rgb: [Plane<f32>; 3],
        encoding: Encoding,
        saturated: Plane<bool>,
        noise: Option<NoiseModel>,
    ) -> Self {
        Self {
            rgb,
            encoding,
            saturated,
            noise,
            camera: None,
            object_size_m: None,
            mosaic: None,
            luma: OnceLock::new(),
            red_difference: OnceLock::new(),
            is_grey: OnceLock::new(),
        }
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
        let encoding = Encoding { bit_depth: 8, transfer: Transfer::Srgb, black_dn: 0.0 };
        Self::of_finite([channel(0), channel(1), channel(2)], encoding)
    }

    /// The samples as 8-bit numbers, full scale 255.
    pub fn to_picture(&self) -> image::RgbImage {
        let scale = 255.0 / self.encoding.full_scale_dn();
        self.pictured(|sample| sample * scale)
    }

    /// The exposure as people expect to see it: what is linear is shown through the sRGB curve, without
    /// its black level.
    pub fn to_preview(&self) -> image::RgbImage {
        if self.encoding.transfer != Transfer::Linear {
            return self.to_picture();
        }
        /// sRGB of linear light from 0 to 1: a power for each sample takes longer than the photograph.
        static CURVE: LazyLock<Vec<f64>> = LazyLock::new(|| {
            (0..=u16::MAX)
                .map(|step| 255.0 * Transfer::Srgb.encode(f64::from(step) / f64::from(u16::MAX)))
                .collect()
        });
        let (full, black) = (self.encoding.full_scale_dn(), self.encoding.black_dn);
        self.pictured(|sample| {
            let light = ((sample - black) / (full - black)).clamp(0.0, 1.0);
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "in 0..=65535"
            )]
            let step = (f64::from(u16::MAX) * light).round() as usize;
            CURVE[step]
        })
    }

    fn pictured(&self, shown: impl Fn(f64) -> f64) -> image::RgbImage {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in 0..=255")]
        image::RgbImage::from_fn(
            u32::try_from(self.width()).unwrap_or(u32::MAX),
            u32::try_from(self.height()).unwrap_or(u32::MAX),
            |x, y| {
                let at = |c: usize| f64::from(self.rgb[c].at(x as usize, y as usize));
                image::Rgb([0, 1, 2].map(|c| shown(at(c)).round() as u8))
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

    /// Red, green and blue \[DN\]; equal where the camera sees no colour, or gives the raw mosaic.
    pub fn rgb(&self) -> &[Plane<f32>; 3] {
        &self.rgb
    }

    /// How to read the samples.
    pub fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// Where samples are saturated, or made of saturated ones: they carry no information.
    pub fn saturated(&self) -> &Plane<bool> {
        &self.saturated
    }

    /// What a data sheet says of its noise; `None` where there is none, or nothing is known of it.
    pub fn noise(&self) -> Option<&NoiseModel> {
        self.noise.as_ref()
    }

    /// Variance of a sample of a channel \[DN^2\], by the noise model and the rounding, from its
    /// expected value \[DN\]. Of colours that are made of a mosaic it is that of a sample of the
    /// channel's own filter: what is made of several varies less, and with its neighbours.
    pub fn variance_dn2(&self, channel: usize, expected_dn: f64) -> f64 {
        let full = self.encoding.full_scale_dn();
        let rounding = 1.0 / 12.0;
        let Some(noise) = &self.noise else { return rounding };
        let black = self.encoding.black_dn;
        let share = ((expected_dn - black) / (full - black)).clamp(0.0, 1.0);
        let light = self.encoding.transfer.decode(share);
        let scale = noise.light_per_dn[channel];
        let raw_dn = noise.sensor.black_level_dn + light / scale;
        let slope = self.encoding.transfer.slope(light) * (full - black) * scale;
        slope * slope * noise.sensor.variance_dn2(raw_dn) + rounding
    }

    /// It, of a sensor of which is known where it is saturated, and its noise.
    pub(super) fn with_sensor(self, saturated: Plane<bool>, noise: Option<NoiseModel>) -> Self {
        Self { saturated, noise, ..self }
    }

    /// It, of a camera whose intrinsics are known.
    #[must_use]
    pub fn with_camera(self, camera: Camera) -> Self {
        Self { camera: Some(camera), ..self }
    }

    /// It, of a target whose size is known.
    #[must_use]
    pub fn with_object_size(self, size_m: [f64; 3]) -> Self {
        Self { object_size_m: Some(size_m), ..self }
    }

    /// It, of colours that are made of a mosaic, red, green / green, blue, of whose pattern the first pixel is
    /// this one; what each pixel's own filter let through is kept.
    #[must_use]
    pub fn with_mosaic(self, origin: [usize; 2]) -> Self {
        Self { mosaic: Some(origin.map(|place| place % 2)), ..self }
    }

    /// Whether only one channel of each pixel was measured.
    pub fn has_mosaic(&self) -> bool {
        self.mosaic.is_some()
    }

    /// Whether a sample of a channel is the sensor's own, not made of its neighbours.
    #[inline(always)]
    pub fn is_measured(&self, channel: usize, x: usize, y: usize) -> bool {
        self.mosaic.is_none_or(|[right, down]| filter(x + right, y + down) == channel)
    }

    /// The intrinsics of its camera, as a calibration knows them; `None` where nothing does.
    pub fn camera(&self) -> Option<&Camera> {
        self.camera.as_ref()
    }

    /// Where the first pixel lies in the mosaic that the colours are made of; `None` where they are not.
    pub fn mosaic(&self) -> Option<[usize; 2]> {
        self.mosaic
    }

    /// Lengths of the target's edges as a data sheet has them \[m\]; `None` where nobody knows them.
    pub fn object_size_m(&self) -> Option<[f64; 3]> {
        self.object_size_m
    }

    /// The planes that differ: one where all three are equal, else red, green and blue.
    pub fn channels(&self) -> &[Plane<f32>] {
        let [red, green, blue] = &self.rgb;
        let is_grey = *self
            .is_grey
            .get_or_init(|| red.samples() == green.samples() && green.samples() == blue.samples());
        if is_grey { &self.rgb[..1] } else { &self.rgb }
    }

    /// Variance of a sample of a channel in linear light, of which 1 is full scale, from its expected value:
    /// [`Self::variance_dn2`] before the curve.
    pub fn light_variance(&self, channel: usize, expected: f64) -> f64 {
        let Encoding { transfer, black_dn, .. } = self.encoding;
        let span_dn = self.encoding.full_scale_dn() - black_dn;
        let slope_dn = transfer.slope(expected) * span_dn;
        self.variance_dn2(channel, black_dn + span_dn * transfer.encode(expected))
            / slope_dn.powi(2)
    }

    /// Samples to linear light.
    pub fn linear_light(&self) -> LinearLight {
        LinearLight::new(self.encoding)
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

    /// Red less the mean of green and blue \[DN\]: how saturated a red is.
    pub fn red_difference(&self) -> &Plane<f32> {
        self.red_difference.get_or_init(|| {
            let [red, green, blue] = &self.rgb;
            let samples = red
                .samples()
                .iter()
                .zip(green.samples())
                .zip(blue.samples())
                .map(|((r, g), b)| r - 0.5 * (g + b))
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
    /// The target's edge lengths, in any order, where a user would know them \[m\].
    pub object_size_m: Option<[f64; 3]>,
}

/// From samples to linear light.
#[derive(Clone, Debug)]
pub struct LinearLight {
    black_dn: f32,
    scale: f32,
    /// Of whole numbers of DN, where the curve is not a line.
    table: Vec<f32>,
}

impl LinearLight {
    fn new(encoding: Encoding) -> Self {
        let (full, black) = (encoding.full_scale_dn(), encoding.black_dn);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 65535")]
        let decoded = |dn: u32| {
            encoding.transfer.decode(((f64::from(dn) - black) / (full - black)).max(0.0)) as f32
        };
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 65535")]
        let table = match encoding.transfer {
            Transfer::Linear => Vec::new(),
            _ => (0..=full as u32 + 1).map(decoded).collect(),
        };
        #[allow(clippy::cast_possible_truncation, reason = "samples are f32")]
        Self { black_dn: black as f32, scale: (1.0 / (full - black)) as f32, table }
    }

    /// The light of a sample \[DN\], 0 at black and 1 at full scale; between whole numbers interpolated.
    #[inline(always)]
    pub fn of(&self, sample_dn: f32) -> f32 {
        if self.table.is_empty() {
            return (sample_dn - self.black_dn) * self.scale;
        }
        let place = sample_dn.clamp(0.0, (self.table.len() - 2) as f32);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in the table")]
        let index = place as usize;
        let (low, high) = (self.table[index], self.table[index + 1]);
        (high - low).mul_add(place - index as f32, low)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_preview_shows_linear_light_through_the_srgb_curve_to_one_level() {
        let (bit_depth, black_dn) = (12, 64.0);
        let encoding = Encoding { bit_depth, transfer: Transfer::Linear, black_dn };
        let plane = Plane::from_fn(64, 64, |x, y| (64 * y + x) as f32);
        let exposure =
            Exposure::new([plane.clone(), plane.clone(), plane], encoding).expect("an exposure");
        let preview = exposure.to_preview();
        for dn in 0..4096_u32 {
            let light = ((f64::from(dn) - black_dn) / (4095.0 - black_dn)).max(0.0);
            let wanted = 255.0 * Transfer::Srgb.encode(light);
            let shown = f64::from(preview.get_pixel(dn % 64, dn / 64)[0]);
            assert!((shown - wanted).abs() < 0.6, "{dn} DN: {shown}, not {wanted}");
        }
        assert_eq!(preview.get_pixel(63, 63)[2], 255);
    }
}
