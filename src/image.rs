//! Planes of samples: row-major, with an explicit border rule and interpolation.

use crate::geometry::ImagePoint;

/// A row-major plane of samples; sample (x, y) is the value at [`ImagePoint`] (x, y).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plane<T> {
    width: usize,
    height: usize,
    samples: Vec<T>,
}

impl<T: Copy> Plane<T> {
    /// A plane of one value.
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, samples: vec![value; width * height] }
    }

    /// A plane of row-major samples.
    ///
    /// # Panics
    /// When `samples` does not hold `width * height` values: a mistake of the caller's code.
    pub fn from_samples(width: usize, height: usize, samples: Vec<T>) -> Self {
        assert_eq!(samples.len(), width * height, "samples of a {width} x {height} plane");
        Self { width, height, samples }
    }

    /// A plane whose sample at (x, y) is `value(x, y)`.
    pub fn from_fn(width: usize, height: usize, mut value: impl FnMut(usize, usize) -> T) -> Self {
        let mut samples = Vec::with_capacity(width * height);
        for y in 0..height {
            samples.extend((0..width).map(|x| value(x, y)));
        }
        Self { width, height, samples }
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All samples, row by row.
    pub fn samples(&self) -> &[T] {
        &self.samples
    }

    /// All samples, row by row, for writing.
    pub fn samples_mut(&mut self) -> &mut [T] {
        &mut self.samples
    }

    /// One row.
    pub fn row(&self, y: usize) -> &[T] {
        &self.samples[y * self.width..(y + 1) * self.width]
    }

    /// One row, for writing.
    pub fn row_mut(&mut self, y: usize) -> &mut [T] {
        &mut self.samples[y * self.width..(y + 1) * self.width]
    }

    /// The sample at (x, y).
    pub fn at(&self, x: usize, y: usize) -> T {
        self.samples[y * self.width + x]
    }

    /// The sample at (x, y), the border pixels continued outwards.
    pub fn at_replicated(&self, x: isize, y: isize) -> T {
        let x = x.clamp(0, self.width.cast_signed() - 1).cast_unsigned();
        let y = y.clamp(0, self.height.cast_signed() - 1).cast_unsigned();
        self.at(x, y)
    }

    /// Makes it a plane of one value of another size; its memory is used again.
    pub fn reset(&mut self, width: usize, height: usize, value: T) {
        self.samples.clear();
        self.samples.resize(width * height, value);
        (self.width, self.height) = (width, height);
    }

    /// Makes it a plane of another size whose samples are anything; its memory is used again.
    pub fn resize(&mut self, width: usize, height: usize, any: T) {
        self.samples.resize(width * height, any);
        (self.width, self.height) = (width, height);
    }

    /// All of it, without a copy.
    pub fn view(&self) -> View<'_, T> {
        View { samples: &self.samples, width: self.width, height: self.height, stride: self.width }
    }

    /// The plane of `f` of every sample.
    pub fn map<U>(&self, f: impl FnMut(T) -> U) -> Plane<U> {
        Plane {
            width: self.width,
            height: self.height,
            samples: self.samples.iter().copied().map(f).collect(),
        }
    }

    /// The sub-plane of `window`, which must lie inside.
    pub fn crop(&self, window: PixelRange) -> Self {
        let mut samples = Vec::with_capacity(window.width() * window.height());
        for y in window.y0..window.y1 {
            samples.extend_from_slice(&self.row(y)[window.x0..window.x1]);
        }
        Self { width: window.width(), height: window.height(), samples }
    }
}

/// A part of a plane, or of somebody else's memory: rows that lie `stride` samples apart.
#[derive(Clone, Copy, Debug)]
pub struct View<'a, T> {
    samples: &'a [T],
    width: usize,
    height: usize,
    stride: usize,
}

impl<'a, T> View<'a, T> {
    /// Rows of `width` of the `samples`, each `stride` after the one above it.
    ///
    /// # Panics
    /// When the rows overlap or reach beyond the samples: a mistake of the caller's code.
    pub fn new(samples: &'a [T], [width, height]: [usize; 2], stride: usize) -> Self {
        assert!(stride >= width, "rows of {width} samples, {stride} apart");
        let end = if height > 0 { (height - 1) * stride + width } else { 0 };
        assert!(samples.len() >= end, "{} samples are fewer than {end}", samples.len());
        Self { samples, width, height, stride }
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// One row.
    #[inline]
    pub fn row(&self, y: usize) -> &'a [T] {
        &self.samples[y * self.stride..][..self.width]
    }

