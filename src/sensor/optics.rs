//! From film to the light on the pixels: blur, aperture, phase, integrated exactly over film cells.
//!
//! A pixel's value is the integral of the film, constant over each of its cells, against the point
//! spread function convolved with the pixel's aperture. Of a Gaussian and a square aperture that
//! integral has a closed form. Discs, diffraction, motion and pictures of a point spread function are
//! many point masses on a fine lattice, each convolved with that closed form.

use nalgebra::DMatrix;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::Distortion;
use crate::image::Plane;
use crate::sensor::kernel::Kernel;

/// What lies between the scene and the pixels. Blurs that are given are convolved with each other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Optics {
    /// Standard deviation of a Gaussian blur \[px\].
    #[schemars(range(min = 0.0, max = 8.0))]
    pub gaussian_sigma_px: f64,
    /// Radius of the disc of a point out of focus \[px\].
    #[schemars(range(min = 0.0, max = 16.0))]
    pub defocus_radius_px: f64,
    /// Radius of the first dark ring of the diffraction pattern of a round aperture \[px\]: 1.22 times
    /// wavelength times f-number, over the pixel's pitch.
    #[schemars(range(min = 0.0, max = 8.0))]
    pub airy_radius_px: f64,
    /// Length of a uniform straight motion during the exposure \[px\].
    #[schemars(range(min = 0.0, max = 32.0))]
    pub motion_length_px: f64,
    /// Its direction, from x right towards y down \[deg\].
    #[schemars(range(min = -360.0, max = 360.0))]
    pub motion_angle_deg: f64,
    /// A picture of the point spread function, a file beside the camera's: its grey values, linear.
    pub psf_image: String,
    /// Samples of that picture per pixel of the sensor.
    #[schemars(range(min = 0.25, max = 64.0))]
    pub psf_samples_per_px: f64,
    /// Share of a pixel's area that gathers light: a square about its centre. Of 0 a pixel sees one
    /// film cell alone.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub fill_factor: f64,
    /// Illumination of the frame's corners, relative to its middle; it falls with the square of the
    /// distance.
    #[schemars(range(min = 0.05, max = 1.0))]
    pub corner_illumination: f64,
    /// Brown-Conrady distortion.
    pub distortion: Distortion,
}

impl Default for Optics {
    fn default() -> Self {
        Self {
            gaussian_sigma_px: 0.0,
            defocus_radius_px: 0.0,
            airy_radius_px: 0.0,
            motion_length_px: 0.0,
            motion_angle_deg: 0.0,
            psf_image: String::new(),
            psf_samples_per_px: 1.0,
            fill_factor: 1.0,
            corner_illumination: 1.0,
            distortion: Distortion::default(),
        }
    }
}

/// A point mass of a point spread function: place \[px\] and share.
#[derive(Clone, Copy, Debug)]
struct Mass {
    x: f64,
    y: f64,
    share: f64,
}

/// A Gaussian is cut off at so many standard deviations: 1e-6 of it lie beyond.
const GAUSSIAN_REACH: f64 = 5.0;

/// The diffraction pattern is cut off at so many radii of its first dark ring: there it holds 97 %.
const AIRY_REACH: f64 = 8.0;

/// All blurs but the Gaussian, as point masses on a lattice: the same at every phase.
#[derive(Clone, Debug)]
pub(super) struct Spread {
    /// Distance of neighbours \[px\].
    step_px: f64,
    /// Place of the first column and row \[px\].
    first_px: [f64; 2],
    /// Rows go down.
    masses: DMatrix<f64>,
}

/// The finest lattice, and about how many points it has across at most.
const FINEST_PX: f64 = 1.0 / 64.0;
const MOST_POINTS: f64 = 512.0;

impl Spread {
    fn point(step_px: f64) -> Self {
        Self { step_px, first_px: [0.0, 0.0], masses: DMatrix::from_element(1, 1, 1.0) }
    }

