//! Gradient orthogonality, exactly as OpenCV's `cornerSubPix` computes it.
//!
//! ```text
//! # Method      q minimises the sum over its window of m (g . (p - q))^2: every gradient g is
//!               orthogonal to the line from its pixel p to the corner q. Each iteration, p from q:
//!                 N = [a b; b c] = sum m g g^T,  [u; v] = sum m g g^T p
//!                 q += [c u - b v; a v - b u] / (a c - b^2)
//!               g: differences I(x+1) - I(x-1) of the window resampled at q (bilinear);
//!               m = exp(-(i/w)^2) exp(-(j/w)^2) for offsets i, j in [-w, w].
//! # Input       luma as encoded [DN]; gain and offset cancel. Positions and gradients are kept in
//!               f32, rounded as OpenCV rounds them, sums in f64: an iteration that does not converge
//!               makes of any other rounding another answer.
//! # Parameters  half_window_px  px, 5     range [1, 255]: w; the window is (2w+1)^2 pixels
//!               zero_zone_px    px, -1    range [-1, w-1]: z >= 0 leaves (2z+1)^2 pixels out
//!               max_iterations  none, 40  range [1, 100]
//!               epsilon_px      px, 1e-3  range [0, inf): done when a step is no longer than this
//!               least_roundness none, 0.03  range [0, 1): of N, 4 det N / (tr N)^2, at the answer; 0 is OpenCV
//! # Output      position, iterations, status; no covariance.
//! # Border      the window continues outwards with border pixels; the image has at least 2w+5 rows
//!               and columns; seeds and steps stay in [0, width) x [0, height).
//! # Cost        O(w^2) per iteration.
//! # Departures  OpenCV returns positions alone. What it does silently is a status here, and the
//!               position of a declined seed is the seed's: reverted (its answer lies further than
//!               w from the seed; OpenCV returns the seed), out_of_bounds (a step leaves the image)
//!               and singular (both after the first iteration: OpenCV returns the last position
//!               inside). On a straight edge aslant OpenCV answers somewhere along it: its equations are
//!               singular but for the pixels' grid; where N is not round, that is singular here.
//!               Where it throws for the whole batch, a seed is out_of_bounds: outside the
//!               image, or an image under 2w+5. Windows across the border differ by rounding, and
//!               past the image's top right corner by more: there OpenCV 5.0.0 does not continue
//!               the border pixels.
//! # Source      Foerstner & Guelch, ISPRS Intercommission Workshop 1987 (the equations); OpenCV
//!               5.0.0, modules/imgproc/src/cornersubpix.cpp and samplers.cpp (what is summed, and
//!               when it stops).
//! # Checked by  tests/it/contract.rs (all), tests/it/oracle.rs::corner_sub_pix_equals_opencv,
//!               corner_sub_pix_recovers_quarter_pixel_shifts, tests/it/opencv.rs (10,000 seeds, w = 3,
//!               5, 7, 10, to 1e-4 px). Against OpenCV 5.0.0 on 12,000 seeds more (junctions, texture, a
//!               rendered picture): the same seeds reverted; across the border 9 of 30,000 answers
//!               differ by more than 1e-4 px, elsewhere none.
//! ```

mod window;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Detection;
use crate::geometry::ImagePoint;
use crate::image::Plane;
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, in_range, parameters, schema};
use crate::sensor::Exposure;
use crate::vector::{Widen, WithWiden, dispatch_widening};

use window::{Step, Window};

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "corner_sub_pix",
    summary: "gradient orthogonality, as OpenCV's cornerSubPix",
    reference: "Foerstner & Guelch 1987; OpenCV 5.0.0 cornerSubPix",
    version: 3,
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
    /// Answers from gradients of next to one direction are declined: 4 det N / (tr N)^2 below this.
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 1.0))]
    pub least_roundness: f64,
}

