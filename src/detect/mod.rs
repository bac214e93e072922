//! From an exposure to corner candidates.

use crate::geometry::ImagePoint;
use crate::registry::Entry;
use crate::sensor::Exposure;
use crate::target::TargetRegion;

pub mod harris;

/// A corner candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Where \[px\].
    pub point: ImagePoint,
    /// How strong, in the detector's own unit; not comparable across detectors.
    pub response: f64,
}

/// Finds corner candidates in one exposure.
pub trait Detector: Send + Sync {
    /// Returns candidates, strongest response first: those inside the region and its margin, or
    /// those of the whole image where no region is given.
    fn detect(&self, exposure: &Exposure, region: Option<&TargetRegion>) -> Vec<Detection>;
}

/// Every detector that a plan can name, in alphabetical order.
pub const DETECTORS: &[Entry<dyn Detector>] = &[harris::ENTRY];
