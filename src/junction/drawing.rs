//! Pictures of junctions with ramps, fast: for experiments with thousands of them.

use super::rays::{Area, Fields, MOST_RAYS, Places, Rays};
use crate::image::Plane;

/// A junction, blurred, whose sectors may be brighter towards one side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drawing {
    /// Its rays and the blur of the optics, the pixel's area not included.
    pub rays: Rays,
    /// Of each sector its value at the vertex.
    pub levels: [f64; MOST_RAYS],
    /// Of each sector how its value changes along x and y \[1/px\].
    pub ramps: [[f64; 2]; MOST_RAYS],
}

/// Memory of drawings; one serves all.
#[derive(Clone, Debug, Default)]
pub struct DrawingBuffers {
    places: Places,
    fields: Fields,
    sums: Vec<f64>,
}

/// Nodes and weights of Gauss and Legendre on a pixel, three of them.
const NODES: [(f64, f64); 3] = [
    (-0.387_298_334_620_741_7, 5.0 / 18.0),
    (0.0, 8.0 / 18.0),
    (0.387_298_334_620_741_7, 5.0 / 18.0),
];

impl Drawing {
    /// The means over pixels, whose area is that of the grid: to 6e-5 of the largest step where the blur is
    /// half a pixel or more.
    pub fn over_pixels(
        &self,
        [width, height]: [usize; 2],
        buffers: &mut DrawingBuffers,
    ) -> Plane<f32> {
        let count = width * height;
        let DrawingBuffers { places, fields, sums } = buffers;
        sums.clear();
        sums.resize(count, 0.0);
        for (right, of_column) in NODES {
            for (down, of_row) in NODES {
                places.fill(width, height, [right, down]);
                fields.compute(&self.rays, places, Area::Point);
                for (index, sum) in sums.iter_mut().enumerate() {
                    *sum += of_column * of_row * self.value(fields, places, index);
                }
            }
        }
        #[allow(clippy::cast_possible_truncation, reason = "samples are in single precision")]
        Plane::from_samples(width, height, sums.iter().map(|sum| *sum as f32).collect())
    }

