//! A drawn junction and the warp that makes it correlate best with samples.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use super::Motion;
use crate::image::Plane;
use crate::junction::fit::Samples;
use crate::junction::rays::{Area, Fields, Rays};

/// Unknowns of a warp: of the translation two, then those of the matrix, each per radius.
const MOST: usize = 6;
type Normal = SMatrix<f64, MOST, MOST>;
type Vector = SVector<f64, MOST>;

/// From places of the template, whose vertex is in its middle, to places among samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Warp {
    /// Where the vertex is \[px\].
    pub(super) vertex: Vector2<f64>,
    pub(super) matrix: Matrix2<f64>,
}

impl Warp {
    /// How far from the vertex the warped square of this radius reaches, along the farther axis \[px\].
    pub(super) fn reach_px(&self, radius_px: f64) -> f64 {
        let m = &self.matrix;
        let x = m[(0, 0)].abs() + m[(0, 1)].abs();
        radius_px * x.max(m[(1, 0)].abs() + m[(1, 1)].abs())
    }

    /// How many times as large as drawn the template is.
    pub(super) fn scale(&self) -> f64 {
        self.matrix.determinant().abs().sqrt()
    }

    /// Rays of the template among the samples; their blur as large as the warp makes it, or the least.
    pub(super) fn rays(&self, template: &Rays, least_sigma_px: f64) -> Rays {
        let mut rays = *template;
        rays.vertex = self.vertex.into();
        rays.sigma_px = (rays.sigma_px * self.scale()).max(least_sigma_px);
        for angle in &mut rays.angles_rad[..rays.count] {
            let (sine, cosine) = angle.sin_cos();
            let direction = self.matrix * Vector2::new(cosine, sine);
            *angle = direction.y.atan2(direction.x).rem_euclid(std::f64::consts::TAU);
        }
        rays.angles_rad[..rays.count].sort_by(f64::total_cmp);
        rays
    }
}

/// A junction on a square of pixels about its vertex, and what a step of the warp changes of it.
#[derive(Default)]
pub(super) struct Template {
    fields: Fields,
    /// Of each pixel its value, less their mean.
    values: Vec<f64>,
    /// Of each pixel what the unknowns change, less their mean.
    jacobian: Vec<Vector>,
    /// Their inner products, on the diagonal 1 of what is no unknown; the inverse.
    normal: Normal,
    inverse: Normal,
    /// Inner products of values with the jacobian, and with themselves.
    mixed: Vector,
    square: f64,
    /// Of each pixel the warped sample, less their mean.
    warped: Vec<f64>,
    /// Which values have which weight in the noise.
    slopes2: Vec<f64>,
    mean: f64,
}

/// A step of the warp.
pub(super) struct Step {
    /// Of the template's unknowns.
    pub(super) translation: Vector2<f64>,
    pub(super) matrix: Matrix2<f64>,
    /// The correlation before the step, in \[-1, 1\].
    pub(super) correlation: f64,
    /// Values of the template for each unit of the samples.
    gain: f64,
}

impl Step {
    /// A step in the same direction, its matrix no larger than this.
    pub(super) fn no_larger_than(self, most: f64) -> Self {
        let share = (most / self.matrix.norm()).min(1.0);
        Self { translation: share * self.translation, matrix: share * self.matrix, ..self }
    }
}

impl Template {
    /// Draws the rays, their vertex in the middle of the places; `None` where the picture does not
    /// determine the warp.
    pub(super) fn draw(
        &mut self,
        places: &Samples,
        rays: &Rays,
        levels: [f64; 3],
        motion: Motion,
    ) -> Option<()> {
        let count = (2 * radius(places) + 1).pow(2);
        let vertex = [0.0; 2];
        self.fields.compute(&Rays { vertex, ..*rays }, &places.places, Area::Pixel);
        self.values.clear();
        self.jacobian.clear();
        self.slopes2.clear();
        for index in 0..count {
            let (mut value, mut slope) = (0.0, [0.0; 2]);
            for ray in 0..rays.count {
                let before = if ray == 0 { rays.count - 1 } else { ray - 1 };
                let (sine, cosine) = rays.angles_rad[ray].sin_cos();
                let jump = (levels[ray] - levels[before]) / rays.sigma_px;
                let across = jump * f64::from(self.fields.line[ray][index]);
                slope = [slope[0] - sine * across, slope[1] + cosine * across];
                value += levels[ray] * f64::from(self.fields.share[ray][index]);
            }
            let scale = 1.0 / places.radius_px;
            let x = scale * f64::from(places.places.x[index]);
            let y = scale * f64::from(places.places.y[index]);
            let mut changes = Vector::zeros();
            changes[0] = slope[0];
            changes[1] = slope[1];
            if motion == Motion::Affine {
                changes[2] = slope[0] * x;
                changes[3] = slope[0] * y;
                changes[4] = slope[1] * x;
                changes[5] = slope[1] * y;
            }
            self.values.push(value);
            self.slopes2.push(slope[0] * slope[0] + slope[1] * slope[1]);
            self.jacobian.push(changes);
        }
        self.mean = without_mean(&mut self.values);
        let mean = self.jacobian.iter().sum::<Vector>() / count as f64;
        self.normal = Normal::zeros();
        self.mixed = Vector::zeros();
        for (changes, value) in self.jacobian.iter_mut().zip(&self.values) {
            *changes -= mean;
            self.normal += *changes * changes.transpose();
            self.mixed += *value * *changes;
        }
        if motion == Motion::Translation {
            (2..MOST).for_each(|index| self.normal[(index, index)] = 1.0);
        }
        self.square = self.values.iter().map(|value| value * value).sum();
        self.inverse = self.normal.cholesky()?.inverse();
        (self.square > 0.0).then_some(())
    }

