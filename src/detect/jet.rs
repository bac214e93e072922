//! Derivatives of the image at one scale: what detectors of curvature measure.

use pulp::Simd;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::Channel;
use crate::detect::peaks::{Response, ResponseMemory};
use crate::filter::{Border, ImageRows, Kernel, grown};
use crate::image::{PixelRange, Plane, View};
use crate::sensor::Exposure;
use crate::vector::{Lanes, Real};

/// How derivatives are measured: parameters that detectors share.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Jet {
    /// What is differentiated. Of colour the measures of red, green and blue are added up, weighted as
    /// the structure tensor's are.
    pub channel: Channel,
    /// Scale of the Gaussian derivatives \[px\].
    #[schemars(range(min = 0.5, max = 8.0))]
    pub sigma_d: f64,
    /// How the image continues beyond its border.
    pub border: Border,
}

impl Default for Jet {
    fn default() -> Self {
        Self { channel: Channel::Luma, sigma_d: 1.5, border: Border::Replicate }
    }
}

/// Derivatives at a pixel \[DN/px, DN/px^2\].
#[derive(Clone, Copy, Debug)]
pub struct Derivatives<R> {
    /// In x.
    pub x: R,
    /// In y.
    pub y: R,
    /// Twice in x.
    pub xx: R,
    /// In x and y.
    pub xy: R,
    /// Twice in y.
    pub yy: R,
}

/// What a detector makes of derivatives.
pub trait MeasureJet: Sync {
    /// The response to them.
    fn of<R: Real>(&self, derivatives: Derivatives<R>) -> R;
}

impl Jet {
    /// A measure of it as a response.
    pub(super) fn measured<'a, M: MeasureJet>(&'a self, measure: &'a M) -> MeasuredJet<'a, M> {
        let kernels = [
            Kernel::gaussian(self.sigma_d),
            Kernel::gaussian_derivative(self.sigma_d),
            Kernel::gaussian_second_derivative(self.sigma_d),
        ];
        MeasuredJet { jet: self, kernels, measure }
    }
}

/// A measure of the derivatives at every pixel.
pub(super) struct MeasuredJet<'a, M> {
    jet: &'a Jet,
    /// The Gaussian and its derivatives.
    kernels: [Kernel; 3],
    measure: &'a M,
}

impl<M: MeasureJet> Response for MeasuredJet<'_, M> {
    fn support(&self) -> usize {
        self.kernels[0].radius()
    }

    fn respond(
        &self,
        exposure: &Exposure,
        range: PixelRange,
        memory: &mut ResponseMemory,
        response: &mut Plane<f32>,
    ) {
        response.resize(range.width(), range.height(), 0.0);
        let planes = self.jet.channel.planes(exposure).into_iter().flatten();
        for (index, (plane, weight)) in planes.enumerate() {
            pulp::Arch::new().dispatch(Rows {
                measured: self,
                image: plane.view().crop(range),
                weight,
                add: index > 0,
                memory: &mut memory.row,
                response: &mut *response,
            });
        }
    }
}

/// One plane's response, row by row: compiled for the machine's vectors.
struct Rows<'a, M> {
    measured: &'a MeasuredJet<'a, M>,
    image: View<'a, f32>,
    weight: f32,
    add: bool,
    memory: &'a mut Vec<f32>,
    response: &'a mut Plane<f32>,
}

impl<M: MeasureJet> pulp::WithSimd for Rows<'_, M> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { measured, image, weight, add, memory, response } = self;
        let MeasuredJet { jet: Jet { border, .. }, kernels, measure } = measured;
        let (width, radius) = (image.width(), kernels[0].radius());
        if width == 0 || image.height() == 0 {
            return;
        }
        // Of each kernel across, with a margin; of each derivative, in whole vectors.
        let pitch = width + 2 * radius + S::F32_LANES;
        memory.resize(8 * pitch, 0.0);
        let (across, along) = memory.split_at_mut(3 * pitch);
        let have = 0..width.cast_signed();
        let wanted = grown(&have, radius);
        let weight = Lanes::splat(simd, weight);
        for y in 0..image.height() {
            let first = y.cast_signed() - radius.cast_signed();
            let rows = ImageRows { image, first, column: 0, border: *border };
            for (kernel, row) in kernels.iter().zip(across.chunks_mut(pitch)) {
                kernel.across(simd, &rows, &mut row[radius..radius + width]);
                border.extend(row, &have, &wanted, width);
            }
            // Which kernel along which row gives which derivative.
            for ((order_x, order_y), derivative) in
                [(1, 0), (0, 1), (2, 0), (1, 1), (0, 2)].into_iter().zip(along.chunks_mut(pitch))
            {
                let row = &across[order_y * pitch..(order_y + 1) * pitch];
                kernels[order_x].along(simd, row, &mut derivative[..width]);
            }
            let out = response.row_mut(y);
            for x in (0..width).step_by(S::F32_LANES) {
                let at = |index: usize| index * pitch + x;
                let derivatives = Derivatives {
                    x: Lanes::load(simd, along, at(0)),
                    y: Lanes::load(simd, along, at(1)),
                    xx: Lanes::load(simd, along, at(2)),
                    xy: Lanes::load(simd, along, at(3)),
                    yy: Lanes::load(simd, along, at(4)),
                };
                let mut measured = weight * measure.of(derivatives);
                if add {
                    measured = measured + Lanes::load_part(simd, out, x);
                }
                measured.store_part(out, x);
            }
        }
    }
}
