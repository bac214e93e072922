//! `truth.json`: what is true of a scene.

use nalgebra::{Point3, Vector2};
use serde::{Deserialize, Serialize};

use crate::geometry::{Camera, ImagePoint, Pose, signed_area_px2};
use crate::junction::Junction;

/// Corners, edges and faces of the target, as projected and as seen.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Truth {
    /// The vertices, in the order of their index.
    pub corners: Vec<TrueCorner>,
    /// The edges, in the order of their index.
    pub edges: Vec<TrueEdge>,
    /// The faces, in the order of their index.
    pub faces: Vec<TrueFace>,
    /// Image points that look like corners of the target and are none.
    pub false_junctions: Vec<FalseJunction>,
    /// Share of the target's image area that nothing hides.
    pub target_visible_fraction: f64,
    /// The largest distance between two projected vertices \[px\].
    pub across_px: f64,
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
    /// Its place in the list.
    pub index: usize,
    /// Position in the world \[m\]: the intersection of the ideal planes.
    pub position_m: [f64; 3],
    /// Its projection \[px\].
    pub image_point_px: ImagePoint,
    /// Whether it is seen.
    pub visibility: Visibility,
    /// What it looks like; `None` where it is not seen, or none of its edges is.
    pub junction: Option<Junction>,
    /// The edges at it that bound a face which looks at the camera.
    pub edges: Vec<EdgeAtCorner>,
    /// The faces at it that look at the camera.
    pub faces: Vec<FaceAtCorner>,
    /// Distance in the image to where an object begins that is nearer than the corner \[px\]; `None`
    /// where there is none within 64 px, or the corner is not seen.
    pub nearest_occluder_px: Option<f64>,
    /// Radius of the rounded edges \[px\], 0 where they are sharp.
    pub bevel_radius_px: f64,
    /// The projection of the rounded corner's outermost point \[px\]; `None` where it is sharp.
    pub apex_image_point_px: Option<ImagePoint>,
    /// Standard deviation of the lens's blur, along any axis \[px\].
    pub blur_px: f64,
    /// Root mean square error of the corner's place that the render's noise alone enforces \[px\].
    pub render_noise_floor_px: Option<f64>,
}

impl TrueCorner {
    /// How far its second longest edge is seen from it \[px\]: what is left of a corner whose other edges
    /// are hidden; 0 where fewer than two are seen.
    pub fn second_edge_px(&self) -> f64 {
        second_largest(self.edges.iter().map(|edge| edge.visible_length_px)).unwrap_or(0.0)
    }

    /// The smallest angle between two of its edges that are seen for `least_edge_px` or more \[degrees\];
    /// `None` of fewer than two.
    pub fn smallest_angle_deg(&self, least_edge_px: f64) -> Option<f64> {
        self.narrowest(least_edge_px).map(|[a, b]| a.angle(&b).to_degrees())
    }

    /// The unit vector from it into that angle's middle; `None` of fewer than two edges, or where they are one
    /// line.
    pub fn bisector(&self, least_edge_px: f64) -> Option<[f64; 2]> {
        let [a, b] = self.narrowest(least_edge_px)?;
        (a.normalize() + b.normalize()).try_normalize(1e-6).map(Into::into)
    }

    /// The directions of the two edges that enclose the smallest angle.
    fn narrowest(&self, least_edge_px: f64) -> Option<[Vector2<f64>; 2]> {
        let directions: Vec<Vector2<f64>> = self
            .edges
            .iter()
            .filter(|edge| edge.visible_length_px >= least_edge_px)
            .map(|edge| Vector2::from(edge.direction))
            .collect();
        let pairs = directions
            .iter()
            .enumerate()
            .flat_map(|(index, a)| directions[index + 1..].iter().map(move |b| [*a, *b]));
        pairs.min_by(|[a, b], [c, d]| a.angle(b).total_cmp(&c.angle(d)))
    }

