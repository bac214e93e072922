//! Taking photographs: film to light, light to electrons, electrons to a picture.

use std::sync::{Arc, PoisonError, RwLock};

use crate::error::{Error, Result};
use crate::geometry::Camera;
use crate::image::{PixelRange, Plane};
use crate::junction::BlurredJunction;
use crate::scene::Film;
use crate::sensor::distort::distorted;
use crate::sensor::electrons::{Pattern, Pixels, Read};
use crate::sensor::kernel::{GatherBuffers, Kernel};
use crate::sensor::mosaic::{demosaiced, filter};
use crate::sensor::optics::{Spread, illumination};
use crate::sensor::transfer::Quantiser;
use crate::sensor::{
    CameraModel, Colour, Demosaic, Encoding, Exposure, NoiseModel, Optics, Sensor, Transfer,
};

/// Rec. 709 luminance: what a camera that sees no colour and has no sensor makes of light.
const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// The planes' names among the random numbers.
const PLANES: [&str; 3] = ["0", "1", "2"];

/// A camera model made ready to take photographs.
#[derive(Debug)]
pub struct Photographer {
    name: String,
    model: CameraModel,
    spread: Spread,
    psf: Option<Plane<f32>>,
    quantiser: Option<Quantiser>,
    /// How its pixels differ, of each plane, for the largest frame so far.
    patterns: [RwLock<Option<Arc<Pattern>>>; 3],
}

/// Which photograph.
#[derive(Clone, Copy, Debug)]
pub struct Shot<'a> {
    /// The scene's name, and whatever else tells this exposure from others: names its noise.
    pub name: &'a [&'a str],
    /// The part of the frame that is taken; `None`: all of it.
    pub window: Option<PixelRange>,
}

/// A photograph, and what only the scorer may know of it.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// What an algorithm may see.
    pub exposure: Exposure,
    /// The camera as it was: phase, window and distortion included. It projects truth into the
    /// exposure.
    pub camera: Camera,
    /// Standard deviation of blur and pixel area along one axis, the mean of both \[px\].
    pub blur_px: f64,
    /// The light on the pixels without noise, in units of radiance: one plane per channel that the
    /// pixels see.
    pub light: Vec<Plane<f32>>,
}

/// Red, green and blue light on the pixels of a window, and how it got there.
struct Gathered {
    planes: [Plane<f32>; 3],
    /// Where in the film's image the centre of pixel (0, 0) is \[px\].
    phase_px: [f64; 2],
    /// Standard deviation of blur and pixel area along one axis \[px\].
    blur_px: f64,
}

/// Memory that photographs need; kept from one to the next.
#[derive(Debug, Default)]
pub struct PhotographBuffers {
    gather: GatherBuffers,
}

impl Photographer {
    /// Makes a camera ready. `psf` is the picture of its point spread function, if it has one.
    pub fn new(name: &str, model: &CameraModel, psf: Option<&Plane<f32>>) -> Self {
        let output = &model.output;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 65535")]
        let quantiser = output.rounded.then(|| {
            Quantiser::new(output.curve(), (2.0_f64.powi(output.bit_depth.into()) - 1.0) as u16)
        });
        Self {
            name: name.to_owned(),
            model: model.clone(),
            spread: model.optics.spread(psf),
            psf: psf.cloned(),
            quantiser,
            patterns: Default::default(),
        }
    }

    /// A camera of the same name and point spread function with another model.
    pub fn with_model(&self, model: &CameraModel) -> Self {
        Self::new(&self.name, model, self.psf.as_ref())
    }

    /// Whether its image is that of a pinhole, blurred by a Gaussian, on pixels without gaps.
    pub fn has_gaussian_blur_alone(&self) -> bool {
        let Optics { fill_factor, corner_illumination, distortion, .. } = &self.model.optics;
        let is_even = *fill_factor >= 1.0 && *corner_illumination >= 1.0;
        self.spread.is_point() && is_even && distortion.is_none()
    }

    /// All that decides what it makes of a film.
    pub fn identity(&self) -> serde_json::Value {
        let psf = self.psf.as_ref().map(|psf| (psf.width(), psf.samples()));
        serde_json::json!([self.name, self.model, psf])
    }

    /// The camera's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether its colours are made of a mosaic.
    pub fn has_mosaic(&self) -> bool {
        self.model.colour == Colour::Rggb && self.model.output.demosaic != Demosaic::Raw
    }

