//! Corners of a red region's outline: polygon, sub-pixel edges, lines, their intersections.
//!
//! ```text
//! # Method      The region's outline runs between its pixels and the others. Douglas & Peucker's polygon
//!               of it, begun at the point farthest from the centroid and the one farthest from that, tells
//!               its sides. Each side's line is fitted (total least squares) to the outline's points, then
//!               to edgels: every pixel along it, the place within `reach_px` along its normal where the
//!               channel's slope inwards, a Gaussian derivative of `sigma`, is largest, by a parabola of
//!               its logarithms (exact of a blurred step); outliers trimmed. Neighbouring lines intersect
//!               in the corner; it is the polygon's vertex where the lines make less than
//!               `least_angle_deg`, or meet more than `farthest_px` from the vertex.
//! # Input       red difference as encoded [DN] for edgels; the mask of the region given, its largest
//!               connected part, or else what the extractor red_difference finds by its defaults.
//! # Parameters  epsilon_share    none, 0.015   range (0, 0.2]: of the outline's length, the farthest
//!                                              that it may leave the polygon's side; not below 1 px
//!               sigma            px, 1         range [0.5, 8]
//!               reach_px         px, 2         range [1, 16]
//!               least_angle_deg  deg, 10       range [1, 90]
//!               farthest_px      px, 5         range [0, 64]
//!               those of places (places.rs: the strongest so many, margin around a region)
//! # Output      vertices of the silhouette, sub-pixel, strongest first, equals by row, then column; no
//!               other corner of a box. Response in DN/px: the sine of the angle between the sides times
//!               the mean slope of the weaker one. No corner where a side has no edge: fewer than 4 edgels.
//! # Border      the channel continues outwards as its border pixels; a side along the image's border has
//!               no slope.
//! # Cost        O(pixels of the region) + (outline's length) (2 reach_px / 0.5 + 1) (10 sigma)^2.
//! # Departures  OpenCV users have cv2.findContours, whose points are the region's outermost pixels, half
//!               a pixel inside, and cv2.approxPolyDP, which begins where the contour does: neither turns
//!               with the image. Vertices without which the outline stays within epsilon are dropped: a
//!               side parallel to a chord that was cut may gain one anywhere. Fewer edgels than 8 are not
//!               trimmed. Of an edge without blur along the rows the steepest place is up to 0.04 px off.
//! # Source      Practice rather than a paper: Douglas & Peucker, Cartographica 10(2), 1973; edges along
//!               the normal as Devernay 1995, INRIA RR-2724, lines and intersections as in AprilTag 3.
//! # Checked by  tests/it/contract.rs (all), tests/it/lines.rs (corners of drawn polygons to 0.1 px,
//!               short sides, the image's border)
//! ```

use geo::{LineString, SimplifyIdx};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::contours::summit;
use crate::detect::line::Line;
use crate::detect::places::Places;
use crate::detect::{Detection, Detector, Scratch};
use crate::geometry::ImagePoint;
use crate::image::Plane;
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;
use crate::stats::median;
use crate::target::red_difference::RedDifference;
use crate::target::{TargetExtractor, TargetRegion, largest_region};

