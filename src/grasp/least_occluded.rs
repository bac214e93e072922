//! The whole face with the fewest gaps.
//!
//! ```text
//! # Method      A *side* joins two corners along one straight edge of the image. The step across it
//!               (over 2 px, of the channel where it is largest, smoothed by [1 2 1] / 4 in x and
//!               y) is sought within 3 px; support = the largest share of samples whose step lies
//!               within 1 px of one straight line.
//!               An *outline* is a convex quadrilateral of four sides that could be one face:
//!                 parallel       opposite sides nearly are;
//!                 one brightness no step between medians of red along lines parallel to a side;
//!                 no T-junction  no side runs on beyond its corner with no target on either side,
//!                                as the outline of an occluder does;
//!                 convex target  no red lies beyond a side that has no red next to it.
//!               Outlines inside a larger outline are parts of a face and are dropped. The answer
//!               has, among those with gap <= max_gap, the largest
//!                 area * support of the weakest side * (1 - gap / max_gap);
//!               gap = share of the pixels at least 1.5 px inside that the target's mask lacks.
//! # Input       encoded exposure; the target's mask; refined corners in any order. Steps are
//!               relative to the mask's mean red: gain does not matter.
//! # Parameters  max_gap_fraction     none, 0.05  range [0.001, 1]: hidden share of the face
//!               min_area_fraction    none, 0.1   range [0, 1]: of the mask's pixels
//!               min_side_support     none, 0.75  range [0.1, 1]: of the weakest side
//!               edge_step_fraction   none, 0.04  range [0.005, 0.5]: an edge from here on, one
//!                                                face up to here
//!               max_convergence_deg  deg, 20     range [0, 60]: between opposite sides, beyond
//!                                                what corner errors of 3 px explain
//!               max_corners          none, 24    range [4, 64]: the strongest within 4 px of the
//!                                                mask's range
//! # Output      the corners as given, clockwise as seen from the topmost (then leftmost);
//!               too_few_corners below four near the target, all_occluded when no outline passes.
//! # Border      corners outside the image are ignored; the border pixels continue outwards.
//! # Cost        O(corners^2) sides of at most 32 samples, O(pixels) for each outline. On drawn
//!               targets of 40 to 200 px: mean 1.5 ms, at most 7.5 ms.
//! # Departures  The source asks for "small or no gaps in the corner point range" and gives no
//!               formula: every test and threshold above is ours.
//!               All four corners of the face are needed; none is completed. A hard shadow across
//!               a face makes it two; two faces less than a step apart are one. An occluder that
//!               hides the end of a face along a straight line passes for the face's edge when
//!               its outline shows nowhere beside the target.
//!               1437 drawn cuboids, corners 0 to 2.5 px off, a face is hit at IoU > 0.8. Where a
//!               face was whole and its corners found, in %:
//!                 target hidden  right  other face  no face  declined
//!                 not at all      97.9         0.0      0.4       1.8
//!                 < 10 %          81.3         2.9      5.0      10.8
//!                 10 to 30 %      76.1         0.0      6.3      17.6
//!                 30 to 60 %      66.0         0.0      4.0      30.0
//!               Where every face was hidden by more than 8 %: declined 91, no face 6.
//! # Source      Visual recognition of robot targets in complex state based on sub-pixel Harris
//!               corner, section 5.
//! # Checked by  tests below; tests/it/grasp.rs (full_experiment prints these rates)
//! ```

use serde::{Deserialize, Serialize};
use toml::Table;

use crate::error::Result;
use crate::geometry::ImagePoint;
use crate::grasp::{Face, FaceSelector, NoFace};
use crate::image::{PixelRange, Plane};
use crate::refine::Corner;
use crate::registry::{self, Entry, in_range};
use crate::sensor::Exposure;
use crate::stats;
use crate::target::TargetRegion;

