//! A cuboid moved, turned and stretched until its edges are where the image has them.

use nalgebra::{Matrix2, SymmetricEigen};

use super::segment::{Segment, SegmentFitter};
use crate::cuboid::{Change, Cuboid, FREEDOM, Information, edges};
use crate::geometry::{Camera, ImagePoint};
use crate::refine::light::Light;

/// Pieces of edges that are located one by one are this long at most \[px\].
const LENGTH_PX: f64 = 6.0;
/// So near to its ends nothing of an edge is used: blur rounds vertices, and others begin there \[px\].
const END_PX: f64 = 3.5;
/// So far to each side pixels count \[px\].
const SIDE_PX: [f64; 2] = [4.0, 2.0];
/// Pieces whose place is known worse tell nothing \[px^2\].
const MOST_VARIANCE_PX2: f64 = 0.25;
/// What an edge's straightness, its shadow and its blur leave of a right model \[px\].
const MODEL_ERROR_PX: f64 = 0.01;
/// How well hypotheses are known beforehand: of angles \[rad\], places \[at depth 1\] and logarithms of lengths.
const PRIOR: f64 = 0.3;
/// Of Tukey's weights, in standard deviations.
const CUT: f64 = 4.7;
/// Where half of the pieces are farther off, the cuboid is not what is seen \[px\].
const MOST_OFFSET_PX: f64 = 0.5;
/// At least so many pieces in all.
const LEAST_PIECES: usize = 12;

/// A cuboid that fits.
pub(crate) struct Adjusted {
    pub cuboid: Cuboid,
    /// Of its change.
    covariance: Information,
    /// How many pieces of edges are where they should be, less a fifth of those that are not.
    pub evidence: f64,
    pub iterations: u32,
    pub converged: bool,
}

#[cfg(test)]
impl Adjusted {
    /// One that is known as it is.
    pub(crate) fn certain(cuboid: Cuboid, evidence: f64) -> Self {
        Self { cuboid, covariance: Information::zeros(), evidence, iterations: 1, converged: true }
    }
}

/// A piece of an edge as it was found: where it lies off, how well, and what moves it.
struct Piece {
    offset_px: f64,
    variance_px2: f64,
    slope: Change,
}

/// Adjusts a cuboid; `None` where too little of its edges is seen, or they are elsewhere.
pub(super) fn adjust(
    light: &Light,
    camera: &Camera,
    start: Cuboid,
    max_iterations: u32,
    epsilon_px: f64,
    fitter: &mut SegmentFitter,
) -> Option<Adjusted> {
    let mut cuboid = start;
    for iterations in 1..=max_iterations {
        let (pieces, wanted) = pieces(light, camera, &cuboid, fitter);
        if pieces.len() < LEAST_PIECES {
            return None;
        }
        // From a gate as wide as the windows down to what noise and the model leave.
        let gate_px = 4.0 * 0.5_f64.powi(i32::try_from(iterations).unwrap_or(i32::MAX) - 1);
        let scale = scale(&pieces);
        let mut information = Information::identity() / (PRIOR * PRIOR);
        let mut right = Change::zeros();
        let (mut left, mut counted) = (0.0, 0.0);
        for piece in &pieces {
            let variance_px2 = piece.variance_px2 + MODEL_ERROR_PX * MODEL_ERROR_PX;
            let cut_px = (CUT * scale * variance_px2.sqrt()).max(gate_px);
            let share = piece.offset_px / cut_px;
            let weight = (1.0 - share * share).max(0.0).powi(2);
            information += weight / variance_px2 * piece.slope * piece.slope.transpose();
            right += weight / variance_px2 * piece.offset_px * piece.slope;
            left += weight * piece.offset_px * piece.offset_px / variance_px2;
            counted += weight;
        }
        let covariance = information.cholesky()?.inverse();
        let change = covariance * right;
        cuboid = cuboid.changed(&limited(change));
        // How far the farthest vertex moves.
        let moved_px = (0..8)
            .filter_map(|vertex| cuboid.derivatives(|cuboid| cuboid.vertex(vertex, camera)))
            .map(|[x, y]| x.dot(&change).hypot(y.dot(&change)))
            .fold(0.0, f64::max);
        let converged = moved_px <= epsilon_px && gate_px < epsilon_px.max(0.05);
        if converged || iterations == max_iterations {
            let offsets: Vec<f64> = pieces.iter().map(|piece| piece.offset_px.abs()).collect();
            if crate::stats::median(&offsets).is_none_or(|offset_px| offset_px > MOST_OFFSET_PX) {
                return None;
            }
            let degrees = (counted - FREEDOM as f64).max(1.0);
            let covariance = covariance * (left / degrees).max(1.0);
            let evidence = counted - 0.2 * (wanted - counted);
            return Some(Adjusted { cuboid, covariance, evidence, iterations, converged });
        }
    }
    None
}

