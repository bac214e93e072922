//! Which cuboid has its corners where junctions are.
//!
//! Three rays from one point are the picture of three edges at right angles in one way only, if all three are to be
//! seen: with e_i the directions of the planes through the camera and each ray, across the line of sight, and c_i
//! the cotangent of the angle between line of sight and edge, c_i c_j = -e_i . e_j.
//!
//! Where no three rays are seen, two junctions at the ends of one edge have them together: two more of their rays, one
//! of each, are parallel edges, whose direction is where the planes through the camera and each of them meet; the edge
//! between the junctions is at right angles to it, in its own plane, and the third edge to both, away from the camera.
//!
//! How long the edges are other junctions tell.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Vector3};

use crate::cuboid::Cuboid;
use crate::geometry::{Camera, ImagePoint};
use crate::junction::rays::{MOST_RAYS, Rays};

/// Junctions lie so near to a vertex they are taken for \[px\], and their rays to its edges \[rad\].
const NEAR_PX: f64 = 5.0;
const NEAR_RAD: f64 = 0.2;

/// Lengths of an axis that are tried.
const MOST_LENGTHS: usize = 8;

/// Edges that are seen shorter than this are none \[px\].
const LEAST_LENGTH_PX: f64 = 10.0;

/// The cuboids of three rays at one junction that explain most rays of junctions, at least so many, the best first; few,
/// or none.
pub(super) fn of_three_rays(junctions: &[Rays], camera: &Camera, least_rays: usize) -> Vec<Cuboid> {
    let three = junctions.iter().filter(|rays| rays.count == MOST_RAYS);
    likely(three.filter_map(|rays| trihedron(rays, camera)), junctions, camera, least_rays)
}

/// The same of two junctions at the ends of one edge.
pub(super) fn of_two_junctions(
    junctions: &[Rays],
    camera: &Camera,
    least_rays: usize,
) -> Vec<Cuboid> {
    let pairs = junctions.iter().flat_map(|one| junctions.iter().map(move |other| [one, other]));
    let trihedra = pairs.flat_map(|[one, other]| of_pair(one, other, camera));
    likely(trihedra, junctions, camera, least_rays)
}

/// The trihedra at a junction of which one edge ends at another and one is parallel to one there.
fn of_pair(one: &Rays, other: &Rays, camera: &Camera) -> Vec<Cuboid> {
    let [from, to] = [one, other].map(|rays| ImagePoint::from(rays.vertex));
    if from.distance_px(to) < LEAST_LENGTH_PX {
        return Vec::new();
    }
    let along = (to.y - from.y).atan2(to.x - from.x);
    // The rays that do not lead to the other junction; none where none does.
    let others = |rays: &Rays, towards: f64| -> Vec<f64> {
        let angles = &rays.angles_rad[..rays.count];
        let leads = |angle: &f64| apart(*angle, towards) < NEAR_RAD;
        let others = angles.iter().copied().filter(|angle| !leads(angle));
        if angles.iter().any(leads) { others.collect() } else { Vec::new() }
    };
    let [first, end] = [from, to].map(|point| camera.ray(point));
    let between = first.cross(&end);
    let mut found = Vec::new();
    for angle in others(one, along) {
        for other_angle in others(other, along + PI) {
            // Parallel edges leave the ends of an edge to the same side.
            if (angle - along).sin() * (other_angle - along).sin() <= 0.0 {
                continue;
            }
            let parallel = plane(from, angle, camera).cross(&plane(to, other_angle, camera));
            let towards = |axis: Vector3<f64>, there: Vector3<f64>| {
                // Of the two ways the one on whose side it is seen.
                let across = there - first * (there.dot(&first) / first.norm_squared());
                if axis.dot(&across) < 0.0 { -axis } else { axis }
            };
            let v = towards(parallel, ray_towards(from, angle, camera));
            let u = towards(between.cross(&v), end);
            let w = u.cross(&v);
            let w = if w.dot(&first) < 0.0 { -w } else { w };
            let Some(axes) = orthonormal([u, v, w].map(|axis| axis.normalize())) else { continue };
            if axes.iter().all(|axis| axis.iter().all(|value| value.is_finite())) {
                found.push(Cuboid { axes, first, lengths: [0.0; 3], is_known: [true; 3] });
            }
        }
    }
    found
}

/// How far along a ray its direction in space is looked up \[px\].
const STEP_PX: f64 = 4.0;

