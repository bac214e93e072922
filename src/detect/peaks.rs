//! Corners as peaks of a response that is there at every pixel.

use std::ops::Range;

use pulp::Simd;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::good_features::Taken;
use crate::detect::tensor::TensorBuffers;
use crate::detect::{Detection, Detector};
use crate::geometry::ImagePoint;
use crate::image::{PixelRange, Plane};
use crate::sensor::Exposure;
use crate::target::TargetRegion;
use crate::vector::{Lanes, Real};

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

/// What is there at every pixel, and whose peaks are corners.
pub(super) trait Response: Sync {
    /// Samples per pixel, in either direction: sample (i, j) lies at pixel (i, j) / oversampling.
    fn oversampling(&self) -> usize {
        1
    }

    /// How far from a sample the others lie on which its response depends, in samples.
    fn support(&self) -> usize;

    /// How near to the image's edges no sample is searched, in samples.
    fn border(&self) -> usize {
        self.support()
    }

    /// Replaces what `response` holds by the responses of the samples in `range`. Those nearer to the
    /// range's edges than the support, and farther from the image's, may be anything.
    fn respond(
        &self,
        exposure: &Exposure,
        range: PixelRange,
        memory: &mut ResponseMemory,
        response: &mut Plane<f32>,
    );
}

impl<R: Response> Response for &R {
    fn oversampling(&self) -> usize {
        (**self).oversampling()
    }

    fn support(&self) -> usize {
        (**self).support()
    }

    fn border(&self) -> usize {
        (**self).border()
    }

    fn respond(
        &self,
        exposure: &Exposure,
        range: PixelRange,
        memory: &mut ResponseMemory,
        response: &mut Plane<f32>,
    ) {
        (**self).respond(exposure, range, memory, response);
    }
}

/// A detector whose corners are the peaks of a response, and nothing else.
pub(super) trait PeakDetector: Send + Sync {
    /// Which of equally strong neighbours is a corner.
    const EQUALS: Equals = Equals::First;

    /// What is measured.
    fn response(&self) -> impl Response;

    /// When it is a corner.
    fn peaks(&self) -> &Peaks;
}

impl<D: PeakDetector> Detector for D {
    fn detect_into(
        &self,
        exposure: &Exposure,
        region: Option<&TargetRegion>,
        scratch: &mut Scratch,
        found: &mut Vec<Detection>,
    ) {
        let response = self.response();
        detect_peaks(&response, self.peaks(), D::EQUALS, exposure, region, scratch, found);
    }
}

/// Memory that responses need.
#[derive(Debug, Default)]
pub(super) struct ResponseMemory {
    pub(super) planes: [Plane<f32>; 3],
    pub(super) row: Vec<f32>,
    pub(super) tensor: TensorBuffers,
}

/// Memory of detectors, kept from call to call: one that has seen an image of the size before
/// allocates nothing.
#[derive(Debug, Default)]
pub struct Scratch {
    memory: ResponseMemory,
    pub(super) response: Plane<f32>,
    pub(super) candidates: Candidates,
    /// Where no more corner may be.
    pub(super) taken: Taken,
    /// Half widths of the disc that a corner takes.
    pub(super) disc: Vec<usize>,
}

/// Which of equally strong neighbours is a peak.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Equals {
    /// The first, by row, then column.
    First,
    /// None of them.
    None,
    /// All of them.
    All,
}

/// The peaks of a response, strongest first, equals by row, then column.
///
/// Of equal neighbours the first is the peak: a plateau that fits into the radius, and a rectangular one
/// of any size, has exactly one. Or `equals` has it otherwise.
fn detect_peaks(
    response: &impl Response,
    rule: &Peaks,
    equals: Equals,
    exposure: &Exposure,
    region: Option<&TargetRegion>,
    scratch: &mut Scratch,
    found: &mut Vec<Detection>,
) {
    found.clear();
    let pitch = response.oversampling();
    let Some(searched) = Searched::of(response, rule, exposure, region, scratch) else { return };
    let strongest = searched.strongest(&scratch.response);
    let threshold = rule.threshold.max(rule.threshold_rel * f64::from(strongest));
    let radius = rule.nms_radius_px as usize * pitch;
    searched.candidates(&scratch.response, radius, threshold, equals, &mut scratch.candidates);
    let most = if rule.most > 0 { rule.most as usize } else { usize::MAX };
    scratch.candidates.strongest_first();
    found.extend(scratch.candidates.iter().take(most).map(|(index, response)| {
        let [x, y] = searched.place(index);
        let scale = 1.0 / pitch as f64;
        Detection::new(ImagePoint::new(scale * x as f64, scale * y as f64), response)
    }));
}

