//! The conventions' only home: image points, cameras, poses.
//!
//! * Image: x right, y down, pixels; the **centre** of the top-left pixel is (0, 0).
//! * Film: x right, y down, pixels; the top-left **corner** of the top-left pixel is (0, 0).
//! * Camera frame: x right, y down, z forward, metres. Depth is z, not distance along the ray.
//! * World: metres, z up, right-handed. Poses are named `a_from_b` and composed as
//!   `a_from_b * b_from_c`.

mod origin;

use nalgebra::{
    Isometry3, Matrix2, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use origin::{Origin, shift_words};

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

/// How a lens bends straight lines: on the plane at z = 1, a point (x, y) at distance r from the axis
/// is seen at
///
/// x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and likewise
/// y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y
///
/// Brown (1966), Decentering distortion of lenses, in the order of coefficients of OpenCV.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Distortion {
    /// Radial, of r^2; below zero: a barrel.
    #[schemars(range(min = -10.0, max = 10.0))]
    pub k1: f64,
    /// Radial, of r^4.
    #[schemars(range(min = -100.0, max = 100.0))]
    pub k2: f64,
    /// Tangential, along y.
    #[schemars(range(min = -1.0, max = 1.0))]
    pub p1: f64,
    /// Tangential, along x.
    #[schemars(range(min = -1.0, max = 1.0))]
    pub p2: f64,
    /// Radial, of r^6.
    #[schemars(range(min = -1000.0, max = 1000.0))]
    pub k3: f64,
}

impl Distortion {
    /// A lens that does not distort.
    pub const NONE: Self = Self { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 };

    /// Whether straight lines stay straight.
    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }

    /// Where the point (x, y) at z = 1 is seen.
    pub fn distort(&self, point: Vector2<f64>) -> Vector2<f64> {
        let (x, y) = (point.x, point.y);
        let square = x * x + y * y;
        let radial = 1.0 + square * (self.k1 + square * (self.k2 + square * self.k3));
        Vector2::new(
            x * radial + 2.0 * self.p1 * x * y + self.p2 * (square + 2.0 * x * x),
            y * radial + self.p1 * (square + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        )
    }

    /// Derivatives of [`Self::distort`] by x and by y, column by column.
    pub fn jacobian(&self, point: Vector2<f64>) -> Matrix2<f64> {
        let (x, y) = (point.x, point.y);
        let square = x * x + y * y;
        let radial = 1.0 + square * (self.k1 + square * (self.k2 + square * self.k3));
        // Twice the derivative by the square of the radius.
        let slope = 2.0 * (self.k1 + square * (2.0 * self.k2 + square * 3.0 * self.k3));
        let mixed = x * y * slope + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        Matrix2::new(
            radial + x * x * slope + 2.0 * self.p1 * y + 6.0 * self.p2 * x,
            mixed,
            mixed,
            radial + y * y * slope + 6.0 * self.p1 * y + 2.0 * self.p2 * x,
        )
    }

    /// The point at z = 1 that is seen at (x, y), by Newton's method; `None` where the lens folds the
    /// image, so that none or more than one is.
    pub fn undistort(&self, seen: Vector2<f64>) -> Option<Vector2<f64>> {
        let mut point = seen;
        for _ in 0..30 {
            let jacobian = self.jacobian(point);
            if jacobian.determinant() <= 1e-3 {
                return None;
            }
            let step = jacobian.try_inverse()? * (self.distort(point) - seen);
            point -= step;
            if step.norm() < 1e-14 * (1.0 + point.norm()) {
                break;
            }
        }
        let is_found = (self.distort(point) - seen).norm() < 1e-10 * (1.0 + seen.norm());
        (is_found && self.jacobian(point).determinant() > 1e-3).then_some(point)
    }
}

/// A camera: image size, intrinsics and distortion, in the image convention above.
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
    /// How its lens bends straight lines.
    #[serde(default, skip_serializing_if = "Distortion::is_none")]
    pub distortion: Distortion,
}

impl Camera {
    /// One of square pixels without distortion, its principal point in the middle; lengths in pixels.
    #[allow(clippy::cast_lossless, reason = "From is not const")]
    pub const fn pinhole(width: u32, height: u32, focal_px: f64) -> Self {
        Self {
            width,
            height,
            fx_px: focal_px,
            fy_px: focal_px,
            cx_px: 0.5 * (width as f64 - 1.0),
            cy_px: 0.5 * (height as f64 - 1.0),
            distortion: Distortion::NONE,
        }
    }

    /// Projects a point of the camera frame \[m\]; `None` when it is not in front of the camera.
    pub fn project(&self, point: &Point3<f64>) -> Option<ImagePoint> {
        (point.z > 0.0).then(|| {
            let seen = self.distortion.distort(Vector2::new(point.x, point.y) / point.z);
            ImagePoint::new(self.fx_px * seen.x + self.cx_px, self.fy_px * seen.y + self.cy_px)
        })
    }

