//! How far a grasp point is from the centre of the face it is meant for.

use geo::{Area, BooleanOps, Coord, LineString, Polygon};
use nalgebra::Point3;

use crate::geometry::{ImagePoint, Pose};
use crate::scene::{TrueFace, Truth};

/// Overlap from which a quadrilateral is said to cover a true face.
const COVERING_OVERLAP: f64 = 0.5;

/// A grasp point's error, in the camera frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GraspError {
    /// Distance from the true face's centre \[mm\].
    pub distance_mm: f64,
    /// Part along the optical axis, positive when too far \[mm\].
    pub axial_mm: f64,
    /// Part across the optical axis \[mm\].
    pub lateral_mm: f64,
}

/// The true face that a quadrilateral covers: the one that faces the camera and overlaps it most,
/// by intersection over union, at least half; `None` where no face does.
pub fn covered_face<'a>(truth: &'a Truth, corners: &[ImagePoint; 4]) -> Option<&'a TrueFace> {
    let quadrilateral = polygon(corners);
    truth
        .faces
        .iter()
        .filter(|face| face.facing)
        .map(|face| {
            let true_face = polygon(&truth.face_corners(face));
            let shared = quadrilateral.intersection(&true_face).unsigned_area();
            let either = quadrilateral.unsigned_area() + true_face.unsigned_area() - shared;
            (if either > 0.0 { shared / either } else { 0.0 }, face)
        })
        .filter(|(overlap, _)| *overlap >= COVERING_OVERLAP)
        .max_by(|(a, _), (b, _)| a.total_cmp(b))
        .map(|(_, face)| face)
}

/// The error of a grasp point in the camera frame \[m\] against the centre of a true face.
pub fn grasp_error(
    point_in_camera: &Point3<f64>,
    face: &TrueFace,
    world_from_camera: &Pose,
) -> GraspError {
    let centre = world_from_camera.inverse_transform_point(&Point3::from(face.centre_m));
    let difference = (point_in_camera - centre) * 1e3;
    GraspError {
        distance_mm: difference.norm(),
        axial_mm: difference.z,
        lateral_mm: difference.xy().norm(),
    }
}

fn polygon(corners: &[ImagePoint; 4]) -> Polygon<f64> {
    let ring = corners.iter().map(|point| Coord { x: point.x, y: point.y }).collect();
    Polygon::new(LineString(ring), Vec::new())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

    #[test]
    fn error_along_the_axis_is_positive_when_the_point_is_too_far() {
        // A camera at (0, 0, 1) that faces down, the face's centre at the origin.
        let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let pose = Isometry3::from_parts(Translation3::new(0.0, 0.0, 1.0), half_turn);
        let face = TrueFace {
            index: 5,
            name: "z+".into(),
            corners: [4, 5, 7, 6],
            facing: true,
            visible_fraction: 1.0,
            centre_m: [0.0, 0.0, 0.0],
            centre_image_point_px: ImagePoint::new(0.0, 0.0),
            normal: [0.0, 0.0, 1.0],
            extent_m: [0.1, 0.1],
        };
        let error = grasp_error(&Point3::new(0.003, 0.004, 1.002), &face, &pose);
        assert!((error.axial_mm - 2.0).abs() < 1e-9, "{error:?}");
        assert!((error.lateral_mm - 5.0).abs() < 1e-9, "{error:?}");
        assert!((error.distance_mm - 29.0_f64.sqrt()).abs() < 1e-9, "{error:?}");
    }
}