    /// The camera's model.
    pub fn model(&self) -> &CameraModel {
        &self.model
    }

    /// The weights of film cells at a phase: the centre of pixel (0, 0) is at image point `phase_px`
    /// of the film. They serve all scenes of one oversampling.
    pub fn kernel(&self, oversampling: u32, phase_px: [f64; 2]) -> Kernel {
        self.model.optics.kernel(oversampling, phase_px, &self.spread)
    }

    /// What the film of `camera` shows through the camera's lens; `None` where it does not distort.
    ///
    /// # Errors
    /// When the distortion folds the image of this camera.
    pub fn through_lens(&self, film: &Film, camera: &Camera) -> Result<Option<Film>> {
        let distortion = &self.model.optics.distortion;
        if distortion.is_none() {
            return Ok(None);
        }
        if !(Camera { distortion: *distortion, ..*camera }).is_one_to_one() {
            return Err(Error::out_of_range(
                format!("camera {}", self.name),
                "optics.distortion",
                format!("{distortion:?}"),
                format!(
                    "such that no two points of a {} x {} px image with focal length {:.1} px are \
                     seen at one place",
                    camera.width, camera.height, camera.fx_px
                ),
            ));
        }
        Ok(Some(distorted(film, camera, distortion)))
    }

    /// Takes a photograph of `camera`'s film through the lens, whole, at a phase.
    ///
    /// # Errors
    /// When the distortion folds the image of this camera.
    pub fn take(
        &self,
        film: &Film,
        camera: &Camera,
        phase_px: [f64; 2],
        name: &[&str],
    ) -> Result<Photograph> {
        let bent = self.through_lens(film, camera)?;
        let kernel = self.kernel(film.oversampling, phase_px);
        let shot = Shot { name, window: None };
        let film = bent.as_ref().unwrap_or(film);
        Ok(self.expose(film, camera, &kernel, &shot, &mut PhotographBuffers::default()))
    }

    /// Takes a photograph of a film, which was taken through the camera's lens if it distorts.
    pub fn expose(
        &self,
        film: &Film,
        camera: &Camera,
        kernel: &Kernel,
        shot: &Shot,
        buffers: &mut PhotographBuffers,
    ) -> Photograph {
        let (wanted, window) = self.windows(camera, shot);
        let planes = film.radiance.each_ref().map(|radiance| {
            let mut light = Plane::filled(window.width(), window.height(), 0.0);
            kernel.gather(radiance, window, &mut buffers.gather, &mut light);
            light
        });
        let gathered = Gathered { planes, phase_px: kernel.phase_px(), blur_px: kernel.blur_px() };
        self.developed(gathered, camera, wanted, window, shot)
    }

    /// Takes a photograph of blurred junctions instead of a film: one of each of the three colours,
    /// in one place. The blur is theirs; the aperture, the noise and the picture are this camera's.
    ///
    /// # Errors
    /// When this camera has any blur but a Gaussian, whose size is not the junctions'.
    pub fn expose_junction(
        &self,
        junction: &[BlurredJunction; 3],
        camera: &Camera,
        shot: &Shot,
    ) -> Result<Photograph> {
        let optics = &self.model.optics;
        let sigma_px = optics.gaussian_sigma_px;
        let is_same = junction.iter().all(|j| (j.sigma_px - sigma_px).abs() < 1e-9);
        if !is_same || !self.spread.is_point() || !optics.distortion.is_none() {
            return Err(Error::out_of_range(
                format!("camera {}", self.name),
                "optics",
                format!("{optics:?}"),
                format!(
                    "a Gaussian blur alone, of the junction's {} px, without distortion",
                    junction[0].sigma_px
                ),
            ));
        }
        let (wanted, window) = self.windows(camera, shot);
        let aperture_px = optics.fill_factor.sqrt().max(1e-3);
        let planes = junction.each_ref().map(|junction| {
            #[allow(clippy::cast_possible_truncation, reason = "radiance is kept as f32")]
            Plane::from_fn(window.width(), window.height(), |x, y| {
                junction.over_pixel(window.x0 + x, window.y0 + y, aperture_px) as f32
            })
        });
        let blur_px = sigma_px.hypot(aperture_px / 12.0_f64.sqrt());
        let gathered = Gathered { planes, phase_px: [0.0, 0.0], blur_px };
        Ok(self.developed(gathered, camera, wanted, window, shot))
    }

