//! A face's plane from the range cells that see it.

use nalgebra::{Matrix3, Point3, Unit, Vector3};

use crate::geometry::ImagePoint;
use crate::grasp::NoGrasp;
use crate::sensor::{RangeImage, Rig};
use crate::stats::excess;

/// A plane in the camera frame: m X = 1, so that m times a ray (x, y, 1) is the inverse of depth \[1/m\].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RangePlane {
    pub inverse_depth: Vector3<f64>,
    /// Of it \[1/m^2\].
    pub covariance: Matrix3<f64>,
}

/// A range cell in the camera frame.
struct Cell {
    /// At z = 1.
    ray: Vector3<f64>,
    inverse_depth: f64,
    /// Standard deviation of that \[1/m\].
    sigma: f64,
}

/// Depths are not known better \[m\].
const LEAST_SIGMA_M: f64 = 1e-6;
/// Of Tukey's weights, in standard deviations.
const CUT: f64 = 4.7;
/// Triples of cells that are tried, and the rounds of least squares after.
const MOST_TRIPLES: usize = 400;
const ROUNDS: usize = 8;
/// So many cells are enough to do without those of which a part may see something else.
const ENOUGH: usize = 6;

impl RangePlane {
    /// Fits a plane to the cells that lie inside a face, `erosion_px` from its sides; half a cell from them where that
    /// leaves six.
    ///
    /// # Errors
    /// Fewer than three cells, or all in a row.
    pub fn inside(
        corners: &[ImagePoint; 4],
        rig: &Rig,
        range: &RangeImage,
        erosion_px: f64,
    ) -> Result<Self, NoGrasp> {
        let pitch_px = rig.camera.fx_px / range.camera.fx_px;
        let half_a_cell = cells(corners, rig, range, erosion_px.max(0.5 * pitch_px));
        if half_a_cell.len() >= ENOUGH {
            return Self::through(&half_a_cell);
        }
        Self::through(&cells(corners, rig, range, erosion_px))
    }

    /// The plane nearest to most cells (Rousseeuw, Least median of squares regression, 1984), then least squares by
    /// Tukey's weights.
    fn through(cells: &[Cell]) -> Result<Self, NoGrasp> {
        let mut plane = triples(cells.len())
            .filter_map(|triple| {
                let rows = triple.map(|index| cells[index].ray.transpose());
                let depths = triple.map(|index| cells[index].inverse_depth);
                let plane = Matrix3::from_rows(&rows).try_inverse()? * Vector3::from(depths);
                let misses: Vec<f64> = misses(cells, &plane).map(f64::abs).collect();
                Some((crate::stats::median(&misses)?, plane))
            })
            .min_by(|(a, _), (b, _)| a.total_cmp(b))
            .map(|(_, plane)| plane)
            .ok_or(NoGrasp::TooFewCells)?;
        let mut covariance = Matrix3::zeros();
        for _ in 0..ROUNDS {
            let all: Vec<f64> = misses(cells, &plane).map(f64::abs).collect();
            let scale = crate::stats::median(&all).map_or(1.0, |median| (1.4826 * median).max(1.0));
            let mut information = Matrix3::zeros();
            let mut right = Vector3::zeros();
            let (mut left, mut counted) = (0.0, 0.0);
            for (cell, miss) in cells.iter().zip(misses(cells, &plane)) {
                let share = miss / (CUT * scale);
                let weight = (1.0 - share * share).max(0.0).powi(2);
                let over = weight / (cell.sigma * cell.sigma);
                information += over * cell.ray * cell.ray.transpose();
                right += over * cell.inverse_depth * cell.ray;
                left += weight * miss * miss;
                counted += weight;
            }
            let inverse = information.try_inverse().ok_or(NoGrasp::TooFewCells)?;
            plane = inverse * right;
            covariance = inverse * excess(left, (counted - 3.0).max(1.0));
        }
        let is_sound =
            covariance.cholesky().is_some() && plane.iter().all(|value| value.is_finite());
        is_sound.then_some(Self { inverse_depth: plane, covariance }).ok_or(NoGrasp::TooFewCells)
    }

    /// Where a ray (x, y, 1) meets it.
    pub fn meets(&self, ray: Vector3<f64>) -> Option<Point3<f64>> {
        let inverse = self.inverse_depth.dot(&ray);
        (inverse > 0.0).then(|| Point3::from(ray / inverse))
    }

    /// Towards the camera, and how far it may be off \[rad\].
    pub fn normal(&self) -> (Unit<Vector3<f64>>, f64) {
        let (normal, length) = Unit::new_and_get(-self.inverse_depth);
        let across = Matrix3::identity() - normal.into_inner() * normal.transpose();
        let turned = across * self.covariance * across / (length * length);
        (normal, turned.symmetric_eigenvalues().max().max(0.0).sqrt())
    }
}

/// How far each cell is off a plane, in standard deviations.
fn misses(cells: &[Cell], plane: &Vector3<f64>) -> impl Iterator<Item = f64> {
    cells.iter().map(|cell| (cell.inverse_depth - plane.dot(&cell.ray)) / cell.sigma)
}