impl Default for CornerSubPix {
    fn default() -> Self {
        Self {
            half_window_px: 5,
            zero_zone_px: -1,
            max_iterations: 40,
            epsilon_px: 1e-3,
            least_roundness: 0.03,
        }
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
        dispatch_widening(Refined { refiner: self, plane, seeds })
    }
}

/// The corners of some seeds: compiled for the machine's vectors.
struct Refined<'a> {
    refiner: &'a CornerSubPix,
    plane: &'a Plane<f32>,
    seeds: &'a [Detection],
}

impl WithWiden for Refined<'_> {
    type Output = Vec<Corner>;

    #[inline(always)]
    fn with_simd<S: Widen>(self, simd: S) -> Vec<Corner> {
        let Self { refiner, plane, seeds } = self;
        let mut window = Window::new(refiner);
        // Those outside the image stay as they are.
        let outside = |seed: &Detection| Corner::at_seed(*seed, 0, RefineStatus::OutOfBounds);
        let mut corners: Vec<Corner> = seeds.iter().map(outside).collect();
        let mut starts = seeds.iter().enumerate().filter_map(|(index, seed)| {
            #[allow(clippy::cast_possible_truncation, reason = "OpenCV keeps positions in f32")]
            let start = [seed.point.x as f32, seed.point.y as f32];
            contains(plane, start).then_some(Run { index, start, position: start, iterations: 0 })
        });
        // A step waits for its own sums: the machine goes on with another corner's meanwhile.
        let mut runs = [starts.next(), starts.next()];
        while runs.iter().any(Option::is_some) {
            for slot in &mut runs {
                let Some(run) = slot else { continue };
                if let Some(end) = refiner.advance(simd, plane, &mut window, run) {
                    let corner = &mut corners[run.index];
                    corner.status = end;
                    corner.iterations = run.iterations;
                    if matches!(end, RefineStatus::Ok | RefineStatus::MaxIterations) {
                        let [x, y] = run.position.map(f64::from);
                        corner.position = ImagePoint::new(x, y);
                    }
                    *slot = starts.next();
                }
            }
        }
        corners
    }
}

/// A corner's iteration.
#[derive(Clone, Copy, Debug)]
struct Run {
    /// Of its seed.
    index: usize,
    start: [f32; 2],
    position: [f32; 2],
    iterations: u32,
}

impl CornerSubPix {
    /// A step of a run; its status where that ends it.
    #[inline(always)]
    fn advance<S: Widen>(
        &self,
        simd: S,
        plane: &Plane<f32>,
        window: &mut Window,
        run: &mut Run,
    ) -> Option<RefineStatus> {
        let Some(Step { by: [dx, dy], roundness }) = window.step(simd, plane, run.position) else {
            return Some(RefineStatus::Singular);
        };
        let [x, y] = run.position;
        #[allow(clippy::cast_possible_truncation, reason = "OpenCV keeps positions in f32")]
        let next = [(f64::from(x) + dx) as f32, (f64::from(y) + dy) as f32];
        if !contains(plane, next) {
            return Some(RefineStatus::OutOfBounds);
        }
        run.position = next;
        run.iterations += 1;
        let [dx, dy] = [next[0] - x, next[1] - y];
        let is_done = f64::from(dx * dx + dy * dy) <= self.epsilon_px * self.epsilon_px;
        if !is_done && run.iterations < self.max_iterations {
            return None;
        }
        let reach = f32::from(self.half_window_px);
        Some(if (next[0] - run.start[0]).abs() > reach || (next[1] - run.start[1]).abs() > reach {
            RefineStatus::Reverted
        } else if roundness < self.least_roundness {
            RefineStatus::Singular
        } else if is_done {
            RefineStatus::Ok
        } else {
            RefineStatus::MaxIterations
        })
    }
}

/// Whether a position counts as inside: from the first pixel's centre up to, and without, the one
/// after the last; never for NaN.
#[inline(always)]
fn contains(plane: &Plane<f32>, [x, y]: [f32; 2]) -> bool {
    (0.0..plane.width() as f32).contains(&x) && (0.0..plane.height() as f32).contains(&y)
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
