//! Registration of a drawn junction: the warp under which it correlates best with the image.
//!
//! ```text
//! # Method      Rays are where edges that cross circles about the seed in a line meet (junction_fit's starts);
//!               levels of their sectors fit the light within R. The junction is drawn, with its blur, on
//!               (2R+1)^2 pixels about its vertex; from its places x to the image's leads v + A x. The image, by
//!               bicubic interpolation, is w there; r is the template, G its slopes by the warp's parameters, all
//!               less their means. The step that correlates r + G d best with w (inverse compositional) is
//!                 d = (G^T G)^-1 G^T (g w - r),  g = (r . r - r . P r) / (w . r - w . P r),
//!                 P = G (G^T G)^-1 G^T;  A <- A (1 + D)^-1, v <- v - A t of d's matrix D and translation t
//!               Then the junction is drawn anew with the rays, blur and levels found, and registered again,
//!               until the warp scales it by less than 2 %, six times at most. Of several starts the one that
//!               correlates best is the answer.
//! # Input       red, green and blue as encoded, decoded to linear light, weighted by 0.2126, 0.7152,
//!               0.0722 (Rec. 709), with the exposure's noise model. Gain and offset cancel.
//! # Parameters  radius_px         px, 8     range [4, 20]: R
//!               template_sigma_px px, 0.8   range [0.3, 5]: blur of the first template, the pixel included
//!               motion            "affine", the default, or "translation": A is fixed
//!               max_shift_px      px, 6     range [0.5, 20]: how far from its seed a corner may be
//!               max_iterations    none, 30  range [1, 100]: of one registration
//!               epsilon_px        px, 1e-3  range [0, 1]: done when no place of the template moves more
//! # Output      position, covariance, iterations (of all registrations), status. The covariance is that of the
//!               normal equations with gain and offset unknown, by the camera's noise or by what is left where
//!               that is more. singular: no two edges meet near the seed, or the two are one straight edge
//!               to 0.1 rad; false_corner: two of three rays are; not_applicable: two straight edges cross, or
//!               the correlation is below 0.95; diverged: the last registration did not converge, the warp left
//!               max_shift_px or twice the size, or the blur grew beyond 0.35 R. Elsewhere the seed's own position.
//! # Border      out_of_bounds where the warped template or the seed is not in the image.
//! # Cost        O(R^2) for each iteration, 16 samples for each place.
//! # Departures  The source has no template of its own; a drawn one has slopes without noise. An affine warp
//!               leaves a wedge a wedge: what it changes are the rays' directions and, by its scale, the blur.
//! # Source      Evangelidis & Psarakis, Parametric image alignment using enhanced correlation coefficient
//!               maximization, IEEE PAMI 30, 2008 (the inverse compositional one); Keys, Cubic convolution
//!               interpolation for digital image processing, IEEE ASSP 29, 1981.
//! # Checked by  tests/it/contract.rs (all), tests/it/peaks.rs
//! ```

mod registration;

use nalgebra::Matrix2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Detection;
use crate::geometry::ImagePoint;
use crate::junction::fit::{Fitter, Samples};
use crate::junction::rays::Rays;
use crate::refine::luminance::Luminance;
use crate::refine::starts::Starts;
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;
use registration::{Template, Warp};

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "template_ecc",
    summary: "a drawn junction registered by its enhanced correlation coefficient",
    reference: "Evangelidis & Psarakis 2008; Keys 1981",
    version: 1,
    defaults: defaults::<TemplateEcc>,
    schema: schema::<TemplateEcc>,
    build: |place, table| Ok(Box::new(parameters::<TemplateEcc>(place, table)?)),
};

/// What a template may do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Motion {
    /// Move.
    Translation,
    /// Move, turn, scale and shear.
    #[default]
    Affine,
}

/// The refiner; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct TemplateEcc {
    /// The template has this many pixels to each side of its middle \[px\].
    #[schemars(range(min = 4, max = 20))]
    pub radius_px: u32,
    /// Blur of the first template, the pixel's area included \[px\].
    #[schemars(range(min = 0.3, max = 5.0))]
    pub template_sigma_px: f64,
    /// What the template may do.
    pub motion: Motion,
    /// How far from its seed a corner may be \[px\].
    #[schemars(range(min = 0.5, max = 20.0))]
    pub max_shift_px: f64,
    /// Iterations of one registration at most.
    #[schemars(range(min = 1, max = 100))]
    pub max_iterations: u32,
    /// The step of any place that ends the iteration \[px\].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub epsilon_px: f64,
}

