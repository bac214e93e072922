//! Corners where straight segments of edges meet, and of what type they are.
//!
//! ```text
//! # Method      Contours of edge points (contours.rs) steeper than `least_steepness` are cut into segments
//!               as by EDLines: of the points of a contour the first n whose line leaves none of them
//!               farther than `fit_error_px`, n the fewest that can be meaningful, lengthened point by
//!               point while the next one is that near to the line of all before. A segment of n points,
//!               k of them with a gradient within 22.5 deg of its normal, is kept if its number of false
//!               alarms, (W H)^2 times the binomial tail B(n, k, 1/8), is 1 or less. Its line is fitted
//!               to its points but for the bends at its ends.
//!               An end and another segment meet where their lines intersect, at `least_angle_deg` or
//!               more, if that is within `gap_px` of the end and of the segment. Ends that meet each
//!               other, and what they meet, are one junction: the point of least squared distances from
//!               the lines, each weighted by its points. Edges leave it along each segment that ends there,
//!               and both ways along one that goes on. Two: L. Three: T if two of them are in line to
//!               `collinear_deg`, arrow if all are within half a turn, else Y. Four, two and two in line: X.
//!               Others have no type.
//! # Input       the channel as encoded [DN].
//! # Parameters  channel          none, luma     luma, red, red_difference
//!               sigma            px, 1          range [0.5, 8]: Gaussian before the gradient
//!               least_steepness  DN/px, 3.5     range [0, 255]: of 8 bit; that of a step of 10 DN, about
//!                                               LSD's weakest
//!               fit_error_px     px, 0.5        range [0.05, 4]
//!               gap_px           px, 5          range [0, 64]
//!               least_angle_deg  deg, 15        range [1, 90]: edges that leave nearer to each other are one
//!               collinear_deg    deg, 10        range [0, 45]
//!               keep_t           none, false    whether T-junctions, mostly one thing before another,
//!                                               are corners
//!               those of places (places.rs: the strongest so many, margin around a region)
//! # Output      sub-pixel points with their type, strongest first, equals by row, then column. Response
//!               in DN: length times mean steepness of the second-best of the junction's segments.
//! # Border      contours end 2 px from the edges. Where a region is given, only its bounding range, grown
//!               by the margin and 16 px, is seen: segments are cut there, W and H are that range's.
//! # Cost        O(pixels seen) + O(ends times segments).
//! # Departures  EDLines draws edges by smart routing between anchors, in whole pixels, which depends on
//!               the order of scanning; here the contours are chains of sub-pixel points, so that segments
//!               turn with the image; hence 0.5 px for the error of a fit, for 1 px of whole pixels. Least
//!               squares are of distances, not along one axis; the error of a first fit is the largest
//!               distance. Alignment is counted at the contour's points, with the gradient of the smoothed
//!               image. A closed contour begins where one of its segments ends.
//!               Segments grow with the brighter side to the right: in a mirror from the other end, so that
//!               places differ by up to some hundredths of a pixel.
//! # Source      Segments: Akinlar & Topal, Pattern Recognition Letters 32(13), 2011, sections 2.2, 2.3;
//!               validation: Desolneux, Moisan & Morel, International Journal of Computer Vision 40(1),
//!               2000. Junctions by their ends are practice.
//! # Checked by  tests/it/contract.rs (all), tests/it/lines.rs (types and places of drawn junctions, noise
//!               gives none)
//! ```

use std::f64::consts::{FRAC_PI_8, PI};
use std::ops::Range;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::contours::{Contour, EdgePoint, contours};
use crate::detect::line::{Line, Sums, meeting};
use crate::detect::places::Places;
use crate::detect::{Detection, Detector, Scratch, Shade};
use crate::geometry::ImagePoint;
use crate::image::PixelRange;
use crate::junction::Junction;
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;
use crate::target::TargetRegion;