/// The registry's line.
pub const ENTRY: Entry<dyn FaceSelector> = Entry {
    name: "least_occluded",
    summary: "the whole face with the fewest gaps: four corners, straight edges, one brightness",
    reference: "Visual recognition of robot targets in complex state based on sub-pixel Harris \
                corner, section 5",
    version: 1,
    build: |place, table| Ok(Box::new(LeastOccluded::from_table(place, table)?)),
};

/// How far an edge of the image may lie from the line through two of its corners \[px\].
const SEARCH_PX: f64 = 3.0;
/// Corners nearer to each other than this make no side \[px\].
const MIN_SIDE_PX: f64 = 8.0;
/// How far inside its outline a face is looked at for gaps, because corners err \[px\].
const GAP_INSET_PX: f64 = 1.5;
/// Outlines hidden by more than this share are accidents.
const MAX_HIDDEN_FRACTION: f64 = 0.8;
/// How much larger an outline must be for another inside it to be its part.
const PART_AREA_RATIO: f64 = 1.15;

/// The selector; its parameters are those of the header.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct LeastOccluded {
    /// Largest share of the chosen face's pixels that may be hidden, in \[0.001, 1\].
    pub max_gap_fraction: f64,
    /// Smallest area of a face, as a share of the mask's pixels, in \[0, 1\].
    pub min_area_fraction: f64,
    /// Smallest share of each side that must lie on an edge of the image, in \[0.1, 1\].
    pub min_side_support: f64,
    /// The smallest step that is an edge and the largest within one face, as a share of the
    /// target's mean red, in \[0.005, 0.5\].
    pub edge_step_fraction: f64,
    /// Largest angle between opposite sides, beyond what corner errors explain, in \[0, 60\] deg.
    pub max_convergence_deg: f64,
    /// How many of the strongest corners are considered, in \[4, 64\].
    pub max_corners: usize,
}

impl Default for LeastOccluded {
    fn default() -> Self {
        Self {
            max_gap_fraction: 0.05,
            min_area_fraction: 0.1,
            min_side_support: 0.75,
            edge_step_fraction: 0.04,
            max_convergence_deg: 20.0,
            max_corners: 24,
        }
    }
}

impl LeastOccluded {
    fn from_table(place: &str, table: &Table) -> Result<Self> {
        let selector: Self = registry::parameters(place, table)?;
        in_range(place, "max_gap_fraction", selector.max_gap_fraction, 0.001..=1.0)?;
        in_range(place, "min_area_fraction", selector.min_area_fraction, 0.0..=1.0)?;
        in_range(place, "min_side_support", selector.min_side_support, 0.1..=1.0)?;
        in_range(place, "edge_step_fraction", selector.edge_step_fraction, 0.005..=0.5)?;
        in_range(place, "max_convergence_deg", selector.max_convergence_deg, 0.0..=60.0)?;
        in_range(place, "max_corners", selector.max_corners, 4..=64)?;
        Ok(selector)
    }

    /// The strongest corners in and around the target's range.
    fn strongest(&self, region: &TargetRegion, corners: &[Corner]) -> Vec<ImagePoint> {
        let near = region.range.grown(4, region.mask.width(), region.mask.height());
        let mut near: Vec<&Corner> =
            corners.iter().filter(|corner| covers(near, corner.position)).collect();
        near.sort_by(|a, b| b.seed.response.total_cmp(&a.seed.response));
        near.iter().take(self.max_corners).map(|corner| corner.position).collect()
    }

