//! Samples about a place in linear light, weighted by the camera's noise.

use crate::geometry::ImagePoint;
use crate::junction::fit::Samples;
use crate::refine::light::Light;
use crate::sensor::Exposure;

/// Takes patches from one exposure.
pub struct Patches<'a> {
    /// The exposure's light.
    pub light: Light<'a>,
    /// Pixels about the middle, and so many that they fill whole vectors.
    smooth: Vec<f32>,
}

impl<'a> Patches<'a> {
    /// Those of an exposure.
    pub fn new(exposure: &'a Exposure) -> Self {
        Self { light: Light::new(exposure), smooth: Vec::new() }
    }

    /// Takes the pixels so far from a point and nearer; places are relative to the pixel that the point
    /// lies in, which is returned. `None` where less than half of them are in the image.
    pub fn take(
        &mut self,
        middle: ImagePoint,
        radius_px: f64,
        samples: &mut Samples,
    ) -> Option<[f64; 2]> {
        let Self { light, smooth: means } = self;
        let (width, height) = (light.exposure.width(), light.exposure.height());
        let centre = [middle.x.round(), middle.y.round()];
        #[allow(clippy::cast_possible_truncation, reason = "in the image, or declined below")]
        let [x0, y0] = centre.map(|value| value as isize);
        #[allow(clippy::cast_possible_truncation, reason = "tens of pixels")]
        let reach = radius_px.ceil() as isize;
        let side = (2 * reach + 1).cast_unsigned();
        samples.make_square(reach.cast_unsigned());
        samples.radius_px = radius_px;
        samples.channel_count = light.planes.len();
        let count = samples.places.x.len();
        let (sub_x, sub_y) = (middle.x - centre[0], middle.y - centre[1]);
        let mut inside = 0;
        let mut all = 0;
        for (channel, plane) in light.planes.iter().enumerate() {
            let of_channel = &mut samples.channels[channel];
            of_channel.samples.resize(count, 0.0);
            of_channel.weights.clear();
            of_channel.weights.resize(count, 0.0);
            for (row, y) in (y0 - reach..=y0 + reach).enumerate() {
                let of_row = &mut of_channel.samples[row * side..(row + 1) * side];
                for (sample, x) in of_row.iter_mut().zip(x0 - reach..) {
                    *sample = light.of(plane.at_replicated(x, y));
                }
            }
            means.resize(count, 0.0);
            smooth(&of_channel.samples, side, means);
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
                        || light.exposure.saturated().at(x.cast_unsigned(), y.cast_unsigned())
                    {
                        continue;
                    }
                    inside += 1;
                    // What a mosaic lacks is made of samples that count already.
                    if !light.exposure.is_measured(channel, x.cast_unsigned(), y.cast_unsigned()) {
                        continue;
                    }
                    let index = row * side + column;
                    let variance = light.variance(channel, means[index]);
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
