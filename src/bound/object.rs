//! The bound of all corners together: what is seen of every edge tells where the cuboid is, and the cuboid where its
//! corners are.

use nalgebra::Vector3;

use super::{BlurredEdge, PER_EDGE};
use crate::cuboid::{Cuboid, Edge, Information};
use crate::geometry::{Camera, Pose};
use crate::scene::Truth;

/// The target as a cuboid in the camera's frame, and which of its vertices each corner of the truth is; `None`
/// where it is none.
fn cuboid_of(truth: &Truth, world_from_camera: &Pose) -> Option<(Cuboid, Vec<usize>)> {
    let places: Vec<Vector3<f64>> = truth
        .corners
        .iter()
        .map(|corner| world_from_camera.inverse_transform_point(&corner.position_m.into()).coords)
        .collect();
    let first = *places.first().filter(|first| first.z > 0.0)?;
    let mut ends = truth.edges.iter().filter_map(|edge| match edge.corners {
        [0, end] | [end, 0] => places.get(end),
        _ => None,
    });
    let [a, b, c] = [ends.next()?, ends.next()?, ends.next()?].map(|end| (end - first) / first.z);
    let lengths = [a.norm(), b.norm(), c.norm()];
    let axes = [a / lengths[0], b / lengths[1], c / lengths[2]];
    let is_right = (0..3).all(|i| axes[i].dot(&axes[(i + 1) % 3]).abs() < 1e-6);
    if ends.next().is_some() || !is_right {
        return None;
    }
    let cuboid = Cuboid { axes, first: first / first.z, lengths, is_known: [true; 3] };
    let vertex = |place: &Vector3<f64>| {
        let from = place / first.z - cuboid.first;
        let along = |axis: usize| from.dot(&axes[axis]) > 0.5 * lengths[axis];
        (0..3).map(|axis| usize::from(along(axis)) << axis).sum()
    };
    let vertices = places.iter().map(vertex).collect();
    Some((cuboid, vertices))
}

/// The bound of every corner \[px\] of an estimate that fits one cuboid of unknown size to all that is seen of its
/// edges, the intrinsics known; `edge` says of each edge what it tells. `None` where the edges do not determine
/// it, or the target is no cuboid.
pub(super) fn object_bounds_px(
    truth: &Truth,
    camera: &Camera,
    world_from_camera: &Pose,
    edge: impl Fn(usize) -> Option<BlurredEdge>,
) -> Vec<Option<f64>> {
    let none = || vec![None; truth.corners.len()];
    let Some((cuboid, vertices)) = cuboid_of(truth, world_from_camera) else { return none() };
    let mut information = Information::zeros();
    for of_truth in &truth.edges {
        let Some(blurred) = edge(of_truth.index) else { continue };
        let [from, to] = of_truth.corners.map(|corner| vertices[corner]);
        let axis = (from ^ to).trailing_zeros() as usize;
        if (from ^ to).count_ones() != 1 || axis > 2 {
            continue;
        }
        let of_cuboid = Edge { axis, from: from & to };
        let per_px = PER_EDGE * blurred.signal_to_noise2 / blurred.sigma_px;
        for interval in &of_truth.visible {
            let share = |share: f64| if from & to == from { share } else { 1.0 - share };
            let (start, end) = (share(interval.start), share(interval.end));
            add(&mut information, &cuboid, of_cuboid, [start, end], camera, per_px);
        }
    }
    // Where it is hardly determined, a bound says no more than that.
    let largest = information.diagonal().max();
    let Some(covariance) = information
        .symmetric_eigenvalues()
        .iter()
        .all(|value| *value > 1e-12 * largest)
        .then(|| information.try_inverse())
        .flatten()
    else {
        return none();
    };
    let bound = |vertex: &usize| {
        let covariance = cuboid.vertex_covariance_px2(*vertex, camera, &covariance)?;
        Some(covariance.trace().sqrt()).filter(|bound| bound.is_finite())
    };
    vertices.iter().map(bound).collect()
}

/// Adds what a part of an edge tells about where the cuboid is, pixel by pixel.
fn add(
    information: &mut Information,
    cuboid: &Cuboid,
    edge: Edge,
    [start, end]: [f64; 2],
    camera: &Camera,
    per_px: f64,
) {
    let at = |share: f64| cuboid.on_edge(edge, share, camera);
    let (Some(a), Some(b)) = (at(start), at(end)) else { return };
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundreds")]
    let count = (a.distance_px(b).ceil() as usize).clamp(1, 100_000);
    for step in 0..count {
        let share = |part: f64| start + (end - start) * (step as f64 + part) / count as f64;
        let (Some(from), Some(to)) = (at(share(0.0)), at(share(1.0))) else { continue };
        let Some([x, y]) = cuboid.derivatives(|cuboid| cuboid.on_edge(edge, share(0.5), camera))
        else {
            continue;
        };
        let length_px = from.distance_px(to).max(f64::MIN_POSITIVE);
        let (ux, uy) = ((to.x - from.x) / length_px, (to.y - from.y) / length_px);
        let across = y * ux - x * uy;
        *information += per_px * length_px * across * across.transpose();
    }
}
