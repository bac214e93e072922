//! How well a corner could be located at all: Cramér-Rao bounds.
//!
//! In closed form, from a corner's edges. A straight edge of contrast A, blurred by a Gaussian of standard
//! deviation sigma_e (the pixel's own area included), in noise of standard deviation sigma_n a pixel,
//! carries per pixel of its length
//!
//! lambda = A^2 / (2 sqrt(pi) sigma_e sigma_n^2)
//!
//! of Fisher information on its place across. Integrated over its length L, with the direction unknown,
//! a quarter of lambda L is left for where its end lies. What several edges with normals n tell about the
//! place of their common end adds up: J = sum eta lambda L n n^T, and the covariance is at least J^-1. Blur
//! rounds the vertex: about 1.5 sigma_e of each edge tell nothing.
//!
//! Levels are nearly free beside the direction; ramps are not counted. Of the numeric bound of a blurred
//! wedge or Y with unknown levels, directions and blur this is 92 to 107 % where the blur is at most a pixel;
//! with more it is too small.
//!
//! Numerically, by the blurred junction that fits the exposure without noise best ([`junction_bound`]); with all
//! that is seen of a corner's own edges; and with all edges of the cuboid, whose picture depends on eight numbers
//! if the camera is calibrated. A method that uses less than a bound counts cannot reach it.

mod junction;
mod object;

use nalgebra::{Matrix2, SymmetricEigen, Vector2};

use crate::geometry::ImagePoint;
use crate::image::Plane;
use crate::junction::rays::{MOST_RAYS, Rays};
use crate::scene::{EdgeAtCorner, TrueCorner, Truth};
use crate::sensor::{Colour, Exposure, Rig};

pub use junction::junction_bound;

/// An edge that ends at a corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlurredEdge {
    /// Unit vector away from the corner.
    pub direction: [f64; 2],
    /// How far it is seen from the corner \[px\].
    pub length_px: f64,
    /// Contrast over the noise of one pixel, squared and added up over channels.
    pub signal_to_noise2: f64,
    /// Standard deviation of blur and pixel area across it \[px\].
    pub sigma_px: f64,
}

/// Whether the edges' directions are known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Directions {
    /// They are.
    Known,
    /// They are found together with the corner.
    Unknown,
}

/// The least root mean square distance from the truth, over both axes, of an unbiased estimate of where
/// `edges` end \[px\]; `None` where no two that tell something cross.
pub fn corner_bound_px(edges: &[BlurredEdge], directions: Directions) -> Option<f64> {
    let information: Matrix2<f64> = edges
        .iter()
        .map(|edge| {
            let per_px = PER_EDGE * edge.signal_to_noise2 / edge.sigma_px;
            let (share, length_px) = match directions {
                Directions::Known => (1.0, edge.length_px),
                Directions::Unknown => (0.25, edge.length_px - 1.5 * edge.sigma_px),
            };
            let normal = Vector2::new(-edge.direction[1], edge.direction[0]);
            share * per_px * length_px.max(0.0) * normal * normal.transpose()
        })
        .sum();
    let values = SymmetricEigen::new(information).eigenvalues;
    (values.min() > 1e-9 * values.max()).then(|| values.map(f64::recip).sum().sqrt())
}

/// 1 / (2 sqrt(pi)): what a pixel's length of an edge tells, times its blur over its signal to noise.
const PER_EDGE: f64 = 0.282_094_791_773_878_14;

/// Of an edge no more than this counts \[px\]: the bound is local.
const LONGEST_PX: f64 = 10.0;

/// Radii of the discs about a corner whose pixels numeric bounds are for \[px\].
pub const RADII_PX: [f64; 3] = [5.0, 10.0, 15.0];

/// The least root mean square errors of one corner's place that the camera's noise allows \[px\]; `None` where
/// the corner is not seen, or nothing tells it. Each is for methods that use no more than it counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CornerBounds {
    /// In closed form, from the first 10 px of each edge, directions unknown.
    pub closed_px: Option<f64>,
    /// Of pixels so near ([`RADII_PX`]), levels, ramps, directions and blur unknown.
    pub local_px: [Option<f64>; 3],
    /// In closed form, from all that is seen of the corner's edges, directions unknown.
    pub edges_px: Option<f64>,
    /// From all that is seen of all edges of one cuboid of unknown size, intrinsics known.
    pub object_px: Option<f64>,
}

