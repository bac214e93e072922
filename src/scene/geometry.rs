//! Geometry buffers: what single rays meet, never averaged.

use nalgebra::Point3;

use crate::geometry::ImagePoint;
use crate::image::Plane;

/// The face id of what is not the target.
pub const NO_FACE: u32 = 255;

/// The first id of floor and walls; other objects' are less, and that of nothing is 0.
const FIRST_OF_ROOM: u32 = 100;

/// What kind of object a ray meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Surface {
    /// The target.
    Target,
    /// Another object.
    Object,
    /// Floor, wall, or nothing.
    Background,
}

/// What the ray through each pixel's centre meets first.
#[derive(Clone, Debug)]
pub struct Geometry {
    /// Depth along the optical axis \[m\]; 0 where nothing was met.
    pub depth_m: Plane<f32>,
    /// The object's id; 0 where nothing was met.
    pub object_id: Plane<u32>,
    /// The face of the target, or [`NO_FACE`].
    pub face_id: Plane<u32>,
}

/// What the range sensor's rays meet.
#[derive(Clone, Debug)]
pub struct RangeRays {
    /// Of the ray through each cell's centre: the point in the sensor's frame \[m\]; `None` where nothing.
    pub points: Plane<Option<Point3<f64>>>,
    /// Of rays through the middles of equal parts of each cell: depth along the sensor's axis \[m\]; 0
    /// where nothing was met.
    pub depth_m: Plane<f32>,
}

impl Geometry {
    /// What is at a point of the image \[px\]: in the pixel that it lies in, or the nearest one.
    pub fn surface_at(&self, point: ImagePoint, target_id: u32) -> Surface {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        let nearest = |place: f64, count: usize| (place.round().max(0.0) as usize).min(count - 1);
        let (width, height) = (self.object_id.width(), self.object_id.height());
        if width == 0 || height == 0 {
            return Surface::Background;
        }
        match self.object_id.at(nearest(point.x, width), nearest(point.y, height)) {
            0 => Surface::Background,
            id if id == target_id => Surface::Target,
            id if id >= FIRST_OF_ROOM => Surface::Background,
            _ => Surface::Object,
        }
    }
}
