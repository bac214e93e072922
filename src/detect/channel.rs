//! What detectors look at.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::peaks::{Response, ResponseMemory};
use crate::image::{PixelRange, Plane, View};
use crate::sensor::Exposure;

/// What of an exposure is differentiated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    /// The luma.
    #[default]
    Luma,
    /// Red alone.
    Red,
    /// Red less the mean of green and blue: how saturated a red is.
    RedDifference,
    /// Red, green and blue: the sum of their tensors, each weighted by the inverse of its noise's
    /// variance at half of full scale, the weights' mean being 1. Di Zenzo (1986), A note on the
    /// gradient of a multi-image, Computer Vision, Graphics, and Image Processing 33.
    Colour,
}

/// What of an exposure is looked at, where it must be one number per pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Shade {
    /// The luma.
    #[default]
    Luma,
    /// Red alone.
    Red,
    /// Red less the mean of green and blue: how saturated a red is.
    RedDifference,
}

impl Shade {
    /// Its plane \[DN\].
    pub fn plane(self, exposure: &Exposure) -> &Plane<f32> {
        match self {
            Self::Luma => exposure.luma(),
            Self::Red => &exposure.rgb()[0],
            Self::RedDifference => exposure.red_difference(),
        }
    }
}

impl Channel {
    /// The planes that are differentiated, and their tensors' weights.
    pub(super) fn planes(self, exposure: &Exposure) -> [Option<(&Plane<f32>, f32)>; 3] {
        let alone = |shade: Shade| [Some((shade.plane(exposure), 1.0)), None, None];
        match self {
            Self::Luma => alone(Shade::Luma),
            Self::Red => alone(Shade::Red),
            Self::RedDifference => alone(Shade::RedDifference),
            Self::Colour => {
                let half = 0.5 * exposure.encoding().full_scale_dn();
                let certainty = [0, 1, 2].map(|c| 1.0 / exposure.variance_dn2(c, half));
                let mean = certainty.iter().sum::<f64>() / 3.0;
                #[allow(clippy::cast_possible_truncation, reason = "some size near 1")]
                let weight = certainty.map(|value| (value / mean) as f32);
                let [red, green, blue] = exposure.rgb();
                [(red, weight[0]), (green, weight[1]), (blue, weight[2])].map(Some)
            }
        }
    }
}

/// A score of a shade at every pixel as a response.
pub(super) struct Scored<F> {
    /// What is looked at.
    pub(super) shade: Shade,
    /// How far from a pixel the others lie that its score is made of \[px\].
    pub(super) radius_px: usize,
    /// Replaces its last argument by the scores of an image of the exposure \[DN\], of that image's size.
    pub(super) score: F,
}

impl<F: Fn(View<'_, f32>, &Exposure, &mut Plane<f32>) + Sync> Response for Scored<F> {
    fn support(&self) -> usize {
        self.radius_px
    }

    fn respond(
        &self,
        exposure: &Exposure,
        range: PixelRange,
        _: &mut ResponseMemory,
        response: &mut Plane<f32>,
    ) {
        (self.score)(self.shade.plane(exposure).view().crop(range), exposure, response);
    }
}
