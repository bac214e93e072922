//! Linear light of an exposure and what the camera's noise makes of it: what refiners fit.

use crate::geometry::ImagePoint;
use crate::image::Plane;
use crate::sensor::{Exposure, LinearLight};

/// What of each channel's light makes luminance (Rec. 709).
pub const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// From samples to linear light, of which 1 is full scale, with its variance.
pub struct Light<'a> {
    /// What it is the light of.
    pub exposure: &'a Exposure,
    /// The channels that differ \[DN\].
    pub planes: &'a [Plane<f32>],
    decode: LinearLight,
    /// Variance at so many shares of full scale, evenly spaced, in each channel.
    variances: [[f32; VARIANCES + 1]; 3],
    /// The reciprocals of their roots.
    weights: [[f32; VARIANCES + 1]; 3],
}

const VARIANCES: usize = 64;

/// Which of them.
#[inline(always)]
fn step(expected: f32) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share")]
    let step = (expected.clamp(0.0, 1.0) * VARIANCES as f32) as usize;
    step
}

impl<'a> Light<'a> {
    /// That of an exposure.
    pub fn new(exposure: &'a Exposure) -> Self {
        let planes = exposure.channels();
        let mut variances = [[1.0; VARIANCES + 1]; 3];
        for (channel, variances) in variances[..planes.len()].iter_mut().enumerate() {
            for (share, variance) in variances.iter_mut().enumerate() {
                #[allow(clippy::cast_possible_truncation, reason = "samples are f32")]
                let value =
                    exposure.light_variance(channel, share as f64 / VARIANCES as f64) as f32;
                *variance = value.max(1e-12);
            }
        }
        let weights = variances.map(|of_one| of_one.map(|variance| 1.0 / variance.sqrt()));
        Self { exposure, planes, decode: exposure.linear_light(), variances, weights }
    }

    /// Whether a place is in the image.
    pub fn is_inside(&self, point: ImagePoint) -> bool {
        let inside = |place: f64, count: usize| (-0.5..count as f64 - 0.5).contains(&place);
        inside(point.x, self.exposure.width()) && inside(point.y, self.exposure.height())
    }

    /// The light of a sample \[DN\].
    #[inline(always)]
    pub fn of(&self, sample_dn: f32) -> f32 {
        self.decode.of(sample_dn)
    }

    /// The variance of a channel's light, by its expected value.
    #[inline(always)]
    pub fn variance(&self, channel: usize, expected: f32) -> f32 {
        self.variances[channel][step(expected)]
    }

    /// The reciprocal of the standard deviation of a channel's light, by its expected value.
    #[inline(always)]
    pub fn weight(&self, channel: usize, expected: f32) -> f32 {
        self.weights[channel][step(expected)]
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
}
