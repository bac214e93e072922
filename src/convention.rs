//! Do renderer, reader and projection agree on where the image is?
//!
//! An image of a rendered scene shows the target's edges; the projection says where they are. Each
//! column (or row) of film cells that an edge crosses undisturbed is a step between two smooth sides,
//! and the sum of the column tells where the step is, exactly for a box filter: the partial-area
//! principle (Trujillo-Pino et al., Image and Vision Computing 2013), here with a linear ramp on
//! either side. A line through the steps of each edge, two or more edges at a corner: the corner as
//! rendered. Its distance from the corner as projected is the offset of the whole chain; half a pixel
//! anywhere in it shows as half a pixel.
//!
//! Two images serve. In the coverage a region of the target is one within and zero without, whatever
//! else is there: nothing but the samples limits what it tells. The radiance is what algorithms see.

use nalgebra::{Matrix2, Point3, Vector2};

use crate::geometry::ImagePoint;
use crate::image::Plane;
use crate::scene::{Coverage, NO_FACE, Scene, TrueEdge, Truth, Visibility};
use crate::stats;

/// In what the corners are looked for.
#[derive(Clone, Copy, Debug)]
pub enum Evidence<'a> {
    /// In the coverage of the scene.
    Coverage(&'a Coverage),
    /// In its film.
    Radiance,
}

/// Film cells next to a step that are not taken for one of its sides.
const CLEAR: f64 = 2.0;
/// A film cell is within a region, or without it, when its share is one or zero but for rounding.
const ROUNDING: f64 = 1e-3;
/// Film cells to either side of a step over which the partial area is summed.
const NARROW: f64 = 4.0;
/// Depth by which the background must lie behind a silhouette \[m\]: nearer surfaces touch the
/// target, and their contact shadow is no linear ramp.
const DEPTH_GAP_M: f64 = 0.03;

/// An image and what of it counts.
struct Picture<'a> {
    channels: &'a [Plane<f32>; 3],
    /// Film cells where it is fine: along x and y, from and to.
    fine: [[i64; 2]; 2],
    /// The film cell of its first sample.
    origin: [i64; 2],
    /// Film cells per pixel.
    scale: f64,
    /// Whether it is the coverage.
    is_coverage: bool,
    /// How far from the ends of what is seen of it an edge is used \[px\].
    end_margin_px: f64,
    /// How far to either side of an edge the image is used \[px\].
    half_band_px: f64,
    /// Edges of which less is left between the margins are not used \[px\].
    shortest_px: f64,
    /// Film columns that an edge must be found in.
    fewest_steps: usize,
    /// Sine of the angle at which two edges must at least meet for a corner.
    least_sine: f64,
}

impl<'a> Picture<'a> {
    fn of(scene: &'a Scene, evidence: Evidence<'a>) -> Self {
        let oversampling = i64::from(scene.film.oversampling);
        let [x0, y0, x1, y1] =
            scene.description.film.fovea_px.map(|edge| i64::from(edge) * oversampling);
        let fine = [[x0, x1], [y0, y1]];
        let scale = f64::from(scene.film.oversampling);
        match evidence {
            Evidence::Coverage(coverage) => Self {
                channels: &coverage.regions,
                fine,
                origin: [x0, y0],
                scale,
                is_coverage: true,
                end_margin_px: 0.5,
                half_band_px: (NARROW + 2.0) / scale,
                shortest_px: 4.0,
                fewest_steps: 12,
                least_sine: 0.05,
            },
            Evidence::Radiance => Self {
                channels: &scene.film.radiance,
                fine,
                origin: [0, 0],
                scale,
                is_coverage: false,
                end_margin_px: 4.0,
                half_band_px: 3.0,
                shortest_px: 16.0,
                fewest_steps: 24,
                least_sine: 0.3,
            },
        }
    }
}