/// A line of sight a little along a ray.
fn ray_towards(vertex: ImagePoint, angle_rad: f64, camera: &Camera) -> Vector3<f64> {
    let (sine, cosine) = angle_rad.sin_cos();
    camera.ray(ImagePoint::new(vertex.x + STEP_PX * cosine, vertex.y + STEP_PX * sine))
}

/// The unit normal of the plane through the camera and a ray.
fn plane(vertex: ImagePoint, angle_rad: f64, camera: &Camera) -> Vector3<f64> {
    camera.ray(vertex).cross(&ray_towards(vertex, angle_rad, camera)).normalize()
}

/// Of these trihedra, with every length that something tells, the cuboids that explain most rays of junctions.
fn likely(
    trihedra: impl Iterator<Item = Cuboid>,
    junctions: &[Rays],
    camera: &Camera,
    least_rays: usize,
) -> Vec<Cuboid> {
    const MOST: usize = 6;
    let mut found: Vec<(usize, Cuboid)> = Vec::new();
    for trihedron in trihedra {
        let lengths = lengths(&trihedron, junctions, camera);
        for a in &lengths[0] {
            for b in &lengths[1] {
                for c in &lengths[2] {
                    let Some(cuboid) = of_lengths(&trihedron, [*a, *b, *c]) else { continue };
                    let explained = explained(&cuboid, junctions, camera);
                    let place = found.partition_point(|(other, _)| *other >= explained);
                    if explained >= least_rays && place < MOST {
                        found.insert(place, (explained, cuboid));
                        found.truncate(MOST);
                    }
                }
            }
        }
    }
    found.into_iter().map(|(_, cuboid)| cuboid).collect()
}

/// It, with lengths of which some may be unknown, where edges are hidden: these are taken for as long as the others.
fn of_lengths(trihedron: &Cuboid, lengths: [Option<f64>; 3]) -> Option<Cuboid> {
    let known = lengths.iter().flatten();
    let mean = known.clone().sum::<f64>() / known.count().max(1) as f64;
    let lengths_or_mean = lengths.map(|length| length.unwrap_or(mean));
    let is_known = lengths.map(|length| length.is_some());
    (mean > 0.0).then_some(Cuboid { lengths: lengths_or_mean, is_known, ..*trihedron })
}

/// Three edges at right angles, of no length yet.
fn trihedron(rays: &Rays, camera: &Camera) -> Option<Cuboid> {
    let vertex = ImagePoint::from(rays.vertex);
    let first = camera.ray(vertex);
    let sight = first.normalize();
    let across = rays.angles_rad.map(|angle| {
        let there = ray_towards(vertex, angle, camera);
        (there - sight * there.dot(&sight)).normalize()
    });
    let product = |i: usize, j: usize| -across[i].dot(&across[j]);
    let mut cotangents = [0.0; 3];
    for (i, cotangent) in cotangents.iter_mut().enumerate() {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let square = product(i, j) * product(i, k) / product(j, k);
        if !square.is_finite() || square <= 0.0 {
            return None;
        }
        *cotangent = square.sqrt();
    }
    // Of two signs each the products are right; of these two the one that shows all three edges.
    for signs in 0..8 {
        let signed: [f64; 3] =
            std::array::from_fn(
                |i| if signs & 1 << i == 0 { cotangents[i] } else { -cotangents[i] },
            );
        let is_right =
            (0..3).all(|i| signed[i] * signed[(i + 1) % 3] * product(i, (i + 1) % 3) > 0.0);
        let away = signed.iter().filter(|cotangent| **cotangent > 0.0).count();
        if is_right && away >= 2 {
            let axes: [Vector3<f64>; 3] =
                std::array::from_fn(|i| (sight * signed[i] + across[i]).normalize());
            let axes = orthonormal(axes)?;
            return Some(Cuboid { axes, first, lengths: [0.0; 3], is_known: [true; 3] });
        }
    }
    None
}

/// The nearest axes at right angles.
fn orthonormal(axes: [Vector3<f64>; 3]) -> Option<[Vector3<f64>; 3]> {
    let decomposed = Matrix3::from_columns(&axes).svd(true, true);
    let matrix = decomposed.u? * decomposed.v_t?;
    Some([0, 1, 2].map(|i| matrix.column(i).into_owned()))
}

