//! The edge as the top of a parabola through three gradient magnitudes.
//!
//! Devernay, A non-maxima suppression method for edge detection with sub-pixel accuracy, INRIA RR-2724, 1995:
//! delta = (G- - G+) / (2 (G- - 2 G0 + G+)); along a column or a row, as Grompone von Gioi & Randall, IPOL 2017,
//! have it, where gradients need not be interpolated.

use super::ray::{Column, Found, Ray, Shape};

/// Half of the pixels that a gradient is made of.
const RADIUS: usize = 2;
/// exp(-j^2 / 2) j, so that a ramp of 1 has a gradient of 1.
const KERNEL: [f64; 2 * RADIUS + 1] = [-0.117_835, -0.264_330, 0.0, 0.264_330, 0.117_835];
/// Variance of the Gaussian that the kernel is a derivative of, cut off as it is: a third of sum j^3 k \[px^2\].
const KERNEL_PX2: f64 = 0.804_7;
/// How far across the line pixels are looked at \[px\]: a search and a kernel, of a slanted column, too.
pub(super) const REACH_PX: f64 = 6.0;

/// Looks for the steepest place up to three times `off_px` from the line.
pub(super) fn locate(ray: &Ray, column: &Column, off_px: f64) -> Option<Found> {
    let across_px = ray.across_px();
    let search_px = (3.0 * off_px).clamp(1.0, 2.5);
    let gradient = |index: usize| -> Option<f64> {
        let from = index.checked_sub(RADIUS)?;
        let to = index + RADIUS + 1;
        let is_whole = to <= column.count && column.usable[from..to].iter().all(|usable| *usable);
        let sum = || column.values[from..to].iter().zip(KERNEL).map(|(v, k)| v * k).sum::<f64>();
        is_whole.then(|| across_px.signum() * sum())
    };
    let (top, most) = (0..column.count)
        .filter(|index| column.distances_px[*index].abs() <= search_px)
        .filter_map(|index| Some((index, gradient(index)?)))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    let [before, after] = [gradient(top.checked_sub(1)?)?, gradient(top + 1)?];
    let bend = before - 2.0 * most + after;
    if most <= 0.0 || before.min(after) <= 0.0 || before.max(after) > most || bend >= 0.0 {
        return None;
    }
    let shift = 0.5 * (before - after) / bend;
    // The noise of each pixel by what it adds to numerator and denominator.
    let variance = 0.5 * (ray.variances[0] + ray.variances[1]);
    let tap = |index: usize| KERNEL.get(index).copied().unwrap_or(0.0);
    let squares: f64 = (0..=2 * RADIUS + 2)
        .map(|pixel| {
            let [of_before, of_top, of_after] =
                [tap(pixel), tap(pixel.wrapping_sub(1)), tap(pixel.wrapping_sub(2))];
            let change =
                0.5 * (of_before - of_after) - shift * (of_before - 2.0 * of_top + of_after);
            (change / bend).powi(2)
        })
        .sum();
    // Of a Gaussian the logarithm is a parabola.
    let curvature = 2.0 * most.ln() - before.ln() - after.ln();
    let width_px2 = (1.0 / curvature).max(KERNEL_PX2);
    let blur_px = (across_px * across_px * (width_px2 - KERNEL_PX2)).sqrt();
    let peak =
        (std::f64::consts::TAU * ((ray.look.sigma_px / across_px).powi(2) + KERNEL_PX2)).sqrt();
    let energy: f64 = KERNEL.iter().map(|tap| tap * tap).sum();
    Some(Found {
        offset_px: column.distances_px[top] + across_px * shift,
        variance_px2: across_px * across_px * variance * squares,
        step: peak * most,
        step_variance: peak * peak * variance * energy,
        blur_px: Some(blur_px),
        shape: Shape::default(),
    })
}
