//! The plane of the range cells inside a face, met by the ray through its centre.
//!
//! ```text
//! # Method      (1) u = where the face's diagonals meet, lens undone. (2) A plane m X = 1 through the range cells
//!               inside the face: least median of squares over triples of cells, then Tukey's weights on the inverse
//!               depth, in which a plane is linear. (3) X = r / (m r) on the ray r through u. The normal is m's, the
//!               jaws close across the shorter pair of sides, as they lie in the plane.
//! # Input       a face; the colour camera and its pose; a range image, its sensor's pose and noise.
//! # Parameters  erosion_px  px, 3   range [0, 50]: cells nearer to a side are not used, half a cell where that
//!                                   leaves six: they may see something else, or half of it
//! # Output      u, X, approach and jaws, and the covariance of X: of the corners' covariances (0.3 px where a refiner
//!               says nothing) and of the plane's. too_few_cells where fewer than three are inside, or in a row.
//! # Border      none.
//! # Cost        O(cells), at most 400 triples of them.
//! # Departures  none.
//! # Source      Rousseeuw, Least median of squares regression, 1984; Hoppe et al. fit planes so in every textbook on
//!               range images. The inverse depth of a plane is linear in image coordinates: Hartley & Zisserman 2004.
//! # Checked by  tests/it/estimators.rs
//! ```

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Point3, SMatrix, Unit, Vector2, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::{ImagePoint, diagonal_intersection};
use crate::grasp::range_plane::RangePlane;
use crate::grasp::{Approach, Face, Grasp, GraspEstimator, NoGrasp};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::{RangeImage, Rig};

/// The registry's line.
pub const ENTRY: Entry<dyn GraspEstimator> = Entry {
    name: "face_plane",
    summary: "where the ray through the diagonals meets the plane of the range cells inside the face",
    reference: "Rousseeuw 1984 (least median of squares); Hartley & Zisserman 2004",
    version: 1,
    defaults: defaults::<FacePlane>,
    schema: schema::<FacePlane>,
    build: |place, table| Ok(Box::new(parameters::<FacePlane>(place, table)?)),
};

/// The estimator; its parameter is that of the header.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct FacePlane {
    /// Range cells nearer to a side are not used \[px\].
    #[schemars(range(min = 0.0, max = 50.0))]
    pub erosion_px: f64,
}

impl Default for FacePlane {
    fn default() -> Self {
        Self { erosion_px: 3.0 }
    }
}

impl GraspEstimator for FacePlane {
    fn estimate(&self, face: &Face, rig: &Rig, range: &RangeImage) -> Result<Grasp, NoGrasp> {
        let ray = diagonal_ray(&face.corners, rig).ok_or(NoGrasp::NoRange)?;
        let image_point = rig.camera.project(&ray.into()).ok_or(NoGrasp::NoRange)?;
        let plane = RangePlane::inside(&face.corners, rig, range, self.erosion_px)?;
        let point = plane.meets(ray).ok_or(NoGrasp::NoRange)?;
        let mut corners = [Point3::origin(); 4];
        for (place, corner) in corners.iter_mut().zip(&face.corners) {
            *place = plane.meets(rig.camera.ray(*corner)).ok_or(NoGrasp::NoRange)?;
        }
        let ray_covariance = diagonal_ray_covariance(face, rig).ok_or(NoGrasp::NoRange)?;
        Ok(Grasp {
            approach: Some(approach(&corners, plane.normal())),
            covariance_m2: Some(covariance_m2(&plane, ray, &ray_covariance)),
            ..Grasp::at(image_point, point, rig)
        })
    }
}

/// The ray, at z = 1, on which the diagonals of a face meet: its centre's, whatever the perspective.
pub(super) fn diagonal_ray(corners: &[ImagePoint; 4], rig: &Rig) -> Option<Vector3<f64>> {
    // On the plane at z = 1 lines are straight.
    let undistorted = corners.map(|corner| {
        let ray = rig.camera.ray(corner);
        ImagePoint::new(ray.x, ray.y)
    });
    let meeting = diagonal_intersection(&undistorted)?;
    Some(Vector3::new(meeting.x, meeting.y, 1.0))
}

/// The covariance of that ray's x and y, by those of the corners.
fn diagonal_ray_covariance(face: &Face, rig: &Rig) -> Option<Matrix2<f64>> {
    const STEP_PX: f64 = 1e-4;
    let mut sum = Matrix2::zeros();
    for corner in 0..4 {
        let moved = |x: f64, y: f64| {
            let mut corners = face.corners;
            corners[corner] = ImagePoint::new(corners[corner].x + x, corners[corner].y + y);
            diagonal_ray(&corners, rig)
        };
        let slope = |x: f64, y: f64| -> Option<Vector2<f64>> {
            Some((moved(x, y)? - moved(-x, -y)?).xy() / (2.0 * STEP_PX))
        };
        let slope = Matrix2::from_columns(&[slope(STEP_PX, 0.0)?, slope(0.0, STEP_PX)?]);
        sum += slope * face.covariance_px2(corner) * slope.transpose();
    }
    Some(sum)
}

/// Of the point where a ray meets a plane.
fn covariance_m2(plane: &RangePlane, ray: Vector3<f64>, of_ray: &Matrix2<f64>) -> Matrix3<f64> {
    let depth = 1.0 / plane.inverse_depth.dot(&ray);
    let by_plane = -ray * ray.transpose() * (depth * depth);
    let along: Matrix3x2<f64> = SMatrix::identity();
    let by_ray = along * depth - ray * (plane.inverse_depth.xy().transpose() * (depth * depth));
    by_plane * plane.covariance * by_plane.transpose() + by_ray * of_ray * by_ray.transpose()
}

/// How to close on a face whose corners are there, clockwise.
pub(super) fn approach(
    corners: &[Point3<f64>; 4],
    (normal, normal_sigma_rad): (Unit<Vector3<f64>>, f64),
) -> Approach {
    let [a, b, c, d] = corners;
    let sides = [((b - a) + (c - d)) * 0.5, ((c - b) + (d - a)) * 0.5];
    let shorter = if sides[0].norm() <= sides[1].norm() { sides[0] } else { sides[1] };
    // In the plane, whatever the corners.
    let within = shorter - normal.into_inner() * shorter.dot(&normal);
    Approach {
        normal,
        normal_sigma_rad: Some(normal_sigma_rad),
        jaw: Unit::new_normalize(within),
        opening_m: within.norm(),
    }
}
