//! Edges as contours: chains of points on the ridge of the gradient, to fractions of a pixel.
//!
//! Devernay (1995), A non-maxima suppression method for edge detection with sub-pixel accuracy, INRIA
//! RR-2724; chained much as in Grompone von Gioi & Randall (2017), A sub-pixel edge detector, IPOL 7.
//! The parabola goes through the logarithms of the gradient, which is exact of a blurred step; the links
//! are made shortest first, so that neither the order of the pixels nor a turn of the image changes them.

use pulp::Simd;

use crate::filter::{Border, ImageRows, Kernel};
use crate::geometry::ImagePoint;
use crate::image::{PixelRange, Plane, View};

/// A point of an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EdgePoint {
    /// Where \[px\].
    pub(super) point: ImagePoint,
    /// The direction in which the channel rises, a unit vector.
    pub(super) rise: [f64; 2],
    /// How steeply \[DN/px\].
    pub(super) steepness: f64,
}

impl EdgePoint {
    /// Whether the step (dx, dy) goes forward along the edge: what is brighter lies to the right, as seen.
    fn leads(&self, dx: f64, dy: f64) -> bool {
        self.rise[1] * dx - self.rise[0] * dy > 0.0
    }
}

/// Points of one edge, one after the other; what is brighter lies to the right, as seen.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Contour {
    /// Its points; of a closed one the first is the weakest.
    pub(super) points: Vec<EdgePoint>,
    /// Whether the first follows the last.
    pub(super) closed: bool,
}

/// How near to an image's edge no point lies \[px\]: two differences.
pub(super) const BORDER: usize = 2;

/// The farthest that a point links to \[px\]; neighbours on a slanted edge are 1.4 px apart.
const LINK_PX: f64 = 2.5;

/// The contours of a part of a plane \[DN\] smoothed by a Gaussian of `sigma` \[px\], in the plane's pixels.
///
/// `thresholds` says of the largest steepness \[DN/px\] which one points have at least, and which one the
/// steepest point of a contour.
pub(super) fn contours(
    plane: &Plane<f32>,
    window: PixelRange,
    sigma: f64,
    thresholds: impl Fn(f64) -> [f64; 2],
) -> Vec<Contour> {
    let smooth = smoothed(plane.view().crop(window), &Kernel::gaussian(sigma));
    let gradient = Gradient::of(&smooth);
    let largest = gradient.steepness.samples().iter().copied().fold(0.0, f32::max);
    let [low, high] = thresholds(f64::from(largest));
    let (mut points, index) = gradient.ridge(low);
    let mut links = linked(&points, &index);
    for point in &mut points {
        point.point.x += window.x0 as f64;
        point.point.y += window.y0 as f64;
    }
    let mut found = Vec::new();
    // Open ones from their beginnings, then what is left: closed ones.
    let beginnings = (0..points.len()).filter(|&i| links.before[i].is_none());
    for first in beginnings.chain(0..points.len()).collect::<Vec<_>>() {
        if links.taken[first] {
            continue;
        }
        let closed = links.before[first].is_some();
        let mut contour = Contour { points: Vec::new(), closed };
        let mut next = Some(first);
        while let Some(i) = next.filter(|&i| !links.taken[i]) {
            links.taken[i] = true;
            contour.points.push(points[i]);
            next = links.after[i];
        }
        let steepness = |i: &usize| contour.points[*i].steepness;
        let order = |i: &usize, j: &usize| steepness(i).total_cmp(&steepness(j));
        let count = contour.points.len();
        let strong = (0..count).max_by(order).is_some_and(|i| steepness(&i) >= high);
        if strong {
            if let Some(weakest) = (0..count).min_by(order).filter(|_| closed) {
                contour.points.rotate_left(weakest);
            }
            found.push(contour);
        }
    }
    found
}

/// A plane filtered in both directions, its border continued outwards.
fn smoothed(plane: View<'_, f32>, kernel: &Kernel) -> Plane<f32> {
    let mut smooth = Plane::filled(plane.width(), plane.height(), 0.0);
    if plane.width() > 0 {
        pulp::Arch::new().dispatch(Smoothed { plane, kernel, smooth: &mut smooth });
    }
    smooth
}

/// Filters a plane: compiled for the machine's vectors.
struct Smoothed<'a> {
    plane: View<'a, f32>,
    kernel: &'a Kernel,
    smooth: &'a mut Plane<f32>,
}

impl pulp::WithSimd for Smoothed<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { plane, kernel, smooth } = self;
        let radius = kernel.radius();
        let mut column = Plane::filled(plane.width() + 2 * radius, 1, 0.0);
        for y in 0..plane.height() {
            let samples = column.samples_mut();
            let row = &mut samples[radius..radius + plane.width()];
            kernel.across(
                simd,
                &ImageRows {
                    image: plane,
                    first: y.cast_signed() - radius.cast_signed(),
                    column: 0,
                    border: Border::Replicate,
                },
                row,
            );
            let (first, last) = (row[0], row[row.len() - 1]);
            samples[..radius].fill(first);
            samples[radius + plane.width()..].fill(last);
            kernel.along(simd, samples, smooth.row_mut(y));
        }
    }
}

