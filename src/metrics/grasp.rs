//! How far a grasp is from the centre of the face it is meant for, and how it is turned; how far a cuboid's pose is off.

use geo::{Area, BooleanOps, Coord, LineString, Polygon};
use nalgebra::{Point3, Vector3};

use crate::geometry::{Camera, ImagePoint, Pose};
use crate::grasp::{Approach, Grasp, pose::CuboidPose};
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
    /// Part along the face's outward normal, positive when in front of the face \[mm\].
    pub normal_mm: f64,
    /// Part in the face \[mm\].
    pub in_face_mm: f64,
    /// Its square over the covariance that the method says: 3 on average where that is right.
    pub nees: Option<f64>,
}

/// How an approach is off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ApproachError {
    /// Between the normals \[deg\].
    pub normal_deg: f64,
    /// Between the jaws' direction and the shorter side of the face, or its opposite; either side of a square \[deg\].
    pub jaw_deg: f64,
    /// Of the opening, positive when too wide \[mm\].
    pub opening_mm: f64,
}

/// How far a pose is off: over the cuboid's vertices, of all of its rotations that leave it the same the best.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseError {
    /// Mean distance of the vertices, ADD (Hinterstoisser et al. 2012) \[mm\].
    pub add_mm: f64,
    /// Mean distance of each from the nearest, ADD-S \[mm\].
    pub add_s_mm: f64,
    /// Largest distance, MSSD (Hodan et al., BOP challenge 2020) \[mm\].
    pub mssd_mm: f64,
    /// The same in the image, MSPD \[px\].
    pub mspd_px: f64,
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

/// The error of a grasp against the centre of a true face.
pub fn grasp_error(grasp: &Grasp, face: &TrueFace, world_from_camera: &Pose) -> GraspError {
    let centre = world_from_camera.inverse_transform_point(&Point3::from(face.centre_m));
    let difference = grasp.point_in_camera - centre;
    let normal = world_from_camera.inverse_transform_vector(&Vector3::from(face.normal));
    let along = difference.dot(&normal);
    let information = grasp.covariance_m2.and_then(|covariance| covariance.try_inverse());
    GraspError {
        distance_mm: 1e3 * difference.norm(),
        axial_mm: 1e3 * difference.z,
        lateral_mm: 1e3 * difference.xy().norm(),
        normal_mm: 1e3 * along,
        in_face_mm: 1e3 * (difference - normal * along).norm(),
        nees: information.map(|over| (difference.transpose() * over * difference)[(0, 0)]),
    }
}

/// The error of an approach against a true face.
pub fn approach_error(
    approach: &Approach,
    face: &TrueFace,
    truth: &Truth,
    world_from_camera: &Pose,
) -> ApproachError {
    let normal = world_from_camera * approach.normal.into_inner();
    let jaw = world_from_camera * approach.jaw.into_inner();
    let vertex = |corner: usize| Vector3::from(truth.corners[face.corners[corner]].position_m);
    let sides = [vertex(1) - vertex(0), vertex(3) - vertex(0)];
    let shortest = sides[0].norm().min(sides[1].norm());
    let between = |side: &Vector3<f64>| {
        let angle = jaw.angle(side);
        angle.min(std::f64::consts::PI - angle)
    };
    let shorter = sides.iter().filter(|side| side.norm() < shortest * (1.0 + 1e-6));
    ApproachError {
        normal_deg: normal.angle(&Vector3::from(face.normal)).to_degrees(),
        jaw_deg: shorter.map(between).fold(f64::INFINITY, f64::min).to_degrees(),
        opening_mm: 1e3 * (approach.opening_m - shortest),
    }
}