    /// Takes a photograph of light that is on the pixels of the whole frame already, blurred by `blur_px` with
    /// the pixel's area. The noise and the picture are this camera's, its optics have no part in it.
    ///
    /// # Panics
    /// When the planes are not of the camera's size: a mistake of the caller's code.
    pub fn expose_light(
        &self,
        planes: [Plane<f32>; 3],
        blur_px: f64,
        camera: &Camera,
        name: &[&str],
    ) -> Photograph {
        let (wanted, window) = self.windows(camera, &Shot { name, window: None });
        for plane in &planes {
            let size = [plane.width(), plane.height()];
            assert_eq!(size, [window.width(), window.height()], "light of the camera's size");
        }
        let gathered = Gathered { planes, phase_px: [0.0, 0.0], blur_px };
        self.developed(gathered, camera, wanted, window, &Shot { name, window: None })
    }

    /// What a photograph of a whole frame is the noisy picture of: the same light, its noise's mean, with the
    /// model of its noise.
    pub fn noise_free(&self, photograph: &Photograph) -> Exposure {
        let full = self.full_light();
        let is_mosaic = self.model.colour == Colour::Rggb;
        let factors = self.light_factors();
        let samples: Vec<Plane<f32>> = photograph
            .light
            .iter()
            .enumerate()
            .map(|(channel, plane)| {
                Plane::from_fn(plane.width(), plane.height(), |x, y| {
                    let own = if is_mosaic { filter(x, y) } else { channel };
                    (factors[own] * plane.at(x, y)).min(full[channel])
                })
            })
            .collect();
        let exposure = &photograph.exposure;
        let whole = PixelRange { x0: 0, y0: 0, x1: exposure.width(), y1: exposure.height() };
        let rgb = self.pictured(samples, whole, whole);
        let saturated = exposure.saturated().clone();
        let exposure = Exposure::photographed(rgb, exposure.encoding(), saturated, self.noise())
            .with_camera(photograph.camera);
        self.of_mosaic(exposure, [0, 0])
    }

    /// What a picture's samples \[DN\] are, the whole frame of which this camera took: its curve, black level, noise,
    /// saturation and mosaic are the model's. A sample is at most full scale.
    ///
    /// # Errors
    /// As of [`Exposure::new`].
    pub fn exposure_of(&self, rgb: [Plane<f32>; 3]) -> Result<Exposure> {
        let encoding = self.encoding();
        let exposure = Exposure::new(rgb, encoding)?;
        let rgb = exposure.rgb();
        let span_dn = encoding.full_scale_dn() - encoding.black_dn;
        #[allow(clippy::cast_possible_truncation, reason = "at most 65535")]
        let full = self.full_light().map(|light| {
            (encoding.black_dn + span_dn * encoding.transfer.encode(light.into()) - 0.5) as f32
        });
        let saturated = Plane::from_fn(rgb[0].width(), rgb[0].height(), |x, y| {
            (0..3).any(|channel| rgb[channel].at(x, y) >= full[channel])
        });
        let saturated = dilated(&saturated, self.reach());
        Ok(self.of_mosaic(exposure.with_sensor(saturated, self.noise()), [0, 0]))
    }

    /// How samples are to be read.
    fn encoding(&self) -> Encoding {
        let output = &self.model.output;
        Encoding {
            bit_depth: output.bit_depth,
            transfer: output.curve(),
            black_dn: output.black_dn,
        }
    }

    /// What becomes of light in each channel, but for noise: as [`Self::digitise`] leaves it, full scale is 1.
    fn light_factors(&self) -> [f32; 3] {
        let sensor = self.model.sensor.as_ref();
        let factors = sensor.zip(self.electrons_at_one()).zip(self.light_per_dn()).map_or(
            [self.model.gain; 3],
            |((sensor, electrons), scale)| {
                // Raw samples keep the sensor's colours.
                let is_raw = self.model.colour == Colour::Rggb
                    && self.model.output.demosaic == Demosaic::Raw;
                [0, 1, 2].map(|c: usize| {
                    electrons[c] * sensor.gain_dn_per_e * scale[if is_raw { 1 } else { c }]
                })
            },
        );
        #[allow(clippy::cast_possible_truncation, reason = "f32 holds it to 1e-7")]
        factors.map(|factor| factor as f32)
    }