/// A part of an image whose response is known.
pub(super) struct Searched {
    area: SearchArea,
    /// The samples whose responses are known.
    known: PixelRange,
}

impl Searched {
    /// Computes the response where it is searched; `None` where nothing is.
    pub(super) fn of(
        response: &impl Response,
        rule: &Peaks,
        exposure: &Exposure,
        region: Option<&TargetRegion>,
        scratch: &mut Scratch,
    ) -> Option<Self> {
        let pitch = response.oversampling();
        let size = [exposure.width(), exposure.height()]
            .map(|count| if count > 0 { (count - 1) * pitch + 1 } else { 0 });
        let area = SearchArea::new(size, response.border(), region, rule.margin_px, pitch);
        if area.range.width() == 0 || area.range.height() == 0 {
            return None;
        }
        let reach = rule.nms_radius_px as usize * pitch + response.support();
        let known = area.range.grown(reach, size[0], size[1]);
        response.respond(exposure, known, &mut scratch.memory, &mut scratch.response);
        Some(Self { area, known })
    }

    /// Where the sample of this index lies, in samples.
    pub(super) fn place(&self, index: usize) -> [usize; 2] {
        let bits = column_bits(self.known.width());
        let x = index & ((1 << bits) - 1);
        [x + self.known.x0, (index >> bits) + self.known.y0]
    }

    /// The area's rows, as the known response counts them.
    fn rows(&self) -> impl Iterator<Item = (usize, Range<usize>)> {
        let PixelRange { x0, y0, .. } = self.known;
        self.area.rows().map(move |(y, columns)| (y - y0, columns.start - x0..columns.end - x0))
    }

    /// The strongest response in the area; 0 where none is positive.
    pub(super) fn strongest(&self, response: &Plane<f32>) -> f32 {
        let of_row = |(y, columns): (usize, Range<usize>)| {
            pulp::Arch::new().dispatch(Strongest(&response.row(y)[columns]))
        };
        self.rows().map(of_row).fold(0.0, f32::max)
    }

    /// Replaces the candidates by the samples of the area that exceed `threshold`, which is not negative,
    /// and that nothing within the square of half side `radius` exceeds.
    pub(super) fn candidates(
        &self,
        response: &Plane<f32>,
        radius: usize,
        threshold: f64,
        equals: Equals,
        candidates: &mut Candidates,
    ) {
        #[allow(clippy::cast_possible_truncation, reason = "no response lies between")]
        let least = threshold as f32;
        let threads = if response.samples().len() < super::tensor::MANY_PIXELS {
            1
        } else {
            rayon::current_num_threads()
        };
        let height = self.area.range.height().div_ceil(threads);
        candidates.blocks.resize_with(threads, Vec::new);
        let first = self.area.range.y0 - self.known.y0;
        let block = |index: usize, found: &mut Vec<u64>| {
            found.clear();
            let wanted = first + index * height..first + (index + 1) * height;
            for (y, columns) in self.rows().filter(|(y, _)| wanted.contains(y)) {
                let row = MaximaOfRow { response, y, columns, radius, least, equals, found };
                pulp::Arch::new().dispatch(row);
            }
            // Exactly, where rounding has moved the threshold.
            found.retain(|key| f64::from(response_of(*key)) > threshold);
        };
        if threads == 1 {
            block(0, &mut candidates.blocks[0]);
        } else {
            candidates.blocks.par_iter_mut().enumerate().for_each(|(i, found)| block(i, found));
        }
        let (all, others) = candidates.blocks.split_at_mut(1);
        others.iter().for_each(|found| all[0].extend_from_slice(found));
    }
}

