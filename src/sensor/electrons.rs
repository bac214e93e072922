//! From light to digital numbers: the linear model of EMVA Standard 1288, Release 4.0 Linear, section 2.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::noise::{normals, poisson};
use crate::image::Plane;
use crate::random::Stream;

/// A sensor by the numbers of its EMVA 1288 data sheet.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sensor {
    /// Pitch of the pixels \[um\].
    #[schemars(range(min = 0.3, max = 100.0))]
    pub pixel_pitch_um: f64,
    /// Quantum efficiency for red, green and blue light: electrons per photon on the pixel's area.
    pub quantum_efficiency: [f64; 3],
    /// Wavelength that stands for red, green and blue light \[nm\].
    pub wavelength_nm: [f64; 3],
    /// Irradiance of the sensor in each colour where the scene's radiance is 1 \[uW/cm^2\].
    #[schemars(range(min = 1e-9, max = 1e9))]
    pub irradiance_uw_cm2: f64,
    /// Exposure time \[ms\].
    #[schemars(range(min = 1e-6, max = 1e6))]
    pub exposure_time_ms: f64,
    /// Dark current \[e-/s\].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub dark_current_e_per_s: f64,
    /// Standard deviation of the signal without light, over time \[e-\].
    #[schemars(range(min = 0.0, max = 1e4))]
    pub read_noise_e: f64,
    /// Photo response non-uniformity: standard deviation over pixels, as a share of the signal.
    #[schemars(range(min = 0.0, max = 0.2))]
    pub prnu: f64,
    /// Dark signal non-uniformity: standard deviation over pixels \[e-\].
    #[schemars(range(min = 0.0, max = 1e4))]
    pub dsnu_e: f64,
    /// Saturation capacity \[e-\].
    #[schemars(range(min = 100.0, max = 1e7))]
    pub full_well_e: f64,
    /// Overall system gain K \[DN/e-\].
    #[schemars(range(min = 1e-5, max = 1e3))]
    pub gain_dn_per_e: f64,
    /// Signal without light \[DN\].
    #[schemars(range(min = 0.0, max = 65535.0))]
    pub black_level_dn: f64,
    /// Bits of a raw sample.
    #[schemars(range(min = 8, max = 16))]
    pub bit_depth: u8,
}

/// Photons on a square micrometre in a millisecond, at one microwatt per square centimetre, by
/// wavelength in micrometres: EMVA 1288, equation 4. The standard prints 50.55; Planck's constant times
/// the speed of light, exact since 2019, give 50.34.
const PHOTONS: f64 = 1e-23 / (6.626_070_15e-34 * 299_792_458.0);

impl Sensor {
    /// Mean electrons from light where the radiance is 1, in each colour.
    pub fn electrons_at_one(&self) -> [f64; 3] {
        let area_um2 = self.pixel_pitch_um * self.pixel_pitch_um;
        [0, 1, 2].map(|colour| {
            self.quantum_efficiency[colour]
                * PHOTONS
                * area_um2
                * self.exposure_time_ms
                * (1e-3 * self.wavelength_nm[colour])
                * self.irradiance_uw_cm2
        })
    }

    /// The digital number at which samples are saturated.
    pub fn saturation_dn(&self) -> f64 {
        let most = 2.0_f64.powi(i32::from(self.bit_depth)) - 1.0;
        (self.black_level_dn + self.gain_dn_per_e * self.full_well_e).floor().min(most)
    }

    /// The digital number from which on samples are marked as saturated: what is read of a full pixel
    /// may be less by four standard deviations of its noise, and by half a number for rounding.
    pub fn surely_saturated_dn(&self) -> f64 {
        let noise_dn = self.gain_dn_per_e * self.read_noise_e.hypot(self.dsnu_e);
        self.saturation_dn() - 4.0 * noise_dn - 0.5
    }

    /// Mean electrons without light.
    pub fn dark_e(&self) -> f64 {
        self.dark_current_e_per_s * 1e-3 * self.exposure_time_ms
    }

    /// Variance over time of a sample, and over pixels, of a mean \[DN^2\].
    pub fn variance_dn2(&self, mean_dn: f64) -> f64 {
        let electrons = ((mean_dn - self.black_level_dn) / self.gain_dn_per_e).max(0.0);
        let light_e = (electrons - self.dark_e()).max(0.0);
        let variance_e = electrons
            + self.read_noise_e.powi(2)
            + self.dsnu_e.powi(2)
            + (self.prnu * light_e).powi(2);
        self.gain_dn_per_e.powi(2) * variance_e + 1.0 / 12.0
    }
}

/// The index of a pixel among the random numbers: the same in frames of all sizes.
fn index(x: usize, y: usize) -> usize {
    (y << 16) + x
}

