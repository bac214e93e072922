//! From refined corners to the face to grasp and the point on it.

use nalgebra::Point3;

use crate::geometry::ImagePoint;
use crate::refine::Corner;
use crate::registry::Entry;
use crate::sensor::{Exposure, RangeImage, Rig};
use crate::target::TargetRegion;

pub mod cell_at_corner_mean;
pub mod least_occluded;

/// A face of the target as it was recognised in the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Its corners \[px\], clockwise as seen (x right, y down).
    pub corners: [ImagePoint; 4],
    /// Share of its pixels that are not the target's, in \[0, 1\].
    pub gap_fraction: f64,
}

/// Why no face was chosen; counted, never dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoFace {
    /// Fewer than four corners.
    TooFewCorners,
    /// No four corners bound a face with small or no gaps.
    AllOccluded,
}

impl NoFace {
    /// The name used in records.
    pub fn name(self) -> &'static str {
        match self {
            Self::TooFewCorners => "too_few_corners",
            Self::AllOccluded => "all_occluded",
        }
    }
}

/// Chooses the face to grasp.
pub trait FaceSelector: Send + Sync {
    /// Returns the face, or why there is none.
    ///
    /// # Errors
    /// [`NoFace`], a counted status.
    fn select(
        &self,
        exposure: &Exposure,
        region: &TargetRegion,
        corners: &[Corner],
    ) -> Result<Face, NoFace>;
}

/// A point to grasp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grasp {
    /// The image point that was looked up \[px\].
    pub image_point: ImagePoint,
    /// The grasp point in the camera frame \[m\].
    pub point_in_camera: Point3<f64>,
    /// The grasp point in the world \[m\].
    pub point_in_world: Point3<f64>,
}

/// Why there is no grasp point; counted, never dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoGrasp {
    /// The range sensor saw nothing there.
    NoRange,
}

impl NoGrasp {
    /// The name used in records.
    pub fn name(self) -> &'static str {
        match self {
            Self::NoRange => "no_range",
        }
    }
}

/// Computes a grasp point from a face.
pub trait GraspEstimator: Send + Sync {
    /// Returns the grasp, or why there is none.
    ///
    /// # Errors
    /// [`NoGrasp`], a counted status.
    fn estimate(&self, face: &Face, rig: &Rig, range: &RangeImage) -> Result<Grasp, NoGrasp>;
}

/// Every face selector that a plan can name, in alphabetical order.
pub const SELECTORS: &[Entry<dyn FaceSelector>] = &[least_occluded::ENTRY];

/// Every grasp estimator that a plan can name, in alphabetical order.
pub const ESTIMATORS: &[Entry<dyn GraspEstimator>] = &[cell_at_corner_mean::ENTRY];
