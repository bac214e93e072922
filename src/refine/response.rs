//! The response of the structure tensor about a seed, and its largest sample: what is interpolated.

use crate::detect::Channel;
use crate::detect::harris::Harris;
use crate::detect::peaks::{Response, ResponseMemory};
use crate::detect::tensor::Measured;
use crate::geometry::ImagePoint;
use crate::image::{PixelRange, Plane};
use crate::refine::RefineStatus;
use crate::sensor::Exposure;

/// So many times as strong as noise alone the slopes of both directions must be.
const LEAST_OVER_NOISE: f64 = 3.0;

/// The response about one seed after the other.
pub(super) struct Responses<'a> {
    exposure: &'a Exposure,
    measured: Measured<'a, Harris>,
    /// How far from the seed the largest sample may be, in samples.
    reach: f64,
    /// So many samples around the largest one are wanted.
    margin: usize,
    /// The response of noise with a variance of 1 DN^2, times what counts as more.
    least: f64,
    memory: ResponseMemory,
    samples: Plane<f32>,
    /// The first of the samples that are known, in samples of the image.
    origin: [usize; 2],
}

impl<'a> Responses<'a> {
    /// The responses of an exposure by a detector, its thresholds and radius left out.
    pub(super) fn new(
        exposure: &'a Exposure,
        harris: &'a Harris,
        max_shift_px: f64,
        margin: usize,
    ) -> Self {
        let measured = harris.tensor.measured(harris);
        let pixels = harris
            .tensor
            .kernels()
            .derivative
            .map(|kernel| kernel.taps().iter().map(|tap| f64::from(tap * tap)).sum::<f64>());
        let planes = match harris.tensor.channel {
            Channel::Luma | Channel::Red => 1.0,
            Channel::RedDifference => 1.5,
            Channel::Colour => 3.0,
        };
        let slope2 = LEAST_OVER_NOISE.powi(2) * planes * pixels[0] * pixels[1];
        Self {
            exposure,
            reach: max_shift_px * measured.oversampling() as f64,
            measured,
            margin,
            least: (1.0 - 4.0 * harris.k) * slope2 * slope2,
            memory: ResponseMemory::default(),
            samples: Plane::default(),
            origin: [0; 2],
        }
    }

    /// Finds the largest sample within reach of a seed; returns its place among the known ones.
    ///
    /// # Errors
    /// Out of bounds where the seed or the margin around the sample leaves the image, singular where no
    /// response is more than noise, diverged where a larger one lies beyond the reach.
    pub(super) fn largest(&mut self, seed: ImagePoint) -> Result<[usize; 2], RefineStatus> {
        let size = [self.exposure.width(), self.exposure.height()];
        let is_inside = |place: f64, count: usize| (-0.5..count as f64 - 0.5).contains(&place);
        if !is_inside(seed.x, size[0]) || !is_inside(seed.y, size[1]) {
            return Err(RefineStatus::OutOfBounds);
        }
        let pitch = self.measured.oversampling();
        let size = size.map(|count| (count - 1) * pitch + 1);
        let middle = [seed.x, seed.y].map(|place| place * pitch as f64);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in the image")]
        let span = |axis: usize| {
            let first = (middle[axis] - self.reach).ceil().max(0.0) as usize;
            (first, ((middle[axis] + self.reach).floor() as usize + 1).min(size[axis]))
        };
        let ((x0, x1), (y0, y1)) = (span(0), span(1));
        let searched = PixelRange { x0, y0, x1, y1 };
        let around = self.measured.support() + self.margin;
        let known = searched.grown(around, size[0], size[1]);
        self.measured.respond(self.exposure, known, &mut self.memory, &mut self.samples);
        self.origin = [known.x0, known.y0];

        let mut largest = (0.0, [x0, y0]);
        for y in y0..y1 {
            for x in x0..x1 {
                let sample = self.samples.at(x - known.x0, y - known.y0);
                let far = (x as f64 - middle[0]).hypot(y as f64 - middle[1]);
                if sample > largest.0 && far <= self.reach {
                    largest = (sample, [x, y]);
                }
            }
        }
        let (value, place) = largest;
        if f64::from(value) <= self.least_at(seed) {
            return Err(RefineStatus::Singular);
        }
        let margin = self.margin;
        if [0, 1].into_iter().any(|i| place[i] < margin || place[i] + margin >= size[i]) {
            return Err(RefineStatus::OutOfBounds);
        }
        let place = [place[0] - known.x0, place[1] - known.y0];
        let is_largest = |sample: &f64| *sample <= f64::from(value);
        let is_maximum = self.around(place).as_flattened().iter().all(is_largest);
        if is_maximum { Ok(place) } else { Err(RefineStatus::Diverged) }
    }

    /// What noise alone may have as its response.
    fn least_at(&self, seed: ImagePoint) -> f64 {
        let [x, y] = [seed.x.round().max(0.0), seed.y.round().max(0.0)];
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in the image")]
        let sample_dn = self.exposure.rgb()[1].at(x as usize, y as usize);
        self.least * self.exposure.variance_dn2(1, f64::from(sample_dn)).powi(2)
    }

    /// The known sample at a place, or the nearest one.
    pub(super) fn at(&self, x: isize, y: isize) -> f64 {
        f64::from(self.samples.at_replicated(x, y))
    }

    /// The samples about a place, row by row.
    pub(super) fn around(&self, [x, y]: [usize; 2]) -> [[f64; 3]; 3] {
        let [x, y] = [x.cast_signed() - 1, y.cast_signed() - 1];
        [0, 1, 2].map(|row| [0, 1, 2].map(|column| self.at(x + column, y + row)))
    }

    /// Where a place among the known samples is in the image.
    pub(super) fn point(&self, place: [f64; 2]) -> ImagePoint {
        let pitch = self.measured.oversampling() as f64;
        let [x, y] = [0, 1].map(|axis| (self.origin[axis] as f64 + place[axis]) / pitch);
        ImagePoint::new(x, y)
    }
}
