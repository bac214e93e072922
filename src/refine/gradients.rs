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
    /// What gradients along x and y do to one coordinate of a point, with zeros around them.
    pulls: [Plane<f32>; 2],
    /// What pixels do to its two coordinates.
    influences: [Plane<f32>; 2],
}

/// A Gaussian and its derivative, and memory to filter by them.
struct Kernels {
    gaussian: Kernel,
    derivative: Kernel,
    row: Vec<f32>,
    other: Vec<f32>,
}

impl Kernels {
    fn radius(&self) -> usize {
        self.gaussian.radius().max(self.derivative.radius())
    }

    /// The derivative along x, or else along y, of row `y` of what is inside of a source by the kernels' radius.
    #[inline(always)]
    fn slope<S: Simd>(
        &mut self,
        simd: S,
        source: &Plane<f32>,
        y: usize,
        is_along_x: bool,
        out: &mut [f32],
    ) {
        let radius = self.radius();
        let Self { gaussian, derivative, row, .. } = self;
        let (across, along) =
            if is_along_x { (gaussian, derivative) } else { (derivative, gaussian) };
        let rows = ImageRows {
            image: source.view(),
            first: (y + radius - across.radius()).cast_signed(),
            column: 0,
            border: Border::Replicate,
        };
        row.resize(source.width(), 0.0);
        across.across(simd, &rows, row);
        along.along(simd, &row[radius - along.radius()..], out);
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
                row: Vec::new(),
                other: Vec::new(),
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

    /// The covariance of a point that depends on the gradients along x and y of each pixel of the range by these
    /// amounts: `pull(coordinate, y, row along x, row along y)` fills a row \[px for each unit of light/px\].
    /// The noise of pixels is independent, that of gradients is not.
    pub fn covariance_px2(
        &mut self,
        mut pull: impl FnMut(&Self, usize, usize, [&mut [f32]; 2]),
    ) -> Matrix2<f64> {
        let radius = self.kernels.radius();
        let (width, height) = (self.range.width(), self.range.height());
        for coordinate in 0..2 {
            let mut pulls = std::mem::take(&mut self.pulls);
            for plane in &mut pulls {
                plane.reset(width + 4 * radius, height + 4 * radius, 0.0);
            }
            let [along_x, along_y] = &mut pulls;
            let columns = 2 * radius..2 * radius + width;
            for y in 0..height {
                let row_x = &mut along_x.row_mut(y + 2 * radius)[columns.clone()];
                let row_y = &mut along_y.row_mut(y + 2 * radius)[columns.clone()];
                pull(self, coordinate, y, [row_x, row_y]);
            }
            self.pulls = pulls;
            pulp::Arch::new().dispatch(Spread(self, coordinate));
        }
        let [along_x, along_y] = &self.influences;
        let is_grey = self.light.planes.len() == 1;
        let mut sums = [0.0; 3];
        for y in 0..along_x.height() {
            let rows = along_x.row(y).iter().zip(along_y.row(y)).zip(self.samples.row(y));
            let mut of_row = [0.0; 3];
            for (x, ((&a, &b), &sample)) in rows.enumerate() {
                // Most of a square is beyond the window.
                if a == 0.0 && b == 0.0 {
                    continue;
                }
                let variance = if is_grey {
                    self.light.variance(0, sample)
                } else {
                    self.variance(
                        [x + self.range.x0, y + self.range.y0]
                            .map(|place| place.cast_signed() - radius.cast_signed()),
                    )
                };
                of_row[0] += variance * a * a;
                of_row[1] += variance * a * b;
                of_row[2] += variance * b * b;
            }
            for (sum, of_row) in sums.iter_mut().zip(of_row) {
                *sum += f64::from(of_row);
            }
        }
        let [xx, xy, yy] = sums;
        Matrix2::new(xx, xy, xy, yy)
    }
}

/// The gradients of a patch: compiled for the machine's vectors.
struct Differentiate<'a, 'b>(&'a mut Gradients<'b>);

impl pulp::WithSimd for Differentiate<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Gradients { kernels, range, samples, x, y, strongest2, .. } = self.0;
        let (width, height) = (range.width(), range.height());
        x.resize(width, height, 0.0);
        y.resize(width, height, 0.0);
        for row in 0..height {
            kernels.slope(simd, samples, row, true, x.row_mut(row));
            kernels.slope(simd, samples, row, false, y.row_mut(row));
        }
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

/// What pixels do to a coordinate, by what gradients do to it: compiled for the machine's vectors.
struct Spread<'a, 'b>(&'a mut Gradients<'b>, usize);

impl pulp::WithSimd for Spread<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self(gradients, coordinate) = self;
        let Gradients { kernels, pulls: [along_x, along_y], influences, .. } = gradients;
        let influence = &mut influences[coordinate];
        let reach = 2 * kernels.radius();
        influence.resize(along_x.width() - reach, along_x.height() - reach, 0.0);
        let mut other = std::mem::take(&mut kernels.other);
        other.resize(influence.width(), 0.0);
        // The same filters: a derivative's taps seen from the pixel are its negative, which no square minds.
        for y in 0..influence.height() {
            let out = influence.row_mut(y);
            kernels.slope(simd, along_x, y, true, out);
            kernels.slope(simd, along_y, y, false, &mut other);
            out.iter_mut().zip(&other).for_each(|(sum, more)| *sum += more);
        }
        kernels.other = other;
    }
}
