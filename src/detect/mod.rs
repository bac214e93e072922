//! From an exposure to corner candidates.

use std::ops::Range;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::ImagePoint;
use crate::image::{PixelRange, Plane};
use crate::registry::Entry;
use crate::sensor::Exposure;
use crate::target::TargetRegion;

pub mod fast;
pub mod foerstner;
pub mod good_features;
pub mod harris;
pub mod noble;
pub mod rohr;
pub mod shi_tomasi;
pub mod tensor;

/// A corner candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Where \[px\].
    pub point: ImagePoint,
    /// How strong, in the detector's own unit; not comparable across detectors.
    pub response: f64,
}

/// Finds corner candidates in one exposure.
pub trait Detector: Send + Sync {
    /// Returns candidates, strongest response first: those inside the region and its margin, or
    /// those of the whole image where no region is given.
    fn detect(&self, exposure: &Exposure, region: Option<&TargetRegion>) -> Vec<Detection>;
}

/// Every detector that a plan can name, in alphabetical order.
pub const DETECTORS: &[Entry<dyn Detector>] = &[
    fast::ENTRY,
    foerstner::ENTRY,
    good_features::ENTRY,
    harris::ENTRY,
    noble::ENTRY,
    rohr::ENTRY,
    shi_tomasi::ENTRY,
];

/// The pixels that may become candidates.
struct SearchArea {
    /// Holds all of them.
    range: PixelRange,
    /// Where they lie, clockwise as seen; anywhere in the range when there is none.
    quadrilateral: Option<[ImagePoint; 4]>,
}

impl SearchArea {
    /// The pixels of a `width` x `height` image at least `border` pixels from its edges and, where
    /// there is a region, inside its quadrilateral grown by `margin_px` on each side.
    fn new(
        [width, height]: [usize; 2],
        border: usize,
        region: Option<&TargetRegion>,
        margin_px: f64,
    ) -> Self {
        let quadrilateral = region.map(|region| region.grown_quadrilateral(margin_px));
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

    /// Whether the pixel at (x, y), which lies in the range, may become a candidate.
    fn contains(&self, x: usize, y: usize) -> bool {
        let Some(corners) = &self.quadrilateral else { return true };
        (0..4).all(|i| {
            let (from, to) = (corners[i], corners[(i + 1) % 4]);
            (to.x - from.x) * (y as f64 - from.y) - (to.y - from.y) * (x as f64 - from.x) >= 0.0
        })
    }

    /// The area's rows, from the top: each one's number and columns.
    fn rows(&self) -> impl Iterator<Item = (usize, Range<usize>)> {
        let PixelRange { x0, y0, x1, y1 } = self.range;
        (y0..y1).filter_map(move |y| {
            // Convex, so that all columns between two inside are inside.
            let first = (x0..x1).find(|&x| self.contains(x, y))?;
            let last = (x0..x1).rfind(|&x| self.contains(x, y))?;
            Some((y, first..last + 1))
        })
    }
}

/// When a response counts as a corner: parameters that detectors share.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Peaks {
    /// Threshold as a fraction of the strongest response searched.
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 1.0))]
    pub threshold_rel: f64,
    /// Threshold on the response itself, in the detector's unit.
    #[schemars(range(min = 0.0))]
    pub threshold: f64,
    /// The most corners, the strongest ones; 0: all.
    #[schemars(range(min = 0, max = 1_000_000))]
    pub most: u32,
    /// Half side of the square in which a corner is the maximum \[px\].
    #[schemars(range(min = 1, max = 64))]
    pub nms_radius_px: u32,
    /// How far around the region to search \[px\].
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub margin_px: f64,
}

impl Default for Peaks {
    fn default() -> Self {
        Self { threshold_rel: 0.01, threshold: 0.0, most: 0, nms_radius_px: 2, margin_px: 3.0 }
    }
}

