//! All corners at once: the picture of one cuboid fitted to everything that is seen of its edges.
//!
//! ```text
//! # Method      (1) Junctions are fitted at the strongest seeds (junction_fit). Three rays from one point are the
//!               picture of three edges at right angles in one way, and so are, where that leads to none, the rays of
//!               two junctions at the ends of one edge; where other junctions lie tells their lengths.
//!               The six cuboids whose vertices and edges explain most rays are tried; the one is taken of whose
//!               edges most is found where it should be. (2) Its edges that are seen,
//!               less 3.5 px at each end, are cut into pieces of at most 6 px, each located across itself by
//!               a blurred step with ramps fitted to the pixels within 4 px, in all channels, weighted by the
//!               camera's noise. (3) The cuboid's eight numbers (a turn, a vertex's place, three lengths; its size
//!               in metres is not needed) follow by least squares, pieces that do not fit (what hides an edge,
//!               a shadow beside it) left out by Tukey's weights; (2) again, until nothing moves.
//! # Input       all channels that differ, decoded to linear light, the exposure's noise model, and the camera's
//!               intrinsics and distortion. It uses the object's model: a cuboid, of any size. Methods without
//!               these see less: compare it with them only under that name.
//! # Parameters  seeds           none, 60  range [4, 1000]: so many seeds are fitted, the strongest first
//!               max_shift_px    px, 6     range [0.5, 20]: how far from its seed a corner may be
//!               max_iterations  none, 20  range [1, 100]: of (2) and (3)
//!               epsilon_px      px, 1e-3  range [0, 1]: done when no vertex moves by more
//! # Output      position, covariance, iterations, status: that of the vertex nearest to a seed, which a face that
//!               looks at the camera has. The covariance is that of the least squares, times what is left over
//!               degrees of freedom where that is more than noise. not_applicable: the intrinsics are not known, no
//!               cuboid explains the junctions, too little of its edges is seen, or none of its vertices is near.
//!               Elsewhere the seed's own position.
//! # Border      pixels beyond the image or saturated do not count; seeds outside the image: out_of_bounds.
//! # Cost        O(seeds) junction fits, then O(pixels along the edges) for each iteration.
//! # Departures  Hannemose et al. compare rendered pixels of whole objects; here only those near edges count,
//!               which carry what is known about places, and no rendering is needed.
//! # Source      Perkins, Real-world objects from line drawings, 1968 (three edges at right angles); Lowe,
//!               Fitting parameterized three-dimensional models to images, PAMI 1991; Drummond & Cipolla, Real-time
//!               visual tracking of complex structures, PAMI 2002; Hannemose, Wilm & Frisvad, Superaccurate
//!               camera calibration via inverse rendering, 2019.
//! # Checked by  tests/it/contract.rs (all), tests/it/cuboids.rs
//! ```

mod adjust;
mod hypothesis;
mod segment;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::cuboid::Cuboid;
use crate::detect::Detection;
use crate::geometry::{Camera, ImagePoint};
use crate::junction::rays::Rays;
use crate::refine::junction_fit::{JunctionFit, Work};
use crate::refine::light::Light;
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;

pub(crate) use adjust::Adjusted;
use adjust::adjust;
use segment::SegmentFitter;

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "cuboid_fit",
    summary: "one cuboid fitted to all its edges; uses object model and intrinsics",
    reference: "Lowe 1991; Drummond & Cipolla 2002; Hannemose et al. 2019",
    version: 2,
    defaults: defaults::<CuboidFit>,
    schema: schema::<CuboidFit>,
    build: |place, table| Ok(Box::new(parameters::<CuboidFit>(place, table)?)),
};

/// The refiner; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct CuboidFit {
    /// So many seeds are fitted, the strongest first.
    #[schemars(range(min = 4, max = 1000))]
    pub seeds: u32,
    /// How far from its seed a corner may be \[px\].
    #[schemars(range(min = 0.5, max = 20.0))]
    pub max_shift_px: f64,
    /// Iterations at most.
    #[schemars(range(min = 1, max = 100))]
    pub max_iterations: u32,
    /// The largest step of a vertex that ends the iteration \[px\].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub epsilon_px: f64,
}

impl Default for CuboidFit {
    fn default() -> Self {
        Self { seeds: 60, max_shift_px: 6.0, max_iterations: 20, epsilon_px: 1e-3 }
    }
}

