//! Corners of contours where they bend: He and Yung's detector.
//!
//! ```text
//! # Method      Canny edges are followed as contours, ends nearer than `gap_px` to each other joined. Each
//!               contour (x(i), y(i)) is smoothed by a Gaussian of `sigma_contour` points; its curvature is
//!               k = |x' y'' - x'' y'| / (x'^2 + y'^2)^(3/2). Candidates: maxima of k. A candidate's region
//!               of support reaches to the minima on both sides: round, and dropped, if k < `ratio` times
//!               the mean of k there. From what is left, false corners are dropped until none is found:
//!               those whose angle exceeds `largest_angle_deg`, between the tangents there of circles
//!               through the smoothed contour's points at the candidate, at the next candidate (or end),
//!               and midway, to both sides. Added, if no corner is within 5 px: T-junctions, where an end
//!               comes within `gap_px` of another contour, at that contour; and other ends.
//! # Input       the channel as encoded [DN].
//! # Parameters  channel            none, luma    luma, red, red_difference
//!               sigma              px, 1         range [0.5, 8]: of Canny's Gaussian
//!               low_share          none, 0.1     range [0, 1]: of the image's largest gradient, where a
//!                                                contour's points end; the source has 0
//!               high_share         none, 0.35    range [0, 1]: that some point of each contour reaches
//!               gap_px             px, 4         range [0, 16]: largest gap that is filled
//!               least_share        none, 0.04    range [0, 1]: of the image's width and height together,
//!                                                points of the shortest contour
//!               sigma_contour      points, 3     range [0.5, 16]
//!               ratio              none, 1.5     range [1, 4]: of the axes of an ellipse whose
//!                                                vertices are corners
//!               largest_angle_deg  deg, 162      range [90, 180]
//!               keep_ends          none, true    whether other ends are corners
//!               those of places (places.rs: the strongest so many, margin around a region)
//! # Output      the contour's point, to fractions of a pixel but on the edge's own rounded bend: inside
//!               a sharp vertex. Strongest first, equals by row, then column. Response in DN/px: the turn
//!               (half a turn less the angle) [rad] times the weaker arm's mean steepness; of a T-junction
//!               the angle between its contours, at most a right one, times that of the one that ends; of
//!               an end its steepness.
//! # Border      contours end 2 px from the edges; an end nearer than `gap_px` to that is no corner. Where
//!               a region is given, only its bounding range, grown by the margin and 16 px, is seen.
//! # Cost        O(pixels seen) and O(points of contours times sigma_contour), plus the pairs of ends.
//! # Departures  Contours are chains of sub-pixel points (contours.rs) and not of pixels, so that they
//!               turn with the image. The source rounds curvature up to hundredths; here a maximum stands
//!               0.01/px above the minima beside it. Its program joins pixels within one pixel, and calls a
//!               contour closed whose ends are within 5.7 px; here one gap is for both. Its low threshold
//!               of 0 follows noise.
//! # Source      He & Yung, Optical Engineering 47(5), 057008, 2008, sections 2 and 3.
//! # Checked by  tests/it/contract.rs (all), tests/it/lines.rs (corners of polygons, round shapes,
//!               T-junctions, angles)
//! ```

use std::f64::consts::{FRAC_PI_2, PI};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::contours::{BORDER, Contour, EdgePoint, contours};
use crate::detect::places::Places;
use crate::detect::{Detection, Detector, Scratch, Shade};
use crate::geometry::ImagePoint;
use crate::image::PixelRange;
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;
use crate::target::TargetRegion;

