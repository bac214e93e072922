//! Which samples may be corners: those far enough from the image's edges and near enough to the target.

use std::ops::Range;

use crate::geometry::ImagePoint;
use crate::image::PixelRange;
use crate::target::TargetRegion;

/// Whether a convex quadrilateral, its corners clockwise as seen, holds the point.
pub(super) fn holds(corners: &[ImagePoint; 4], point: ImagePoint) -> bool {
    (0..4).all(|i| {
        let (from, to) = (corners[i], corners[(i + 1) % 4]);
        (to.x - from.x) * (point.y - from.y) - (to.y - from.y) * (point.x - from.x) >= 0.0
    })
}

/// The samples that may become candidates.
pub(super) struct SearchArea {
    /// Holds all of them.
    pub(super) range: PixelRange,
    /// Where they lie, clockwise as seen; anywhere in the range when there is none.
    quadrilateral: Option<[ImagePoint; 4]>,
}

impl SearchArea {
    /// The samples of an image of `width` x `height` at least `border` of them from its edges and, where
    /// there is a region, inside its quadrilateral grown by `margin_px` on each side; `pitch` of them
    /// are a pixel.
    pub(super) fn new(
        [width, height]: [usize; 2],
        border: usize,
        region: Option<&TargetRegion>,
        margin_px: f64,
        pitch: usize,
    ) -> Self {
        let in_samples = |p: ImagePoint| ImagePoint::new(p.x * pitch as f64, p.y * pitch as f64);
        let quadrilateral =
            region.map(|region| region.grown_quadrilateral(margin_px).map(in_samples));
        let span = |coordinate: fn(&ImagePoint) -> f64, size: usize| {
            let (first, end) = (border, size.saturating_sub(border).max(border));
            let Some(corners) = &quadrilateral else { return (first, end) };
            let values = corners.iter().map(coordinate);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
            let (low, high) = (
                values.clone().fold(f64::INFINITY, f64::min).ceil() as usize,
                values.fold(f64::NEG_INFINITY, f64::max).floor() as usize,
            );
            let low = low.clamp(first, end);
            (low, high.saturating_add(1).clamp(low, end))
        };
        let ((x0, x1), (y0, y1)) = (span(|p| p.x, width), span(|p| p.y, height));
        Self { range: PixelRange { x0, y0, x1, y1 }, quadrilateral }
    }

    /// Whether the place (x, y), which lies in the range, may become a candidate.
    pub(super) fn contains(&self, x: f64, y: f64) -> bool {
        let Some(corners) = &self.quadrilateral else { return true };
        holds(corners, ImagePoint::new(x, y))
    }

    /// The area's rows, from the top: each one's number and columns.
    pub(super) fn rows(&self) -> impl Iterator<Item = (usize, Range<usize>)> {
        let PixelRange { x0, y0, x1, y1 } = self.range;
        (y0..y1).filter_map(move |y| {
            // Convex, so that all columns between two inside are inside.
            let first = (x0..x1).find(|&x| self.contains(x as f64, y as f64))?;
            let last = (x0..x1).rfind(|&x| self.contains(x as f64, y as f64))?;
            Some((y, first..last + 1))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Plane;

    #[test]
    fn an_area_leaves_the_border_out_and_may_be_empty() {
        let area = SearchArea::new([12, 11], 5, None, 0.0, 1);
        assert_eq!(area.rows().collect::<Vec<_>>(), [(5, 5..7)]);
        assert_eq!(SearchArea::new([3, 30], 5, None, 0.0, 1).rows().count(), 0);
    }

    #[test]
    fn an_area_is_the_pixels_inside_the_grown_quadrilateral() {
        let diamond = TargetRegion {
            mask: Plane::filled(20, 20, false),
            range: PixelRange { x0: 9, y0: 9, x1: 11, y1: 11 },
            quadrilateral: [[9.0, 8.0], [10.0, 9.0], [9.0, 10.0], [8.0, 9.0]].map(ImagePoint::from),
            pixels: 5,
        };
        let rows = |margin_px| {
            SearchArea::new([20, 20], 0, Some(&diamond), margin_px, 1).rows().collect::<Vec<_>>()
        };
        assert_eq!(rows(0.0), [(8, 9..10), (9, 8..11), (10, 9..10)]);
        let margin_px = f64::sqrt(0.5) + 1e-9; // |dx| + |dy| <= 1 becomes <= 2
        assert_eq!(rows(margin_px), [(7, 9..10), (8, 8..11), (9, 7..12), (10, 8..11), (11, 9..10)]);
    }
}
