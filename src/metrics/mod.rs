//! From answers and truth to numbers, each with its unit.

mod grasp;
mod localisation;

pub use grasp::{GraspError, covered_face, grasp_error};
pub use localisation::{CornerScore, Fate, score_corners};
