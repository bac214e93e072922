//! Geometry buffers: what single rays meet, never averaged.

use nalgebra::Point3;

use crate::image::Plane;

/// The face id of what is not the target.
pub const NO_FACE: u32 = 255;

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
