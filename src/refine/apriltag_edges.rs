//! Edges of a corner by weighted means across them, as AprilTag 3 refines the sides of a tag, intersected.
//!
//! ```text
//! # Method      Edges that leave the corner are those that cross circles about the seed in a line and meet (4.5,
//!               6.5, 8.5 and 10.5 px). Along each, over `length_px`, n = max(16, length / 8) samples lie at
//!               shares a_s = (1 + s) / (n + 1), s = 0 .. n - 1. Across each sample, at t = -range to range in
//!               steps of 1/4 px, g1 and g2 are luma 1 px behind and before; its place is
//!                 m = sum (g1 - g2)^2 t / sum (g1 - g2)^2
//!               of those that step in the edge's own sense. The line is that of the samples' first and second
//!               moments (total least squares), the corner where lines meet.
//! # Input       luma, as encoded; between pixels bilinear.
//! # Parameters  length_px     px, 10  range [4, 100]: of each edge from the corner
//!               range_px      px, 2   range [0.5, 8]: how far across it is looked at
//!               max_shift_px  px, 6   range [0.5, 20]: how far from its seed a corner may be
//! # Output      position, status; no covariance, the source has none. diverged: farther off than max_shift_px;
//!               singular: no two edges meet near the seed, or the two are one straight edge to within
//!               0.05 rad; false_corner: two of three are; not_applicable: two straight edges cross. One iteration.
//!               Elsewhere the seed's own position.
//! # Border      replicated; a seed outside the image is out_of_bounds.
//! # Cost        O(n range) for each edge.
//! # Departures  The source's edges are the sides of a quadrilateral that it has found before, its corners are all
//!               four of them, and range is that of its decimation and 1 px; here an edge is as long as a parameter
//!               says, and its start is near the rounded corner, too. A tag's border is darker within: here the
//!               sense of a step is that of the most. Of three lines the corner is the point nearest to them all.
//! # Source      Wang & Olson, AprilTag 2: efficient and robust fiducial detection, IROS 2016; Krogius, Haggenmiller
//!               & Olson, Flexible layouts for fiducial tags, IROS 2019 (refine_edges).
//! # Checked by  tests/it/contract.rs (all), tests/it/edges.rs
//! ```

use nalgebra::{Matrix2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Detection;
use crate::geometry::ImagePoint;
use crate::image::Plane;
use crate::refine::edges::{Line, corner, image_point, lines_of, meet};
use crate::refine::light::Light;
use crate::refine::starts::Starts;
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "apriltag_edges",
    summary: "lines through weighted means across edges, as AprilTag 3 has them, intersected",
    reference: "Wang & Olson 2016; Krogius et al. 2019",
    version: 1,
    defaults: defaults::<AprilTagEdges>,
    schema: schema::<AprilTagEdges>,
    build: |place, table| Ok(Box::new(parameters::<AprilTagEdges>(place, table)?)),
};

/// The refiner; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct AprilTagEdges {
    /// How far from the corner edges are sampled \[px\].
    #[schemars(range(min = 4.0, max = 100.0))]
    pub length_px: f64,
    /// How far across an edge is looked at \[px\].
    #[schemars(range(min = 0.5, max = 8.0))]
    pub range_px: f64,
    /// How far from its seed a corner may be \[px\].
    #[schemars(range(min = 0.5, max = 20.0))]
    pub max_shift_px: f64,
}

impl Default for AprilTagEdges {
    fn default() -> Self {
        Self { length_px: 10.0, range_px: 2.0, max_shift_px: 6.0 }
    }
}

impl Refiner for AprilTagEdges {
    fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner> {
        let light = Light::new(exposure);
        let mut starts = Starts::default();
        let refined = |seed: &Detection| {
            if !light.is_inside(seed.point) {
                return Corner::at_seed(*seed, 0, RefineStatus::OutOfBounds);
            }
            match self.locate(&light, seed.point, &mut starts) {
                Ok(position) => Corner {
                    seed: *seed,
                    position,
                    covariance_px2: None,
                    iterations: 1,
                    status: RefineStatus::Ok,
                },
                Err(status) => Corner::at_seed(*seed, 1, status),
            }
        };
        seeds.iter().map(refined).collect()
    }
}

