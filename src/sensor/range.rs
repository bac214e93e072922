//! The range sensor: a coarse grid of three-dimensional points.

use nalgebra::Point3;

use crate::geometry::{Camera, ImagePoint, Pose};
use crate::image::Plane;
use crate::sensor::Rig;

/// What an XYZ range sensor returns: one point per cell, in its own frame \[m\]. z is depth along its
/// axis; the distance along a ray is never called depth.
#[derive(Clone, Debug, PartialEq)]
pub struct RangeImage {
    /// The sensor's pinhole; cell (x, y) looks along the ray through [`ImagePoint`] (x, y).
    pub camera: Camera,
    /// Where it stands.
    pub world_from_range: Pose,
    /// The point that each cell tells; `None` where it tells nothing.
    pub points: Plane<Option<Point3<f64>>>,
    /// What a data sheet says of its noise.
    pub noise: DepthNoise,
}

/// What a data sheet says of the noise in a range image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DepthNoise {
    /// Standard deviation of depth: this \[m\],
    pub noise_m: f64,
    /// and this share of the depth,
    pub noise_share: f64,
    /// and this times the square of the depth \[1/m\].
    pub noise_per_m: f64,
    /// Steps of depth \[m\]; 0: none.
    pub quantum_m: f64,
    /// Steps of the inverse of depth \[1/m\]; 0: none.
    pub inverse_quantum_per_m: f64,
}

impl DepthNoise {
    /// Standard deviation of a depth, without the steps \[m\].
    pub fn standard_deviation_m(&self, depth_m: f64) -> f64 {
        self.noise_m + self.noise_share * depth_m + self.noise_per_m * depth_m * depth_m
    }
}

impl RangeImage {
    /// One of a single cell that tells nothing.
    pub fn blind() -> Self {
        Self {
            camera: Camera::pinhole(1, 1, 1.0),
            world_from_range: Pose::identity(),
            points: Plane::filled(1, 1, None),
            noise: DepthNoise::default(),
        }
    }

    /// The cell whose ray is nearest in direction to the ray through `point` of the colour camera,
    /// clamped to the grid; `None` for a ray that goes backwards, and of a grid without cells.
    pub fn nearest_cell(&self, rig: &Rig, point: ImagePoint) -> Option<(usize, usize)> {
        let range_from_camera =
            self.world_from_range.rotation.inverse() * rig.world_from_camera.rotation;
        let ray = range_from_camera * rig.camera.ray(point);
        let cell = self.camera.project(&Point3::from(ray))?;
        let (width, height) = (self.points.width(), self.points.height());
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            clippy::cast_precision_loss,
            reason = "clamped to the grid first"
        )]
        let index = |cell: f64, count: usize| cell.round().clamp(0.0, (count - 1) as f64) as usize;
        (width > 0 && height > 0).then(|| (index(cell.x, width), index(cell.y, height)))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};

    use super::*;

    const COLOUR: Camera = Camera::pinhole(512, 512, 480.0);
    const RANGE: Camera = Camera::pinhole(32, 32, 30.0);

    fn nearest(turn: f64, x: f64, y: f64) -> Option<(usize, usize)> {
        let pose = Isometry3::rotation(Vector3::new(0.3, 0.2, 0.1));
        let rig = Rig { camera: COLOUR, world_from_camera: pose, object_size_m: None };
        let range = RangeImage {
            camera: RANGE,
            // Its place does not matter, only where it looks.
            world_from_range: Isometry3::translation(1.0, 2.0, 3.0)
                * pose
                * Isometry3::rotation(Vector3::y() * turn),
            points: Plane::filled(32, 32, None),
            noise: DepthNoise::default(),
        };
        range.nearest_cell(&rig, ImagePoint::new(x, y))
    }

    #[test]
    fn the_nearest_cell_covers_its_sixteen_pixels() {
        assert_eq!(nearest(0.0, 0.0, 0.0), Some((0, 0)));
        assert_eq!(nearest(0.0, 15.4, 15.6), Some((0, 1)));
        assert_eq!(nearest(0.0, 511.0, 900.0), Some((31, 31)));
    }

    #[test]
    fn a_sensor_that_looks_to_the_right_sees_the_middle_on_its_left() {
        // tan(0.2) * 30 cells = 6.08 cells left of the middle, at 15.5.
        assert_eq!(nearest(0.2, 255.5, 255.4), Some((9, 15)));
        assert_eq!(nearest(3.0, 255.5, 255.5), None, "it looks backwards");
    }
}