    /// An exposure that knows which samples are the sensor's own; its first pixel is this one of the sensor.
    fn of_mosaic(&self, exposure: Exposure, origin: [usize; 2]) -> Exposure {
        if self.has_mosaic() { exposure.with_mosaic(origin) } else { exposure }
    }

    /// The part of the frame that is wanted, and what of it has to be taken for that.
    fn windows(&self, camera: &Camera, shot: &Shot) -> (PixelRange, PixelRange) {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let whole = PixelRange { x0: 0, y0: 0, x1: width, y1: height };
        let wanted = shot.window.unwrap_or(whole);
        // Colours near the window's border are made of samples beyond it.
        (wanted, wanted.grown(self.reach(), width, height))
    }

    /// How far from a pixel samples lie that its colour is made of \[px\].
    fn reach(&self) -> usize {
        if self.model.colour == Colour::Rggb { self.model.output.demosaic.reach() } else { 0 }
    }

    /// What becomes of gathered light.
    fn developed(
        &self,
        Gathered { planes, phase_px: [phase_x, phase_y], blur_px }: Gathered,
        camera: &Camera,
        wanted: PixelRange,
        window: PixelRange,
        shot: &Shot,
    ) -> Photograph {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut light = self.light(planes, [width, height], window);
        let mut samples = light.clone();
        let full = self.full_light();
        let mut saturated = Plane::filled(window.width(), window.height(), false);
        for (channel, plane) in samples.iter_mut().enumerate() {
            self.digitise(channel, plane, window, [width, height], shot);
            for (saturated, &sample) in saturated.samples_mut().iter_mut().zip(plane.samples()) {
                *saturated |= sample >= full[channel];
            }
        }
        let reach = self.reach();
        let inner = PixelRange {
            x0: wanted.x0 - window.x0,
            y0: wanted.y0 - window.y0,
            x1: wanted.x1 - window.x0,
            y1: wanted.y1 - window.y0,
        };
        let rgb = self.pictured(samples, window, inner);
        let saturated = if reach > 0 { dilated(&saturated, reach) } else { saturated };
        let saturated = if inner.width() == window.width() && inner.height() == window.height() {
            saturated
        } else {
            light = light.iter().map(|plane| plane.crop(inner)).collect();
            saturated.crop(inner)
        };
        #[allow(clippy::cast_possible_truncation, reason = "no larger than the camera's")]
        let camera = Camera {
            width: wanted.width() as u32,
            height: wanted.height() as u32,
            cx_px: camera.cx_px - phase_x - wanted.x0 as f64,
            cy_px: camera.cy_px - phase_y - wanted.y0 as f64,
            distortion: self.model.optics.distortion,
            ..*camera
        };
        let exposure = Exposure::photographed(rgb, self.encoding(), saturated, self.noise())
            .with_camera(camera);
        Photograph {
            exposure: self.of_mosaic(exposure, [wanted.x0, wanted.y0]),
            camera,
            blur_px,
            light,
        }
    }

    /// The light on the pixels in each channel that they see \[radiance\].
    fn light(
        &self,
        planes: [Plane<f32>; 3],
        [width, height]: [usize; 2],
        window: PixelRange,
    ) -> Vec<Plane<f32>> {
        let mut planes = Vec::from(planes);
        let corner = self.model.optics.corner_illumination;
        if corner < 1.0 {
            let share = illumination(corner, width, height);
            for plane in &mut planes {
                for y in 0..window.height() {
                    for (x, light) in plane.row_mut(y).iter_mut().enumerate() {
                        *light *= share(window.x0 + x, window.y0 + y);
                    }
                }
            }
        }
        match self.model.colour {
            Colour::Rgb => planes,
            Colour::Mono => {
                let weights = self.mono_weights();
                let [red, green, blue] = [0, 1, 2].map(|c: usize| planes[c].samples());
                let sums = red
                    .iter()
                    .zip(green)
                    .zip(blue)
                    .map(|((r, g), b)| weights[0] * r + weights[1] * g + weights[2] * b)
                    .collect();
                vec![Plane::from_samples(window.width(), window.height(), sums)]
            }
            Colour::Rggb => vec![Plane::from_fn(window.width(), window.height(), |x, y| {
                planes[filter(window.x0 + x, window.y0 + y)].at(x, y)
            })],
        }
    }