/// What is known of an exposure's noise and blur.
#[derive(Clone, Copy, Debug)]
pub struct Seeing<'a> {
    /// Without noise, with its model: where there is none, rounding is all the noise.
    pub exposure: &'a Exposure,
    /// What its pixels see.
    pub colour: Colour,
    /// Standard deviation of the camera's blur and pixel area along one axis \[px\]; the scene's own lens comes
    /// on top.
    pub blur_px: f64,
}

/// The bounds of every corner in an exposure, in the order of their index. What is to both sides of an edge is taken
/// from the exposure.
pub fn corner_bounds(truth: &Truth, rig: &Rig, seeing: &Seeing<'_>) -> Vec<CornerBounds> {
    let edge = |index: usize| seeing.whole_edge(truth, index);
    let object_px = object::object_bounds_px(truth, &rig.camera, &rig.world_from_camera, edge);
    truth
        .corners
        .iter()
        .zip(object_px)
        .map(|(corner, object_px)| {
            if corner.junction.is_none() {
                return CornerBounds::default();
            }
            let closed = |longest_px: f64| {
                let edges: Vec<BlurredEdge> = corner
                    .edges
                    .iter()
                    .filter_map(|edge| seeing.blurred_edge(corner, edge, longest_px))
                    .collect();
                corner_bound_px(&edges, Directions::Unknown)
            };
            CornerBounds {
                closed_px: closed(LONGEST_PX),
                local_px: RADII_PX.map(|radius_px| seeing.local_px(corner, radius_px)),
                edges_px: closed(f64::INFINITY),
                object_px,
            }
        })
        .collect()
}

impl Seeing<'_> {
    /// An edge at a corner, of which no more than a length counts.
    fn blurred_edge(
        &self,
        corner: &TrueCorner,
        edge: &EdgeAtCorner,
        longest_px: f64,
    ) -> Option<BlurredEdge> {
        let length_px = edge.visible_length_px.min(longest_px);
        let sides = Sides { from: corner.image_point_px, along: edge.direction, length_px };
        Some(BlurredEdge {
            direction: edge.direction,
            length_px,
            signal_to_noise2: sides.signal_to_noise2(self.exposure, self.colour)?,
            sigma_px: self.blur_px.hypot(edge.blur_px),
        })
    }

    /// An edge by its index, as the corner sees it from which more of it is seen.
    fn whole_edge(&self, truth: &Truth, index: usize) -> Option<BlurredEdge> {
        let corners = truth.edges.get(index)?.corners.map(|corner| truth.corners.get(corner));
        let seen = corners.into_iter().flatten().flat_map(|corner| {
            corner.edges.iter().filter(|edge| edge.edge == index).map(move |edge| (corner, edge))
        });
        let (corner, edge) =
            seen.max_by(|(_, a), (_, b)| a.visible_length_px.total_cmp(&b.visible_length_px))?;
        self.blurred_edge(corner, edge, f64::INFINITY)
    }

    /// The numeric bound from the pixels near a corner.
    fn local_px(&self, corner: &TrueCorner, radius_px: f64) -> Option<f64> {
        let mut angles: Vec<f64> = corner
            .edges
            .iter()
            .filter(|edge| edge.visible_length_px > 0.0)
            .map(|edge| edge.direction[1].atan2(edge.direction[0]))
            .collect();
        angles.sort_by(f64::total_cmp);
        if !(2..=MOST_RAYS).contains(&angles.len()) {
            return None;
        }
        let mut rays = Rays {
            vertex: corner.image_point_px.into(),
            sigma_px: self.blur_px.hypot(corner.blur_px),
            count: angles.len(),
            angles_rad: [0.0; MOST_RAYS],
        };
        rays.angles_rad[..angles.len()].copy_from_slice(&angles);
        let covariance = junction_bound(self.exposure, &rays, radius_px, true)?;
        Some(covariance.trace().sqrt()).filter(|bound| bound.is_finite())
    }
}

/// What is to both sides of an edge.
struct Sides {
    from: ImagePoint,
    along: [f64; 2],
    length_px: f64,
}

/// How far to a side, and from which share of the length on: where neither the edge's own blur, of a pixel or
/// less, nor the corner's other edges are. With more blur contrast is told too small, and the bound too large.
const OFFSET_PX: f64 = 1.5;
const FIRST_SHARE: f64 = 0.35;
const PLACES: u32 = 24;

