//! The saddle of a quadric fitted to an X corner.
//!
//! ```text
//! # Method      Linear light is filtered by a cone, c(d) = max(0, gamma + 1 - |d|), normalised. Each iteration
//!               a quadric a1 x^2 + a2 x y + a3 y^2 + a4 x + a5 y + a6 about q is fitted to the filtered samples
//!               of a disc of radius R by least squares, and q moves to where its slope is zero:
//!                 q -= H^-1 [a4; a5],  H = [2 a1, a2; a2, 2 a3],  det H < 0
//!               Samples at distance r have the weight (1 - (r / R)^2)^2: the disc moves with q, not by whole
//!               pixels. About the answer the filtered samples on a circle of radius R must cross the middle
//!               between their least and largest four times, two and two opposite.
//! # Input       red, green and blue as encoded, decoded to linear light, weighted by 0.2126, 0.7152,
//!               0.0722 (Rec. 709), with the exposure's noise model. Gain and offset cancel.
//! # Parameters  radius_px       px, 5     range [3, 20]: R
//!               cone_px         px, 2     range [0, 5]: gamma; 0 filters nothing
//!               max_shift_px    px, 6     range [0.5, 20]: how far from its seed a corner may be
//!               max_iterations  none, 30  range [1, 100]
//!               epsilon_px      px, 1e-4  range [0, 1]: done when a step is no longer than this
//! # Output      position, covariance, iterations, status. The covariance is the camera's noise through filter
//!               and fit to the point where the slope is zero, first order. not_applicable: no two edges cross
//!               on the circle, of L, Y, arrow, T and straight edges; singular: the circle is flat to within
//!               noise, or there is an X and the quadric is no saddle; diverged: there is an X and the
//!               iteration left max_shift_px; max_iterations: the last position. Elsewhere the seed's own.
//! # Border      out_of_bounds where the disc about the answer, or the seed, is not in the image.
//! # Cost        O((R + max_shift)^2 gamma^2) for a seed, O(R^2) for each iteration.
//! # Departures  Lucchese and Mitra fit pixels of equal weight in a square once; ROCHADE fits the square about
//!               the nearest pixel. Weights that end smoothly and a disc that follows q leave no error of phase:
//!               an X is its own image turned by half a turn, and so is the disc. The cone is normalised.
//! # Source      Lucchese & Mitra, Using saddle points for subpixel feature detection in camera calibration
//!               targets, APCCAS 2002; Placht et al., ROCHADE: robust checkerboard advanced detection for camera
//!               calibration, ECCV 2014 (the cone).
//! # Checked by  tests/it/contract.rs (all), tests/it/peaks.rs
//! ```

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Detection;
use crate::geometry::ImagePoint;
use crate::image::Plane;
use crate::refine::luminance::Luminance;
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "saddle_polynomial",
    summary: "the saddle of a quadric fitted to an X corner; no other corner's",
    reference: "Lucchese & Mitra 2002; Placht et al. 2014",
    version: 1,
    defaults: defaults::<SaddlePolynomial>,
    schema: schema::<SaddlePolynomial>,
    build: |place, table| Ok(Box::new(parameters::<SaddlePolynomial>(place, table)?)),
};

/// The refiner; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct SaddlePolynomial {
    /// Radius of the disc that is fitted \[px\].
    #[schemars(range(min = 3.0, max = 20.0))]
    pub radius_px: f64,
    /// Radius of the cone, a pixel less \[px\].
    #[schemars(range(min = 0, max = 5))]
    pub cone_px: u32,
    /// How far from its seed a corner may be \[px\].
    #[schemars(range(min = 0.5, max = 20.0))]
    pub max_shift_px: f64,
    /// Iterations at most.
    #[schemars(range(min = 1, max = 100))]
    pub max_iterations: u32,
    /// The step that ends the iteration \[px\].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub epsilon_px: f64,
}

impl Default for SaddlePolynomial {
    fn default() -> Self {
        Self { radius_px: 5.0, cone_px: 2, max_shift_px: 6.0, max_iterations: 30, epsilon_px: 1e-4 }
    }
}

impl Refiner for SaddlePolynomial {
    fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner> {
        let mut work = Work {
            refiner: self,
            luminance: Luminance::new(exposure),
            cone: self.cone(),
            filtered: Plane::default(),
            slopes: Plane::default(),
            iterations: 0,
        };
        let refined = |seed: &Detection| {
            work.iterations = 0;
            match work.locate(seed.point) {
                Ok((position, covariance_px2, status)) => Corner {
                    seed: *seed,
                    position,
                    covariance_px2,
                    iterations: work.iterations,
                    status,
                },
                Err(status) => Corner::at_seed(*seed, work.iterations, status),
            }
        };
        seeds.iter().map(refined).collect()
    }
}

impl SaddlePolynomial {
    /// The cone, which adds up to 1.
    fn cone(&self) -> Plane<f64> {
        let reach = f64::from(self.cone_px);
        let side = 2 * self.cone_px as usize + 1;
        let height = |x: usize, y: usize| {
            (reach + 1.0 - (x as f64 - reach).hypot(y as f64 - reach)).max(0.0)
        };
        let cone = Plane::from_fn(side, side, height);
        let sum: f64 = cone.samples().iter().sum();
        cone.map(|value| value / sum)
    }
}

