//! Samples about a place in linear light, weighted by the camera's noise.

use crate::geometry::ImagePoint;
use crate::junction::fit::Samples;
use crate::junction::rays::Places;
use crate::refine::light::Light;
use crate::sensor::Exposure;

/// Takes patches from one exposure.
pub struct Patches<'a> {
    /// The exposure's light.
    pub light: Light<'a>,
    /// Pixels from the middle, right and down, such as are near each other after each other.
    order: Vec<[i16; 2]>,
    /// Those that count: their places in the square.
    chosen: Vec<usize>,
    /// The side of the largest square so far.
    ordered_side: usize,
    /// Of the square, row by row: light, and its means over three by three.
    square: Vec<f32>,
    means: Vec<f32>,
    /// Of three of its rows the sums.
    sums: Vec<f32>,
}

impl<'a> Patches<'a> {
    /// Those of an exposure.
    pub fn new(exposure: &'a Exposure) -> Self {
        Self {
            light: Light::new(exposure),
            order: Vec::new(),
            chosen: Vec::new(),
            ordered_side: 0,
            square: Vec::new(),
            means: Vec::new(),
            sums: Vec::new(),
        }
    }

    /// Takes the pixels of the image so far from a point and nearer, less saturated ones; places are relative
    /// to the pixel that the point lies in, which is returned. `None` where that is less than half of them.
    pub fn take(
        &mut self,
        middle: ImagePoint,
        radius_px: f64,
        samples: &mut Samples,
    ) -> Option<[f64; 2]> {
        let centre = [middle.x.round(), middle.y.round()];
        #[allow(clippy::cast_possible_truncation, reason = "in the image, or declined below")]
        let pixel = centre.map(|value| value as isize);
        samples.radius_px = radius_px;
        samples.channel_count = self.light.planes.len();
        let from_centre = [middle.x - centre[0], middle.y - centre[1]];
        self.choose(pixel, from_centre, samples)?;
        for channel in 0..samples.channel_count {
            self.fill(pixel, channel, samples);
        }
        Some(centre)
    }

    /// The pixels that count.
    fn choose(
        &mut self,
        [x0, y0]: [isize; 2],
        from_centre: [f64; 2],
        samples: &mut Samples,
    ) -> Option<()> {
        let Self { light, order, chosen, ordered_side, .. } = self;
        let side = side(samples);
        if *ordered_side < side {
            fill_order(order, side);
            *ordered_side = side;
        }
        let reach = (side / 2).cast_signed();
        let saturated = light.exposure.saturated();
        let (width, height) = (saturated.width().cast_signed(), saturated.height().cast_signed());
        let Samples { places, radius_px, .. } = samples;
        places.x.clear();
        places.y.clear();
        chosen.clear();
        let mut all = 0;
        for &[right, down] in &*order {
            let (dx, dy) = (f64::from(right) - from_centre[0], f64::from(down) - from_centre[1]);
            if dx * dx + dy * dy > *radius_px * *radius_px {
                continue;
            }
            all += 1;
            let (right, down) = (isize::from(right), isize::from(down));
            let (x, y) = (x0 + right, y0 + down);
            let is_inside = (0..width).contains(&x) && (0..height).contains(&y);
            if is_inside && !saturated.at(x.cast_unsigned(), y.cast_unsigned()) {
                places.x.push(right as f32);
                places.y.push(down as f32);
                chosen
                    .push((down + reach).cast_unsigned() * side + (right + reach).cast_unsigned());
            }
        }
        places.pad();
        (2 * chosen.len() > all).then_some(())
    }