/// The registry's line.
pub const ENTRY: Entry<dyn Detector> = Entry {
    name: "line_junctions",
    summary: "line segments, validated, whose ends meet: L, Y, arrow, T, X",
    reference: "Akinlar & Topal 2011, EDLines",
    version: 1,
    defaults: defaults::<LineJunctions>,
    schema: schema::<LineJunctions>,
    build: |place, table| Ok(Box::new(parameters::<LineJunctions>(place, table)?)),
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct LineJunctions {
    /// What edges are sought in.
    pub channel: Shade,
    /// Scale of the edges \[px\].
    #[schemars(range(min = 0.5, max = 8.0))]
    pub sigma: f64,
    /// Gradient of the weakest edge \[DN/px of 8 bit\].
    #[schemars(range(min = 0.0, max = 255.0))]
    pub least_steepness: f64,
    /// How far from its line a segment's points may lie \[px\].
    #[schemars(range(min = 0.05, max = 4.0))]
    pub fit_error_px: f64,
    /// How far a segment's end may be from where it meets another \[px\].
    #[schemars(range(min = 0.0, max = 64.0))]
    pub gap_px: f64,
    /// The least angle between segments that meet \[deg\].
    #[schemars(range(min = 1.0, max = 90.0))]
    pub least_angle_deg: f64,
    /// How far from straight two edges in line may be \[deg\].
    #[schemars(range(min = 0.0, max = 45.0))]
    pub collinear_deg: f64,
    /// Whether T-junctions are kept.
    pub keep_t: bool,
    /// Which corners are returned.
    #[serde(flatten)]
    pub places: Places,
}

impl Default for LineJunctions {
    fn default() -> Self {
        Self {
            channel: Shade::Luma,
            sigma: 1.0,
            least_steepness: 3.5,
            fit_error_px: 0.5,
            gap_px: 5.0,
            least_angle_deg: 15.0,
            collinear_deg: 10.0,
            keep_t: false,
            places: Places::default(),
        }
    }
}

/// How far beyond a region edges are seen \[px\]: some more than the shortest segment.
const REACH_PX: usize = 16;

/// The probability that a gradient of no edge is within 22.5 deg of a given direction.
const CHANCE: f64 = 0.125;

/// A straight piece of an edge, to fractions of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// From where to where; what is brighter lies to the right, as seen.
    pub ends: [ImagePoint; 2],
    /// Mean gradient \[DN/px\].
    pub steepness: f64,
    /// Points of the edge that it was fitted to.
    pub points: usize,
    line: Line,
}

impl Segment {
    /// The direction from end 0 or 1 into the segment.
    fn inwards(&self, end: usize) -> [f64; 2] {
        self.line.direction.map(|d| if end == 0 { d } else { -d })
    }

    /// Length times steepness \[DN\].
    fn support(&self) -> f64 {
        self.ends[0].distance_px(self.ends[1]) * self.steepness
    }
}

impl Detector for LineJunctions {
    fn detect_into(
        &self,
        exposure: &Exposure,
        region: Option<&TargetRegion>,
        _: &mut Scratch,
        found: &mut Vec<Detection>,
    ) {
        found.clear();
        let Some(window) = self.places.window(exposure, region, REACH_PX) else { return };
        self.junctions(&self.segments_in(exposure, window), found);
        self.places.keep(exposure, region, found);
    }
}

// ---- Segments -----------------------------------------------------------------------------------------------

impl LineJunctions {
    /// The segments of the whole image.
    pub fn segments(&self, exposure: &Exposure) -> Vec<Segment> {
        let window = PixelRange { x0: 0, y0: 0, x1: exposure.width(), y1: exposure.height() };
        self.segments_in(exposure, window)
    }

    fn segments_in(&self, exposure: &Exposure, window: PixelRange) -> Vec<Segment> {
        let least = self.least_steepness * exposure.encoding().full_scale_dn() / 255.0;
        let plane = self.channel.plane(exposure);
        let tests = 2.0 * ((window.width() * window.height()).max(1) as f64).ln();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some tens")]
        let fewest = (-tests / CHANCE.ln()).ceil().max(3.0) as usize;
        let mut found = Vec::new();
        for Contour { mut points, closed } in contours(plane, window, self.sigma, |_| [least; 2]) {
            let mut pieces = self.pieces(&points, fewest);
            if let (true, Some(first)) = (closed, pieces.first()) {
                let count = points.len();
                points.rotate_left(first.end % count);
                pieces = self.pieces(&points, fewest);
            }
            let segments = pieces.into_iter().map(|piece| self.segment(&points[piece]));
            let is_meaningful = |(segment, aligned): &(Segment, usize)| {
                ln_binomial_tail(segment.points, *aligned, CHANCE) + tests <= 0.0
            };
            found.extend(segments.filter(is_meaningful).map(|(segment, _)| segment));
        }
        found
    }