impl Sides {
    /// Contrast over noise, squared and added up over the channels that pixels see, each as dense as its
    /// samples are. `None` where too little is in the image.
    fn signal_to_noise2(&self, exposure: &Exposure, colour: Colour) -> Option<f64> {
        let densities: &[f64] = match colour {
            Colour::Rgb => &[1.0, 1.0, 1.0],
            Colour::Mono => &[1.0],
            Colour::Rggb => &[0.25, 0.5, 0.25],
        };
        densities.iter().zip(exposure.rgb()).enumerate().try_fold(0.0, |sum, (channel, one)| {
            let (density, plane) = one;
            let [left, right] = [-1.0, 1.0].map(|side| self.level(plane, side));
            let (left, right) = (left?, right?);
            let variance_dn2 = exposure.variance_dn2(channel, 0.5 * (left + right));
            Some(sum + density * (right - left).powi(2) / variance_dn2)
        })
    }

    /// The median to one side \[DN\].
    fn level(&self, plane: &Plane<f32>, side: f64) -> Option<f64> {
        let [x, y] = self.along;
        let offset_px = side * OFFSET_PX.min(FIRST_SHARE * self.length_px);
        let samples: Vec<f64> = (0..PLACES)
            .filter_map(|place| {
                let share =
                    FIRST_SHARE + (1.0 - FIRST_SHARE) * f64::from(place) / f64::from(PLACES - 1);
                let distance_px = share * self.length_px;
                pixel(
                    plane,
                    self.from.x + distance_px * x - offset_px * y,
                    self.from.y + distance_px * y + offset_px * x,
                )
            })
            .collect();
        if samples.len() < 8 { None } else { crate::stats::median(&samples) }
    }
}

/// The sample of the pixel that a point lies in.
fn pixel(plane: &Plane<f32>, x: f64, y: f64) -> Option<f64> {
    let (x, y) = (x.round(), y.round());
    let inside = x >= 0.0 && y >= 0.0 && x < plane.width() as f64 && y < plane.height() as f64;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the image")]
    inside.then(|| f64::from(plane.at(x as usize, y as usize)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Edges at these angles, of 10 px, each with its contrast, over noise of 0.02.
    fn bound(angles_deg: &[f64], contrasts: &[f64], blur_px: f64, directions: Directions) -> f64 {
        let edges: Vec<_> = angles_deg
            .iter()
            .zip(contrasts)
            .map(|(angle_deg, contrast)| BlurredEdge {
                direction: angle_deg.to_radians().sin_cos().into(),
                length_px: 10.0,
                signal_to_noise2: (contrast / 0.02_f64).powi(2),
                sigma_px: blur_px.hypot((1.0_f64 / 12.0).sqrt()),
            })
            .collect();
        corner_bound_px(&edges, directions).expect("edges that cross")
    }

    #[test]
    fn wedges_and_junctions_are_near_their_numeric_bounds() {
        // Numeric bounds of a disc of 10 px, noise 0.02: directions, levels and blur known, and unknown.
        for (angles_deg, contrasts, blur_px, known_px, unknown_px) in [
            (&[0.0, 60.0][..], &[1.0, 1.0][..], 0.5, 0.0144, 0.0302),
            (&[0.0, 90.0], &[1.0, 1.0], 0.5, 0.0126, 0.0271),
            (&[0.0, 90.0], &[1.0, 1.0], 0.7, 0.0145, 0.0321),
            (&[0.0, 90.0], &[1.0, 1.0], 1.0, 0.0172, 0.0400),
            (&[0.0, 120.0], &[1.0, 1.0], 0.7, 0.0157, 0.0349),
            (&[0.0, 150.0], &[1.0, 1.0], 0.7, 0.0293, 0.0663),
            // Three sectors of levels 0.9, 0.6, 0.35.
            (&[0.0, 120.0, 240.0], &[0.3, 0.25, 0.55], 0.5, 0.0284, 0.0612),
        ] {
            let known = bound(angles_deg, contrasts, blur_px, Directions::Known);
            let unknown = bound(angles_deg, contrasts, blur_px, Directions::Unknown);
            assert!((known / known_px - 1.0).abs() < 0.1, "{angles_deg:?}: {known}");
            assert!((0.92..1.07).contains(&(unknown / unknown_px)), "{angles_deg:?}: {unknown}");
        }
    }

    #[test]
    fn one_line_alone_bounds_nothing() {
        let edge = |direction| BlurredEdge {
            direction,
            length_px: 10.0,
            signal_to_noise2: 100.0,
            sigma_px: 1.0,
        };
        let line = [edge([1.0, 0.0]), edge([-1.0, 0.0])];
        assert_eq!(corner_bound_px(&line, Directions::Unknown), None);
        assert_eq!(corner_bound_px(&[], Directions::Known), None);
        let faint = BlurredEdge { signal_to_noise2: 0.0, ..edge([0.0, 1.0]) };
        assert_eq!(corner_bound_px(&[line[0], faint], Directions::Unknown), None);
    }
}
