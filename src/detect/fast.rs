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
//! # Cost        O(pixels searched): four pixels of the circle, and all sixteen where a vector holds one
//!               that two neighbours of these let pass. One plane of f32.
//! # Departures  The score is the second of the source's section 4.1, the largest threshold, as in
//!               OpenCV, whose score is S - 1 of whole numbers; not the sum of differences. Where
//!               neighbours are equally strong neither is a corner, as in OpenCV.
//! # Source      Rosten & Drummond, ECCV 2006, Machine learning for high-speed corner detection;
//!               Rosten, Porter & Drummond, PAMI 32(1), 2010.
//! # Checked by  tests/it/contract.rs (all), tests/it/opencv.rs::detectors_equal_opencv (the same set),
//!               tests/it/responses.rs::fast_matches_its_definition
//! ```

use pulp::Simd;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::channel::Scored;
use crate::detect::maxima::Equals;
use crate::detect::peaks::{PeakDetector, Response};
use crate::detect::{Detector, Peaks, Shade};
use crate::image::{Plane, View};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;
use crate::vector::{Lanes, Real};

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
    /// nearer than 3 px to an edge. Scores that do not exceed `least_dn`, 0 or more, may be 0 instead.
    pub fn score(&self, plane: View<'_, f32>, least_dn: f32, score: &mut Plane<f32>) {
        score.reset(plane.width(), plane.height(), 0.0);
        let machine = pulp::Arch::new();
        match self.arc_px {
            ..=9 => machine.dispatch(Score::<9> { plane, least_dn, score }),
            10 => machine.dispatch(Score::<10> { plane, least_dn, score }),
            11 => machine.dispatch(Score::<11> { plane, least_dn, score }),
            12.. => machine.dispatch(Score::<12> { plane, least_dn, score }),
        }
    }
}

/// Scores of a plane: compiled for the machine's vectors and the length of the arc.
struct Score<'a, const ARC: usize> {
    plane: View<'a, f32>,
    least_dn: f32,
    score: &'a mut Plane<f32>,
}

impl<const ARC: usize> pulp::WithSimd for Score<'_, ARC> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        const MANY: usize = 4;
        let Self { plane, least_dn, score } = self;
        let (width, height) = (plane.width(), plane.height());
        let end = width.saturating_sub(RADIUS);
        for y in RADIUS..height.saturating_sub(RADIUS) {
            let rows = std::array::from_fn(|row| plane.row(y + row - RADIUS));
            let circles = Circles { rows };
            let out = score.row_mut(y);
            if end < RADIUS + S::F32_LANES {
                for (x, out) in out.iter_mut().enumerate().take(end).skip(RADIUS) {
                    *out = score_of::<f32, ARC>(&circles.differences(|row, x| row[x], x), 0.0);
                }
                continue;
            }
            // The last vector overlaps the one before.
            let last = end - S::F32_LANES;
            let mut x = RADIUS;
            while x < end {
                let mut strongest = Lanes::splat(simd, 0.0);
                for vector in 0..MANY {
                    let first = (x + vector * S::F32_LANES).min(last);
                    strongest = strongest.max(circles.compass(simd, first));
                }
                if strongest.largest() > least_dn {
                    for vector in 0..MANY {
                        let first = (x + vector * S::F32_LANES).min(last);
                        if circles.compass(simd, first).largest() > least_dn {
                            let all = circles.differences(
                                #[inline(always)]
                                |row, x| Lanes::load(simd, row, x),
                                first,
                            );
                            score_of::<_, ARC>(&all, Lanes::splat(simd, 0.0)).store(out, first);
                        }
                    }
                }
                x += MANY * S::F32_LANES;
            }
        }
    }
}

/// The circles about the pixels of a row.
#[derive(Clone, Copy)]
struct Circles<'a> {
    /// From the third above to the third below.
    rows: [&'a [f32]; 7],
}

impl Circles<'_> {
    /// At least the score, from four pixels: an arc of nine or more holds two of them next to each other.
    #[inline(always)]
    fn compass<S: Simd>(&self, simd: S, x: usize) -> Lanes<S> {
        let middle = Lanes::load(simd, self.rows[3], x);
        let up = Lanes::load(simd, self.rows[0], x) - middle;
        let down = Lanes::load(simd, self.rows[6], x) - middle;
        let left = Lanes::load(simd, self.rows[3], x - 3) - middle;
        let right = Lanes::load(simd, self.rows[3], x + 3) - middle;
        // Up or down, and left or right.
        let brighter = up.max(down).min(left.max(right));
        let darker = up.min(down).max(left.min(right));
        brighter.max(Lanes::splat(simd, 0.0) - darker)
    }

    /// What the circle's pixels exceed the middle by.
    #[inline(always)]
    fn differences<R: Real>(&self, load: impl Fn(&[f32], usize) -> R, x: usize) -> [R; 16] {
        let middle = load(self.rows[3], x);
        let mut differences = [middle; 16];
        for place in 0..16 {
            let [dx, dy] = CIRCLE[place];
            let row = self.rows[dy.wrapping_add_unsigned(RADIUS).unsigned_abs()];
            differences[place] = load(row, x.wrapping_add_signed(dx)) - middle;
        }
        differences
    }
}

/// The largest least difference along an arc, of brighter and of darker ones; 0 where there is none.
#[inline(always)]
fn score_of<R: Real, const ARC: usize>(differences: &[R; 16], zero: R) -> R {
    let (mut brightest, mut darkest) = (zero, zero);
    // Two arcs at a time, which differ in one pixel at either end.
    for start in (0..16).step_by(2) {
        let mut least = differences[(start + 1) % 16];
        let mut most = least;
        for place in start + 2..start + ARC {
            let here = differences[place % 16];
            least = least.min(here);
            most = most.max(here);
        }
        let (first, last) = (differences[start], differences[(start + ARC) % 16]);
        brightest = brightest.max(least.min(first)).max(least.min(last));
        darkest = darkest.min(most.max(first)).min(most.max(last));
    }
    brightest.max(zero - darkest)
}

impl PeakDetector for Fast {
    const EQUALS: Equals = Equals::None;

    fn response(&self) -> impl Response {
        #[allow(clippy::cast_possible_truncation, reason = "peaks compare exactly afterwards")]
        let least_dn = (self.peaks.threshold as f32).next_down().max(0.0);
        let score = move |image: View<'_, f32>, _: &Exposure, score: &mut Plane<f32>| {
            self.score(image, least_dn, score);
        };
        Scored { shade: self.channel, radius_px: RADIUS, score }
    }

    fn peaks(&self) -> &Peaks {
        &self.peaks
    }
}
