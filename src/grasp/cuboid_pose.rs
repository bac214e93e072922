//! The pose of a cuboid of known size, from where its vertices are seen.
//!
//! ```text
//! # Method      Perspective n points: of all that is seen of the cuboid's vertices, each over its covariance, for every
//!               way in which the known lengths may belong to its axes; of a face alone both of its mirrored poses.
//!               The grasp point is the middle of the chosen face.
//! # Input       a face, and what else is seen of its cuboid; the colour camera; the target's three lengths.
//! # Parameters  most_rmse_px    px, 3     range [0.01, 100]: where the best pose misses by more, the corners are no
//!                                         cuboid's of that size
//!               least_gap       none, 6   range [0, 1000]: how much larger the sum of squares over covariances is of
//!                                         the next best pose; less is ambiguous: e^(gap/2) is the ratio of likelihoods
//! # Output      the point, its image, approach, jaws, covariance, the whole pose. no_size where the target's size is
//!               not known, no_pose, ambiguous.
//! # Border      none.
//! # Cost        at most six orders of the lengths, two starts, 60 iterations each of up to seven points.
//! # Departures  of DeMenthon's iterations only the first, as a start of least squares. Poses that differ by a symmetry
//!               of the cuboid are one.
//! # Source      DeMenthon & Davis 1995; Oberkampf, DeMenthon & Davis 1996; ambiguity: Schweighofer & Pinz, Robust pose
//!               estimation from a planar target, PAMI 2006; Collins & Bartoli, IJCV 2014.
//! # Checked by  src/grasp/pose.rs (tests); tests/it/estimators.rs
//! ```

use nalgebra::{Matrix3, Matrix3x6, Point3, Unit, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::grasp::face_plane::approach;
use crate::grasp::pose::{CuboidPose, poses_of_lengths};
use crate::grasp::{Face, Grasp, GraspEstimator, NoGrasp};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::{RangeImage, Rig};
use crate::stats::excess;

/// The registry's line.
pub const ENTRY: Entry<dyn GraspEstimator> = Entry {
    name: "cuboid_pose",
    summary: "the face's middle by the pose of the cuboid of known size (PnP), without range",
    reference: "DeMenthon & Davis 1995; Oberkampf et al. 1996; Collins & Bartoli 2014",
    version: 1,
    defaults: defaults::<CuboidPoseGrasp>,
    schema: schema::<CuboidPoseGrasp>,
    build: |place, table| Ok(Box::new(parameters::<CuboidPoseGrasp>(place, table)?)),
};

/// The estimator; its parameters are those of the header.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct CuboidPoseGrasp {
    /// The largest root mean square error of a pose \[px\].
    #[schemars(range(min = 0.01, max = 100.0))]
    pub most_rmse_px: f64,
    /// How much larger the next best pose's sum of squares is at least.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub least_gap: f64,
}

impl Default for CuboidPoseGrasp {
    fn default() -> Self {
        Self { most_rmse_px: 3.0, least_gap: 6.0 }
    }
}

impl GraspEstimator for CuboidPoseGrasp {
    fn estimate(&self, face: &Face, rig: &Rig, _: &RangeImage) -> Result<Grasp, NoGrasp> {
        let all = candidates(face, rig, self.most_rmse_px)?;
        let best = all[0];
        if all[1..].iter().any(|next| next.chi_square - best.chi_square < self.least_gap) {
            return Err(NoGrasp::Ambiguous);
        }
        let (_, vertices) = face.seen();
        grasp_of_pose(&best, vertices, rig).ok_or(NoGrasp::NoPose)
    }
}

/// The poses that explain what is seen of the cuboid, the best first, each with the covariance that its own errors tell
/// where these are larger than the corners' covariances; at least one.
pub(super) fn candidates(
    face: &Face,
    rig: &Rig,
    most_rmse_px: f64,
) -> Result<Vec<CuboidPose>, NoGrasp> {
    let lengths_m = rig.object_size_m.ok_or(NoGrasp::NoSize)?;
    let (seen, vertices) = face.seen();
    let left = (2 * seen.len()).saturating_sub(6).max(1) as f64;
    let mut found = poses_of_lengths(&seen, lengths_m, &rig.camera);
    found.retain(|pose| pose.rmse_px <= most_rmse_px && looks_here(pose, vertices));
    let Some(best) = found.first() else { return Err(NoGrasp::NoPose) };
    // What corners err by more than they say is the same for all poses.
    let scale = excess(best.chi_square, left);
    for pose in &mut found {
        pose.covariance *= scale;
        pose.chi_square /= scale;
    }
    Ok(found)
}

/// Whether the face of these vertices faces the camera.
fn looks_here(pose: &CuboidPose, vertices: [usize; 4]) -> bool {
    let middle = middle(pose, vertices);
    outward(pose, vertices).is_some_and(|normal| normal.dot(&middle.coords) < 0.0)
}

fn middle(pose: &CuboidPose, vertices: [usize; 4]) -> Point3<f64> {
    let sum = vertices.iter().map(|vertex| pose.vertex(*vertex).coords).sum::<Vector3<f64>>();
    Point3::from(sum * 0.25)
}

fn outward(pose: &CuboidPose, vertices: [usize; 4]) -> Option<Unit<Vector3<f64>>> {
    let centre = pose.camera_from_cuboid.translation.vector;
    Unit::try_new(middle(pose, vertices).coords - centre, 0.0)
}

/// How a point of the cuboid moves with a turn and a shift.
fn slope(pose: &CuboidPose, point: &Point3<f64>) -> Matrix3x6<f64> {
    let arm = point.coords - pose.camera_from_cuboid.translation.vector;
    let mut slope = Matrix3x6::zeros();
    slope.fixed_view_mut::<3, 3>(0, 0).copy_from(&-arm.cross_matrix());
    slope.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
    slope
}

/// The grasp of the face of these vertices.
pub(super) fn grasp_of_pose(pose: &CuboidPose, vertices: [usize; 4], rig: &Rig) -> Option<Grasp> {
    let point = middle(pose, vertices);
    let slope = slope(pose, &point);
    let turned = pose.covariance.fixed_view::<3, 3>(0, 0);
    let normal = outward(pose, vertices)?;
    // A turn about the normal does not turn it.
    let across = Matrix3::identity() - normal.into_inner() * normal.transpose();
    let variance = (across * turned * across).symmetric_eigenvalues().max().max(0.0);
    let corners = vertices.map(|vertex| pose.vertex(vertex));
    Some(Grasp {
        approach: Some(approach(&corners, (normal, variance.sqrt()))),
        covariance_m2: Some(slope * pose.covariance * slope.transpose()),
        pose: Some(*pose),
        ..Grasp::at(rig.camera.project(&point)?, point, rig)
    })
}
