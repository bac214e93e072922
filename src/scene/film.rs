//! Film: linear radiance on a grid finer than the sensor's.

use crate::image::Plane;

/// Linear Rec. 709 radiance, `oversampling` times finer than the sensor in each direction.
#[derive(Clone, Debug)]
pub struct Film {
    /// Film cells per pixel and direction.
    pub oversampling: u32,
    /// Red, green and blue radiance.
    pub radiance: [Plane<f32>; 3],
}

/// How much of each film cell regions of the target fill, as seen, in the fovea.
#[derive(Clone, Debug)]
pub struct Coverage {
    /// Where: first column, first row, one past the last column and row \[px\].
    pub fovea_px: [u32; 4],
    /// Film cells per pixel and direction.
    pub oversampling: u32,
    /// Of a cuboid the faces that look at the camera, in the order of their index; of a board its
    /// black squares and the rest of it. Each in \[0, 1\].
    pub regions: [Plane<f32>; 3],
}

impl Film {
    /// One channel at sensor resolution: the mean of each pixel's film cells.
    #[allow(clippy::cast_possible_truncation, reason = "a mean of f32 values fits f32")]
    pub fn binned(&self, channel: usize) -> Plane<f32> {
        let fine = &self.radiance[channel];
        let cells = self.oversampling as usize;
        let scale = 1.0 / f64::from(self.oversampling * self.oversampling);
        let mut sums = vec![0.0_f64; fine.width() / cells];
        let mut binned = Plane::filled(fine.width() / cells, fine.height() / cells, 0.0);
        for y in 0..binned.height() {
            sums.fill(0.0);
            for row in 0..cells {
                for (sum, run) in sums.iter_mut().zip(fine.row(y * cells + row).chunks_exact(cells))
                {
                    *sum += run.iter().map(|&value| f64::from(value)).sum::<f64>();
                }
            }
            for (pixel, sum) in binned.row_mut(y).iter_mut().zip(&sums) {
                *pixel = (sum * scale) as f32;
            }
        }
        binned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_is_the_mean_of_its_own_cells() {
        #[allow(clippy::cast_precision_loss, reason = "small numbers")]
        let plane = Plane::from_fn(4, 4, |x, y| (x + 4 * y) as f32);
        let film = Film { oversampling: 2, radiance: [plane.clone(), plane.clone(), plane] };
        assert_eq!(film.binned(0).samples(), [2.5, 4.5, 10.5, 12.5]);
    }
}