/// The registry's line.
pub const ENTRY: Entry<dyn Detector> = Entry {
    name: "red_polygon",
    summary: "red region, its polygon, sub-pixel lines along its sides, their intersections",
    reference: "Douglas & Peucker 1973; practice",
    version: 1,
    defaults: defaults::<RedPolygon>,
    schema: schema::<RedPolygon>,
    build: |place, table| Ok(Box::new(parameters::<RedPolygon>(place, table)?)),
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct RedPolygon {
    /// How far the outline may leave the polygon's sides, as a share of its length.
    #[schemars(range(max = 0.2), extend("exclusiveMinimum" = 0.0))]
    pub epsilon_share: f64,
    /// Scale of the slope \[px\].
    #[schemars(range(min = 0.5, max = 8.0))]
    pub sigma: f64,
    /// How far from a side its edge is sought \[px\].
    #[schemars(range(min = 1.0, max = 16.0))]
    pub reach_px: f64,
    /// The least angle of lines that intersect \[deg\].
    #[schemars(range(min = 1.0, max = 90.0))]
    pub least_angle_deg: f64,
    /// How far from the polygon's vertex lines may intersect \[px\].
    #[schemars(range(min = 0.0, max = 64.0))]
    pub farthest_px: f64,
    /// Which corners are returned.
    #[serde(flatten)]
    pub places: Places,
}

impl Default for RedPolygon {
    fn default() -> Self {
        Self {
            epsilon_share: 0.015,
            sigma: 1.0,
            reach_px: 2.0,
            least_angle_deg: 10.0,
            farthest_px: 5.0,
            places: Places::default(),
        }
    }
}

/// How finely an edge is sought along a side's normal \[px\].
const STEP_PX: f64 = 0.5;

/// Edgels that make a line, and those of which outliers are trimmed.
const FEWEST: usize = 4;
const FEWEST_TRIMMED: usize = 8;

impl Detector for RedPolygon {
    fn detect_into(
        &self,
        exposure: &Exposure,
        region: Option<&TargetRegion>,
        _: &mut Scratch,
        found: &mut Vec<Detection>,
    ) {
        found.clear();
        if self.places.window(exposure, region, 0).is_none() {
            return;
        }
        let mask = match region {
            Some(region) => largest_region(&region.mask),
            None => RedDifference::default().extract(exposure).ok().map(|region| region.mask),
        };
        let Some(outline) = mask.as_ref().and_then(outline) else { return };
        let length: f64 = (0..outline.len())
            .map(|i| outline[i].distance_px(outline[(i + 1) % outline.len()]))
            .sum();
        let vertices = polygon(&outline, (self.epsilon_share * length).max(1.0));
        let sides: Vec<Side> = (0..vertices.len())
            .map(|i| {
                let (from, to) = (vertices[i], vertices[(i + 1) % vertices.len()]);
                self.side(exposure.red_difference(), &outline, from, to)
            })
            .collect();
        for (i, side) in sides.iter().enumerate() {
            let before = &sides[(i + sides.len() - 1) % sides.len()];
            let vertex = outline[vertices[i]];
            let sine = before.line.sine(&side.line).abs();
            let meet = sine >= self.least_angle_deg.to_radians().sin();
            let corner = before
                .line
                .intersection(&side.line)
                .filter(|point| meet && point.distance_px(vertex) <= self.farthest_px)
                .unwrap_or(vertex);
            found.push(Detection::new(corner, sine * before.slope.min(side.slope)));
        }
        self.places.keep(exposure, region, found);
    }
}

/// A side of the polygon.
struct Side {
    line: Line,
    /// Mean slope inwards \[DN/px\]; 0 where there is no edge.
    slope: f64,
}

impl RedPolygon {
    /// The side along the outline from one point to another.
    fn side(&self, channel: &Plane<f32>, outline: &[ImagePoint], from: usize, to: usize) -> Side {
        let steps = (to + outline.len() - from) % outline.len();
        let points: Vec<ImagePoint> =
            (0..=steps).map(|k| outline[(from + k) % outline.len()]).collect();
        // The bends at both ends, rounded by blur and slope, are left out; of a short side a third each.
        let bend_px = 3.0 * (self.sigma * self.sigma + 0.5).sqrt();
        let skipped = |length: f64| bend_px.min(length / 3.0);
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a small number"
        )]
        let left_out = skipped(steps as f64) as usize;
        let rough = Line::through(points[left_out..points.len() - left_out].iter().copied());
        let (start, end) = (rough.along(points[0]), rough.along(points[steps]));
        let skip = skipped((end - start).abs()).copysign(end - start);
        let (start, length) = (start + skip, end - start - 2.0 * skip);
        // Clockwise, inside is on the right.
        let inwards = [-rough.direction[1], rough.direction[0]].map(|n| n * length.signum());
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a small number"
        )]
        let count = (length.abs().ceil() as usize).max(FEWEST);
        let edgels: Vec<(ImagePoint, f64)> = (0..count)
            .filter_map(|k| {
                let along = start + (k as f64 + 0.5) / count as f64 * length;
                self.edgel(channel, rough.at(along), inwards)
            })
            .collect();
        if edgels.len() < FEWEST {
            return Side { line: rough, slope: 0.0 };
        }
        let slope = edgels.iter().map(|(_, slope)| slope).sum::<f64>() / edgels.len() as f64;
        let mut points: Vec<ImagePoint> = edgels.into_iter().map(|(point, _)| point).collect();
        let mut line = Line::through(points.iter().copied());
        // Outliers: farther than three standard deviations, told by the median; a tenth of a pixel is none.
        while points.len() >= FEWEST_TRIMMED {
            let off: Vec<f64> = points.iter().map(|point| line.off(*point).abs()).collect();
            let limit = median(&off).map_or(0.1, |off| (3.0 * 1.4826 * off).max(0.1));
            let before = points.len();
            points.retain(|point| line.off(*point).abs() <= limit);
            if points.len() == before {
                break;
            }
            line = Line::through(points.iter().copied());
        }
        Side { line, slope }
    }

    /// The edge nearest to a place along a side's normal: where the channel rises most steeply, and how.
    fn edgel(
        &self,
        channel: &Plane<f32>,
        place: ImagePoint,
        inwards: [f64; 2],
    ) -> Option<(ImagePoint, f64)> {
        let at = |offset: f64| {
            ImagePoint::new(place.x + offset * inwards[0], place.y + offset * inwards[1])
        };
        #[allow(clippy::cast_possible_truncation, reason = "a small number")]
        let steps = (self.reach_px / STEP_PX).round() as i32;
        let slopes: Vec<f64> = (-steps..=steps)
            .map(|k| slope(channel, at(f64::from(k) * STEP_PX), inwards, self.sigma))
            .collect();
        let steepest = (1..slopes.len() - 1).max_by(|&i, &j| slopes[i].total_cmp(&slopes[j]))?;
        let [before, here, after] = [steepest - 1, steepest, steepest + 1].map(|i| slopes[i]);
        // Rounding has slopes of its own.
        if here <= 1e-3 || here < before || here < after {
            return None;
        }
        let (offset, height) = summit([before, here, after]);
        Some((at((steepest as f64 - f64::from(steps) + offset) * STEP_PX), height))
    }
}

