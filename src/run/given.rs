//! The face of corners that are known to be which: what a grasp is worth when nothing but refinement can err.

use crate::grasp::pose::SeenVertex;
use crate::grasp::{Face, NoFace, SeenCuboid, covariance_or_default_px2};
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
    let mut vertices: [Option<SeenVertex>; 8] = [None; 8];
    for (asked, corner) in asked.iter().zip(corners).filter(|(_, corner)| corner.status.answered())
    {
        // A board has more corners, and is no cuboid.
        let Some(place) = vertices.get_mut(asked.index) else { return Err(NoFace::NoCuboid) };
        *place = Some(SeenVertex {
            vertex: asked.index,
            point: corner.position,
            covariance_px2: covariance_or_default_px2(corner.covariance_px2),
        });
    }
    if vertices.iter().flatten().count() < 4 {
        return Err(NoFace::TooFewCorners);
    }
    // Clockwise as seen, where true faces are counter-clockwise from outside.
    let seen = |face: &TrueFace| -> Option<[SeenVertex; 4]> {
        let [a, b, c, d] = face.corners.map(|corner| vertices[corner]);
        Some([a?, d?, c?, b?])
    };
    let (best, seen) = truth
        .faces
        .iter()
        .filter(|face| face.facing)
        .filter_map(|face| Some((face, seen(face)?)))
        .max_by(|(a, _), (b, _)| a.visible_fraction.total_cmp(&b.visible_fraction))
        .ok_or(NoFace::AllOccluded)?;
    Ok(Face {
        corners: seen.map(|vertex| vertex.point),
        covariances_px2: seen.map(|vertex| Some(vertex.covariance_px2)),
        gap_fraction: 1.0 - best.visible_fraction,
        cuboid: Some(SeenCuboid { vertices, face: seen.map(|vertex| vertex.vertex) }),
    })
}
