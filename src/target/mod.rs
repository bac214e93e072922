//! From an exposure to the region that holds the target.

use crate::geometry::ImagePoint;
use crate::image::{PixelRange, Plane};
use crate::registry::Entry;
use crate::sensor::Exposure;

pub mod red_difference;

/// The part of an image that holds the target.
#[derive(Clone, Debug)]
pub struct TargetRegion {
    /// True on the target's pixels; the size of the exposure.
    pub mask: Plane<bool>,
    /// The smallest range of rows and columns that holds the mask.
    pub range: PixelRange,
    /// The smallest circumscribed quadrilateral, rotated: corners in clockwise order as seen.
    pub quadrilateral: [ImagePoint; 4],
    /// Pixels in the mask.
    pub pixels: usize,
}

/// Why no target was found; counted, never dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoTarget {
    /// No pixel has the target's colour.
    NoPixel,
    /// The largest region of the target's colour is too small to be one.
    TooSmall,
}

/// Finds the target's region in one exposure.
pub trait TargetExtractor: Send + Sync {
    /// Returns the region, or why there is none.
    ///
    /// # Errors
    /// [`NoTarget`], a counted status.
    fn extract(&self, exposure: &Exposure) -> Result<TargetRegion, NoTarget>;
}

/// Every extractor that a plan can name, in alphabetical order.
pub const EXTRACTORS: &[Entry<dyn TargetExtractor>] = &[red_difference::ENTRY];
