//! Gradient orthogonality, exactly as OpenCV's `cornerSubPix` computes it.
//!
//! ```text
//! # Method      q minimises the sum over its window of m (g . (p - q))^2: every gradient g is
//!               orthogonal to the line from its pixel p to the corner q. Each iteration, p from q:
//!                 N = [a b; b c] = sum m g g^T,  [u; v] = sum m g g^T p
//!                 q += [c u - b v; a v - b u] / (a c - b^2)
//!               g: differences I(x+1) - I(x-1) of the window resampled at q (bilinear);
//!               m = exp(-(i/w)^2) exp(-(j/w)^2) for offsets i, j in [-w, w].
//! # Input       luma as encoded [DN]; gain and offset cancel. Positions are kept in f32, sums in
//!               f64.
//! # Parameters  half_window_px  px, 5     range [1, 255]: w; the window is (2w+1)^2 pixels
//!               zero_zone_px    px, -1    range [-1, w-1]: z >= 0 leaves (2z+1)^2 pixels out
//!               max_iterations  none, 40  range [1, 100]
//!               epsilon_px      px, 1e-3  range [0, inf): done when a step is no longer than this
//! # Output      position, iterations, status; no covariance.
//! # Border      the window continues outwards with border pixels; the image has at least 2w+5 rows
//!               and columns; seeds and steps stay in [0, width) x [0, height).
//! # Cost        O(w^2) per iteration.
//! # Departures  OpenCV returns positions alone. What it does silently is a status here, and the
//!               position of a declined seed is the seed's: reverted (its answer lies further than
//!               w from the seed; OpenCV returns the seed), out_of_bounds (a step leaves the image)
//!               and singular (both after the first iteration: OpenCV returns the last position
//!               inside). Where it throws for the whole batch, a seed is out_of_bounds: outside the
//!               image, or an image under 2w+5. Windows across the border differ by rounding, and
//!               past the image's top right corner by more: there OpenCV 5.0.0 does not continue
//!               the border pixels.
//! # Source      Foerstner & Guelch, ISPRS Intercommission Workshop 1987 (the equations); OpenCV
//!               5.0.0, modules/imgproc/src/cornersubpix.cpp and samplers.cpp (what is summed, and
//!               when it stops).
//! # Checked by  tests/it/contract.rs (all), tests/it/oracle.rs::corner_sub_pix_equals_opencv,
//!               corner_sub_pix_recovers_quarter_pixel_shifts. Against OpenCV 5.0.0 on 8-bit wedges
//!               (3 images, 2,000 seeds, w = 3, 5, 10): the same seeds declined, all 20,008 answers
//!               whose window stays inside equal to the last bit; across the border 10 of 449
//!               differ by more than 1e-4 px, seeds near the top right corner or never converging.
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Detection;
use crate::geometry::ImagePoint;
use crate::image::Plane;
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, in_range, parameters, schema};
use crate::sensor::Exposure;

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "corner_sub_pix",
    summary: "gradient orthogonality, as OpenCV's cornerSubPix",
    reference: "Foerstner & Guelch 1987; OpenCV 5.0.0 cornerSubPix",
    version: 1,
    defaults: defaults::<CornerSubPix>,
    schema: schema::<CornerSubPix>,
    build: |place, table| {
        let refiner: CornerSubPix = parameters(place, table)?;
        let half_window = i32::from(refiner.half_window_px);
        in_range(place, "zero_zone_px", refiner.zero_zone_px, -1..=half_window - 1)?;
        Ok(Box::new(refiner))
    },
};

/// The refiner; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct CornerSubPix {
    /// Half the window's side \[px\], its centre not counted.
    #[schemars(range(min = 1, max = 255))]
    pub half_window_px: u8,
    /// Half the side of the square left out around the centre \[px\]; -1 leaves nothing out.
    #[schemars(range(min = -1, max = 254))]
    pub zero_zone_px: i32,
    /// Iterations at most.
    #[schemars(range(min = 1, max = 100))]
    pub max_iterations: u32,
    /// The step that ends the iteration \[px\].
    #[schemars(range(min = 0.0))]
    pub epsilon_px: f64,
}

impl Default for CornerSubPix {
    fn default() -> Self {
        Self { half_window_px: 5, zero_zone_px: -1, max_iterations: 40, epsilon_px: 1e-3 }
    }
}

