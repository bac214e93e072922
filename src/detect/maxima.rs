//! The maxima of a response, row by row, in the machine's vectors.

use std::ops::Range;

use pulp::Simd;

use crate::image::Plane;
use crate::vector::{Lanes, Real};

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

/// Samples that may be corners.
#[derive(Debug, Default)]
pub(super) struct Candidates {
    /// Response and index, so that keys are in the order of their responses: found by each thread; the
    /// first holds all.
    pub(super) blocks: Vec<Vec<u64>>,
}

/// How many bits of a sample's index are its column: rows count in powers of two, so that a place needs no
/// division.
pub(super) fn column_bits(width: usize) -> u32 {
    usize::BITS - width.saturating_sub(1).leading_zeros()
}

/// Of a positive response the bits are in order. A picture has less than 2^31 samples.
fn key_of(index: usize, response: f32) -> u64 {
    u64::from(response.to_bits()) << 32 | (index as u64 & 0xffff_ffff)
}

fn index_of(key: u64) -> usize {
    (key & 0xffff_ffff) as usize
}

pub(super) fn response_of(key: u64) -> f32 {
    f32::from_bits((key >> 32) as u32)
}

impl Candidates {
    /// Sorts them: strongest first, equals by their index.
    pub(super) fn strongest_first(&mut self) {
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
pub(super) struct Strongest<'a>(pub(super) &'a [f32]);

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
pub(super) struct MaximaOfRow<'a> {
    pub(super) response: &'a Plane<f32>,
    pub(super) y: usize,
    pub(super) columns: Range<usize>,
    pub(super) radius: usize,
    pub(super) least: f32,
    pub(super) equals: Equals,
    pub(super) found: &'a mut Vec<u64>,
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