/// The peaks of `response` in `area`, strongest first, equals by row, then column.
///
/// `response` is the part of the image's response that starts at column `origin[0]` and row
/// `origin[1]`; it holds the area and, as far as the image goes, the rule's radius around it. Of
/// equal neighbours the first, by row, then column, is the peak: a plateau that fits into the
/// radius, and a rectangular one of any size, has exactly one.
fn peaks(
    response: &Plane<f32>,
    origin: [usize; 2],
    area: &SearchArea,
    rule: &Peaks,
) -> Vec<Detection> {
    let [x0, y0] = origin;
    let samples = |y: usize, columns: Range<usize>| {
        &response.row(y - y0)[columns.start - x0..columns.end - x0]
    };
    let strongest = area
        .rows()
        .flat_map(|(y, columns)| samples(y, columns))
        .fold(0.0, |strongest, &r| if r > strongest { r } else { strongest });
    let threshold = rule.threshold.max(rule.threshold_rel * f64::from(strongest));

    let radius = rule.nms_radius_px as usize;
    let around = |centre: usize, first: usize, size: usize| {
        centre.saturating_sub(radius).max(first)..(centre + radius + 1).min(first + size)
    };
    // Of equals the first: none before it is as strong.
    let is_first = |x: usize, y: usize, r: f32| {
        let columns = around(x, x0, response.width());
        around(y, y0, response.height()).take_while(|&row| row <= y).all(|row| {
            let end = if row < y { columns.end } else { x };
            samples(row, columns.start..end).iter().all(|&other| other < r)
        })
    };
    let mut peaks = Vec::new();
    #[allow(clippy::cast_possible_truncation, reason = "no response lies between")]
    let least = threshold as f32;
    maxima(response, origin, area, radius, least, |x, y, r| {
        if f64::from(r) > threshold && is_first(x, y, r) {
            let point = ImagePoint::new(x as f64, y as f64);
            peaks.push(Detection { point, response: f64::from(r) });
        }
    });
    peaks.sort_by(|a, b| b.response.total_cmp(&a.response)); // stable: equals stay in row order
    if rule.most > 0 {
        peaks.truncate(rule.most as usize);
    }
    peaks
}

/// Calls `on` with place and response of every pixel of `area`, by row, then column, that is not less
/// than `least` and than anything within the square of half side `radius`; `response` and `origin` are
/// those of [`peaks`].
fn maxima(
    response: &Plane<f32>,
    [x0, y0]: [usize; 2],
    area: &SearchArea,
    radius: usize,
    least: f32,
    mut on: impl FnMut(usize, usize, f32),
) {
    let mut row = MaximaRow::default();
    for (y, columns) in area.rows() {
        let y = y - y0;
        let rows = y.saturating_sub(radius)..(y + radius + 1).min(response.height());
        let columns = columns.start - x0..columns.end - x0;
        let (first, count) = (columns.start, columns.len());
        pulp::Arch::new().dispatch(MarkMaxima {
            response,
            y,
            rows,
            columns,
            radius,
            least,
            row: &mut row,
        });
        // Most stretches of a row have none.
        for (block, marks) in row.marks[..count].chunks(16).enumerate() {
            if marks.iter().fold(0, |any, &mark| any | mark) > 0 {
                for (index, _) in marks.iter().enumerate().filter(|(_, mark)| **mark > 0) {
                    let x = first + 16 * block + index;
                    on(x + x0, y + y0, response.at(x, y));
                }
            }
        }
    }
}

/// Memory of [`maxima`]: of one row.
#[derive(Default)]
struct MaximaRow {
    /// The largest of each column, with `radius` more on each side.
    columns: Vec<f32>,
    /// The largest of each square.
    squares: Vec<f32>,
    /// 1 where a pixel is not less than it.
    marks: Vec<u8>,
}

/// Marks the maxima of a part of a row: compiled for the machine's vectors.
struct MarkMaxima<'a> {
    response: &'a Plane<f32>,
    y: usize,
    rows: Range<usize>,
    columns: Range<usize>,
    radius: usize,
    least: f32,
    row: &'a mut MaximaRow,
}

