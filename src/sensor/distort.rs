//! A film through a lens that bends straight lines.

use crate::geometry::{Camera, Distortion, ImagePoint};
use crate::image::Plane;
use crate::scene::Film;
use rayon::prelude::*;

/// What `camera`'s film shows through a lens: every cell is the mean of what it looks at, a rectangle
/// of the film's own cells. Where it looks beyond the film, the film is continued.
///
/// Where a cell looks is found at the pixels' corners and interpolated within a pixel: to better than
/// 1e-4 px where the lens bends a line by less than a pixel in ten.
pub(super) fn distorted(film: &Film, camera: &Camera, distortion: &Distortion) -> Film {
    let scale = film.oversampling as usize;
    let bent = Camera { distortion: *distortion, ..*camera };
    let (width, height) = (camera.width as usize, camera.height as usize);
    // Film coordinates that the corners of pixels look at.
    let corner = |x: usize, y: usize| {
        let seen = ImagePoint::new(x as f64 - 0.5, y as f64 - 0.5);
        let ray = bent.ray(seen);
        let at = ImagePoint::new(
            camera.fx_px * ray.x + camera.cx_px,
            camera.fy_px * ray.y + camera.cy_px,
        );
        at.to_film(film.oversampling)
    };
    let corners: Vec<[f64; 2]> = (0..=height)
        .into_par_iter()
        .flat_map_iter(|y| (0..=width).map(move |x| corner(x, y)))
        .collect();
    let cells = 1.0 / scale as f64;
    let [red, green, blue] = &film.radiance;
    let (columns, rows) = (red.width(), red.height());
    let [mut to_red, mut to_green, mut to_blue] = [0, 1, 2].map(|_| vec![0.0; columns * rows]);
    to_red
        .par_chunks_mut(columns)
        .zip(to_green.par_chunks_mut(columns))
        .zip(to_blue.par_chunks_mut(columns))
        .enumerate()
        .for_each(|(row, ((to_red, to_green), to_blue))| {
            let (y, v) = (row / scale, ((row % scale) as f64 + 0.5) * cells);
            for x in 0..width {
                let at = |dx: usize, dy: usize| corners[(y + dy) * (width + 1) + x + dx];
                // Where the left and the right side of the pixel look at this height.
                let side = |dx: usize| {
                    let (top, bottom) = (at(dx, 0), at(dx, 1));
                    [0, 1].map(|axis| (1.0 - v) * top[axis] + v * bottom[axis])
                };
                let (left, right) = (side(0), side(1));
                // How many film cells a cell spans, across and down.
                let spans = [
                    cells * (at(1, 0)[0] - at(0, 0)[0] + at(1, 1)[0] - at(0, 1)[0]) * 0.5,
                    cells * (at(0, 1)[1] - at(0, 0)[1] + at(1, 1)[1] - at(1, 0)[1]) * 0.5,
                ];
                for cell in 0..scale {
                    let u = (cell as f64 + 0.5) * cells;
                    let middle = [0, 1].map(|axis| (1.0 - u) * left[axis] + u * right[axis]);
                    let patch = Patch::new(middle, spans);
                    let index = x * scale + cell;
                    to_red[index] = patch.mean(red);
                    to_green[index] = patch.mean(green);
                    to_blue[index] = patch.mean(blue);
                }
            }
        });
    let plane = |samples| Plane::from_samples(columns, rows, samples);
    Film {
        oversampling: film.oversampling,
        radiance: [plane(to_red), plane(to_green), plane(to_blue)],
    }
}

/// The most cells that a side of a patch reaches into.
const MOST: usize = 4;

/// A rectangle of film: its first cell, and what the cells from there on count, across and down.
struct Patch {
    first: [isize; 2],
    shares: [[f32; MOST]; 2],
    counts: [usize; 2],
}

impl Patch {
    /// A rectangle by its middle, in coordinates in which a cell's corner is at the integer.
    fn new(middle: [f64; 2], spans: [f64; 2]) -> Self {
        let mut patch = Self { first: [0; 2], shares: [[0.0; MOST]; 2], counts: [1; 2] };
        for axis in 0..2 {
            let half = 0.5 * spans[axis].abs().clamp(1e-3, 3.0);
            let (from, to) = (middle[axis] - half, middle[axis] + half);
            let low = from.floor();
            #[allow(clippy::cast_possible_truncation, reason = "saturates, then clamps")]
            let (first, count) = (low as isize, (to - low).ceil().clamp(1.0, 4.0) as isize);
            patch.first[axis] = first;
            patch.counts[axis] = count.unsigned_abs();
            for (share, step) in patch.shares[axis].iter_mut().zip([0.0, 1.0, 2.0, 3.0]) {
                let within = (to.min(low + step + 1.0) - from.max(low + step)).max(0.0);
                #[allow(clippy::cast_possible_truncation, reason = "a share")]
                let value = (within / (to - from)) as f32;
                *share = value;
            }
        }
        patch
    }

    /// The mean of a plane over the rectangle; the plane is continued at its border.
    fn mean(&self, plane: &Plane<f32>) -> f32 {
        let ([x, y], [across, down], [columns, rows]) = (self.first, &self.shares, self.counts);
        let is_inside = x >= 0
            && y >= 0
            && x.unsigned_abs() + columns <= plane.width()
            && y.unsigned_abs() + rows <= plane.height();
        let mut sum = 0.0;
        for (row, down) in down[..rows].iter().enumerate() {
            let mut along = 0.0;
            if is_inside {
                let from = &plane.row(y.unsigned_abs() + row)[x.unsigned_abs()..];
                for (share, value) in across[..columns].iter().zip(from) {
                    along += share * value;
                }
            } else {
                for (column, share) in (0..).zip(&across[..columns]) {
                    let at = plane.at_replicated(
                        x.saturating_add(column),
                        y.saturating_add(row.cast_signed()),
                    );
                    along += share * at;
                }
            }
            sum += down * along;
        }
        sum
    }
}