impl Picture<'_> {
    /// The cell at `index` of a film column (axis 0) or row (axis 1); `None` where it is not fine.
    fn cell(&self, axis: usize, column: i64, index: i64) -> Option<[f64; 3]> {
        let place = if axis == 0 { [column, index] } else { [index, column] };
        let is_fine = |axis: usize| (self.fine[axis][0]..self.fine[axis][1]).contains(&place[axis]);
        if !is_fine(0) || !is_fine(1) {
            return None;
        }
        let [x, y] = [0, 1].map(|axis| usize::try_from(place[axis] - self.origin[axis]).ok());
        let (x, y) = (x?, y?);
        Some([0, 1, 2].map(|channel| f64::from(self.channels[channel].at(x, y))))
    }
}

/// How far a corner as rendered is from the corner as projected.
#[derive(Clone, Debug, PartialEq)]
pub struct CornerOffset {
    /// Index of the corner.
    pub corner: usize,
    /// Its projection \[px\].
    pub image_point_px: ImagePoint,
    /// Rendered minus projected position \[px\].
    pub offset_px: [f64; 2],
    /// Standard error of each coordinate \[px\].
    pub standard_error_px: [f64; 2],
}

/// The mean of corner offsets.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct MeanOffset {
    /// Corners measured.
    pub corners: usize,
    /// Mean offset, rendered minus projected \[px\].
    pub mean_px: [f64; 2],
    /// Length of the mean offset \[px\].
    pub length_px: f64,
    /// Standard error of the mean, from those of the corners \[px\].
    pub standard_error_px: [f64; 2],
}

/// The mean of `offsets`, each weighted by its precision; `None` of fewer than two.
pub fn mean_offset(offsets: &[CornerOffset]) -> Option<MeanOffset> {
    if offsets.len() < 2 {
        return None;
    }
    let axis = |axis: usize| {
        let weight = |offset: &CornerOffset| offset.standard_error_px[axis].powi(-2);
        let total: f64 = offsets.iter().map(weight).sum();
        let sum: f64 = offsets.iter().map(|offset| weight(offset) * offset.offset_px[axis]).sum();
        (sum / total, total.sqrt().recip())
    };
    let ((x, x_error), (y, y_error)) = (axis(0), axis(1));
    Some(MeanOffset {
        corners: offsets.len(),
        mean_px: [x, y],
        length_px: x.hypot(y),
        standard_error_px: [x_error, y_error],
    })
}

/// The root mean square of the offsets' lengths \[px\]; `None` of none.
pub fn root_mean_square_px(offsets: &[CornerOffset]) -> Option<f64> {
    let lengths: Vec<f64> =
        offsets.iter().map(|offset| offset.offset_px[0].hypot(offset.offset_px[1])).collect();
    stats::root_mean_square(&lengths)
}

/// Measures every visible corner of a scene that two or more edges lead to which are seen.
///
/// Rounded edges and those that a lens blurs are not where the projection is: such scenes have no
/// corner that can be measured.
pub fn corner_offsets(scene: &Scene, evidence: Evidence<'_>) -> Vec<CornerOffset> {
    if !is_sharp(scene) {
        return Vec::new();
    }
    let truth = &scene.truth;
    let picture = Picture::of(scene, evidence);
    let visible = truth.corners.iter().filter(|corner| corner.visibility == Visibility::Visible);
    visible
        .filter_map(|corner| {
            let lines: Vec<EdgeLine> = corner
                .edges
                .iter()
                .filter_map(|at| edge_line(scene, &picture, &truth.edges[at.edge], corner.index))
                .collect();
            intersect(&lines, picture.least_sine).map(|(offset_px, standard_error_px)| {
                CornerOffset {
                    corner: corner.index,
                    image_point_px: corner.image_point_px,
                    offset_px,
                    standard_error_px,
                }
            })
        })
        .collect()
}

/// Whether the edges of a scene's target are sharp, in space and in the image.
pub fn is_sharp(scene: &Scene) -> bool {
    scene.description.lens.is_none() && scene.description.target.bevel_radius_m == 0.0
}

/// Where an edge was found, relative to its projection, extrapolated to one of its ends.
#[derive(Clone, Copy, Debug)]
struct EdgeLine {
    /// Unit normal of the edge.
    normal: Vector2<f64>,
    /// Displacement along the normal at the corner \[px\].
    displacement_px: f64,
    /// Its variance \[px^2\].
    variance_px2: f64,
}