/// The registry's line.
pub const ENTRY: Entry<dyn Detector> = Entry {
    name: "contour_curvature",
    summary: "bends of Canny contours against a threshold of their own: He & Yung",
    reference: "He & Yung 2008",
    version: 1,
    defaults: defaults::<ContourCurvature>,
    schema: schema::<ContourCurvature>,
    build: |place, table| Ok(Box::new(parameters::<ContourCurvature>(place, table)?)),
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct ContourCurvature {
    /// What edges are sought in.
    pub channel: Shade,
    /// Scale of the edges \[px\].
    #[schemars(range(min = 0.5, max = 8.0))]
    pub sigma: f64,
    /// Share of the largest gradient that every point of a contour has.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub low_share: f64,
    /// Share of the largest gradient that some point of a contour has.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub high_share: f64,
    /// The largest gap of a contour that is filled \[px\].
    #[schemars(range(min = 0.0, max = 16.0))]
    pub gap_px: f64,
    /// Points of the shortest contour, as a share of the image's width and height together.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub least_share: f64,
    /// Scale of the curvature, in points of the contour.
    #[schemars(range(min = 0.5, max = 16.0))]
    pub sigma_contour: f64,
    /// By how much a corner's curvature exceeds the mean of its region of support.
    #[schemars(range(min = 1.0, max = 4.0))]
    pub ratio: f64,
    /// The most obtuse corner \[deg\].
    #[schemars(range(min = 90.0, max = 180.0))]
    pub largest_angle_deg: f64,
    /// Whether ends of contours, far from corners and other contours, are corners.
    pub keep_ends: bool,
    /// Which corners are returned.
    #[serde(flatten)]
    pub places: Places,
}

impl Default for ContourCurvature {
    fn default() -> Self {
        Self {
            channel: Shade::Luma,
            sigma: 1.0,
            low_share: 0.1,
            high_share: 0.35,
            gap_px: 4.0,
            least_share: 0.04,
            sigma_contour: 3.0,
            ratio: 1.5,
            largest_angle_deg: 162.0,
            keep_ends: true,
            places: Places::default(),
        }
    }
}

/// How far beyond a region contours are seen \[px\]: some more than what smoothes them.
const REACH_PX: usize = 16;

/// How far an end or a T-junction is from corners \[px\].
const APART_PX: f64 = 5.0;

/// By how much a maximum of curvature exceeds the minima beside it \[1/px\].
const STANDS_OUT: f64 = 0.01;

impl Detector for ContourCurvature {
    fn detect_into(
        &self,
        exposure: &Exposure,
        region: Option<&TargetRegion>,
        _: &mut Scratch,
        found: &mut Vec<Detection>,
    ) {
        found.clear();
        let Some(window) = self.places.window(exposure, region, REACH_PX) else { return };
        let plane = self.channel.plane(exposure);
        let thresholds = |largest: f64| [self.low_share, self.high_share].map(|s| s * largest);
        let mut contours = joined(contours(plane, window, self.sigma, thresholds), self.gap_px);
        let least = self.least_share * (window.width() + window.height()) as f64;
        contours.retain(|contour| contour.points.len() as f64 > least);
        for contour in &contours {
            self.bends(contour, found);
        }
        self.ends(&contours, window, found);
        self.places.keep(exposure, region, found);
    }
}

impl ContourCurvature {
    /// Adds the corners inside a contour.
    fn bends(&self, contour: &Contour, found: &mut Vec<Detection>) {
        let count = contour.points.len();
        if count < 5 {
            return;
        }
        let smooth = smoothed(contour, self.sigma_contour);
        let curvature = curvature(&smooth, contour.closed);
        let mut corners = maxima(&curvature, contour.closed);
        corners.retain(|[before, corner, after]| {
            let support = after - before + 1;
            let sum: f64 = (*before..=*after).map(|i| curvature[i % count]).sum();
            curvature[corner % count] >= self.ratio * sum / support as f64
        });
        let mut corners: Vec<usize> = corners.iter().map(|[_, corner, _]| corner % count).collect();
        corners.sort_unstable();
        let largest = self.largest_angle_deg.to_radians();
        let arms = |corners: &[usize], i: usize| {
            let all = corners.len();
            let [last, first] = if contour.closed {
                [corners[(i + all - 1) % all], corners[(i + 1) % all]]
            } else {
                let before = i.checked_sub(1).map_or(0, |before| corners[before]);
                [before, corners.get(i + 1).copied().unwrap_or(count - 1)]
            };
            // Of a closed contour with one corner both arms lead back to it.
            let length = |steps: usize| if steps == 0 && contour.closed { count } else { steps };
            let back = length((corners[i] + count - last) % count);
            let forth = length((first + count - corners[i]) % count);
            [(back, count - 1), (forth, 1)]
        };
        loop {
            let kept: Vec<usize> = (0..corners.len())
                .filter(|&i| angle(&smooth, corners[i], arms(&corners, i)) <= largest)
                .map(|i| corners[i])
                .collect();
            if kept.len() == corners.len() {
                break;
            }
            corners = kept;
        }
        for (i, &corner) in corners.iter().enumerate() {
            let arms = arms(&corners, i);
            let turn = PI - angle(&smooth, corner, arms);
            let strength = arms.map(|(steps, stride)| {
                let along = (0..=steps).map(|k| contour.points[(corner + k * stride) % count]);
                along.map(|point| point.steepness).sum::<f64>() / (steps + 1) as f64
            });
            let response = turn * strength[0].min(strength[1]);
            found.push(Detection::new(contour.points[corner].point, response));
        }
    }

    /// Adds T-junctions and ends that are far from what was found.
    fn ends(&self, contours: &[Contour], window: PixelRange, found: &mut Vec<Detection>) {
        let mut added: Vec<(Detection, bool)> = Vec::new();
        let margin = BORDER as f64 + self.gap_px;
        let within = |value: f64, first: usize, end: usize| {
            value >= first as f64 + margin && value <= end as f64 - 1.0 - margin
        };
        for (own, contour) in contours.iter().enumerate().filter(|(_, contour)| !contour.closed) {
            let count = contour.points.len();
            for end in [0, count - 1] {
                let from = &contour.points[end];
                if !within(from.point.x, window.x0, window.x1)
                    || !within(from.point.y, window.y0, window.y1)
                {
                    continue;
                }
                // Of its own contour only what comes back from afar.
                let afar = |other: usize, i: usize| {
                    other != own || i.abs_diff(end) as f64 > 4.0 * self.gap_px.max(1.0)
                };
                let near = contours
                    .iter()
                    .enumerate()
                    .flat_map(|(other, contour)| {
                        let points = contour.points.iter().enumerate();
                        points.filter(move |(i, _)| afar(other, *i)).map(|(_, point)| point)
                    })
                    .filter(|point| (point.point.x - from.point.x).abs() <= self.gap_px)
                    .map(|point| (point.point.distance_px(from.point), point))
                    .min_by(|a, b| a.0.total_cmp(&b.0))
                    .filter(|(distance, _)| *distance <= self.gap_px);
                if let Some((_, meets)) = near {
                    let aligned = from.rise[0] * meets.rise[0] + from.rise[1] * meets.rise[1];
                    let angle = aligned.abs().min(1.0).acos();
                    let mean = contour.points.iter().map(|point| point.steepness).sum::<f64>();
                    let response = angle.min(FRAC_PI_2) * mean / count as f64;
                    added.push((Detection::new(meets.point, response), true));
                } else if self.keep_ends {
                    added.push((Detection::new(from.point, from.steepness), false));
                }
            }
        }
        // T-junctions before other ends, the strongest first.
        added.sort_by(|(a, is_t), (b, other_is_t)| {
            other_is_t.cmp(is_t).then(b.response.total_cmp(&a.response))
        });
        for (detection, _) in added {
            if found.iter().all(|other| other.point.distance_px(detection.point) > APART_PX) {
                found.push(detection);
            }
        }
    }
}

// ---- Contours -----------------------------------------------------------------------------------------------

/// Contours whose ends, if nearer than `gap_px` to each other, are joined: the nearest first.
fn joined(contours: Vec<Contour>, gap_px: f64) -> Vec<Contour> {
    let (mut whole, open): (Vec<_>, Vec<_>) = contours.into_iter().partition(|c| c.closed);
    // End 2 i is the first point of contour i, 2 i + 1 its last.
    let end = |e: usize| {
        let points = &open[e / 2].points;
        points[if e.is_multiple_of(2) { 0 } else { points.len() - 1 }].point
    };
    let mut gaps = Vec::new();
    for a in 0..2 * open.len() {
        for b in a + 1..2 * open.len() {
            let (from, to) = (end(a), end(b));
            if (from.x - to.x).abs() > gap_px || (from.y - to.y).abs() > gap_px {
                continue;
            }
            let distance = from.distance_px(to);
            // A contour shorter than a few gaps is not closed by one.
            let own = a / 2 == b / 2;
            if distance <= gap_px && (!own || open[a / 2].points.len() as f64 > 4.0 * gap_px) {
                gaps.push((distance, a, b));
            }
        }
    }
    gaps.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut across = vec![None; 2 * open.len()];
    for (_, a, b) in gaps {
        if across[a].is_none() && across[b].is_none() {
            across[a] = Some(b);
            across[b] = Some(a);
        }
    }
    let mut taken = vec![false; open.len()];
    // From ends that nothing continues; then round what is left.
    let starts = (0..across.len()).filter(|&e| across[e].is_none()).chain(0..across.len());
    for start in starts {
        if taken[start / 2] {
            continue;
        }
        let mut contour = Contour { points: Vec::new(), closed: across[start].is_some() };
        let mut next = Some(start);
        while let Some(from) = next.filter(|e| !taken[e / 2]) {
            taken[from / 2] = true;
            let points = &open[from / 2].points;
            if let Some(last) = contour.points.last().copied() {
                let first =
                    if from.is_multiple_of(2) { points[0] } else { points[points.len() - 1] };
                contour.points.extend(between(&last, &first));
            }
            if from.is_multiple_of(2) {
                contour.points.extend(points);
            } else {
                contour.points.extend(points.iter().rev());
            }
            next = across[from ^ 1];
        }
        if let (true, [first, .., last]) = (contour.closed, &contour.points[..]) {
            let filling: Vec<_> = between(last, first).collect();
            contour.points.extend(filling);
        }
        whole.push(contour);
    }
    whole
}

/// Points that fill a gap, not farther than a pixel apart.
fn between(from: &EdgePoint, to: &EdgePoint) -> impl Iterator<Item = EdgePoint> + use<> {
    let (from, to) = (*from, *to);
    let distance = from.point.distance_px(to.point);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small number")]
    let parts = distance.ceil() as usize;
    (1..parts).map(move |k| {
        let share = k as f64 / parts as f64;
        let mix = |a: f64, b: f64| a + share * (b - a);
        EdgePoint {
            point: ImagePoint::new(mix(from.point.x, to.point.x), mix(from.point.y, to.point.y)),
            rise: if 2 * k < parts { from.rise } else { to.rise },
            steepness: mix(from.steepness, to.steepness),
        }
    })
}

/// The contour's points smoothed along it; an open one continues beyond its ends mirrored in them.
fn smoothed(contour: &Contour, sigma: f64) -> Vec<[f64; 2]> {
    let count = contour.points.len().cast_signed();
    let at = |i: isize| -> [f64; 2] {
        let point = |i: isize| contour.points[i.unsigned_abs()].point;
        if contour.closed {
            return point(i.rem_euclid(count)).into();
        }
        let last = count - 1;
        let end = i.clamp(0, last);
        // As far on the other side of the end, or at the other end.
        let mirrored: [f64; 2] = point((2 * end - i).clamp(0, last)).into();
        let end: [f64; 2] = point(end).into();
        [2.0 * end[0] - mirrored[0], 2.0 * end[1] - mirrored[1]]
    };
    // To where the Gaussian is less than 1e-4 of its height.
    #[allow(clippy::cast_possible_truncation, reason = "a small number")]
    let reach = (sigma * f64::sqrt(-2.0 * f64::ln(1e-4))) as isize;
    let weights: Vec<f64> =
        (0..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let total = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
    (0..count)
        .map(|i| {
            let [mut x, mut y] = at(i).map(|value| weights[0] * value);
            for (k, weight) in (1..).zip(&weights[1..]) {
                let ([x0, y0], [x1, y1]) = (at(i - k), at(i + k));
                x += weight * (x0 + x1);
                y += weight * (y0 + y1);
            }
            [x / total, y / total]
        })
        .collect()
}

/// The absolute curvature at each point of a curve \[1/px\]; 0 at the ends of an open one.
fn curvature(curve: &[[f64; 2]], closed: bool) -> Vec<f64> {
    let count = curve.len();
    (0..count)
        .map(|i| {
            if !closed && (i == 0 || i + 1 == count) {
                return 0.0;
            }
            let [before, here, after] =
                [(i + count - 1) % count, i, (i + 1) % count].map(|i| curve[i]);
            let first = [0, 1].map(|axis| 0.5 * (after[axis] - before[axis]));
            let second = [0, 1].map(|axis| after[axis] - 2.0 * here[axis] + before[axis]);
            let speed = first[0].hypot(first[1]);
            let turn = (first[0] * second[1] - first[1] * second[0]).abs();
            if speed > 0.0 { turn / speed.powi(3) } else { 0.0 }
        })
        .collect()
}

/// Maxima that stand out, each between the minima beside it. Of a closed curve indices may go on beyond
/// the last one.
fn maxima(values: &[f64], closed: bool) -> Vec<[usize; 3]> {
    let count = values.len();
    let at = |i: usize| values[i % count];
    // A closed curve is gone round from its lowest point.
    let (start, steps) = if closed {
        let lowest = (0..count).min_by(|&i, &j| values[i].total_cmp(&values[j])).unwrap_or(0);
        (lowest, count)
    } else {
        (0, count - 1)
    };
    let mut found = Vec::new();
    let (mut low, mut high) = (start, None::<usize>);
    // The minimum before the maximum that is being climbed.
    let mut before = start;
    for i in start..=start + steps {
        match high {
            None if at(i) < at(low) => low = i,
            None if at(i) >= at(low) + STANDS_OUT => {
                before = low;
                high = Some(i);
            }
            Some(top) if at(i) > at(top) => high = Some(i),
            Some(top) if at(i) <= at(top) - STANDS_OUT => {
                found.push([before, top, i]);
                (low, high) = (i, None);
            }
            _ => {}
        }
        // The minimum after a maximum goes on falling.
        if let (None, Some([_, _, after])) = (high, found.last_mut()) {
            *after = low;
        }
    }
    found
}

/// The angle that a curve makes at a point \[rad\], between its arms: so many steps of so many points.
fn angle(curve: &[[f64; 2]], corner: usize, arms: [(usize, usize); 2]) -> f64 {
    let count = curve.len();
    let [back, forth] = arms.map(|(steps, stride)| {
        let at = |k: usize| curve[(corner + k * stride) % count];
        // All the way round the arm's last point is its first: two thirds of it do.
        let [middle, end] =
            if steps == count { [steps / 3, 2 * steps / 3] } else { [(steps / 2).max(1), steps] };
        tangent(at(0), at(middle), at(end))
    });
    let turn = (back - forth).rem_euclid(2.0 * PI);
    turn.min(2.0 * PI - turn)
}

/// The direction of the circle through three points at the first, towards the second.
fn tangent(first: [f64; 2], second: [f64; 2], third: [f64; 2]) -> f64 {
    let towards = |a: [f64; 2], b: [f64; 2]| [b[0] - a[0], b[1] - a[1]];
    let [x, y] = towards(first, second);
    // The tangent and the chord make the angle that the chord is seen at from the third point.
    let (a, b) = (towards(third, first), towards(third, second));
    let seen = (a[0] * b[1] - a[1] * b[0]).atan2(a[0] * b[0] + a[1] * b[1]);
    y.atan2(x) - seen
}