/// Slopes of a plane \[DN/px\]; 0 at its edges.
struct Gradient {
    slopes: Plane<[f32; 2]>,
    steepness: Plane<f32>,
}

impl Gradient {
    fn of(plane: &Plane<f32>) -> Self {
        let (width, height) = (plane.width(), plane.height());
        let mut slopes = Plane::filled(width, height, [0.0; 2]);
        let mut steepness = Plane::filled(width, height, 0.0);
        for y in 1..height.saturating_sub(1) {
            let [above, row, below] = [y - 1, y, y + 1].map(|y| plane.row(y));
            let out = slopes.row_mut(y).iter_mut().zip(steepness.row_mut(y));
            for (x, (slope, steepness)) in out.enumerate().take(width.saturating_sub(1)).skip(1) {
                let [dx, dy] = [0.5 * (row[x + 1] - row[x - 1]), 0.5 * (below[x] - above[x])];
                *slope = [dx, dy];
                *steepness = (dx * dx + dy * dy).sqrt();
            }
        }
        Self { slopes, steepness }
    }

    /// The points where the gradient is steepest along the axis that it is nearer to, `low` at least, and
    /// the index of each pixel's.
    fn ridge(&self, low: f64) -> (Vec<EdgePoint>, Plane<u32>) {
        let (width, height) = (self.slopes.width(), self.slopes.height());
        let mut points = Vec::new();
        let mut index = Plane::filled(width, height, NONE);
        #[allow(clippy::cast_possible_truncation, reason = "points lie between")]
        let least = (low as f32).max(f32::MIN_POSITIVE);
        for y in BORDER..height.saturating_sub(BORDER) {
            let steepness = self.steepness.row(y);
            for x in BORDER..width.saturating_sub(BORDER) {
                let here = steepness[x];
                if here < least {
                    continue;
                }
                let [dx, dy] = self.slopes.at(x, y);
                let across = dx.abs() < dy.abs();
                let near = |step: usize| if across { [x, y + step - 1] } else { [x + step - 1, y] };
                let [before, after] = [0, 2].map(|step| {
                    let [x, y] = near(step);
                    self.steepness.at(x, y)
                });
                if here <= before || here < after {
                    continue;
                }
                let (offset, steepness) = summit([before, here, after].map(f64::from));
                // Slopes in between, so that of two equal pixels either gives the same point.
                let [other_x, other_y] = near(if offset < 0.0 { 0 } else { 2 });
                let [other_dx, other_dy] = self.slopes.at(other_x, other_y);
                let between =
                    |a: f32, b: f32| f64::from(a) + offset.abs() * (f64::from(b) - f64::from(a));
                let [dx, dy] = [between(dx, other_dx), between(dy, other_dy)];
                let length = dx.hypot(dy);
                if length <= 0.0 || !steepness.is_finite() {
                    continue;
                }
                let [x_offset, y_offset] = if across { [0.0, offset] } else { [offset, 0.0] };
                index.row_mut(y)[x] = u32::try_from(points.len()).unwrap_or(NONE);
                points.push(EdgePoint {
                    point: ImagePoint::new(x as f64 + x_offset, y as f64 + y_offset),
                    rise: [dx / length, dy / length],
                    steepness,
                });
            }
        }
        (points, index)
    }
}

/// Where no point is.
const NONE: u32 = u32::MAX;

/// Where a bell is highest that goes through three values, the middle one the largest, and how high: as
/// a parabola of their logarithms. In steps from the middle one, a half at most.
pub(super) fn summit(values: [f64; 3]) -> (f64, f64) {
    let least = 1e-3 * values[1];
    let [before, here, after] = values.map(|value| value.max(least).ln());
    let bend = before - 2.0 * here + after;
    if bend >= 0.0 || !bend.is_finite() {
        return (0.0, values[1]);
    }
    let offset = (0.5 * (before - after) / bend).clamp(-0.5, 0.5);
    let slope = 0.5 * (after - before);
    (offset, (here + slope * offset + 0.5 * bend * offset * offset).exp())
}

/// Which points follow which.
struct Links {
    before: Vec<Option<usize>>,
    after: Vec<Option<usize>>,
    taken: Vec<bool>,
}