/// Least-squares intersection of displaced lines: the offset and its standard errors.
fn intersect(lines: &[EdgeLine], least_sine: f64) -> Option<([f64; 2], [f64; 2])> {
    let mut information = Matrix2::zeros();
    let mut right = Vector2::zeros();
    for line in lines {
        information += line.normal * line.normal.transpose() / line.variance_px2;
        right += line.normal * line.displacement_px / line.variance_px2;
    }
    let sine = |a: &EdgeLine, b: &EdgeLine| a.normal.perp(&b.normal).abs();
    let cross =
        lines.iter().enumerate().any(|(i, a)| lines[..i].iter().any(|b| sine(a, b) > least_sine));
    let covariance = information.try_inverse().filter(|_| cross)?;
    let offset = covariance * right;
    Some((
        [offset.x, offset.y],
        [covariance[(0, 0)].max(0.0).sqrt(), covariance[(1, 1)].max(0.0).sqrt()],
    ))
}

/// Measures one edge, seen from the corner `end`.
fn edge_line(
    scene: &Scene,
    picture: &Picture<'_>,
    edge: &TrueEdge,
    end: usize,
) -> Option<EdgeLine> {
    let is_whole = edge.visible_fraction > 1.0 - 1e-9;
    if !picture.is_coverage && !is_whole {
        return None;
    }
    let other = if edge.corners[0] == end { edge.corners[1] } else { edge.corners[0] };
    let [start, finish] = [end, other].map(|index| scene.truth.corners[index].image_point_px);
    let along = Vector2::new(finish.x - start.x, finish.y - start.y);
    let length_px = along.norm();
    let used = used_distances_px(scene, picture, edge, start, along / length_px);
    if used.iter().map(|[from, to]| (to - from).max(0.0)).sum::<f64>() < picture.shortest_px {
        return None;
    }
    let direction = along / length_px;
    // Steps are looked for across the edge's major axis: down columns of an edge that runs across.
    let axis = usize::from(direction.x.abs() < direction.y.abs());
    let mut normal = Vector2::new(-direction.y, direction.x);
    if normal[1 - axis] < 0.0 {
        normal = -normal;
    }

    let oversampling = scene.film.oversampling;
    let (first, last) = (start.to_film(oversampling), finish.to_film(oversampling));
    let (low, high) = (first[axis].min(last[axis]), first[axis].max(last[axis]));
    let regions = regions(&scene.truth, edge);
    let mut steps = Vec::new();
    #[allow(clippy::cast_possible_truncation, reason = "film coordinates")]
    for column in low.ceil() as i64..high.floor() as i64 {
        #[allow(clippy::cast_precision_loss, reason = "film coordinates")]
        let middle = column as f64 + 0.5;
        let share = (middle - first[axis]) / (last[axis] - first[axis]);
        let distance_px = share * length_px;
        if !used.iter().any(|[from, to]| (*from..*to).contains(&distance_px)) {
            continue;
        }
        let expected = first[1 - axis] + share * (last[1 - axis] - first[1 - axis]);
        let point = ImagePoint::new(start.x + share * along.x, start.y + share * along.y);
        let found = if picture.is_coverage {
            let border = |region: &usize| find_border(picture, *region, axis, column, expected);
            regions.iter().find_map(border).map(|step| (step, 1.0))
        } else if is_undisturbed(scene, picture, edge, point, normal) {
            find_step(picture, axis, column, expected)
        } else {
            None
        };
        if let Some((step, contrast)) = found {
            let displacement_px = (step - expected) * normal[1 - axis] / picture.scale;
            steps.push(Step { distance_px, displacement_px, contrast });
        }
    }
    fit_line(&steps, picture.fewest_steps).map(|(displacement_px, variance_px2)| EdgeLine {
        normal,
        displacement_px,
        variance_px2,
    })
}

