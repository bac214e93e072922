//! Geometry buffers: one ray through each pixel's centre, never averaged.

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
