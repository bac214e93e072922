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
        recognition: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::Detection;
    use crate::geometry::{ImagePoint, signed_area_px2};
    use crate::refine::RefineStatus;
    use crate::scene::Visibility;

    fn corner(index: usize, image_point_px: ImagePoint) -> TrueCorner {
        TrueCorner {
            index,
            position_m: [0.0; 3],
            image_point_px,
            visibility: Visibility::Visible,
            junction: None,
            edges: Vec::new(),
            faces: Vec::new(),
            nearest_occluder_px: None,
            bevel_radius_px: 0.0,
            apex_image_point_px: None,
            blur_px: 0.0,
            render_noise_floor_px: None,
        }
    }

    fn true_face(corners: [usize; 4], visible_fraction: f64) -> TrueFace {
        TrueFace {
            index: 0,
            name: String::new(),
            corners,
            facing: true,
            visible_fraction,
            centre_m: [0.0; 3],
            centre_image_point_px: ImagePoint::new(0.0, 0.0),
            normal: [0.0; 3],
            extent_m: [0.1; 2],
        }
    }

    #[test]
    fn the_least_hidden_face_is_given_clockwise_with_what_hides_of_it_as_its_gap() {
        // Three columns of two corners; from outside faces are counter-clockwise.
        let places =
            [[0.0, 0.0], [0.0, 10.0], [10.0, 0.0], [10.0, 10.0], [20.0, 0.0], [20.0, 10.0]];
        let corners: Vec<TrueCorner> =
            places.into_iter().enumerate().map(|(index, at)| corner(index, at.into())).collect();
        let truth = Truth {
            corners: corners.clone(),
            edges: Vec::new(),
            faces: vec![true_face([0, 1, 3, 2], 0.5), true_face([2, 3, 5, 4], 0.75)],
            false_junctions: Vec::new(),
            target_visible_fraction: 0.6,
            across_px: 20.0,
        };
        let asked: Vec<&TrueCorner> = corners.iter().collect();
        let answer = |asked: &&TrueCorner| {
            Corner::at_seed(Detection::new(asked.image_point_px, 1.0), 0, RefineStatus::Ok)
        };
        let answers: Vec<Corner> = asked.iter().map(answer).collect();
        let found = face(&truth, &asked, &answers).expect("two faces");
        assert!((found.gap_fraction - 0.25).abs() < 1e-12, "{found:?}");
        assert!((signed_area_px2(&found.corners) - 100.0).abs() < 1e-9, "{found:?}");
        let cuboid = found.cuboid.expect("all that is seen");
        assert_eq!(cuboid.face.map(|vertex| corners[vertex].image_point_px), found.corners);
    }
}
