//! Gathering light: a film's cells, weighted and added up.

use nalgebra::DMatrix;

use crate::image::{PixelRange, Plane};

/// The weights of film cells in a pixel at one phase; the same for all pixels. They sum to 1.
#[derive(Clone, Debug)]
pub struct Kernel {
    oversampling: usize,
    /// Column and row of the first cell that counts, from pixel (0, 0)'s first cell.
    first: [isize; 2],
    weights: Weights,
    phase_px: [f64; 2],
    centroid_px: [f64; 2],
    blur_px: f64,
}

#[derive(Clone, Debug)]
enum Weights {
    /// The product of a row and a column.
    Product { across: Vec<f32>, down: Vec<f32> },
    /// Of each row the first column that counts, and weights from there on.
    Rows(Vec<(usize, Vec<f32>)>),
}

/// Weights are dropped below this share of the largest one.
const NEGLIGIBLE: f64 = 1e-7;

/// Pixels whose sums stay in registers while taps are added up: in the middle of a row, and at its end.
const BLOCK: usize = 128;
const MIDDLE_BLOCK: usize = 64;
const SMALL_BLOCK: usize = 16;

/// Memory that [`Kernel::gather`] needs; kept from call to call.
#[derive(Debug, Default)]
pub struct GatherBuffers {
    line: Vec<f32>,
    ring: Vec<f32>,
    places: Vec<usize>,
    taps: Vec<Tap>,
}

/// A weight, and where its samples begin.
type Tap = (usize, f32);

impl Kernel {
    /// Of a matrix of weights, rows going down. `first` is its first cell, `centre` the pixel's centre
    /// in film cells.
    pub(super) fn new(
        oversampling: usize,
        first: [isize; 2],
        centre: [f64; 2],
        phase_px: [f64; 2],
        mut matrix: DMatrix<f64>,
        is_product: bool,
    ) -> Self {
        let least = if is_product { 0.0 } else { NEGLIGIBLE * matrix.max() };
        matrix.apply(|weight| {
            if *weight < least {
                *weight = 0.0;
            }
        });
        matrix /= matrix.sum();
        let (mut moment, mut moment2) = ([0.0, 0.0], 0.0);
        for (row, line) in matrix.row_iter().enumerate() {
            for (column, weight) in line.iter().enumerate() {
                let x = first[0] as f64 + column as f64 + 0.5 - centre[0];
                let y = first[1] as f64 + row as f64 + 0.5 - centre[1];
                moment[0] += weight * x;
                moment[1] += weight * y;
                moment2 += weight * (x * x + y * y);
            }
        }
        #[allow(clippy::cast_possible_truncation, reason = "weights are kept as f32")]
        let narrow = |weight: &f64| *weight as f32;
        let weights = if is_product {
            Weights::Product {
                across: matrix.row_sum().iter().map(narrow).collect(),
                down: matrix.column_sum().iter().map(narrow).collect(),
            }
        } else {
            let rows = matrix.row_iter().map(|row| {
                let counts = |weight: &f64| *weight > 0.0;
                let first = row.iter().position(counts).unwrap_or(0);
                let end = row.iter().rposition(counts).map_or(first, |last| last + 1);
                (first, row.iter().take(end).skip(first).map(narrow).collect())
            });
            Weights::Rows(rows.collect())
        };
        let centroid_px = moment.map(|value| value / oversampling as f64);
        // Within a cell the film is constant: that, too, blurs.
        let variance = 0.5 * (moment2 - moment[0].powi(2) - moment[1].powi(2)) + 1.0 / 12.0;
        let blur_px = variance.max(0.0).sqrt() / oversampling as f64;
        Self { oversampling, first, weights, phase_px, centroid_px, blur_px }
    }

    /// Where in the film's image the centre of pixel (0, 0) is \[px\].
    pub fn phase_px(&self) -> [f64; 2] {
        self.phase_px
    }

    /// Centroid of blur and aperture, from the pixel's centre \[px\]: zero but for rounding.
    pub fn centroid_px(&self) -> [f64; 2] {
        self.centroid_px
    }

    /// Standard deviation of blur, pixel area and film cell along one axis, the mean of both \[px\].
    pub fn blur_px(&self) -> f64 {
        self.blur_px
    }

