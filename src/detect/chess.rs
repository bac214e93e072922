//! ChESS: chessboards' corners, and no others.
//!
//! ```text
//! # Method      Sixteen pixels I_0 ... I_15 lie on a ring of radius 5 about p.
//!               R = sum_{n<4} |I_n + I_{n+8} - I_{n+4} - I_{n+12}| - sum_{n<8} |I_n - I_{n+8}|
//!                   - 16 |mean of the ring - mean of p and its four neighbours|.
//!               Corners are the maxima of R: opposite pixels are alike, those a quarter turn on differ.
//! # Input       the channel as encoded [DN].
//! # Parameters  channel  luma; red; red_difference
//!               those of peaks (peaks.rs: thresholds, the strongest so many, suppression radius, margin
//!               around a region)
//! # Output      whole-pixel maxima, strongest first, equals by row, then column; response in DN.
//! # Border      no candidate nearer than 5 px to an edge.
//! # Cost        O(pixels searched); one plane of f32.
//! # Departures  Theirs has no threshold but 0 and groups maxima into a board's grid.
//!               A control: on the L, Y and arrow corners of a cuboid it finds next to nothing.
//! # Source      Bennett & Lasenby, ChESS - Quick and robust detection of chess-board features, Computer
//!               Vision and Image Understanding 118, 2014, equations 1 to 5.
//! # Checked by  tests/it/contract.rs (all), tests/it/detectors.rs::chess_finds_an_x_and_no_l_or_y
//! ```

use pulp::Simd;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::channel::Scored;
use crate::detect::peaks::{PeakDetector, Response};
use crate::detect::{Detector, Peaks, Shade};
use crate::image::{Plane, View};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;
use crate::vector::{Lanes, Real};

/// The registry's line.
pub const ENTRY: Entry<dyn Detector> = Entry {
    name: "chess",
    summary: "corners of chessboards alone: a control",
    reference: "Bennett & Lasenby 2014, equations 1 to 5",
    version: 1,
    defaults: defaults::<Chess>,
    schema: schema::<Chess>,
    build: |place, table| Ok(Box::new(parameters::<Chess>(place, table)?)),
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Chess {
    /// What is looked at.
    pub channel: Shade,
    /// When a response is a corner.
    #[serde(flatten)]
    pub peaks: Peaks,
}

/// The ring, clockwise as seen from the top: (x, y) from its middle.
const RING: [[isize; 2]; 16] = [
    [0, -5],
    [2, -5],
    [3, -3],
    [5, -2],
    [5, 0],
    [5, 2],
    [3, 3],
    [2, 5],
    [0, 5],
    [-2, 5],
    [-3, 3],
    [-5, 2],
    [-5, 0],
    [-5, -2],
    [-3, -3],
    [-2, -5],
];
const RADIUS: usize = 5;

/// Responses of an image: compiled for the machine's vectors.
struct Rings<'a> {
    image: View<'a, f32>,
    response: &'a mut Plane<f32>,
}

impl pulp::WithSimd for Rings<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { image, response } = self;
        let end = image.width().saturating_sub(RADIUS);
        for y in RADIUS..image.height().saturating_sub(RADIUS) {
            for x in (RADIUS..end).step_by(S::F32_LANES) {
                let samples = |[dx, dy]: [isize; 2]| {
                    let (x, y) = (x.wrapping_add_signed(dx), y.wrapping_add_signed(dy));
                    &image.row(y)[x..(x + S::F32_LANES).min(image.width())]
                };
                let mut ring = [Lanes::splat(simd, 0.0); 16];
                let mut sum = Lanes::splat(simd, 0.0);
                for (sample, offset) in ring.iter_mut().zip(RING) {
                    *sample = Lanes::load_part(simd, samples(offset), 0);
                    sum = sum + *sample;
                }
                let mut local = Lanes::splat(simd, 0.0);
                for offset in [[0, 0], [0, -1], [1, 0], [0, 1], [-1, 0]] {
                    local = local + Lanes::load_part(simd, samples(offset), 0);
                }
                let mut answer = (sum - local * (16.0 / 5.0)).abs() * -1.0;
                for n in 0..4 {
                    let quarter = ring[n] + ring[n + 8] - ring[n + 4] - ring[n + 12];
                    answer = answer + quarter.abs();
                }
                for n in 0..8 {
                    answer = answer - (ring[n] - ring[n + 8]).abs();
                }
                answer.store_part(&mut response.row_mut(y)[..end], x);
            }
        }
    }
}

impl PeakDetector for Chess {
    fn response(&self) -> impl Response {
        let score = |image: View<'_, f32>, _: &Exposure, response: &mut Plane<f32>| {
            response.reset(image.width(), image.height(), 0.0);
            pulp::Arch::new().dispatch(Rings { image, response });
        };
        Scored { shade: self.channel, radius_px: RADIUS, score }
    }

    fn peaks(&self) -> &Peaks {
        &self.peaks
    }
}