/// Links each point to the nearest one before it and after it, the shortest links first.
fn linked(points: &[EdgePoint], index: &Plane<u32>) -> Links {
    // Of each point the nearest one before it and after it.
    let mut nearest_of = Vec::with_capacity(points.len());
    let square = LINK_PX * LINK_PX;
    for (i, from) in points.iter().enumerate() {
        let mut nearest: [Option<(f64, usize)>; 2] = [None; 2];
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in the plane")]
        let (x, y) = (from.point.x.round() as usize, from.point.y.round() as usize);
        // A point lies half a pixel from its pixel at most, and this one half a pixel from (x, y).
        let rows = y.saturating_sub(3)..(y + 4).min(index.height());
        for row in rows {
            let columns = x.saturating_sub(3)..(x + 4).min(index.width());
            for &j in index.row(row)[columns].iter().filter(|&&j| j != NONE) {
                let to = &points[j as usize];
                let (dx, dy) = (to.point.x - from.point.x, to.point.y - from.point.y);
                let distance = dx * dx + dy * dy;
                let alike = from.rise[0] * to.rise[0] + from.rise[1] * to.rise[1] > 0.0;
                if j as usize == i || distance > square || !alike {
                    continue;
                }
                let forward = from.leads(dx, dy);
                if forward != to.leads(dx, dy) {
                    continue;
                }
                let best = &mut nearest[usize::from(forward)];
                if best.is_none_or(|(least, _)| distance < least) {
                    *best = Some((distance, j as usize));
                }
            }
        }
        nearest_of.push(nearest);
    }
    let none = || vec![None; points.len()];
    let mut links = Links { before: none(), after: none(), taken: vec![false; points.len()] };
    let mut wishes = Vec::new();
    for (i, [back, forth]) in nearest_of.iter().enumerate() {
        if let Some((distance, j)) = *forth {
            // Where either is the other's nearest no link is shorter.
            if nearest_of[j][0].is_some_and(|(_, back)| back == i) {
                (links.after[i], links.before[j]) = (Some(j), Some(i));
            } else {
                wishes.push((distance, i, j));
            }
        }
        wishes.extend(
            back.filter(|(_, j)| nearest_of[*j][1].is_none_or(|(_, forth)| forth != i))
                .map(|(distance, j)| (distance, j, i)),
        );
    }
    wishes.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    for (_, from, to) in wishes {
        if links.after[from].is_none() && links.before[to].is_none() {
            links.after[from] = Some(to);
            links.before[to] = Some(from);
        }
    }
    links
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::junction::normal_cdf;

    fn all(plane: &Plane<f32>) -> Vec<Contour> {
        let window = PixelRange { x0: 0, y0: 0, x1: plane.width(), y1: plane.height() };
        contours(plane, window, 1.0, |largest| [0.1 * largest, 0.5 * largest])
    }

    #[test]
    fn a_blurred_edge_is_one_contour_at_its_place() {
        for degrees in [0.0_f64, 7.0, 31.0, 45.0, 62.0, 90.0, 133.0, 260.0] {
            let (sine, cosine) = degrees.to_radians().sin_cos();
            let distance = |x: f64, y: f64| cosine * (x - 20.3) + sine * (y - 19.6);
            #[allow(clippy::cast_possible_truncation, reason = "a grey value")]
            let plane = Plane::from_fn(40, 40, |x, y| {
                (40.0 + 150.0 * normal_cdf(distance(x as f64, y as f64) / 0.7)) as f32
            });
            let found = all(&plane);
            assert_eq!(found.len(), 1, "{degrees}");
            assert!(!found[0].closed && found[0].points.len() >= 34, "{degrees}");
            for point in &found[0].points {
                let off = distance(point.point.x, point.point.y);
                assert!(off.abs() < 0.02, "{degrees}: {off} px");
                assert!(point.rise[0] * cosine + point.rise[1] * sine > 0.999, "{degrees}");
            }
            // Forwards, what is brighter is on the right.
            let [first, last] = [0, found[0].points.len() - 1].map(|i| found[0].points[i].point);
            assert!(sine * (last.x - first.x) - cosine * (last.y - first.y) > 30.0, "{degrees}");
        }
    }

    #[test]
    fn a_blurred_disc_is_one_closed_contour() {
        #[allow(clippy::cast_possible_truncation, reason = "a grey value")]
        let plane = Plane::from_fn(50, 48, |x, y| {
            let radius = (x as f64 - 24.2).hypot(y as f64 - 23.7);
            (200.0 - 150.0 * normal_cdf((radius - 15.0) / 0.7)) as f32
        });
        let found = all(&plane);
        assert_eq!(found.len(), 1);
        assert!(found[0].closed && found[0].points.len() > 70, "{}", found[0].points.len());
        for point in &found[0].points {
            let radius = (point.point.x - 24.2).hypot(point.point.y - 23.7);
            assert!((radius - 15.0).abs() < 0.1, "{radius}"); // A bend draws an edge inwards.
        }
    }

    #[test]
    fn a_flat_or_tiny_plane_has_none() {
        for (width, height) in [(0, 0), (1, 1), (2, 3), (30, 20)] {
            assert!(all(&Plane::filled(width, height, 128.0)).is_empty());
        }
    }
}
