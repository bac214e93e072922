//! Where a straight piece of an edge is, across itself: a blurred step with ramps on both sides, fitted to the
//! pixels about it.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use crate::geometry::ImagePoint;
use crate::junction::normal_cdf;
use crate::refine::light::Light;

/// A piece of an edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    pub middle: ImagePoint,
    /// Unit vector along it.
    pub along: [f64; 2],
    pub length_px: f64,
    /// How far pixels count to each side.
    pub side_px: f64,
}

/// Where it is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Offset {
    /// From where it was supposed, along (-y, x) of its direction.
    pub offset_px: f64,
    /// Of that.
    pub variance_px2: f64,
}

/// Memory of fits: one serves all.
#[derive(Default)]
pub(super) struct SegmentFitter {
    /// Of each pixel: along, across, and the light and weight in each channel.
    pixels: Vec<Pixel>,
}

#[derive(Clone, Copy, Default)]
struct Pixel {
    along: f64,
    across: f64,
    light: [f64; 3],
    weight: [f64; 3],
}

/// Of each channel: on either side a level, a ramp across and one along.
const LINEAR: usize = 6;

/// Steps of the fit; the cuboid's own follow.
const STEPS: usize = 4;

/// Fits of fewer samples, less what is fitted, tell nothing.
const LEAST_DEGREES: f64 = 8.0;

impl SegmentFitter {
    /// Fits a step; `None` where there is none that noise or its surroundings did not make.
    pub fn fit(&mut self, light: &Light, segment: &Segment) -> Option<Offset> {
        self.take(light, segment);
        let channels = light.planes.len();
        let counted: usize = self
            .pixels
            .iter()
            .map(|pixel| pixel.weight[..channels].iter().filter(|weight| **weight > 0.0).count())
            .sum();
        let degrees = counted as f64 - (channels * LINEAR + 2) as f64;
        if degrees < LEAST_DEGREES {
            return None;
        }
        let (mut offset_px, mut sigma_px) = (0.0, 0.8_f64);
        let mut normal = Matrix2::identity();
        let mut excess = 1.0;
        for step in 0..=STEPS {
            let (information, right, chi2) = self.equations(channels, offset_px, sigma_px)?;
            normal = information;
            excess = (chi2 / degrees).max(1.0);
            if step == STEPS {
                break;
            }
            // A step of the width of the blur at most; of the blur itself, to twice or half.
            let damped = normal + Matrix2::new(0.0, 0.0, 0.0, 1e-3 * normal[(1, 1)] + 1e-12);
            let change = damped.try_inverse()? * right;
            offset_px += change.x.clamp(-sigma_px, sigma_px);
            sigma_px = (sigma_px + change.y).clamp(0.6 * sigma_px, 1.6 * sigma_px).clamp(0.3, 3.0);
            if !offset_px.is_finite() || offset_px.abs() > segment.side_px - 0.5 {
                return None;
            }
        }
        let variance_px2 = excess * normal.try_inverse()?[(0, 0)];
        (variance_px2.is_finite() && variance_px2 > 0.0)
            .then_some(Offset { offset_px, variance_px2 })
    }

    /// Takes the pixels within the segment that are in the image and not saturated.
    fn take(&mut self, light: &Light, segment: &Segment) {
        self.pixels.clear();
        let [cosine, sine] = segment.along;
        let reach = (0.5 * segment.length_px).hypot(segment.side_px);
        let (width, height) = (light.exposure.width() as f64, light.exposure.height() as f64);
        let span = |middle: f64, count: f64| {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
            let span = ((middle - reach).ceil().max(0.0) as usize)
                ..((middle + reach + 1.0).floor().clamp(0.0, count) as usize);
            span
        };
        for y in span(segment.middle.y, height) {
            for x in span(segment.middle.x, width) {
                let (dx, dy) = (x as f64 - segment.middle.x, y as f64 - segment.middle.y);
                let (along, across) = (dx * cosine + dy * sine, dy * cosine - dx * sine);
                let is_in = along.abs() <= 0.5 * segment.length_px
                    && across.abs() <= segment.side_px
                    && !light.exposure.saturated().at(x, y);
                if !is_in {
                    continue;
                }
                let mut pixel = Pixel { along, across, ..Pixel::default() };
                for (channel, plane) in light.planes.iter().enumerate() {
                    let value = light.of(plane.at(x, y));
                    pixel.light[channel] = f64::from(value);
                    // What a mosaic lacks is made of samples that count already.
                    if light.exposure.is_measured(channel, x, y) {
                        pixel.weight[channel] = f64::from(light.variance(channel, value)).recip();
                    }
                }
                self.pixels.push(pixel);
            }
        }
    }

