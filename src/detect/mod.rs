//! From an exposure to corner candidates.

use crate::geometry::ImagePoint;
use crate::junction::Junction;
use crate::registry::Entry;
use crate::sensor::Exposure;
use crate::target::TargetRegion;

pub use channel::{Channel, Shade};
pub use peaks::{Peaks, Scratch};
pub use places::Places;

mod area;
mod channel;
pub mod chess;
pub mod contour_curvature;
mod contours;
pub mod deriche_giraudon;
pub mod fast;
pub mod foerstner;
pub mod good_features;
pub mod harris;
pub mod hessian_determinant;
pub mod jet;
pub mod kitchen_rosenfeld;
mod line;
pub mod line_junctions;
mod maxima;
pub mod noble;
pub mod peaks;
mod places;
pub mod red_polygon;
pub mod rohr;
pub mod shi_tomasi;
pub mod susan;
mod taken;
pub mod tensor;

/// A corner candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Where \[px\].
    pub point: ImagePoint,
    /// How strong, in the detector's own unit; not comparable across detectors.
    pub response: f64,
    /// What it looks like, of a detector that tells.
    pub junction: Option<Junction>,
}

impl Detection {
    /// A candidate of a detector that does not tell what it looks like.
    pub fn new(point: ImagePoint, response: f64) -> Self {
        Self { point, response, junction: None }
    }
}

/// Whether a point lies in the region or no farther than `margin_px` from it, as a detector that is no own one
/// is held to.
pub fn is_near_region(region: &TargetRegion, margin_px: f64, point: ImagePoint) -> bool {
    area::holds(&region.grown_quadrilateral(margin_px), point)
}

/// Finds corner candidates in one exposure.
pub trait Detector: Send + Sync {
    /// Replaces what `found` holds by the candidates, strongest response first: those inside the region
    /// and its margin, or those of the whole image where no region is given. The threshold may be swept
    /// afterwards, over the responses. `scratch` is memory; what it holds changes no answer.
    fn detect_into(
        &self,
        exposure: &Exposure,
        region: Option<&TargetRegion>,
        scratch: &mut Scratch,
        found: &mut Vec<Detection>,
    );

    /// The candidates, as [`Detector::detect_into`] finds them.
    fn detect(&self, exposure: &Exposure, region: Option<&TargetRegion>) -> Vec<Detection> {
        let mut found = Vec::new();
        self.detect_into(exposure, region, &mut Scratch::default(), &mut found);
        found
    }
}

/// Every detector that a plan can name, in alphabetical order.
pub const DETECTORS: &[Entry<dyn Detector>] = &[
    chess::ENTRY,
    contour_curvature::ENTRY,
    deriche_giraudon::ENTRY,
    fast::ENTRY,
    foerstner::ENTRY,
    good_features::ENTRY,
    harris::ENTRY,
    hessian_determinant::ENTRY,
    kitchen_rosenfeld::ENTRY,
    line_junctions::ENTRY,
    noble::ENTRY,
    red_polygon::ENTRY,
    rohr::ENTRY,
    shi_tomasi::ENTRY,
    susan::ENTRY,
];
