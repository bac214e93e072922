//! SUSAN: corners by the area that is as bright as its middle.
//!
//! ```text
//! # Method      On the 37 pixels of a disc about p, n = sum exp(-((I - I_p) / t)^6), the area of the
//!               part that is as bright as p. Score R = g - n where n < g, half of 37. It is 0 where the
//!               part's centre of gravity is nearer than `centroid_px` to p, or where a pixel on the way
//!               from p beyond that centre does not belong to the part. Corners are the maxima of R.
//! # Input       the channel as encoded [DN].
//! # Parameters  channel       luma                luma, red, red_difference
//!               brightness    of full scale, 0.1  range [0.001, 1]: t
//!               centroid_px   px, 0.7             range [0, 3]
//!               those of peaks (peaks.rs: thresholds in px^2 and of the strongest; the strongest so many;
//!               suppression radius, by default 3 px; margin around a region)
//! # Output      whole-pixel maxima, strongest first, equals by row, then column; response R in px^2: the
//!               sharper the angle the more, whatever the contrast.
//! # Border      no candidate nearer than 3 px to an edge.
//! # Cost        36 table look-ups for each pixel searched; one plane of f32.
//! # Departures  The table of exp is interpolated, to 1e-4. On the way "belongs" is to exceed 1/2. Theirs
//!               suppresses in 5 x 5 pixels; ours in 7 x 7, as their program does by default.
//! # Source      Smith & Brady, SUSAN - A new approach to low level image processing, International
//!               Journal of Computer Vision 23(1), 1997, equations 4, 2 and section 4.
//! # Checked by  tests/it/contract.rs (all), tests/it/responses.rs::susan_matches_its_definition
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::channel::Scored;
use crate::detect::peaks::{PeakDetector, Response};
use crate::detect::{Detector, Peaks, Shade};
use crate::image::{Plane, View};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;

/// The registry's line.
pub const ENTRY: Entry<dyn Detector> = Entry {
    name: "susan",
    summary: "small areas as bright as their middle",
    reference: "Smith & Brady 1997, section 4",
    version: 1,
    defaults: defaults::<Susan>,
    schema: schema::<Susan>,
    build: |place, table| Ok(Box::new(parameters::<Susan>(place, table)?)),
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Susan {
    /// What is looked at.
    pub channel: Shade,
    /// What difference in brightness counts as one, of full scale.
    #[schemars(range(min = 0.001, max = 1.0))]
    pub brightness: f64,
    /// The least distance of the centre of gravity \[px\].
    #[schemars(range(min = 0.0, max = 3.0))]
    pub centroid_px: f64,
    /// When a score is a corner.
    #[serde(flatten)]
    pub peaks: Peaks,
}

impl Default for Susan {
    fn default() -> Self {
        let peaks = Peaks { nms_radius_px: 3, ..Peaks::default() };
        Self { channel: Shade::Luma, brightness: 0.1, centroid_px: 0.7, peaks }
    }
}

const RADIUS: usize = 3;
/// Of the rows of the disc, from the top: how far they reach to both sides of the middle.
const DISC: [i8; 7] = [1, 2, 3, 3, 3, 2, 1];
/// Half of its 37 pixels.
const HALF_AREA_PX2: f32 = 18.5;

impl Susan {
    /// Replaces what `score` holds by the score R \[px^2\] of every pixel of an image of this full scale
    /// \[DN\]; 0 nearer than 3 px to an edge.
    pub fn score(&self, image: View<'_, f32>, full_scale_dn: f64, score: &mut Plane<f32>) {
        score.reset(image.width(), image.height(), 0.0);
        let alike = Alike::new(self.brightness * full_scale_dn);
        for y in RADIUS..image.height().saturating_sub(RADIUS) {
            for x in RADIUS..image.width() - RADIUS.min(image.width()) {
                score.row_mut(y)[x] = self.score_at(image, &alike, x, y);
            }
        }
    }

    fn score_at(&self, image: View<'_, f32>, alike: &Alike, x: usize, y: usize) -> f32 {
        let middle = image.row(y)[x];
        let (mut area, mut moment_x, mut moment_y) = (0.0, 0.0, 0.0);
        for (half, dy) in DISC.into_iter().zip(-3_i8..) {
            let row = image.row(y.wrapping_add_signed(dy.into()));
            let reach = usize::from(half.unsigned_abs());
            let mut of_row = 0.0;
            for (sample, dx) in row[x - reach..=x + reach].iter().zip(-half..) {
                let share = alike.share(sample - middle);
                of_row += share;
                moment_x += share * f32::from(dx);
            }
            area += of_row;
            moment_y += of_row * f32::from(dy);
        }
        if area >= HALF_AREA_PX2 {
            return 0.0;
        }
        // The middle itself belongs: the area is at least 1.
        let (x_px, y_px) = (f64::from(moment_x / area), f64::from(moment_y / area));
        let distance_px = x_px.hypot(y_px);
        if distance_px < self.centroid_px || distance_px <= 0.0 {
            return 0.0;
        }
        let on_the_way = (1..=3).all(|step| {
            let along = |component: f64| f64::from(step) * component / distance_px;
            #[allow(clippy::cast_possible_truncation, reason = "-3 to 3")]
            let (dx, dy) = (along(x_px).round() as isize, along(y_px).round() as isize);
            let outside =
                isize::from(DISC[dy.wrapping_add_unsigned(RADIUS).unsigned_abs()]) < dx.abs();
            let sample = image.row(y.wrapping_add_signed(dy))[x.wrapping_add_signed(dx)];
            outside || alike.share(sample - middle) > 0.5
        });
        if on_the_way { HALF_AREA_PX2 - area } else { 0.0 }
    }
}

/// exp(-u^6), of differences u in brightness.
struct Alike {
    /// At multiples of 1 / PER_UNIT, and the steps to the next ones.
    table: [[f32; 2]; Self::LAST + 1],
    scale: f32,
}

impl Alike {
    /// How finely it is sampled, and where it ends: exp(-2^6) is nothing.
    const PER_UNIT: usize = 128;
    const LAST: usize = 2 * Self::PER_UNIT;

    fn new(unit_dn: f64) -> Self {
        #[allow(clippy::cast_possible_truncation, reason = "rounds to the nearest")]
        let at = |index: usize| (-(index as f64 / Self::PER_UNIT as f64).powi(6)).exp() as f32;
        #[allow(clippy::cast_possible_truncation, reason = "rounds to the nearest")]
        let scale = (Self::PER_UNIT as f64 / unit_dn) as f32;
        Self { table: std::array::from_fn(|i| [at(i), at(i + 1) - at(i)]), scale }
    }

    fn share(&self, difference_dn: f32) -> f32 {
        let place = difference_dn.abs() * self.scale;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        let index = (place as usize).min(Self::LAST);
        #[allow(clippy::cast_precision_loss, reason = "at most 256")]
        let fraction = (place - index as f32).min(1.0);
        let [start, step] = self.table[index];
        step.mul_add(fraction, start)
    }
}

impl PeakDetector for Susan {
    fn response(&self) -> impl Response {
        let score = |image: View<'_, f32>, exposure: &Exposure, score: &mut Plane<f32>| {
            self.score(image, exposure.encoding().full_scale_dn(), score);
        };
        Scored { shade: self.channel, radius_px: RADIUS, score }
    }

    fn peaks(&self) -> &Peaks {
        &self.peaks
    }
}