    /// The direction of the ray through `point`, in the camera frame, scaled to z = 1; where the lens
    /// folds the image, as if it did not distort.
    pub fn ray(&self, point: ImagePoint) -> Vector3<f64> {
        let seen =
            Vector2::new((point.x - self.cx_px) / self.fx_px, (point.y - self.cy_px) / self.fy_px);
        if self.distortion.is_none() {
            return seen.push(1.0);
        }
        self.distortion.undistort(seen).unwrap_or(seen).push(1.0)
    }

    /// Whether each point of the sensor, and of a margin of two pixels, is the image of one ray.
    pub fn is_one_to_one(&self) -> bool {
        const STEPS: u32 = 64;
        let along = |step: u32, count: u32| {
            -2.5 + f64::from(step) / f64::from(STEPS) * (f64::from(count) + 4.0)
        };
        let seen = |x: f64, y: f64| {
            Vector2::new((x - self.cx_px) / self.fx_px, (y - self.cy_px) / self.fy_px)
        };
        (0..=STEPS).all(|row| {
            (0..=STEPS).all(|column| {
                let point = seen(along(column, self.width), along(row, self.height));
                self.distortion.undistort(point).is_some()
            })
        })
    }

    /// The point of the camera frame \[m\] seen at `point` with depth `depth_m` along the axis.
    pub fn unproject(&self, point: ImagePoint, depth_m: f64) -> Point3<f64> {
        Point3::from(self.ray(point) * depth_m)
    }

    /// The camera with the same field of view and another number of pixels across and down.
    #[must_use]
    pub fn resized(&self, [width, height]: [usize; 2]) -> Self {
        let scale = [width as f64 / f64::from(self.width), height as f64 / f64::from(self.height)];
        Self {
            width: u32::try_from(width).unwrap_or(u32::MAX),
            height: u32::try_from(height).unwrap_or(u32::MAX),
            fx_px: self.fx_px * scale[0],
            fy_px: self.fy_px * scale[1],
            cx_px: (self.cx_px + 0.5) * scale[0] - 0.5,
            cy_px: (self.cy_px + 0.5) * scale[1] - 0.5,
            distortion: self.distortion,
        }
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

/// Area of a polygon \[px^2\], positive where its corners run clockwise as seen (shoelace formula).
pub fn signed_area_px2(corners: &[ImagePoint]) -> f64 {
    let next = corners.iter().cycle().skip(1);
    0.5 * corners.iter().zip(next).map(|(a, b)| a.x * b.y - b.x * a.y).sum::<f64>()
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

    const CAMERA: Camera = Camera::pinhole(512, 512, 470.0);
    const BENT: Distortion = Distortion { k1: -0.21, k2: 0.08, p1: 0.002, p2: -0.003, k3: -0.01 };

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
    fn a_lens_bends_as_opencv_says() {
        // cv2.projectPoints (OpenCV 5.0.0) of (0.3, -0.2, 1) with these coefficients and intrinsics.
        let camera = Camera { distortion: BENT, ..CAMERA };
        let point = camera.project(&Point3::new(0.3, -0.2, 1.0)).expect("in front");
        assert!((point.x - 392.288_334_23).abs() < 1e-6, "{point:?}");
        assert!((point.y - 164.307_777_18).abs() < 1e-6, "{point:?}");
    }

    #[test]
    fn undistorting_undoes_distorting() {
        for (x, y) in [(0.0, 0.0), (0.5, -0.4), (-0.6, 0.6), (0.01, 0.55)] {
            let point = Vector2::new(x, y);
            let back = BENT.undistort(BENT.distort(point)).expect("one to one");
            assert!((back - point).norm() < 1e-13, "{point:?} {back:?}");
            let step = 1e-6;
            for (axis, column) in [Vector2::x(), Vector2::y()].into_iter().zip(0..) {
                let ahead = BENT.distort(point + step * axis);
                let slope = (ahead - BENT.distort(point - step * axis)) / (2.0 * step);
                assert!((slope - BENT.jacobian(point).column(column)).norm() < 1e-8);
            }
        }
    }

    #[test]
    fn a_lens_that_folds_the_image_is_told_from_one_that_does_not() {
        let with = |k1| Camera { distortion: Distortion { k1, ..Distortion::NONE }, ..CAMERA };
        assert!(with(-0.2).is_one_to_one());
        // Its farthest point is seen 0.70 from the axis, the frame's corners are 0.78 from it.
        assert!(!with(-0.3).is_one_to_one());
        assert!(with(2.0).is_one_to_one());
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
