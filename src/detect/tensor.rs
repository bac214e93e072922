//! The structure tensor: what most detectors of corners measure.
//!
//! M = W * [Ix^2 IxIy; IxIy Iy^2] = [A C; C B], W a normalised window. Sums in f32. Beside the response
//! only some rows are kept.

mod fused;
mod tiles;

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Channel;
use crate::detect::peaks::{Response, ResponseMemory};
use crate::filter::{Border, Kernel};
use crate::image::{PixelRange, Plane, View};
use crate::sensor::Exposure;
use crate::vector::Real;

/// How the structure tensor is measured: parameters that detectors share.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct StructureTensor {
    /// What is differentiated.
    pub channel: Channel,
    /// The derivative operator.
    pub derivative: Derivative,
    /// Scale of the Gaussian derivative \[px\].
    #[schemars(range(min = 0.5, max = 8.0))]
    pub sigma_d: f64,
    /// What the products are averaged over.
    pub window: Window,
    /// Scale of the Gaussian window \[px\].
    #[schemars(range(min = 0.5, max = 8.0))]
    pub sigma_i: f64,
    /// Half side of the box: 1 is OpenCV's block size 3 \[px\].
    #[schemars(range(min = 1, max = 15))]
    pub box_radius_px: u32,
    /// Samples per pixel, in either direction, on which it is measured: slopes' products hold twice the
    /// image's frequencies.
    #[schemars(range(min = 1, max = 2))]
    pub oversampling: u32,
    /// How the image continues beyond its border, and the products beyond theirs.
    pub border: Border,
}

impl Default for StructureTensor {
    fn default() -> Self {
        Self {
            channel: Channel::Luma,
            derivative: Derivative::Central,
            sigma_d: 1.0,
            window: Window::Gaussian,
            sigma_i: 1.5,
            box_radius_px: 1,
            oversampling: 1,
            border: Border::Replicate,
        }
    }
}

/// What the products of slopes are averaged over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Window {
    /// A Gaussian at `sigma_i`.
    #[default]
    Gaussian,
    /// A square, all of it alike: `2 box_radius_px + 1` wide, `2 box_radius_px + 1/2` with oversampling
    /// 2 \[px\].
    Box,
}

/// How slopes are measured; each gives 1 DN/px on a ramp of 1 DN/px.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Derivative {
    /// (-1, 0, 1) / 2.
    Central,
    /// (-1, 0, 1) / 2 along, (1, 2, 1) / 4 across.
    Sobel,
    /// (-1, 0, 1) / 2 along, (3, 10, 3) / 16 across.
    Scharr,
    /// Derivative of a Gaussian along, the Gaussian across.
    Gaussian,
}

impl Derivative {
    /// Its kernels along and across the direction of the slope; `sigma_d` is the Gaussian's.
    pub fn kernels(self, sigma_d: f64) -> [Kernel; 2] {
        match self {
            Self::Central => [Kernel::central_difference(), Kernel::identity()],
            Self::Sobel => [Kernel::central_difference(), Kernel::binomial()],
            Self::Scharr => [Kernel::central_difference(), Kernel::scharr()],
            Self::Gaussian => [Kernel::gaussian_derivative(sigma_d), Kernel::gaussian(sigma_d)],
        }
    }
}

/// What a detector makes of a tensor.
pub trait Measure: Sync {
    /// The response to the tensor [A C; C B]; A and B may change places.
    fn of<R: Real>(&self, a: R, b: R, c: R) -> R;
}

/// The kernels by which a tensor is measured, and how the image continues.
#[derive(Clone, Debug)]
pub struct TensorKernels {
    /// Along and across a slope.
    pub derivative: [Kernel; 2],
    /// The window, in either direction.
    pub window: Kernel,
    /// How image and products continue.
    pub border: Border,
}

/// Memory that [`TensorKernels::response`] needs; kept from call to call.
#[derive(Debug, Default)]
pub struct TensorBuffers {
    /// Of each block of rows.
    blocks: Vec<BlockMemory>,
}

/// Memory of a block of rows.
#[derive(Debug, Default)]
struct BlockMemory {
    tiles: Vec<f32>,
    sides: fused::SideMemory,
}

