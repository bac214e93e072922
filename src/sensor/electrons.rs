//! From light to digital numbers: the linear model of EMVA Standard 1288, Release 4.0 Linear, section 2.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::noise::{Stream, normals, poisson};

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
/// wavelength in micrometres: EMVA 1288, equation 4.
const PHOTONS: f64 = 50.55;

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

/// A sensor's pixels: draws what they read.
pub(super) struct Pixels<'a> {
    sensor: &'a Sensor,
    shot: Stream,
    read: Stream,
    response: Option<Stream>,
    dark: Option<Stream>,
    words: Vec<u32>,
    deviates: Vec<f32>,
    spread: Vec<f32>,
}

impl<'a> Pixels<'a> {
    /// The pixels of one plane of one camera in one exposure. Those of a camera differ from each other
    /// in the same way in every exposure; noise over time is another in each.
    pub(super) fn new(sensor: &'a Sensor, camera: &str, exposure: &[&str], plane: &str) -> Self {
        let of_exposure = |kind| Stream::named(&[exposure, &[plane, kind]].concat());
        let of_camera =
            |kind, size: f64| (size > 0.0).then(|| Stream::named(&["camera", camera, plane, kind]));
        Self {
            sensor,
            shot: of_exposure("shot"),
            read: of_exposure("read"),
            response: of_camera("response", sensor.prnu),
            dark: of_camera("dark", sensor.dsnu_e),
            words: Vec::new(),
            deviates: Vec::new(),
            spread: Vec::new(),
        }
    }

    /// Turns mean electrons from light into digital numbers, for pixels from index `first` on.
    #[inline(always)]
    fn read(&mut self, first: usize, samples: &mut [f32]) {
        let sensor = self.sensor;
        for buffer in [&mut self.deviates, &mut self.spread] {
            buffer.resize(samples.len(), 0.0);
        }
        self.words.resize(samples.len(), 0);
        #[allow(clippy::cast_possible_truncation, reason = "f32 holds them to 1e-7")]
        let [dark_e, prnu, dsnu_e, read_noise_e, full_well_e, gain, black, most] = [
            sensor.dark_e(),
            sensor.prnu,
            sensor.dsnu_e,
            sensor.read_noise_e,
            sensor.full_well_e,
            sensor.gain_dn_per_e,
            sensor.black_level_dn,
            2.0_f64.powi(i32::from(sensor.bit_depth)) - 1.0,
        ]
        .map(|value| value as f32);
        if let Some(response) = &mut self.response {
            response.words(first, &mut self.words);
            normals(&self.words, &mut self.deviates);
            for (sample, deviate) in samples.iter_mut().zip(&self.deviates) {
                *sample *= (1.0 + prnu * deviate).max(0.0);
            }
        }
        for sample in samples.iter_mut() {
            *sample += dark_e;
        }
        self.shot.words(first, &mut self.words);
        poisson(&self.words, &mut self.deviates, samples);
        self.spread.fill(0.0);
        if let Some(dark) = &mut self.dark {
            dark.words(first, &mut self.words);
            normals(&self.words, &mut self.spread);
        }
        self.read.words(first, &mut self.words);
        normals(&self.words, &mut self.deviates);
        for ((sample, read), fixed) in samples.iter_mut().zip(&self.deviates).zip(&self.spread) {
            let electrons = sample.min(full_well_e) + read_noise_e * read + dsnu_e * fixed;
            *sample = (black + gain * electrons + 0.5).floor().clamp(0.0, most);
        }
    }
}

/// What pixels from index `first` on read of mean electrons, as digital numbers: compiled for the
/// machine's vectors.
pub(super) struct Read<'a, 'b> {
    pub(super) pixels: &'a mut Pixels<'b>,
    pub(super) first: usize,
    pub(super) samples: &'a mut [f32],
}

impl pulp::WithSimd for Read<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        self.pixels.read(self.first, self.samples);
    }
}