impl Refiner for CornerSubPix {
    fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner> {
        let plane = exposure.luma();
        let least = 2 * usize::from(self.half_window_px) + 5;
        if plane.width() < least || plane.height() < least {
            let declined = |seed: &Detection| Corner::at_seed(*seed, 0, RefineStatus::OutOfBounds);
            return seeds.iter().map(declined).collect();
        }
        let mut window = Window::new(self);
        seeds.iter().map(|seed| self.refine_one(plane, &mut window, seed)).collect()
    }
}

impl CornerSubPix {
    fn refine_one(&self, plane: &Plane<f32>, window: &mut Window, seed: &Detection) -> Corner {
        #[allow(clippy::cast_possible_truncation, reason = "OpenCV keeps positions in f32")]
        let start = [seed.point.x as f32, seed.point.y as f32];
        if !contains(plane, start) {
            return Corner::at_seed(*seed, 0, RefineStatus::OutOfBounds);
        }
        let mut position = start;
        let mut iterations = 0;
        let status = loop {
            window.resample(plane, position);
            let Some([dx, dy]) = window.step() else {
                return Corner::at_seed(*seed, iterations, RefineStatus::Singular);
            };
            #[allow(clippy::cast_possible_truncation, reason = "OpenCV keeps positions in f32")]
            let next = [(f64::from(position[0]) + dx) as f32, (f64::from(position[1]) + dy) as f32];
            let moved = [next[0] - position[0], next[1] - position[1]];
            if !contains(plane, next) {
                return Corner::at_seed(*seed, iterations, RefineStatus::OutOfBounds);
            }
            position = next;
            iterations += 1;
            if f64::from(moved[0] * moved[0] + moved[1] * moved[1])
                <= self.epsilon_px * self.epsilon_px
            {
                break RefineStatus::Ok;
            }
            if iterations == self.max_iterations {
                break RefineStatus::MaxIterations;
            }
        };
        let reach = f32::from(self.half_window_px);
        if (position[0] - start[0]).abs() > reach || (position[1] - start[1]).abs() > reach {
            return Corner::at_seed(*seed, iterations, RefineStatus::Reverted);
        }
        Corner {
            seed: *seed,
            position: ImagePoint::new(f64::from(position[0]), f64::from(position[1])),
            covariance_px2: None,
            iterations,
            status,
        }
    }
}

/// Whether a position counts as inside: from the first pixel's centre up to, and without, the one
/// after the last; never for NaN.
fn contains(plane: &Plane<f32>, [x, y]: [f32; 2]) -> bool {
    (0.0..plane.width() as f32).contains(&x) && (0.0..plane.height() as f32).contains(&y)
}

/// The window's weights, and room for what is computed in it; one serves all seeds.
struct Window {
    /// w.
    half: usize,
    /// m, (2w+1)^2.
    weights: Vec<f32>,
    /// The pixels that the resampled window covers, (2w+4)^2.
    pixels: Vec<f32>,
    /// The window resampled, with the one pixel around it that differences need, (2w+3)^2.
    resampled: Vec<f32>,
    /// Sums over the rows of the window, per column: of gx^2, gxgy, gy^2 and, times the row's
    /// offset from the centre, of gxgy and gy^2; all weighted.
    columns: [Vec<f64>; 5],
}

impl Window {
    fn new(parameters: &CornerSubPix) -> Self {
        let half = usize::from(parameters.half_window_px);
        let w = f32::from(parameters.half_window_px);
        let side = 2 * half + 1;
        let bell: Vec<f32> =
            (0..side).map(|i| (i as f32 - w) / w).map(|offset| (-offset * offset).exp()).collect();
        let mut weights: Vec<f32> =
            bell.iter().flat_map(|vy| bell.iter().map(move |vx| vy * vx)).collect();
        if let Ok(zone) = usize::try_from(parameters.zero_zone_px) {
            for row in weights.chunks_exact_mut(side).skip(half - zone).take(2 * zone + 1) {
                row[half - zone..=half + zone].fill(0.0);
            }
        }
        Self {
            half,
            weights,
            pixels: vec![0.0; (side + 3) * (side + 3)],
            resampled: vec![0.0; (side + 2) * (side + 2)],
            columns: [0; 5].map(|_| vec![0.0; side]),
        }
    }

