//! From corner candidates to sub-pixel corners.

use nalgebra::Matrix2;

use crate::detect::Detection;
use crate::geometry::ImagePoint;
use crate::registry::Entry;
use crate::sensor::Exposure;

pub mod annular_orthogonality;
pub mod apriltag_edges;
pub mod corner_sub_pix;
pub mod cuboid_fit;
pub mod edge_intersection;
mod edges;
pub mod foerstner;
mod gradients;
pub mod junction_fit;
mod light;
mod luminance;
pub mod none;
mod orthogonality;
mod response;
pub mod response_centroid;
pub mod response_parabola;
pub mod saddle_polynomial;
mod starts;
pub mod template_ecc;

/// What became of one candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RefineStatus {
    /// Converged.
    Ok,
    /// Stopped at the last allowed iteration, not yet converged; the position is the last one.
    MaxIterations,
    /// The answer lay too far from the seed and was given up; the position is the seed.
    Reverted,
    /// The way from the seed led out of its neighbourhood; the position is the seed.
    Diverged,
    /// The equations are singular (no gradient, or one direction only); the position is the seed.
    Singular,
    /// The seed or the way from it leaves the image, or no window fits into it; the position is the
    /// seed.
    OutOfBounds,
    /// What is there is nothing that the method can locate: an X corner's method at another corner;
    /// the position is the seed.
    NotApplicable,
    /// What is there looks like a corner and is none: an edge that ends behind another one. The
    /// position is the seed.
    FalseCorner,
    /// A program that refines did not answer; the position is the seed.
    Failed,
}

impl RefineStatus {
    /// The name used in records.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::MaxIterations => "max_iterations",
            Self::Reverted => "reverted",
            Self::Diverged => "diverged",
            Self::Singular => "singular",
            Self::OutOfBounds => "out_of_bounds",
            Self::NotApplicable => "not_applicable",
            Self::FalseCorner => "false_corner",
            Self::Failed => "failed",
        }
    }

    /// Whether the position is an answer of the refiner, not its seed.
    pub fn answered(self) -> bool {
        matches!(self, Self::Ok | Self::MaxIterations)
    }
}

/// A refined corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// The candidate it came from.
    pub seed: Detection,
    /// The refined position; the seed's own where the status says so.
    pub position: ImagePoint,
    /// Covariance of the position \[px^2\], where the method has one.
    pub covariance_px2: Option<Matrix2<f64>>,
    /// Iterations taken.
    pub iterations: u32,
    /// What became of the candidate.
    pub status: RefineStatus,
}

impl Corner {
    /// A corner left at its seed.
    pub fn at_seed(seed: Detection, iterations: u32, status: RefineStatus) -> Self {
        Self { seed, position: seed.point, covariance_px2: None, iterations, status }
    }
}

/// Moves candidates to their sub-pixel positions.
pub trait Refiner: Send + Sync {
    /// Refines the candidates of one exposure; answer i belongs to seed i, always. A position is
    /// finite where the status answers, else it is the seed's.
    fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner>;
}

/// Every refiner that a plan can name, in alphabetical order.
pub const REFINERS: &[Entry<dyn Refiner>] = &[
    annular_orthogonality::ENTRY,
    apriltag_edges::ENTRY,
    corner_sub_pix::ENTRY,
    cuboid_fit::ENTRY,
    edge_intersection::ENTRY,
    foerstner::ENTRY,
    junction_fit::ENTRY,
    none::ENTRY,
    response_centroid::ENTRY,
    response_parabola::ENTRY,
    saddle_polynomial::ENTRY,
    template_ecc::ENTRY,
];