/// Which parts of an edge are used: from and to which distance from an image point on it \[px\].
fn used_distances_px(
    scene: &Scene,
    picture: &Picture<'_>,
    edge: &TrueEdge,
    start: ImagePoint,
    direction: Vector2<f64>,
) -> Vec<[f64; 2]> {
    let [a, b] = edge.corners.map(|index| Point3::from(scene.truth.corners[index].position_m));
    let description = &scene.description;
    let distance_px = |share: f64| {
        let point = description.world_from_camera.inverse_transform_point(&(a + share * (b - a)));
        let image = description.camera.project(&point)?;
        Some(direction.x * (image.x - start.x) + direction.y * (image.y - start.y))
    };
    let margin_px = picture.end_margin_px;
    edge.visible
        .iter()
        .filter_map(|seen| Some([distance_px(seen.start)?, distance_px(seen.end)?]))
        .map(|[one, other]| [one.min(other) + margin_px, one.max(other) - margin_px])
        .collect()
}

/// The regions of the coverage that end at an edge: faces that look at the camera, in their order.
fn regions(truth: &Truth, edge: &TrueEdge) -> Vec<usize> {
    let facing = edge.faces.iter().filter(|face| truth.faces[**face].facing);
    facing.map(|face| truth.faces[..*face].iter().filter(|f| f.facing).count()).collect()
}

/// Film coordinate of the border of a region in one column (axis 0) or row (axis 1), looked for near
/// `expected`: the sum of its shares, where it is all on one side of the border and none on the other.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    reason = "film coordinates, checked against the film's size"
)]
fn find_border(
    picture: &Picture<'_>,
    region: usize,
    axis: usize,
    column: i64,
    expected: f64,
) -> Option<f64> {
    let half = picture.half_band_px * picture.scale;
    let (from, to) = ((expected - half).round() as i64, (expected + half).round() as i64);
    let shares: Vec<f64> =
        (from..to).map(|v| Some(picture.cell(axis, column, v)?[region])).collect::<Option<_>>()?;
    let total: f64 = shares.iter().sum();
    let (first, last) = (*shares.first()? > 0.5, *shares.last()? > 0.5);
    if first == last {
        return None;
    }
    let border = if first { from as f64 + total } else { to as f64 - total };
    let is_clear = |(v, share): (i64, &f64)| {
        let within = match v as f64 {
            v if v + 1.0 < border - CLEAR => first,
            v if v > border + CLEAR => last,
            _ => return true,
        };
        (share - f64::from(u8::from(within))).abs() < ROUNDING
    };
    (from..to).zip(&shares).all(is_clear).then_some(border)
}

/// Whether each side of the edge at `point` is one surface, on the target those that meet there, and
/// the one behind, if there is one, does not touch the target.
fn is_undisturbed(
    scene: &Scene,
    picture: &Picture<'_>,
    edge: &TrueEdge,
    point: ImagePoint,
    normal: Vector2<f64>,
) -> bool {
    let geometry = &scene.geometry;
    let at = |distance_px: f64| {
        let x = (point.x + distance_px * normal.x).round();
        let y = (point.y + distance_px * normal.y).round();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked")]
        scene.description.camera.contains(ImagePoint::new(x, y)).then(|| {
            let (x, y) = (x as usize, y as usize);
            let ids = (geometry.object_id.at(x, y), geometry.face_id.at(x, y));
            let depth_m = f64::from(geometry.depth_m.at(x, y));
            (ids, if depth_m > 0.0 { depth_m } else { f64::INFINITY })
        })
    };
    let side = |sign: f64| {
        let near = at(1.5 * sign)?;
        let far = at((picture.half_band_px + 0.5) * sign)?;
        (near.0 == far.0).then_some(near)
    };
    let (Some((ids_a, depth_a)), Some((ids_b, depth_b))) = (side(-1.0), side(1.0)) else {
        return false;
    };
    let on_target = |ids: (u32, u32)| ids.1 != NO_FACE;
    // A face that is seen nearly edge-on is narrower than the distance that was looked at.
    let is_shown = |face: usize| [ids_a, ids_b].iter().any(|ids| ids.1 as usize == face);
    let mut facing = edge.faces.iter().filter(|face| scene.truth.faces[**face].facing);
    if !facing.all(|face| is_shown(*face)) {
        return false;
    }
    match (on_target(ids_a), on_target(ids_b)) {
        (true, true) => ids_a != ids_b,
        (true, false) => depth_b - depth_a > DEPTH_GAP_M,
        (false, true) => depth_a - depth_b > DEPTH_GAP_M,
        (false, false) => false,
    }
}

