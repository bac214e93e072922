//! Samples about a place in linear light, weighted by the camera's noise.

use crate::geometry::ImagePoint;
use crate::image::Plane;
use crate::junction::fit::Samples;
use crate::sensor::{Exposure, LinearLight};

/// Takes patches from one exposure.
pub struct Patches<'a> {
    exposure: &'a Exposure,
    light: LinearLight,
    /// The channels that differ.
    pub planes: &'a [Plane<f32>],
    /// Variance of light at so many shares of full scale, evenly spaced, in each channel.
    variances: [[f32; VARIANCES + 1]; 3],
    /// Pixels about the middle, and so many that they fill whole vectors.
    smooth: Vec<f32>,
}

const VARIANCES: usize = 64;

impl<'a> Patches<'a> {
    /// Those of an exposure.
    pub fn new(exposure: &'a Exposure) -> Self {
        let planes = exposure.channels();
        let mut variances = [[0.0; VARIANCES + 1]; 3];
        for (channel, variances) in variances[..planes.len()].iter_mut().enumerate() {
            for (share, variance) in variances.iter_mut().enumerate() {
                #[allow(clippy::cast_possible_truncation, reason = "samples are f32")]
                let value =
                    exposure.light_variance(channel, share as f64 / VARIANCES as f64) as f32;
                *variance = value.max(1e-12);
            }
        }
        let light = exposure.linear_light();
        Self { exposure, light, planes, variances, smooth: Vec::new() }
    }

    /// The standard deviation of a sample of each channel at a pixel \[DN\].
    pub fn deviations_dn(&self, at: ImagePoint) -> [f64; 3] {
        let mut deviations = [1.0; 3];
        for (channel, plane) in self.planes.iter().enumerate() {
            #[allow(clippy::cast_possible_truncation, reason = "in the image")]
            let sample = plane.at_replicated(at.x.round() as isize, at.y.round() as isize);
            deviations[channel] = self.exposure.variance_dn2(channel, f64::from(sample)).sqrt();
        }
        deviations
    }

    /// Takes the pixels so far from a point and nearer; places are relative to the pixel that the point
    /// lies in, which is returned. `None` where less than half of them are in the image.
    pub fn take(
        &mut self,
        middle: ImagePoint,
        radius_px: f64,
        samples: &mut Samples,
    ) -> Option<[f64; 2]> {
        let (width, height) = (self.exposure.width(), self.exposure.height());
        let centre = [middle.x.round(), middle.y.round()];
        #[allow(clippy::cast_possible_truncation, reason = "in the image, or declined below")]
        let [x0, y0] = centre.map(|value| value as isize);
        #[allow(clippy::cast_possible_truncation, reason = "tens of pixels")]
        let reach = radius_px.ceil() as isize;
        let side = (2 * reach + 1).cast_unsigned();
        samples.make_square(reach.cast_unsigned());
        samples.radius_px = radius_px;
        samples.channel_count = self.planes.len();
        let count = samples.places.x.len();
        let (sub_x, sub_y) = (middle.x - centre[0], middle.y - centre[1]);
        let mut inside = 0;
        let mut all = 0;
        for (channel, plane) in self.planes.iter().enumerate() {
            let of_channel = &mut samples.channels[channel];
            of_channel.samples.resize(count, 0.0);
            of_channel.weights.clear();
            of_channel.weights.resize(count, 0.0);
            for (row, y) in (y0 - reach..=y0 + reach).enumerate() {
                let light = &mut of_channel.samples[row * side..(row + 1) * side];
                for (sample, x) in light.iter_mut().zip(x0 - reach..) {
                    *sample = self.light.of(plane.at_replicated(x, y));
                }
            }
            self.smooth.resize(count, 0.0);
            smooth(&of_channel.samples, side, &mut self.smooth);
            for (row, y) in (y0 - reach..=y0 + reach).enumerate() {
                for (column, x) in (x0 - reach..=x0 + reach).enumerate() {
                    let far = ((x - x0) as f64 - sub_x).hypot((y - y0) as f64 - sub_y);
                    if far > radius_px {
                        continue;
                    }
                    all += 1;
                    let is_inside =
                        x >= 0 && y >= 0 && x < width.cast_signed() && y < height.cast_signed();
                    if !is_inside
                        || self.exposure.saturated().at(x.cast_unsigned(), y.cast_unsigned())
                    {
                        continue;
                    }
                    inside += 1;
                    let index = row * side + column;
                    let share = self.smooth[index].clamp(0.0, 1.0) * VARIANCES as f32;
                    #[allow(
                        clippy::cast_possible_truncation,
                        clippy::cast_sign_loss,
                        reason = "a share"
                    )]
                    let variance = self.variances[channel][share as usize];
                    of_channel.weights[index] = 1.0 / variance.sqrt();
                }
            }
        }
        (2 * inside > all).then_some(centre)
    }
}

/// Means over three by three, so that a sample's weight hardly knows its noise.
fn smooth(samples: &[f32], side: usize, means: &mut [f32]) {
    for row in 0..side {
        for column in 0..side {
            let mut sum = 0.0;
            for y in row.saturating_sub(1)..=(row + 1).min(side - 1) {
                for x in column.saturating_sub(1)..=(column + 1).min(side - 1) {
                    sum += samples[y * side + x];
                }
            }
            let rows = (row + 1).min(side - 1) - row.saturating_sub(1) + 1;
            let columns = (column + 1).min(side - 1) - column.saturating_sub(1) + 1;
            means[row * side + column] = sum / (rows * columns) as f32;
        }
    }
}