    /// The second largest contrast of its edges, as radiance: of each edge that of the channel in which it
    /// is largest. Two edges make a corner, so this is what it is seen by. `None` of fewer than two.
    pub fn second_contrast(&self) -> Option<f64> {
        let of_edge = |contrast: [f64; 3]| contrast.into_iter().map(f64::abs).fold(0.0, f64::max);
        second_largest(self.edges.iter().filter_map(|edge| edge.contrast).map(of_edge))
    }
}

fn second_largest(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(|a, b| b.total_cmp(a));
    values.get(1).copied()
}

/// An edge as it is seen from one of its ends.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EdgeAtCorner {
    /// Which edge.
    pub edge: usize,
    /// Unit vector in the image, away from the corner.
    pub direction: [f64; 2],
    /// Length of its projection \[px\].
    pub length_px: f64,
    /// How far it is seen from the corner on \[px\].
    pub visible_length_px: f64,
    /// Radiance to the right of the direction (as seen, y down) minus that to the left.
    pub contrast: Option<[f64; 3]>,
    /// Standard deviation of the lens's blur in the middle of what is seen \[px\].
    pub blur_px: f64,
}

/// A face at a corner.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaceAtCorner {
    /// Which face.
    pub face: usize,
    /// Share of its area that is seen.
    pub visible_fraction: f64,
    /// Share that is seen of what of its image lies within 10 px of the corner.
    pub near_visible_fraction: Option<f64>,
}

/// An edge of the target.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrueEdge {
    /// Its place in the list.
    pub index: usize,
    /// The two vertices at its ends.
    pub corners: [usize; 2],
    /// The two faces that meet there; twice the same where it is drawn on one.
    pub faces: [usize; 2],
    /// Share of its length that is seen.
    pub visible_fraction: f64,
    /// The parts that are seen, in order.
    pub visible: Vec<SeenInterval>,
}

/// A part of an edge that is seen.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SeenInterval {
    /// Where it starts: 0 at the edge's first vertex, 1 at its second, linear in space.
    pub start: f64,
    /// Where it ends.
    pub end: f64,
    /// What is there.
    pub started_by: IntervalEnd,
    /// What is there.
    pub ended_by: IntervalEnd,
}

/// What ends a part of an edge that is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(untagged)]
pub enum IntervalEnd {
    /// The edge's own end, or the frame.
    Itself(EdgeEnd),
    /// The object of this id hides the rest.
    Object(u32),
}

/// What ends an edge where no object does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EdgeEnd {
    /// Its vertex.
    Vertex,
    /// The border of the image.
    Frame,
}

/// An image point that looks like a corner of the target and is none.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FalseJunction {
    /// Why it looks like one.
    pub cause: Cause,
    /// What is there, for people.
    pub name: String,
    /// Where \[px\].
    pub image_point_px: ImagePoint,
    /// Where in the world \[m\].
    pub position_m: [f64; 3],
    /// The object that hides, or that a shadow falls on.
    pub object_id: Option<u32>,
    /// The edge of the target that is hidden from there on.
    pub edge: Option<usize>,
}

/// Why something looks like a corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cause {
    /// An outline crosses an edge of the target or a line of the room.
    #[serde(rename = "T")]
    T,
    /// A corner of the target's shadow.
    Shadow,
    /// A corner of what is printed or hung on a surface.
    Texture,
    /// A corner of an object that resembles the target.
    Distractor,
    /// A corner of the room.
    Room,
}

/// A face of the target.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrueFace {
    /// Its place in the list.
    pub index: usize,
    /// "x-", "x+", ..., "z+": the side of the cuboid's own frame; "pattern" of a board.
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
    /// Lengths of its first and last side \[m\].
    pub extent_m: [f64; 2],
}

impl Cause {
    /// The name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::T => "T",
            Self::Shadow => "shadow",
            Self::Texture => "texture",
            Self::Distractor => "distractor",
            Self::Room => "room",
        }
    }
}

