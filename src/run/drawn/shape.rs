//! What is drawn: junctions of straight edges, sums of blurred sectors.

use std::f64::consts::TAU;

use crate::image::Plane;
use crate::junction::drawing::{Drawing, DrawingBuffers};
use crate::junction::rays::{MOST_RAYS, Rays};
use crate::plan::{Factors, Kind};
use crate::random::Stream;
use crate::scene::Film;

/// Size of the pictures along each side \[px\].
pub(super) const SIZE: usize = 64;

/// Film cells per pixel and direction, where there is a film.
pub(super) const OVERSAMPLING: u32 = 8;

/// Memory of drawings.
pub(super) type ShapeBuffers = DrawingBuffers;

/// A junction and what is about it: the sum of its parts.
pub(super) struct Shape {
    /// The first is the junction, of an X half of it.
    parts: Vec<Drawing>,
    rounding: Option<Rounding>,
}

/// The circle that rounds a corner.
struct Rounding {
    centre: [f64; 2],
    radius_px: f64,
    /// Unit vector from the corner to the centre.
    inward: [f64; 2],
    /// How far from the corner along that vector the circle ends.
    until_px: f64,
    /// Value and ramp inside less those outside.
    difference: f64,
    ramp: [f64; 2],
}

impl Shape {
    /// The junction of a cell with its vertex there, its first edge turned so far from x right towards y down.
    pub fn new(factors: &Factors, vertex: [f64; 2], turn_rad: f64, random: &mut Stream) -> Self {
        let contrast = factors.contrast();
        let ramps = [(); MOST_RAYS].map(|()| {
            let (sine, cosine) = (TAU * random.uniform()).sin_cos();
            [cosine, sine].map(|share| factors.ramp_per_px * contrast * share)
        });
        // Nowhere in the picture a ramp leads below black.
        let lift = factors.ramp_per_px * contrast * SIZE as f64 * std::f64::consts::FRAC_1_SQRT_2;
        let levels = factors.junction.levels().map(|level| level + lift);
        let directions = factors.directions_deg();
        let mut angles_rad = [0.0; MOST_RAYS];
        for (angle, degrees) in angles_rad.iter_mut().zip(&directions) {
            *angle = degrees.to_radians() + turn_rad;
        }
        let rays = Rays { vertex, sigma_px: 0.0, count: directions.len(), angles_rad };
        let own = Drawing { rays, levels, ramps };
        let alone = |rays: Rays, level: f64, ramp: [f64; 2]| Drawing {
            rays,
            levels: [level, 0.0, 0.0],
            ramps: [ramp, [0.0; 2], [0.0; 2]],
        };
        let step = levels[0] - levels[1];
        let steeper = [0, 1].map(|axis: usize| ramps[0][axis] - ramps[1][axis]);
        let mut parts = vec![own];
        if factors.junction == Kind::X {
            let angles_rad = angles_rad.map(|angle| angle + 0.5 * TAU);
            parts.push(alone(Rays { angles_rad, ..rays }, step, ramps[2]));
        }
        if let Some(far_px) = factors.neighbour_px {
            let (sine, cosine) = angles_rad[0].sin_cos();
            let shift = [far_px * cosine, far_px * sine];
            let there = [0, 1].map(|axis: usize| vertex[axis] + shift[axis]);
            let level = step + steeper[0] * shift[0] + steeper[1] * shift[1];
            let taken = alone(Rays { vertex: there, ..rays }, -level, steeper.map(|ramp| -ramp));
            parts.push(taken);
        }
        let half_rad = 0.5 * factors.angle_deg().to_radians();
        let middle = angles_rad[0] + half_rad;
        let inward = [middle.cos(), middle.sin()];
        let rounding = (factors.rounding_px > 0.0).then(|| {
            let radius_px = factors.rounding_px;
            let to_centre_px = radius_px / half_rad.sin();
            Rounding {
                centre: [0, 1].map(|axis: usize| vertex[axis] + to_centre_px * inward[axis]),
                radius_px,
                inward,
                until_px: radius_px / half_rad.tan() * half_rad.cos(),
                difference: step,
                ramp: steeper,
            }
        });
        Self { parts, rounding }
    }

    /// The junction's edges, with this blur \[px\].
    pub fn rays(&self, sigma_px: f64) -> Rays {
        Rays { sigma_px, ..self.parts[0].rays }
    }

