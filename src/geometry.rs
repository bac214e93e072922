//! The conventions' only home: image points, cameras, poses.
//!
//! * Image: x right, y down, pixels; the **centre** of the top-left pixel is (0, 0).
//! * Film: x right, y down, pixels; the top-left **corner** of the top-left pixel is (0, 0).
//! * Camera frame: x right, y down, z forward, metres. Depth is z, not distance along the ray.
//! * World: metres, z up, right-handed. Poses are named `a_from_b` and composed as
//!   `a_from_b * b_from_c`.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// A rigid motion; a value named `a_from_b` takes coordinates in b to coordinates in a.
pub type Pose = Isometry3<f64>;

/// A point in the image plane, in pixels: x right, y down, centre of the top-left pixel at (0, 0).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "[f64; 2]", into = "[f64; 2]")]
pub struct ImagePoint {
    /// Rightwards \[px\].
    pub x: f64,
    /// Downwards \[px\].
    pub y: f64,
}

impl ImagePoint {
    /// A point from its coordinates \[px\].
    pub const fn new(x: f64, y: f64) -> Self {
        Self { x, y }
    }

    /// The image point of film coordinates \[film px\] on a film `oversampling` times finer than
    /// the sensor: pixel corners at integers become pixel centres at integers.
    pub fn from_film(film_x: f64, film_y: f64, oversampling: u32) -> Self {
        let scale = 1.0 / f64::from(oversampling);
        Self { x: film_x * scale - 0.5, y: film_y * scale - 0.5 }
    }

    /// Film coordinates \[film px\] of this point; the inverse of [`ImagePoint::from_film`].
    pub fn to_film(self, oversampling: u32) -> [f64; 2] {
        let scale = f64::from(oversampling);
        [(self.x + 0.5) * scale, (self.y + 0.5) * scale]
    }

    /// Euclidean distance to `other` \[px\].
    pub fn distance_px(self, other: Self) -> f64 {
        (self.x - other.x).hypot(self.y - other.y)
    }
}

impl From<[f64; 2]> for ImagePoint {
    fn from([x, y]: [f64; 2]) -> Self {
        Self { x, y }
    }
}

impl From<ImagePoint> for [f64; 2] {
    fn from(point: ImagePoint) -> Self {
        [point.x, point.y]
    }
}

/// A pinhole camera: image size and intrinsics, in the image convention above.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Columns \[px\].
    pub width: u32,
    /// Rows \[px\].
    pub height: u32,
    /// Focal length along x \[px\].
    pub fx_px: f64,
    /// Focal length along y \[px\].
    pub fy_px: f64,
    /// Principal point, x \[px\]; (width - 1) / 2 when centred.
    pub cx_px: f64,
    /// Principal point, y \[px\]; (height - 1) / 2 when centred.
    pub cy_px: f64,
}

impl Camera {
    /// Projects a point of the camera frame \[m\]; `None` when it is not in front of the camera.
    pub fn project(&self, point: &Point3<f64>) -> Option<ImagePoint> {
        (point.z > 0.0).then(|| ImagePoint {
            x: self.fx_px * point.x / point.z + self.cx_px,
            y: self.fy_px * point.y / point.z + self.cy_px,
        })
    }

    /// The direction of the ray through `point`, in the camera frame, scaled to z = 1.
    pub fn ray(&self, point: ImagePoint) -> Vector3<f64> {
        Vector3::new((point.x - self.cx_px) / self.fx_px, (point.y - self.cy_px) / self.fy_px, 1.0)
    }

    /// The point of the camera frame \[m\] seen at `point` with depth `depth_m` along the axis.
    pub fn unproject(&self, point: ImagePoint, depth_m: f64) -> Point3<f64> {
        Point3::from(self.ray(point) * depth_m)
    }