    /// Convolved with masses; each is shared out to its four neighbours on the lattice, which keeps
    /// the centroid.
    fn convolved(&self, with: &[Mass]) -> Self {
        let range = |along: fn(&Mass) -> f64| {
            with.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), mass| {
                let place = (along(mass) / self.step_px).floor();
                (low.min(place), high.max(place + 1.0))
            })
        };
        let ((left, right), (top, bottom)) = (range(|mass| mass.x), range(|mass| mass.y));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from below")]
        let index = |place: f64| place as usize;
        let (rows, columns) = self.masses.shape();
        let mut masses = DMatrix::zeros(rows + index(bottom - top), columns + index(right - left));
        for mass in with {
            let (x, y) = (mass.x / self.step_px - left, mass.y / self.step_px - top);
            let (u, v) = (x.fract(), y.fract());
            for (dx, dy, share) in [
                (0, 0, (1.0 - u) * (1.0 - v)),
                (1, 0, u * (1.0 - v)),
                (0, 1, (1.0 - u) * v),
                (1, 1, u * v),
            ] {
                if share > 0.0 {
                    let mut place =
                        masses.view_mut((index(y) + dy, index(x) + dx), (rows, columns));
                    place += &self.masses * (share * mass.share);
                }
            }
        }
        let first_px =
            [self.first_px[0] + left * self.step_px, self.first_px[1] + top * self.step_px];
        Self { step_px: self.step_px, first_px, masses }
    }

    pub(super) fn is_point(&self) -> bool {
        self.masses.len() == 1
    }

    /// The farthest that a mass lies from the middle, across or down \[px\].
    fn reach_px(&self, axis: usize) -> f64 {
        let count = [self.masses.ncols(), self.masses.nrows()][axis];
        let last = self.first_px[axis] + (count as f64 - 1.0) * self.step_px;
        self.first_px[axis].abs().max(last.abs())
    }
}

impl Optics {
    /// All blurs but the Gaussian. `psf` is the picture that `psf_image` names.
    pub(super) fn spread(&self, psf: Option<&Plane<f32>>) -> Spread {
        let mut blurs = Vec::new();
        if self.defocus_radius_px > 0.0 {
            blurs.push(disc(self.defocus_radius_px, |_| 1.0));
        }
        if self.airy_radius_px > 0.0 {
            // The first zero of J1.
            let scale = 3.831_705_970_207_512 / self.airy_radius_px;
            let intensity = |radius: f64| {
                let v = scale * radius;
                if v < 1e-6 { 1.0 } else { (2.0 * libm::j1(v) / v).powi(2) }
            };
            blurs.push(disc(AIRY_REACH * self.airy_radius_px, intensity));
        }
        if let Some(psf) = psf {
            blurs.push(picture(psf, self.psf_samples_per_px));
        }
        if self.motion_length_px > 0.0 {
            blurs.push(line(self.motion_length_px, self.motion_angle_deg));
        }
        let far = |masses: &Vec<Mass>| {
            masses.iter().map(|mass| mass.x.abs().max(mass.y.abs())).fold(0.0, f64::max)
        };
        // The many first, while the lattice is a point.
        blurs.sort_by_key(|masses: &Vec<Mass>| std::cmp::Reverse(masses.len()));
        let across: f64 = 2.0 * blurs.iter().map(far).sum::<f64>();
        let point = Spread::point(FINEST_PX.max(across / MOST_POINTS));
        blurs.iter().fold(point, |spread, blur| spread.convolved(blur))
    }

