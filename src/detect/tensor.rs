//! The structure tensor: what most detectors of corners measure.
//!
//! M = W * [Ix^2 IxIy; IxIy Iy^2] = [A C; C B]. Its rows are computed one at a time; those that the
//! window needs are kept in a ring.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::{Detection, Peaks, SearchArea, peaks};
use crate::filter::{Border, Kernel};
use crate::image::Plane;
use crate::sensor::Exposure;
use crate::target::TargetRegion;

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
            border: Border::Replicate,
        }
    }
}

/// What of an exposure is differentiated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    /// The luma.
    #[default]
    Luma,
    /// Red alone.
    Red,
    /// Red less the mean of green and blue: how saturated a red is.
    RedDifference,
    /// Red, green and blue: the sum of their tensors, each weighted by the inverse of its noise's
    /// variance at half of full scale, the weights' mean being 1. Di Zenzo (1986), A note on the
    /// gradient of a multi-image, Computer Vision, Graphics, and Image Processing 33.
    Colour,
}

/// What the products of slopes are averaged over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Window {
    /// A Gaussian at `sigma_i`.
    #[default]
    Gaussian,
    /// A square of `2 box_radius_px + 1`, all of it alike.
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

impl TensorKernels {
    /// How far from a pixel the samples lie on which its tensor depends \[px\].
    pub fn support(&self) -> usize {
        self.derivative[0].radius().max(self.derivative[1].radius()) + self.window.radius()
    }

    /// A measure of the tensor's A, B and C at every pixel of an image, which is the sum of weighted
    /// `planes` of one size \[DN\]. Memory beside input and output: some rows.
    pub fn response(
        &self,
        planes: &[(&Plane<f32>, f32)],
        buffers: &mut TensorBuffers,
        measure: impl Fn(f32, f32, f32) -> f32,
        response: &mut Plane<f32>,
    ) {
        pulp::Arch::new().dispatch(Rows { kernels: self, planes, buffers, measure, response });
    }
}

/// Memory that [`TensorKernels::response`] needs; kept from call to call.
#[derive(Debug, Default)]
pub struct TensorBuffers {
    padded: Vec<f32>,
    slopes: [Vec<f32>; 2],
    rings: [Vec<f32>; 3],
    tensor: [Vec<f32>; 3],
}

/// One response, row by row: compiled for the machine's vectors.
struct Rows<'a, F> {
    kernels: &'a TensorKernels,
    planes: &'a [(&'a Plane<f32>, f32)],
    buffers: &'a mut TensorBuffers,
    measure: F,
    response: &'a mut Plane<f32>,
}

impl<F: Fn(f32, f32, f32) -> f32> pulp::WithSimd for Rows<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { kernels, planes, buffers, measure, response } = self;
        let TensorKernels { derivative: [along, across], window, border } = kernels;
        let (width, height) = (response.width(), response.height());
        if width == 0 || height == 0 {
            return;
        }
        let margin = along.radius().max(across.radius()).max(window.radius());
        let kept = 2 * window.radius() + 1;
        let TensorBuffers { padded, slopes: [ix, iy], rings, tensor } = buffers;
        padded.resize(width + 2 * margin, 0.0);
        ix.resize(width, 0.0);
        iy.resize(width, 0.0);
        for ring in rings.iter_mut() {
            ring.resize(kept * width, 0.0);
        }
        for row in tensor.iter_mut() {
            row.resize(width, 0.0);
        }
        let middle = margin..margin + width;
        let around = |kernel: &Kernel| middle.start - kernel.radius()..middle.end + kernel.radius();
        let mut next = 0; // the first row whose products are not yet smoothed along it
        for y in 0..height {
            while next < height.min(y + window.radius() + 1) {
                let slot = next % kept * width..(next % kept + 1) * width;
                for (index, (plane, weight)) in planes.iter().enumerate() {
                    // The row that tap k of a kernel across weighs.
                    let row = |kernel: &Kernel, k: usize| {
                        let at = (next + k).cast_signed() - kernel.radius().cast_signed();
                        plane.row(border.index(at, height))
                    };
                    across.across(|k| row(across, k), &mut padded[middle.clone()]);
                    border.extend(padded, margin);
                    along.along(&padded[around(along)], ix);
                    along.across(|k| row(along, k), &mut padded[middle.clone()]);
                    border.extend(padded, margin);
                    across.along(&padded[around(across)], iy);
                    for (ring, [p, q]) in
                        rings.iter_mut().zip([[&*ix, &*ix], [&*iy, &*iy], [&*ix, &*iy]])
                    {
                        for ((product, p), q) in padded[middle.clone()].iter_mut().zip(p).zip(q) {
                            *product = weight * p * q;
                        }
                        border.extend(padded, margin);
                        let smoothed = &mut ring[slot.clone()];
                        if index == 0 {
                            window.along(&padded[around(window)], smoothed);
                        } else {
                            // The tensor's own row is free until the window is across.
                            window.along(&padded[around(window)], &mut tensor[0]);
                            for (sum, more) in smoothed.iter_mut().zip(&tensor[0]) {
                                *sum += more;
                            }
                        }
                    }
                }
                next += 1;
            }
            for (ring, row) in rings.iter().zip(tensor.iter_mut()) {
                let smoothed = |k: usize| {
                    let at = (y + k).cast_signed() - window.radius().cast_signed();
                    let slot = border.index(at, height) % kept;
                    &ring[slot * width..(slot + 1) * width]
                };
                window.across(smoothed, row);
            }
            let [a, b, c] = &*tensor;
            for (((r, a), b), c) in response.row_mut(y).iter_mut().zip(a).zip(b).zip(c) {
                *r = measure(*a, *b, *c);
            }
        }
    }
}

