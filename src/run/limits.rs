//! Refiners beside the limit: drawn junctions by the thousand, each with its Cramér-Rao bound.
//!
//! What a cell of the table holds: junctions of one kind and blur, in any orientation and phase, photographed
//! with one ratio of contrast to noise, with seeds about the vertex or where a detector sees it. Every corner has
//! its own random numbers, named by cell and index: more corners change none, and threads do not matter.

use std::f64::consts::TAU;

use rayon::prelude::*;
use serde::Serialize;

use crate::bound::junction_bound;
use crate::detect::{Detection, Detector};
use crate::geometry::{Camera, Distortion, ImagePoint};
use crate::junction::drawing::{Drawing, DrawingBuffers};
use crate::junction::rays::{MOST_RAYS, Rays};
use crate::random::Stream;
use crate::refine::{Corner, Refiner};
use crate::sensor::{CameraModel, Colour, Curve, Optics, Output, Photographer, Sensor};

/// Junctions of one kind, and how they are photographed.
#[derive(Clone, Debug)]
pub struct Cell {
    /// What the rows of the table call it.
    pub name: &'static str,
    /// Directions of the rays; the picture is turned at random \[deg\].
    pub angles_deg: &'static [f64],
    /// Of each sector.
    pub levels: [f64; MOST_RAYS],
    /// Standard deviation of the lens's blur, without the pixel's area \[px\].
    pub blur_px: f64,
    /// The largest difference of levels over the noise of a pixel.
    pub contrast_over_noise: f64,
    /// How much brighter a sector becomes for each pixel, in a direction at random, as a share of that difference.
    pub ramp_per_px: f64,
    /// Where seeds are.
    pub seeds: Seeds,
}

/// Where seeds are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Seeds {
    /// Anywhere in a disc of this radius about the vertex \[px\].
    Disc(f64),
    /// The detector's answer nearest to the vertex, of those within 6 px.
    Detector,
}

/// A refiner by name.
pub struct Contestant {
    /// What the table calls it.
    pub name: String,
    /// The algorithm.
    pub refiner: Box<dyn Refiner>,
}

/// What a refiner made of a cell.
#[derive(Clone, Debug, Serialize)]
pub struct Score {
    /// Which.
    pub refiner: String,
    /// Corners that had a seed.
    pub asked: usize,
    /// Those that were answered within [`FAILED_PX`] of the vertex.
    pub located: usize,
    /// Those that were not answered, and said so.
    pub declined: usize,
    /// Root mean square error of all that were answered, however far \[px\]; `None` where none was.
    pub rmse_px: Option<f64>,
    /// The same over that of their bounds with ramps unknown.
    pub rmse_over_bound: Option<f64>,
    /// The length of the mean error without noise, in the corner's own frame, of some \[px\].
    pub bias_px: Option<f64>,
    /// Mean of the squared error over the covariance: 2 where that is right; of methods that have one.
    pub nees: Option<f64>,
}

/// A row of the table.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The kind of junction.
    pub junction: &'static str,
    /// See [`Cell`].
    pub blur_px: f64,
    /// See [`Cell`].
    pub contrast_over_noise: f64,
    /// See [`Cell`].
    pub ramp_per_px: f64,
    /// Root mean square of the bounds, ramps known to be none \[px\].
    pub bound_px: f64,
    /// The same with ramps unknown \[px\].
    pub bound_with_ramps_px: f64,
    /// Of each refiner.
    pub scores: Vec<Score>,
}

/// Farther from the vertex than this an answer is a failure \[px\].
pub const FAILED_PX: f64 = 1.0;
/// Radius of the disc of pixels that bounds are for \[px\].
pub const BOUND_RADIUS_PX: f64 = 10.0;
/// So many corners are photographed without noise, too.
const NOISE_FREE: usize = 64;
const SIZE: usize = 48;
/// Electrons of a pixel where the radiance is 1: so many that their own noise is little.
const ELECTRONS: f64 = 2e5;
/// Where pixels are full \[radiance\]: beyond what any ramp leads to.
const FULL: f64 = 3.0;

/// Draws `count` corners of a cell and refines each by every contestant.
pub fn measure_cell(
    cell: &Cell,
    count: usize,
    contestants: &[Contestant],
    detector: &dyn Detector,
) -> Row {
    let noisy = Photographer::new("limits", &camera(cell, true), None);
    let clean = Photographer::new("limits", &camera(cell, false), None);
    let trials: Vec<Trial> = (0..count)
        .into_par_iter()
        .map_init(DrawingBuffers::default, |buffers, index| {
            let clean = (index < NOISE_FREE).then_some(&clean);
            Trial::of(cell, index, [Some(&noisy), clean], contestants, detector, buffers)
        })
        .collect();
    let mean_square = |bound: &dyn Fn(&Trial) -> Option<f64>| {
        let bounds: Vec<f64> = trials.iter().filter_map(bound).collect();
        (bounds.iter().sum::<f64>() / bounds.len() as f64).sqrt()
    };
    Row {
        junction: cell.name,
        blur_px: cell.blur_px,
        contrast_over_noise: cell.contrast_over_noise,
        ramp_per_px: cell.ramp_per_px,
        bound_px: mean_square(&|trial| trial.bound_px2[0]),
        bound_with_ramps_px: mean_square(&|trial| trial.bound_px2[1]),
        scores: contestants
            .iter()
            .enumerate()
            .map(|(index, contestant)| score(&contestant.name, index, &trials))
            .collect(),
    }
}