    /// What red, green and blue light count in a pixel that sees all as one; they sum to 1.
    fn mono_weights(&self) -> [f32; 3] {
        let Some(sensor) = &self.model.sensor else { return LUMINANCE };
        let electrons = sensor.electrons_at_one();
        let sum: f64 = electrons.iter().sum();
        #[allow(clippy::cast_possible_truncation, reason = "in (0, 1)")]
        electrons.map(|value| (value / sum) as f32)
    }

    /// Electrons at radiance 1 in each channel that the pixels see.
    fn electrons_at_one(&self) -> Option<[f64; 3]> {
        let electrons = self.model.sensor.as_ref()?.electrons_at_one();
        Some(match self.model.colour {
            // A pixel without a filter gathers all three.
            Colour::Mono => [electrons.iter().sum(); 3],
            Colour::Rgb | Colour::Rggb => electrons,
        })
    }

    /// Light of full scale per raw number above black, by channel: white stays white.
    fn light_per_dn(&self) -> Option<[f64; 3]> {
        let sensor = self.model.sensor.as_ref()?;
        let electrons = self.electrons_at_one()?;
        let most = electrons.iter().copied().fold(0.0, f64::max);
        let saturation = sensor.saturation_dn() - sensor.black_level_dn;
        Some(electrons.map(|value| self.model.gain * most / value / saturation))
    }

    fn noise(&self) -> Option<NoiseModel> {
        let sensor = self.model.sensor.clone()?;
        Some(NoiseModel { sensor, light_per_dn: self.light_per_dn()? })
    }

    /// The light at which each channel is saturated, as [`Self::digitise`] leaves it.
    fn full_light(&self) -> [f32; 3] {
        let Some((sensor, scale)) = self.model.sensor.as_ref().zip(self.light_per_dn()) else {
            return [1.0; 3];
        };
        let surely = sensor.surely_saturated_dn() - sensor.black_level_dn;
        #[allow(clippy::cast_possible_truncation, reason = "some size near 1")]
        scale.map(|scale| 1.0_f64.min(scale * surely) as f32)
    }

    /// Turns light into light again, as the sensor's raw numbers say: full scale is 1.
    fn digitise(
        &self,
        channel: usize,
        plane: &mut Plane<f32>,
        window: PixelRange,
        frame: [usize; 2],
        shot: &Shot,
    ) {
        #[allow(clippy::cast_possible_truncation, reason = "f32 holds it to 1e-7")]
        let gain = self.model.gain as f32;
        let arch = pulp::Arch::new();
        let Some(((sensor, electrons), scale)) =
            self.model.sensor.as_ref().zip(self.electrons_at_one()).zip(self.light_per_dn())
        else {
            for sample in plane.samples_mut() {
                *sample *= gain;
            }
            return;
        };
        let pattern = self.pattern(sensor, channel, frame);
        let mut pixels = Pixels::new(sensor, &pattern, shot.name, PLANES[channel]);
        let is_mosaic = self.model.colour == Colour::Rggb;
        let is_raw = is_mosaic && self.model.output.demosaic == Demosaic::Raw;
        let own = |x: usize, y: usize| if is_mosaic { filter(x, y) } else { channel };
        // What the filters of an even and of an odd row make of light, and of raw numbers.
        #[allow(clippy::cast_possible_truncation, reason = "f32 holds them to 1e-7")]
        let factors: [[Vec<f32>; 2]; 2] = [0, 1].map(|parity| {
            let columns = window.x0..window.x1;
            [
                columns.clone().map(|x| electrons[own(x, parity)] as f32).collect(),
                // Raw samples keep the sensor's colours.
                columns.map(|x| scale[if is_raw { 1 } else { own(x, parity) }] as f32).collect(),
            ]
        });
        for y in 0..window.height() {
            let [to_electrons, to_light] = &factors[(window.y0 + y) % 2];
            let first = [window.x0, window.y0 + y];
            let samples = plane.row_mut(y);
            arch.dispatch(Read { pixels: &mut pixels, first, to_electrons, to_light, samples });
        }
    }