    /// Every quadrilateral of `points` that could be one face.
    fn outlines(&self, target: &Target, points: &[ImagePoint]) -> Vec<Outline> {
        let count = points.len();
        let mut sides: Vec<Option<Side>> = vec![None; count * count];
        for from in 0..count {
            for to in from + 1..count {
                let side = target.side(points[from], points[to], self.min_side_support);
                sides[from * count + to] = side;
                sides[to * count + from] = side.map(Side::reversed);
            }
        }
        let from = |corner: usize, least: usize| {
            let row = &sides[corner * count..(corner + 1) * count];
            (least..count).filter_map(move |to| Some((to, row[to]?)))
        };

        // Closed walks of four sides from their first corner; one direction of each is clockwise.
        let mut outlines = Vec::new();
        for i in 0..count {
            for (j, ij) in from(i, i + 1) {
                for (k, jk) in from(j, i + 1) {
                    for (l, kl) in from(k, i + 1) {
                        let Some(li) = sides[l * count + i] else { continue };
                        let corners = [i, j, k, l].map(|n| points[n]);
                        outlines.extend(self.outline(target, corners, [ij, jk, kl, li]));
                    }
                }
            }
        }
        outlines
    }

    /// The outline of four corners and the sides that join them, when it could be one face.
    fn outline(
        &self,
        target: &Target,
        corners: [ImagePoint; 4],
        sides: [Side; 4],
    ) -> Option<Outline> {
        let area_px2 = convex_clockwise_area(&corners)?;
        let is_plausible = area_px2 >= self.min_area_fraction * target.pixels
            && convergence(&corners) <= self.max_convergence_deg.to_radians().sin();
        if !is_plausible {
            return None;
        }
        let gap_fraction = target.gap_fraction(&corners)?;
        let is_face = gap_fraction <= MAX_HIDDEN_FRACTION
            && target.largest_step(&corners) <= target.min_step
            && !sides.iter().any(|side| {
                target.lies_beyond(&side.line)
                    || target.runs_on(&side.line)
                    || target.runs_on(&side.reversed().line)
            });
        let support = sides.iter().map(|side| side.support).fold(1.0, f64::min);
        is_face.then_some(Outline { corners, area_px2, support, gap_fraction })
    }

    fn score(&self, outline: &Outline) -> f64 {
        let unspent = 1.0 - outline.gap_fraction / self.max_gap_fraction;
        outline.area_px2 * outline.support * unspent
    }
}

impl FaceSelector for LeastOccluded {
    fn select(
        &self,
        exposure: &Exposure,
        region: &TargetRegion,
        corners: &[Corner],
    ) -> std::result::Result<Face, NoFace> {
        let points = self.strongest(region, corners);
        if points.len() < 4 {
            return Err(NoFace::TooFewCorners);
        }
        let target = Target::new(exposure, region, self.edge_step_fraction);
        let outlines = self.outlines(&target, &points);
        outlines
            .iter()
            .filter(|outline| outline.gap_fraction <= self.max_gap_fraction)
            .filter(|outline| !outlines.iter().any(|other| outline.is_part_of(other)))
            .max_by(|a, b| self.score(a).total_cmp(&self.score(b)))
            .map(|best| Face {
                corners: from_the_topmost(best.corners),
                gap_fraction: best.gap_fraction,
            })
            .ok_or(NoFace::AllOccluded)
    }
}

/// A quadrilateral that could be one face.
struct Outline {
    corners: [ImagePoint; 4],
    area_px2: f64,
    /// Of the weakest side.
    support: f64,
    gap_fraction: f64,
}

impl Outline {
    /// Whether it lies inside a larger outline, corner errors allowed for.
    fn is_part_of(&self, other: &Self) -> bool {
        other.area_px2 > PART_AREA_RATIO * self.area_px2
            && sides_of(&other.corners)
                .iter()
                .all(|side| self.corners.iter().all(|&p| side.coordinates(p).1 > -SEARCH_PX))
    }
}

/// A directed line segment with its own coordinates: along it, and to its right as seen, which is
/// inwards for a clockwise outline \[px\].
#[derive(Clone, Copy)]
struct Line {
    start: ImagePoint,
    direction: [f64; 2],
    length_px: f64,
}