/// The slope of a plane at a place, along a unit vector \[DN/px\]: the derivative of a Gaussian of `sigma`
/// centred there, between pixels too; 1 on a ramp of 1.
fn slope(plane: &Plane<f32>, place: ImagePoint, along: [f64; 2], sigma: f64) -> f64 {
    // To where the Gaussian's steps are below rounding.
    let reach = 5.0 * sigma;
    let weights = |centre: f64| {
        #[allow(clippy::cast_possible_truncation, reason = "saturates")]
        let (first, last) = ((centre - reach).ceil() as isize, (centre + reach).floor() as isize);
        (first..=last).map(move |i| {
            let offset = i as f64 - centre;
            (i, offset, (-0.5 * (offset / sigma).powi(2)).exp())
        })
    };
    let columns: Vec<_> = weights(place.x).collect();
    let (mut sums, mut total) = ([0.0; 2], 0.0);
    for (y, dy, down) in weights(place.y) {
        for &(x, dx, across) in &columns {
            let weight = down * across;
            let value = f64::from(plane.at_replicated(x, y)) * weight;
            sums[0] += value * dx;
            sums[1] += value * dy;
            total += weight;
        }
    }
    (sums[0] * along[0] + sums[1] * along[1]) / (total * sigma * sigma)
}

// ---- Outline and polygon ------------------------------------------------------------------------------------

/// The outer outline of a mask's first region, clockwise as seen: the middles of the borders between its
/// pixels and the others. Pixels that touch by a corner are of one region.
fn outline(mask: &Plane<bool>) -> Option<Vec<ImagePoint>> {
    let start = mask.samples().iter().position(|&inside| inside)?;
    let [left, top] = [start % mask.width(), start / mask.width()].map(usize::cast_signed);
    // A pixel is named by its top left corner; from corner (x, y) the walk goes to (x + dx, y + dy).
    let inside = |x: isize, y: isize| {
        x >= 0
            && y >= 0
            && x < mask.width().cast_signed()
            && y < mask.height().cast_signed()
            && mask.at(x.unsigned_abs(), y.unsigned_abs())
    };
    let (mut x, mut y, mut dx, mut dy) = (left, top, 1, 0);
    let mut points = Vec::new();
    loop {
        points.push(ImagePoint::new(
            x as f64 + 0.5 * dx as f64 - 0.5,
            y as f64 + 0.5 * dy as f64 - 0.5,
        ));
        (x, y) = (x + dx, y + dy);
        // The pixels ahead, on the left and on the right of the walk.
        let pixel = |side_x: isize, side_y: isize| {
            inside(x + (dx + side_x - 1) / 2, y + (dy + side_y - 1) / 2)
        };
        if pixel(dy, -dx) {
            (dx, dy) = (dy, -dx);
        } else if !pixel(-dy, dx) {
            (dx, dy) = (-dy, dx);
        }
        if (x, y, dx, dy) == (left, top, 1, 0) {
            return Some(points);
        }
    }
}

