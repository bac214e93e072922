//! The pose of a cuboid of known size by its corners and by the range cells on a face, each as well as it is known.
//!
//! ```text
//! # Method      Every pose that explains the corners (cuboid_pose), ambiguous or not, is moved to where corners and
//!               the plane of the face's range cells (face_plane) together have the least sum of squares over their
//!               covariances; the pose is taken of which that is least: range decides between mirrored poses.
//! # Input       a face, and what else is seen of its cuboid; the colour camera; the target's three lengths; a range
//!               image, its sensor's pose and noise.
//! # Parameters  erosion_px      px, 3     as of face_plane
//!               most_rmse_px    px, 3     as of cuboid_pose, before range has its say and after
//!               least_gap       none, 6   as of cuboid_pose, range included
//! # Output      as of cuboid_pose. Where range says nothing of the face: that of cuboid_pose. contradictory where no pose
//!               explains both: with the plane's say the corners are farther off than most_rmse_px.
//! # Border      none.
//! # Cost        that of both, and five rounds of least squares for each pose.
//! # Departures  none: information adds.
//! # Source      least squares of two sources; Bar-Shalom, Li & Kirubarajan, Estimation with applications to tracking and
//!               navigation, 2001, chapter 3.
//! # Checked by  tests/it/estimators.rs
//! ```

use nalgebra::{Matrix3x6, SMatrix, Vector3, Vector6};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::grasp::cuboid_pose::{candidates, grasp_of_pose};
use crate::grasp::pose::CuboidPose;
use crate::grasp::range_plane::RangePlane;
use crate::grasp::{Face, Grasp, GraspEstimator, NoGrasp};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::{RangeImage, Rig};

/// The registry's line.
pub const ENTRY: Entry<dyn GraspEstimator> = Entry {
    name: "pose_and_plane",
    summary: "PnP of the cuboid of known size and the plane of the range cells inside the face, fused",
    reference: "Bar-Shalom, Li & Kirubarajan 2001, chapter 3",
    version: 2,
    defaults: defaults::<PoseAndPlane>,
    schema: schema::<PoseAndPlane>,
    build: |place, table| Ok(Box::new(parameters::<PoseAndPlane>(place, table)?)),
};

/// The estimator; its parameters are those of the header.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct PoseAndPlane {
    /// Range cells nearer to a side are not used \[px\].
    #[schemars(range(min = 0.0, max = 50.0))]
    pub erosion_px: f64,
    /// The largest root mean square error of a pose \[px\].
    #[schemars(range(min = 0.01, max = 100.0))]
    pub most_rmse_px: f64,
    /// How much larger the next best pose's sum of squares is at least.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub least_gap: f64,
}

impl Default for PoseAndPlane {
    fn default() -> Self {
        Self { erosion_px: 3.0, most_rmse_px: 3.0, least_gap: 6.0 }
    }
}

const ROUNDS: usize = 5;

impl GraspEstimator for PoseAndPlane {
    fn estimate(&self, face: &Face, rig: &Rig, range: &RangeImage) -> Result<Grasp, NoGrasp> {
        let mut poses = candidates(face, rig, self.most_rmse_px)?;
        let (seen, vertices) = face.seen();
        if let Ok(plane) = RangePlane::inside(&face.corners, rig, range, self.erosion_px) {
            poses = poses.iter().filter_map(|pose| fused(pose, vertices, &plane)).collect();
            poses.retain(|pose| {
                let rmse_px = pose.rmse_px_of(&seen, &rig.camera);
                rmse_px.is_some_and(|rmse_px| rmse_px <= self.most_rmse_px)
            });
            if poses.is_empty() {
                return Err(NoGrasp::Contradictory);
            }
            poses.sort_by(|a, b| a.chi_square.total_cmp(&b.chi_square));
        }
        let best = *poses.first().ok_or(NoGrasp::NoPose)?;
        if poses[1..].iter().any(|next| next.chi_square - best.chi_square < self.least_gap) {
            return Err(NoGrasp::Ambiguous);
        }
        grasp_of_pose(&best, vertices, rig).ok_or(NoGrasp::NoPose)
    }
}

/// A pose moved to where its face's plane has its say, too.
fn fused(pose: &CuboidPose, vertices: [usize; 4], plane: &RangePlane) -> Option<CuboidPose> {
    let by_corners = pose.covariance.try_inverse()?;
    let by_range = plane.covariance.try_inverse()?;
    let mut change = Vector6::zeros();
    let mut information = by_corners;
    for _ in 0..ROUNDS {
        let (seen, slope) = face_plane(&pose.changed(&change), vertices)?;
        information = by_corners + slope.transpose() * by_range * slope;
        let right =
            slope.transpose() * by_range * (plane.inverse_depth - seen) - by_corners * change;
        change += information.cholesky()?.solve(&right);
    }
    let (seen, _) = face_plane(&pose.changed(&change), vertices)?;
    let miss = plane.inverse_depth - seen;
    let chi_square = pose.chi_square
        + (change.transpose() * by_corners * change)[(0, 0)]
        + (miss.transpose() * by_range * miss)[(0, 0)];
    let covariance = information.cholesky()?.inverse();
    Some(CuboidPose { covariance, chi_square, ..pose.changed(&change) })
}

/// The plane of a face, m X = 1, and how it changes with the pose.
fn face_plane(pose: &CuboidPose, vertices: [usize; 4]) -> Option<(Vector3<f64>, Matrix3x6<f64>)> {
    const STEP: f64 = 1e-6;
    let of = |pose: &CuboidPose| {
        let [a, b, _, d] = vertices.map(|vertex| pose.vertex(vertex));
        let normal = (b - a).cross(&(d - a));
        let distance = normal.dot(&a.coords);
        (distance != 0.0).then(|| normal / distance)
    };
    let mut slope = SMatrix::<f64, 3, 6>::zeros();
    for index in 0..6 {
        let mut step = Vector6::zeros();
        step[index] = STEP;
        let (more, less) = (of(&pose.changed(&step))?, of(&pose.changed(&-step))?);
        slope.set_column(index, &((more - less) / (2.0 * STEP)));
    }
    Some((of(pose)?, slope))
}