    /// The straight pieces of a contour, of `fewest` points at least.
    fn pieces(&self, points: &[EdgePoint], fewest: usize) -> Vec<Range<usize>> {
        let mut found = Vec::new();
        let mut first = 0;
        while first + fewest <= points.len() {
            let mut sums = Sums::new(points[first].point);
            let mut end = first + fewest;
            points[first..end].iter().for_each(|point| sums.add(point.point));
            let mut line = sums.line();
            let far =
                |line: &Line, point: &EdgePoint| line.off(point.point).abs() > self.fit_error_px;
            if points[first..end].iter().any(|point| far(&line, point)) {
                first += 1;
                continue;
            }
            while end < points.len() && !far(&line, &points[end]) {
                sums.add(points[end].point);
                line = sums.line();
                end += 1;
            }
            found.push(first..end);
            first = end;
        }
        found
    }

    /// The segment of a straight piece, and how many of its points are aligned.
    fn segment(&self, points: &[EdgePoint]) -> (Segment, usize) {
        let count = points.len();
        // Blur rounds the ends, where there is a corner.
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a small number"
        )]
        let bend = ((3.0 * (self.sigma * self.sigma + 0.5).sqrt()).ceil() as usize).min(count / 4);
        let straight = &points[bend..count - bend];
        let mut line = Line::through(straight.iter().map(|point| point.point));
        let [first, last] = [points[0].point, points[count - 1].point];
        if line.along(last) < line.along(first) {
            line.direction = line.direction.map(|d| -d);
        }
        let normal = [-line.direction[1], line.direction[0]];
        let aligned = |point: &&EdgePoint| {
            point.rise[0] * normal[0] + point.rise[1] * normal[1] >= FRAC_PI_8.cos()
        };
        let steepness = straight.iter().map(|p| p.steepness).sum::<f64>() / straight.len() as f64;
        let ends = [first, last].map(|point| line.at(line.along(point)));
        let segment = Segment { ends, steepness, points: count, line };
        (segment, points.iter().filter(aligned).count())
    }
}

/// The logarithm of the probability that of `count` trials `least` or more succeed, each by `chance`.
fn ln_binomial_tail(count: usize, least: usize, chance: f64) -> f64 {
    if least == 0 {
        return 0.0;
    }
    let ln_factorial = |n: usize| libm::lgamma(n as f64 + 1.0);
    let first = ln_factorial(count) - ln_factorial(least) - ln_factorial(count - least)
        + least as f64 * chance.ln()
        + (count - least) as f64 * (1.0 - chance).ln();
    // Each further term is a share of the one before.
    let (mut term, mut sum) = (1.0, 1.0);
    for k in least..count {
        term *= (count - k) as f64 / (k + 1) as f64 * chance / (1.0 - chance);
        sum += term;
    }
    first + f64::ln(sum)
}

// ---- Junctions ----------------------------------------------------------------------------------------------

