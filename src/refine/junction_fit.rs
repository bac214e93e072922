//! A blurred junction fitted to the pixels about a corner: as near to the limit as noise lets it.
//!
//! ```text
//! # Method      Two or three rays from a vertex, between them sectors of any level and ramp, blurred by a
//!               Gaussian that takes in the pixel's area, are fitted to linear light by least squares, each
//!               pixel weighted by the camera's noise: variable projection, see src/junction/fit.rs.
//!               Starts are where edges that cross circles about the seed in a line meet (4.5, 6.5, 8.5 and
//!               10.5 px), the nearest and strongest first; the window then moves with the vertex. A third ray
//!               stays, or is tried where an L leaves more than noise, if it lowers chi^2 + k ln n (Schwarz's
//!               information criterion). Where more is left than noise and 0.3 % of the contrast, smaller windows
//!               are tried, and the one is taken whose covariance, so enlarged, is smallest.
//! # Input       all channels that differ, decoded to linear light, with the exposure's noise model.
//! # Parameters  radius_px       px, 10    range [4, 30]: pixels whose centres are nearer to the vertex
//!               ramps           bool, true: sectors may be brighter towards one side
//!               max_shift_px    px, 6     range [0.5, 20]: how far from its seed a corner may be
//!               max_iterations  none, 30  range [1, 100]: of one fit
//!               epsilon_px      px, 1e-3  range [0, 1]: done when a step is no longer than this
//! # Output      position, covariance, iterations (of all fits), status. The covariance is the inverse of the
//!               Fisher information with levels, ramps, directions and blur unknown, times chi^2 over degrees of
//!               freedom where more than noise is left. diverged: no fit within max_shift_px;
//!               singular: no two edges meet near the seed, the two are one straight edge to within three
//!               standard deviations, or by its covariance the corner is known to no better than 0.5 px;
//!               false_corner: two of three rays are one edge, at which another ends; not_applicable: two
//!               straight edges cross. Elsewhere the seed's own position.
//! # Border      pixels beyond the image or saturated have no weight; where half of a window has none, and for
//!               a seed outside the image, out_of_bounds.
//! # Cost        O(R^2) for a step of a fit, four to six of them; three channels cost thrice.
//! # Departures  Rohr fits a wedge blurred in one direction, Deriche and Blaszka exponential blurs; here the
//!               blurred sector is exact (src/junction/rays.rs), and the pixel's square to the fourth order: at a
//!               blur of 0.5 px no corner is displaced by 0.001 px.
//! # Source      Rohr, Recognizing corners by fitting parametric models, IJCV 1992; Deriche & Blaszka,
//!               Recovering and characterizing image features using an efficient model based approach, CVPR
//!               1993; Golub & Pereyra, The differentiation of pseudo-inverses and nonlinear least squares
//!               problems whose variables separate, SIAM J. Numer. Anal. 1973; Kaufman, BIT 1975.
//! # Checked by  tests/it/contract.rs (all), tests/it/junctions.rs
//! ```

mod patch;
mod third;

use nalgebra::Matrix2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Detection;
use crate::geometry::ImagePoint;
use crate::junction::fit::{Fit, Fitter, Freedom, NoFit, Samples};
use crate::junction::rays::Rays;
use crate::refine::starts::Starts;
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;

pub use patch::Patches;
use third::{Ring, with_third};

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "junction_fit",
    summary: "a blurred L, Y or arrow with ramps, fitted to all channels in linear light",
    reference: "Rohr 1992; Deriche & Blaszka 1993; Golub & Pereyra 1973",
    version: 2,
    defaults: defaults::<JunctionFit>,
    schema: schema::<JunctionFit>,
    build: |place, table| Ok(Box::new(parameters::<JunctionFit>(place, table)?)),
};

/// The refiner; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct JunctionFit {
    /// Pixels whose centres are nearer to the vertex are fitted \[px\].
    #[schemars(range(min = 4.0, max = 30.0))]
    pub radius_px: f64,
    /// Whether sectors may be brighter towards one side.
    pub ramps: bool,
    /// How far from its seed a corner may be \[px\].
    #[schemars(range(min = 0.5, max = 20.0))]
    pub max_shift_px: f64,
    /// Iterations of one fit at most.
    #[schemars(range(min = 1, max = 100))]
    pub max_iterations: u32,
    /// The step that ends the iteration \[px\].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub epsilon_px: f64,
}