struct Step {
    distance_px: f64,
    displacement_px: f64,
    contrast: f64,
}

/// Film coordinate of the step in one column (axis 0) or row (axis 1), looked for near `expected`,
/// and its contrast in radiance.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_precision_loss,
    clippy::cast_sign_loss,
    reason = "film coordinates, checked against the film's size"
)]
fn find_step(picture: &Picture<'_>, axis: usize, column: i64, expected: f64) -> Option<(f64, f64)> {
    let half = picture.half_band_px * picture.scale;
    let mut step = expected;
    let mut contrast = 0.0;
    for _ in 0..4 {
        let from = (step - half).round() as i64;
        let to = (step + half).round() as i64;
        let cells: Vec<[f64; 3]> =
            (from..to).map(|v| picture.cell(axis, column, v)).collect::<Option<_>>()?;
        let cell = |v: i64| cells[(v - from) as usize];
        // The two sides, without the cells that the step may touch.
        let below: Vec<i64> = (from..to).filter(|v| (*v as f64 + 1.0) < step - CLEAR).collect();
        let above: Vec<i64> = (from..to).filter(|v| *v as f64 > step + CLEAR).collect();
        let mean = |cells: &[i64]| -> [f64; 3] {
            let sum = cells
                .iter()
                .map(|v| cell(*v))
                .fold([0.0; 3], |a, b| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]);
            sum.map(|value| value / cells.len() as f64)
        };
        if below.is_empty() || above.is_empty() {
            return None;
        }
        let (mean_below, mean_above) = (mean(&below), mean(&above));
        let difference = [0, 1, 2].map(|c| mean_above[c] - mean_below[c]);
        let square: f64 = difference.iter().map(|d| d * d).sum();
        contrast = square.sqrt();
        if contrast < 0.02 {
            return None;
        }
        // The colour along the difference of the sides, and its linear ramp on each.
        let level = |v: i64| {
            let colour = cell(v);
            (0..3).map(|c| colour[c] * difference[c]).sum::<f64>() / contrast
        };
        let ramp = |cells: &[i64]| {
            let points: Vec<(f64, f64)> =
                cells.iter().map(|v| (*v as f64 + 0.5 - expected, level(*v))).collect();
            fit_ramp(&points)
        };
        let ((a0, a1), (b0, b1)) = (ramp(&below)?, ramp(&above)?);
        // The sum needs only the cells around the step; more of them would add noise.
        let narrow = NARROW.min(half);
        let (from, to) = ((step - narrow).round() as i64, (step + narrow).round() as i64);
        let total: f64 = (from..to).map(level).sum();
        let integral = |(value, slope): (f64, f64), from: f64, to: f64| {
            value * (to - from) + 0.5 * slope * (to * to - from * from)
        };
        let (low, high) = (from as f64 - expected, to as f64 - expected);
        let mut t = step - expected;
        for _ in 0..6 {
            let excess = integral((a0, a1), low, t) + integral((b0, b1), t, high) - total;
            let slope = (a0 + a1 * t) - (b0 + b1 * t);
            if slope.abs() < 0.25 * contrast {
                return None;
            }
            t -= excess / slope;
        }
        if !t.is_finite() || (expected + t - step).abs() > NARROW + half {
            return None;
        }
        step = expected + t;
    }
    Some((step, contrast))
}