/// Samples that may be corners.
#[derive(Debug, Default)]
pub(super) struct Candidates {
    /// Response and index, so that keys are in the order of their responses: found by each thread; the
    /// first holds all.
    blocks: Vec<Vec<u64>>,
}

/// How many bits of a sample's index are its column: rows count in powers of two, so that a place needs no
/// division.
fn column_bits(width: usize) -> u32 {
    usize::BITS - width.saturating_sub(1).leading_zeros()
}

/// Of a positive response the bits are in order. A picture has less than 2^31 samples.
fn key_of(index: usize, response: f32) -> u64 {
    u64::from(response.to_bits()) << 32 | (index as u64 & 0xffff_ffff)
}

fn index_of(key: u64) -> usize {
    (key & 0xffff_ffff) as usize
}

fn response_of(key: u64) -> f32 {
    f32::from_bits((key >> 32) as u32)
}

impl Candidates {
    /// Sorts them: strongest first, equals by their index.
    fn strongest_first(&mut self) {
        self.blocks[0].sort_unstable_by_key(|key| key ^ 0xffff_ffff_0000_0000);
    }

    /// Sorts them: strongest first, equals against their index.
    pub(super) fn strongest_and_last_first(&mut self) {
        self.blocks[0].sort_unstable_by_key(|key| !key);
    }

    /// Index and response of each.
    pub(super) fn iter(&self) -> impl Iterator<Item = (usize, f64)> {
        let split = |key: &u64| (index_of(*key), f64::from(response_of(*key)));
        self.blocks.first().into_iter().flatten().map(split)
    }
}

/// The largest of samples, or 0: compiled for the machine's vectors.
struct Strongest<'a>(&'a [f32]);

impl pulp::WithSimd for Strongest<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        let samples = self.0;
        let mut strongest = Lanes::splat(simd, 0.0);
        let mut x = 0;
        while x < samples.len() {
            // The last vector overlaps the one before; of a row shorter than one, lanes are 0.
            let first = x.min(samples.len().saturating_sub(S::F32_LANES));
            strongest = strongest.max(Lanes::load_part(simd, samples, first));
            x = first + S::F32_LANES;
        }
        strongest.largest()
    }
}

/// The most lanes of a vector.
const LANES: usize = 16;

/// The candidates of a part of a row: compiled for the machine's vectors.
struct MaximaOfRow<'a> {
    response: &'a Plane<f32>,
    y: usize,
    columns: Range<usize>,
    radius: usize,
    least: f32,
    equals: Equals,
    found: &'a mut Vec<u64>,
}

impl pulp::WithSimd for MaximaOfRow<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        const MANY: usize = 4;
        let (width, height) = (self.response.width(), self.response.height());
        let row = self.response.row(self.y);
        // Those whose neighbours are in the plane, where they fill a vector.
        let columns = self.columns.clone();
        let mut inner = columns.start.max(1)..columns.end.min(width - 1);
        if self.y == 0 || self.y + 1 >= height || inner.len() < S::F32_LANES {
            inner = columns.end..columns.end;
        }
        (columns.start..inner.start).chain(inner.end..columns.end).for_each(|x| self.judge(x));
        let mut x = inner.start;
        while x < inner.end {
            let end = inner.end.min(x + MANY * S::F32_LANES);
            let mut largest = Lanes::splat(simd, 0.0);
            for first in (x..end).step_by(S::F32_LANES) {
                let first = first.min(inner.end - S::F32_LANES);
                largest = largest.max(Lanes::load(simd, row, first));
            }
            if largest.largest() >= self.least {
                for first in (x..end).step_by(S::F32_LANES) {
                    // The last vector overlaps the one before.
                    let start = first.min(inner.end - S::F32_LANES);
                    self.judge_vector(simd, start, first - start);
                }
            }
            x = end;
        }
    }
}