impl pulp::WithSimd for MarkMaxima<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { response, y, rows, columns, radius, least, row } = self;
        let count = columns.len();
        row.columns.clear();
        row.columns.resize(count + 2 * radius, f32::NEG_INFINITY);
        let from = columns.start.saturating_sub(radius);
        let to = (columns.end + radius).min(response.width());
        let largest = &mut row.columns[from + radius - columns.start..to + radius - columns.start];
        for y in rows {
            for (largest, &r) in largest.iter_mut().zip(&response.row(y)[from..to]) {
                *largest = if r > *largest { r } else { *largest };
            }
        }
        row.squares.clear();
        row.squares.extend_from_slice(&row.columns[..count]);
        for shift in 1..=2 * radius {
            for (square, &column) in row.squares.iter_mut().zip(&row.columns[shift..]) {
                *square = if column > *square { column } else { *square };
            }
        }
        row.marks.resize(count, 0);
        let samples = &response.row(y)[columns];
        for ((mark, &r), &square) in row.marks.iter_mut().zip(samples).zip(&row.squares) {
            *mark = u8::from(r >= square) & u8::from(r >= least);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EVERYWHERE: SearchArea =
        SearchArea { range: PixelRange { x0: 0, y0: 0, x1: 5, y1: 4 }, quadrilateral: None };

    fn peak_pixels(rows: [[f32; 5]; 4], rule: &Peaks) -> Vec<[f64; 2]> {
        let response = Plane::from_samples(5, 4, rows.concat());
        peaks(&response, [0, 0], &EVERYWHERE, rule).iter().map(|peak| peak.point.into()).collect()
    }

    #[test]
    fn a_plateau_is_one_peak_and_the_strongest_comes_first() {
        let rule =
            Peaks { nms_radius_px: 1, threshold_rel: 0.01, threshold: 0.0, ..Peaks::default() };
        let rows = [
            [3.0, 3.0, 0.0, 0.0, 0.0],
            [3.0, 3.0, 0.0, 0.0, 9.0],
            [0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 2.0, 2.0, 2.0, 1.0],
        ];
        assert_eq!(peak_pixels(rows, &rule), [[4.0, 1.0], [0.0, 0.0], [1.0, 3.0]]);
    }

    #[test]
    fn a_peak_exceeds_both_thresholds() {
        let rows = [
            [8.0, 0.0, 0.0, 0.0, 4.0],
            [0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0],
            [5.0, 0.0, 0.0, 0.0, 0.0],
        ];
        let relative =
            Peaks { nms_radius_px: 1, threshold_rel: 0.5, threshold: 0.0, ..Peaks::default() };
        assert_eq!(peak_pixels(rows, &relative), [[0.0, 0.0], [0.0, 3.0]]);
        let absolute =
            Peaks { nms_radius_px: 1, threshold_rel: 0.5, threshold: 5.0, ..Peaks::default() };
        assert_eq!(peak_pixels(rows, &absolute), [[0.0, 0.0]]);
    }

    #[test]
    fn of_many_the_strongest_are_returned() {
        let rows = [
            [8.0, 0.0, 0.0, 0.0, 4.0],
            [0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 0.0],
            [5.0, 0.0, 0.0, 0.0, 0.0],
        ];
        let rule = Peaks { nms_radius_px: 1, most: 2, ..Peaks::default() };
        assert_eq!(peak_pixels(rows, &rule), [[0.0, 0.0], [0.0, 3.0]]);
    }

    #[test]
    fn nothing_positive_is_nothing_found() {
        let rule =
            Peaks { nms_radius_px: 2, threshold_rel: 0.0, threshold: 0.0, ..Peaks::default() };
        assert!(peak_pixels([[0.0; 5]; 4], &rule).is_empty());
        assert!(peak_pixels([[-1.0; 5]; 4], &rule).is_empty());
    }

    #[test]
    fn an_area_leaves_the_border_out_and_may_be_empty() {
        let area = SearchArea::new([12, 11], 5, None, 0.0);
        assert_eq!(area.rows().collect::<Vec<_>>(), [(5, 5..7)]);
        assert_eq!(SearchArea::new([3, 30], 5, None, 0.0).rows().count(), 0);
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
            SearchArea::new([20, 20], 0, Some(&diamond), margin_px).rows().collect::<Vec<_>>()
        };
        assert_eq!(rows(0.0), [(8, 9..10), (9, 8..11), (10, 9..10)]);
        let margin_px = f64::sqrt(0.5) + 1e-9; // |dx| + |dy| <= 1 becomes <= 2
        assert_eq!(rows(margin_px), [(7, 9..10), (8, 8..11), (9, 7..12), (10, 8..11), (11, 9..10)]);
    }
}