    /// The value at one of the places.
    fn value(&self, fields: &Fields, places: &Places, index: usize) -> f64 {
        let rays = &self.rays;
        let dx = f64::from(places.x[index]) - rays.vertex[0];
        let dy = f64::from(places.y[index]) - rays.vertex[1];
        let mut sum = 0.0;
        for sector in 0..rays.count {
            let next = rays.next(sector);
            let share = f64::from(fields.share[sector][index]);
            let [line, other] =
                [sector, next].map(|ray| rays.sigma_px * f64::from(fields.line[ray][index]));
            let (sine, cosine) = rays.angles_rad[sector].sin_cos();
            let (next_sine, next_cosine) = rays.angles_rad[next].sin_cos();
            let along_x = dx * share - sine * line + next_sine * other;
            let along_y = dy * share + cosine * line - next_cosine * other;
            let [ramp_x, ramp_y] = self.ramps[sector];
            sum += self.levels[sector] * share + ramp_x * along_x + ramp_y * along_y;
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::ImagePoint;
    use crate::junction::BlurredJunction;

    fn drawing(angles_deg: &[f64], sigma_px: f64) -> Drawing {
        let mut angles_rad = [0.0; MOST_RAYS];
        for (angle, degrees) in angles_rad.iter_mut().zip(angles_deg) {
            *angle = degrees.to_radians();
        }
        // A vertex on a pixel's centre, as rounded seeds are, or anywhere.
        let vertex = if sigma_px < 0.6 { [7.0, 6.0] } else { [7.23, 6.59] };
        let rays = Rays { vertex, sigma_px, count: angles_deg.len(), angles_rad };
        Drawing { rays, levels: [0.9, 0.4, 0.1], ramps: [[0.0; 2]; MOST_RAYS] }
    }

    /// Directions of rays: wide, narrow, straight and overhanging sectors.
    const ANGLES_DEG: [&[f64]; 6] = [
        &[10.0, 100.0],
        &[-40.0, 200.0],
        &[0.0, 180.0],
        &[7.0, 57.0, 117.0],
        &[10.0, 130.0, 250.0],
        &[30.0, 90.0, 210.0],
    ];

    #[test]
    fn drawn_pixels_are_those_of_the_closed_form() {
        for angles_deg in ANGLES_DEG {
            for sigma_px in [0.5, 0.8, 1.5] {
                let drawing = drawing(angles_deg, sigma_px);
                let Rays { vertex: [x, y], count, angles_rad, .. } = drawing.rays;
                let junction = BlurredJunction {
                    vertex: ImagePoint::new(x, y),
                    edges_rad: angles_rad[..count].to_vec(),
                    levels: drawing.levels[..count].to_vec(),
                    sigma_px,
                };
                let plane = drawing.over_pixels([15, 14], &mut DrawingBuffers::default());
                for y in 0..14 {
                    for x in 0..15 {
                        let wanted = junction.over_pixel(x, y, 1.0);
                        let found = f64::from(plane.at(x, y));
                        assert!((found - wanted).abs() < 6e-5, "{found} {wanted} at {x}, {y}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_pixel_s_square_is_a_gaussian_and_a_term_of_the_fourth_order() {
        let mut worst: [f64; 2] = [0.0; 2];
        for angles_deg in ANGLES_DEG {
            let drawing = drawing(angles_deg, 0.5);
            let plane = drawing.over_pixels([15, 14], &mut DrawingBuffers::default());
            let rays = Rays { sigma_px: 0.5_f64.hypot(12.0_f64.sqrt().recip()), ..drawing.rays };
            let mut places = Places::default();
            places.fill(15, 14, [0.0; 2]);
            let [alone, with_term] = [Area::Point, Area::Pixel].map(|area| {
                let mut fields = Fields::default();
                fields.compute(&rays, &places, area);
                let of = |index: usize| {
                    let shares = (0..rays.count).map(|sector| {
                        drawing.levels[sector] * f64::from(fields.share[sector][index])
                    });
                    (shares.sum::<f64>() - f64::from(plane.samples()[index])).abs()
                };
                (0..15 * 14).map(of).fold(0.0, f64::max)
            });
            worst = [worst[0].max(alone), worst[1].max(with_term)];
        }
        assert!(worst[1] < 4e-4 && worst[0] > 4.0 * worst[1], "{worst:?}");
    }

    #[test]
    fn a_sector_s_ramp_is_blurred_with_it() {
        // By brute force: the ramp within the sector, weighted by the blur's density on a fine grid.
        let sigma_px = 0.9;
        let mut drawing = drawing(&[20.0, 130.0, 250.0], sigma_px);
        drawing.levels = [0.0; MOST_RAYS];
        drawing.ramps[0] = [0.3, -0.2];
        let places = Places { x: vec![8.0; 16], y: vec![7.0; 16] };
        let mut fields = Fields::default();
        fields.compute(&drawing.rays, &places, Area::Point);
        let found = drawing.value(&fields, &places, 0);
        let step = 0.01;
        let mut wanted = 0.0;
        for row in -500..500 {
            for column in -500..500 {
                let offset = [column, row].map(|cell| step * (f64::from(cell) + 0.5));
                let dx = 8.0 + offset[0] - drawing.rays.vertex[0];
                let dy = 7.0 + offset[1] - drawing.rays.vertex[1];
                let angle = dy.atan2(dx).to_degrees();
                if (20.0..130.0).contains(&angle) {
                    let r2 = offset[0] * offset[0] + offset[1] * offset[1];
                    let density = (-0.5 * r2 / (sigma_px * sigma_px)).exp()
                        / (std::f64::consts::TAU * sigma_px * sigma_px);
                    wanted += (0.3 * dx - 0.2 * dy) * density * step * step;
                }
            }
        }
        assert!((found - wanted).abs() < 1e-4, "{found} {wanted}");
    }

    #[test]
    fn what_moves_a_sector_are_the_lines_and_moments_of_its_rays() {
        let places = Places {
            x: (0..16).map(|i| 3.0 + 0.5 * i as f32).collect(),
            y: (0..16).map(|i| 4.0 + 0.4 * ((7 * i) % 16) as f32).collect(),
        };
        let of = |rays: &Rays| {
            let mut fields = Fields::default();
            fields.compute(rays, &places, Area::Point);
            fields
        };
        let h = 3e-3;
        for angles_deg in ANGLES_DEG {
            let rays = drawing(angles_deg, 1.3).rays;
            let here = of(&rays);
            let difference = |change: &dyn Fn(&mut Rays, f64), sector: usize, index: usize| {
                let [less, more] = [-h, h].map(|step| {
                    let mut changed = rays;
                    change(&mut changed, step);
                    f64::from(of(&changed).share[sector][index])
                });
                (more - less) / (2.0 * h)
            };
            for sector in 0..rays.count {
                let next = rays.next(sector);
                for index in 0..16 {
                    let at =
                        |field: &[Vec<f32>; MOST_RAYS], ray: usize| f64::from(field[ray][index]);
                    let turned =
                        difference(&|rays, step| rays.angles_rad[sector] += step, sector, index);
                    assert!((turned + at(&here.moment, sector)).abs() < 2e-3, "{angles_deg:?}");
                    let moved = difference(&|rays, step| rays.vertex[0] += step, sector, index);
                    let [sine, next_sine] = [sector, next].map(|ray| rays.angles_rad[ray].sin());
                    let wanted = (sine * at(&here.line, sector) - next_sine * at(&here.line, next))
                        / rays.sigma_px;
                    assert!((moved - wanted).abs() < 2e-3, "{angles_deg:?}: {moved} {wanted}");
                    // dM/dphi of the blurred ray's first moment is its second one across.
                    let line = at(&here.line, sector);
                    assert!(at(&here.second_moment, sector) >= 0.0 && line >= 0.0);
                }
            }
        }
    }
}