impl Refiner for CuboidFit {
    fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner> {
        let light = Light::new(exposure);
        let fitted = exposure.camera().and_then(|camera| {
            let best = self.fitted(&light, camera, seeds).into_iter().next()?;
            Some((camera, best))
        });
        let refined = |seed: &Detection| {
            if !light.is_inside(seed.point) {
                return Corner::at_seed(*seed, 0, RefineStatus::OutOfBounds);
            }
            let located =
                fitted.as_ref().and_then(|(camera, adjusted)| self.nearest(adjusted, camera, seed));
            located.unwrap_or_else(|| Corner::at_seed(*seed, 0, RefineStatus::NotApplicable))
        };
        seeds.iter().map(refined).collect()
    }
}

/// Seeds nearer to a junction that was fitted lead to it again \[px\].
const SAME_PX: f64 = 2.5;

/// A cuboid explains at least so many rays: those of its first vertex and of two more.
const LEAST_RAYS: usize = 7;

impl CuboidFit {
    /// The cuboids whose vertices are among the seeds and whose edges are found where they should be, that of most
    /// evidence first; none where nothing knows the camera.
    pub(crate) fn cuboids(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Adjusted> {
        let light = Light::new(exposure);
        exposure.camera().map_or_else(Vec::new, |camera| self.fitted(&light, camera, seeds))
    }

    fn fitted(&self, light: &Light, camera: &Camera, seeds: &[Detection]) -> Vec<Adjusted> {
        let junctions = self.junctions(light, seeds);
        let mut fitter = SegmentFitter::default();
        let mut adjusted = |hypotheses: Vec<Cuboid>| {
            let adjusted = hypotheses.into_iter().filter_map(|cuboid| {
                let iterations = self.max_iterations;
                adjust(light, camera, cuboid, iterations, self.epsilon_px, &mut fitter)
            });
            let mut adjusted: Vec<Adjusted> = adjusted.collect();
            adjusted.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
            adjusted
        };
        let found = adjusted(hypothesis::of_three_rays(&junctions, camera, LEAST_RAYS));
        match found.is_empty() {
            true => adjusted(hypothesis::of_two_junctions(&junctions, camera, LEAST_RAYS)),
            false => found,
        }
    }

    /// Junctions at the strongest seeds, none twice.
    fn junctions(&self, light: &Light, seeds: &[Detection]) -> Vec<Rays> {
        let refiner = JunctionFit { max_shift_px: self.max_shift_px, ..JunctionFit::default() };
        let mut work = Work::new(&refiner, light.exposure);
        let mut strongest: Vec<&Detection> =
            seeds.iter().filter(|seed| light.is_inside(seed.point)).collect();
        // Whatever the order in which they are given.
        strongest.sort_by(|a, b| {
            let rows = a.point.y.total_cmp(&b.point.y);
            b.response.total_cmp(&a.response).then(rows).then(a.point.x.total_cmp(&b.point.x))
        });
        let mut found: Vec<Rays> = Vec::new();
        let mut tried: Vec<ImagePoint> = Vec::new();
        for seed in strongest {
            let is_known =
                found.iter().any(|rays| seed.point.distance_px(rays.vertex.into()) < SAME_PX)
                    || tried.iter().any(|point| seed.point.distance_px(*point) < 1.0);
            if is_known || tried.len() >= self.seeds as usize {
                continue;
            }
            tried.push(seed.point);
            if let Ok(located) = work.locate(seed.point) {
                let is_new = found
                    .iter()
                    .all(|rays| located.position().distance_px(rays.vertex.into()) > 1.0);
                if is_new {
                    found.push(located.rays);
                }
            }
        }
        found
    }

    /// The vertex that is nearest to a seed.
    fn nearest(&self, adjusted: &Adjusted, camera: &Camera, seed: &Detection) -> Option<Corner> {
        let nearest = (0..8)
            .filter(|vertex| adjusted.cuboid.shows_vertex(*vertex))
            .filter_map(|vertex| adjusted.vertex(vertex, camera))
            .min_by(|(a, _), (b, _)| {
                a.distance_px(seed.point).total_cmp(&b.distance_px(seed.point))
            });
        let (position, covariance_px2) = nearest?;
        let status =
            if adjusted.converged { RefineStatus::Ok } else { RefineStatus::MaxIterations };
        (position.distance_px(seed.point) <= self.max_shift_px).then_some(Corner {
            seed: *seed,
            position,
            covariance_px2: Some(covariance_px2),
            iterations: adjusted.iterations,
            status,
        })
    }
}