    /// Resamples `plane` around `centre`, bilinear.
    fn resample(&mut self, plane: &Plane<f32>, centre: [f32; 2]) {
        let side = 2 * self.half + 3;
        let reach = (self.half + 1) as f32;
        let corner = centre.map(|coordinate| coordinate - reach);
        let whole = corner.map(f32::floor);
        let [a, b] = [corner[0] - whole[0], corner[1] - whole[1]];
        #[allow(clippy::cast_possible_truncation, reason = "inside the image, less the reach")]
        let [x0, y0] = whole.map(|coordinate| coordinate as isize);

        for (row, y) in self.pixels.chunks_exact_mut(side + 1).zip(y0..) {
            let last = plane.height().cast_signed() - 1;
            let source = plane.row(y.clamp(0, last).cast_unsigned());
            let inside = usize::try_from(x0).ok().and_then(|x| source.get(x..x + side + 1));
            match inside {
                Some(samples) => row.copy_from_slice(samples),
                None => {
                    for (sample, x) in row.iter_mut().zip(x0..) {
                        *sample = plane.at_replicated(x, y);
                    }
                }
            }
        }

        let weights = [(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b];
        for (y, row) in self.resampled.chunks_exact_mut(side).enumerate() {
            let (upper, lower) = self.pixels[y * (side + 1)..][..2 * (side + 1)].split_at(side + 1);
            for (x, sample) in row.iter_mut().enumerate() {
                *sample = (upper[x] * weights[0] + upper[x + 1] * weights[1])
                    + (lower[x] * weights[2] + lower[x + 1] * weights[3]);
            }
        }
    }

    /// The step from the window's centre to the point that solves the normal equations; `None`
    /// where they are singular.
    fn step(&mut self) -> Option<[f64; 2]> {
        let (side, w) = (2 * self.half + 1, self.half as f64);
        let [gxx, gxy, gyy, gxy_py, gyy_py] = self.columns.each_mut().map(|sums| {
            sums.fill(0.0);
            &mut sums[..side]
        });
        let mut py = -w;
        for (y, weights) in self.weights.chunks_exact(side).enumerate() {
            let samples = |row: usize, column: usize| {
                &self.resampled[(y + row) * (side + 2) + column..][..side]
            };
            let (left, right) = (samples(1, 0), samples(1, 2));
            let (above, below) = (samples(0, 1), samples(2, 1));
            let weights = &weights[..side];
            for x in 0..side {
                let gx = f64::from(right[x] - left[x]);
                let gy = f64::from(below[x] - above[x]);
                let m = f64::from(weights[x]);
                let (xx, xy, yy) = (gx * gx * m, gx * gy * m, gy * gy * m);
                gxx[x] += xx;
                gxy[x] += xy;
                gyy[x] += yy;
                gxy_py[x] += xy * py;
                gyy_py[x] += yy * py;
            }
            py += 1.0;
        }
        let (mut a, mut b, mut c, mut u, mut v) = (0.0, 0.0, 0.0, 0.0, 0.0);
        let mut px = -w;
        for x in 0..side {
            a += gxx[x];
            b += gxy[x];
            c += gyy[x];
            u += gxx[x] * px + gxy_py[x];
            v += gxy[x] * px + gyy_py[x];
            px += 1.0;
        }
        let determinant = a * c - b * b;
        if determinant.abs() <= f64::EPSILON * f64::EPSILON {
            return None;
        }
        let scale = 1.0 / determinant;
        Some([c * scale * u - b * scale * v, a * scale * v - b * scale * u])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::{Encoding, Transfer};

    fn grey(width: usize, height: usize, value: impl FnMut(usize, usize) -> f32) -> Exposure {
        let plane = Plane::from_fn(width, height, value);
        let encoding = Encoding { bit_depth: 8, transfer: Transfer::Srgb, black_dn: 0.0 };
        Exposure::new([plane.clone(), plane.clone(), plane], encoding).expect("finite")
    }

    /// A chessboard's corner between the pixels 9 and 10, both ways.
    fn chess() -> Exposure {
        grey(20, 20, |x, y| if (x < 10) == (y < 10) { 200.0 } else { 50.0 })
    }

    fn refine(refiner: &CornerSubPix, exposure: &Exposure, x: f64, y: f64) -> Corner {
        let seed = Detection::new(ImagePoint::new(x, y), 1.0);
        refiner.refine(exposure, &[seed])[0]
    }

    #[test]
    fn a_corner_between_pixels_is_found_from_every_side() {
        for (x, y) in [(9.0, 9.0), (10.0, 9.0), (8.0, 11.0), (9.3, 12.0)] {
            let corner = refine(&CornerSubPix::default(), &chess(), x, y);
            assert_eq!(corner.status, RefineStatus::Ok);
            assert!(corner.position.distance_px(ImagePoint::new(9.5, 9.5)) < 1e-3, "{corner:?}");
        }
    }

    #[test]
    fn weights_fall_to_e_to_the_minus_two_in_the_corner_and_vanish_in_the_zone() {
        let parameters = CornerSubPix { half_window_px: 2, zero_zone_px: 0, ..Default::default() };
        let window = Window::new(&parameters);
        let expected = [-2.0_f32, -1.25, -1.0, -1.25, -2.0, -1.25, -0.5, -0.25].map(f32::exp);
        for (found, expected) in window.weights.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-7, "{found} {expected}");
        }
        assert_eq!(window.weights[12].to_bits(), 0); // the centre
    }

