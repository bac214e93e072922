//! From radiance to what an algorithm may see: exposures and range images.

mod camera_model;
mod distort;
mod electrons;
mod exposure;
mod kernel;
mod mosaic;
mod noise;
mod optics;
mod photograph;
mod range;
mod range_sensor;
mod transfer;

pub use camera_model::{CameraModel, Colour, Curve, Output};
pub use electrons::Sensor;
pub use exposure::{Encoding, Exposure, LinearLight, NoiseModel, Rig};
pub use kernel::{GatherBuffers, Kernel};
pub use mosaic::Demosaic;
pub use optics::Optics;
pub use photograph::{Photograph, PhotographBuffers, Photographer, Shot};
pub use range::{DepthNoise, RangeImage};
pub use range_sensor::RangeSensor;
pub use transfer::Transfer;
