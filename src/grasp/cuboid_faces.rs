//! The faces of the one cuboid that corners and edges are seen of.
//!
//! ```text
//! # Method      (1) The cuboid: junctions at the corners, three rays from one of them, or two junctions at the ends of
//!               one edge, and lengths told by others, then all of its edges that are seen (refine/cuboid_fit.rs; of
//!               several hypotheses the one with most evidence).
//!               (2) Its vertices: where a corner lies within the gate of one, that corner is where it is seen, with its
//!               own covariance; where none does, the vertex is completed by the cuboid. So hidden vertices are known,
//!               and known to be hidden. (3) Its faces that look at the camera and whose lengths are told, least
//!               gap first, gap being the share of a face's pixels that lack the target's colour:
//!                 least_occluded  the least gap; of gaps within 0.02 the larger in the image: the paper's rule;
//!                 graspable       the largest (1 - gap) area cos(a), a between approach and line of sight: what is seen
//!                                 well, whole and frontally, and tells most of where its centre is;
//!                 holdable        the largest (1 - gap) (1 + n up): the more from above, the less is in a gripper's way;
//!                                 of faces across whose shorter side it can close: no longer than most_opening_m, as far
//!                                 as the cuboid's size is known, and not upright, for then one jaw is in the floor; half
//!                                 of it where range cells lie in the way of jaws or palm, as far as that size is known.
//! # Input       encoded exposure with intrinsics; the target's mask; refined corners in any order; for holdable the
//!               camera's attitude in a world whose z is up, the cuboid's size and range cells.
//! # Parameters  rule              least_occluded, graspable or holdable
//!               max_gap_fraction  none, 0.4   range [0.001, 1]: hidden share of the face; what hides it is in the way
//!               most_opening_m    m, 0.16     range [0.001, 10]: of the gripper; for holdable
//!               jaw_m             m, 0.015    range [0, 1]: a jaw's thickness and the room beside it; for holdable
//!               depth_m           m, 0.03     range [0, 1]: how far jaws reach beyond the face; for holdable
//!               least_margin      none, 0     range [0, 1]: declined where the next cuboid lacks a smaller share of the
//!                                             chosen one's evidence; 0 never declines
//!               gate_px           px, 3       range [0.1, 20]: corners so near to a vertex are it
//!               max_corners       none, 60    range [4, 1000]: the strongest near the target
//! # Output      the face, its corners clockwise as seen, and all of the cuboid's vertices: seen ones, and completed ones
//!               where fewer than four are. too_few_corners below four near the target, no_cuboid, ambiguous_cuboid, all_occluded.
//!               How many different cuboids fitted, and by what share the chosen one is ahead.
//! # Border      as of cuboid_fit.
//! # Cost        that of cuboid_fit.
//! # Departures  The paper asks for small or no gaps and gives no formula. A vertex is never completed by the parallelogram
//!               rule, which perspective breaks.
//! # Source      the paper, section 5; Lowe 1991 and Drummond & Cipolla 2002 for the cuboid.
//! # Checked by  tests/it/estimators.rs
//! ```

use nalgebra::{
    Isometry3, Matrix2, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::cuboid::Cuboid;
use crate::detect::Detection;
use crate::geometry::{Camera, ImagePoint, signed_area_px2};
use crate::grasp::evidence::Target;
use crate::grasp::pose::{LEAST_VERTICES, SeenVertex};
use crate::grasp::{
    Face, FaceSelector, NoFace, Recognition, SeenCuboid, covariance_or_default_px2,
};
use crate::refine::Corner;
use crate::refine::cuboid_fit::{Adjusted, CuboidFit};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::{Exposure, RangeImage, Rig};
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
    /// That from most above, of those that a gripper can close on.
    Holdable,
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
    /// How far the gripper opens, for the rule holdable \[m\].
    #[schemars(range(min = 0.001, max = 10.0))]
    pub most_opening_m: f64,
    /// A jaw's thickness and the room beside it, for the rule holdable \[m\].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub jaw_m: f64,
    /// How far jaws reach beyond the face, for the rule holdable \[m\].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub depth_m: f64,
    /// By what share of its evidence the cuboid must be ahead of the next one.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub least_margin: f64,
    /// Corners so near to a vertex are it \[px\].
    #[schemars(range(min = 0.1, max = 20.0))]
    pub gate_px: f64,
    /// How many of the strongest corners are considered.
    #[schemars(range(min = 4, max = 1000))]
    pub max_corners: u32,
}