    /// Columns and rows of cells that count.
    fn size(&self) -> [usize; 2] {
        match &self.weights {
            Weights::Product { across, down } => [across.len(), down.len()],
            Weights::Rows(rows) => {
                [rows.iter().map(|(first, row)| first + row.len()).max().unwrap_or(0), rows.len()]
            }
        }
    }

    /// The light on the pixels of `window` from one channel of the film, which is continued at its
    /// border.
    ///
    /// Of each of the film's rows the columns of one place within their pixels are put next to each
    /// other, so that one weight counts for neighbours in memory. The film is read once, in the order
    /// of memory; what the next row of pixels needs again is kept in a ring.
    pub fn gather(
        &self,
        film: &Plane<f32>,
        window: PixelRange,
        buffers: &mut GatherBuffers,
        light: &mut Plane<f32>,
    ) {
        pulp::Arch::new().dispatch(Gather { kernel: self, film, window, buffers, light });
    }
}

/// A gathering of light: compiled for the machine's vectors.
struct Gather<'a> {
    kernel: &'a Kernel,
    film: &'a Plane<f32>,
    window: PixelRange,
    buffers: &'a mut GatherBuffers,
    light: &'a mut Plane<f32>,
}

impl pulp::WithSimd for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { kernel, film, window, buffers, light } = self;
        let GatherBuffers { line, ring, places, taps } = buffers;
        let scale = kernel.oversampling;
        let [columns, rows] = kernel.size();
        let pixels = window.width().next_multiple_of(SMALL_BLOCK);
        // Cells of one place within their pixels; a line has one such run for each place.
        let run = pixels + columns.div_ceil(scale);
        places.clear();
        places.extend((0..columns).map(|cell| (cell % scale) * run + cell / scale));
        let left = kernel.first[0] + (window.x0 * scale).cast_signed();
        let top = kernel.first[1] + (window.y0 * scale).cast_signed();
        let kept = if matches!(kernel.weights, Weights::Rows(_)) { scale * run } else { pixels };
        line.resize(scale * run, 0.0);
        ring.resize(rows * kept, 0.0);
        let mut filled = 0;
        for y in 0..window.height() {
            let begin = y * scale;
            for row in filled.max(begin)..begin + rows {
                let from = (top + row.cast_signed()).clamp(0, film.height().cast_signed() - 1);
                let from = film.row(from.unsigned_abs());
                let slot = &mut ring[row % rows * kept..][..kept];
                match &kernel.weights {
                    Weights::Rows(_) => sort_by_place(from, left, scale, run, slot),
                    Weights::Product { across, .. } => {
                        sort_by_place(from, left, scale, run, line);
                        taps.clear();
                        taps.extend(places.iter().copied().zip(across.iter().copied()));
                        weighted_sum(line, taps, slot);
                    }
                }
            }
            filled = begin + rows;
            taps.clear();
            let slot = |row: usize| (begin + row) % rows * kept;
            match &kernel.weights {
                Weights::Product { down, .. } => {
                    taps.extend(down.iter().enumerate().map(|(row, &w)| (slot(row), w)));
                }
                Weights::Rows(all) => {
                    for (row, (first, weights)) in all.iter().enumerate() {
                        let tap = |(place, weight): (&usize, &f32)| (slot(row) + place, *weight);
                        taps.extend(places[*first..].iter().zip(weights).map(tap));
                    }
                }
            }
            weighted_sum(ring, taps, light.row_mut(y));
        }
    }
}

/// A row of film from column `left` on, continued at its border, in runs of the cells that lie at one
/// place within their pixels.
#[inline(always)]
fn sort_by_place(row: &[f32], left: isize, scale: usize, run: usize, line: &mut [f32]) {
    // The pixels all of whose cells are in the film.
    let to_pixel = |cell: isize| cell.clamp(0, (run * scale).cast_signed()).unsigned_abs();
    let end = to_pixel(row.len().cast_signed() - left) / scale;
    let begin = to_pixel(-left).div_ceil(scale).min(end);
    let first = (left + (begin * scale).cast_signed()).clamp(0, row.len().cast_signed());
    let cells = &row[first.unsigned_abs()..][..(end - begin) * scale];
    match scale {
        1 => sort::<1>(cells, begin, run, line),
        2 => sort::<2>(cells, begin, run, line),
        4 => sort::<4>(cells, begin, run, line),
        8 => sort::<8>(cells, begin, run, line),
        _ => {
            for (pixel, cells) in (begin..).zip(cells.chunks_exact(scale)) {
                for (place, &cell) in cells.iter().enumerate() {
                    line[place * run + pixel] = cell;
                }
            }
        }
    }
    for pixel in (0..begin).chain(end..run) {
        for place in 0..scale {
            let cell = left + (pixel * scale + place).cast_signed();
            line[place * run + pixel] =
                row[cell.clamp(0, row.len().cast_signed() - 1).unsigned_abs()];
        }
    }
}