/// Least-squares line through (x, y): value at 0 and slope.
#[allow(clippy::cast_precision_loss, reason = "counts")]
fn fit_ramp(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    let count = points.len() as f64;
    let mean_x = points.iter().map(|p| p.0).sum::<f64>() / count;
    let mean_y = points.iter().map(|p| p.1).sum::<f64>() / count;
    let sxx: f64 = points.iter().map(|p| (p.0 - mean_x).powi(2)).sum();
    let sxy: f64 = points.iter().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum();
    (points.len() > 2 && sxx > 0.0).then(|| (mean_y - sxy / sxx * mean_x, sxy / sxx))
}

/// The displacement extrapolated to distance 0, and its variance; steps far from the others are
/// left out (3.5 median absolute deviations).
#[allow(clippy::cast_precision_loss, reason = "counts")]
fn fit_line(steps: &[Step], fewest: usize) -> Option<(f64, f64)> {
    let displacements: Vec<f64> = steps.iter().map(|step| step.displacement_px).collect();
    let centre = stats::median(&displacements)?;
    let deviations: Vec<f64> = displacements.iter().map(|d| (d - centre).abs()).collect();
    let limit = 3.5 * 1.4826 * stats::median(&deviations)? + 1e-6;
    let kept: Vec<&Step> =
        steps.iter().filter(|step| (step.displacement_px - centre).abs() <= limit).collect();
    if kept.len() < fewest {
        return None;
    }
    let weight = |step: &Step| step.contrast * step.contrast;
    let total: f64 = kept.iter().map(|step| weight(step)).sum();
    let mean = |value: &dyn Fn(&Step) -> f64| {
        kept.iter().map(|step| weight(step) * value(step)).sum::<f64>() / total
    };
    let mean_s = mean(&|step| step.distance_px);
    let mean_d = mean(&|step| step.displacement_px);
    let sss = mean(&|step| (step.distance_px - mean_s).powi(2));
    let ssd = mean(&|step| (step.distance_px - mean_s) * (step.displacement_px - mean_d));
    let slope = ssd / sss;
    let at_corner = mean_d - slope * mean_s;
    let scatter =
        mean(&|step| (step.displacement_px - at_corner - slope * step.distance_px).powi(2));
    let variance = scatter / (kept.len() as f64 - 2.0) * (1.0 + mean_s * mean_s / sss);
    Some((at_corner, variance.max(1e-12)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where region 0 or 1 is found to end in a column in which region 0 ends at film coordinate `end`
    /// and region 1 goes on for `sliver` cells.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_precision_loss,
        reason = "small numbers"
    )]
    fn border_found(region: usize, end: f64, sliver: f64) -> Option<f64> {
        let filled = |y: usize, to: f64| (to - y as f64).clamp(0.0, 1.0);
        let plane = |share: &dyn Fn(usize) -> f64| Plane::from_fn(4, 24, |_, y| share(y) as f32);
        let channels = [
            plane(&|y| filled(y, end)),
            plane(&|y| filled(y, end + sliver) - filled(y, end)),
            plane(&|_| 0.0),
        ];
        let picture = Picture {
            channels: &channels,
            fine: [[0, 4], [0, 24]],
            origin: [0, 0],
            scale: 4.0,
            is_coverage: true,
            end_margin_px: 0.5,
            half_band_px: 1.5,
            shortest_px: 4.0,
            fewest_steps: 12,
            least_sine: 0.05,
        };
        find_border(&picture, region, 0, 1, 12.0)
    }

    #[test]
    fn the_border_of_a_region_is_found_exactly_whatever_is_beyond_it() {
        for (end, sliver) in [(11.3, 0.0), (12.0, 0.4), (12.7, 1.5), (13.25, 9.0), (10.1, 0.01)] {
            let found = border_found(0, end, sliver).expect("a border");
            assert!((found - end).abs() < 1e-6, "{found} in place of {end}");
        }
    }

    #[test]
    fn a_region_that_is_narrow_or_ends_elsewhere_has_no_border_here() {
        assert_eq!(border_found(1, 12.0, 3.0), None);
        assert_eq!(border_found(1, 12.0, 5.5), None, "its far end shows, too");
        assert_eq!(border_found(0, 5.5, 0.0), None);
        assert_eq!(border_found(0, 19.0, 0.0), None);
    }
}