/// Lengths of each axis at whose end, or diagonally across a face, a junction lies whose rays are those of edges
/// there; and, last, that nobody knows.
fn lengths(trihedron: &Cuboid, junctions: &[Rays], camera: &Camera) -> [Vec<Option<f64>>; 3] {
    let mut found: [Vec<Option<f64>>; 3] = Default::default();
    let first_seen = camera.project(&trihedron.first.into());
    let mut add = |axis: usize, length: f64| {
        let end = with(trihedron, &[(axis, length)]).vertex(1 << axis, camera);
        let is_long = match (first_seen, end) {
            (Some(first), Some(end)) => first.distance_px(end) >= LEAST_LENGTH_PX,
            _ => false,
        };
        let is_new = |other: &f64| (length / other - 1.0).abs() > 0.02;
        let lengths = &mut found[axis];
        if is_long && lengths.len() < MOST_LENGTHS && lengths.iter().flatten().all(is_new) {
            lengths.push(Some(length));
        }
    };
    let Cuboid { axes, first, .. } = trihedron;
    for (axis, direction) in axes.iter().enumerate() {
        for rays in junctions {
            // Where the junction's line of sight comes nearest to the edge.
            let sight = camera.ray(rays.vertex.into());
            let normal = sight.cross(direction).cross(&sight);
            let length = -normal.dot(first) / normal.dot(direction);
            let cuboid = with(trihedron, &[(axis, length)]);
            if fits(&cuboid, 1 << axis, rays, camera) {
                add(axis, length);
            }
        }
    }
    for (i, j) in [(0, 1), (0, 2), (1, 2)] {
        for rays in junctions {
            let sight = camera.ray(rays.vertex.into());
            let matrix = Matrix3::from_columns(&[axes[i], axes[j], -sight]);
            let Some(solved) = matrix.lu().solve(&-first) else { continue };
            let cuboid = with(trihedron, &[(i, solved.x), (j, solved.y)]);
            if solved.z > 0.0 && fits(&cuboid, 1 << i | 1 << j, rays, camera) {
                add(i, solved.x);
                add(j, solved.y);
            }
        }
    }
    found.iter_mut().for_each(|lengths| lengths.push(None));
    found
}

/// The trihedron with these lengths; the others do not matter for vertices that do not lie along them.
fn with(trihedron: &Cuboid, lengths: &[(usize, f64)]) -> Cuboid {
    let mut cuboid = Cuboid { lengths: [1e-3; 3], ..*trihedron };
    for (axis, length) in lengths {
        cuboid.lengths[*axis] = *length;
    }
    cuboid
}

/// Whether a junction lies where a vertex is and two of its rays are edges there, seen or not.
fn fits(cuboid: &Cuboid, vertex: usize, rays: &Rays, camera: &Camera) -> bool {
    if cuboid.lengths.iter().any(|length| length.is_nan() || *length <= 0.0) {
        return false;
    }
    let Some(point) = cuboid.vertex(vertex, camera) else { return false };
    point.distance_px(rays.vertex.into()) < NEAR_PX
        && (0..3).filter(|axis| has_ray(cuboid, vertex, *axis, rays, camera)).count() >= 2
}

/// Whether one of a junction's rays is a vertex's edge along an axis.
fn has_ray(cuboid: &Cuboid, vertex: usize, axis: usize, rays: &Rays, camera: &Camera) -> bool {
    let sign = if vertex & 1 << axis == 0 { 1.0 } else { -1.0 };
    let shares = |more: f64| {
        let mut shares = Cuboid::shares(vertex);
        shares[axis] += more / cuboid.lengths[axis];
        camera.project(&cuboid.point(shares).into())
    };
    let (Some(here), Some(there)) = (shares(0.0), shares(0.01 * sign)) else { return false };
    let angle = (there.y - here.y).atan2(there.x - here.x);
    rays.angles_rad[..rays.count].iter().any(|ray| apart(angle, *ray) < NEAR_RAD)
}

/// The angle between two directions \[rad\].
fn apart(a: f64, b: f64) -> f64 {
    let turn = (a - b).rem_euclid(TAU);
    if turn > PI { TAU - turn } else { turn }
}