/// What one exposure's corners share.
struct Work<'a> {
    refiner: &'a SaddlePolynomial,
    luminance: Luminance<'a>,
    cone: Plane<f64>,
    /// Samples filtered by the cone; those at the edge are anything.
    filtered: Plane<f32>,
    /// How the slope depends on each filtered sample.
    slopes: Plane<[f64; 2]>,
    iterations: u32,
}

/// A quadric about a point.
struct Quadric {
    hessian: Matrix2<f64>,
    slope: Vector2<f64>,
    /// The two rows of the inverse normal equations that give the slope.
    of_slope: SMatrix<f64, 2, 6>,
}

/// What a circle crosses.
enum Crossing {
    /// Nothing but noise.
    Nothing,
    /// Two edges that cross.
    X,
    /// Something else.
    Other,
}

type Answer = (ImagePoint, Option<Matrix2<f64>>, RefineStatus);

impl Work<'_> {
    fn locate(&mut self, seed: ImagePoint) -> Result<Answer, RefineStatus> {
        let SaddlePolynomial { radius_px, cone_px, max_shift_px, .. } = *self.refiner;
        if !self.luminance.light.is_inside(seed) {
            return Err(RefineStatus::OutOfBounds);
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "tens of px")]
        let reach = (radius_px + max_shift_px).ceil() as usize + cone_px as usize + 2;
        self.luminance.take(seed, reach);
        self.filter();
        let start = Vector2::from(self.luminance.local(seed));
        let found = self.saddle(start);
        let place = found.as_ref().map_or(start, |(place, ..)| *place);
        if !self.luminance.holds(place.into(), radius_px) {
            return Err(RefineStatus::OutOfBounds);
        }
        match self.crossing(place) {
            Crossing::Nothing => Err(RefineStatus::Singular),
            Crossing::Other => Err(RefineStatus::NotApplicable),
            Crossing::X => {
                let (place, quadric, status) = found?;
                let covariance_px2 = self.covariance_px2(place, &quadric);
                Ok((self.luminance.point(place.into()), covariance_px2, status))
            }
        }
    }

    /// Filters the samples by the cone.
    fn filter(&mut self) {
        let Self { luminance, cone, filtered, .. } = self;
        let samples = &luminance.samples;
        let side = samples.width();
        filtered.reset(side, side, 0.0);
        let reach = cone.width() / 2;
        for y in reach..side - reach {
            for j in 0..cone.height() {
                let from = samples.row(y + j - reach);
                for (i, tap) in cone.row(j).iter().enumerate() {
                    #[allow(clippy::cast_possible_truncation, reason = "samples are f32")]
                    let tap = *tap as f32;
                    let row = &mut filtered.row_mut(y)[reach..side - reach];
                    row.iter_mut().zip(&from[i..]).for_each(|(sum, sample)| *sum += tap * sample);
                }
            }
        }
    }

    /// Where the fitted quadric's slope is zero, the quadric there, and whether it converged.
    fn saddle(
        &mut self,
        start: Vector2<f64>,
    ) -> Result<(Vector2<f64>, Quadric, RefineStatus), RefineStatus> {
        const MOST_PX: f64 = 2.0;
        let SaddlePolynomial { max_shift_px, max_iterations, epsilon_px, .. } = *self.refiner;
        let mut place = start;
        loop {
            self.iterations += 1;
            let quadric = self.quadric(place).ok_or(RefineStatus::Singular)?;
            let step = quadric.step().ok_or(RefineStatus::Singular)?;
            let length_px = step.norm();
            if length_px <= epsilon_px {
                return Ok((place + step, quadric, RefineStatus::Ok));
            }
            place += step * (MOST_PX / length_px).min(1.0);
            if (place - start).norm() > max_shift_px {
                return Err(RefineStatus::Diverged);
            }
            if self.iterations == max_iterations {
                return Ok((place, quadric, RefineStatus::MaxIterations));
            }
        }
    }

    /// Calls for each pixel of the disc about a place: its column and row, the terms of the quadric there,
    /// in units of the radius, and its weight.
    fn over_disc(
        &self,
        place: Vector2<f64>,
        mut each: impl FnMut([usize; 2], &SVector<f64, 6>, f64),
    ) {
        let radius_px = self.refiner.radius_px;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in the patch")]
        let span = |at: f64| (at - radius_px).ceil() as usize..=(at + radius_px).floor() as usize;
        for row in span(place.y) {
            for column in span(place.x) {
                let x = (column as f64 - place.x) / radius_px;
                let y = (row as f64 - place.y) / radius_px;
                let inside = 1.0 - x * x - y * y;
                if inside > 0.0 {
                    let terms = SVector::from([x * x, x * y, y * y, x, y, 1.0]);
                    each([column, row], &terms, inside * inside);
                }
            }
        }
    }

    /// The quadric that fits a disc best.
    fn quadric(&self, place: Vector2<f64>) -> Option<Quadric> {
        let mut normal = SMatrix::<f64, 6, 6>::zeros();
        let mut right = SVector::<f64, 6>::zeros();
        self.over_disc(place, |[x, y], terms, weight| {
            let weighted = weight * terms;
            normal += weighted * terms.transpose();
            right += weighted * f64::from(self.filtered.at(x, y));
        });
        let inverse = normal.cholesky()?.inverse();
        let [a1, a2, a3, a4, a5, _] = (inverse * right).into();
        let scale = 1.0 / self.refiner.radius_px;
        Some(Quadric {
            hessian: scale * scale * Matrix2::new(2.0 * a1, a2, a2, 2.0 * a3),
            slope: scale * Vector2::new(a4, a5),
            of_slope: scale * inverse.fixed_rows::<2>(3),
        })
    }

    /// The camera's noise through filter and fit.
    fn covariance_px2(&mut self, place: Vector2<f64>, quadric: &Quadric) -> Option<Matrix2<f64>> {
        let side = self.filtered.width();
        let mut slopes = std::mem::take(&mut self.slopes);
        slopes.reset(side, side, [0.0; 2]);
        self.over_disc(place, |[x, y], terms, weight| {
            let of_sample = weight * quadric.of_slope * terms;
            for (j, row) in (y..).zip(0..self.cone.height()) {
                let reach = self.cone.width() / 2;
                let slopes = &mut slopes.row_mut(j - reach)[x - reach..];
                for (slope, tap) in slopes.iter_mut().zip(self.cone.row(row)) {
                    *slope = [slope[0] + tap * of_sample.x, slope[1] + tap * of_sample.y];
                }
            }
        });
        let mut noise = Matrix2::zeros();
        for (slope, expected) in slopes.samples().iter().zip(self.filtered.samples()) {
            if slope[0] != 0.0 || slope[1] != 0.0 {
                let slope = Vector2::from(*slope);
                noise += self.luminance.variance(*expected) * slope * slope.transpose();
            }
        }
        self.slopes = slopes;
        let inverse = quadric.hessian.try_inverse()?;
        let covariance = inverse * noise * inverse.transpose();
        covariance.iter().all(|value| value.is_finite()).then_some(covariance)
    }

    /// What a circle about a place crosses.
    fn crossing(&self, place: Vector2<f64>) -> Crossing {
        const PLACES: usize = 64;
        const LEAST_SHARE: f64 = 0.1;
        const LEAST_DEVIATIONS: f64 = 4.0;
        const STRAIGHT_RAD: f64 = 0.4;
        let radius_px = self.refiner.radius_px;
        let angle = |index: usize| TAU * index as f64 / PLACES as f64;
        let samples: [f64; PLACES] = std::array::from_fn(|index| {
            let (sine, cosine) = angle(index).sin_cos();
            let x = place.x + radius_px * cosine;
            self.filtered.bilinear(ImagePoint::new(x, place.y + radius_px * sine))
        });
        let least = samples.iter().copied().fold(f64::MAX, f64::min);
        let largest = samples.iter().copied().fold(f64::MIN, f64::max);
        let middle = 0.5 * (least + largest);
        #[allow(clippy::cast_possible_truncation, reason = "a share of full scale")]
        let variance = self.luminance.variance(middle as f32);
        let energy: f64 = self.cone.samples().iter().map(|tap| tap * tap).sum();
        let noise = LEAST_DEVIATIONS * (variance * energy).sqrt();
        // What is nearer to the middle is on neither side.
        let off = noise.max(LEAST_SHARE * (largest - least));
        if 0.5 * (largest - least) <= off {
            return Crossing::Nothing;
        }
        let mut crossings = [0.0; 4];
        let mut count = 0;
        // Once around, from where it is surely on one side; the last place on that side is known.
        let first = samples.iter().position(|sample| *sample > middle + off).unwrap_or(0);
        let (mut is_above, mut last) = (true, first);
        for index in first + 1..=first + PLACES {
            let above = samples[index % PLACES] - middle;
            if above.abs() <= off {
                continue;
            }
            if (above > 0.0) != is_above {
                if count == crossings.len() {
                    return Crossing::Other;
                }
                crossings[count] = 0.5 * (angle(last) + angle(index));
                count += 1;
                is_above = !is_above;
            }
            last = index;
        }
        let [a, b, c, d] = crossings;
        let is_straight = |from: f64, to: f64| (to - from - PI).abs() < STRAIGHT_RAD;
        if count == 4 && is_straight(a, c) && is_straight(b, d) {
            Crossing::X
        } else {
            Crossing::Other
        }
    }
}

impl Quadric {
    /// The step to its saddle; `None` where it has none.
    fn step(&self) -> Option<Vector2<f64>> {
        let inverse = self.hessian.try_inverse()?;
        let step = -(inverse * self.slope);
        (self.hessian.determinant() < 0.0 && step.iter().all(|value| value.is_finite()))
            .then_some(step)
    }
}