    /// Whether `point` lies on the sensor, pixel areas included.
    pub fn contains(&self, point: ImagePoint) -> bool {
        (-0.5..f64::from(self.width) - 0.5).contains(&point.x)
            && (-0.5..f64::from(self.height) - 0.5).contains(&point.y)
    }
}

/// A pose as it stands in files: the upper three rows of the homogeneous matrix, row-major.
pub type PoseRows = [[f64; 4]; 3];

/// The pose of matrix rows; `None` when they are not a proper rotation (to 1e-9) and translation.
pub fn pose_from_rows(rows: &PoseRows) -> Option<Pose> {
    let matrix = Matrix3::from_fn(|row, column| rows[row][column]);
    let is_rotation = (matrix * matrix.transpose() - Matrix3::identity()).amax() < 1e-9
        && (matrix.determinant() - 1.0).abs() < 1e-9;
    let translation = Vector3::new(rows[0][3], rows[1][3], rows[2][3]);
    (is_rotation && translation.iter().all(|value| value.is_finite())).then(|| {
        Isometry3::from_parts(
            Translation3::from(translation),
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix)),
        )
    })
}

/// Intersection of the diagonals p0-p2 and p1-p3 of a quadrilateral; `None` when they are parallel.
pub fn diagonal_intersection(corners: &[ImagePoint; 4]) -> Option<ImagePoint> {
    let homogeneous = |p: ImagePoint| Vector3::new(p.x, p.y, 1.0);
    let [p0, p1, p2, p3] = corners.map(homogeneous);
    let meeting = p0.cross(&p2).cross(&p1.cross(&p3));
    (meeting.z.abs() > 1e-12 * meeting.xy().norm().max(1.0))
        .then(|| ImagePoint::new(meeting.x / meeting.z, meeting.y / meeting.z))
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera =
        Camera { width: 512, height: 512, fx_px: 470.0, fy_px: 470.0, cx_px: 255.5, cy_px: 255.5 };

    #[test]
    fn the_optical_axis_meets_the_middle_of_the_sensor_between_four_pixels() {
        let point = CAMERA.project(&Point3::new(0.0, 0.0, 2.0)).expect("in front");
        assert_eq!(point, ImagePoint::new(255.5, 255.5));
    }

    #[test]
    fn right_and_down_in_the_camera_are_right_and_down_in_the_image() {
        let point = CAMERA.project(&Point3::new(0.1, 0.2, 1.0)).expect("in front");
        assert!((point.x - 302.5).abs() < 1e-12);
        assert!((point.y - 349.5).abs() < 1e-12);
    }

    #[test]
    fn a_point_behind_the_camera_has_no_image() {
        assert_eq!(CAMERA.project(&Point3::new(0.0, 0.0, -1.0)), None);
        assert_eq!(CAMERA.project(&Point3::new(0.0, 0.0, 0.0)), None);
    }

    #[test]
    fn the_top_left_film_corner_is_half_a_pixel_outside_the_first_centre() {
        assert_eq!(ImagePoint::from_film(0.0, 0.0, 4), ImagePoint::new(-0.5, -0.5));
        assert_eq!(ImagePoint::from_film(2.0, 6.0, 4), ImagePoint::new(0.0, 1.0));
        let [x, y] = ImagePoint::new(0.0, 1.0).to_film(4);
        assert_eq!(ImagePoint::new(x, y), ImagePoint::new(2.0, 6.0));
    }

    #[test]
    fn a_mirrored_matrix_is_not_a_pose() {
        let mirrored = [[-1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        assert!(pose_from_rows(&mirrored).is_none());
    }

    #[test]
    fn diagonals_of_a_trapezium_meet_nearer_the_short_side() {
        let corners = [[0.0, 0.0], [4.0, 0.0], [3.0, 2.0], [1.0, 2.0]].map(ImagePoint::from);
        let centre = diagonal_intersection(&corners).expect("convex");
        assert!((centre.x - 2.0).abs() < 1e-12);
        assert!((centre.y - 4.0 / 3.0).abs() < 1e-12);
    }
}