impl LineJunctions {
    /// Adds the junctions of segments.
    fn junctions(&self, segments: &[Segment], found: &mut Vec<Detection>) {
        // End 2 i is where segment i begins, 2 i + 1 where it ends.
        let mut junction_of: Vec<usize> = (0..2 * segments.len()).collect();
        // An end, and the segment that goes on where it meets it.
        let mut stops = Vec::new();
        let mut meets = vec![false; junction_of.len()];
        for end in 0..junction_of.len() {
            let own = &segments[end / 2];
            for (other, segment) in segments.iter().enumerate().filter(|(i, _)| *i != end / 2) {
                match self.meet(own, end % 2, segment) {
                    Some(Met::End(far)) => {
                        let (a, b) = (root(&junction_of, end), root(&junction_of, 2 * other + far));
                        junction_of[a.max(b)] = a.min(b);
                        meets[end] = true;
                        meets[2 * other + far] = true;
                    }
                    Some(Met::Side) => {
                        stops.push((end, other));
                        meets[end] = true;
                    }
                    None => {}
                }
            }
        }
        let mut members: Vec<Vec<usize>> = vec![Vec::new(); junction_of.len()];
        for end in (0..junction_of.len()).filter(|&end| meets[end]) {
            members[root(&junction_of, end)].push(end);
        }
        for ends in members.iter().filter(|ends| !ends.is_empty()) {
            let mut passing: Vec<usize> = stops
                .iter()
                .filter(|(end, _)| ends.contains(end))
                .map(|(_, other)| *other)
                .collect();
            passing.sort_unstable();
            passing.dedup();
            passing.retain(|other| ends.iter().all(|end| end / 2 != *other));
            found.extend(self.junction(segments, ends, &passing));
        }
    }

    /// Where an end of a segment meets another one.
    fn meet(&self, own: &Segment, end: usize, other: &Segment) -> Option<Met> {
        if own.line.sine(&other.line).abs() < self.least_angle_deg.to_radians().sin() {
            return None;
        }
        let point = own.line.intersection(&other.line)?;
        if point.distance_px(own.ends[end]) > self.gap_px {
            return None;
        }
        let [to_first, to_last] = other.ends.map(|end| end.distance_px(point));
        if to_first.min(to_last) <= self.gap_px {
            return Some(Met::End(usize::from(to_last < to_first)));
        }
        let length = other.ends[0].distance_px(other.ends[1]);
        (to_first < length && to_last < length).then_some(Met::Side)
    }

    /// The junction of ends, and of segments that pass them.
    fn junction(
        &self,
        segments: &[Segment],
        ends: &[usize],
        passing: &[usize],
    ) -> Option<Detection> {
        let all = || ends.iter().map(|end| end / 2).chain(passing.iter().copied());
        let point = meeting(all().map(|i| (segments[i].line, segments[i].points as f64)))?;
        let mut edges: Vec<f64> = ends
            .iter()
            .map(|end| segments[end / 2].inwards(end % 2))
            .chain(passing.iter().flat_map(|&i| [0, 1].map(|end| segments[i].inwards(end))))
            .map(|[x, y]| y.atan2(x))
            .collect();
        self.merge(&mut edges);
        let junction = self.kind(&edges)?;
        if junction == Kind::Typed(Junction::T) && !self.keep_t {
            return None;
        }
        let mut supports: Vec<f64> = all().map(|i| segments[i].support()).collect();
        supports.sort_by(f64::total_cmp);
        let response = supports[supports.len().checked_sub(2)?];
        let junction = match junction {
            Kind::Typed(junction) => Some(junction),
            Kind::Other => None,
        };
        Some(Detection { point, response, junction })
    }

    /// Makes one of edges that leave nearly in the same direction; ascending \[rad\].
    fn merge(&self, edges: &mut Vec<f64>) {
        edges.sort_by(f64::total_cmp);
        let least = self.least_angle_deg.to_radians();
        let mut merged: Vec<f64> = Vec::new();
        for &edge in edges.iter() {
            if merged.iter().all(|other| apart(*other, edge) >= least) {
                merged.push(edge);
            }
        }
        *edges = merged;
    }

    /// What edges in these directions make, ascending \[rad\]; `None` of one straight edge.
    fn kind(&self, edges: &[f64]) -> Option<Kind> {
        let straight = PI - self.collinear_deg.to_radians();
        let in_line = |i: usize, j: usize| apart(edges[i], edges[j]) >= straight;
        let typed = |junction| Some(Kind::Typed(junction));
        match edges.len() {
            0 | 1 => None,
            2 if in_line(0, 1) => None,
            2 => typed(Junction::L),
            3 if in_line(0, 1) || in_line(1, 2) || in_line(0, 2) => typed(Junction::T),
            3 => {
                let widest = (0..3)
                    .map(|i| (edges[(i + 1) % 3] - edges[i]).rem_euclid(2.0 * PI))
                    .fold(0.0, f64::max);
                typed(if widest > PI { Junction::Arrow } else { Junction::Y })
            }
            4 if in_line(0, 2) && in_line(1, 3) => typed(Junction::X),
            _ => Some(Kind::Other),
        }
    }
}