impl Line {
    /// The segment between two different points.
    fn between(start: ImagePoint, end: ImagePoint) -> Self {
        let length_px = start.distance_px(end);
        let direction = [(end.x - start.x) / length_px, (end.y - start.y) / length_px];
        Self { start, direction, length_px }
    }

    fn end(&self) -> ImagePoint {
        self.point(self.length_px, 0.0)
    }

    fn point(&self, along: f64, right: f64) -> ImagePoint {
        let [x, y] = self.direction;
        ImagePoint::new(self.start.x + along * x - right * y, self.start.y + along * y + right * x)
    }

    /// (along, right) of a point.
    fn coordinates(&self, point: ImagePoint) -> (f64, f64) {
        let [x, y] = self.direction;
        let (dx, dy) = (point.x - self.start.x, point.y - self.start.y);
        (dx * x + dy * y, dy * x - dx * y)
    }

    /// `count` distances along the segment, evenly spread.
    fn spread(&self, count: u32) -> impl Iterator<Item = f64> {
        let pitch = self.length_px / f64::from(count);
        (0..count).map(move |i| (f64::from(i) + 0.5) * pitch)
    }
}

fn sides_of(corners: &[ImagePoint; 4]) -> [Line; 4] {
    let [a, b, c, d] = *corners;
    [Line::between(a, b), Line::between(b, c), Line::between(c, d), Line::between(d, a)]
}

/// The straight edge of the image that joins two corners.
#[derive(Clone, Copy)]
struct Side {
    /// Share of it on an edge, in \[0, 1\].
    support: f64,
    /// The edge itself, up to [`SEARCH_PX`] from the line through the corners.
    line: Line,
}

impl Side {
    fn reversed(self) -> Self {
        Self { line: Line::between(self.line.end(), self.line.start), ..self }
    }
}

/// The offsets from a line, in half pixels from -6 to 6, at which an edge of the image crosses.
#[derive(Clone, Copy, Default)]
struct Crossings(u32);

impl Crossings {
    const LAST: usize = 12;

    /// Whether one lies within 1 px of `offset_px`, itself within [`SEARCH_PX`].
    fn near(self, offset_px: f64) -> bool {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in 0..=12")]
        let place = (2.0 * (offset_px + SEARCH_PX)).round().clamp(0.0, 12.0) as u32;
        // Bit `place` of the shifted set is the offset 1 px to the left of `place`.
        ((self.0 << 2) >> place) & 0b1_1111 != 0
    }
}

/// What is known of the target in one exposure.
struct Target<'a> {
    red: &'a Plane<f32>,
    mask: &'a Plane<bool>,
    /// Pixels in the mask.
    pixels: f64,
    /// The part of the image that is looked at.
    window: PixelRange,
    /// The channels there, smoothed.
    channels: [Plane<f32>; 3],
    /// The smallest step that is an edge \[DN\].
    min_step: f64,
    /// The first and the last pixel of the mask in each row: its convex hull's vertices and more.
    extremes: Vec<ImagePoint>,
}

#[allow(clippy::cast_precision_loss, reason = "image coordinates")]
impl<'a> Target<'a> {
    fn new(exposure: &'a Exposure, region: &'a TargetRegion, edge_step_fraction: f64) -> Self {
        let (mask, red) = (&region.mask, &exposure.rgb()[0]);
        let window = region.range.grown(20, mask.width(), mask.height());
        let channels = [0, 1, 2].map(|c| smoothed(&exposure.rgb()[c].crop(window)));
        let (mut sum, mut pixels) = (0.0, 0.0);
        let mut extremes = Vec::new();
        for y in window.y0..window.y1 {
            let of_target = || (window.x0..window.x1).filter(|&x| mask.at(x, y));
            for x in of_target() {
                sum += f64::from(red.at(x, y));
                pixels += 1.0;
            }
            let ends = of_target().next().into_iter().chain(of_target().next_back());
            extremes.extend(ends.map(|x| ImagePoint::new(x as f64, y as f64)));
        }
        let min_step = edge_step_fraction * sum / f64::max(pixels, 1.0);
        Self { red, mask, pixels, window, channels, min_step, extremes }
    }

