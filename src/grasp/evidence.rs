//! What one exposure shows of the target's edges and colour, for face selectors.

use crate::geometry::ImagePoint;
use crate::image::{PixelRange, Plane};
use crate::sensor::Exposure;
use crate::stats;
use crate::target::TargetRegion;

/// How far an edge of the image may lie from the line through two of its corners \[px\].
pub(super) const SEARCH_PX: f64 = 3.0;
/// Corners nearer to each other than this make no side \[px\].
const MIN_SIDE_PX: f64 = 8.0;
/// How far inside its outline a face is looked at for gaps, because corners err \[px\].
const GAP_INSET_PX: f64 = 1.5;
/// Sine of the least angle between adjacent sides.
const MIN_TURN: f64 = 0.26;
/// A pixel is of the target's colour from this share of the mask's mean purity on, ...
const MIN_PURITY: f32 = 0.6;
/// ... and from this share of its mean red on, below which noise makes colours.
const MIN_RED: f32 = 0.15;
/// The outline of an occluder is this many times as strong as an edge has to be: so are the seams
/// of a floor not.
const OUTLINE_STEPS: f64 = 3.0;

/// A directed line segment with its own coordinates: along it, and to its right as seen, which is
/// inwards for a clockwise outline \[px\].
#[derive(Clone, Copy)]
pub(super) struct Line {
    start: ImagePoint,
    pub(super) direction: [f64; 2],
    pub(super) length_px: f64,
}

impl Line {
    /// The segment between two different points.
    pub(super) fn between(start: ImagePoint, end: ImagePoint) -> Self {
        let length_px = start.distance_px(end);
        let direction = [(end.x - start.x) / length_px, (end.y - start.y) / length_px];
        Self { start, direction, length_px }
    }

    pub(super) fn end(&self) -> ImagePoint {
        self.point(self.length_px, 0.0)
    }

    pub(super) fn point(&self, along: f64, right: f64) -> ImagePoint {
        let [x, y] = self.direction;
        ImagePoint::new(self.start.x + along * x - right * y, self.start.y + along * y + right * x)
    }