impl StructureTensor {
    /// Its kernels.
    pub fn kernels(&self) -> TensorKernels {
        TensorKernels {
            derivative: self.derivative.kernels(self.sigma_d),
            window: match self.window {
                Window::Gaussian => Kernel::gaussian(self.sigma_i),
                Window::Box => Kernel::mean(self.box_radius_px as usize),
            },
            border: self.border,
        }
    }

    /// The peaks of a measure of the tensor's A, B and C, strongest first: no nearer to the image's
    /// border than the window reaches.
    pub(super) fn detect(
        &self,
        exposure: &Exposure,
        region: Option<&TargetRegion>,
        rule: &Peaks,
        measure: impl Fn(f32, f32, f32) -> f32,
    ) -> Vec<Detection> {
        let kernels = self.kernels();
        let size = [exposure.width(), exposure.height()];
        let area = SearchArea::new(size, kernels.window.radius(), region, rule.margin_px);
        if area.range.width() == 0 || area.range.height() == 0 {
            return Vec::new();
        }
        let reach = rule.nms_radius_px as usize + kernels.support();
        let crop = area.range.grown(reach, size[0], size[1]);
        let planes = self.channel.planes(exposure);
        let cropped: Vec<(Plane<f32>, f32)> =
            planes.iter().map(|(plane, weight)| (plane.crop(crop), *weight)).collect();
        let weighted: Vec<(&Plane<f32>, f32)> =
            cropped.iter().map(|(plane, weight)| (plane, *weight)).collect();
        let mut response = Plane::filled(crop.width(), crop.height(), 0.0);
        kernels.response(&weighted, &mut TensorBuffers::default(), measure, &mut response);
        peaks(&response, [crop.x0, crop.y0], &area, rule)
    }
}

impl Channel {
    /// The planes that are differentiated, and their tensors' weights.
    fn planes(self, exposure: &Exposure) -> Vec<(std::borrow::Cow<'_, Plane<f32>>, f32)> {
        use std::borrow::Cow;
        let [red, green, blue] = exposure.rgb();
        match self {
            Self::Luma => vec![(Cow::Borrowed(exposure.luma()), 1.0)],
            Self::Red => vec![(Cow::Borrowed(red), 1.0)],
            Self::RedDifference => {
                let samples = red
                    .samples()
                    .iter()
                    .zip(green.samples())
                    .zip(blue.samples())
                    .map(|((red, green), blue)| red - 0.5 * (green + blue))
                    .collect();
                let plane = Plane::from_samples(red.width(), red.height(), samples);
                vec![(Cow::Owned(plane), 1.0)]
            }
            Self::Colour => {
                let half = 0.5 * exposure.encoding().full_scale_dn();
                let certainty = [0, 1, 2].map(|c| 1.0 / exposure.variance_dn2(c, half));
                let mean = certainty.iter().sum::<f64>() / 3.0;
                #[allow(clippy::cast_possible_truncation, reason = "some size near 1")]
                let weight = certainty.map(|value| (value / mean) as f32);
                [red, green, blue].map(Cow::Borrowed).into_iter().zip(weight).collect()
            }
        }
    }
}
