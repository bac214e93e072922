//! Gradients of linear light about a place, and what the noise of pixels makes of a point found by them.

use nalgebra::Matrix2;
use pulp::Simd;

use super::light::{LUMINANCE, Light};
use crate::filter::{Border, ImageRows, Kernel};
use crate::geometry::ImagePoint;
use crate::image::{PixelRange, Plane};
use crate::sensor::Exposure;
use crate::vector::{Lanes, Real};

/// Gaussian derivatives of luminance in a patch, and memory for them: one serves all corners.
pub(super) struct Gradients<'a> {
    pub light: Light<'a>,
    kernels: Kernels,
    /// The pixels whose gradients are known.
    pub range: PixelRange,
    /// Luminance of these and of so many around them as the kernels reach.
    samples: Plane<f32>,
    pub x: Plane<f32>,
    pub y: Plane<f32>,
    /// 0, 1, 2, ... \[px\]
    pub columns: Vec<f32>,
    /// The largest squared gradient.
    pub strongest2: f32,
    /// Variance of a gradient's component by noise alone.
    pub noise2: f64,
    /// What gradients along x, and along y, do to each of two numbers, with zeros around them.
    pulls: [[Plane<f32>; 2]; 2],
    /// What pixels do to these by gradients along x, and along y.
    influences: [[Plane<f32>; 2]; 2],
}

/// A Gaussian and its derivative, and memory to filter by them.
struct Kernels {
    gaussian: Kernel,
    derivative: Kernel,
    /// Rows that are filtered across.
    filtered: Plane<f32>,
}

impl Kernels {
    fn radius(&self) -> usize {
        self.gaussian.radius().max(self.derivative.radius())
    }

    /// The derivative along x, or else along y, of what is inside of a source by the kernels' radius.
    #[inline(always)]
    fn slope<S: Simd>(
        &mut self,
        simd: S,
        source: &Plane<f32>,
        is_along_x: bool,
        out: &mut Plane<f32>,
    ) {
        let radius = self.radius();
        let Self { gaussian, derivative, filtered } = self;
        let (across, along) =
            if is_along_x { (gaussian, derivative) } else { (derivative, gaussian) };
        let (width, height) = (source.width() - 2 * radius, source.height() - 2 * radius);
        out.resize(width, height, 0.0);
        filtered.resize(source.width(), height, 0.0);
        // All rows first: what was just written is slow to read at another place.
        for y in 0..height {
            let rows = ImageRows {
                image: source.view(),
                first: (y + radius - across.radius()).cast_signed(),
                column: 0,
                border: Border::Replicate,
            };
            across.across(simd, &rows, filtered.row_mut(y));
        }
        for y in 0..height {
            along.along(simd, &filtered.row(y)[radius - along.radius()..], out.row_mut(y));
        }
    }
}

impl<'a> Gradients<'a> {
    /// Those of an exposure, at a scale \[px\].
    pub fn new(exposure: &'a Exposure, sigma_d: f64) -> Self {
        Self {
            light: Light::new(exposure),
            kernels: Kernels {
                gaussian: Kernel::gaussian(sigma_d),
                derivative: Kernel::gaussian_derivative(sigma_d),
                filtered: Plane::default(),
            },
            range: PixelRange { x0: 0, y0: 0, x1: 0, y1: 0 },
            samples: Plane::default(),
            x: Plane::default(),
            y: Plane::default(),
            columns: Vec::new(),
            strongest2: 0.0,
            noise2: 0.0,
            pulls: Default::default(),
            influences: Default::default(),
        }
    }

    /// Takes the gradients so far from a point of the image and nearer.
    pub fn take(&mut self, middle: ImagePoint, reach_px: f64) {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in the image")]
        let span = |place: f64, count: usize| {
            let first = (place - reach_px).floor().max(0.0) as usize;
            (first, ((place + reach_px).ceil() as usize + 1).min(count))
        };
        let exposure = self.light.exposure;
        let ((x0, x1), (y0, y1)) =
            (span(middle.x, exposure.width()), span(middle.y, exposure.height()));
        self.range = PixelRange { x0, y0, x1, y1 };
        self.fill();
        pulp::Arch::new().dispatch(Differentiate(self));
        self.columns.clear();
        self.columns.extend((0..self.range.width()).map(|x| x as f32));
        let energy = |kernel: &Kernel| kernel.taps().iter().map(|t| f64::from(t * t)).sum::<f64>();
        let energies = energy(&self.kernels.gaussian) * energy(&self.kernels.derivative);
        #[allow(clippy::cast_possible_truncation, reason = "in the image")]
        let middle = [middle.x.round() as isize, middle.y.round() as isize];
        self.noise2 = f64::from(self.variance(middle)) * energies;
    }

    /// The luminance of the range and around it.
    fn fill(&mut self) {
        let Self { light, range, samples, .. } = self;
        let radius = self.kernels.radius();
        let (width, height) = (range.width() + 2 * radius, range.height() + 2 * radius);
        samples.resize(width, height, 0.0);
        let source = |place: usize, first: usize, count: usize| {
            (first + place).saturating_sub(radius).min(count - 1)
        };
        let (columns, rows) = (light.exposure.width(), light.exposure.height());
        // Columns that are in the image are copied as they are.
        let inside = radius.saturating_sub(range.x0)..(columns + radius - range.x0).min(width);
        let first = source(inside.start, range.x0, columns);
        for y in 0..height {
            let from = source(y, range.y0, rows);
            let row = samples.row_mut(y);
            let out = &mut row[inside.clone()];
            match light.planes {
                [grey] => {
                    let row = &grey.row(from)[first..][..out.len()];
                    out.iter_mut().zip(row).for_each(|(sample, dn)| *sample = light.of(*dn));
                }
                planes => {
                    out.fill(0.0);
                    for (plane, weight) in planes.iter().zip(LUMINANCE) {
                        let row = &plane.row(from)[first..][..out.len()];
                        let pairs = out.iter_mut().zip(row);
                        pairs.for_each(|(sample, dn)| *sample += weight * light.of(*dn));
                    }
                }
            }
            let (left, right) = (row[inside.start], row[inside.end - 1]);
            row[..inside.start].fill(left);
            row[inside.end..].fill(right);
        }
    }