/// The error of a pose against the vertices of the true cuboid in the camera frame \[m\], numbered as a pose's are; None
/// where the pose is of another size, or lies behind the camera.
pub fn pose_error(
    pose: &CuboidPose,
    truth: &[Point3<f64>; 8],
    camera: &Camera,
) -> Option<PoseError> {
    let found: [Point3<f64>; 8] = std::array::from_fn(|vertex| pose.vertex(vertex));
    let size_of =
        |vertices: &[Point3<f64>; 8]| [1, 2, 4].map(|end| (vertices[end] - vertices[0]).norm());
    let (own, true_size) = (size_of(&found), size_of(truth));
    let in_image = |points: &[Point3<f64>; 8]| -> Option<Vec<ImagePoint>> {
        points.iter().map(|point| camera.project(point)).collect()
    };
    let (found_px, true_px) = (in_image(&found)?, in_image(truth)?);
    let mut best: Option<PoseError> = None;
    let mut keep = |value: PoseError| {
        let least = best.get_or_insert(value);
        least.add_mm = least.add_mm.min(value.add_mm);
        least.mssd_mm = least.mssd_mm.min(value.mssd_mm);
        least.mspd_px = least.mspd_px.min(value.mspd_px);
    };
    let nearest_mm = |point: &Point3<f64>| {
        let all = found.iter().map(|other| 1e3 * (other - point).norm());
        all.fold(f64::INFINITY, f64::min)
    };
    let add_s_mm = truth.iter().map(nearest_mm).sum::<f64>() / 8.0;
    for (axes, flipped) in rotations() {
        let is_same = |axis: usize| (own[axes[axis]] / true_size[axis] - 1.0).abs() < 1e-6;
        if !(0..3).all(is_same) {
            continue;
        }
        let image_of = |vertex: usize| -> usize {
            (0..3).map(|axis| ((vertex >> axis & 1) ^ (flipped >> axis & 1)) << axes[axis]).sum()
        };
        let distances_mm =
            (0..8).map(|vertex| 1e3 * (found[image_of(vertex)] - truth[vertex]).norm());
        let distances_px =
            (0..8).map(|vertex| found_px[image_of(vertex)].distance_px(true_px[vertex]));
        keep(PoseError {
            add_mm: distances_mm.clone().sum::<f64>() / 8.0,
            add_s_mm,
            mssd_mm: distances_mm.fold(0.0, f64::max),
            mspd_px: distances_px.fold(0.0, f64::max),
        });
    }
    best
}