    /// Samples and weights of a channel.
    fn fill(&mut self, [x0, y0]: [isize; 2], channel: usize, samples: &mut Samples) {
        let Self { light, chosen, square, means, sums, .. } = self;
        let side = side(samples);
        let reach = (side / 2).cast_signed();
        let plane = &light.planes[channel];
        square.clear();
        let columns = x0 - reach..=x0 + reach;
        for y in y0 - reach..=y0 + reach {
            let row = plane.row(y.clamp(0, plane.height().cast_signed() - 1).cast_unsigned());
            let last = row.len().cast_signed() - 1;
            if x0 >= reach && x0 + reach <= last {
                let inside = &row[(x0 - reach).unsigned_abs()..][..side];
                square.extend(inside.iter().map(|sample| light.of(*sample)));
            } else {
                let replicated = |x: isize| light.of(row[x.clamp(0, last).cast_unsigned()]);
                square.extend(columns.clone().map(replicated));
            }
        }
        smooth(square, side, sums, means);

        let Samples { places: Places { x, y }, channels, .. } = samples;
        let of_channel = &mut channels[channel];
        of_channel.samples.clear();
        of_channel.samples.extend(chosen.iter().map(|index| square[*index]));
        of_channel.weights.clear();
        of_channel.weights.extend(chosen.iter().map(|index| light.weight(channel, means[*index])));
        if light.exposure.has_mosaic() {
            // What a mosaic lacks is made of samples that count already.
            for (weight, (x, y)) in of_channel.weights.iter_mut().zip(x.iter().zip(&*y)) {
                #[allow(clippy::cast_possible_truncation, reason = "whole numbers")]
                let (x, y) = (x0 + *x as isize, y0 + *y as isize);
                if !light.exposure.is_measured(channel, x.cast_unsigned(), y.cast_unsigned()) {
                    *weight = 0.0;
                }
            }
        }
        // Those that fill the last vector do not count.
        of_channel.samples.resize(x.len(), 0.0);
        of_channel.weights.resize(x.len(), 0.0);
    }
}

/// The side of the square that holds all of a window's pixels.
fn side(samples: &Samples) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "tens of pixels")]
    let reach = samples.radius_px.ceil() as usize;
    2 * reach + 1
}

/// The pixels that may be near enough, along Morton's curve.
fn fill_order(order: &mut Vec<[i16; 2]>, side: usize) {
    let spread = |value: usize| (0..16).fold(0, |sum, bit| sum | ((value >> bit) & 1) << (2 * bit));
    let mut places: Vec<[usize; 2]> =
        (0..side).flat_map(|y| (0..side).map(move |x| [x, y])).collect();
    places.sort_unstable_by_key(|&[x, y]| spread(x) | (spread(y) << 1));
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        reason = "tens of pixels"
    )]
    let from_middle = |place: [usize; 2]| place.map(|at| at as i16 - (side / 2) as i16);
    // The middle is at most half a pixel from a pixel's own, along each axis.
    let most = (side / 2) as f64 + std::f64::consts::FRAC_1_SQRT_2;
    let is_near = |pixel: &[i16; 2]| f64::from(pixel[0]).hypot(f64::from(pixel[1])) <= most;
    order.clear();
    order.extend(places.into_iter().map(from_middle).filter(is_near));
}

/// Means over three by three, so that a sample's weight hardly knows its noise.
fn smooth(square: &[f32], side: usize, sums: &mut Vec<f32>, means: &mut Vec<f32>) {
    means.clear();
    for row in 0..side {
        let (above, below) = (row.saturating_sub(1), (row + 1).min(side - 1));
        sums.clear();
        sums.extend_from_slice(&square[above * side..][..side]);
        for other in above + 1..=below {
            let row = &square[other * side..][..side];
            sums.iter_mut().zip(row).for_each(|(sum, sample)| *sum += sample);
        }
        let rows = (below - above + 1) as f32;
        let share = 1.0 / (3.0 * rows);
        means.push((sums[0] + sums[1]) / (2.0 * rows));
        means.extend(sums.windows(3).map(|three| (three[0] + three[1] + three[2]) * share));
        means.push((sums[side - 2] + sums[side - 1]) / (2.0 * rows));
    }
}
