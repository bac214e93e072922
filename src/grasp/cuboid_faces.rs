//! The faces of the one cuboid that corners and edges are seen of.
//!
//! ```text
//! # Method      (1) The cuboid: junctions at the corners, three rays from one of them and lengths told by others, then all
//!               of its edges that are seen (refine/cuboid_fit.rs; of several hypotheses the one with most evidence).
//!               (2) Its vertices: where a corner lies within the gate of one, that corner is where it is seen, with its
//!               own covariance; where none does, the vertex is completed by the cuboid. So hidden vertices are known,
//!               and known to be hidden. (3) Its faces that look at the camera and whose lengths are told, least
//!               gap first, gap being the share of a face's pixels that lack the target's colour:
//!                 least_occluded  the least gap; of gaps within 0.02 the larger in the image: the paper's rule;
//!                 graspable       the largest (1 - gap) area cos(a), a between approach and line of sight: what is seen
//!                                 well, whole and frontally, and tells most of where its centre is.
//! # Input       encoded exposure with intrinsics; the target's mask; refined corners in any order.
//! # Parameters  rule              least_occluded or graspable
//!               max_gap_fraction  none, 0.4   range [0.001, 1]: hidden share of the face; what hides it is in the way
//!               gate_px           px, 3       range [0.1, 20]: corners so near to a vertex are it
//!               max_corners       none, 60    range [4, 1000]: the strongest near the target
//! # Output      the face, its corners clockwise as seen, and all of the cuboid's vertices: seen ones, and completed ones
//!               where fewer than four are. too_few_corners below four near the target, no_cuboid, all_occluded.
//! # Border      as of cuboid_fit.
//! # Cost        that of cuboid_fit.
//! # Departures  The paper asks for small or no gaps and gives no formula. A vertex is never completed by the parallelogram
//!               rule, which perspective breaks.
//! # Source      the paper, section 5; Lowe 1991 and Drummond & Cipolla 2002 for the cuboid.
//! # Checked by  tests/it/estimators.rs
//! ```

use nalgebra::Matrix2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::cuboid::Cuboid;
use crate::detect::Detection;
use crate::geometry::{Camera, ImagePoint, signed_area_px2};
use crate::grasp::evidence::Target;
use crate::grasp::pose::{LEAST_VERTICES, SeenVertex};
use crate::grasp::{Face, FaceSelector, NoFace, SeenCuboid, covariance_or_default_px2};
use crate::refine::Corner;
use crate::refine::cuboid_fit::{Adjusted, CuboidFit};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;
use crate::target::TargetRegion;

/// The registry's line.
pub const ENTRY: Entry<dyn FaceSelector> = Entry {
    name: "cuboid_faces",
    summary: "a face of the one cuboid that corners and edges are of, hidden corners completed",
    reference: "the paper, section 5; Lowe 1991; Drummond & Cipolla 2002",
    version: 1,
    defaults: defaults::<CuboidFaces>,
    schema: schema::<CuboidFaces>,
    build: |place, table| Ok(Box::new(parameters::<CuboidFaces>(place, table)?)),
};

/// Which face is the best.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Rule {
    /// That of which least is hidden.
    #[default]
    LeastOccluded,
    /// That of which most is seen, frontally.
    Graspable,
}

/// The selector; its parameters are those of the header.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct CuboidFaces {
    /// Which face is the best.
    pub rule: Rule,
    /// Largest share of the chosen face's pixels that may be hidden.
    #[schemars(range(min = 0.001, max = 1.0))]
    pub max_gap_fraction: f64,
    /// Corners so near to a vertex are it \[px\].
    #[schemars(range(min = 0.1, max = 20.0))]
    pub gate_px: f64,
    /// How many of the strongest corners are considered.
    #[schemars(range(min = 4, max = 1000))]
    pub max_corners: u32,
}

impl Default for CuboidFaces {
    fn default() -> Self {
        Self { rule: Rule::LeastOccluded, max_gap_fraction: 0.4, gate_px: 3.0, max_corners: 60 }
    }
}

/// Steps of brightness matter to outlines only, which are known here.
const EDGE_STEP_FRACTION: f64 = 0.04;
/// Gaps are as good as equal that differ by less.
const SAME_GAP: f64 = 0.02;