/// What an end meets of another segment.
enum Met {
    /// Its end 0 or 1.
    End(usize),
    /// What lies between.
    Side,
}

/// A junction of a type, or of none of them.
#[derive(PartialEq)]
enum Kind {
    Typed(Junction),
    Other,
}

/// The angle between two directions, half a turn at most \[rad\].
fn apart(a: f64, b: f64) -> f64 {
    let turn = (a - b).rem_euclid(2.0 * PI);
    turn.min(2.0 * PI - turn)
}

/// The first of the ends that are one junction with this one.
fn root(junction_of: &[usize], mut end: usize) -> usize {
    while junction_of[end] != end {
        end = junction_of[end];
    }
    end
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_binomial_tail_is_the_sum_of_its_terms() {
        for (count, least) in [(10_u32, 0_u32), (10, 1), (10, 7), (10, 10), (60, 20)] {
            let choose =
                |k: u32| (1..=k).fold(1.0, |c, i| c * f64::from(count - k + i) / f64::from(i));
            let term = |k: u32| {
                choose(k) * CHANCE.powf(f64::from(k)) * (1.0 - CHANCE).powf(f64::from(count - k))
            };
            let wanted: f64 = (least..=count).map(term).sum();
            let found = ln_binomial_tail(count as usize, least as usize, CHANCE).exp();
            assert!((found / wanted - 1.0).abs() < 1e-9, "{count} {least}: {found} {wanted}");
        }
    }

    #[test]
    fn a_junction_lies_nearer_to_lines_of_more_points() {
        let segment = |degrees: f64, off_px: f64, points: usize| {
            let (sine, cosine) = degrees.to_radians().sin_cos();
            let point = ImagePoint::new(-off_px * sine, off_px * cosine);
            let line = Line { point, direction: [cosine, sine] };
            Segment { ends: [line.at(1.0), line.at(40.0)], steepness: 10.0, points, line }
        };
        let segments = [segment(0.0, 0.0, 900), segment(120.0, 0.0, 900), segment(240.0, 1.0, 9)];
        let found = LineJunctions::default().junction(&segments, &[0, 2, 4], &[]).expect("a Y");
        assert_eq!(found.junction, Some(Junction::Y));
        let off_px = found.point.distance_px(ImagePoint::new(0.0, 0.0));
        assert!(off_px > 0.0 && off_px < 0.05, "{off_px}");
    }

    #[test]
    fn edges_that_leave_a_point_have_a_type() {
        let detector = LineJunctions::default();
        let kind = |degrees: &[f64]| {
            let mut edges: Vec<f64> = degrees.iter().map(|d| d.to_radians()).collect();
            detector.merge(&mut edges);
            match detector.kind(&edges) {
                Some(Kind::Typed(junction)) => junction.name(),
                Some(Kind::Other) => "other",
                None => "none",
            }
        };
        assert_eq!(kind(&[10.0, 100.0]), "L");
        assert_eq!(kind(&[10.0, -175.0]), "none");
        assert_eq!(kind(&[0.0, 120.0, -120.0]), "Y");
        assert_eq!(kind(&[150.0, -120.0, 20.0]), "Y");
        assert_eq!(kind(&[160.0, -160.0, 130.0]), "arrow");
        assert_eq!(kind(&[0.0, 60.0, -175.0]), "T");
        assert_eq!(kind(&[0.0, 80.0, 178.0, -97.0]), "X");
        assert_eq!(kind(&[0.0, 60.0, 120.0, -120.0]), "other");
        assert_eq!(kind(&[0.0, 5.0, 90.0]), "L"); // Both sides of a thin line are one edge.
    }
}