/// No farther than the linearisation may hold.
fn limited(change: Change) -> Change {
    const MOST: f64 = 0.2;
    let largest = change.amax();
    if largest > MOST { change * (MOST / largest) } else { change }
}

/// The scale of the offsets over their standard deviations, of the better half: 1 where noise is all.
fn scale(pieces: &[Piece]) -> f64 {
    let normed = |piece: &Piece| {
        let variance_px2 = piece.variance_px2 + MODEL_ERROR_PX * MODEL_ERROR_PX;
        piece.offset_px.abs() / variance_px2.sqrt()
    };
    let all: Vec<f64> = pieces.iter().map(normed).collect();
    crate::stats::median(&all).map_or(1.0, |median| (1.4826 * median).max(1.0))
}

/// The pieces of the edges that are found, and how many were looked for.
fn pieces(
    light: &Light,
    camera: &Camera,
    cuboid: &Cuboid,
    fitter: &mut SegmentFitter,
) -> (Vec<Piece>, f64) {
    let mut found = Vec::new();
    let mut wanted = 0.0;
    let seen: Vec<_> = edges()
        .filter(|edge| cuboid.shows(*edge))
        .filter_map(|edge| {
            let [from, to] = [0.0, 1.0].map(|share| cuboid.on_edge(edge, share, camera));
            Some((edge, from?, to?))
        })
        .collect();
    for (index, (edge, from, to)) in seen.iter().enumerate() {
        let length_px = from.distance_px(*to);
        let inner_px = length_px - 2.0 * END_PX;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some dozens")]
        let count = (inner_px / LENGTH_PX).ceil().clamp(0.0, 1000.0) as usize;
        for piece in 0..count {
            let at_px = END_PX + inner_px * (piece as f64 + 0.5) / count as f64;
            let place = |cuboid: &Cuboid| {
                cuboid.on_edge(*edge, cuboid.share_in_space(*edge, at_px / length_px), camera)
            };
            let there = |more: f64| {
                cuboid.on_edge(
                    *edge,
                    cuboid.share_in_space(*edge, at_px / length_px) + more,
                    camera,
                )
            };
            let (Some(middle), Some(before), Some(beyond)) =
                (there(0.0), there(-0.01), there(0.01))
            else {
                continue;
            };
            let far_px = before.distance_px(beyond).max(1e-9);
            let along = [(beyond.x - before.x) / far_px, (beyond.y - before.y) / far_px];
            let others = seen.iter().enumerate().filter(|(other, _)| *other != index);
            let room_px = others
                .map(|(_, (_, a, b))| distance_to_line_px(middle, *a, *b))
                .fold(f64::INFINITY, f64::min);
            let side_px = SIDE_PX[0].min(room_px - 1.5);
            if side_px < SIDE_PX[1] {
                continue;
            }
            wanted += 1.0;
            let segment = Segment { middle, along, length_px: inner_px / count as f64, side_px };
            let Some(offset) = fitter.fit(light, &segment) else { continue };
            let Some([x, y]) = cuboid.derivatives(place) else { continue };
            if offset.variance_px2 > MOST_VARIANCE_PX2 {
                continue;
            }
            found.push(Piece {
                offset_px: offset.offset_px,
                variance_px2: offset.variance_px2,
                slope: y * along[0] - x * along[1],
            });
        }
    }
    (found, wanted)
}

fn distance_to_line_px(point: ImagePoint, a: ImagePoint, b: ImagePoint) -> f64 {
    let (ux, uy) = (b.x - a.x, b.y - a.y);
    let along = ((point.x - a.x) * ux + (point.y - a.y) * uy) / (ux * ux + uy * uy).max(1e-12);
    let along = along.clamp(0.0, 1.0);
    (point.x - a.x - along * ux).hypot(point.y - a.y - along * uy)
}

impl Adjusted {
    /// Where a vertex is seen, and its covariance \[px^2\].
    pub fn vertex(&self, vertex: usize, camera: &Camera) -> Option<(ImagePoint, Matrix2<f64>)> {
        let point = self.cuboid.vertex(vertex, camera)?;
        let covariance = self.cuboid.vertex_covariance_px2(vertex, camera, &self.covariance)?;
        let is_sound = SymmetricEigen::new(covariance).eigenvalues.min() > 0.0;
        is_sound.then_some((point, covariance))
    }
}
