//! A camera by the numbers of its data sheet.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::electrons::Sensor;
use super::mosaic::Demosaic;
use super::optics::Optics;
use super::transfer::Transfer;
use crate::error::{Error, Result};
use crate::image::Plane;

/// How a camera turns radiance into digital numbers. What is not given is ideal: a pinhole, square
/// pixels that gather all their light, no noise, full colour in every pixel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(title = "Camera")]
pub struct CameraModel {
    /// One line for `cornerbench list`.
    pub summary: String,
    /// Encoded full scale per unit of radiance; of a camera with a sensor, per its saturation.
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub gain: f64,
    /// What its pixels see.
    pub colour: Colour,
    /// Blur, aperture, distortion.
    pub optics: Optics,
    /// Noise. Without it there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor: Option<Sensor>,
    /// From samples to a picture.
    pub output: Output,
}

/// What pixels see.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Colour {
    /// Every pixel sees red, green and blue.
    #[default]
    Rgb,
    /// Every pixel sees all light as one.
    Mono,
    /// A mosaic of filters: red, green, / green, blue.
    Rggb,
}

/// From samples to a picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Output {
    /// Bits per sample.
    #[schemars(range(min = 8, max = 16))]
    pub bit_depth: u8,
    /// Whether samples are whole numbers.
    pub rounded: bool,
    /// The curve from linear light to encoded value.
    pub transfer: Curve,
    /// The sample without light, of the curve "linear": room for noise below black.
    #[schemars(range(min = 0.0, max = 4096.0))]
    pub black_dn: f64,
    /// The exponent that undoes the curve "power".
    #[schemars(range(min = 1.0, max = 4.0))]
    pub gamma: f64,
    /// How many times the light is in the curve "log".
    #[schemars(range(min = 0.1, max = 100_000.0))]
    pub log_gain: f64,
    /// How full colour is made of a mosaic.
    pub demosaic: Demosaic,
    /// Quality of a JPEG file in between, 1 to 100; none where 0. Its colours have full resolution.
    #[schemars(range(min = 0, max = 100))]
    pub jpeg_quality: u8,
}

/// The name of a curve from linear light to encoded value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Curve {
    /// Encoded value proportional to light.
    Linear,
    /// The piecewise sRGB curve.
    #[default]
    Srgb,
    /// Light to the power of one over gamma.
    Power,
    /// The logarithm of one and `log_gain` times the light.
    Log,
}

impl Default for CameraModel {
    fn default() -> Self {
        Self {
            summary: String::new(),
            gain: 1.0,
            colour: Colour::default(),
            optics: Optics::default(),
            sensor: None,
            output: Output::default(),
        }
    }
}

impl Default for Output {
    fn default() -> Self {
        Self {
            bit_depth: 8,
            rounded: true,
            transfer: Curve::default(),
            black_dn: 0.0,
            gamma: 2.2,
            log_gain: 1000.0,
            demosaic: Demosaic::default(),
            jpeg_quality: 0,
        }
    }
}

impl Output {
    /// The curve with its parameter.
    pub fn curve(&self) -> Transfer {
        match self.transfer {
            Curve::Linear => Transfer::Linear,
            Curve::Srgb => Transfer::Srgb,
            Curve::Power => Transfer::Power { gamma: self.gamma },
            Curve::Log => Transfer::Log { gain: self.log_gain },
        }
    }
}

impl CameraModel {
    /// Checks what the range of a single value cannot say. `place` names the file.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for numbers that no camera can have.
    pub fn check(&self, place: &str) -> Result<()> {
        let out = |key: &str, found: String, allowed: &str| {
            Err(Error::out_of_range(place, key, found, allowed))
        };
        if self.output.jpeg_quality > 0 && (self.output.bit_depth != 8 || !self.output.rounded) {
            let found = self.output.jpeg_quality.to_string();
            return out(
                "output.jpeg_quality",
                found,
                "0 unless bit_depth is 8 and rounded is true",
            );
        }
        let full = 2.0_f64.powi(self.output.bit_depth.into()) - 1.0;
        let most = if self.output.transfer == Curve::Linear { 0.5 * full } else { 0.0 };
        if self.output.black_dn > most {
            let allowed = format!("in [0, {most}]: only the curve \"linear\" may have one");
            return out("output.black_dn", self.output.black_dn.to_string(), &allowed);
        }
        let Some(sensor) = &self.sensor else { return Ok(()) };
        for (key, values, most) in [
            ("sensor.quantum_efficiency", sensor.quantum_efficiency, 1.0),
            ("sensor.wavelength_nm", sensor.wavelength_nm, 20_000.0),
        ] {
            if values.iter().any(|value| !(*value > 0.0 && *value <= most)) {
                return out(key, format!("{values:?}"), &format!("three numbers in (0, {most}]"));
            }
        }
        let most = 2.0_f64.powi(i32::from(sensor.bit_depth)) - 1.0;
        if sensor.black_level_dn >= 0.5 * most {
            let allowed = format!("below half of the largest sample, {}", 0.5 * most);
            return out("sensor.black_level_dn", sensor.black_level_dn.to_string(), &allowed);
        }
        if sensor.gain_dn_per_e * sensor.full_well_e < 1.0 {
            let allowed = "large enough to be a digital number above the black level: at least 1 / gain_dn_per_e";
            return out("sensor.full_well_e", sensor.full_well_e.to_string(), allowed);
        }
        if sensor.dark_e() >= sensor.full_well_e {
            let allowed = "so small that full_well_e is not reached without light";
            return out(
                "sensor.dark_current_e_per_s",
                sensor.dark_current_e_per_s.to_string(),
                allowed,
            );
        }
        if sensor.surely_saturated_dn() <= sensor.black_level_dn {
            let found = format!("{} (dsnu_e is {})", sensor.read_noise_e, sensor.dsnu_e);
            let allowed = "so small, both together, that a full pixel is told from an empty one: \
                           below a quarter of full_well_e";
            return out("sensor.read_noise_e", found, allowed);
        }
        Ok(())
    }

    /// The picture of its point spread function, if it names one: a file in `folder`.
    ///
    /// # Errors
    /// When the file is no picture, or its sum is not positive, or its name leads out of the folder.
    pub fn read_psf(&self, folder: &Path) -> Result<Option<Plane<f32>>> {
        let name = &self.optics.psf_image;
        if name.is_empty() {
            return Ok(None);
        }
        let is_beside = Path::new(name).file_name().is_some_and(|file| file == name.as_str());
        if !is_beside {
            return Err(Error::out_of_range(
                folder.display(),
                "optics.psf_image",
                format!("{name:?}"),
                "the name of a file in this folder",
            ));
        }
        let path: PathBuf = folder.join(name);
        let picture = image::open(&path).map_err(|error| Error::malformed(&path, error))?;
        let grey = picture.to_luma32f();
        let (width, height) = (grey.width() as usize, grey.height() as usize);
        if width > 256 || height > 256 {
            let problem = format!("{width} x {height} samples, at most 256 x 256 are allowed");
            return Err(Error::malformed(&path, problem));
        }
        let plane = Plane::from_samples(width, height, grey.into_raw());
        let sum: f32 = plane.samples().iter().sum();
        if !(sum.is_finite() && sum > 0.0) || plane.samples().iter().any(|value| *value < 0.0) {
            let problem =
                format!("its samples sum to {sum}, must be positive and finite, none below 0");
            return Err(Error::malformed(&path, problem));
        }
        Ok(Some(plane))
    }
}
