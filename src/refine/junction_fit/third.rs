//! Where a third ray may be: the angle at which a sector falls into two that differ most.

use super::Placed;
use crate::junction::fit::Samples;
use crate::junction::rays::Rays;

const BINS: usize = 48;

/// Sums over pixels by their angle about a vertex.
#[derive(Clone, Debug, Default)]
pub(super) struct Ring {
    /// Of the samples over their deviation, in each channel.
    sums: [Vec<f64>; 3],
    /// Pixels whose sample counts, in each channel.
    counts: [Vec<f64>; 3],
}

/// The rays with a third one; `None` where no sector is wide enough for it.
pub(super) fn with_third(two: &Placed, samples: &Samples, ring: &mut Ring) -> Option<Rays> {
    const LEAST_BINS: usize = 3;
    const TURN: f64 = std::f64::consts::TAU;
    let rays = &two.fit.rays;
    ring.fill(rays, samples);
    let bin = |angle: f64| {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a bin")]
        let bin = (angle.rem_euclid(TURN) / TURN * BINS as f64) as usize;
        bin.min(BINS - 1)
    };
    let mut best = (0.0, None);
    for ray in 0..rays.count {
        let from = bin(rays.angles_rad[ray]) + 1;
        let to = bin(rays.angles_rad[rays.next(ray)]);
        // Bins that lie wholly within the sector.
        let count = (to + BINS - from % BINS) % BINS;
        for split in LEAST_BINS..count.saturating_sub(LEAST_BINS) {
            let [a, b] = [(from, split), (from + split, count - split)]
                .map(|(first, count)| ring.over(first, count));
            let gain: f64 = (0..3).map(|channel| gain(a[channel], b[channel])).sum();
            if gain > best.0 {
                best = (gain, Some(TURN * ((from + split) % BINS) as f64 / BINS as f64));
            }
        }
    }
    Some(two.rays_in_image().with(best.1?))
}

/// How much less is left where two parts, pixels and sums, have a mean each.
fn gain(a: (f64, f64), b: (f64, f64)) -> f64 {
    const LEAST_PIXELS: f64 = 4.0;
    if a.0 < LEAST_PIXELS || b.0 < LEAST_PIXELS {
        return 0.0;
    }
    (a.1 / a.0 - b.1 / b.0).powi(2) * a.0 * b.0 / (a.0 + b.0)
}

impl Ring {
    fn fill(&mut self, rays: &Rays, samples: &Samples) {
        for values in self.counts.iter_mut().chain(&mut self.sums) {
            values.clear();
            values.resize(BINS, 0.0);
        }
        let least_px = 2.5 * rays.sigma_px;
        for (index, (x, y)) in samples.places.x.iter().zip(&samples.places.y).enumerate() {
            let dx = f64::from(*x) - rays.vertex[0];
            let dy = f64::from(*y) - rays.vertex[1];
            if dx.hypot(dy) < least_px {
                continue;
            }
            let share = dy.atan2(dx).rem_euclid(std::f64::consts::TAU) / std::f64::consts::TAU;
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a bin")]
            let bin = ((share * BINS as f64) as usize).min(BINS - 1);
            let channels = &samples.channels[..samples.channel_count];
            for ((sums, counts), channel) in
                self.sums.iter_mut().zip(&mut self.counts).zip(channels)
            {
                let weight = channel.weights[index];
                if weight > 0.0 {
                    counts[bin] += 1.0;
                    sums[bin] += f64::from(channel.samples[index] * weight);
                }
            }
        }
    }

    /// Pixels and sums of some bins, in each channel.
    fn over(&self, first: usize, count: usize) -> [(f64, f64); 3] {
        let mut totals = [(0.0, 0.0); 3];
        for bin in (first..first + count).map(|bin| bin % BINS) {
            for ((total, counts), sums) in totals.iter_mut().zip(&self.counts).zip(&self.sums) {
                total.0 += counts[bin];
                total.1 += sums[bin];
            }
        }
        totals
    }
}