impl Default for CuboidFaces {
    fn default() -> Self {
        Self {
            rule: Rule::LeastOccluded,
            max_gap_fraction: 0.4,
            most_opening_m: 0.16,
            jaw_m: 0.015,
            depth_m: 0.03,
            least_margin: 0.0,
            gate_px: 3.0,
            max_corners: 60,
        }
    }
}

/// Steps of brightness matter to outlines only, which are known here.
const EDGE_STEP_FRACTION: f64 = 0.04;
/// Cosine of the angle from the vertical at which jaws begin to reach below what they close on.
const MOST_UPRIGHT: f64 = 0.5;
/// Gaps are as good as equal that differ by less.
const SAME_GAP: f64 = 0.02;
/// Two cuboids are the same whose vertices are seen no farther apart \[px\].
const SAME_PX: f64 = 3.0;
/// What of a gripper's way is looked at: half its width across the jaws, where its palm begins above the face, and how far
/// it is as it comes; nearer than this to the target's own faces cells are the target's \[m\].
const HALF_WIDTH_M: f64 = 0.02;
const PALM_M: f64 = 0.02;
const WAY_M: f64 = 0.12;
const OWN_M: f64 = 0.005;
/// What a face is worth that something is in the way of, of what it would be worth.
const IN_THE_WAY: f64 = 0.5;

/// A face that looks at the camera.
struct Candidate {
    vertices: [usize; 4],
    corners: [ImagePoint; 4],
    gap_fraction: f64,
    area_px2: f64,
    /// Of the angle between its normal and the line of sight.
    cosine: f64,
    /// How much its normal looks up: 1 of the top.
    upwards: f64,
    /// How upright its shorter side is: 1 where it stands.
    shorter_side_upright: f64,
    /// The length of that side, where the cuboid's size is known.
    shorter_side_m: Option<f64>,
    /// From the face's middle along the jaws, across them and outwards, at depth 1 of the first vertex; and half the
    /// extents of the face along the first two.
    frame: Isometry3<f64>,
    half: [f64; 2],
}

/// Range cells in the camera frame, in units of the cuboid, which are so long \[m\].
struct Cells {
    points: Vec<Point3<f64>>,
    scale_m: f64,
}

impl FaceSelector for CuboidFaces {
    fn select(
        &self,
        exposure: &Exposure,
        region: &TargetRegion,
        corners: &[Corner],
        rig: &Rig,
        range: &RangeImage,
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
        let found = fit.cuboids(exposure, &seeds);
        let fitted = found.first().ok_or(NoFace::NoCuboid)?;
        let recognition = recognition(&found, camera);
        if recognition.margin < self.least_margin {
            return Err(NoFace::AmbiguousCuboid);
        }
        let all = vertices(fitted, camera, &near, self.gate_px);
        let mut faces: Vec<Candidate> = candidates(&fitted.cuboid, &all, &target, rig).collect();
        faces.retain(|face| face.gap_fraction <= self.max_gap_fraction);
        let cells = rig.object_size_m.map(|size_m| Cells::of(&fitted.cuboid, size_m, rig, range));
        let best = self.best(&faces, cells.as_ref()).ok_or(NoFace::AllOccluded)?;
        Ok(Face { recognition: Some(recognition), ..face(best, &all, &fitted.cuboid) })
    }
}