    /// The variance of the luminance of a pixel, of the nearest one beyond the border.
    fn variance(&self, [x, y]: [isize; 2]) -> f32 {
        let of = |channel: usize| {
            let light = self.light.of(self.light.planes[channel].at_replicated(x, y));
            self.light.variance(channel, light)
        };
        match self.light.planes.len() {
            1 => of(0),
            channels => (0..channels).map(|c| LUMINANCE[c] * LUMINANCE[c] * of(c)).sum(),
        }
    }

    /// The covariance of two numbers that depend on the gradients along x and y of each pixel of the range as
    /// `fill` says: `pulls[number][axis]`, the range from so many columns and rows on, zeros around it. The noise of
    /// pixels is independent, that of gradients is not.
    pub fn covariance(
        &mut self,
        fill: impl FnOnce(&Self, usize, &mut [[Plane<f32>; 2]; 2]),
    ) -> Matrix2<f64> {
        let margin = 2 * self.kernels.radius();
        let (width, height) = (self.range.width() + 2 * margin, self.range.height() + 2 * margin);
        let mut pulls = std::mem::take(&mut self.pulls);
        pulls.iter_mut().flatten().for_each(|plane| plane.reset(width, height, 0.0));
        fill(self, margin, &mut pulls);
        self.pulls = pulls;
        let [aa, ab, bb] = pulp::Arch::new().dispatch(Spread(self)).map(f64::from);
        Matrix2::new(aa, ab, ab, bb)
    }

    /// The variances of pixels of the samples from (x, y) on, as many as there are in the row.
    fn fill_variances(&self, [x, y]: [usize; 2], variances: &mut [f32]) {
        let samples = &self.samples.row(y)[x..];
        let is_grey = self.light.planes.len() == 1;
        let beyond = self.kernels.radius().cast_signed();
        for (index, (variance, sample)) in variances.iter_mut().zip(samples).enumerate() {
            let place = [self.range.x0 + x + index, self.range.y0 + y];
            *variance = if is_grey {
                self.light.variance(0, *sample)
            } else {
                self.variance(place.map(|place| place.cast_signed() - beyond))
            };
        }
    }
}

/// No vector holds more samples.
const MOST_LANES: usize = 16;

/// The gradients of a patch: compiled for the machine's vectors.
struct Differentiate<'a, 'b>(&'a mut Gradients<'b>);

impl pulp::WithSimd for Differentiate<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Gradients { kernels, samples, x, y, strongest2, .. } = self.0;
        kernels.slope(simd, samples, true, x);
        kernels.slope(simd, samples, false, y);
        let mut most = Lanes::splat(simd, 0.0);
        let mut first = 0;
        while first < x.samples().len() {
            let gx = Lanes::load_part(simd, x.samples(), first);
            let gy = Lanes::load_part(simd, y.samples(), first);
            most = most.max(gx.mul_add(gx, gy * gy));
            first += S::F32_LANES;
        }
        *strongest2 = most.largest();
    }
}

/// What pixels do to two numbers, by what gradients do to them, and with that sums over pixels: variances times
/// what they do to both; compiled for the machine's vectors.
struct Spread<'a, 'b>(&'a mut Gradients<'b>);

impl pulp::WithSimd for Spread<'_, '_> {
    type Output = [f32; 3];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> [f32; 3] {
        let Gradients { kernels, pulls, influences, .. } = &mut *self.0;
        for (pulls, influences) in pulls.iter().zip(&mut *influences) {
            // The same filters: a derivative's taps seen from the pixel are its negative, which no square minds.
            kernels.slope(simd, &pulls[0], true, &mut influences[0]);
            kernels.slope(simd, &pulls[1], false, &mut influences[1]);
        }
        let gradients = &*self.0;
        let [a, b] = &gradients.influences;
        let mut variances = [0.0; MOST_LANES];
        let mut sums = [Lanes::splat(simd, 0.0); 3];
        for y in 0..a[0].height() {
            let rows = [a[0].row(y), a[1].row(y), b[0].row(y), b[1].row(y)];
            let mut x = 0;
            while x < rows[0].len() {
                let a = Lanes::load_part(simd, rows[0], x) + Lanes::load_part(simd, rows[1], x);
                let b = Lanes::load_part(simd, rows[2], x) + Lanes::load_part(simd, rows[3], x);
                // Most of a square is beyond the window.
                if a.abs().max(b.abs()).largest() > 0.0 {
                    gradients.fill_variances([x, y], &mut variances);
                    let variance = Lanes::load(simd, &variances, 0);
                    let (weighed_a, weighed_b) = (variance * a, variance * b);
                    sums[0] = weighed_a.mul_add(a, sums[0]);
                    sums[1] = weighed_a.mul_add(b, sums[1]);
                    sums[2] = weighed_b.mul_add(b, sums[2]);
                }
                x += S::F32_LANES;
            }
        }
        let [aa, ab, bb] = sums;
        [aa.total(), ab.total(), bb.total()]
    }
}