    /// The part within `window`, which must lie inside.
    #[must_use]
    pub fn crop(&self, window: PixelRange) -> Self {
        let first = (window.y0 * self.stride + window.x0).min(self.samples.len());
        Self::new(&self.samples[first..], [window.width(), window.height()], self.stride)
    }
}

impl Plane<f32> {
    /// Bilinear interpolation at `point`, the border pixels continued outwards.
    pub fn bilinear(&self, point: ImagePoint) -> f64 {
        let ((x, fx), (y, fy)) = (whole_and_rest(point.x), whole_and_rest(point.y));
        let (last_x, last_y) = (self.width.cast_signed() - 1, self.height.cast_signed() - 1);
        let [a, b, c, d] = if (0..last_x).contains(&x) && (0..last_y).contains(&y) {
            let first = y.cast_unsigned() * self.width + x.cast_unsigned();
            let (upper, lower) = (&self.samples[first..], &self.samples[first + self.width..]);
            [upper[0], upper[1], lower[0], lower[1]]
        } else {
            [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(right, down)| {
                self.at_replicated(x.saturating_add(right), y.saturating_add(down))
            })
        }
        .map(f64::from);
        (1.0 - fy) * ((1.0 - fx) * a + fx * b) + fy * ((1.0 - fx) * c + fx * d)
    }
}

/// The largest whole number that is no larger, and what is left; without a call for each of them.
#[inline(always)]
fn whole_and_rest(value: f64) -> (isize, f64) {
    #[allow(clippy::cast_possible_truncation, reason = "saturates, then clamps to the border")]
    let towards_zero = value as isize;
    let whole = towards_zero.saturating_sub(isize::from((towards_zero as f64) > value));
    (whole, value - whole as f64)
}

impl Plane<bool> {
    /// The smallest range of columns and rows that holds every true sample; `None` of none.
    pub fn range(&self) -> Option<PixelRange> {
        (0..self.height).fold(None, |range, y| {
            let row = self.row(y);
            let first = row.iter().position(|&inside| inside);
            let last = row.iter().rposition(|&inside| inside);
            let Some((first, last)) = first.zip(last) else { return range };
            let PixelRange { x0, y0, x1, .. } =
                range.unwrap_or(PixelRange { x0: first, y0: y, x1: last + 1, y1: y + 1 });
            Some(PixelRange { x0: x0.min(first), y0, x1: x1.max(last + 1), y1: y + 1 })
        })
    }
}

/// A half-open rectangle of pixels: columns `x0..x1`, rows `y0..y1`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelRange {
    /// First column.
    pub x0: usize,
    /// First row.
    pub y0: usize,
    /// One past the last column.
    pub x1: usize,
    /// One past the last row.
    pub y1: usize,
}

impl PixelRange {
    /// Columns.
    pub fn width(&self) -> usize {
        self.x1 - self.x0
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.y1 - self.y0
    }

    /// Grown by `margin` on every side, kept inside a `width` x `height` image.
    #[must_use]
    pub fn grown(&self, margin: usize, width: usize, height: usize) -> Self {
        Self {
            x0: self.x0.saturating_sub(margin),
            y0: self.y0.saturating_sub(margin),
            x1: (self.x1 + margin).min(width),
            y1: (self.y1 + margin).min(height),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bilinear_is_exact_on_a_ramp_and_replicates_the_border() {
        #[allow(clippy::cast_precision_loss, reason = "small numbers")]
        let plane = Plane::from_fn(5, 4, |x, y| (2 * x + 3 * y) as f32);
        assert!((plane.bilinear(ImagePoint::new(1.25, 2.5)) - 10.0).abs() < 1e-12);
        assert!((plane.bilinear(ImagePoint::new(-3.0, 0.0)) - 0.0).abs() < 1e-12);
        assert!((plane.bilinear(ImagePoint::new(9.0, 9.0)) - 17.0).abs() < 1e-12);
    }

    #[test]
    fn the_range_of_a_mask_holds_its_true_samples_closely() {
        let mask = Plane::from_fn(6, 5, |x, y| [(3, 1), (2, 3), (4, 3)].contains(&(x, y)));
        assert_eq!(mask.range(), Some(PixelRange { x0: 2, y0: 1, x1: 5, y1: 4 }));
        assert_eq!(Plane::filled(6, 5, false).range(), None);
    }

    #[test]
    fn crop_keeps_the_samples_of_the_window() {
        let plane = Plane::from_fn(5, 4, |x, y| 10 * y + x);
        let cropped = plane.crop(PixelRange { x0: 1, y0: 2, x1: 3, y1: 4 });
        assert_eq!(cropped.samples(), [21, 22, 31, 32]);
    }
}