impl Truth {
    /// The same truth in the image of another camera at the same place, which may distort: all places
    /// and directions in the image. A corner beyond its frame is outside. Places are those of `film`'s
    /// image now.
    #[must_use]
    pub fn seen_by(&self, film: &Camera, camera: &Camera) -> Self {
        // A ray has depth 1, so it has an image.
        let moved =
            |point: ImagePoint| camera.project(&film.unproject(point, 1.0)).unwrap_or(point);
        let mut seen = self.clone();
        for corner in &mut seen.corners {
            let (from, to) = (corner.image_point_px, moved(corner.image_point_px));
            for edge in &mut corner.edges {
                let along = |length_px: f64| {
                    let [x, y] = edge.direction;
                    moved(ImagePoint::new(from.x + length_px * x, from.y + length_px * y))
                };
                let near = along(1e-3);
                let distance_px = near.distance_px(to).max(f64::MIN_POSITIVE);
                let lengths = [edge.length_px, edge.visible_length_px]
                    .map(|length_px| along(length_px).distance_px(to));
                edge.direction = [(near.x - to.x) / distance_px, (near.y - to.y) / distance_px];
                [edge.length_px, edge.visible_length_px] = lengths;
            }
            corner.image_point_px = to;
            corner.apex_image_point_px = corner.apex_image_point_px.map(moved);
            if corner.visibility == Visibility::Visible && !camera.contains(to) {
                corner.visibility = Visibility::Outside;
            }
        }
        for face in &mut seen.faces {
            face.centre_image_point_px = moved(face.centre_image_point_px);
        }
        for junction in &mut seen.false_junctions {
            junction.image_point_px = moved(junction.image_point_px);
        }
        seen
    }

    /// What is seen of the edges, as lines of points not much more than `step_px` apart in the image of a
    /// camera of this pose \[px\].
    pub fn seen_edges(
        &self,
        camera: &Camera,
        world_from_camera: &Pose,
        step_px: f64,
    ) -> Vec<Vec<ImagePoint>> {
        let position = |corner: usize| {
            world_from_camera
                .inverse_transform_point(&Point3::from(self.corners[corner].position_m))
        };
        let mut lines = Vec::new();
        for edge in &self.edges {
            let [from, to] = edge.corners.map(position);
            let at = |share: f64| camera.project(&(from + (to - from) * share));
            for seen in &edge.visible {
                let (Some(start), Some(end)) = (at(seen.start), at(seen.end)) else { continue };
                #[allow(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "clamped"
                )]
                let steps = (start.distance_px(end) / step_px).ceil().clamp(1.0, 1e4) as u32;
                let share = |step: u32| {
                    seen.start + (seen.end - seen.start) * f64::from(step) / f64::from(steps)
                };
                lines.push((0..=steps).filter_map(|step| at(share(step))).collect());
            }
        }
        lines
    }

    /// The projected corners of a face \[px\].
    pub fn face_corners(&self, face: &TrueFace) -> [ImagePoint; 4] {
        face.corners.map(|index| self.corners[index].image_point_px)
    }

    /// The face that is seen most of, by the share of its area; of equals, the larger in the image.
    pub fn least_occluded_face(&self) -> Option<&TrueFace> {
        self.faces.iter().filter(|face| face.facing && face.visible_fraction > 0.0).max_by(
            |a, b| {
                let image_area = |face| signed_area_px2(&self.face_corners(face)).abs();
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
        let edge = |index: &usize| *index < self.edges.len();
        let in_order = |indices: &mut dyn Iterator<Item = usize>| {
            indices.enumerate().all(|(place, index)| place == index)
        };
        in_order(&mut self.corners.iter().map(|corner| corner.index))
            && in_order(&mut self.edges.iter().map(|edge| edge.index))
            && in_order(&mut self.faces.iter().map(|face| face.index))
            && self.corners.iter().all(|c| {
                c.edges.iter().all(|e| edge(&e.edge)) && c.faces.iter().all(|f| face(&f.face))
            })
            && self.edges.iter().all(|e| {
                let ordered = |seen: &SeenInterval| 0.0 <= seen.start && seen.start <= seen.end;
                e.corners.iter().all(corner)
                    && e.faces.iter().all(face)
                    && e.visible.iter().all(|seen| ordered(seen) && seen.end <= 1.0)
            })
            && self.faces.iter().all(|f| f.corners.iter().all(corner))
            && self.false_junctions.iter().all(|junction| junction.edge.iter().all(edge))
    }
}