impl CuboidFaces {
    fn best<'a>(&self, faces: &'a [Candidate], cells: Option<&Cells>) -> Option<&'a Candidate> {
        let least_gap = faces.iter().map(|face| face.gap_fraction).fold(1.0, f64::min);
        let is_among = |face: &&Candidate| match self.rule {
            Rule::LeastOccluded => face.gap_fraction <= least_gap + SAME_GAP,
            Rule::Graspable => true,
            Rule::Holdable => {
                face.shorter_side_upright < MOST_UPRIGHT
                    && face.shorter_side_m.is_none_or(|side_m| side_m <= self.most_opening_m)
            }
        };
        let worth = |face: &Candidate| match self.rule {
            Rule::LeastOccluded => face.area_px2,
            Rule::Graspable => (1.0 - face.gap_fraction) * face.area_px2 * face.cosine,
            Rule::Holdable => {
                let is_clear = cells.is_none_or(|cells| self.is_clear(face, cells));
                let share = if is_clear { 1.0 } else { IN_THE_WAY };
                share * (1.0 - face.gap_fraction) * (1.0 + face.upwards)
            }
        };
        faces.iter().filter(is_among).max_by(|a, b| worth(a).total_cmp(&worth(b)))
    }
}

impl CuboidFaces {
    /// Whether no cell is where the jaws come down beside a face, or the palm above it.
    fn is_clear(&self, face: &Candidate, cells: &Cells) -> bool {
        let [along_m, across_m] = face.half.map(|half| half * cells.scale_m);
        let is_in_the_way = |point: &Point3<f64>| {
            let place = face.frame.inverse_transform_point(point) * cells.scale_m;
            let beside_m = place.x.abs() - along_m;
            let is_own = beside_m < OWN_M && place.y.abs() < across_m + OWN_M && place.z < OWN_M;
            let is_within = place.y.abs() < HALF_WIDTH_M && place.z < WAY_M;
            let is_at_jaw =
                beside_m > 0.0 && beside_m < OWN_M + self.jaw_m && place.z > -self.depth_m;
            let is_at_palm = beside_m < self.jaw_m && place.z > PALM_M;
            !is_own && is_within && (is_at_jaw || is_at_palm)
        };
        !cells.points.iter().any(is_in_the_way)
    }
}

impl Cells {
    fn of(cuboid: &Cuboid, size_m: [f64; 3], rig: &Rig, range: &RangeImage) -> Self {
        let scale_m = scale_m(cuboid, size_m);
        let camera_from_range = rig.world_from_camera.inverse() * range.world_from_range;
        let cells = range.points.samples().iter().flatten();
        Self { points: cells.map(|point| camera_from_range * point / scale_m).collect(), scale_m }
    }
}

/// How certain it is that the first cuboid is what is seen.
fn recognition(found: &[Adjusted], camera: &Camera) -> Recognition {
    let shown = |adjusted: &Adjusted| -> Vec<ImagePoint> {
        let shown = (0..8).filter(|vertex| adjusted.cuboid.shows_vertex(*vertex));
        shown.filter_map(|vertex| adjusted.cuboid.vertex(vertex, camera)).collect()
    };
    let has = |all: &[ImagePoint], point: &ImagePoint| {
        all.iter().any(|other| other.distance_px(*point) < SAME_PX)
    };
    let mut different: Vec<(Vec<ImagePoint>, f64)> = Vec::new();
    for adjusted in found {
        let own = shown(adjusted);
        let is_known = different.iter().any(|(other, _)| {
            own.iter().all(|point| has(other, point)) && other.iter().all(|point| has(&own, point))
        });
        if !is_known {
            different.push((own, adjusted.evidence));
        }
    }
    let margin = match &different[..] {
        [(_, best), (_, next), ..] if *best > 0.0 => (1.0 - next / best).clamp(0.0, 1.0),
        _ => 1.0,
    };
    Recognition { hypotheses: different.len(), margin }
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
    rig: &Rig,
) -> impl Iterator<Item = Candidate> + 'a {
    let up = rig.world_from_camera.inverse_transform_vector(&Vector3::z());
    let scale_m = rig.object_size_m.map(|size_m| scale_m(cuboid, size_m));
    let sides = (0..3).flat_map(|axis| [(axis, false), (axis, true)]);
    sides.filter(|(axis, is_end)| cuboid.faces(*axis, *is_end)).filter_map(move |(axis, is_end)| {
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
            .sum::<Vector3<f64>>();
        let cosine = cuboid.axes[axis].dot(&middle.normalize()).abs();
        let gap_fraction = target.gap_fraction(&corners)?;
        let outwards = if is_end { cuboid.axes[axis] } else { -cuboid.axes[axis] };
        let [one, other] = [(axis + 1) % 3, (axis + 2) % 3];
        let (shorter, longer) =
            if cuboid.lengths[one] <= cuboid.lengths[other] { (one, other) } else { (other, one) };
        let jaw = cuboid.axes[shorter];
        let turn = Matrix3::from_columns(&[jaw, outwards.cross(&jaw), outwards]);
        let frame = Isometry3::from_parts(
            Translation3::from(middle / 4.0),
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn)),
        );
        Some(Candidate {
            vertices,
            corners,
            gap_fraction,
            area_px2,
            cosine,
            upwards: outwards.dot(&up),
            shorter_side_upright: cuboid.axes[shorter].dot(&up).abs(),
            shorter_side_m: scale_m.map(|scale_m| cuboid.lengths[shorter] * scale_m),
            frame,
            half: [shorter, longer].map(|side| 0.5 * cuboid.lengths[side]),
        })
    })
}