/// Pixels from which on an image is worth more than one thread.
pub(super) const MANY_PIXELS: usize = 1 << 20;

impl TensorKernels {
    /// How far from a pixel the samples lie on which its tensor depends \[px\].
    pub fn support(&self) -> usize {
        self.slope_support() + self.window.radius()
    }

    /// How far from a pixel the samples lie on which its slopes depend \[px\].
    fn slope_support(&self) -> usize {
        self.derivative[0].radius().max(self.derivative[1].radius())
    }

    /// A measure of the tensor at every pixel of an image: of the sum of its `planes`' tensors, each
    /// with its weight \[DN\].
    ///
    /// Memory beside input and output: some rows for each block of rows. Large images are done by all
    /// threads of the pool; every response has the same bits on one and on many. With kernels of three
    /// taps an image narrower than 20 columns, or lower than 5 rows, is computed otherwise: a crop so
    /// small may differ from the whole in the last bits.
    ///
    /// # Panics
    /// Of no planes, and of one that has not the response's size: a mistake of the caller's code.
    pub fn response<M: Measure>(
        &self,
        planes: &[(View<'_, f32>, f32)],
        buffers: &mut TensorBuffers,
        measure: &M,
        response: &mut Plane<f32>,
    ) {
        let (width, height) = (response.width(), response.height());
        let fits =
            |(plane, _): &(View<'_, f32>, f32)| (plane.width(), plane.height()) == (width, height);
        assert!(!planes.is_empty() && planes.iter().all(fits), "planes of {width} x {height}");
        if width == 0 || height == 0 {
            return;
        }
        let threads = if width * height < MANY_PIXELS { 1 } else { rayon::current_num_threads() };
        // Some more blocks than threads: none waits long for the slowest. Whole bands each.
        let rows = height.div_ceil(if threads > 1 { 4 * threads } else { 1 });
        let rows = rows.next_multiple_of(fused::BAND);
        buffers.blocks.resize_with(height.div_ceil(rows), BlockMemory::default);
        let block = |index: usize, memory: &mut BlockMemory, out: &mut [f32]| {
            let first = index * rows;
            let block = Block { kernels: self, planes, rows: first..(first + rows).min(height) };
            block.response(memory, measure, out);
        };
        let samples = response.samples_mut();
        if threads == 1 {
            block(0, &mut buffers.blocks[0], samples);
        } else {
            samples
                .par_chunks_mut(rows * width)
                .zip(&mut buffers.blocks)
                .enumerate()
                .for_each(|(index, (out, memory))| block(index, memory, out));
        }
    }
}

/// Rows of a response.
struct Block<'a> {
    kernels: &'a TensorKernels,
    planes: &'a [(View<'a, f32>, f32)],
    rows: std::ops::Range<usize>,
}

impl Block<'_> {
    /// Computes them: in registers where the kernels are of three taps, through tiles elsewhere and
    /// at the image's border.
    fn response<M: Measure>(&self, memory: &mut BlockMemory, measure: &M, out: &mut [f32]) {
        let Self { kernels, planes, rows } = self;
        let (image, _) = planes[0];
        let (width, height) = (image.width(), image.height());
        let all = PixelRange { x0: 0, y0: rows.start, x1: width, y1: rows.end };
        let tiles = |range, memory: &mut Vec<f32>, out: &mut [f32]| {
            tiles::Tiles { kernels, planes, range, first_row: rows.start, memory, out }
                .run(measure);
        };
        let Some(taps) = fused::ThreeTaps::of(kernels).filter(|_| planes.len() == 1) else {
            return tiles(all, &mut memory.tiles, out);
        };
        let inner = fused::inner(all, [width, height]);
        if inner.width() < fused::LEAST_COLUMNS || inner.height() == 0 {
            return tiles(all, &mut memory.tiles, out);
        }
        taps.run(image, inner, rows.start, measure, out);
        for range in [PixelRange { y1: inner.y0, ..all }, PixelRange { y0: inner.y1, ..all }] {
            tiles(range, &mut memory.tiles, out);
        }
        fused::sides(self, inner, memory, measure, out);
    }
}