/// A face that looks at the camera.
struct Candidate {
    vertices: [usize; 4],
    corners: [ImagePoint; 4],
    gap_fraction: f64,
    area_px2: f64,
    /// Of the angle between its normal and the line of sight.
    cosine: f64,
}

impl FaceSelector for CuboidFaces {
    fn select(
        &self,
        exposure: &Exposure,
        region: &TargetRegion,
        corners: &[Corner],
    ) -> Result<Face, NoFace> {
        let target = Target::new(exposure, region, EDGE_STEP_FRACTION);
        let near: Vec<&Corner> =
            corners.iter().filter(|corner| target.is_near(corner.position)).collect();
        if near.len() < LEAST_VERTICES {
            return Err(NoFace::TooFewCorners);
        }
        let camera = exposure.camera().ok_or(NoFace::NoCuboid)?;
        let seeds: Vec<Detection> =
            near.iter().map(|corner| Detection { point: corner.position, ..corner.seed }).collect();
        let fit = CuboidFit { seeds: self.max_corners, ..CuboidFit::default() };
        let fitted = fit.cuboid(exposure, &seeds).ok_or(NoFace::NoCuboid)?;
        let all = vertices(&fitted, camera, &near, self.gate_px);
        let mut faces: Vec<Candidate> = candidates(&fitted.cuboid, &all, &target).collect();
        faces.retain(|face| face.gap_fraction <= self.max_gap_fraction);
        let best = self.best(&faces).ok_or(NoFace::AllOccluded)?;
        Ok(face(best, &all, &fitted.cuboid))
    }
}

impl CuboidFaces {
    fn best<'a>(&self, faces: &'a [Candidate]) -> Option<&'a Candidate> {
        let least_gap = faces.iter().map(|face| face.gap_fraction).fold(1.0, f64::min);
        let is_among = |face: &&Candidate| match self.rule {
            Rule::LeastOccluded => face.gap_fraction <= least_gap + SAME_GAP,
            Rule::Graspable => true,
        };
        let worth = |face: &Candidate| match self.rule {
            Rule::LeastOccluded => face.area_px2,
            Rule::Graspable => (1.0 - face.gap_fraction) * face.area_px2 * face.cosine,
        };
        faces.iter().filter(is_among).max_by(|a, b| worth(a).total_cmp(&worth(b)))
    }
}

/// A vertex where it is seen, or where it must be.
#[derive(Clone, Copy)]
struct Vertex {
    point: ImagePoint,
    covariance_px2: Matrix2<f64>,
    is_seen: bool,
}

/// The vertices of the faces that look at the camera.
fn vertices(
    fitted: &Adjusted,
    camera: &Camera,
    corners: &[&Corner],
    gate_px: f64,
) -> [Option<Vertex>; 8] {
    let completed: [Option<Vertex>; 8] = std::array::from_fn(|index| {
        let (point, covariance_px2) =
            fitted.cuboid.shows_vertex(index).then(|| fitted.vertex(index, camera))??;
        Some(Vertex { point, covariance_px2, is_seen: false })
    });
    let mut all = completed;
    // Of corners that are near to one vertex the nearest; a corner is no two vertices.
    let mut nearest_px = [gate_px; 8];
    for corner in corners.iter().filter(|corner| corner.status.answered()) {
        let distances_px = completed.iter().enumerate().filter_map(|(index, vertex)| {
            Some((index, vertex.as_ref()?.point.distance_px(corner.position)))
        });
        let Some((index, distance_px)) = distances_px.min_by(|a, b| a.1.total_cmp(&b.1)) else {
            continue;
        };
        if distance_px <= nearest_px[index] {
            nearest_px[index] = distance_px;
            all[index] = Some(Vertex {
                point: corner.position,
                covariance_px2: covariance_or_default_px2(corner.covariance_px2),
                is_seen: true,
            });
        }
    }
    all
}