/// How the pixels of a camera differ from each other, the same in every exposure: of each plane.
#[derive(Debug)]
pub(super) struct Pattern {
    /// Factor of the response to light.
    response: Plane<f32>,
    /// Signal without light, beyond the mean \[e-\].
    dark_e: Plane<f32>,
}

impl Pattern {
    /// That of a plane of a camera, from its name alone.
    pub(super) fn new(sensor: &Sensor, camera: &str, plane: &str, size: [usize; 2]) -> Self {
        let [width, height] = size;
        let arch = pulp::Arch::new();
        let (mut words, mut deviates) = (vec![0; width], vec![0.0; width]);
        let mut drawn = |kind: &str, mean: f32, deviation: f64| {
            let mut values = Plane::filled(width, height, mean);
            if deviation > 0.0 {
                let mut stream = Stream::named(&["camera", camera, plane, kind]);
                for y in 0..height {
                    stream.words(index(0, y), &mut words);
                    arch.dispatch(|| normals(&words, &mut deviates));
                    for (value, deviate) in values.row_mut(y).iter_mut().zip(&deviates) {
                        #[allow(clippy::cast_possible_truncation, reason = "f32 holds it")]
                        let deviation = deviation as f32;
                        *value = mean + deviation * deviate;
                    }
                }
            }
            values
        };
        let response = drawn("response", 1.0, sensor.prnu).map(|factor| factor.max(0.0));
        Self { response, dark_e: drawn("dark", 0.0, sensor.dsnu_e) }
    }

    /// Whether it covers a frame of this size.
    pub(super) fn covers(&self, [width, height]: [usize; 2]) -> bool {
        self.response.width() >= width && self.response.height() >= height
    }
}

/// A sensor's pixels in one exposure: draws what they read.
pub(super) struct Pixels<'a> {
    sensor: &'a Sensor,
    pattern: &'a Pattern,
    shot: Stream,
    read: Stream,
    words: Vec<u32>,
    deviates: Vec<f32>,
}

impl<'a> Pixels<'a> {
    /// The pixels of one plane in the exposure of a name.
    pub(super) fn new(
        sensor: &'a Sensor,
        pattern: &'a Pattern,
        exposure: &[&str],
        plane: &str,
    ) -> Self {
        let named = |kind| Stream::named(&[exposure, &[plane, kind]].concat());
        Self {
            sensor,
            pattern,
            shot: named("shot"),
            read: named("read"),
            words: Vec::new(),
            deviates: Vec::new(),
        }
    }

    /// Turns light into light as the digital numbers say, for pixels of a row from (x, y) on.
    #[inline(always)]
    fn read(
        &mut self,
        [x, y]: [usize; 2],
        to_electrons: &[f32],
        to_light: &[f32],
        samples: &mut [f32],
    ) {
        let sensor = self.sensor;
        self.deviates.resize(samples.len(), 0.0);
        self.words.resize(samples.len(), 0);
        #[allow(clippy::cast_possible_truncation, reason = "f32 holds them to 1e-7")]
        let [mean_dark_e, read_noise_e, full_well_e, gain, black, most] = [
            sensor.dark_e(),
            sensor.read_noise_e,
            sensor.full_well_e,
            sensor.gain_dn_per_e,
            sensor.black_level_dn,
            2.0_f64.powi(i32::from(sensor.bit_depth)) - 1.0,
        ]
        .map(|value| value as f32);
        let response = &self.pattern.response.row(y)[x..x + samples.len()];
        let dark_e = &self.pattern.dark_e.row(y)[x..x + samples.len()];
        for ((sample, to_electrons), response) in samples.iter_mut().zip(to_electrons).zip(response)
        {
            *sample = *sample * to_electrons * response + mean_dark_e;
        }
        self.shot.words(index(x, y), &mut self.words);
        poisson(&self.words, &mut self.deviates, samples);
        self.read.words(index(x, y), &mut self.words);
        normals(&self.words, &mut self.deviates);
        for (((sample, read), dark_e), to_light) in
            samples.iter_mut().zip(&self.deviates).zip(dark_e).zip(to_light)
        {
            let electrons = sample.min(full_well_e) + read_noise_e * read + dark_e;
            let number = (black + gain * electrons + 0.5).floor().clamp(0.0, most);
            *sample = (number - black) * to_light;
        }
    }
}

/// What pixels of a row read: compiled for the machine's vectors.
pub(super) struct Read<'a, 'b> {
    pub(super) pixels: &'a mut Pixels<'b>,
    /// The first of them.
    pub(super) first: [usize; 2],
    /// Of each pixel, electrons per light.
    pub(super) to_electrons: &'a [f32],
    /// Of each pixel, light per digital number above black.
    pub(super) to_light: &'a [f32],
    /// Light, with noise when done.
    pub(super) samples: &'a mut [f32],
}

impl pulp::WithSimd for Read<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        self.pixels.read(self.first, self.to_electrons, self.to_light, self.samples);
    }
}
