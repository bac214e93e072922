//! The edge by the area that it leaves of pixels.
//!
//! Trujillo-Pino, Krissian, Aleman-Flores & Santana-Cedres, Accurate subpixel edge location based on partial area
//! effect, Image Vis. Comput. 2013: in a block of three columns of 2 h + 1 pixels, about the pixel of the edge, with
//! levels T before and B behind, the middle column sums to S = (2 h + 1) (T + B) / 2 + a (T - B), a the mean
//! place of the edge in it. T and B are means of the three pixels farthest from the edge.

use super::ray::{Column, Found, Ray, Shape};

/// Half a column, without its middle: 2 in the source, for edges without blur; with it pixels of the levels must be
/// out of its tails, the nearest too.
fn half(ray: &Ray) -> usize {
    const TAILS: f64 = 2.25;
    let blur = ray.look.sigma_px / ray.across_px().abs();
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few")]
    let half = (1.5 - ray.slope().abs() + TAILS * blur).ceil() as usize;
    half.clamp(2, 12)
}

/// How far across the line pixels are summed \[px\].
pub(super) fn reach_px(ray: &Ray) -> f64 {
    (half(ray) as f64 + 1.5) * ray.across_px().abs()
}

/// Sums the column about the line.
pub(super) fn locate(ray: &Ray, column: &Column) -> Option<Found> {
    let half = half(ray);
    let across_px = ray.across_px();
    #[allow(clippy::cast_possible_truncation, reason = "near the image")]
    let middle = column.crossing_px.round() as isize;
    let index = usize::try_from(middle - column.first).ok()?;
    let from = index.checked_sub(half)?;
    let to = index + half + 1;
    if to > column.count || !column.usable[from..to].iter().all(|usable| *usable) {
        return None;
    }
    let side = if ray.slope() > 0.0 { 1 } else { -1 };
    let reach = half.cast_signed();
    let level = |own: f64, place: isize, sign: isize| {
        let far = ray.value(place, middle + sign * reach)?;
        let near = ray.value(place, middle + sign * (reach - 1))?;
        Some((own + far + near) / 3.0)
    };
    let before = level(column.values[from], column.place + side, -1)?;
    let behind = level(column.values[to - 1], column.place - side, 1)?;
    let step = across_px.signum() * (behind - before);
    let count = (2 * half + 1) as f64;
    let sum: f64 = column.values[from..to].iter().sum();
    let place = (sum - 0.5 * count * (before + behind)) / (before - behind);
    if step <= 0.0 || place.abs() > 1.5 {
        return None;
    }
    let variance = 0.5 * (ray.variances[0] + ray.variances[1]);
    // Pixels of the levels count less or more where the edge is off the middle; one of them is in the sum, too.
    let of_levels: f64 = [0.5 * count + place, 0.5 * count - place]
        .into_iter()
        .map(|weight| (1.0 - weight / 3.0).powi(2) + 2.0 * (weight / 3.0).powi(2))
        .sum();
    let squares = count - 2.0 + of_levels;
    Some(Found {
        offset_px: across_px * (middle as f64 + place - column.crossing_px),
        variance_px2: across_px * across_px * variance * squares / (step * step),
        step,
        step_variance: variance * 2.0 / 3.0,
        blur_px: None,
        shape: Shape::default(),
    })
}

/// What the mean over many stations has of their variance: a level's pixels are in the sums of others.
pub(super) fn kept(ray: &Ray) -> f64 {
    let count = (2 * half(ray) + 1) as f64;
    let share = count / 6.0;
    let of_levels = |own: f64| 2.0 * ((1.0 - share - own).powi(2));
    let alone = count - 2.0 + of_levels(0.0) + 4.0 * share * share;
    (count - 4.0 + of_levels(share) + of_levels(0.0)) / alone
}