    /// How the pixels of a plane differ from each other, for a frame of a size.
    fn pattern(&self, sensor: &Sensor, channel: usize, frame: [usize; 2]) -> Arc<Pattern> {
        let kept = &self.patterns[channel];
        let there = kept.read().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(pattern) = there.filter(|pattern| pattern.covers(frame)) {
            return pattern;
        }
        let pattern = Arc::new(Pattern::new(sensor, &self.name, PLANES[channel], frame));
        *kept.write().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&pattern));
        pattern
    }

    /// Encodes linear samples, full scale 1, as the picture that the camera gives.
    fn pictured(
        &self,
        samples: Vec<Plane<f32>>,
        window: PixelRange,
        inner: PixelRange,
    ) -> [Plane<f32>; 3] {
        let output = &self.model.output;
        let is_mosaic = self.model.colour == Colour::Rggb;
        let is_whole = inner.width() == window.width() && inner.height() == window.height();
        let mut planes = match samples.as_slice() {
            [mosaic] if is_mosaic && output.demosaic != Demosaic::Raw => {
                demosaiced(mosaic, [window.x0, window.y0], output.demosaic).to_vec()
            }
            _ => samples,
        };
        if !is_whole {
            planes = planes.iter().map(|plane| plane.crop(inner)).collect();
        }
        #[allow(clippy::cast_possible_truncation, reason = "at most 65535")]
        let (full, black) =
            ((2.0_f64.powi(output.bit_depth.into()) - 1.0) as f32, output.black_dn as f32);
        let curve = output.curve();
        for plane in &mut planes {
            let samples = plane.samples_mut().iter_mut();
            match (&self.quantiser, curve) {
                (Some(_), Transfer::Linear) => samples.for_each(|sample| {
                    *sample = (black + *sample * (full - black) + 0.5).floor().clamp(0.0, full);
                }),
                (None, Transfer::Linear) => {
                    samples.for_each(|sample| *sample = black + *sample * (full - black));
                }
                (Some(quantiser), _) => quantiser.quantise(plane.samples_mut()),
                #[allow(clippy::cast_possible_truncation, reason = "at most 65535")]
                (None, _) => samples.for_each(|sample| {
                    *sample = curve.encode(f64::from(sample.clamp(0.0, 1.0))) as f32 * full;
                }),
            }
        }
        let rgb: [Plane<f32>; 3] = match <[Plane<f32>; 3]>::try_from(planes) {
            Ok(rgb) => rgb,
            Err(one) => [one[0].clone(), one[0].clone(), one[0].clone()],
        };
        if output.jpeg_quality > 0 { through_jpeg(rgb, output.jpeg_quality) } else { rgb }
    }
}

/// Three planes of 8-bit samples, written as a JPEG file and read again.
fn through_jpeg(rgb: [Plane<f32>; 3], quality: u8) -> [Plane<f32>; 3] {
    let encoding = Encoding { bit_depth: 8, transfer: super::Transfer::Srgb, black_dn: 0.0 };
    let picture = Exposure::of_finite(rgb.clone(), encoding).to_picture();
    let mut file = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut file, quality);
    let read = picture
        .write_with_encoder(encoder)
        .and_then(|()| image::load_from_memory_with_format(&file, image::ImageFormat::Jpeg));
    // A picture in memory of at most 65535 pixels a side can be written and read.
    let Ok(read) = read else { return rgb };
    Exposure::from_picture(&read.to_rgb8()).rgb().clone()
}

/// Where any sample within `reach` is true.
fn dilated(mask: &Plane<bool>, reach: usize) -> Plane<bool> {
    let (width, height) = (mask.width(), mask.height());
    let wide = Plane::from_fn(width, height, |x, y| {
        let row = &mask.row(y)[x.saturating_sub(reach)..(x + reach + 1).min(width)];
        row.contains(&true)
    });
    Plane::from_fn(width, height, |x, y| {
        (y.saturating_sub(reach)..(y + reach + 1).min(height)).any(|y| wide.at(x, y))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_picture_of_the_point_spread_is_another_camera() {
        let camera = |level: Option<f32>| {
            let psf = level.map(|level| Plane::from_fn(3, 3, |x, _| level * x as f32 + 1.0));
            Photographer::new("a", &CameraModel::default(), psf.as_ref()).identity()
        };
        assert_eq!(camera(Some(0.5)), camera(Some(0.5)));
        assert_ne!(camera(Some(0.5)), camera(Some(0.25)));
        assert_ne!(camera(Some(0.5)), camera(None));
    }
}
