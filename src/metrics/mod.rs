//! From answers and truth to numbers, each with its unit.

mod corners;
mod gospa;
mod grasp;

pub use corners::{
    CornerRule, CornerScore, CornerScores, Fate, OtherScore, Place, Seen, found_at_responses,
    score_corners, score_seeded,
};
pub use gospa::{CUTOFF_PX, Gospa, gospa};
pub use grasp::{
    ApproachError, GraspError, PoseError, approach_error, covered_face, grasp_error, pose_error,
};