/// One corner and what refiners made of it.
struct Trial {
    vertex: ImagePoint,
    /// Unit vector into the first sector's middle.
    inward: [f64; 2],
    /// Squared bounds without and with ramps.
    bound_px2: [Option<f64>; 2],
    /// Of each contestant with noise; nothing where the detector saw nothing.
    corners: Vec<Corner>,
    /// The same without noise, of some.
    noise_free: Vec<Corner>,
}

impl Trial {
    fn of(
        cell: &Cell,
        index: usize,
        photographers: [Option<&Photographer>; 2],
        contestants: &[Contestant],
        detector: &dyn Detector,
        buffers: &mut DrawingBuffers,
    ) -> Self {
        let number = index.to_string();
        let name = [
            "limits",
            cell.name,
            &format!("{} {} {}", cell.blur_px, cell.contrast_over_noise, cell.ramp_per_px),
            &number,
        ];
        let mut random = Stream::named(&name);
        let drawing = drawn(cell, &mut random);
        let [x, y] = drawing.rays.vertex;
        let vertex = ImagePoint::new(x, y);
        let (far, direction) = (random.uniform().sqrt(), TAU * random.uniform());
        let plane = drawing.over_pixels([SIZE, SIZE], buffers);
        let mut corners = [Vec::new(), Vec::new()];
        let mut bound_px2 = [None; 2];
        for (which, photographer) in photographers.into_iter().enumerate() {
            let Some(photographer) = photographer else { continue };
            let light = [plane.clone(), plane.clone(), plane.clone()];
            let sigma_px = cell.blur_px.hypot(12.0_f64.sqrt().recip());
            let exposure = photographer.expose_light(light, sigma_px, &frame(), &name).exposure;
            if which == 0 {
                let rays = Rays { sigma_px, ..drawing.rays };
                bound_px2 = [false, true].map(|ramps| {
                    junction_bound(&exposure, &rays, BOUND_RADIUS_PX, ramps)
                        .map(|covariance| covariance.trace())
                });
            }
            let seed = match cell.seeds {
                Seeds::Disc(radius_px) => {
                    let (sine, cosine) = direction.sin_cos();
                    let far_px = radius_px * far;
                    let point = ImagePoint::new(x + far_px * cosine, y + far_px * sine);
                    Some(Detection::new(point, 1.0))
                }
                Seeds::Detector => detector
                    .detect(&exposure, None)
                    .into_iter()
                    .filter(|found| found.point.distance_px(vertex) <= 6.0)
                    .min_by(|a, b| {
                        let far = |found: &Detection| found.point.distance_px(vertex);
                        far(a).total_cmp(&far(b))
                    }),
            };
            let refined = |contestant: &Contestant| {
                seed.and_then(|seed| contestant.refiner.refine(&exposure, &[seed]).pop())
            };
            corners[which] = contestants.iter().filter_map(refined).collect();
        }
        let middle = drawing.rays.angles_rad[0] + 0.5 * drawing.rays.opening_rad(0);
        let [corners, noise_free] = corners;
        let inward = [middle.cos(), middle.sin()];
        Self { vertex, inward, bound_px2, corners, noise_free }
    }

    fn error_px(&self, corner: &Corner) -> [f64; 2] {
        let (dx, dy) = (corner.position.x - self.vertex.x, corner.position.y - self.vertex.y);
        let [x, y] = self.inward;
        [dx * x + dy * y, dy * x - dx * y]
    }
}