    /// The weights at a phase: the centre of pixel (0, 0) is at image point `phase_px` of the film.
    pub(super) fn kernel(&self, oversampling: u32, phase_px: [f64; 2], spread: &Spread) -> Kernel {
        let scale = f64::from(oversampling);
        // A pixel that gathers light at a point sees the cell that this point is in, all of it. On the
        // border of two cells the one to the right is taken, and the phase is that cell's middle.
        let is_point = self.fill_factor * scale * scale < 1.0
            && self.gaussian_sigma_px * scale < 1.0
            && spread.is_point();
        let snapped = |phase: f64| ((0.5 + phase) * scale).floor() / scale + 0.5 / scale - 0.5;
        let phase_px = if is_point { phase_px.map(snapped) } else { phase_px };
        let aperture = (self.fill_factor.sqrt() * scale).max(1e-3);
        let sigma = self.gaussian_sigma_px * scale;
        let reach = 0.5 * aperture + GAUSSIAN_REACH * sigma + 0.5;
        // Of every place on the lattice, the weights of the cells that count.
        let profiles = |axis: usize| {
            let centre = (0.5 + phase_px[axis]) * scale;
            let far = reach + scale * spread.reach_px(axis);
            #[allow(clippy::cast_possible_truncation, reason = "a few hundred cells at most")]
            let (first, last) = ((centre - far).floor() as isize, (centre + far).ceil() as isize);
            let places = [spread.masses.ncols(), spread.masses.nrows()][axis];
            let weights = DMatrix::from_fn((last - first).unsigned_abs(), places, |cell, place| {
                let place_px = spread.first_px[axis] + place as f64 * spread.step_px;
                let middle = first as f64 + cell as f64 + 0.5;
                cell_weight(middle - centre - scale * place_px, aperture, sigma)
            });
            (centre, first, weights)
        };
        let (x_centre, x_first, across) = profiles(0);
        let (y_centre, y_first, down) = profiles(1);
        let weights = down * &spread.masses * across.transpose();
        Kernel::new(
            oversampling as usize,
            [x_first, y_first],
            [x_centre, y_centre],
            phase_px,
            weights,
            spread.is_point(),
        )
    }
}