impl MaximaOfRow<'_> {
    /// The index of a sample of the row.
    #[inline(always)]
    fn index(&self, x: usize) -> usize {
        (self.y << column_bits(self.response.width())) + x
    }

    /// Judges those samples of a vector that no neighbour exceeds, its first `known` left out.
    #[inline(always)]
    fn judge_vector<S: Simd>(&mut self, simd: S, first: usize, known: usize) {
        let [above, row, below] =
            [self.y - 1, self.y, self.y + 1].map(|y| &self.response.row(y)[first - 1..]);
        let mut most = Lanes::splat(simd, self.least);
        for (row, shifts) in [(above, &[0, 1, 2][..]), (row, &[0, 2]), (below, &[0, 1, 2])] {
            for shift in shifts {
                most = most.max(Lanes::load(simd, row, *shift));
            }
        }
        let here = Lanes::load(simd, row, 1);
        let excess = here - most;
        if excess.largest() < 0.0 {
            return;
        }
        // Without a branch for each lane: which of them it is cannot be foretold.
        let (mut samples, mut excesses, mut keys) = ([0.0; LANES], [0.0; LANES], [0; LANES]);
        here.store(&mut samples, 0);
        excess.store(&mut excesses, 0);
        let mut count = 0;
        let index = self.index(first);
        for lane in known..S::F32_LANES {
            keys[count] = key_of(index + lane, samples[lane]);
            count += usize::from(excesses[lane] >= 0.0);
        }
        // Of a threshold of 0, 0 itself does not pass.
        if self.radius == 1 && self.equals == Equals::All && self.least > 0.0 {
            self.found.extend_from_slice(&keys[..count]);
        } else {
            keys[..count].iter().for_each(|key| self.judge(first + (index_of(*key) - index)));
        }
    }

    /// Keeps a sample that is a maximum.
    fn judge(&mut self, x: usize) {
        let Self { response, y, radius, .. } = *self;
        let here = response.at(x, y);
        if here < self.least || here <= 0.0 {
            return;
        }
        let rows = y.saturating_sub(radius)..(y + radius + 1).min(response.height());
        let columns = x.saturating_sub(radius)..(x + radius + 1).min(response.width());
        for row in rows {
            let samples = &response.row(row)[columns.clone()];
            // Those before it, by row, then column; then those after it.
            let middle = match row.cmp(&y) {
                std::cmp::Ordering::Less => samples.len(),
                std::cmp::Ordering::Equal => x - columns.start,
                std::cmp::Ordering::Greater => 0,
            };
            let (before, after) = samples.split_at(middle);
            let after = if row == y { &after[1..] } else { after };
            let may_equal = match self.equals {
                Equals::First => [false, true],
                Equals::None => [false; 2],
                Equals::All => [true; 2],
            };
            for (samples, may_equal) in [before, after].into_iter().zip(may_equal) {
                let exceeded = samples
                    .iter()
                    .any(|&other| if may_equal { other > here } else { other >= here });
                if exceeded {
                    return;
                }
            }
        }
        self.found.push(key_of(self.index(x), here));
    }
}

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

    /// A response as it is drawn.
    struct Drawn(Plane<f32>);

    impl Response for Drawn {
        fn support(&self) -> usize {
            0
        }

        fn respond(
            &self,
            _: &Exposure,
            range: PixelRange,
            _: &mut ResponseMemory,
            response: &mut Plane<f32>,
        ) {
            *response = self.0.crop(range);
        }
    }

    fn peak_pixels(rows: [[f32; 5]; 4], rule: &Peaks) -> Vec<[f64; 2]> {
        let drawn = Drawn(Plane::from_samples(5, 4, rows.concat()));
        let exposure = Exposure::from_picture(&image::RgbImage::new(5, 4));
        let (mut scratch, mut found) = (Scratch::default(), Vec::new());
        detect_peaks(&drawn, rule, Equals::First, &exposure, None, &mut scratch, &mut found);
        found.iter().map(|peak| peak.point.into()).collect()
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