    /// The light on pixels, blurred by a Gaussian; without rounding.
    pub fn over_pixels(&self, sigma_px: f64, buffers: &mut ShapeBuffers) -> Plane<f32> {
        let drawn = |part: &Drawing, buffers: &mut ShapeBuffers| {
            let rays = Rays { sigma_px, ..part.rays };
            Drawing { rays, ..*part }.over_pixels([SIZE, SIZE], buffers)
        };
        let mut sum = drawn(&self.parts[0], buffers);
        for part in &self.parts[1..] {
            let more = drawn(part, buffers);
            for (sum, more) in sum.samples_mut().iter_mut().zip(more.samples()) {
                *sum += more;
            }
        }
        sum
    }

    /// The sharp picture on a film, of so much light in each colour.
    pub fn film(&self, shares: [f32; 3]) -> Film {
        let sharp = Sharp::of(self);
        let cells = SIZE * OVERSAMPLING as usize;
        let size_px = 1.0 / f64::from(OVERSAMPLING);
        // A film's image starts at the corner of its first cell, a photograph's in the middle of its first pixel.
        let at = |index: usize, share: f64| (index as f64 + share) * size_px - 0.5;
        let plane = Plane::from_fn(cells, cells, |x, y| {
            let middle = [at(x, 0.5), at(y, 0.5)];
            let value = if sharp.is_even(middle, size_px) {
                sharp.value(middle)
            } else {
                mean(|column, row| sharp.value([at(x, column), at(y, row)]))
            };
            #[allow(clippy::cast_possible_truncation, reason = "radiance is kept as f32")]
            let value = value as f32;
            value
        });
        Film {
            oversampling: OVERSAMPLING,
            radiance: shares.map(|share| plane.map(|sample| share * sample)),
        }
    }
}

/// The mean over a cell of the film, whose points are given by shares of its size.
fn mean(value: impl Fn(f64, f64) -> f64) -> f64 {
    const ALONG: u32 = 8;
    let share = |index: u32| (f64::from(index) + 0.5) / f64::from(ALONG);
    let of_row = |row| (0..ALONG).map(|column| value(share(column), share(row))).sum::<f64>();
    (0..ALONG).map(of_row).sum::<f64>() / f64::from(ALONG * ALONG)
}

/// A shape without blur.
struct Sharp<'a> {
    /// Each with the directions of its edges.
    parts: Vec<(&'a Drawing, [[f64; 2]; MOST_RAYS])>,
    rounding: Option<&'a Rounding>,
}

/// How far a point is to the right of a direction, seen along it, x being right and y down.
fn right_of([x, y]: [f64; 2], [dx, dy]: [f64; 2]) -> f64 {
    dy * x - dx * y
}

impl<'a> Sharp<'a> {
    fn of(shape: &'a Shape) -> Self {
        let directions = |part: &Drawing| part.rays.angles_rad.map(|a| [a.cos(), a.sin()]);
        let parts = shape.parts.iter().map(|part| (part, directions(part))).collect();
        Self { parts, rounding: shape.rounding.as_ref() }
    }

    /// Whether no edge is within a cell's size.
    fn is_even(&self, [x, y]: [f64; 2], size_px: f64) -> bool {
        let is_far = |(part, directions): &(&Drawing, [[f64; 2]; MOST_RAYS])| {
            let from = [x - part.rays.vertex[0], y - part.rays.vertex[1]];
            directions[..part.rays.count].iter().all(|direction| {
                let along_px = direction[0] * from[0] + direction[1] * from[1];
                right_of(*direction, from).abs() > size_px || along_px < -size_px
            })
        };
        let is_far_from_circle = |rounding: &&Rounding| {
            let [cx, cy] = rounding.centre;
            ((x - cx).hypot(y - cy) - rounding.radius_px).abs() > size_px
        };
        self.parts.iter().all(is_far) && self.rounding.as_ref().is_none_or(is_far_from_circle)
    }

    /// The picture at a point.
    fn value(&self, point: [f64; 2]) -> f64 {
        let of_part = |(part, directions): &(&Drawing, [[f64; 2]; MOST_RAYS])| {
            let from = [0, 1].map(|axis: usize| point[axis] - part.rays.vertex[axis]);
            // The last is where no other one is.
            let sector = (0..part.rays.count - 1)
                .find(|sector| is_inside(&part.rays, directions, *sector, from))
                .unwrap_or(part.rays.count - 1);
            let [ramp_x, ramp_y] = part.ramps[sector];
            part.levels[sector] + ramp_x * from[0] + ramp_y * from[1]
        };
        let sum: f64 = self.parts.iter().map(of_part).sum();
        sum - self.rounding.map_or(0.0, |rounding| self.rounded_off(rounding, point))
    }

