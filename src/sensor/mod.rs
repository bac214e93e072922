//! From radiance to what an algorithm may see: exposures and range images.

mod exposure;
mod range;
mod transfer;

pub use exposure::{CameraModel, Encoding, Exposure, Rig, expose};
pub use range::RangeImage;
pub use transfer::Transfer;