    /// Information about offset and blur, levels and ramps unknown, and the gradient; and what is left.
    fn equations(
        &self,
        channels: usize,
        offset_px: f64,
        sigma_px: f64,
    ) -> Option<(Matrix2<f64>, Vector2<f64>, f64)> {
        let (mut information, mut right, mut chi2) = (Matrix2::zeros(), Vector2::zeros(), 0.0);
        for channel in 0..channels {
            let mut normal = SMatrix::<f64, LINEAR, LINEAR>::zeros();
            let mut sums = SVector::<f64, LINEAR>::zeros();
            for pixel in &self.pixels {
                let basis = Basis::of(pixel, offset_px, sigma_px).columns;
                normal.syger(pixel.weight[channel], &basis, &basis, 1.0);
                sums += pixel.weight[channel] * pixel.light[channel] * basis;
            }
            normal.fill_upper_triangle_with_lower_triangle();
            let scale = 1e-9 * normal.trace();
            for i in 0..LINEAR {
                normal[(i, i)] += scale;
            }
            let cholesky = normal.cholesky()?;
            let levels = cholesky.solve(&sums);
            let (mut shape, mut gradient) = (Matrix2::zeros(), Vector2::zeros());
            let mut mixed = SMatrix::<f64, LINEAR, 2>::zeros();
            for pixel in &self.pixels {
                let basis = Basis::of(pixel, offset_px, sigma_px);
                let rest = pixel.light[channel] - basis.columns.dot(&levels);
                let slopes = basis.slopes(&levels);
                let weight = pixel.weight[channel];
                shape += weight * slopes * slopes.transpose();
                gradient += weight * rest * slopes;
                mixed += weight * basis.columns * slopes.transpose();
                chi2 += weight * rest * rest;
            }
            information += shape - mixed.transpose() * cholesky.solve(&mixed);
            right += gradient;
        }
        Some((information, right, chi2))
    }
}

/// What a pixel is made of.
struct Basis {
    columns: SVector<f64, LINEAR>,
    /// The density across, and its argument.
    bell: f64,
    z: f64,
    sigma_px: f64,
    along: f64,
}

impl Basis {
    /// Levels, ramps across and ramps along of what is before the edge, and of what is beyond it. A ramp across is
    /// blurred with its side: d S + sigma phi.
    fn of(pixel: &Pixel, offset_px: f64, sigma_px: f64) -> Self {
        let across = pixel.across - offset_px;
        let z = across / sigma_px;
        let beyond = normal_cdf(z);
        let bell = (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
        let ramp = across * beyond + sigma_px * bell;
        let columns = SVector::from([
            1.0 - beyond,
            beyond,
            across - ramp,
            ramp,
            pixel.along * (1.0 - beyond),
            pixel.along * beyond,
        ]);
        Self { columns, bell, z, sigma_px, along: pixel.along }
    }

    /// Derivatives by the offset and by the blur.
    fn slopes(&self, levels: &SVector<f64, LINEAR>) -> Vector2<f64> {
        let step = levels[1] - levels[0] + self.along * (levels[5] - levels[4]);
        let kink = levels[3] - levels[2];
        // d Phi / d offset = -phi / sigma, d (d Phi + sigma phi) / d offset = -Phi; by sigma -z phi / sigma and phi.
        let beyond = self.columns[1];
        let by_offset = -step * self.bell / self.sigma_px - kink * beyond - levels[2];
        let by_blur = -step * self.z * self.bell / self.sigma_px + kink * self.bell;
        Vector2::new(by_offset, by_blur)
    }
}