impl Default for JunctionFit {
    fn default() -> Self {
        Self {
            radius_px: 10.0,
            ramps: true,
            max_shift_px: 6.0,
            max_iterations: 30,
            epsilon_px: 1e-3,
        }
    }
}

impl Refiner for JunctionFit {
    fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner> {
        let mut work = Work::new(self, exposure);
        let refined = |seed: &Detection| {
            if !work.patches.light.is_inside(seed.point) {
                return Corner::at_seed(*seed, 0, RefineStatus::OutOfBounds);
            }
            match work.locate(seed.point) {
                Ok(found) => Corner {
                    seed: *seed,
                    position: found.position(),
                    covariance_px2: Some(found.covariance_px2),
                    iterations: work.iterations,
                    status: found.status,
                },
                Err(status) => Corner::at_seed(*seed, work.iterations, status),
            }
        };
        seeds.iter().map(refined).collect()
    }
}

/// A corner that was located.
pub(super) struct Located {
    /// In the image.
    pub rays: Rays,
    pub covariance_px2: Matrix2<f64>,
    pub status: RefineStatus,
}

impl Located {
    pub fn position(&self) -> ImagePoint {
        self.rays.vertex.into()
    }
}

/// A fit and where its window is.
struct Placed {
    fit: Fit,
    /// The pixel that places are relative to.
    origin: [f64; 2],
}

impl Placed {
    fn vertex(&self) -> ImagePoint {
        let [x, y] = self.fit.rays.vertex;
        ImagePoint::new(self.origin[0] + x, self.origin[1] + y)
    }

    /// The trace of the vertex's covariance, with what is left over.
    fn variance_px2(&self) -> f64 {
        self.fit.vertex_covariance_px2().trace()
    }

    /// How many times as much is left as noise and the model's own faults leave.
    fn excess(&self) -> f64 {
        self.fit.chi2 / self.fit.degrees / self.expected()
    }

    /// What is left of a right fit, over what noise leaves.
    fn expected(&self) -> f64 {
        1.0 + (MODEL_ERROR * self.fit.contrast_over_noise).powi(2)
    }

    /// Whether more than noise is left: by so many standard deviations.
    fn is_left_over(&self, deviations: f64) -> bool {
        let degrees = self.fit.degrees;
        self.excess() > 1.0 + deviations * (2.0 / degrees).sqrt()
    }

    /// What is left beyond noise, as a share of the largest step between sectors.
    fn misfit(&self) -> f64 {
        let left = (self.fit.chi2 / self.fit.degrees - 1.0).max(0.0).sqrt();
        left / self.fit.contrast_over_noise.max(1e-9)
    }

    /// The ray whose direction is known worst.
    fn weakest(&self) -> usize {
        let variance = |ray: &usize| self.fit.covariance[(3 + ray, 3 + ray)];
        (0..self.fit.rays.count).max_by(|a, b| variance(a).total_cmp(&variance(b))).unwrap_or(0)
    }

    /// The rays, from a vertex in the image.
    fn rays_in_image(&self) -> Rays {
        let vertex = self.vertex();
        Rays { vertex: [vertex.x, vertex.y], ..self.fit.rays }
    }

    /// Whether these three rays explain so much more of the same samples than those two that a third is
    /// worth its parameters: Schwarz's information criterion. Where more than noise is left by three, all
    /// that is left counts as noise.
    fn is_worth_more_than(&self, two: &Self, channels: usize) -> bool {
        let parameters = 1.0 + 3.0 * channels as f64;
        let noise = self.expected() * self.excess().max(1.0);
        (two.fit.chi2 - self.fit.chi2) / noise > parameters * self.fit.degrees.ln()
    }
}

/// More is left than noise where it is so many standard deviations more.
const LEFT_OVER: f64 = 5.0;

/// How wrong the model of a right fit may be, as a share of the contrast: a pixel's square is no Gaussian, a
/// sector is not quite even.
const MODEL_ERROR: f64 = 0.003;

/// What is left, as a share of the contrast, where a ray may be missing.
const LEAST_MISFIT: f64 = 0.02;

/// A corner whose place is known worse by its own covariance is not located \[px\].
const MOST_DEVIATION_PX: f64 = 0.5;

/// Smaller windows, of the radius, that are tried where more than noise is left.
const SMALLER: [f64; 2] = [0.7, 0.5];