fn score(name: &str, index: usize, trials: &[Trial]) -> Score {
    let mut score = Score {
        refiner: name.to_owned(),
        asked: 0,
        located: 0,
        declined: 0,
        rmse_px: None,
        rmse_over_bound: None,
        bias_px: None,
        nees: None,
    };
    let (mut squares, mut bounds, mut nees, mut with_covariance) = (0.0, 0.0, 0.0, 0);
    let (mut bias, mut noise_free) = ([0.0; 2], 0);
    for trial in trials {
        if let Some(corner) = trial.noise_free.get(index).filter(|c| c.status.answered()) {
            let error = trial.error_px(corner);
            bias = [bias[0] + error[0], bias[1] + error[1]];
            noise_free += 1;
        }
        let Some(corner) = trial.corners.get(index) else { continue };
        score.asked += 1;
        if !corner.status.answered() {
            score.declined += 1;
            continue;
        }
        let error = trial.error_px(corner);
        let square = error[0] * error[0] + error[1] * error[1];
        score.located += usize::from(square <= FAILED_PX * FAILED_PX);
        squares += square;
        bounds += trial.bound_px2[1].unwrap_or(f64::INFINITY);
        if let Some(inverse) = corner.covariance_px2.and_then(|c| c.try_inverse()) {
            let (dx, dy) = (corner.position.x - trial.vertex.x, corner.position.y - trial.vertex.y);
            let error = nalgebra::Vector2::new(dx, dy);
            nees += error.dot(&(inverse * error));
            with_covariance += 1;
        }
    }
    let answered = score.asked - score.declined;
    if answered > 0 {
        score.rmse_px = Some((squares / answered as f64).sqrt());
        score.rmse_over_bound = Some((squares / bounds).sqrt());
    }
    score.bias_px = (noise_free > 0).then(|| bias[0].hypot(bias[1]) / f64::from(noise_free));
    score.nees = (with_covariance > 0).then(|| nees / f64::from(with_covariance));
    score
}

/// A junction of the cell, turned and placed at random.
fn drawn(cell: &Cell, random: &mut Stream) -> Drawing {
    let middle = 0.5 * (SIZE as f64 - 1.0);
    let vertex = [middle + random.uniform() - 0.5, middle + random.uniform() - 0.5];
    let turn = TAU * random.uniform();
    let mut angles_rad = [0.0; MOST_RAYS];
    for (angle, degrees) in angles_rad.iter_mut().zip(cell.angles_deg) {
        *angle = degrees.to_radians() + turn;
    }
    let contrast = cell.contrast();
    let ramps = [(); MOST_RAYS].map(|()| {
        let (sine, cosine) = (TAU * random.uniform()).sin_cos();
        [cosine, sine].map(|share| cell.ramp_per_px * contrast * share)
    });
    let count = cell.angles_deg.len();
    let rays = Rays { vertex, sigma_px: cell.blur_px, count, angles_rad };
    // Nowhere in the picture a ramp leads below black.
    let lift = cell.ramp_per_px * contrast * SIZE as f64 * std::f64::consts::FRAC_1_SQRT_2;
    Drawing { rays, levels: cell.levels.map(|level| level + lift), ramps }
}

impl Cell {
    /// The largest difference of levels.
    fn contrast(&self) -> f64 {
        let levels = &self.levels[..self.angles_deg.len()];
        let most = levels.iter().copied().fold(f64::MIN, f64::max);
        most - levels.iter().copied().fold(f64::MAX, f64::min)
    }
}

/// The frame of the pictures.
fn frame() -> Camera {
    #[allow(clippy::cast_possible_truncation, reason = "tens of pixels")]
    let size = SIZE as u32;
    let middle = 0.5 * (SIZE as f64 - 1.0);
    Camera {
        width: size,
        height: size,
        fx_px: 1000.0,
        fy_px: 1000.0,
        cx_px: middle,
        cy_px: middle,
        distortion: Distortion::NONE,
    }
}

/// A monochrome camera of the cell's blur and, if any, noise: read noise for the most part.
fn camera(cell: &Cell, has_noise: bool) -> CameraModel {
    const BLACK_DN: f64 = 4000.0;
    let sensor = |irradiance_uw_cm2| Sensor {
        pixel_pitch_um: 5.0,
        quantum_efficiency: [0.6; 3],
        wavelength_nm: [550.0; 3],
        irradiance_uw_cm2,
        exposure_time_ms: 5.0,
        dark_current_e_per_s: 0.0,
        read_noise_e: ELECTRONS * cell.contrast() / cell.contrast_over_noise,
        prnu: 0.0,
        dsnu_e: 0.0,
        full_well_e: FULL * ELECTRONS,
        gain_dn_per_e: 60_000.0 / (FULL * ELECTRONS),
        black_level_dn: BLACK_DN,
        bit_depth: 16,
    };
    let sum: f64 = sensor(1.0).electrons_at_one().iter().sum();
    CameraModel {
        colour: Colour::Mono,
        optics: Optics { gaussian_sigma_px: cell.blur_px, ..Optics::default() },
        sensor: has_noise.then(|| sensor(ELECTRONS / sum)),
        output: Output {
            bit_depth: 16,
            rounded: false,
            transfer: Curve::Linear,
            black_dn: if has_noise { BLACK_DN } else { 0.0 },
            ..Output::default()
        },
        // Full scale is where pixels are full.
        gain: if has_noise { 1.0 } else { 1.0 / FULL },
        ..CameraModel::default()
    }
}
