//! Corners as peaks of a response that is there at every pixel.

use std::ops::Range;

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::area::SearchArea;
use crate::detect::maxima::{Candidates, Equals, MaximaOfRow, Strongest, column_bits, response_of};
use crate::detect::taken::Taken;
use crate::detect::tensor::TensorBuffers;
use crate::detect::{Detection, Detector};
use crate::geometry::ImagePoint;
use crate::image::{PixelRange, Plane};
use crate::sensor::Exposure;
use crate::target::TargetRegion;

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
pub(crate) trait Response: Sync {
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
pub(crate) struct ResponseMemory {
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
    pub(super) taken: Taken,
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
}