    /// The pixel at `point`, when it is the target's.
    fn pixel(&self, point: ImagePoint) -> Option<(usize, usize)> {
        covers(self.window, point).then(|| pixel_of(point)).filter(|&(x, y)| self.mask.at(x, y))
    }

    /// Where edges cross the normal of `line` at `along`: local maxima of the step over 2 px.
    fn crossings(&self, line: &Line, along: f64) -> Crossings {
        const STEPS: usize = Crossings::LAST + 3;
        let mut steps = [0.0_f64; STEPS];
        for channel in &self.channels {
            let values: [f64; STEPS + 4] = std::array::from_fn(|n| {
                let point = line.point(along, 0.5 * (n as f64 - 9.0));
                channel.bilinear(ImagePoint::new(
                    point.x - self.window.x0 as f64,
                    point.y - self.window.y0 as f64,
                ))
            });
            for (n, step) in steps.iter_mut().enumerate() {
                *step = step.max((values[n + 4] - values[n]).abs());
            }
        }
        let is_edge = |n: &usize| {
            let step = steps[n + 1];
            step >= self.min_step && step > 0.0 && step >= steps[*n] && step >= steps[n + 2]
        };
        Crossings((0..=Crossings::LAST).filter(is_edge).fold(0, |set, n| set | 1 << n))
    }

    /// The straight edge that joins two corners, when enough of it shows.
    fn side(&self, a: ImagePoint, b: ImagePoint, min_support: f64) -> Option<Side> {
        if a.distance_px(b) < MIN_SIDE_PX {
            return None;
        }
        let chord = Line::between(a, b);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let count = (chord.length_px / 2.0).clamp(6.0, 32.0) as u32;
        let mut missing_allowed = (1.0 - min_support) * f64::from(count);
        let mut samples = Vec::with_capacity(count as usize);
        for along in chord.spread(count) {
            let crossings = self.crossings(&chord, along);
            if crossings.0 == 0 {
                missing_allowed -= 1.0;
                if missing_allowed < -1e-9 {
                    return None;
                }
            }
            samples.push((along / chord.length_px, crossings));
        }

        // The line through most crossings; the least displaced of equals.
        let offsets = -3_i32..=3;
        let (hits, _, first, last) = offsets
            .clone()
            .flat_map(|first| offsets.clone().map(move |last| (first, last)))
            .map(|(first, last)| {
                let [p, q] = [first, last].map(f64::from);
                let on = |&&(t, crossings): &&(f64, Crossings)| crossings.near(p + t * (q - p));
                (samples.iter().filter(on).count(), -(first.abs() + last.abs()), first, last)
            })
            .max()?;
        let support = hits as f64 / f64::from(count);
        let line = Line::between(
            chord.point(0.0, f64::from(first)),
            chord.point(chord.length_px, f64::from(last)),
        );
        (support >= min_support).then_some(Side { support, line })
    }

    /// Whether an edge runs on beyond the end of `line`, straight, with no target on either side:
    /// the outline of an occluder, never of the target.
    fn runs_on(&self, line: &Line) -> bool {
        const SAMPLES: u32 = 8;
        let reach = (0.5 * line.length_px).clamp(8.0, 14.0) - 4.0;
        let on = (0..SAMPLES).filter(|&i| {
            let along = line.length_px + 4.0 + reach * f64::from(i) / f64::from(SAMPLES - 1);
            [-2.5, 2.5].iter().all(|&right| self.pixel(line.point(along, right)).is_none())
                && self.crossings(line, along).near(0.0)
        });
        on.count() >= 6
    }

