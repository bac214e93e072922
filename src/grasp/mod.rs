//! From refined corners to the face to grasp and the point on it.

use nalgebra::{Matrix2, Matrix3, Point3, Unit, Vector3};

use crate::geometry::ImagePoint;
use crate::refine::Corner;
use crate::registry::Entry;
use crate::sensor::{Exposure, RangeImage, Rig};
use crate::target::TargetRegion;

use pose::{CuboidPose, SeenVertex};

pub mod cell_at_corner_mean;
pub mod cell_at_diagonals;
mod cells;
pub mod cuboid_faces;
pub mod cuboid_pose;
mod evidence;
pub mod face_plane;
pub mod least_occluded;
pub mod pose;
pub mod pose_and_plane;
mod range_plane;

/// A face of the target as it was recognised in the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Its corners \[px\], clockwise as seen (x right, y down).
    pub corners: [ImagePoint; 4],
    /// Of each, what its refiner says of it \[px^2\].
    pub covariances_px2: [Option<Matrix2<f64>>; 4],
    /// Share of its pixels that are not the target's, in \[0, 1\].
    pub gap_fraction: f64,
    /// What else is seen of the cuboid, where that was recognised.
    pub cuboid: Option<SeenCuboid>,
    /// How certain that is, where several cuboids were thought of.
    pub recognition: Option<Recognition>,
}

/// How certain it is what was recognised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recognition {
    /// Cuboids that were fitted to what is seen and are not the same.
    pub hypotheses: usize,
    /// By what share the chosen one has more evidence than the next, in \[0, 1\]; 1 where there is no other.
    pub margin: f64,
}

/// What is seen of the cuboid that a face belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenCuboid {
    /// Its vertices where they are seen; none twice.
    pub vertices: [Option<SeenVertex>; 8],
    /// The face's, in the order of its corners.
    pub face: [usize; 4],
}

/// What a corner's refiner is taken to err by that does not say it \[px\].
pub const CORNER_SIGMA_PX: f64 = 0.3;

/// What a refiner says of a corner, [`CORNER_SIGMA_PX`] in every direction where it says nothing, or what is none
/// \[px^2\].
pub fn covariance_or_default_px2(said: Option<Matrix2<f64>>) -> Matrix2<f64> {
    let unknown = Matrix2::identity() * CORNER_SIGMA_PX * CORNER_SIGMA_PX;
    said.filter(|covariance| covariance.cholesky().is_some()).unwrap_or(unknown)
}

impl Face {
    /// A face of corners among those that were found, whose covariances it has.
    pub fn of_corners(corners: [ImagePoint; 4], gap_fraction: f64, found: &[Corner]) -> Self {
        let of = |point: &ImagePoint| {
            let its = found.iter().filter(|corner| corner.position == *point);
            its.filter_map(|corner| corner.covariance_px2).next()
        };
        let covariances_px2 = corners.each_ref().map(of);
        Self { corners, covariances_px2, gap_fraction, cuboid: None, recognition: None }
    }

    /// The covariance of a corner, [`CORNER_SIGMA_PX`] where nothing is known \[px^2\].
    pub fn covariance_px2(&self, corner: usize) -> Matrix2<f64> {
        covariance_or_default_px2(self.covariances_px2[corner])
    }

    /// The vertices of its cuboid that are seen, and which are the face's: those of a face alone where nothing else was
    /// recognised, at the end of z.
    pub fn seen(&self) -> (Vec<SeenVertex>, [usize; 4]) {
        if let Some(cuboid) = &self.cuboid {
            return (cuboid.vertices.iter().flatten().copied().collect(), cuboid.face);
        }
        // Clockwise from outside.
        const FACE: [usize; 4] = [4, 6, 7, 5];
        let seen = |corner: usize| SeenVertex {
            vertex: FACE[corner],
            point: self.corners[corner],
            covariance_px2: self.covariance_px2(corner),
        };
        ([0, 1, 2, 3].map(seen).to_vec(), FACE)
    }
}

/// Why no face was chosen; counted, never dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoFace {
    /// Fewer than four corners.
    TooFewCorners,
    /// No four corners bound a face with small or no gaps.
    AllOccluded,
    /// Corners and edges are no cuboid's, or the camera is not known.
    NoCuboid,
    /// Two cuboids explain what is seen about as well.
    AmbiguousCuboid,
}

impl NoFace {
    /// The name used in records.
    pub fn name(self) -> &'static str {
        match self {
            Self::TooFewCorners => "too_few_corners",
            Self::AllOccluded => "all_occluded",
            Self::NoCuboid => "no_cuboid",
            Self::AmbiguousCuboid => "ambiguous_cuboid",
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
        rig: &Rig,
        range: &RangeImage,
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
    /// From where and how to close on it; none of an estimator that tells a point alone.
    pub approach: Option<Approach>,
    /// Of the grasp point in the camera frame \[m^2\].
    pub covariance_m2: Option<Matrix3<f64>>,
    /// The whole cuboid in the camera frame, where its size is known.
    pub pose: Option<CuboidPose>,
}

/// From where a gripper comes, and how it closes; in the camera frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    /// Out of the face: the gripper comes against it.
    pub normal: Unit<Vector3<f64>>,
    /// How far that may be off, one standard deviation, where that is known \[rad\].
    pub normal_sigma_rad: Option<f64>,
    /// In the face, across its shorter side: the jaws move along it. As good as its opposite.
    pub jaw: Unit<Vector3<f64>>,
    /// How far they are apart when they touch: the face's extent along it \[m\].
    pub opening_m: f64,
}

impl Grasp {
    /// A point alone.
    pub fn at(image_point: ImagePoint, point_in_camera: Point3<f64>, rig: &Rig) -> Self {
        Self {
            image_point,
            point_in_camera,
            point_in_world: rig.world_from_camera * point_in_camera,
            approach: None,
            covariance_m2: None,
            pose: None,
        }
    }
}

/// Why there is no grasp point; counted, never dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoGrasp {
    /// The range sensor saw nothing there.
    NoRange,
    /// Fewer than three of its cells lie inside the face, or in a row.
    TooFewCells,
    /// The target's size is not known.
    NoSize,
    /// The corners are no cuboid's of that size.
    NoPose,
    /// Two poses explain the corners about as well.
    Ambiguous,
    /// Corners and range tell different poses.
    Contradictory,
}

impl NoGrasp {
    /// The name used in records.
    pub fn name(self) -> &'static str {
        match self {
            Self::NoRange => "no_range",
            Self::TooFewCells => "too_few_cells",
            Self::NoSize => "no_size",
            Self::NoPose => "no_pose",
            Self::Ambiguous => "ambiguous",
            Self::Contradictory => "contradictory",
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
pub const SELECTORS: &[Entry<dyn FaceSelector>] = &[cuboid_faces::ENTRY, least_occluded::ENTRY];

/// Every grasp estimator that a plan can name, in alphabetical order.
pub const ESTIMATORS: &[Entry<dyn GraspEstimator>] = &[
    cell_at_corner_mean::ENTRY,
    cell_at_diagonals::ENTRY,
    cuboid_pose::ENTRY,
    face_plane::ENTRY,
    pose_and_plane::ENTRY,
];