/// The weight of a film cell whose middle lies `from_centre` cells from a point: the integral over the
/// cell of a Gaussian convolved with a box of width `aperture`, all in cells.
fn cell_weight(from_centre: f64, aperture: f64, sigma: f64) -> f64 {
    // Twice the integral of the normal distribution; of a ramp where there is no blur.
    let ramp = |x: f64| {
        if sigma < 1e-9 {
            x.max(0.0)
        } else {
            let z = x / sigma;
            let density = (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt();
            x * 0.5 * libm::erfc(-z / std::f64::consts::SQRT_2) + sigma * density
        }
    };
    let (outer, inner) = (0.5 * (1.0 + aperture), 0.5 * (1.0 - aperture));
    let x = from_centre;
    ((ramp(x + outer) - ramp(x + inner)) - (ramp(x - inner) - ramp(x - outer))) / aperture
}

/// Point masses of a disc, lighter or heavier by distance from its middle, an eighth of a pixel from
/// each other or less: rings of one width each.
fn disc(radius: f64, intensity: impl Fn(f64) -> f64) -> Vec<Mass> {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some thousands")]
    let at_least = |least: u32, value: f64| least.max(value.ceil() as u32);
    let rings = at_least(48, 8.0 * radius);
    let mut masses = Vec::new();
    for ring in 0..rings {
        let middle = (f64::from(ring) + 0.5) / f64::from(rings) * radius;
        // Evenly spread, and a multiple of four: the centroid is zero.
        let quarter = 0.5 * std::f64::consts::PI * middle;
        let count = 4 * at_least((2 * ring + 1).min(24), 8.0 * quarter);
        let share = intensity(middle) * middle / f64::from(count);
        for step in 0..count {
            let angle = 2.0 * std::f64::consts::PI * (f64::from(step) + 0.5) / f64::from(count);
            masses.push(Mass { x: middle * angle.cos(), y: middle * angle.sin(), share });
        }
    }
    normalised(masses)
}

fn line(length: f64, angle_deg: f64) -> Vec<Mass> {
    const STEPS: u32 = 128;
    let (sine, cosine) = angle_deg.to_radians().sin_cos();
    let at = |step: u32| ((f64::from(step) + 0.5) / f64::from(STEPS) - 0.5) * length;
    normalised(
        (0..STEPS)
            .map(|step| Mass { x: at(step) * cosine, y: at(step) * sine, share: 1.0 })
            .collect(),
    )
}

/// Point masses of a picture: four by four of every sample, about the picture's centroid.
fn picture(psf: &Plane<f32>, samples_per_px: f64) -> Vec<Mass> {
    const PARTS: u32 = 4;
    let part = |index: u32| (f64::from(index) + 0.5) / f64::from(PARTS) - 0.5;
    let mut masses = Vec::new();
    for y in 0..psf.height() {
        for x in 0..psf.width() {
            let share = f64::from(psf.at(x, y));
            if share > 0.0 {
                masses.extend((0..PARTS * PARTS).map(|index| Mass {
                    x: (x as f64 + part(index % PARTS)) / samples_per_px,
                    y: (y as f64 + part(index / PARTS)) / samples_per_px,
                    share,
                }));
            }
        }
    }
    let mut masses = normalised(masses);
    let moment = |along: fn(&Mass) -> f64| masses.iter().map(|m| m.share * along(m)).sum::<f64>();
    let (x, y) = (moment(|mass| mass.x), moment(|mass| mass.y));
    for mass in &mut masses {
        mass.x -= x;
        mass.y -= y;
    }
    masses
}

fn normalised(mut masses: Vec<Mass>) -> Vec<Mass> {
    let sum: f64 = masses.iter().map(|mass| mass.share).sum();
    for mass in &mut masses {
        mass.share /= sum;
    }
    masses
}

/// Relative illumination of a pixel by its distance from the middle of a frame \[px\].
pub(super) fn illumination(
    corner: f64,
    width: usize,
    height: usize,
) -> impl Fn(usize, usize) -> f32 {
    let middle = [width, height].map(|count| 0.5 * (count as f64 - 1.0));
    let farthest = middle[0] * middle[0] + middle[1] * middle[1];
    move |x, y| {
        let (x, y) = (x as f64 - middle[0], y as f64 - middle[1]);
        #[allow(clippy::cast_possible_truncation, reason = "in (0, 1]")]
        let share = (1.0 - (1.0 - corner) * (x * x + y * y) / farthest.max(1.0)) as f32;
        share
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::sensor) fn some_optics() -> Vec<Optics> {
        let none = Optics::default();
        vec![
            none.clone(),
            Optics { gaussian_sigma_px: 0.5, ..none.clone() },
            Optics { gaussian_sigma_px: 1.3, fill_factor: 0.4, ..none.clone() },
            Optics { defocus_radius_px: 2.0, ..none.clone() },
            Optics { airy_radius_px: 0.9, ..none.clone() },
            Optics { motion_length_px: 3.0, motion_angle_deg: 25.0, ..none.clone() },
            Optics {
                defocus_radius_px: 1.0,
                gaussian_sigma_px: 0.4,
                motion_length_px: 1.0,
                ..none
            },
        ]
    }

    pub(in crate::sensor) fn kernel(
        optics: &Optics,
        oversampling: u32,
        phase_px: [f64; 2],
    ) -> Kernel {
        optics.kernel(oversampling, phase_px, &optics.spread(None))
    }

    /// Moments of the weights about the pixel's centre \[px\]: sum, mean and variance across and down.
    fn moments(kernel: &Kernel) -> (f64, [f64; 2], [f64; 2]) {
        let scale = kernel.oversampling() as f64;
        let (mut sum, mut mean, mut square) = (0.0, [0.0; 2], [0.0; 2]);
        for (row, line) in kernel.matrix().iter().enumerate() {
            for (column, weight) in line.iter().enumerate() {
                let at = [column, row].map(|index| index as f64 + 0.5);
                sum += weight;
                for axis in 0..2 {
                    let place = (kernel.first()[axis] as f64 + at[axis]) / scale
                        - 0.5
                        - kernel.phase_px()[axis];
                    mean[axis] += weight * place;
                    square[axis] += weight * place * place;
                }
            }
        }
        (sum, mean, [square[0] - mean[0] * mean[0], square[1] - mean[1] * mean[1]])
    }

    #[test]
    fn the_centroid_is_the_pixel_s_centre_at_every_phase() {
        for optics in some_optics() {
            for phase in [[0.0, 0.0], [0.37, -0.21], [-0.5, 0.5], [0.125, 0.999]] {
                let kernel = kernel(&optics, 4, phase);
                let (sum, mean, _) = moments(&kernel);
                assert!((sum - 1.0).abs() < 1e-6, "{optics:?}: {sum}");
                let far = mean[0].hypot(mean[1]);
                assert!(far < 1e-4, "{optics:?} {phase:?}: {mean:?}");
                assert!((kernel.centroid_px()[0] - mean[0]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn the_variance_is_the_sum_of_those_of_the_blurs() {
        // Of a pixel of width w: w^2 / 12; of the film cells the same of their width.
        let boxes = |fill: f64| (fill + 1.0 / 64.0) / 12.0;
        let none = Optics::default();
        let cosine = 30.0_f64.to_radians().cos();
        for (optics, across, down) in [
            (none.clone(), boxes(1.0), boxes(1.0)),
            (Optics { gaussian_sigma_px: 0.8, ..none.clone() }, 0.64, 0.64),
            (Optics { gaussian_sigma_px: 0.8, fill_factor: 0.49, ..none.clone() }, 0.64, 0.64),
            (Optics { defocus_radius_px: 2.5, ..none.clone() }, 6.25 / 4.0, 6.25 / 4.0),
            (
                Optics { motion_length_px: 4.0, motion_angle_deg: 30.0, ..none },
                16.0 / 12.0 * cosine * cosine,
                16.0 / 12.0 * (1.0 - cosine * cosine),
            ),
        ] {
            let is_box = optics == Optics::default();
            let own = if is_box { 0.0 } else { boxes(optics.fill_factor) };
            let (_, _, variance) = moments(&kernel(&optics, 8, [0.3, 0.1]));
            for (found, wanted) in variance.iter().zip([across + own, down + own]) {
                // A box alone ends within cells.
                let most = if is_box { 2e-2 } else { 2e-3 };
                assert!((found / wanted - 1.0).abs() < most, "{optics:?}: {found} {wanted}");
            }
        }
    }

    #[test]
    fn a_large_disc_is_even() {
        let optics = Optics { defocus_radius_px: 14.0, ..Optics::default() };
        let weights = kernel(&optics, 4, [0.3, 0.1]).matrix();
        let middle = weights.len() / 2;
        let inside: Vec<f64> = weights[middle - 36..middle + 36]
            .iter()
            .flat_map(|row| row[middle - 36..middle + 36].iter().copied())
            .collect();
        let least = inside.iter().copied().fold(f64::INFINITY, f64::min);
        let most = inside.iter().copied().fold(0.0, f64::max);
        assert!(most / least < 1.02, "{least} to {most}");
    }

    #[test]
    fn gaussian_weights_are_the_integral() {
        // Brute force: a fine sum over aperture and cell.
        let optics = Optics { gaussian_sigma_px: 0.6, fill_factor: 0.64, ..Optics::default() };
        let kernel = kernel(&optics, 4, [0.3, -0.2]);
        let found = kernel.matrix();
        let density =
            |x: f64| (-0.5 * (x / 0.6).powi(2)).exp() / (0.6 * (2.0 * std::f64::consts::PI).sqrt());
        let along = |axis: usize, index: usize| {
            const STEPS: u32 = 200;
            let middle = (kernel.first()[axis] as f64 + index as f64 + 0.5) / 4.0
                - 0.5
                - kernel.phase_px()[axis];
            let part = |step: u32| (f64::from(step) + 0.5) / f64::from(STEPS) - 0.5;
            let mut sum = 0.0;
            for cell in 0..STEPS {
                for aperture in 0..STEPS {
                    sum += density(middle + 0.25 * part(cell) - 0.8 * part(aperture));
                }
            }
            sum * 0.25 / f64::from(STEPS * STEPS)
        };
        for (row, line) in found.iter().enumerate().step_by(3) {
            let down = along(1, row);
            for (column, weight) in line.iter().enumerate().step_by(3) {
                assert!((weight - along(0, column) * down).abs() < 2e-6, "{row} {column}");
            }
        }
    }

    #[test]
    fn a_picture_of_the_point_spread_is_centred() {
        let mut psf = Plane::filled(9, 9, 0.0);
        for (x, y, value) in [(2, 3, 1.0), (3, 3, 2.0), (6, 5, 0.5)] {
            psf.row_mut(y)[x] = value;
        }
        let optics = Optics { psf_samples_per_px: 2.0, ..Optics::default() };
        let (_, mean, variance) =
            moments(&optics.kernel(4, [0.0, 0.0], &optics.spread(Some(&psf))));
        assert!(mean[0].hypot(mean[1]) < 1e-4, "{mean:?}");
        assert!(variance[0] > 0.3 && variance[0] < 1.0, "{variance:?}");
    }
}
