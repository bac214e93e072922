//! FAST: corners by an arc of a circle that is brighter or darker than its middle.
//!
//! ```text
//! # Method      Sixteen pixels lie on a circle of radius 3 about p. Score S(p): the largest s such
//!               that `arc_px` of them next to each other are all brighter than p by s or more, or all
//!               darker. Corners: S > threshold and S larger than any other in the square about p.
//! # Input       the channel as encoded [DN].
//! # Parameters  channel        none, luma    luma, red, red_difference
//!               arc_px         none, 9       range [9, 12]: 9 and 12 are customary
//!               those of peaks (peaks.rs: thresholds in DN, by default 20 and 0 of the strongest;
//!               the strongest so many; suppression radius, by default 1 px; margin around a region)
//! # Output      whole pixels, strongest first, equals by row, then column; response S in DN.
//! # Border      no candidate nearer than 3 px to an edge.
//! # Cost        O(pixels searched), without a branch: a decision tree saves nothing where sixteen
//!               pixels are tested at once. One plane of f32.
//! # Departures  The score is the second of the source's section 4.1, the largest threshold, as in
//!               OpenCV, whose score is S - 1 of whole numbers; not the sum of differences. Where
//!               neighbours are equally strong neither is a corner, as in OpenCV.
//! # Source      Rosten & Drummond, ECCV 2006, Machine learning for high-speed corner detection;
//!               Rosten, Porter & Drummond, PAMI 32(1), 2010.
//! # Checked by  tests/it/contract.rs (all), tests/it/opencv.rs::detectors_equal_opencv (the same set),
//!               tests/it/responses.rs::fast_matches_its_definition
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::peaks::{Equals, PeakDetector, Response, ResponseMemory};
use crate::detect::{Detector, Peaks, Shade};
use crate::image::{PixelRange, Plane, View};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;

/// The registry's line.
pub const ENTRY: Entry<dyn Detector> = Entry {
    name: "fast",
    summary: "arcs of a circle brighter or darker than its middle: FAST-9 to FAST-12",
    reference: "Rosten & Drummond 2006; Rosten, Porter & Drummond 2010",
    version: 1,
    defaults: defaults::<Fast>,
    schema: schema::<Fast>,
    build: |place, table| Ok(Box::new(parameters::<Fast>(place, table)?)),
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Fast {
    /// What is looked at.
    pub channel: Shade,
    /// How many of the circle's sixteen pixels.
    #[schemars(range(min = 9, max = 12))]
    pub arc_px: u32,
    /// When a score is a corner; the threshold in DN.
    #[serde(flatten)]
    pub peaks: Peaks,
}

impl Default for Fast {
    fn default() -> Self {
        let peaks =
            Peaks { threshold_rel: 0.0, threshold: 20.0, nms_radius_px: 1, ..Peaks::default() };
        Self { channel: Shade::Luma, arc_px: 9, peaks }
    }
}

/// The circle, clockwise as seen from the top: (x, y) from its middle.
const CIRCLE: [[isize; 2]; 16] = [
    [0, -3],
    [1, -3],
    [2, -2],
    [3, -1],
    [3, 0],
    [3, 1],
    [2, 2],
    [1, 3],
    [0, 3],
    [-1, 3],
    [-2, 2],
    [-3, 1],
    [-3, 0],
    [-3, -1],
    [-2, -2],
    [-1, -3],
];
const RADIUS: usize = 3;

impl Fast {
    /// Replaces what `score` holds by the score S \[DN\] of every pixel of `plane` \[DN\]: 0 or more, 0
    /// nearer than 3 px to an edge.
    pub fn score(&self, plane: View<'_, f32>, score: &mut Plane<f32>) {
        score.reset(plane.width(), plane.height(), 0.0);
        pulp::Arch::new().dispatch(Score { plane, arc: self.arc_px as usize, score });
    }
}

/// Scores of a plane: compiled for the machine's vectors.
struct Score<'a> {
    plane: View<'a, f32>,
    arc: usize,
    score: &'a mut Plane<f32>,
}

/// Pixels that are scored at a time.
const LANES: usize = 16;

impl pulp::WithSimd for Score<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { plane, arc, score } = self;
        let (width, height) = (plane.width(), plane.height());
        for y in RADIUS..height.saturating_sub(RADIUS) {
            let middle = plane.row(y);
            let circle = CIRCLE.map(|[dx, dy]| (plane.row(y.wrapping_add_signed(dy)), dx));
            let mut x = RADIUS;
            while x + RADIUS < width {
                let count = LANES.min(width - RADIUS - x);
                let mut differences = [[0.0_f32; LANES]; 16];
                for (difference, (row, dx)) in differences.iter_mut().zip(circle) {
                    let from = &row[x.wrapping_add_signed(dx)..][..count];
                    for ((d, p), c) in difference.iter_mut().zip(from).zip(&middle[x..x + count]) {
                        *d = p - c;
                    }
                }
                let scores = largest_arc(&differences, arc);
                score.row_mut(y)[x..x + count].copy_from_slice(&scores[..count]);
                x += count;
            }
        }
    }
}

/// The largest least difference along an arc, of brighter and of darker ones; 0 where there is none.
#[inline(always)]
fn largest_arc(differences: &[[f32; LANES]; 16], arc: usize) -> [f32; LANES] {
    let mut best = [0.0_f32; LANES];
    for start in 0..16 {
        let (mut least, mut most) = (differences[start], differences[start]);
        for step in 1..arc {
            let next = &differences[(start + step) % 16];
            for ((least, most), d) in least.iter_mut().zip(&mut most).zip(next) {
                *least = if d < least { *d } else { *least };
                *most = if d > most { *d } else { *most };
            }
        }
        for ((best, least), most) in best.iter_mut().zip(least).zip(most) {
            let score = if least > -most { least } else { -most };
            *best = if score > *best { score } else { *best };
        }
    }
    best
}

impl Response for Fast {
    fn support(&self) -> usize {
        RADIUS
    }

    fn respond(
        &self,
        exposure: &Exposure,
        range: PixelRange,
        _: &mut ResponseMemory,
        response: &mut Plane<f32>,
    ) {
        self.score(self.channel.plane(exposure).view().crop(range), response);
    }
}

impl PeakDetector for Fast {
    const EQUALS: Equals = Equals::None;

    fn response(&self) -> impl Response {
        self
    }

    fn peaks(&self) -> &Peaks {
        &self.peaks
    }
}
