//! A straight line through edges, some of which may be wrong.

use nalgebra::{Matrix2, Vector2};

use super::ray::{Edgel, Followed};
use crate::refine::edges::Line;

/// Stations that a line needs at least.
const LEAST: usize = 4;

/// The line through what was found about another one: least squares by the stations' variances, those off by more
/// than two deviations with less weight (Huber 1964). The covariance is that of noise, larger where surely more
/// than noise is left. `None` of few stations.
pub(super) fn through(
    about: &Line,
    edgels: &[Edgel],
    followed: &Followed,
    residuals: &mut Vec<f64>,
) -> Option<Line> {
    const ROUNDS: u32 = 6;
    const HUBER: f64 = 2.0;
    const SURELY: f64 = 4.0;
    if edgels.len() < LEAST {
        return None;
    }
    let off = |edgel: &Edgel, line: &Vector2<f64>| {
        (edgel.offset_px - line.x - line.y * edgel.along_px) / edgel.variance_px2.sqrt()
    };
    let mut line = Vector2::zeros();
    let mut inverse = Matrix2::zeros();
    let mut scale = f64::INFINITY;
    let mut left = 0.0;
    let mut shaped = Matrix2::zeros();
    for _ in 0..ROUNDS {
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        let mut moved = Matrix2::zeros();
        for edgel in edgels {
            let share = (HUBER * scale / off(edgel, &line).abs()).min(1.0);
            let place = Vector2::new(1.0, edgel.along_px);
            let weight = share / edgel.variance_px2;
            normal += weight * place * place.transpose();
            right += weight * edgel.offset_px * place;
            moved += weight * place * edgel.moves_px.transpose();
        }
        inverse = normal.try_inverse()?;
        line = inverse * right;
        shaped = inverse * moved;
        residuals.clear();
        residuals.extend(edgels.iter().map(|edgel| off(edgel, &line).abs()));
        residuals.sort_by(f64::total_cmp);
        // Of a normal distribution half are nearer than 0.6745 deviations.
        scale = (residuals[residuals.len() / 2] / 0.6745).max(1.0);
        left = residuals.iter().map(|off| off * off * (HUBER * scale / off).min(1.0)).sum();
    }
    let degrees = (edgels.len() - 2) as f64;
    let excess = left / degrees;
    let excess = if excess > 1.0 + SURELY * (2.0 / degrees).sqrt() { excess } else { 1.0 };
    Some(Line {
        origin: about.origin + line.x * about.normal(),
        angle_rad: about.angle_rad + line.y.atan(),
        covariance: excess * followed.kept * inverse + shaped * followed.shape * shaped.transpose(),
    })
    .filter(|line| line.angle_rad.is_finite() && line.origin.iter().all(|place| place.is_finite()))
}