/// Which points of a closed outline are the vertices of Douglas & Peucker's polygon; two or more.
fn polygon(outline: &[ImagePoint], epsilon_px: f64) -> Vec<usize> {
    let count = outline.len();
    let mean = |coordinate: fn(&ImagePoint) -> f64| {
        outline.iter().map(coordinate).sum::<f64>() / count as f64
    };
    let farthest = |from: ImagePoint| {
        let distance = |i: &usize| outline[*i].distance_px(from);
        (0..count).max_by(|i, j| distance(i).total_cmp(&distance(j))).unwrap_or(0)
    };
    let first = farthest(ImagePoint::new(mean(|p| p.x), mean(|p| p.y)));
    let second = farthest(outline[first]);
    let half = |from: usize, to: usize| {
        let steps = (to + count - from) % count;
        let points = (0..=steps).map(|k| outline[(from + k) % count]);
        let half: LineString<f64> = points.map(|point| (point.x, point.y)).collect();
        let mut vertices = half.simplify_idx(epsilon_px);
        vertices.pop(); // The other half's first.
        vertices.into_iter().map(move |k| (from + k) % count)
    };
    let mut vertices: Vec<usize> = half(first, second).chain(half(second, first)).collect();
    // Where a side is parallel to one that was cut, any of its points may have become a vertex.
    while vertices.len() > 3 {
        let neighbours =
            |i: usize| [i + vertices.len() - 1, i + 1].map(|i| vertices[i % vertices.len()]);
        let missed = |i: usize| {
            let [from, to] = neighbours(i);
            farthest_off(outline, from, to)
        };
        let least = (0..vertices.len())
            .map(|i| (missed(i), i))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .filter(|(missed, _)| *missed <= epsilon_px);
        let Some((_, needless)) = least else { break };
        vertices.remove(needless);
    }
    vertices
}

/// How far the outline from one of its points to another leaves the line through them \[px\].
fn farthest_off(outline: &[ImagePoint], from: usize, to: usize) -> f64 {
    let steps = (to + outline.len() - from) % outline.len();
    let chord = Line::through([outline[from], outline[to]]);
    let points = (0..=steps).map(|k| outline[(from + k) % outline.len()]);
    points.map(|point| chord.off(point).abs()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(rows: &[&str]) -> Plane<bool> {
        Plane::from_fn(rows[0].len(), rows.len(), |x, y| rows[y].as_bytes()[x] == b'#')
    }

    fn walked(rows: &[&str]) -> Vec<[f64; 2]> {
        outline(&drawn(rows)).expect("not empty").into_iter().map(Into::into).collect()
    }

    #[test]
    fn an_outline_runs_round_the_pixels_clockwise() {
        assert_eq!(
            walked(&["...", ".#.", "..."]),
            [[1.0, 0.5], [1.5, 1.0], [1.0, 1.5], [0.5, 1.0]]
        );
        let expected = [
            [0.0, -0.5],
            [0.5, 0.0],
            [1.0, 0.5],
            [1.5, 1.0],
            [1.0, 1.5],
            [0.5, 1.0],
            [0.0, 0.5],
            [-0.5, 0.0],
        ];
        assert_eq!(walked(&["#.", ".#"]), expected);
        // A hole has no part in it.
        assert_eq!(walked(&["###", "#.#", "###"]).len(), 12);
        assert!(outline(&drawn(&["..."])).is_none());
    }

    #[test]
    fn a_rectangle_s_polygon_is_its_four_corners() {
        let mask = Plane::from_fn(60, 40, |x, y| (5..50).contains(&x) && (8..30).contains(&y));
        let outline = outline(&mask).expect("not empty");
        let vertices = polygon(&outline, 2.0);
        assert_eq!(vertices.len(), 4);
        for [x, y] in [[4.5, 7.5], [49.5, 7.5], [49.5, 29.5], [4.5, 29.5]] {
            let near = |&i: &usize| outline[i].distance_px(ImagePoint::new(x, y)) < 0.8;
            assert!(vertices.iter().any(near), "{x} {y}");
        }
    }

    #[test]
    fn the_slope_of_a_ramp_is_its_own_anywhere() {
        #[allow(clippy::cast_precision_loss, reason = "small numbers")]
        let ramp = Plane::from_fn(30, 30, |x, y| (3 * x) as f32 + (5 * y) as f32);
        for (x, y) in [(14.0, 15.0), (14.3, 15.7), (13.5, 14.5)] {
            let found = slope(&ramp, ImagePoint::new(x, y), [0.6, 0.8], 1.0);
            assert!((found - 5.8).abs() < 1e-3, "{found}");
        }
    }
}