/// What makes metres of a cuboid's lengths whose true ones are known in any order: the mean ratio of those that are told,
/// in the order in which the ratios are most alike.
fn scale_m(cuboid: &Cuboid, size_m: [f64; 3]) -> f64 {
    const ORDERS: [[usize; 3]; 6] =
        [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let of_order = |order: [usize; 3]| {
        let told = (0..3).filter(|axis| cuboid.is_known[*axis]);
        let ratios: Vec<f64> =
            told.map(|axis| (size_m[order[axis]] / cuboid.lengths[axis]).ln()).collect();
        let mean = ratios.iter().sum::<f64>() / ratios.len().max(1) as f64;
        (ratios.iter().map(|ratio| (ratio - mean).powi(2)).sum::<f64>(), mean.exp())
    };
    let best = ORDERS.map(of_order).into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or(1.0, |(_, scale_m)| scale_m)
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
        recognition: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;
    use crate::image::{PixelRange, Plane};
    use crate::sensor::{Encoding, Transfer};

    fn candidate(gap_fraction: f64, area_px2: f64, cosine: f64) -> Candidate {
        let corners = [ImagePoint::new(0.0, 0.0); 4];
        Candidate {
            vertices: [0; 4],
            corners,
            gap_fraction,
            area_px2,
            cosine,
            upwards: 0.0,
            shorter_side_upright: 0.0,
            shorter_side_m: Some(0.1),
            frame: Isometry3::identity(),
            half: [0.05, 0.08],
        }
    }

    #[test]
    fn a_gripper_closes_on_the_top_unless_it_is_too_wide_and_never_into_the_floor() {
        let top = || Candidate { upwards: 1.0, ..candidate(0.3, 100.0, 0.3) };
        let front = || candidate(0.0, 400.0, 0.9);
        let selector = CuboidFaces { rule: Rule::Holdable, ..CuboidFaces::default() };
        let gap = |faces: &[Candidate]| selector.best(faces, None).map(|face| face.gap_fraction);
        assert_eq!(gap(&[front(), top()]), Some(0.3));
        let wide = Candidate { shorter_side_m: Some(0.17), ..top() };
        assert_eq!(gap(&[front(), wide]), Some(0.0));
        let low = Candidate { shorter_side_upright: 0.9, ..front() };
        assert_eq!(gap(&[low]), None);
        let of_unknown_size = Candidate { shorter_side_m: None, ..top() };
        assert_eq!(gap(&[front(), of_unknown_size]), Some(0.3));
    }

    #[test]
    fn cells_are_in_the_way_of_jaws_and_palm_but_not_where_the_target_is() {
        // A face of 10 x 16 cm at depth 0.8 m that looks at the camera, in units of 2 m; jaws along y.
        let turn = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[
            Vector3::y(),
            Vector3::x(),
            -Vector3::z(),
        ]));
        let frame = Isometry3::from_parts(
            Translation3::new(0.1, 0.2, 0.4),
            UnitQuaternion::from_rotation_matrix(&turn),
        );
        let face = Candidate { frame, half: [0.025, 0.04], ..candidate(0.0, 100.0, 1.0) };
        let selector = CuboidFaces { rule: Rule::Holdable, ..CuboidFaces::default() };
        let is_clear = |along_m: f64, across_m: f64, outwards_m: f64| {
            let points = vec![frame * (Point3::new(along_m, across_m, outwards_m) / 2.0)];
            selector.is_clear(&face, &Cells { points, scale_m: 2.0 })
        };
        for side in [-1.0, 1.0] {
            assert!(!is_clear(side * 0.06, 0.0, 0.0), "beside it, where a jaw comes down");
            assert!(!is_clear(side * 0.06, 0.01, -0.025), "as deep as it reaches");
            assert!(is_clear(side * 0.06, 0.0, -0.04), "deeper");
            assert!(is_clear(side * 0.08, 0.0, 0.0), "farther");
            assert!(is_clear(side * 0.06, side * 0.05, 0.0), "not where it comes down");
            assert!(is_clear(side * 0.02, side * 0.01, 0.0), "on the face");
            assert!(is_clear(side * 0.051, 0.0, -0.02), "on its side");
            assert!(!is_clear(side * 0.02, side * 0.01, 0.05), "above the face");
            assert!(is_clear(side * 0.02, side * 0.01, 0.15), "above the hand");
        }
        let points = vec![frame * Point3::new(0.03, 0.0, 0.0)];
        let cells = Cells { points, scale_m: 2.0 };
        let elsewhere = Isometry3::translation(5.0, 0.0, 0.0);
        let far = || Candidate { frame: elsewhere, ..candidate(0.2, 100.0, 1.0) };
        // Half of what a top is worth is more than a side with a gap of a fifth, a whole one is more than half.
        let chosen = |upwards: f64| {
            let Candidate { frame, half, .. } = face;
            let blocked = Candidate { frame, half, upwards, ..candidate(0.0, 100.0, 1.0) };
            let faces = [blocked, far()];
            selector.best(&faces, Some(&cells)).map(|face| face.gap_fraction)
        };
        assert_eq!(chosen(1.0), Some(0.0));
        assert_eq!(chosen(0.5), Some(0.2));
    }

    #[test]
    fn cuboids_that_look_alike_are_one_and_others_leave_a_margin() {
        let camera = Camera::pinhole(64, 64, 64.0);
        let of = |lengths: [f64; 3], evidence: f64| {
            let first = Vector3::new(-0.1, -0.1, 1.0);
            let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
            Adjusted::certain(Cuboid { axes, first, lengths, is_known: [true; 3] }, evidence)
        };
        let one = |evidence| of([0.2, 0.3, 0.4], evidence);
        let alone = recognition(&[one(80.0), of([0.21, 0.3, 0.4], 79.0)], &camera);
        assert_eq!(alone, Recognition { hypotheses: 1, margin: 1.0 });
        let several = recognition(&[one(80.0), one(79.0), of([0.3, 0.3, 0.4], 60.0)], &camera);
        assert_eq!(several, Recognition { hypotheses: 2, margin: 0.25 });
    }

    #[test]
    fn metres_come_from_the_lengths_that_are_told_in_whatever_order() {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let first = Vector3::z();
        let lengths = [0.18 / 0.7, 0.12 / 0.7, 0.14 / 0.7];
        for is_known in [[true; 3], [true, true, false]] {
            let cuboid = Cuboid { axes, first, lengths, is_known };
            let found = scale_m(&cuboid, [0.12, 0.14, 0.18]);
            assert!((found - 0.7).abs() < 1e-12, "{is_known:?}: {found}");
        }
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
            selector.best(&faces, None).expect("a face").gap_fraction
        };
        for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            assert!((gap(Rule::LeastOccluded, order) - 0.015).abs() < 1e-12, "{order:?}");
            assert!((gap(Rule::Graspable, order) - 0.03).abs() < 1e-12, "{order:?}");
        }
        assert!(CuboidFaces::default().best(&[], None).is_none());
    }

    fn cuboid(axes: [Vector3<f64>; 3]) -> Cuboid {
        let first = Vector3::new(-0.1, -0.1, 1.0);
        Cuboid { axes, first, lengths: [0.2, 0.3, 0.4], is_known: [true; 3] }
    }

    fn at(point: ImagePoint) -> Option<Vertex> {
        Some(Vertex { point, covariance_px2: Matrix2::identity(), is_seen: true })
    }

    #[test]
    fn vertices_are_numbered_such_that_axes_are_right_handed() {
        let [x, y, z] = [Vector3::x(), Vector3::y(), Vector3::z()];
        // Each vertex is where its own number says.
        let place = |vertex: u8| ImagePoint::new(f64::from(vertex), 0.0);
        let all = [0, 1, 2, 3, 4, 5, 6, 7].map(|vertex| at(place(vertex)));
        for axes in [[x, y, z], [y, x, z], [x, z, y]] {
            let cuboid = cuboid(axes);
            let best = Candidate {
                vertices: [0, 2, 6, 4],
                corners: [0, 2, 6, 4].map(place),
                ..candidate(0.0, 1.0, 1.0)
            };
            let face = face(&best, &all, &cuboid);
            let seen = face.cuboid.expect("a cuboid");
            let point = |number: usize| seen.vertices[number].expect("a vertex").point;
            let of_number = |number: usize| {
                let own = (0_u8..8).position(|vertex| place(vertex) == point(number));
                cuboid.point(Cuboid::shares(own.expect("one of them")))
            };
            let found = [1, 2, 4].map(|end| of_number(end) - of_number(0));
            assert!(Matrix3::from_columns(&found).determinant() > 0.0, "{axes:?}");
            assert_eq!(seen.face.map(point), face.corners, "{axes:?}");
        }
    }

    #[test]
    fn what_hides_a_part_of_a_face_is_its_gap() {
        // Red over the pixels from (12, 16) to (43, 51), but for 10 x 10 of them.
        let is_red = |x: usize, y: usize| {
            let is_hidden = (20..30).contains(&x) && (30..40).contains(&y);
            (12..44).contains(&x) && (16..52).contains(&y) && !is_hidden
        };
        let mask = Plane::from_fn(64, 64, is_red);
        let rgb = [200.0, 20.0, 20.0].map(|dn| mask.map(|is_red| if is_red { dn } else { 120.0 }));
        let encoding = Encoding { bit_depth: 8, transfer: Transfer::Srgb, black_dn: 0.0 };
        let exposure = Exposure::new(rgb, encoding).expect("finite");
        let corners =
            [[12.0, 16.0], [43.0, 16.0], [43.0, 51.0], [12.0, 51.0]].map(ImagePoint::from);
        let range = PixelRange { x0: 12, y0: 16, x1: 44, y1: 52 };
        let region = TargetRegion { mask, range, quadrilateral: corners, pixels: 32 * 36 - 100 };
        let target = Target::new(&exposure, &region, EDGE_STEP_FRACTION);
        // Only the face across the line of sight looks here.
        let cuboid = cuboid([Vector3::x(), Vector3::y(), Vector3::z()]);
        let [a, b, c, d] = corners.map(at);
        let all = [a, b, d, c, None, None, None, None];
        let camera = Camera::pinhole(64, 64, 64.0);
        let rig = Rig { camera, world_from_camera: Pose::identity(), object_size_m: None };
        let found: Vec<Candidate> = candidates(&cuboid, &all, &target, &rig).collect();
        let [face] = &found[..] else { panic!("{}", found.len()) };
        assert_eq!(face.corners, corners);
        // Pixels at least 1.5 px inside: 28 x 32.
        assert!((face.gap_fraction - 100.0 / 896.0).abs() < 1e-12, "{}", face.gap_fraction);
    }
}