/// All triples of indices, or so many of them that are spread.
fn triples(count: usize) -> impl Iterator<Item = [usize; 3]> {
    let all = (0..count).flat_map(move |a| {
        (a + 1..count).flat_map(move |b| (b + 1..count).map(move |c| [a, b, c]))
    });
    let step =
        (count * count.saturating_sub(1) * count.saturating_sub(2) / 6).div_ceil(MOST_TRIPLES);
    all.step_by(step.max(1))
}

/// The cells that see a face, so far from its sides.
fn cells(corners: &[ImagePoint; 4], rig: &Rig, range: &RangeImage, erosion_px: f64) -> Vec<Cell> {
    let camera_from_range = rig.world_from_camera.inverse() * range.world_from_range;
    let mut found = Vec::new();
    for y in 0..range.points.height() {
        for x in 0..range.points.width() {
            let Some(point) = range.points.at(x, y) else { continue };
            let sigma_m = range.noise.standard_deviation_m(point.z) + step_m(range, point.z);
            let point = camera_from_range * point;
            let Some(seen) = rig.camera.project(&point) else { continue };
            if inside_px(corners, seen) < erosion_px {
                continue;
            }
            let inverse_depth = 1.0 / point.z;
            let sigma = sigma_m.max(LEAST_SIGMA_M) * inverse_depth * inverse_depth;
            found.push(Cell { ray: point.coords * inverse_depth, inverse_depth, sigma });
        }
    }
    found
}

/// What steps of depth add to its standard deviation \[m\].
fn step_m(range: &RangeImage, depth_m: f64) -> f64 {
    let noise = range.noise;
    noise.quantum_m.max(noise.inverse_quantum_per_m * depth_m * depth_m) / 12.0_f64.sqrt()
}

/// How far inside a convex quadrilateral, clockwise as seen, a point is \[px\]; below 0 outside.
fn inside_px(corners: &[ImagePoint; 4], point: ImagePoint) -> f64 {
    let of_side = |index: usize| {
        let (a, b) = (corners[index], corners[(index + 1) % 4]);
        let (ux, uy) = (b.x - a.x, b.y - a.y);
        (ux * (point.y - a.y) - uy * (point.x - a.x)) / ux.hypot(uy)
    };
    (0..4).map(of_side).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Camera, Pose};
    use crate::image::Plane;
    use crate::sensor::DepthNoise;

    /// A camera of 64 x 64 pixels and one of 16 x 16 cells in the same place, whose middles are seen at 1.5 px, 5.5 px,
    /// ...; the depth is of a cell's column.
    fn cells_of_four_pixels(depth_m: impl Fn(usize) -> f64) -> (Rig, RangeImage) {
        let camera = Camera::pinhole(64, 64, 64.0);
        let of_range = camera.resized([16, 16]);
        #[allow(clippy::cast_precision_loss, reason = "small numbers")]
        let point = |x: usize, y: usize| {
            Some(of_range.unproject(ImagePoint::new(x as f64, y as f64), depth_m(x)))
        };
        let range = RangeImage {
            camera: of_range,
            world_from_range: Pose::identity(),
            points: Plane::from_fn(16, 16, point),
            noise: DepthNoise { noise_m: 1e-3, ..DepthNoise::default() },
        };
        (Rig { camera, world_from_camera: Pose::identity(), object_size_m: None }, range)
    }

    fn rectangle([left, top, right, bottom]: [f64; 4]) -> [ImagePoint; 4] {
        [[left, top], [right, top], [right, bottom], [left, bottom]].map(ImagePoint::from)
    }

    #[test]
    fn a_cell_is_inside_where_its_middle_is_seen_inside() {
        let (rig, range) = cells_of_four_pixels(|_| 1.0);
        // 3 px inside lie those from 13.5 to 25.5 and from 13.5 to 21.5.
        let found = cells(&rectangle([10.0, 10.0, 30.0, 26.0]), &rig, &range, 3.0);
        assert_eq!(found.len(), 4 * 3);
        let least = found.iter().map(|cell| cell.ray.x).fold(f64::INFINITY, f64::min);
        assert!((31.5 + 64.0 * least - 13.5).abs() < 1e-9, "{least}");
    }

    #[test]
    fn cells_that_a_side_divides_do_not_count_where_six_others_are_left() {
        // Those of column 3 see a bit of what is behind, by two standard deviations.
        let (rig, range) = cells_of_four_pixels(|x| if x == 3 { 1.002 } else { 1.0 });
        let off = |right_px: f64| {
            let face = rectangle([13.0, 9.0, right_px, 26.0]);
            let plane = RangePlane::inside(&face, &rig, &range, 0.0).expect("cells");
            (plane.inverse_depth - Vector3::z()).norm()
        };
        assert!(off(34.0) < 1e-12, "{}", off(34.0));
        // Of three rows one column is no plane: the divided ones are better than none.
        assert!(off(20.0) > 1e-6, "{}", off(20.0));
    }
}