    /// Whether some of the target lies beyond a side that has none next to it. The image of a
    /// cuboid is convex, so such a side is an occluder's. Tolerance grows with the distance from
    /// the side, for its direction errs as its ends do.
    fn lies_beyond(&self, side: &Line) -> bool {
        let outside = |&along: &f64| self.pixel(side.point(along, -SEARCH_PX)).is_none();
        let is_silhouette = side.spread(16).filter(outside).count() >= 8;
        is_silhouette
            && self.extremes.iter().any(|&point| {
                let (along, right) = side.coordinates(point);
                let overshoot = (-along).max(along - side.length_px).max(0.0);
                -right > 4.0 + (0.1 + 4.0 / side.length_px) * overshoot
            })
    }

    /// Share of the pixels well inside a clockwise outline that are not the target's; `None` when
    /// there is no such pixel.
    fn gap_fraction(&self, corners: &[ImagePoint; 4]) -> Option<f64> {
        let sides = sides_of(corners);
        let (mut inside, mut red) = (0, 0);
        for y in self.window.y0..self.window.y1 {
            // right(x) = right(0) - x * direction.y must reach the inset for every side.
            let (mut low, mut high) = (self.window.x0 as f64, self.window.x1 as f64 - 1.0);
            for side in &sides {
                let excess = side.coordinates(ImagePoint::new(0.0, y as f64)).1 - GAP_INSET_PX;
                let slope = -side.direction[1];
                if slope > 0.0 {
                    low = low.max(-excess / slope);
                } else if slope < 0.0 {
                    high = high.min(-excess / slope);
                } else if excess < 0.0 {
                    high = f64::NEG_INFINITY;
                }
            }
            if low.ceil() <= high.floor() {
                let (first, _) = pixel_of(ImagePoint::new(low.ceil(), 0.0));
                let (last, _) = pixel_of(ImagePoint::new(high.floor(), 0.0));
                inside += last - first + 1;
                red += self.mask.row(y)[first..=last].iter().filter(|&&is_red| is_red).count();
            }
        }
        (inside > 0).then(|| 1.0 - red as f64 / inside as f64)
    }

    /// The largest step of brightness across the outline, in either direction \[DN\].
    fn largest_step(&self, &[a, b, c, d]: &[ImagePoint; 4]) -> f64 {
        self.step_between(Line::between(a, b), Line::between(d, c))
            .max(self.step_between(Line::between(b, c), Line::between(a, d)))
    }

    /// The largest step \[DN\] of the profile from the starts to the ends of two opposite sides:
    /// of the medians of red along the lines that join them, which shadows and leaves do not move.
    fn step_between(&self, near: Line, far: Line) -> f64 {
        const LINES: u32 = 24;
        let trim = SEARCH_PX / near.length_px.min(far.length_px);
        let profile: Vec<f64> = (0..LINES)
            .filter_map(|k| {
                let t = trim + (1.0 - 2.0 * trim) * (f64::from(k) + 0.5) / f64::from(LINES);
                let (p, q) =
                    (near.point(t * near.length_px, 0.0), far.point(t * far.length_px, 0.0));
                let across = Line::between(p, q);
                let red: Vec<f64> = (0..LINES)
                    .filter_map(|m| {
                        let s = 0.08 + 0.84 * f64::from(m) / f64::from(LINES - 1);
                        let (x, y) = self.pixel(across.point(s * across.length_px, 0.0))?;
                        Some(f64::from(self.red.at(x, y)))
                    })
                    .collect();
                if red.len() >= 8 { stats::median(&red) } else { None }
            })
            .collect();
        let step = |four: &[f64]| 0.5 * (four[3] + four[2] - four[1] - four[0]).abs();
        profile.windows(4).map(step).fold(0.0, f64::max)
    }
}

/// Whether `point` lies on a pixel of `range`; false for what is not finite.
#[allow(clippy::cast_precision_loss, reason = "image coordinates")]
fn covers(range: PixelRange, point: ImagePoint) -> bool {
    (range.x0 as f64 - 0.5..range.x1 as f64 - 0.5).contains(&point.x)
        && (range.y0 as f64 - 0.5..range.y1 as f64 - 0.5).contains(&point.y)
}