/// How many rays of junctions are edges of the cuboid where they should be.
fn explained(cuboid: &Cuboid, junctions: &[Rays], camera: &Camera) -> usize {
    (0..8)
        .filter(|vertex| cuboid.shows_vertex(*vertex))
        .map(|vertex| {
            let Some(point) = cuboid.vertex(vertex, camera) else { return 0 };
            let of = |rays: &Rays| {
                if point.distance_px(rays.vertex.into()) > NEAR_PX {
                    return 0;
                }
                let edges = cuboid.rays(vertex, camera);
                edges
                    .filter(|edge| {
                        rays.angles_rad[..rays.count]
                            .iter()
                            .any(|ray| apart(*edge, *ray) < NEAR_RAD)
                    })
                    .count()
            };
            junctions.iter().map(of).max().unwrap_or(0)
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Vector3};

    use super::*;
    use crate::random::Stream;

    const CAMERA: Camera = Camera::pinhole(512, 512, 600.0);

    /// A cuboid of lengths 0.2, 0.3 and 0.25 at depth 1 to 1.5, turned any way; its first vertex the nearest.
    fn any_cuboid(random: &mut Stream) -> Cuboid {
        let turn = Rotation3::new(Vector3::from_fn(|_, _| random.normal()));
        let first = Vector3::new(0.1 * random.normal(), 0.1 * random.normal(), 1.0);
        let axes = [0, 1, 2].map(|axis| {
            let axis = turn.matrix().column(axis).into_owned();
            if axis.dot(&first) < 0.0 { -axis } else { axis }
        });
        Cuboid { axes, first, lengths: [0.2, 0.3, 0.25], is_known: [true; 3] }
    }

    /// The corners of the face across an axis at its start, each with the two edges of that face.
    fn corners_of_face(cuboid: &Cuboid, across: usize) -> Vec<Rays> {
        let sides: Vec<usize> = (0..3).filter(|axis| *axis != across).collect();
        let at = |vertex| match cuboid.vertex(vertex, &CAMERA) {
            Some(point) => point,
            None => panic!("vertex {vertex} is behind the camera"),
        };
        let corner = |vertex: usize| {
            let here = at(vertex);
            let mut angles = [0.0; MOST_RAYS];
            for (angle, side) in angles.iter_mut().zip(&sides) {
                let there = at(vertex ^ 1 << side);
                *angle = (there.y - here.y).atan2(there.x - here.x);
            }
            angles[..2].sort_by(f64::total_cmp);
            Rays { vertex: [here.x, here.y], sigma_px: 0.7, count: 2, angles_rad: angles }
        };
        let [a, b] = [1 << sides[0], 1 << sides[1]];
        [0, a, a | b, b].map(corner).to_vec()
    }

    /// The axis of which most is there.
    fn most(of: impl Fn(usize) -> f64) -> usize {
        (1..3).fold(0, |best, axis| if of(axis) > of(best) { axis } else { best })
    }

    #[test]
    fn four_corners_of_one_face_tell_the_axes_and_two_lengths_but_no_three_rays_do() {
        let mut random = Stream::named(&["tests", "hypothesis", "two junctions"]);
        for _ in 0..100 {
            let cuboid = any_cuboid(&mut random);
            let across = most(|axis| cuboid.axes[axis].dot(&cuboid.first));
            let junctions = corners_of_face(&cuboid, across);
            assert!(of_three_rays(&junctions, &CAMERA, 1).is_empty());
            let found = of_two_junctions(&junctions, &CAMERA, 8);
            // Whichever corner each starts at and however long it is, its axes are the true ones, that of the face away
            // from the camera; and one has the sides as long to each other as they are. The depth nothing tells.
            let is_right = |hypothesis: &Cuboid| {
                let own = [0, 1, 2].map(|axis: usize| {
                    let along = |own: usize| hypothesis.axes[own].dot(&cuboid.axes[axis]).abs();
                    let own = most(along);
                    assert!(along(own) > 1.0 - 1e-9, "{hypothesis:?} of {cuboid:?}");
                    own
                });
                assert!(hypothesis.axes[own[across]].dot(&cuboid.axes[across]) > 0.0);
                let [a, b] = [(across + 1) % 3, (across + 2) % 3];
                let ratio = hypothesis.lengths[own[a]] / hypothesis.lengths[own[b]];
                let wanted = cuboid.lengths[a] / cuboid.lengths[b];
                hypothesis.faces(own[across], false) && (ratio / wanted - 1.0).abs() < 1e-6
            };
            let right = found.iter().filter(|hypothesis| is_right(hypothesis)).count();
            assert!(right > 0, "{cuboid:?}: {found:?}");
        }
    }
}
