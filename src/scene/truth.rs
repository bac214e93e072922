//! `truth.json`: what is true of a scene.

use serde::{Deserialize, Serialize};

use crate::geometry::ImagePoint;

/// Corners, edges and faces of the target, as projected and as seen.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Truth {
    /// The eight vertices, in the order of their index.
    pub corners: Vec<TrueCorner>,
    /// The twelve edges.
    pub edges: Vec<TrueEdge>,
    /// The six faces.
    pub faces: Vec<TrueFace>,
    /// Share of the target's image area that nothing hides.
    pub target_visible_fraction: f64,
}

/// How a vertex stands to the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Visibility {
    /// Nothing is between the camera and the vertex.
    Visible,
    /// The target itself is: none of the vertex's faces looks at the camera.
    SelfOccluded,
    /// Another object is.
    Occluded,
    /// The vertex projects outside the sensor.
    Outside,
}

/// A vertex of the target.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrueCorner {
    /// 0 to 7.
    pub index: usize,
    /// Position in the world \[m\]: the intersection of the ideal planes.
    pub position_m: [f64; 3],
    /// Its projection \[px\].
    pub image_point_px: ImagePoint,
    /// Whether it is seen.
    pub visibility: Visibility,
    /// The three faces that meet there.
    pub faces: [usize; 3],
}

/// An edge of the target.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrueEdge {
    /// 0 to 11.
    pub index: usize,
    /// The two vertices at its ends.
    pub corners: [usize; 2],
    /// The two faces that meet there.
    pub faces: [usize; 2],
    /// Share of its length that is seen.
    pub visible_fraction: f64,
}

/// A face of the target.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrueFace {
    /// 0 to 5.
    pub index: usize,
    /// "x-", "x+", ..., "z+": the side of the cuboid's own frame.
    pub name: String,
    /// Its vertices, counter-clockwise seen from outside.
    pub corners: [usize; 4],
    /// Whether its outside is towards the camera.
    pub facing: bool,
    /// Share of its area that is seen.
    pub visible_fraction: f64,
    /// Its centre in the world \[m\].
    pub centre_m: [f64; 3],
    /// The projection of its centre \[px\].
    pub centre_image_point_px: ImagePoint,
    /// Its outward normal in the world.
    pub normal: [f64; 3],
    /// Lengths of its first and second side \[m\].
    pub extent_m: [f64; 2],
}

impl Truth {
    /// The projected corners of a face \[px\].
    pub fn face_corners(&self, face: &TrueFace) -> [ImagePoint; 4] {
        face.corners.map(|index| self.corners[index].image_point_px)
    }

    /// The face that is seen most of, by the share of its area; of equals, the larger in the image.
    pub fn least_occluded_face(&self) -> Option<&TrueFace> {
        self.faces.iter().filter(|face| face.facing && face.visible_fraction > 0.0).max_by(
            |a, b| {
                let image_area = |face| polygon_area_px2(&self.face_corners(face));
                (a.visible_fraction.total_cmp(&b.visible_fraction))
                    .then_with(|| image_area(a).total_cmp(&image_area(b)))
            },
        )
    }

    /// Whether a face is the least occluded one, or as little occluded to half a percent of its area.
    pub fn is_least_occluded(&self, face: &TrueFace) -> bool {
        const SAME: f64 = 0.005;
        self.least_occluded_face().is_some_and(|best| {
            face.facing && face.visible_fraction >= best.visible_fraction - SAME
        })
    }

    /// Whether all indices refer to what is there; checked once, on loading.
    pub(crate) fn is_consistent(&self) -> bool {
        let corner = |index: &usize| *index < self.corners.len();
        let face = |index: &usize| *index < self.faces.len();
        self.corners.len() == 8
            && self.faces.len() == 6
            && self.corners.iter().enumerate().all(|(place, c)| c.index == place)
            && self.faces.iter().enumerate().all(|(place, f)| f.index == place)
            && self.corners.iter().all(|c| c.faces.iter().all(face))
            && self.edges.iter().all(|e| e.corners.iter().all(corner) && e.faces.iter().all(face))
            && self.faces.iter().all(|f| f.corners.iter().all(corner))
    }
}

/// Area of a polygon \[px^2\], whatever its sense (shoelace formula).
pub fn polygon_area_px2(points: &[ImagePoint]) -> f64 {
    let next = points.iter().cycle().skip(1);
    let twice: f64 = points.iter().zip(next).map(|(a, b)| a.x * b.y - b.x * a.y).sum();
    0.5 * twice.abs()
}