impl StructureTensor {
    /// Its kernels, on a grid of `oversampling` samples per pixel.
    pub fn kernels(&self) -> TensorKernels {
        let samples = self.oversampling as usize;
        let scale = f64::from(self.oversampling);
        let mut derivative = self.derivative.kernels(scale * self.sigma_d);
        derivative[0] = derivative[0].scaled(scale); // per pixel, not per sample
        TensorKernels {
            derivative,
            window: match self.window {
                Window::Gaussian => Kernel::gaussian(scale * self.sigma_i),
                Window::Box => Kernel::mean(samples * self.box_radius_px as usize),
            },
            border: self.border,
        }
    }

    /// A measure of it as a response.
    pub(crate) fn measured<'a, M: Measure>(&self, measure: &'a M) -> Measured<'a, M> {
        let kernels = self.kernels();
        Measured {
            channel: self.channel,
            oversampling: self.oversampling,
            border: kernels.window.radius(),
            kernels,
            measure,
        }
    }
}

/// A measure of the tensor at every sample of an exposure.
pub(crate) struct Measured<'a, M> {
    pub(super) channel: Channel,
    pub(super) oversampling: u32,
    /// How near to the image's edges no sample is searched, in samples.
    pub(super) border: usize,
    pub(super) kernels: TensorKernels,
    pub(super) measure: &'a M,
}

impl<M: Measure> Response for Measured<'_, M> {
    fn oversampling(&self) -> usize {
        self.oversampling as usize
    }

    fn support(&self) -> usize {
        self.kernels.support()
    }

    fn border(&self) -> usize {
        self.border
    }

    fn respond(
        &self,
        exposure: &Exposure,
        range: PixelRange,
        memory: &mut ResponseMemory,
        response: &mut Plane<f32>,
    ) {
        let ResponseMemory { planes, row, tensor } = memory;
        // Red only until it is overwritten: a view needs something to look at.
        let mut weighted = [(exposure.rgb()[0].view(), 0.0); 3];
        let mut count = 0;
        for (plane, (source, weight)) in
            planes.iter_mut().zip(self.channel.planes(exposure).into_iter().flatten())
        {
            let view = if self.oversampling == 1 {
                source.view().crop(range)
            } else {
                twice(source.view(), self.kernels.border, range, row, plane);
                plane.view()
            };
            weighted[count] = (view, weight);
            count += 1;
        }
        response.resize(range.width(), range.height(), 0.0);
        self.kernels.response(&weighted[..count], tensor, self.measure, response);
    }
}

/// The image on a grid of half the pitch, of which `range` is wanted: sample (2 x, 2 y) is pixel (x, y),
/// those between are interpolated by Lanczos' kernel of eight taps.
fn twice(
    image: View<'_, f32>,
    border: Border,
    range: PixelRange,
    row: &mut Vec<f32>,
    out: &mut Plane<f32>,
) {
    let tap = |k: usize| {
        let x = std::f64::consts::PI * (k as f64 - 3.5);
        x.sin() / x * (0.25 * x).sin() / (0.25 * x)
    };
    let sum: f64 = (0..8).map(tap).sum();
    #[allow(clippy::cast_possible_truncation, reason = "rounds to the nearest")]
    let taps: [f32; 8] = std::array::from_fn(|k| (tap(k) / sum) as f32);
    let neighbour =
        |first: usize, k: usize, count: usize| border.index((first + k).cast_signed() - 3, count);
    out.resize(range.width(), range.height(), 0.0);
    row.resize(image.width(), 0.0);
    for y in range.y0..range.y1 {
        if y % 2 == 0 {
            row.copy_from_slice(image.row(y / 2));
        } else {
            row.fill(0.0);
            for (k, tap) in taps.iter().enumerate() {
                let source = image.row(neighbour(y / 2, k, image.height()));
                row.iter_mut().zip(source).for_each(|(sum, sample)| *sum += tap * sample);
            }
        }
        for (x, sample) in (range.x0..range.x1).zip(out.row_mut(y - range.y0)) {
            *sample = if x % 2 == 0 {
                row[x / 2]
            } else {
                let at = |k: usize| row[neighbour(x / 2, k, image.width())];
                taps.iter().enumerate().map(|(k, tap)| tap * at(k)).sum()
            };
        }
    }
}
