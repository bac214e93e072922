//! Lines through a corner's edges, as far as these are seen, intersected: long edges tell more than any window.
//!
//! ```text
//! # Method      Starts are where edges that cross circles about the seed in a line meet (4.5, 6.5, 8.5 and
//!               10.5 px), the nearest and strongest first. Along each of their two or three rays, from 3 blurs
//!               outwards, the edge is located at stations: the columns of pixels that the ray crosses, or the rows
//!               where it is steep. A pixel belongs to one station of a ray and none is interpolated; those nearer
//!               than 3 blurs to another ray, or to the vertex, are left out. A ray ends after 3 px without an edge
//!               of its step and in its line. Channels are projected to the one number that steps by 1 across the
//!               edge with least noise: weights are steps over variances.
//!               erf           B + A Phi((d - d0) / sigma) + C d + K k by least squares, k the blurred |d|; K and
//!                             sigma are one for the ray (erf_profile.rs)
//!               devernay      the top of a parabola through gradients of a Gaussian of about 0.9 px (devernay.rs)
//!               partial_area  three columns' sums and levels, columns as long as the blur wants (partial_area.rs)
//!               Of a ray's stations, weighted by their variances, the line with Huber's weights beyond two
//!               deviations. v = N^-1 sum n (n . q) / s^2, N = sum n n^T / s^2, s the deviation of each line
//!               at v. Rounds about the lines of the one before, the first with devernay and to 16 px, each that
//!               follows twice as far, until v rests. Where a start's edges are not there, or meet too far off, the
//!               next one is tried.
//! # Input       all channels that differ, decoded to linear light, with the exposure's noise model.
//! # Parameters  operator        erf | devernay | partial_area, erf
//!               max_length_px   px, 40    range [8, 400]: how far edges are followed
//!               flank_px        px, 3     range [1, 10]: what erf fits of the even light beside the blur's 3 sigma
//!               max_shift_px    px, 6     range [0.5, 20]: how far from its seed a corner may be
//!               max_iterations  none, 10  range [2, 100]: rounds
//!               epsilon_px      px, 1e-3  range [0, 1]: done when a step is no longer than this
//! # Output      position, covariance, iterations (of all starts), status. The covariance is that of the lines'
//!               offsets and directions by the noise of their pixels, with kink and blur unknown; of a line that
//!               leaves surely more than noise (4 deviations of chi^2) as much larger, and so where three lines
//!               meet in no point. diverged: farther off than max_shift_px; singular: no two edges meet near the seed,
//!               or the two are one straight edge to within three standard deviations; false_corner: two of three
//!               rays are, an edge that ends at another; not_applicable: two straight edges cross. Elsewhere the
//!               seed's own position.
//! # Border      a ray ends at the image's; saturated pixels are left out; a seed outside the image, and a corner
//!               of which a ray leaves it too early, is out_of_bounds.
//! # Cost        O(rays rounds max_length (3 sigma + flank)).
//! # Departures  Sources locate edges in the whole image, at each pixel of large gradient; here across a line that is
//!               known. Devernay's magnitudes are those along a column. Trujillo-Pino's columns have five pixels, and
//!               a term for curvature; here more where blur is, and none. A ramp that differs on both sides of
//!               the edge is known to erf alone, as is the blur: devernay's displacement with the phase of the pixels,
//!               0.02 px of the corner, and that of partial_area, are not in their covariances, which are too small
//!               by so much. Edges are taken for straight: of a lens that bends them undistort first, or give a
//!               smaller max_length_px.
//! # Source      Devernay, INRIA RR-2724, 1995; Grompone von Gioi & Randall, A sub-pixel edge detector, IPOL 2017;
//!               Trujillo-Pino, Krissian, Aleman-Flores & Santana-Cedres, Image Vis. Comput. 2013; Huber, Ann.
//!               Math. Stat. 1964. Kink, blur and the step's growth are our own.
//! # Checked by  tests/it/contract.rs (all), tests/it/edges.rs
//! ```

mod devernay;
mod erf_profile;
mod line;
mod partial_area;
mod ray;

use nalgebra::Vector2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Detection;
use crate::geometry::ImagePoint;
use crate::junction::rays::{MOST_RAYS, Rays};
use crate::refine::edges::{Meeting, corner, image_point, lines_of, meet};
use crate::refine::light::Light;
use crate::refine::starts::Starts;
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;

use ray::{Column, Edgel, Look, Ray};

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "edge_intersection",
    summary: "lines through the edges' sub-pixel places as far as they are seen, intersected",
    reference: "Devernay 1995; Trujillo-Pino et al. 2013; Huber 1964",
    version: 1,
    defaults: defaults::<EdgeIntersection>,
    schema: schema::<EdgeIntersection>,
    build: |place, table| Ok(Box::new(parameters::<EdgeIntersection>(place, table)?)),
};

/// How an edge is located at a station.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Operator {
    /// The top of a parabola through three gradients (Devernay 1995).
    Devernay,
    /// A blurred step with ramps, fitted.
    Erf,
    /// The area that the edge leaves of pixels (Trujillo-Pino et al. 2013).
    PartialArea,
}

