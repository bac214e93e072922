//! The edge as a step of any blur, fitted to a column's pixels where they are.
//!
//! I(d) = B + A Phi((d - d0) / sigma) + C d + K k, k = 2 (d Phi + sigma phi) - d what |d| is when it is blurred:
//! ramps to both sides. About d0 = 0 and the ray's blur this is linear in 1, d, Phi, phi, k and t phi, t = d / sigma, and one
//! step of Gauss and Newton is d0 = -sigma c_phi / A; the ray moves there, and the next round begins at 0. The
//! kink K is one for the whole ray: of each station it would double the offset's variance. As least squares have it,
//! the offset without a kink does not correlate with the kink, and moves in proportion to it.

use nalgebra::{Matrix2, Vector2};

use super::ray::{Column, Found, Ray, Shape};

/// Functions that are fitted: the step and what moves and widens it come last.
const FUNCTIONS: usize = 6;
const STEP: usize = 2;
const MOVED: usize = 3;
const KINK: usize = 4;
const WIDENED: usize = 5;

/// Fits the column's pixels, each weighted by its noise; `usual` is the step of the stations before, which is
/// known better than this one's.
pub(super) fn locate(ray: &Ray, column: &Column, usual: f64) -> Option<Found> {
    const LEAST_PIVOT: f64 = 1e-4;
    let sigma_px = ray.look.sigma_px;
    let [less, more] = ray.variances;
    let mut normal = [[0.0; FUNCTIONS]; FUNCTIONS];
    let mut right = [0.0; FUNCTIONS];
    let (mut squares, mut pixels) = (0.0, 0.0);
    for index in (0..column.count).filter(|index| column.usable[*index]) {
        let (far_px, value) = (column.distances_px[index], column.values[index]);
        let t = far_px / sigma_px;
        let (below, density) = normal_distribution(t);
        let kink = 2.0 * (far_px * below + sigma_px * density) - far_px;
        let functions = [1.0, far_px, below, density, kink, t * density];
        let weight = 1.0 / (less + (more - less) * below);
        for row in 0..FUNCTIONS {
            let weighted = weight * functions[row];
            right[row] += weighted * value;
            for column in 0..=row {
                normal[row][column] += weighted * functions[column];
            }
        }
        squares += weight * value * value;
        pixels += 1.0;
    }
    let degrees = pixels - FUNCTIONS as f64;
    if degrees < 1.0 {
        return None;
    }
    // Cholesky; a pivot that is next to nothing is a function that the others make, too.
    for row in 0..FUNCTIONS {
        let whole = normal[row][row];
        for column in 0..=row {
            let sum: f64 = (0..column).map(|k| normal[row][k] * normal[column][k]).sum();
            let rest = normal[row][column] - sum;
            normal[row][column] =
                if column < row { rest / normal[column][column] } else { rest.max(0.0).sqrt() };
        }
        if normal[row][row].powi(2) <= LEAST_PIVOT * LEAST_PIVOT * whole {
            return None;
        }
        let sum: f64 = (0..row).map(|k| normal[row][k] * right[k]).sum();
        right[row] = (right[row] - sum) / normal[row][row];
        squares -= right[row] * right[row];
    }
    let moved = right[MOVED] / normal[MOVED][MOVED];
    let coupling = normal[MOVED][STEP] / normal[MOVED][MOVED];
    let step = (right[STEP] - normal[MOVED][STEP] * moved) / normal[STEP][STEP];
    let step_variance = (1.0 + coupling * coupling) / normal[STEP][STEP].powi(2);
    if step <= 0.0 {
        return None;
    }
    // Surely more is left than noise: other things are near.
    let left = squares / degrees;
    let excess = if left > 1.0 + 5.0 * (2.0 / degrees).sqrt() { left } else { 1.0 };
    let per_px = usual / sigma_px;
    // The kink as it is, the widening as a share of the blur: phi t is what narrows the step.
    let l = Matrix2::new(normal[KINK][KINK], 0.0, normal[WIDENED][KINK], normal[WIDENED][WIDENED]);
    let units = Matrix2::new(1.0, 0.0, 0.0, -usual);
    let moves = Vector2::new(normal[KINK][MOVED], normal[WIDENED][MOVED]);
    let shape = Shape {
        information: units * l * l.transpose() * units / excess,
        score: units * l * Vector2::new(right[KINK], right[WIDENED]) / excess,
        moves_px: units * moves / (normal[MOVED][MOVED] * per_px),
    };
    Some(Found {
        offset_px: -moved / per_px,
        variance_px2: excess / (per_px * normal[MOVED][MOVED]).powi(2),
        step,
        step_variance: excess * step_variance,
        blur_px: None,
        shape,
    })
}

/// The normal distribution function and density at a place.
///
/// Abramowitz & Stegun (1964), Handbook of Mathematical Functions, 7.1.26: to 1e-7.
fn normal_distribution(t: f64) -> (f64, f64) {
    const TERMS: [f64; 5] =
        [1.061_405_429, -1.453_152_027, 1.421_413_741, -0.284_496_736, 0.254_829_592];
    let bell = (-0.5 * t * t).exp();
    let u = 1.0 / (1.0 + 0.327_591_1 * std::f64::consts::FRAC_1_SQRT_2 * t.abs());
    let tail = 0.5 * bell * u * TERMS.iter().fold(0.0, |sum, term| sum * u + term);
    (if t > 0.0 { 1.0 - tail } else { tail }, bell / std::f64::consts::TAU.sqrt())
}
