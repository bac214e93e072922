//! One plane of linear light about a seed: what refiners of a single channel look at.

use crate::geometry::ImagePoint;
use crate::image::Plane;
use crate::refine::light::{LUMINANCE, Light};
use crate::sensor::Exposure;

/// The luminance about one seed after the other.
pub struct Luminance<'a> {
    /// The exposure's light.
    pub light: Light<'a>,
    /// Of each channel that differs.
    weights: &'static [f32],
    /// What is known of it; 1 is full scale.
    pub samples: Plane<f32>,
    /// The pixel of its first sample.
    origin: [f64; 2],
}

impl<'a> Luminance<'a> {
    /// That of an exposure.
    pub fn new(exposure: &'a Exposure) -> Self {
        let light = Light::new(exposure);
        let weights = if light.planes.len() == 1 { &[1.0] } else { &LUMINANCE[..] };
        Self { light, weights, samples: Plane::default(), origin: [0.0; 2] }
    }

    /// Takes the square of pixels so far from the one a place in the image lies in; beyond the image its
    /// border pixels go on.
    pub fn take(&mut self, middle: ImagePoint, reach: usize) {
        let side = 2 * reach + 1;
        self.samples.reset(side, side, 0.0);
        #[allow(clippy::cast_possible_truncation, reason = "in the image")]
        let [x0, y0] = [middle.x, middle.y].map(|at| at.round() as isize - reach.cast_signed());
        self.origin = [x0 as f64, y0 as f64];
        for (plane, weight) in self.light.planes.iter().zip(self.weights) {
            for (y, row) in (y0..).zip(self.samples.samples_mut().chunks_exact_mut(side)) {
                for (x, sample) in (x0..).zip(row) {
                    *sample += weight * self.light.of(plane.at_replicated(x, y));
                }
            }
        }
    }

    /// A place of the image among the samples.
    pub fn local(&self, point: ImagePoint) -> [f64; 2] {
        [point.x - self.origin[0], point.y - self.origin[1]]
    }

    /// A place among the samples in the image.
    pub fn point(&self, [x, y]: [f64; 2]) -> ImagePoint {
        ImagePoint::new(self.origin[0] + x, self.origin[1] + y)
    }

    /// Whether a square so far from a place among the samples lies in the image.
    pub fn holds(&self, place: [f64; 2], reach_px: f64) -> bool {
        let ImagePoint { x, y } = self.point(place);
        [-reach_px, reach_px]
            .iter()
            .all(|far| self.light.is_inside(ImagePoint::new(x + far, y + far)))
    }

    /// The variance of a sample, by its expected value, as if all channels were of about this light.
    pub fn variance(&self, expected: f32) -> f64 {
        let of_channel = |(channel, weight): (usize, &f32)| {
            f64::from(weight * weight * self.light.variance(channel, expected))
        };
        self.weights.iter().enumerate().map(of_channel).sum()
    }
}