    /// The step that the samples under a warp ask for; `None` where no correlation is gained.
    pub(super) fn step(
        &mut self,
        samples: &Plane<f32>,
        warp: &Warp,
        places: &Samples,
    ) -> Option<Step> {
        self.warped.clear();
        for index in 0..self.values.len() {
            let x = f64::from(places.places.x[index]);
            let y = f64::from(places.places.y[index]);
            let place = warp.vertex + warp.matrix * Vector2::new(x, y);
            self.warped.push(bicubic(samples, place.x, place.y));
        }
        without_mean(&mut self.warped);
        let mut seen = Vector::zeros();
        let (mut product, mut square) = (0.0, 0.0);
        for ((warped, value), changes) in self.warped.iter().zip(&self.values).zip(&self.jacobian) {
            seen += *warped * *changes;
            product += warped * value;
            square += warped * warped;
        }
        let explained = self.inverse * self.mixed;
        let below = product - seen.dot(&explained);
        let gain = (self.square - self.mixed.dot(&explained)) / below;
        if below <= 0.0 || !gain.is_finite() {
            return None;
        }
        let step = self.inverse * (gain * seen - self.mixed);
        let scale = 1.0 / places.radius_px;
        Some(Step {
            translation: step.fixed_rows::<2>(0).into_owned(),
            matrix: scale * Matrix2::new(step[2], step[3], step[4], step[5]),
            correlation: product / (self.square * square).sqrt(),
            gain,
        })
    }

    /// The covariance of the vertex \[px^2\]: `variance` is that of a sample by its expected value. What is
    /// left counts as noise where it is more.
    pub(super) fn covariance_px2(
        &self,
        warp: &Warp,
        step: &Step,
        variance: impl Fn(f64) -> f64,
    ) -> Option<Matrix2<f64>> {
        let (mut noise, mut weight, mut left) = (0.0, 0.0, 0.0);
        for ((value, slope2), warped) in self.values.iter().zip(&self.slopes2).zip(&self.warped) {
            noise += slope2 * variance(value + self.mean);
            weight += slope2;
            left += (warped - value / step.gain).powi(2);
        }
        let noise = (noise / weight).max(left / (self.values.len() - MOST - 2) as f64);
        // Offset and gain are unknown, too.
        let normal = self.normal - self.mixed * self.mixed.transpose() / self.square;
        let of_template = normal.try_inverse()?.fixed_view::<2, 2>(0, 0).into_owned();
        // Samples under a warp that enlarges are fewer than places of the template.
        let scale = step.gain * step.gain * noise / warp.matrix.determinant().abs();
        let covariance = scale * warp.matrix * of_template * warp.matrix.transpose();
        covariance.iter().all(|value| value.is_finite()).then_some(covariance)
    }
}

/// Half the side of the square that places are of, less half a pixel.
fn radius(places: &Samples) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number")]
    let radius = places.radius_px as usize;
    radius
}

/// Takes their mean from values, and returns it.
fn without_mean(values: &mut [f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter_mut().for_each(|value| *value -= mean);
    mean
}

/// The sample at a place that is two pixels and more within the plane.
///
/// Keys (1981), Cubic convolution interpolation for digital image processing, equation 15.
#[inline(always)]
fn bicubic(samples: &Plane<f32>, x: f64, y: f64) -> f64 {
    let weights = |s: f64| {
        let (s2, s3) = (s * s, s * s * s);
        [
            0.5 * (-s3 + 2.0 * s2 - s),
            0.5 * (3.0 * s3 - 5.0 * s2 + 2.0),
            0.5 * (-3.0 * s3 + 4.0 * s2 + s),
            0.5 * (s3 - s2),
        ]
    };
    let (column, row) = (x.floor(), y.floor());
    let (across, down) = (weights(x - column), weights(y - row));
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in the plane")]
    let (first, row) = (column as usize - 1, row as usize - 1);
    let mut sum = 0.0;
    for (j, down) in down.into_iter().enumerate() {
        let samples = &samples.row(row + j)[first..first + 4];
        let of_row: f64 = samples.iter().zip(across).map(|(s, w)| f64::from(*s) * w).sum();
        sum += down * of_row;
    }
    sum
}