impl AprilTagEdges {
    fn locate(
        &self,
        light: &Light,
        seed: ImagePoint,
        starts: &mut Starts,
    ) -> Result<ImagePoint, RefineStatus> {
        const LEAST_RAD: f64 = 0.05;
        starts.look(light.planes, &light.deviations_dn(seed), seed, self.max_shift_px);
        let start = starts.found.first().ok_or(RefineStatus::Singular)?;
        if start.is_crossing {
            return Err(RefineStatus::NotApplicable);
        }
        let mut lines = lines_of(&start.rays);
        let lines = &mut lines[..start.rays.count];
        for line in lines.iter_mut() {
            *line = self.moved(light.exposure.luma(), line).ok_or(RefineStatus::Singular)?;
        }
        corner(lines, LEAST_RAD)?;
        let position = image_point(meet(lines).ok_or(RefineStatus::Singular)?.point);
        let is_near = position.distance_px(seed) <= self.max_shift_px;
        if is_near { Ok(position) } else { Err(RefineStatus::Diverged) }
    }

    /// The line through the edge about a line; `None` where there is no step.
    fn moved(&self, luma: &Plane<f32>, line: &Line) -> Option<Line> {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few")]
        let samples = ((self.length_px / 8.0) as u32).max(16);
        let (direction, normal) = (line.direction(), line.normal());
        let point = |sample: u32| {
            let share = f64::from(1 + sample) / f64::from(samples + 1);
            line.origin + share * self.length_px * direction
        };
        // Which side is brighter is what most of the edge says.
        let difference: f64 = (0..samples)
            .flat_map(|sample| self.steps(luma, point(sample), normal))
            .map(|s| s[1])
            .sum();
        let mut moments = (0.0, Vector2::zeros(), Matrix2::zeros());
        for sample in 0..samples {
            let (mut sum, mut weights) = (0.0, 0.0);
            let own =
                self.steps(luma, point(sample), normal).filter(|[_, step]| step * difference > 0.0);
            for [far_px, step] in own {
                sum += step * step * far_px;
                weights += step * step;
            }
            if weights <= 0.0 {
                continue;
            }
            // From the line's own point sums are small, and lose nothing.
            let place = point(sample) + sum / weights * normal - line.origin;
            moments.0 += 1.0;
            moments.1 += place;
            moments.2 += place * place.transpose();
        }
        let (count, sum, squares) = moments;
        if count < 2.0 {
            return None;
        }
        let mean = sum / count;
        let scatter = squares / count - mean * mean.transpose();
        let angle_rad = 0.5 * (2.0 * scatter[(0, 1)]).atan2(scatter[(0, 0)] - scatter[(1, 1)]);
        let turn_rad = angle_rad - line.angle_rad;
        // Of the two directions of the line the one outwards.
        let half_turns = (turn_rad / std::f64::consts::PI).round();
        let moved = Line {
            origin: line.origin + mean,
            angle_rad: angle_rad - half_turns * std::f64::consts::PI,
            covariance: Matrix2::new(1.0, 0.0, 0.0, 0.0),
        };
        Some(moved.counted_from(line.origin))
    }

    /// Places across a point and how luma steps there.
    fn steps(
        &self,
        luma: &Plane<f32>,
        point: Vector2<f64>,
        normal: Vector2<f64>,
    ) -> impl Iterator<Item = [f64; 2]> {
        const PER_PX: f64 = 4.0;
        #[allow(clippy::cast_possible_truncation, reason = "a few")]
        let reach = (PER_PX * self.range_px) as i32;
        (-reach..=reach).map(move |step| {
            let far_px = f64::from(step) / PER_PX;
            let at = |far_px: f64| luma.bilinear(image_point(point + far_px * normal));
            [far_px, at(far_px + 1.0) - at(far_px - 1.0)]
        })
    }
}