impl Default for TemplateEcc {
    fn default() -> Self {
        Self {
            radius_px: 8,
            template_sigma_px: 0.8,
            motion: Motion::default(),
            max_shift_px: 6.0,
            max_iterations: 30,
            epsilon_px: 1e-3,
        }
    }
}

/// Below this correlation what is there is not what was drawn.
const LEAST_CORRELATION: f64 = 0.95;
/// From this correlation on no other start is tried.
const SURE_CORRELATION: f64 = 0.99;
/// Two rays are one straight edge to within this \[rad\].
const STRAIGHT_RAD: f64 = 0.1;
/// The blur at least: about that of the samples' interpolation and of a pixel's area \[px\].
const LEAST_SIGMA_PX: f64 = 0.5;
/// The blur at most, as a share of the template's radius.
const MOST_BLUR: f64 = 0.35;
/// How much a step may change the warp's matrix.
const MOST_CHANGE: f64 = 0.3;
/// How much the warp may enlarge the template.
const MOST_SCALE: f64 = 2.0;
/// How often a junction is drawn and registered at most.
const MOST_ROUNDS: usize = 6;
/// A drawing that is scaled by less than this fits as it is.
const SAME_SCALE: f64 = 0.02;
/// One that is scaled by more than this, or its inverse, is drawn anew.
const OTHER_SCALE: f64 = 1.25;

impl Refiner for TemplateEcc {
    fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner> {
        let mut samples = Samples {
            channel_count: 1,
            radius_px: f64::from(self.radius_px),
            ..Samples::default()
        };
        samples.make_square(self.radius_px as usize);
        let mut work = Work {
            refiner: self,
            luminance: Luminance::new(exposure),
            samples,
            fitter: Fitter::default(),
            starts: Starts::default(),
            template: Template::default(),
            iterations: 0,
        };
        let refined = |seed: &Detection| {
            work.iterations = 0;
            match work.locate(seed.point) {
                Ok(found) => Corner {
                    seed: *seed,
                    position: found.position,
                    covariance_px2: found.covariance_px2,
                    iterations: work.iterations,
                    status: RefineStatus::Ok,
                },
                Err(status) => Corner::at_seed(*seed, work.iterations, status),
            }
        };
        seeds.iter().map(refined).collect()
    }
}

/// A template that was registered.
struct Registered {
    position: ImagePoint,
    covariance_px2: Option<Matrix2<f64>>,
    converged: bool,
    correlation: f64,
    /// The rays among the samples.
    rays: Rays,
    /// How much larger than drawn.
    scale: f64,
}

/// What one exposure's corners share.
struct Work<'a> {
    refiner: &'a TemplateEcc,
    luminance: Luminance<'a>,
    samples: Samples,
    fitter: Fitter,
    starts: Starts,
    template: Template,
    iterations: u32,
}

