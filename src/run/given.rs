//! The face of corners that are known to be which: what a grasp is worth when nothing but refinement can err.

use crate::grasp::pose::SeenVertex;
use crate::grasp::{CORNER_SIGMA_PX, Face, NoFace, SeenCuboid};
use crate::refine::Corner;
use crate::scene::{TrueCorner, TrueFace, Truth};

/// The least occluded of the faces whose four corners were asked for and answered, and all that was answered of the
/// cuboid; `corners` are the answers to the corners asked for, in their order.
///
/// # Errors
/// When fewer than four are answered, or of no face all.
pub(super) fn face(
    truth: &Truth,
    asked: &[&TrueCorner],
    corners: &[Corner],
) -> Result<Face, NoFace> {
    let unknown = nalgebra::Matrix2::identity() * CORNER_SIGMA_PX * CORNER_SIGMA_PX;
    let mut vertices = [None; 8];
    for (asked, corner) in asked.iter().zip(corners).filter(|(_, corner)| corner.status.answered())
    {
        // A board has more corners, and is no cuboid.
        let Some(place) = vertices.get_mut(asked.index) else { return Err(NoFace::NoCuboid) };
        let own = corner.covariance_px2.filter(|own| own.cholesky().is_some());
        *place = Some(SeenVertex {
            vertex: asked.index,
            point: corner.position,
            covariance_px2: own.unwrap_or(unknown),
        });
    }
    if vertices.iter().flatten().count() < 4 {
        return Err(NoFace::TooFewCorners);
    }
    let whole = |face: &&TrueFace| {
        face.facing
            && face.corners.iter().all(|corner| vertices.get(*corner).is_some_and(Option::is_some))
    };
    let best = truth
        .faces
        .iter()
        .filter(whole)
        .max_by(|a, b| a.visible_fraction.total_cmp(&b.visible_fraction))
        .ok_or(NoFace::AllOccluded)?;
    // Clockwise as seen.
    let [a, b, c, d] = best.corners;
    let order = [a, d, c, b];
    let seen = order.map(|corner| vertices[corner]);
    let [Some(first), ..] = seen else { return Err(NoFace::AllOccluded) };
    Ok(Face {
        corners: seen.map(|vertex| vertex.unwrap_or(first).point),
        covariances_px2: seen.map(|vertex| vertex.map(|vertex| vertex.covariance_px2)),
        gap_fraction: 1.0 - best.visible_fraction,
        cuboid: Some(SeenCuboid { vertices, face: order }),
    })
}