    /// (along, right) of a point.
    pub(super) fn coordinates(&self, point: ImagePoint) -> (f64, f64) {
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

pub(super) fn sides_of(corners: &[ImagePoint; 4]) -> [Line; 4] {
    let [a, b, c, d] = *corners;
    [Line::between(a, b), Line::between(b, c), Line::between(c, d), Line::between(d, a)]
}

/// The straight edge of the image that joins two corners.
#[derive(Clone, Copy)]
pub(super) struct Side {
    /// Share of it on an edge, in \[0, 1\].
    pub(super) support: f64,
    /// The edge itself, up to [`SEARCH_PX`] from the line through the corners.
    pub(super) line: Line,
}

impl Side {
    /// Whether the way from this side into the `next` turns right, clearly.
    pub(super) fn turns_right_to(&self, next: &Self) -> bool {
        let ([ax, ay], [bx, by]) = (self.line.direction, next.line.direction);
        ax * by - ay * bx >= MIN_TURN
    }

    pub(super) fn reversed(self) -> Self {
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

/// What is known of the target in one exposure, in the part of the image around it.
pub(super) struct Target {
    /// The part of the image; the planes below are its size.
    window: PixelRange,
    /// Smoothed. Blue shows no edge of something red that green does not.
    red: Plane<f32>,
    green: Plane<f32>,
    /// Where the target's colour is, in light or in shade: the mask holds only what is well lit.
    is_coloured: Plane<bool>,
    /// Within [`SEARCH_PX`] of that colour.
    is_near: Plane<bool>,
    /// Of these, the pixels within [`SEARCH_PX`] of an edge.
    may_be_side: Plane<bool>,
    /// How many pixels are of that colour.
    pub(super) pixels: f64,
    /// The smallest step that is an edge \[DN\].
    pub(super) min_step: f64,
    /// The first and the last such pixel in each row: its convex hull's vertices and more.
    extremes: Vec<ImagePoint>,
}

#[allow(clippy::cast_precision_loss, reason = "image coordinates")]
impl Target {
    pub(super) fn new(exposure: &Exposure, region: &TargetRegion, edge_step_fraction: f64) -> Self {
        let window = region.range.grown(20, region.mask.width(), region.mask.height());
        let [red, green, blue] = [0, 1, 2].map(|c| smoothed(&exposure.rgb()[c].crop(window)));
        let mask = region.mask.crop(window);
        let (width, height) = (mask.width(), mask.height());
        // Purity: by how much red exceeds green and blue, as a share of red.
        let purity = |x: usize, y: usize| {
            (red.at(x, y) - green.at(x, y).max(blue.at(x, y))) / red.at(x, y).max(1e-6)
        };
        let mean = |value: &dyn Fn(usize, usize) -> f32| {
            let (mut sum, mut count) = (0.0, 0.0);
            for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
                if mask.at(x, y) {
                    sum += f64::from(value(x, y));
                    count += 1.0;
                }
            }
            sum / f64::max(count, 1.0)
        };
        let (mean_purity, mean_red) = (mean(&purity), mean(&|x, y| red.at(x, y)));
        #[allow(clippy::cast_possible_truncation, reason = "samples are f32")]
        let (least_purity, least_red) =
            (MIN_PURITY * mean_purity as f32, MIN_RED * mean_red as f32);
        let is_coloured = Plane::from_fn(width, height, |x, y| {
            red.at(x, y) > least_red && purity(x, y) > least_purity
        });

        let min_step = edge_step_fraction * mean_red;
        let is_edge = Plane::from_fn(width, height, |x, y| {
            let (x, y) = (x.cast_signed(), y.cast_signed());
            [&red, &green].iter().any(|channel| {
                let at = |dx, dy| channel.at_replicated(x + dx, y + dy);
                let (dx, dy) = (at(1, 0) - at(-1, 0), at(0, 1) - at(0, -1));
                f64::from(dx.hypot(dy)) >= 0.9 * min_step
            })
        });
        let is_near = grown(&is_coloured);
        let is_near_edge = grown(&is_edge);
        let may_be_side =
            Plane::from_fn(width, height, |x, y| is_near.at(x, y) && is_near_edge.at(x, y));

        let (mut pixels, mut extremes) = (0.0, Vec::new());
        for y in 0..height {
            let row = is_coloured.row(y);
            pixels += row.iter().filter(|&&coloured| coloured).count() as f64;
            let ends = [row.iter().position(|&c| c), row.iter().rposition(|&c| c)];
            let at = |x| ImagePoint::new((window.x0 + x) as f64, (window.y0 + y) as f64);
            extremes.extend(ends.into_iter().flatten().map(at));
        }
        Self { window, red, green, is_coloured, is_near, may_be_side, pixels, min_step, extremes }
    }

    /// The pixel of the window at `point`.
    fn pixel(&self, point: ImagePoint) -> Option<(usize, usize)> {
        covers(self.window, point).then(|| {
            let (x, y) = pixel_of(point);
            (x - self.window.x0, y - self.window.y0)
        })
    }

    /// Whether the target's colour is within [`SEARCH_PX`] of `point`.
    pub(super) fn is_near(&self, point: ImagePoint) -> bool {
        self.pixel(point).is_some_and(|(x, y)| self.is_near.at(x, y))
    }

    /// Whether `point` has the target's colour.
    fn is_coloured(&self, point: ImagePoint) -> bool {
        self.pixel(point).is_some_and(|(x, y)| self.is_coloured.at(x, y))
    }

    /// Where edges of at least `min_step` cross the normal of `line` at `along`: local maxima of
    /// the step over 2 px.
    fn crossings(&self, line: &Line, along: f64, min_step: f64) -> Crossings {
        const STEPS: usize = Crossings::LAST + 3;
        let mut steps = [0.0_f64; STEPS];
        for channel in [&self.red, &self.green] {
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
            step >= min_step && step > 0.0 && step >= steps[*n] && step >= steps[n + 2]
        };
        Crossings((0..=Crossings::LAST).filter(is_edge).fold(0, |set, n| set | 1 << n))
    }

    /// The straight edge that joins two corners, when enough of it shows.
    pub(super) fn side(&self, a: ImagePoint, b: ImagePoint, min_support: f64) -> Option<Side> {
        if a.distance_px(b) < MIN_SIDE_PX {
            return None;
        }
        let chord = Line::between(a, b);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let count = (chord.length_px / 3.0).clamp(6.0, 20.0) as u32;
        let mut missing_allowed = (1.0 - min_support) * f64::from(count);
        let may_be_side = |&along: &f64| {
            let pixel = self.pixel(chord.point(along, 0.0));
            pixel.is_some_and(|(x, y)| self.may_be_side.at(x, y))
        };
        if (chord.spread(count).filter(may_be_side).count() as f64)
            < f64::from(count) - missing_allowed - 1e-9
        {
            return None;
        }
        let mut samples = Vec::with_capacity(count as usize);
        for along in chord.spread(count) {
            let crossings = self.crossings(&chord, along, self.min_step);
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
    pub(super) fn runs_on(&self, line: &Line) -> bool {
        const SAMPLES: u32 = 8;
        let reach = (0.5 * line.length_px).clamp(8.0, 14.0) - 4.0;
        let on = (0..SAMPLES).filter(|&i| {
            let along = line.length_px + 4.0 + reach * f64::from(i) / f64::from(SAMPLES - 1);
            [-2.5, 2.5].iter().all(|&right| !self.is_coloured(line.point(along, right)))
                && self.crossings(line, along, OUTLINE_STEPS * self.min_step).near(0.0)
        });
        on.count() >= 6
    }

    /// Whether some of the target lies beyond a side that has none next to it. The image of a
    /// cuboid is convex, so such a side is an occluder's. Tolerance grows with the distance from
    /// the side, for its direction errs as its ends do.
    pub(super) fn lies_beyond(&self, side: &Line) -> bool {
        let outside = |&along: &f64| !self.is_coloured(side.point(along, -SEARCH_PX));
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
    pub(super) fn gap_fraction(&self, corners: &[ImagePoint; 4]) -> Option<f64> {
        let sides = sides_of(corners);
        let (mut inside, mut coloured) = (0, 0);
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
                let row = &self.is_coloured.row(y - self.window.y0)
                    [first - self.window.x0..=last - self.window.x0];
                coloured += row.iter().filter(|&&coloured| coloured).count();
            }
        }
        (inside > 0).then(|| 1.0 - coloured as f64 / inside as f64)
    }

    /// The largest step of brightness across the outline, in either direction \[DN\].
    pub(super) fn largest_step(&self, &[a, b, c, d]: &[ImagePoint; 4]) -> f64 {
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
                        let red = f64::from(self.red.at(x, y));
                        self.is_coloured.at(x, y).then_some(red)
                    })
                    .collect();
                if red.len() >= 8 { stats::median(&red) } else { None }
            })
            .collect();
        let steps: Vec<f64> =
            profile.windows(4).map(|w| 0.5 * (w[3] + w[2] - w[1] - w[0])).collect();
        let slope = stats::median(&steps).unwrap_or(0.0);
        steps.iter().map(|step| (step - slope).abs()).fold(0.0, f64::max)
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

/// The mask and all within [`SEARCH_PX`] of it along x and y.
fn grown(mask: &Plane<bool>) -> Plane<bool> {
    const REACH: usize = 3;
    let (width, height) = (mask.width(), mask.height());
    let span = |at: usize, size: usize| at.saturating_sub(REACH)..(at + REACH + 1).min(size);
    let wide = Plane::from_fn(width, height, |x, y| {
        mask.row(y)[span(x, width)].iter().any(|&inside| inside)
    });
    Plane::from_fn(width, height, |x, y| span(y, height).any(|y| wide.at(x, y)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_right_of_a_clockwise_side_is_inside() {
        let side = Line::between(ImagePoint::new(1.0, 2.0), ImagePoint::new(5.0, 2.0));
        let (along, right) = side.coordinates(ImagePoint::new(2.0, 4.5));
        assert!((along - 1.0).abs() < 1e-12 && (right - 2.5).abs() < 1e-12);
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
}