    #[test]
    fn resampling_is_exact_on_a_ramp_and_continues_the_border() {
        let mut window = Window::new(&CornerSubPix { half_window_px: 1, ..Default::default() });
        let ramp = Plane::from_fn(9, 9, |x, y| 4.0 * x as f32 + 32.0 * y as f32);
        window.resample(&ramp, [3.25, 4.5]); // from (1.25, 2.5) to (5.25, 6.5)
        assert_eq!(window.resampled[..5], [85.0, 89.0, 93.0, 97.0, 101.0]);
        assert_eq!(window.resampled[20..], [213.0, 217.0, 221.0, 225.0, 229.0]);
        window.resample(&ramp, [0.25, 8.0]); // from (-1.75, 6) to (2.25, 10)
        assert_eq!(window.resampled[..5], [192.0, 192.0, 193.0, 197.0, 201.0]);
        assert_eq!(window.resampled[20..], [256.0, 256.0, 257.0, 261.0, 265.0]);
    }

    #[test]
    fn one_iteration_that_has_not_converged_says_so() {
        let refiner = CornerSubPix { max_iterations: 1, ..Default::default() };
        let corner = refine(&refiner, &chess(), 8.0, 8.0);
        assert_eq!((corner.status, corner.iterations), (RefineStatus::MaxIterations, 1));
        assert!(corner.position != corner.seed.point);
    }

    #[test]
    fn an_answer_beyond_the_window_is_given_up() {
        // From 4 px off, a window of +-3 sees the corner's edges run towards it step by step.
        let refiner = CornerSubPix { half_window_px: 3, ..Default::default() };
        let corner = refine(&refiner, &chess(), 6.0, 6.0);
        assert_eq!(corner.status, RefineStatus::Reverted, "{corner:?}");
        assert_eq!(corner.position, corner.seed.point);
    }

    #[test]
    fn no_gradient_or_one_direction_is_singular() {
        let flat = grey(20, 20, |_, _| 80.0);
        let edge = grey(20, 20, |x, _| if x < 10 { 80.0 } else { 90.0 });
        for exposure in [flat, edge] {
            let corner = refine(&CornerSubPix::default(), &exposure, 10.0, 10.0);
            assert_eq!(corner, Corner::at_seed(corner.seed, 0, RefineStatus::Singular));
        }
    }

    #[test]
    fn a_way_that_leaves_the_image_is_out_of_bounds() {
        // Two edges meet at (-2, 10).
        let wedge = grey(20, 20, |x, y| {
            let inside = 2 * y.abs_diff(10) < x + 2;
            if inside { 200.0 } else { 20.0 }
        });
        let corner = refine(&CornerSubPix::default(), &wedge, 1.0, 10.0);
        assert_eq!(corner.status, RefineStatus::OutOfBounds, "{corner:?}");
        assert_eq!(corner.position, corner.seed.point);
    }

    #[test]
    fn seeds_outside_and_images_too_small_are_out_of_bounds() {
        for (x, y) in [(-0.1, 5.0), (5.0, 20.0), (f64::NAN, 5.0), (5.0, f64::INFINITY)] {
            let corner = refine(&CornerSubPix::default(), &chess(), x, y);
            assert_eq!((corner.status, corner.iterations), (RefineStatus::OutOfBounds, 0));
        }
        assert_ne!(
            refine(&CornerSubPix::default(), &chess(), 5.0, 19.9).status,
            RefineStatus::OutOfBounds
        );
        let small = grey(14, 40, |x, y| (x * y) as f32);
        let corner = refine(&CornerSubPix::default(), &small, 5.0, 5.0);
        assert_eq!(corner.status, RefineStatus::OutOfBounds);
    }
}