/// The faces that look at the camera and whose corners are all known.
fn candidates<'a>(
    cuboid: &'a Cuboid,
    all: &'a [Option<Vertex>; 8],
    target: &'a Target,
) -> impl Iterator<Item = Candidate> + 'a {
    let sides = (0..3).flat_map(|axis| [(axis, false), (axis, true)]);
    sides.filter(|(axis, is_end)| cuboid.faces(*axis, *is_end)).filter_map(|(axis, is_end)| {
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3].map(|other| 1_usize << other);
        let from = usize::from(is_end) << axis;
        let mut vertices = [from, from | u, from | u | v, from | v];
        let is_told = |of: usize| (0..3).all(|k| of & 1 << k == 0 || cuboid.is_known[k]);
        if !vertices.iter().all(|vertex| is_told(*vertex)) {
            return None;
        }
        let corner = |vertex: usize| all[vertex].map(|vertex| vertex.point);
        let mut corners = [corner(vertices[0])?; 4];
        for (place, vertex) in corners.iter_mut().zip(vertices) {
            *place = corner(vertex)?;
        }
        let mut area_px2 = signed_area_px2(&corners);
        if area_px2 < 0.0 {
            corners.reverse();
            vertices.reverse();
            area_px2 = -area_px2;
        }
        let middle = vertices
            .map(|vertex| cuboid.point(Cuboid::shares(vertex)))
            .iter()
            .sum::<nalgebra::Vector3<f64>>();
        let cosine = cuboid.axes[axis].dot(&middle.normalize()).abs();
        let gap_fraction = target.gap_fraction(&corners)?;
        Some(Candidate { vertices, corners, gap_fraction, area_px2, cosine })
    })
}

/// The face with all that is seen of its cuboid, whose axes are numbered such that they are right-handed.
fn face(best: &Candidate, all: &[Option<Vertex>; 8], cuboid: &Cuboid) -> Face {
    let is_mirrored = nalgebra::Matrix3::from_columns(&cuboid.axes).determinant() < 0.0;
    // The first two axes, one for the other.
    let number = |vertex: usize| match is_mirrored {
        true => vertex & 4 | (vertex & 1) << 1 | (vertex & 2) >> 1,
        false => vertex,
    };
    let is_seen = |vertex: &&Vertex| vertex.is_seen;
    let are_enough = all.iter().flatten().filter(is_seen).count() >= LEAST_VERTICES;
    let seen = |index: usize| {
        // What is renumbered twice has its number again.
        let vertex = all[number(index)].filter(|vertex| vertex.is_seen || !are_enough)?;
        let Vertex { point, covariance_px2, .. } = vertex;
        Some(SeenVertex { vertex: index, point, covariance_px2 })
    };
    let covariance = |vertex: usize| all[vertex].map(|vertex| vertex.covariance_px2);
    Face {
        corners: best.corners,
        covariances_px2: best.vertices.map(covariance),
        gap_fraction: best.gap_fraction,
        cuboid: Some(SeenCuboid {
            vertices: std::array::from_fn(seen),
            face: best.vertices.map(number),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(gap_fraction: f64, area_px2: f64, cosine: f64) -> Candidate {
        let corners = [ImagePoint::new(0.0, 0.0); 4];
        Candidate { vertices: [0; 4], corners, gap_fraction, area_px2, cosine }
    }

    #[test]
    fn the_least_gap_decides_and_of_like_gaps_the_area_whatever_the_order() {
        // Each is like the next, and the last not like the first.
        let faces =
            [candidate(0.0, 100.0, 1.0), candidate(0.015, 200.0, 1.0), candidate(0.03, 300.0, 1.0)];
        let gap = |rule: Rule, order: [usize; 3]| {
            let faces = order.map(|place| {
                let Candidate { gap_fraction, area_px2, cosine, .. } = faces[place];
                candidate(gap_fraction, area_px2, cosine)
            });
            let selector = CuboidFaces { rule, ..CuboidFaces::default() };
            selector.best(&faces).expect("a face").gap_fraction
        };
        for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            assert!((gap(Rule::LeastOccluded, order) - 0.015).abs() < 1e-12, "{order:?}");
            assert!((gap(Rule::Graspable, order) - 0.03).abs() < 1e-12, "{order:?}");
        }
        assert!(CuboidFaces::default().best(&[]).is_none());
    }
}