/// The refiner; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct EdgeIntersection {
    /// How edges are located.
    pub operator: Operator,
    /// How far from the corner edges are followed at most \[px\].
    #[schemars(range(min = 8.0, max = 400.0))]
    pub max_length_px: f64,
    /// How much of the even light beside an edge's blur is fitted with it \[px\].
    #[schemars(range(min = 1.0, max = 10.0))]
    pub flank_px: f64,
    /// How far from its seed a corner may be \[px\].
    #[schemars(range(min = 0.5, max = 20.0))]
    pub max_shift_px: f64,
    /// Rounds at most; each follows the edges about the lines of the one before.
    #[schemars(range(min = 2, max = 100))]
    pub max_iterations: u32,
    /// The step that ends the iteration \[px\].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub epsilon_px: f64,
}

impl Default for EdgeIntersection {
    fn default() -> Self {
        Self {
            operator: Operator::Erf,
            max_length_px: 40.0,
            flank_px: 3.0,
            max_shift_px: 6.0,
            max_iterations: 10,
            epsilon_px: 1e-3,
        }
    }
}

impl Refiner for EdgeIntersection {
    fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner> {
        let light = Light::new(exposure);
        let mut work = Work {
            refiner: self,
            light: &light,
            starts: Starts::default(),
            column: Column::default(),
            edgels: Vec::new(),
            residuals: Vec::new(),
            iterations: 0,
        };
        let refined = |seed: &Detection| {
            if !light.is_inside(seed.point) {
                return Corner::at_seed(*seed, 0, RefineStatus::OutOfBounds);
            }
            work.iterations = 0;
            match work.locate(seed.point) {
                Ok((meeting, status)) => Corner {
                    seed: *seed,
                    position: image_point(meeting.point),
                    covariance_px2: Some(meeting.covariance_px2),
                    iterations: work.iterations,
                    status,
                },
                Err(status) => Corner::at_seed(*seed, work.iterations, status),
            }
        };
        seeds.iter().map(refined).collect()
    }
}

/// What one exposure's corners share.
struct Work<'a> {
    refiner: &'a EdgeIntersection,
    light: &'a Light<'a>,
    starts: Starts,
    column: Column,
    edgels: Vec<Edgel>,
    residuals: Vec<f64>,
    iterations: u32,
}

/// How far edges are followed in the first round \[px\]; in each that follows twice as far.
const FIRST_PX: f64 = 16.0;

/// Lines that differ from one straight edge by no more are one \[rad\].
const LEAST_RAD: f64 = 0.02;

impl Work<'_> {
    /// The corner of the best start; where its edges are not there, or meet too far off, of the next.
    fn locate(&mut self, seed: ImagePoint) -> Result<(Meeting, RefineStatus), RefineStatus> {
        let deviations_dn = self.light.deviations_dn(seed);
        let max_shift_px = self.refiner.max_shift_px;
        self.starts.look(self.light.planes, &deviations_dn, seed, max_shift_px);
        let mut first = None;
        for index in 0..self.starts.found.len() {
            let start = self.starts.found[index];
            if start.is_crossing {
                return Err(first.unwrap_or(RefineStatus::NotApplicable));
            }
            match self.follow(&start.rays, seed) {
                Err(status @ (RefineStatus::Singular | RefineStatus::Diverged)) => {
                    first.get_or_insert(status);
                }
                found => return found,
            }
        }
        Err(first.unwrap_or(RefineStatus::Singular))
    }

    /// Follows the rays of a start until where they meet rests.
    fn follow(
        &mut self,
        rays: &Rays,
        seed: ImagePoint,
    ) -> Result<(Meeting, RefineStatus), RefineStatus> {
        let EdgeIntersection { operator, max_length_px, flank_px, max_iterations, .. } =
            *self.refiner;
        let mut lines = lines_of(rays);
        let mut looks = [Look { sigma_px: 1.0, growth_per_px: 0.0 }; MOST_RAYS];
        let mut count = rays.count;
        let mut last = Vector2::from(rays.vertex);
        let mut limit_px = FIRST_PX;
        let mut meeting = None;
        let mut status = RefineStatus::MaxIterations;
        for round in 0..max_iterations {
            self.iterations += 1;
            limit_px = limit_px.min(max_length_px);
            // The steepest place is found from farther off than others.
            let operator = if round == 0 { Operator::Devernay } else { operator };
            let before = lines;
            let mut kept = 0;
            let mut left_image = false;
            for index in 0..count {
                let ray = Ray::new(self.light, &before[..count], index, looks[index]);
                let Self { column, edgels, .. } = self;
                let followed = ray.follow(operator, flank_px, limit_px, column, edgels);
                left_image |= followed.left_image;
                let line = line::through(&ray.line, edgels, &followed, &mut self.residuals);
                let Some(line) = line else { continue };
                lines[kept] = line;
                looks[kept] = followed.look;
                kept += 1;
            }
            if kept < 2 {
                let status =
                    if left_image { RefineStatus::OutOfBounds } else { RefineStatus::Singular };
                return Err(status);
            }
            count = kept;
            corner(&lines[..count], LEAST_RAD)?;
            let found = meet(&lines[..count]).ok_or(RefineStatus::Singular)?;
            if image_point(found.point).distance_px(seed) > self.refiner.max_shift_px {
                return Err(RefineStatus::Diverged);
            }
            for line in &mut lines[..count] {
                *line = line.counted_from(found.point);
            }
            let step_px = (found.point - last).norm();
            last = found.point;
            meeting = Some(found);
            if round > 0 && limit_px >= max_length_px && step_px <= self.refiner.epsilon_px {
                status = RefineStatus::Ok;
                break;
            }
            limit_px *= 2.0;
        }
        meeting.map(|meeting| (meeting, status)).ok_or(RefineStatus::Singular)
    }
}