/// The cells of whole pixels from `begin` on, some pixels at a time: the film comes in the order of
/// memory.
#[inline(always)]
fn sort<const SCALE: usize>(cells: &[f32], begin: usize, run: usize, line: &mut [f32]) {
    let (pixels, _) = cells.as_chunks::<SCALE>();
    let (blocks, rest) = pixels.as_chunks::<SMALL_BLOCK>();
    let last = begin + blocks.len() * SMALL_BLOCK;
    for (block, from) in blocks.iter().zip((begin..).step_by(SMALL_BLOCK)) {
        let sorted: [[f32; SMALL_BLOCK]; SCALE] =
            std::array::from_fn(|place| block.map(|pixel| pixel[place]));
        for (place, sorted) in sorted.iter().enumerate() {
            line[place * run + from..][..SMALL_BLOCK].copy_from_slice(sorted);
        }
    }
    for (place, line) in line.chunks_exact_mut(run).enumerate().take(SCALE) {
        for (to, pixel) in line[last..].iter_mut().zip(rest) {
            *to = pixel[place];
        }
    }
}

/// Samples from each tap's place on, times its weight, added up.
#[inline(always)]
fn weighted_sum(samples: &[f32], taps: &[Tap], sums: &mut [f32]) {
    let mut done = 0;
    while done < sums.len() {
        let (samples, rest) = (&samples[done..], &mut sums[done..]);
        done += match rest.len() {
            BLOCK.. => add_block::<BLOCK>(samples, taps, rest),
            MIDDLE_BLOCK.. => add_block::<MIDDLE_BLOCK>(samples, taps, rest),
            _ => add_block::<SMALL_BLOCK>(samples, taps, rest),
        };
    }
}