impl Work<'_> {
    fn locate(&mut self, seed: ImagePoint) -> Result<Registered, RefineStatus> {
        let TemplateEcc { radius_px, max_shift_px, .. } = *self.refiner;
        if !self.luminance.light.is_inside(seed) {
            return Err(RefineStatus::OutOfBounds);
        }
        let reach_px = max_shift_px + MOST_SCALE * f64::from(radius_px);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "tens of px")]
        self.luminance.take(seed, reach_px.ceil() as usize + 3);
        let light = &self.luminance.light;
        self.starts.look(light.planes, &light.deviations_dn(seed), seed, max_shift_px);
        let mut best = Err(RefineStatus::Singular);
        for index in 0..self.starts.found.len() {
            let start = self.starts.found[index];
            if start.is_crossing {
                return Err(RefineStatus::NotApplicable);
            }
            let found = self.registered(&start.rays, seed);
            let correlation = |found: &Result<Registered, _>| {
                found.as_ref().map_or(0.0, |found: &Registered| found.correlation)
            };
            if index == 0 || correlation(&found) > correlation(&best) {
                best = found;
            }
            if correlation(&best) >= SURE_CORRELATION {
                break;
            }
        }
        let best = best?;
        verdict(&best.rays)?;
        if best.correlation < LEAST_CORRELATION {
            return Err(RefineStatus::NotApplicable);
        }
        Ok(best)
    }

    /// Draws rays of the image and registers them, again and again until the drawing fits as it is.
    fn registered(&mut self, start: &Rays, seed: ImagePoint) -> Result<Registered, RefineStatus> {
        let vertex = self.luminance.local(ImagePoint::new(start.vertex[0], start.vertex[1]));
        let sigma_px = self.refiner.template_sigma_px;
        let mut found = self.register(&Rays { vertex, sigma_px, ..*start }, seed)?;
        for _ in 1..MOST_ROUNDS {
            found = self.register(&found.rays, seed)?;
            if (found.scale - 1.0).abs() < SAME_SCALE && found.converged {
                return Ok(found);
            }
        }
        // What still moves depends on where it started.
        if found.converged { Ok(found) } else { Err(RefineStatus::Diverged) }
    }

    /// Draws rays among the samples and registers them.
    fn register(&mut self, rays: &Rays, seed: ImagePoint) -> Result<Registered, RefineStatus> {
        let TemplateEcc { max_shift_px, max_iterations, epsilon_px, motion, .. } = *self.refiner;
        let radius_px = self.samples.radius_px;
        let levels = self.levels(rays).ok_or(RefineStatus::Singular)?;
        self.template.draw(&self.samples, rays, levels, motion).ok_or(RefineStatus::Singular)?;
        let mut warp = Warp { vertex: rays.vertex.into(), matrix: Matrix2::identity() };
        for iteration in 1..=max_iterations {
            self.iterations += 1;
            let position = self.luminance.point(warp.vertex.into());
            let reach_px = warp.reach_px(radius_px);
            // Neither holds of what is not a number.
            let is_near = position.distance_px(seed) <= max_shift_px;
            let is_blurred = rays.sigma_px > MOST_BLUR * radius_px;
            if !is_near || reach_px > MOST_SCALE * radius_px || reach_px.is_nan() || is_blurred {
                return Err(RefineStatus::Diverged);
            }
            if !self.luminance.holds(warp.vertex.into(), reach_px) {
                return Err(RefineStatus::OutOfBounds);
            }
            let samples = &self.luminance.samples;
            let step = self.template.step(samples, &warp, &self.samples);
            let step = step.ok_or(RefineStatus::Diverged)?.no_larger_than(MOST_CHANGE);
            let moved_px = step.translation.norm() + radius_px * step.matrix.norm();
            let is_done = moved_px <= epsilon_px;
            let scale = warp.scale();
            let may_shrink = rays.sigma_px > LEAST_SIGMA_PX;
            let is_other = scale > OTHER_SCALE || (may_shrink && scale < 1.0 / OTHER_SCALE);
            if is_done || is_other || iteration == max_iterations {
                let variance = |value: f64| {
                    #[allow(clippy::cast_possible_truncation, reason = "a share")]
                    let expected = value as f32;
                    self.luminance.variance(expected)
                };
                return Ok(Registered {
                    position,
                    covariance_px2: self.template.covariance_px2(&warp, &step, variance),
                    converged: is_done,
                    correlation: step.correlation,
                    rays: warp.rays(rays, LEAST_SIGMA_PX),
                    scale,
                });
            }
            let change = (Matrix2::identity() + step.matrix).try_inverse();
            warp.matrix *= change.ok_or(RefineStatus::Diverged)?;
            warp.vertex -= warp.matrix * step.translation;
        }
        Err(RefineStatus::Diverged)
    }

    /// The levels of rays among the samples that fit the light about their vertex.
    fn levels(&mut self, rays: &Rays) -> Option<[f64; 3]> {
        let Self { samples, luminance, fitter, .. } = self;
        let middle = rays.vertex.map(f64::round);
        let count = samples.places.x.len();
        let square = (2 * self.refiner.radius_px as usize + 1).pow(2);
        let channel = &mut samples.channels[0];
        channel.samples.resize(count, 0.0);
        channel.weights.resize(count, 0.0);
        for index in 0..square {
            let (x, y) = (samples.places.x[index], samples.places.y[index]);
            #[allow(clippy::cast_possible_truncation, reason = "in the patch, or clamped")]
            let at = |middle: f64, offset: f32| middle as isize + offset as isize;
            channel.samples[index] =
                luminance.samples.at_replicated(at(middle[0], x), at(middle[1], y));
            let is_near = f64::from(x.hypot(y)) <= samples.radius_px;
            channel.weights[index] = f32::from(u8::from(is_near));
        }
        let vertex = [rays.vertex[0] - middle[0], rays.vertex[1] - middle[1]];
        let levels = fitter.levels(samples, &Rays { vertex, ..*rays }, false)?;
        Some(levels[0].map(|sector| sector[0]))
    }
}

/// Whether rays are those of a corner.
fn verdict(rays: &Rays) -> Result<(), RefineStatus> {
    for ray in 0..rays.count {
        for other in ray + 1..rays.count {
            let turn = (rays.angles_rad[other] - rays.angles_rad[ray]).abs();
            if (turn - std::f64::consts::PI).abs() < STRAIGHT_RAD {
                return Err(if rays.count == 2 {
                    RefineStatus::Singular
                } else {
                    RefineStatus::FalseCorner
                });
            }
        }
    }
    Ok(())
}