/// What one exposure's corners share.
pub(super) struct Work<'a> {
    refiner: &'a JunctionFit,
    patches: Patches<'a>,
    samples: Samples,
    fitter: Fitter,
    starts: Starts,
    ring: Ring,
    /// Of the last corner.
    pub iterations: u32,
}

impl<'a> Work<'a> {
    pub fn new(refiner: &'a JunctionFit, exposure: &'a Exposure) -> Self {
        Self {
            refiner,
            patches: Patches::new(exposure),
            samples: Samples::default(),
            fitter: Fitter::default(),
            starts: Starts::default(),
            ring: Ring::default(),
            iterations: 0,
        }
    }

    /// The corner about a place of the image, or why there is none.
    pub fn locate(&mut self, seed: ImagePoint) -> Result<Located, RefineStatus> {
        self.iterations = 0;
        let mut best = self.best_about(seed, seed);
        // From the vertex itself its edges are seen better than from beyond it.
        let again = match &best {
            Ok(placed) if placed.is_left_over(LEFT_OVER) => Some(placed.vertex()),
            _ => None,
        };
        if let Some(vertex) = again
            && let Ok(other) = self.best_about(vertex, seed)
            && best.as_ref().is_ok_and(|best| other.excess() < best.excess())
        {
            best = Ok(other);
        }
        let mut best = best?;
        if best.is_left_over(LEFT_OVER) && best.misfit() > LEAST_MISFIT {
            best = self.with_any_third(best, seed);
        }
        if best.is_left_over(LEFT_OVER) {
            for share in SMALLER {
                let radius_px = share * self.refiner.radius_px;
                if let Ok(other) = self.chosen(best.rays_in_image(), radius_px, seed)
                    && other.variance_px2() < best.variance_px2()
                {
                    best = other;
                }
            }
        }
        if best.variance_px2() > MOST_DEVIATION_PX * MOST_DEVIATION_PX {
            return Err(RefineStatus::Singular);
        }
        Ok(Located {
            rays: best.rays_in_image(),
            covariance_px2: best.fit.vertex_covariance_px2(),
            status: verdict(&best.fit)?,
        })
    }

    /// The junction of which least is left over, or the first that leaves no more than noise, of those that
    /// edges about a place suggest.
    fn best_about(&mut self, place: ImagePoint, seed: ImagePoint) -> Result<Placed, RefineStatus> {
        let deviations_dn = self.patches.light.deviations_dn(place);
        let max_shift_px = self.refiner.max_shift_px;
        self.starts.look(self.patches.light.planes, &deviations_dn, place, max_shift_px);
        let mut best: Result<Placed, _> = Err(RefineStatus::Singular);
        for index in 0..self.starts.found.len() {
            let start = self.starts.found[index];
            let found = if start.is_crossing {
                Err(RefineStatus::NotApplicable)
            } else {
                self.chosen(start.rays, self.refiner.radius_px, seed)
            };
            match (&best, &found) {
                (Ok(best), Ok(found)) if best.excess() <= found.excess() => continue,
                (Ok(_), Err(_)) => continue,
                _ => best = found,
            }
            if best.as_ref().is_ok_and(|best| !best.is_left_over(LEFT_OVER)) {
                break;
            }
        }
        best
    }

    /// Tries a third ray in all directions, where three fit no better than two.
    fn with_any_third(&mut self, best: Placed, seed: ImagePoint) -> Placed {
        const DIRECTIONS: u32 = 16;
        const APART_RAD: f64 = 0.3;
        let mut best = best;
        let rays = best.rays_in_image();
        let two = if rays.count == 2 { rays } else { rays.without(best.weakest()) };
        for direction in 0..DIRECTIONS {
            let angle = std::f64::consts::TAU * f64::from(direction) / f64::from(DIRECTIONS);
            let is_apart = two.angles_rad[..2].iter().all(|other| {
                let turn = (angle - other).rem_euclid(std::f64::consts::TAU);
                turn.min(std::f64::consts::TAU - turn) > APART_RAD
            });
            if !is_apart {
                continue;
            }
            if let Ok(three) = self.fit(two.with(angle), self.refiner.radius_px)
                && three.vertex().distance_px(seed) <= self.refiner.max_shift_px
                && three.excess() < 0.9 * best.excess()
            {
                best = three;
            }
        }
        best
    }