/// Adds up a block of at most `COUNT` and returns how many.
#[inline(always)]
fn add_block<const COUNT: usize>(samples: &[f32], taps: &[Tap], sums: &mut [f32]) -> usize {
    let mut added = [0.0_f32; COUNT];
    for &(from, weight) in taps {
        for (sum, sample) in added.iter_mut().zip(&samples[from..from + COUNT]) {
            *sum = weight.mul_add(*sample, *sum);
        }
    }
    let count = sums.len().min(COUNT);
    sums[..count].copy_from_slice(&added[..count]);
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::optics::Optics;
    use crate::sensor::optics::tests::{kernel, some_optics};

    impl Kernel {
        pub(in crate::sensor) fn oversampling(&self) -> usize {
            self.oversampling
        }

        pub(in crate::sensor) fn first(&self) -> [isize; 2] {
            self.first
        }

        /// The weights row by row.
        pub(in crate::sensor) fn matrix(&self) -> Vec<Vec<f64>> {
            let [columns, rows] = self.size();
            let mut matrix = vec![vec![0.0; columns]; rows];
            for (y, line) in matrix.iter_mut().enumerate() {
                for (x, weight) in line.iter_mut().enumerate() {
                    *weight = match &self.weights {
                        Weights::Product { across, down } => {
                            f64::from(across[x]) * f64::from(down[y])
                        }
                        Weights::Rows(rows) => {
                            let (first, row) = &rows[y];
                            x.checked_sub(*first)
                                .and_then(|x| row.get(x))
                                .map_or(0.0, |&w| w.into())
                        }
                    };
                }
            }
            matrix
        }
    }

    fn speckled(width: usize, height: usize) -> Plane<f32> {
        Plane::from_fn(width, height, |x, y| ((x * 7919 + y * 104_729) % 97) as f32 / 97.0)
    }

    #[test]
    fn gathering_is_the_weighted_sum_of_cells_also_at_the_border_and_in_a_window() {
        let film = speckled(4 * 45, 4 * 38);
        let mut buffers = GatherBuffers::default();
        for optics in some_optics() {
            for phase in [[0.0, 0.0], [0.4, -0.3]] {
                let kernel = kernel(&optics, 4, phase);
                let weights = kernel.matrix();
                let direct = |x: usize, y: usize| {
                    let mut sum = 0.0;
                    for (row, line) in (0..).zip(&weights) {
                        for (column, weight) in (0..).zip(line) {
                            let at = film.at_replicated(
                                kernel.first()[0] + 4 * x.cast_signed() + column,
                                kernel.first()[1] + 4 * y.cast_signed() + row,
                            );
                            sum += weight * f64::from(at);
                        }
                    }
                    sum
                };
                for window in [
                    PixelRange { x0: 0, y0: 0, x1: 45, y1: 38 },
                    PixelRange { x0: 5, y0: 30, x1: 44, y1: 37 },
                ] {
                    let mut light = Plane::filled(window.width(), window.height(), 9.0);
                    kernel.gather(&film, window, &mut buffers, &mut light);
                    for y in 0..window.height() {
                        for x in 0..window.width() {
                            let wanted = direct(window.x0 + x, window.y0 + y);
                            let found = f64::from(light.at(x, y));
                            assert!((found - wanted).abs() < 3e-6, "{optics:?} {x} {y}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn a_phase_of_one_cell_moves_the_picture_by_one_cell() {
        let film = speckled(4 * 20, 4 * 20);
        let moved = Plane::from_fn(80, 80, |x, y| {
            film.at_replicated(x.cast_signed() + 1, y.cast_signed() - 2)
        });
        let optics = Optics { gaussian_sigma_px: 0.5, ..Optics::default() };
        let gathered = |film: &Plane<f32>, phase: [f64; 2]| {
            let mut light = Plane::filled(20, 20, 0.0);
            let window = PixelRange { x0: 0, y0: 0, x1: 20, y1: 20 };
            kernel(&optics, 4, phase).gather(
                film,
                window,
                &mut GatherBuffers::default(),
                &mut light,
            );
            light
        };
        let (ahead, beside) = (gathered(&film, [0.25, -0.5]), gathered(&moved, [0.0, 0.0]));
        for y in 5..15 {
            for x in 5..15 {
                assert!((ahead.at(x, y) - beside.at(x, y)).abs() < 1e-6, "{x} {y}");
            }
        }
    }

    #[test]
    fn the_mean_of_light_is_the_mean_of_the_film() {
        // Dark about a lit middle: nothing is lost beyond the border.
        let film = Plane::from_fn(4 * 64, 4 * 64, |x, y| {
            if (96..160).contains(&x) && (80..176).contains(&y) {
                0.2 + ((x * 31 + y * 17) % 50) as f32 / 50.0
            } else {
                0.0
            }
        });
        let mean = |plane: &Plane<f32>| {
            let sum: f64 = plane.samples().iter().map(|&v| f64::from(v)).sum();
            sum / plane.samples().len() as f64
        };
        for optics in some_optics() {
            let mut light = Plane::filled(64, 64, 0.0);
            let window = PixelRange { x0: 0, y0: 0, x1: 64, y1: 64 };
            let kernel = kernel(&optics, 4, [0.31, 0.17]);
            kernel.gather(&film, window, &mut GatherBuffers::default(), &mut light);
            assert!((mean(&light) / mean(&film) - 1.0).abs() < 1e-6, "{optics:?}");
        }
    }

    #[test]
    fn a_point_sampled_pixel_sees_one_cell_and_says_which() {
        let film = speckled(4 * 10, 4 * 10);
        let optics = Optics { fill_factor: 0.0, ..Optics::default() };
        let kernel = kernel(&optics, 4, [0.0, 0.0]);
        assert!(kernel.phase_px().iter().all(|phase| (phase - 0.125).abs() < 1e-12));
        let mut light = Plane::filled(10, 10, 0.0);
        let window = PixelRange { x0: 0, y0: 0, x1: 10, y1: 10 };
        kernel.gather(&film, window, &mut GatherBuffers::default(), &mut light);
        for y in 0..10 {
            for x in 0..10 {
                assert!((light.at(x, y) - film.at(4 * x + 2, 4 * y + 2)).abs() < 1e-6);
            }
        }
    }
}
