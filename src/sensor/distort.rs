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
    let channel = |plane: &Plane<f32>| {
        let mut samples = vec![0.0; plane.width() * plane.height()];
        samples.par_chunks_mut(plane.width()).enumerate().for_each(|(row, out)| {
            let (y, v) = (row / scale, ((row % scale) as f64 + 0.5) * cells);
            for x in 0..width {
                let at = |dx: usize, dy: usize| corners[(y + dy) * (width + 1) + x + dx];
                let mix = |axis: usize, u: f64| {
                    (1.0 - v) * ((1.0 - u) * at(0, 0)[axis] + u * at(1, 0)[axis])
                        + v * ((1.0 - u) * at(0, 1)[axis] + u * at(1, 1)[axis])
                };
                // How many film cells a cell spans, across and down.
                let spans = [
                    cells * (at(1, 0)[0] - at(0, 0)[0] + at(1, 1)[0] - at(0, 1)[0]) * 0.5,
                    cells * (at(0, 1)[1] - at(0, 0)[1] + at(1, 1)[1] - at(1, 0)[1]) * 0.5,
                ];
                for (cell, out) in out[x * scale..(x + 1) * scale].iter_mut().enumerate() {
                    let u = (cell as f64 + 0.5) * cells;
                    *out = mean(plane, [mix(0, u), mix(1, u)], spans);
                }
            }
        });
        Plane::from_samples(plane.width(), plane.height(), samples)
    };
    Film { oversampling: film.oversampling, radiance: film.radiance.each_ref().map(channel) }
}

/// The mean of a plane over a rectangle, in coordinates in which a cell's corner is at the integer.
fn mean(plane: &Plane<f32>, middle: [f64; 2], spans: [f64; 2]) -> f32 {
    let [(x, across), (y, down)] = [0, 1].map(|axis| {
        let half = 0.5 * spans[axis].abs().clamp(1e-3, 3.0);
        let (from, to) = (middle[axis] - half, middle[axis] + half);
        #[allow(clippy::cast_possible_truncation, reason = "saturates, then clamps to the border")]
        let first = from.floor() as isize;
        let shares = [0.0, 1.0, 2.0, 3.0].map(|step| {
            let low = from.floor() + step;
            ((to.min(low + 1.0) - from.max(low)).max(0.0)) / (to - from)
        });
        (first, shares)
    });
    let mut sum = 0.0;
    for (dy, down) in (0..).zip(down) {
        for (dx, across) in (0..).zip(across) {
            if across * down > 0.0 {
                let at = plane.at_replicated(x.saturating_add(dx), y.saturating_add(dy));
                sum += across * down * f64::from(at);
            }
        }
    }
    #[allow(clippy::cast_possible_truncation, reason = "a mean of f32 values fits f32")]
    let sum = sum as f32;
    sum
}