    /// What rounding takes away at a point.
    fn rounded_off(&self, rounding: &Rounding, [x, y]: [f64; 2]) -> f64 {
        let (part, directions) = &self.parts[0];
        let from = [x - part.rays.vertex[0], y - part.rays.vertex[1]];
        let along_px = from[0] * rounding.inward[0] + from[1] * rounding.inward[1];
        let [cx, cy] = rounding.centre;
        let is_tip = along_px < rounding.until_px && (x - cx).hypot(y - cy) > rounding.radius_px;
        if is_tip && is_inside(&part.rays, directions, 0, from) {
            rounding.difference + rounding.ramp[0] * from[0] + rounding.ramp[1] * from[1]
        } else {
            0.0
        }
    }
}

/// Whether a point, seen from the vertex, is in a sector.
fn is_inside(
    rays: &Rays,
    directions: &[[f64; 2]; MOST_RAYS],
    sector: usize,
    from: [f64; 2],
) -> bool {
    let is_behind = right_of(directions[sector], from) >= 0.0;
    let is_before = right_of(directions[rays.next(sector)], from) < 0.0;
    if rays.opening_rad(sector) < 0.5 * TAU {
        is_behind && is_before
    } else {
        is_behind || is_before
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::{CameraModel, Optics, PhotographBuffers, Photographer, Shot};

    fn shape(factors: &Factors, turn_rad: f64) -> Shape {
        Shape::new(factors, [31.3, 31.8], turn_rad, &mut Stream::named(&["shape"]))
    }

    /// All that a film can show and the closed form knows, too.
    fn known() -> Vec<Factors> {
        let kinds = [Kind::L, Kind::Y, Kind::Arrow, Kind::T, Kind::X];
        let mut all: Vec<Factors> = kinds
            .into_iter()
            .flat_map(|junction| {
                [0.0, 0.01].map(|ramp_per_px| Factors {
                    junction,
                    ramp_per_px,
                    ..Factors::default()
                })
            })
            .collect();
        for angle_deg in [Some(40.0), Some(150.0)] {
            all.push(Factors { angle_deg, ..Factors::default() });
            let neighbour_px = Some(6.5);
            let ramp_per_px = 0.01;
            all.push(Factors { angle_deg, neighbour_px, ramp_per_px, ..Factors::default() });
        }
        all
    }

    #[test]
    fn film_and_closed_form_are_the_same_picture() {
        const SIGMA_PX: f64 = 0.8;
        let optics = Optics { gaussian_sigma_px: SIGMA_PX, ..Optics::default() };
        let camera = Photographer::new("", &CameraModel { optics, ..CameraModel::default() }, None);
        let kernel = camera.kernel(OVERSAMPLING, [0.0; 2]);
        for (index, factors) in known().iter().enumerate() {
            let shape = shape(factors, 0.3 + 0.7 * index as f64);
            // What a film cell's own area blurs.
            let cell_px = 1.0 / f64::from(OVERSAMPLING) / 12.0_f64.sqrt();
            let closed = shape.over_pixels(SIGMA_PX.hypot(cell_px), &mut ShapeBuffers::default());
            let film = shape.film([1.0; 3]);
            let shot = Shot { name: &[""], window: None };
            let mut buffers = PhotographBuffers::default();
            let frame = crate::run::drawn::frame();
            let light = camera.expose(&film, &frame, &kernel, &shot, &mut buffers).light;
            for y in 8..SIZE - 8 {
                for x in 8..SIZE - 8 {
                    let (found, wanted) = (light[0].at(x, y), closed.at(x, y));
                    assert!(
                        (found - wanted).abs() < 1.5e-3,
                        "{factors:?}: {found} {wanted} at {x}, {y}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_rounded_corner_loses_what_its_circle_leaves() {
        for angle_deg in [60.0, 90.0, 120.0_f64] {
            let sharp = Factors { angle_deg: Some(angle_deg), ..Factors::default() };
            let round = Factors { rounding_px: 3.0, ..sharp.clone() };
            let [whole, left] = [&sharp, &round].map(|factors| {
                let film = shape(factors, 0.4).film([1.0; 3]);
                film.radiance[0].samples().iter().copied().map(f64::from).sum::<f64>()
            });
            // Two triangles up to the circle's centre, without its sector.
            let half_rad = 0.5 * angle_deg.to_radians();
            let area_px2 = 9.0 * (half_rad.tan().recip() - (0.25 * TAU - half_rad));
            let found_px2 = (whole - left) / 0.6 / f64::from(OVERSAMPLING).powi(2);
            assert!((found_px2 - area_px2).abs() < 0.01 * area_px2, "{found_px2} {area_px2}");
        }
    }
}
