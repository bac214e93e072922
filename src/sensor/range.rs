//! The range sensor: a coarse grid of three-dimensional points.

use nalgebra::Point3;

use crate::geometry::{Camera, ImagePoint};
use crate::image::Plane;

/// What an XYZ range sensor returns: one point per cell, in its own camera frame \[m\].
#[derive(Clone, Debug, PartialEq)]
pub struct RangeImage {
    /// The sensor's pinhole; cell (x, y) looks along the ray through [`ImagePoint`] (x, y).
    pub camera: Camera,
    /// The point seen by each cell; `None` where the ray met nothing.
    pub points: Plane<Option<Point3<f64>>>,
}

impl RangeImage {
    /// The cell whose ray is nearest to the direction of `point` of a `colour` camera that shares
    /// this sensor's pose, clamped to the grid.
    pub fn nearest_cell(&self, colour: &Camera, point: ImagePoint) -> (usize, usize) {
        let ray = colour.ray(point);
        let cell_x = self.camera.fx_px * ray.x + self.camera.cx_px;
        let cell_y = self.camera.fy_px * ray.y + self.camera.cy_px;
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            clippy::cast_precision_loss,
            reason = "clamped to the grid first"
        )]
        let index = |cell: f64, count: usize| cell.round().clamp(0.0, (count - 1) as f64) as usize;
        (index(cell_x, self.points.width()), index(cell_y, self.points.height()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_cell_covers_its_sixteen_pixels() {
        let colour = Camera {
            width: 512,
            height: 512,
            fx_px: 480.0,
            fy_px: 480.0,
            cx_px: 255.5,
            cy_px: 255.5,
        };
        let camera =
            Camera { width: 32, height: 32, fx_px: 30.0, fy_px: 30.0, cx_px: 15.5, cy_px: 15.5 };
        let range = RangeImage { camera, points: Plane::filled(32, 32, None) };
        assert_eq!(range.nearest_cell(&colour, ImagePoint::new(0.0, 0.0)), (0, 0));
        assert_eq!(range.nearest_cell(&colour, ImagePoint::new(15.4, 15.6)), (0, 1));
        assert_eq!(range.nearest_cell(&colour, ImagePoint::new(511.0, 900.0)), (31, 31));
    }
}