/// The 24 rotations of a cube: for each axis the one that it becomes, and as bits which are turned about.
fn rotations() -> impl Iterator<Item = ([usize; 3], usize)> {
    const ORDERS: [([usize; 3], bool); 6] = [
        ([0, 1, 2], true),
        ([1, 2, 0], true),
        ([2, 0, 1], true),
        ([0, 2, 1], false),
        ([2, 1, 0], false),
        ([1, 0, 2], false),
    ];
    ORDERS.into_iter().flat_map(|(axes, is_even)| {
        let is_proper = move |flipped: &usize| flipped.count_ones().is_multiple_of(2) == is_even;
        (0..8).filter(is_proper).map(move |flipped| (axes, flipped))
    })
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
        let grasp = Grasp {
            image_point: ImagePoint::new(0.0, 0.0),
            point_in_camera: Point3::new(0.003, 0.004, 1.002),
            point_in_world: Point3::origin(),
            approach: None,
            covariance_m2: Some(nalgebra::Matrix3::identity() * 1e-6),
            pose: None,
        };
        let error = grasp_error(&grasp, &face, &pose);
        // Too far is below the face, which looks up.
        assert!((error.normal_mm + 2.0).abs() < 1e-9, "{error:?}");
        assert!((error.in_face_mm - 5.0).abs() < 1e-9, "{error:?}");
        assert!((error.nees.expect("a covariance") - 29.0).abs() < 1e-9, "{error:?}");
        assert!((error.axial_mm - 2.0).abs() < 1e-9, "{error:?}");
        assert!((error.lateral_mm - 5.0).abs() < 1e-9, "{error:?}");
        assert!((error.distance_mm - 29.0_f64.sqrt()).abs() < 1e-9, "{error:?}");
    }

    fn cuboid(size_m: [f64; 3], turn: Vector3<f64>) -> CuboidPose {
        CuboidPose {
            camera_from_cuboid: Isometry3::new(Vector3::new(0.1, 0.0, 0.8), turn),
            size_m,
            covariance: nalgebra::Matrix6::identity(),
            chi_square: 0.0,
            rmse_px: 0.0,
        }
    }

    const CAMERA: Camera = Camera {
        width: 512,
        height: 512,
        fx_px: 500.0,
        fy_px: 500.0,
        cx_px: 255.5,
        cy_px: 255.5,
        distortion: crate::geometry::Distortion::NONE,
    };

    #[test]
    fn rotations_that_leave_a_cuboid_the_same_are_no_error() {
        let turn = Vector3::new(0.4, -0.3, 0.2);
        let half = std::f64::consts::FRAC_PI_2;
        for (size_m, quarter_about_z, same) in [
            ([0.06, 0.09, 0.14], 2.0, true),
            ([0.06, 0.09, 0.14], 1.0, false),
            ([0.09, 0.09, 0.14], 1.0, true),
            ([0.1, 0.1, 0.1], 3.0, true),
        ] {
            let one = cuboid(size_m, turn);
            let truth: [Point3<f64>; 8] = std::array::from_fn(|vertex| one.vertex(vertex));
            let about_z =
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), quarter_about_z * half);
            let turned = CuboidPose { camera_from_cuboid: one.camera_from_cuboid * about_z, ..one };
            let error = pose_error(&turned, &truth, &CAMERA).expect("an error");
            assert_eq!(error.mssd_mm < 1e-9 && error.add_mm < 1e-9, same, "{size_m:?}: {error:?}");
            assert_eq!(
                error.mspd_px < 1e-9 && error.add_s_mm < 1e-9,
                same,
                "{size_m:?}: {error:?}"
            );
        }
        // The same cuboid whose axes have other names.
        let one = cuboid([0.06, 0.09, 0.14], turn);
        let truth: [Point3<f64>; 8] = std::array::from_fn(|vertex| one.vertex(vertex));
        let renamed = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), half);
        let other = CuboidPose {
            camera_from_cuboid: one.camera_from_cuboid * renamed,
            size_m: [0.09, 0.06, 0.14],
            ..one
        };
        assert!(pose_error(&other, &truth, &CAMERA).expect("an error").mssd_mm < 1e-9);
        let larger = CuboidPose { size_m: [0.07, 0.09, 0.14], ..one };
        assert_eq!(pose_error(&larger, &truth, &CAMERA), None);
    }

    #[test]
    fn a_shift_is_all_of_every_distance() {
        let one = cuboid([0.06, 0.09, 0.14], Vector3::new(0.4, -0.3, 0.2));
        let truth: [Point3<f64>; 8] = std::array::from_fn(|vertex| one.vertex(vertex));
        let mut moved = one;
        moved.camera_from_cuboid.translation.vector += Vector3::new(0.0, 0.003, 0.0);
        let error = pose_error(&moved, &truth, &CAMERA).expect("an error");
        for value in [error.add_mm, error.add_s_mm, error.mssd_mm] {
            assert!((value - 3.0).abs() < 1e-9, "{error:?}");
        }
        // At the nearest vertex.
        let nearest = truth.iter().map(|point| point.z).fold(f64::INFINITY, f64::min);
        assert!((error.mspd_px - 500.0 * 0.003 / nearest).abs() < 1e-9, "{error:?}");
    }

    #[test]
    fn there_are_24_rotations_and_each_is_another() {
        let all: std::collections::HashSet<_> = rotations().collect();
        assert_eq!(all.len(), 24);
    }

    #[test]
    fn no_rotation_is_a_mirror() {
        for (axes, flipped) in rotations() {
            let mut turn = nalgebra::Matrix3::<f64>::zeros();
            for (axis, to) in axes.into_iter().enumerate() {
                turn[(to, axis)] = if flipped >> axis & 1 == 0 { 1.0 } else { -1.0 };
            }
            assert!((turn.determinant() - 1.0).abs() < 1e-12, "{axes:?} {flipped:03b}");
        }
    }
}