    /// Fits two rays or three, whichever the samples are worth; near the seed.
    fn chosen(
        &mut self,
        start: Rays,
        radius_px: f64,
        seed: ImagePoint,
    ) -> Result<Placed, RefineStatus> {
        let placed = self.two_or_three(start, radius_px)?;
        let is_near = placed.vertex().distance_px(seed) <= self.refiner.max_shift_px;
        if is_near { Ok(placed) } else { Err(RefineStatus::Diverged) }
    }

    fn two_or_three(&mut self, start: Rays, radius_px: f64) -> Result<Placed, RefineStatus> {
        const SURELY_RAD: f64 = 0.05;
        let first = self.fit(start, radius_px);
        let channels = self.patches.light.planes.len();
        if start.count == 2 {
            let two = first?;
            if !two.is_left_over(2.0) {
                return Ok(two);
            }
            let Some(rays) = with_third(&two, &self.samples, &mut self.ring) else {
                return Ok(two);
            };
            return Ok(match self.fit(rays, radius_px) {
                Ok(three) if three.is_worth_more_than(&two, channels) => three,
                _ => two,
            });
        }
        let weakest = match &first {
            Ok(three) => {
                let weakest = three.weakest();
                let variance = three.fit.covariance[(3 + weakest, 3 + weakest)];
                if variance < SURELY_RAD * SURELY_RAD {
                    return first;
                }
                weakest
            }
            Err(_) => start.count - 1,
        };
        let rays = first.as_ref().map_or(start, Placed::rays_in_image);
        match (first, self.fit(rays.without(weakest), radius_px)) {
            (Ok(three), Ok(two)) if three.is_worth_more_than(&two, channels) => Ok(three),
            (_, Ok(two)) => Ok(two),
            (first, _) => first,
        }
    }

    /// Fits rays that start in the image; the window follows the vertex.
    fn fit(&mut self, start: Rays, radius_px: f64) -> Result<Placed, RefineStatus> {
        let mut rays = start;
        let mut last = None;
        for _ in 0..4 {
            let middle = ImagePoint::new(rays.vertex[0], rays.vertex[1]);
            let origin = self
                .patches
                .take(middle, radius_px, &mut self.samples)
                .ok_or(RefineStatus::OutOfBounds)?;
            let mut local = rays;
            local.vertex = [middle.x - origin[0], middle.y - origin[1]];
            let freedom = Freedom {
                ramps: self.refiner.ramps,
                max_shift_px: 0.5 * radius_px,
                max_sigma_px: 0.4 * radius_px,
                max_iterations: self.refiner.max_iterations,
                epsilon_px: self.refiner.epsilon_px,
            };
            let fit =
                self.fitter.fit(&self.samples, &local, &freedom).map_err(|none| match none {
                    NoFit::Singular => RefineStatus::Singular,
                    NoFit::Diverged => RefineStatus::Diverged,
                })?;
            self.iterations += fit.iterations;
            let placed = Placed { fit, origin };
            let vertex = placed.vertex();
            let is_there = vertex.distance_px(middle) < 0.5;
            rays = placed.rays_in_image();
            last = Some(placed);
            if is_there {
                break;
            }
        }
        last.ok_or(RefineStatus::Diverged)
    }
}

/// Whether two rays are one straight edge, to within three standard deviations.
fn is_straight(fit: &Fit, ray: usize, other: usize) -> bool {
    const LEAST_RAD: f64 = 0.02;
    let turn = (fit.rays.angles_rad[other] - fit.rays.angles_rad[ray]).abs();
    let (a, b) = (3 + ray, 3 + other);
    let c = &fit.covariance;
    let variance = fit.excess() * (c[(a, a)] + c[(b, b)] - 2.0 * c[(a, b)]);
    (turn - std::f64::consts::PI).abs() < 3.0 * variance.max(0.0).sqrt().max(LEAST_RAD / 3.0)
}

fn verdict(fit: &Fit) -> Result<RefineStatus, RefineStatus> {
    let rays = fit.rays.count;
    for ray in 0..rays {
        for other in ray + 1..rays {
            if is_straight(fit, ray, other) {
                return Err(if rays == 2 {
                    RefineStatus::Singular
                } else {
                    RefineStatus::FalseCorner
                });
            }
        }
    }
    Ok(if fit.converged { RefineStatus::Ok } else { RefineStatus::MaxIterations })
}