/// The pixel at a point of the image.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the image")]
fn pixel_of(point: ImagePoint) -> (usize, usize) {
    ((point.x + 0.5).floor() as usize, (point.y + 0.5).floor() as usize)
}

/// The binomial \[1 2 1\]/4 in x and in y, the border pixels continued outwards.
fn smoothed(plane: &Plane<f32>) -> Plane<f32> {
    let pass = |plane: &Plane<f32>, dx: isize, dy: isize| {
        Plane::from_fn(plane.width(), plane.height(), |x, y| {
            let (x, y) = (x.cast_signed(), y.cast_signed());
            0.25 * (plane.at_replicated(x - dx, y - dy) + plane.at_replicated(x + dx, y + dy))
                + 0.5 * plane.at_replicated(x, y)
        })
    };
    pass(&pass(plane, 1, 0), 0, 1)
}

/// Twice the signed area of a triangle, positive when a, b, c run clockwise as seen.
fn turn(a: ImagePoint, b: ImagePoint, c: ImagePoint) -> f64 {
    (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
}

/// The area of a quadrilateral \[px^2\]; `None` unless it is strictly convex and clockwise as seen.
fn convex_clockwise_area(&[a, b, c, d]: &[ImagePoint; 4]) -> Option<f64> {
    let turns = [turn(a, b, c), turn(b, c, d), turn(c, d, a), turn(d, a, b)];
    turns.iter().all(|&turn| turn > 0.0).then(|| 0.5 * (turns[0] + turns[2]))
}

/// Sine of the larger angle between opposite sides, less what corner errors explain.
fn convergence(corners: &[ImagePoint; 4]) -> f64 {
    let between = |a: &Line, b: &Line| {
        let sine = a.direction[0] * b.direction[1] - a.direction[1] * b.direction[0];
        sine.abs() - SEARCH_PX / a.length_px.min(b.length_px)
    };
    let [ab, bc, cd, da] = sides_of(corners);
    between(&ab, &cd).max(between(&bc, &da))
}

/// The same corners in the same sense, the topmost first, the leftmost of equals.
fn from_the_topmost(mut corners: [ImagePoint; 4]) -> [ImagePoint; 4] {
    let first = (0..4).min_by(|&m, &n| {
        let (a, b) = (corners[m], corners[n]);
        a.y.total_cmp(&b.y).then(a.x.total_cmp(&b.x))
    });
    corners.rotate_left(first.unwrap_or(0));
    corners
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::Detection;
    use crate::refine::RefineStatus;
    use crate::sensor::{Encoding, Transfer};

    /// Grey, 64 x 64, with a rectangle of `red` over the pixels from (12, 16) to (43, 51).
    fn rectangle(red: f32) -> (Exposure, TargetRegion) {
        let range = PixelRange { x0: 12, y0: 16, x1: 44, y1: 52 };
        let mask = Plane::from_fn(64, 64, |x, y| (12..44).contains(&x) && (16..52).contains(&y));
        let rgb =
            [red, 20.0, 20.0].map(|dn| mask.map(|of_target| if of_target { dn } else { 120.0 }));
        let exposure = Exposure::new(rgb, Encoding { bit_depth: 8, transfer: Transfer::Srgb });
        let quadrilateral =
            [[12.0, 16.0], [43.0, 16.0], [43.0, 51.0], [12.0, 51.0]].map(ImagePoint::from);
        (exposure, TargetRegion { mask, range, quadrilateral, pixels: 32 * 36 })
    }

    fn corners(points: &[[f64; 2]]) -> Vec<Corner> {
        let corner = |&point: &[f64; 2]| Corner {
            seed: Detection { point: point.into(), response: 1.0 },
            position: point.into(),
            covariance_px2: None,
            iterations: 0,
            status: RefineStatus::Ok,
        };
        points.iter().map(corner).collect()
    }

    #[test]
    fn a_rectangle_is_returned_clockwise_from_its_topmost_corner() {
        let (exposure, region) = rectangle(200.0);
        let found =
            corners(&[[43.0, 51.0], [12.0, 51.5], [30.0, 30.0], [43.5, 16.0], [13.0, 15.5]]);
        let face = LeastOccluded::default().select(&exposure, &region, &found).expect("whole");
        let expected = [[13.0, 15.5], [43.5, 16.0], [43.0, 51.0], [12.0, 51.5]];
        assert_eq!(face.corners, expected.map(ImagePoint::from));
        assert!(face.gap_fraction.abs() < 1e-12);
    }

    #[test]
    fn a_hole_is_counted_as_gap() {
        let (exposure, mut region) = rectangle(200.0);
        for y in 30..40 {
            region.mask.row_mut(y)[20..30].fill(false);
        }
        let found = corners(&[[12.0, 16.0], [43.0, 16.0], [43.0, 51.0], [12.0, 51.0]]);
        let select = |max_gap_fraction| {
            let selector = LeastOccluded { max_gap_fraction, ..LeastOccluded::default() };
            selector.select(&exposure, &region, &found)
        };
        // Pixels at least 1.5 px inside 31 x 35 px: 28 x 32.
        let face = select(0.2).expect("a gap of 11 %");
        assert!((face.gap_fraction - 100.0 / 896.0).abs() < 1e-12);
        assert_eq!(select(0.11), Err(NoFace::AllOccluded));
    }

    #[test]
    fn a_corner_that_is_missing_is_not_made_up() {
        let (exposure, region) = rectangle(200.0);
        let three = corners(&[[12.0, 16.0], [43.0, 16.0], [43.0, 51.0]]);
        let selector = LeastOccluded::default();
        assert_eq!(selector.select(&exposure, &region, &three), Err(NoFace::TooFewCorners));
        let other = corners(&[[12.0, 16.0], [43.0, 16.0], [43.0, 51.0], [28.0, 40.0]]);
        assert_eq!(selector.select(&exposure, &region, &other), Err(NoFace::AllOccluded));
    }

    #[test]
    fn the_right_of_a_clockwise_side_is_inside() {
        let side = Line::between(ImagePoint::new(1.0, 2.0), ImagePoint::new(5.0, 2.0));
        assert_eq!(side.coordinates(ImagePoint::new(2.0, 4.5)), (1.0, 2.5));
        assert_eq!(side.point(1.0, 2.5), ImagePoint::new(2.0, 4.5));
    }

    #[test]
    fn a_crossing_is_near_within_one_pixel() {
        // Only the offset 0.5 px: place 7.
        let crossings = Crossings(1 << 7);
        let near: Vec<bool> =
            [-1.0, -0.5, 0.5, 1.5, 2.0].map(|offset| crossings.near(offset)).into();
        assert_eq!(near, [false, true, true, true, false]);
    }

    #[test]
    fn only_the_clockwise_convex_order_has_an_area() {
        let square = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]].map(ImagePoint::from);
        let [a, b, c, d] = square;
        assert_eq!(convex_clockwise_area(&square), Some(12.0));
        assert_eq!(convex_clockwise_area(&[d, c, b, a]), None);
        assert_eq!(convex_clockwise_area(&[a, c, b, d]), None);
        assert_eq!(convex_clockwise_area(&[a, b, b, c]), None);
    }

    #[test]
    fn a_parameter_out_of_range_is_named() {
        let table = "max_gap_fraction = 0.0".parse().expect("valid TOML");
        let error = (ENTRY.build)("plan.toml", &table).err().expect("out of range");
        let expected = "plan.toml: max_gap_fraction is 0, must be in 0.001..=1.0";
        assert_eq!(error.to_string(), expected);
    }
}
