//! Taking range images: what the range sensor's rays meet, as a real sensor tells it.
//!
//! A cell reports one depth along its central ray: the mean over its footprint, with noise, in steps.
//! So a cell that sees an edge reports a depth at which there is nothing, unless the sensor drops it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::noise::normals;
use super::range::{DepthNoise, RangeImage};
use crate::error::{Error, Result};
use crate::geometry::{Camera, ImagePoint, Pose};
use crate::image::Plane;
use crate::random::Stream;
use crate::scene::RangeRays;

/// How a range sensor turns what its rays meet into points. What is not given is ideal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(title = "Range sensor")]
pub struct RangeSensor {
    /// One line for `cornerbench list`.
    pub summary: String,
    /// Columns of cells, which share the field of view of the dataset's sensor; 0: as many as that has.
    #[schemars(range(min = 0, max = 16384))]
    pub width: u32,
    /// Rows of cells, likewise.
    #[schemars(range(min = 0, max = 16384))]
    pub height: u32,
    /// Share of a cell's side over which it averages, about its centre; of 0 it has one ray.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub footprint: f64,
    /// Standard deviation of depth: this \[m\],
    #[schemars(range(min = 0.0, max = 10.0))]
    pub noise_m: f64,
    /// and this share of the depth,
    #[schemars(range(min = 0.0, max = 1.0))]
    pub noise_share: f64,
    /// and this times the square of the depth \[1/m\].
    #[schemars(range(min = 0.0, max = 10.0))]
    pub noise_per_m: f64,
    /// Steps of depth \[m\]; 0: none.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub quantum_m: f64,
    /// Steps of the inverse of depth \[1/m\]; 0: none.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub inverse_quantum_per_m: f64,
    /// Smaller depths are not reported \[m\].
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub min_depth_m: f64,
    /// Larger depths are not reported \[m\].
    #[schemars(range(min = 0.001, max = 1000.0))]
    pub max_depth_m: f64,
    /// A cell reports nothing where depths in its footprint differ by more than this \[m\]; 0: it always does.
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub most_spread_m: f64,
    /// Probability that a cell reports nothing, whatever it sees.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub dropout: f64,
    /// How far to the right of the sensor a projector stands, without which nothing is seen \[m\];
    /// negative: to the left; 0: there is none.
    #[schemars(range(min = -10.0, max = 10.0))]
    pub baseline_m: f64,
}

impl Default for RangeSensor {
    fn default() -> Self {
        Self {
            summary: String::new(),
            width: 0,
            height: 0,
            footprint: 1.0,
            noise_m: 0.0,
            noise_share: 0.0,
            noise_per_m: 0.0,
            quantum_m: 0.0,
            inverse_quantum_per_m: 0.0,
            min_depth_m: 0.0,
            max_depth_m: 1000.0,
            most_spread_m: 0.0,
            dropout: 0.0,
            baseline_m: 0.0,
        }
    }
}

/// A cell reports nothing if less than this share of its footprint meets anything.
const LEAST_SHARE: f64 = 0.5;

impl RangeSensor {
    /// Checks what concerns several keys at once.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] with key, found, allowed.
    pub fn check(&self, place: &str) -> Result<()> {
        let out = |key: &str, found: String, allowed: &str| {
            Err(Error::out_of_range(place, key, found, allowed))
        };
        if (self.width == 0) != (self.height == 0) {
            let found = format!("{} x {}", self.width, self.height);
            return out("width", found, "0 where height is 0, and only there");
        }
        if self.min_depth_m >= self.max_depth_m {
            let allowed = format!("below max_depth_m, {}", self.max_depth_m);
            return out("min_depth_m", self.min_depth_m.to_string(), &allowed);
        }
        Ok(())
    }

    /// What a data sheet says of its noise.
    pub fn noise(&self) -> DepthNoise {
        DepthNoise {
            noise_m: self.noise_m,
            noise_share: self.noise_share,
            noise_per_m: self.noise_per_m,
            quantum_m: self.quantum_m,
            inverse_quantum_per_m: self.inverse_quantum_per_m,
        }
    }

    /// The range image of a scene. `camera` is the dataset's range sensor, whose field of view this one
    /// shares; `name` names the noise: the scene, and whatever else tells this image from others.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] when it has more cells than the dataset has rays.
    pub fn measure(
        &self,
        rays: &RangeRays,
        camera: &Camera,
        world_from_range: Pose,
        name: &[&str],
    ) -> Result<RangeImage> {
        let fine = [rays.depth_m.width(), rays.depth_m.height()];
        let size = match (self.width as usize, self.height as usize) {
            (0, _) | (_, 0) => [rays.points.width(), rays.points.height()],
            (width, height) => [width, height],
        };
        if size[0] > fine[0] || size[1] > fine[1] {
            return Err(Error::out_of_range(
                "range sensor",
                "width, height",
                format!("{} x {} cells", size[0], size[1]),
                format!("at most {} x {}, the dataset's rays", fine[0], fine[1]),
            ));
        }
        let own = camera.resized(size);
        let lit = lit(&rays.depth_m, camera.resized(fine).fx_px, self.baseline_m);
        // One ray through the centre: the dataset has it where the cells are its own.
        let has_centres = self.footprint == 0.0
            && self.baseline_m == 0.0
            && size == [rays.points.width(), rays.points.height()];
        let named = |kind| Stream::named(&[name, &["range", kind]].concat());
        let (mut noise, mut dropout) = (named("noise"), named("dropout"));
        let (mut words, mut deviates) = (vec![0; size[0]], vec![0.0; size[0]]);
        let (model, mut points) = (self.noise(), Vec::with_capacity(size[0] * size[1]));
        for y in 0..size[1] {
            noise.words(y << 16, &mut words);
            normals(&words, &mut deviates);
            dropout.words(y << 16, &mut words);
            for x in 0..size[0] {
                let seen_m = if has_centres {
                    rays.points.at(x, y).map(|point| point.z)
                } else {
                    self.averaged(&lit, size, [x, y])
                };
                let told_m = seen_m
                    .filter(|_| f64::from(words[x]) >= self.dropout * 2.0_f64.powi(32))
                    .map(|depth| depth + model.standard_deviation_m(depth) * f64::from(deviates[x]))
                    .and_then(|depth_m| self.quantised(depth_m));
                let cell = ImagePoint::new(x as f64, y as f64);
                points.push(told_m.map(|depth_m| own.unproject(cell, depth_m)));
            }
        }
        Ok(RangeImage {
            camera: own,
            world_from_range,
            points: Plane::from_samples(size[0], size[1], points),
            noise: model,
        })
    }

    /// The mean depth in the footprint of a cell, of a grid of `size` cells \[m\].
    fn averaged(&self, depth_m: &Plane<f32>, size: [usize; 2], cell: [usize; 2]) -> Option<f64> {
        let fine = [depth_m.width(), depth_m.height()];
        // The rays whose squares the footprint overlaps, and by how much.
        let [across, down] = [0, 1].map(|axis| {
            let side = fine[axis] as f64 / size[axis] as f64;
            let middle = (cell[axis] as f64 + 0.5) * side;
            let half = 0.5 * (self.footprint * side).max(1e-6);
            let (from, to) = (middle - half, middle + half);
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "in the grid"
            )]
            let range = (from.max(0.0) as usize)..(to.ceil() as usize).min(fine[axis]);
            range.map(move |ray| (ray, (to.min(ray as f64 + 1.0) - from.max(ray as f64)).max(0.0)))
        });
        let (mut all, mut met, mut sum) = (0.0, 0.0, 0.0);
        let (mut near, mut far) = (f64::INFINITY, 0.0_f64);
        for (y, high) in down {
            for (x, wide) in across.clone() {
                let (weight, depth) = (high * wide, f64::from(depth_m.at(x, y)));
                all += weight;
                if depth > 0.0 && weight > 0.0 {
                    met += weight;
                    sum += weight * depth;
                    (near, far) = (near.min(depth), far.max(depth));
                }
            }
        }
        let is_mixed = self.most_spread_m > 0.0 && far - near > self.most_spread_m;
        (met > 0.0 && met >= LEAST_SHARE * all && !is_mixed).then(|| sum / met)
    }

    /// A depth as it is told \[m\].
    fn quantised(&self, depth_m: f64) -> Option<f64> {
        let rounded = |value: f64, step: f64| {
            if step > 0.0 { (value / step).round() * step } else { value }
        };
        let inverse = rounded(1.0 / depth_m, self.inverse_quantum_per_m);
        let told_m = match self.inverse_quantum_per_m > 0.0 {
            true => rounded(1.0 / inverse, self.quantum_m),
            false => rounded(depth_m, self.quantum_m),
        };
        let is_told = depth_m > 0.0 && told_m.is_finite() && told_m > 0.0;
        (is_told && (self.min_depth_m..=self.max_depth_m).contains(&told_m)).then_some(told_m)
    }
}

/// Depths \[m\] with 0 where a projector, `baseline_m` to the right of the sensor, does not reach: where
/// what is nearer stands in between. Only what the sensor itself sees casts shadows.
fn lit(depth_m: &Plane<f32>, focal_px: f64, baseline_m: f64) -> Plane<f32> {
    let mut lit = depth_m.clone();
    if baseline_m == 0.0 {
        return lit;
    }
    let width = lit.width();
    for y in 0..lit.height() {
        let row = lit.row_mut(y);
        // From the projector's side on, what is lit comes in the order in which the projector sees it.
        let mut last_px = f64::INFINITY;
        for step in 0..width {
            let x = if baseline_m > 0.0 { width - 1 - step } else { step };
            if row[x] <= 0.0 {
                continue;
            }
            let seen_px = x as f64 - focal_px * baseline_m / f64::from(row[x]);
            let place_px = if baseline_m > 0.0 { seen_px } else { -seen_px };
            if place_px > last_px {
                row[x] = 0.0;
            } else {
                last_px = place_px;
            }
        }
    }
    lit
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera = Camera::pinhole(32, 24, 30.0);

    /// Eight rays across each cell and down, with a depth by column and row; points on the central rays.
    fn rays(depth_m: impl Fn(usize, usize) -> f32) -> RangeRays {
        let centre = |x: usize, y: usize| {
            let depth_m = f64::from(depth_m(8 * x + 4, 8 * y + 4));
            (depth_m > 0.0).then(|| CAMERA.unproject(ImagePoint::new(x as f64, y as f64), depth_m))
        };
        RangeRays {
            points: Plane::from_fn(32, 24, centre),
            depth_m: Plane::from_fn(8 * 32, 8 * 24, depth_m),
        }
    }

    fn taken(sensor: &RangeSensor, rays: &RangeRays, name: &str) -> RangeImage {
        sensor.measure(rays, &CAMERA, Pose::identity(), &[name]).expect("a range image")
    }

    fn depth_m(image: &RangeImage, x: usize, y: usize) -> Option<f64> {
        image.points.at(x, y).map(|point| point.z)
    }

    #[test]
    fn a_sensor_of_one_ray_a_cell_gives_the_dataset_s_points() {
        let rays = rays(|x, y| 1.0 + 0.01 * x as f32 + 0.02 * y as f32);
        let ideal = RangeSensor { footprint: 0.0, ..RangeSensor::default() };
        let image = taken(&ideal, &rays, "scene");
        assert_eq!(image.camera, CAMERA);
        for (found, wanted) in image.points.samples().iter().zip(rays.points.samples()) {
            let (found, wanted) = (found.expect("a point"), wanted.expect("a point"));
            assert!((found - wanted).norm() < 1e-12);
        }
    }

    #[test]
    fn a_cell_on_an_edge_mixes_near_and_far_by_their_shares() {
        // The edge is after three of the eight columns of cell 10; cells 9 and 11 see one side each.
        let rays = rays(|x, _| if x < 83 { 1.0 } else { 2.0 });
        let image = taken(&RangeSensor::default(), &rays, "scene");
        for (x, wanted) in [(9, 1.0), (10, 3.0 / 8.0 + 2.0 * 5.0 / 8.0), (11, 2.0)] {
            let point = image.points.at(x, 7).expect("a point");
            assert!((point.z - wanted).abs() < 1e-6, "{x}: {}", point.z);
            let cell = CAMERA.project(&point).expect("in front");
            assert!((cell.x - x as f64).abs() < 1e-9 && (cell.y - 7.0).abs() < 1e-9);
        }
        // The middle quarter of the cell is all beyond the edge, but for half a ray.
        let narrow = RangeSensor { footprint: 0.25, ..RangeSensor::default() };
        assert!((depth_m(&taken(&narrow, &rays, "scene"), 10, 7).expect("one") - 2.0).abs() < 1e-6);
        let strict = RangeSensor { most_spread_m: 0.5, ..RangeSensor::default() };
        let image = taken(&strict, &rays, "scene");
        assert_eq!(depth_m(&image, 10, 7), None);
        assert!(depth_m(&image, 9, 7).is_some() && depth_m(&image, 11, 7).is_some());
    }

    #[test]
    fn a_cell_needs_half_of_its_footprint_to_meet_something() {
        let with = |columns: usize| {
            let rays = rays(|x, _| if x % 8 < columns { 1.5 } else { 0.0 });
            depth_m(&taken(&RangeSensor::default(), &rays, "scene"), 5, 5)
        };
        assert_eq!(with(3), None);
        assert!((with(4).expect("half") - 1.5).abs() < 1e-6);
    }

    #[test]
    fn any_number_of_cells_shares_the_field_of_view() {
        let rays = rays(|x, y| 1.0 + 0.003 * x as f32 + 0.002 * y as f32);
        let all: f64 = rays.depth_m.samples().iter().map(|&depth| f64::from(depth)).sum();
        let mean = all / (256.0 * 192.0);
        for (width, height) in [(8, 8), (20, 14), (256, 192), (1, 1)] {
            let sensor = RangeSensor { width, height, ..RangeSensor::default() };
            let image = taken(&sensor, &rays, "scene");
            assert_eq!((image.camera.width, image.camera.height), (width, height));
            let found: f64 = image.points.samples().iter().flatten().map(|point| point.z).sum();
            let found = found / f64::from(width * height);
            assert!((found / mean - 1.0).abs() < 1e-6, "{width} x {height}: {found} {mean}");
            // The sensor's corners look where the dataset's do.
            for (x, y) in [(0.0, 0.0), (1.0, 1.0)] {
                let corner = |camera: &Camera| {
                    camera.ray(ImagePoint::new(
                        x * f64::from(camera.width) - 0.5,
                        y * f64::from(camera.height) - 0.5,
                    ))
                };
                assert!((corner(&image.camera) - corner(&CAMERA)).norm() < 1e-12);
            }
        }
        let sensor = RangeSensor { width: 300, height: 100, ..RangeSensor::default() };
        let problem = sensor.measure(&rays, &CAMERA, Pose::identity(), &[]).expect_err("too many");
        assert!(problem.to_string().contains("at most 256 x 192"), "{problem}");
    }

    #[test]
    fn noise_grows_with_depth_as_the_data_sheet_says() {
        let sensor = RangeSensor {
            noise_m: 0.001,
            noise_share: 0.004,
            noise_per_m: 0.002,
            ..RangeSensor::default()
        };
        for depth in [0.5_f32, 1.0, 3.0] {
            let rays = rays(|_, _| depth);
            let far: Vec<f64> = (0..40)
                .flat_map(|number| {
                    let image = taken(&sensor, &rays, &number.to_string());
                    let samples = image.points.samples().to_vec();
                    samples.into_iter().flatten().map(|point| point.z - f64::from(depth))
                })
                .collect();
            let count = far.len() as f64;
            let wanted = 0.001 + 0.004 * f64::from(depth) + 0.002 * f64::from(depth * depth);
            let deviation = (far.iter().map(|value| value * value).sum::<f64>() / count).sqrt();
            assert!((deviation / wanted - 1.0).abs() < 4.0 / (2.0 * count).sqrt(), "{deviation}");
            let mean = far.iter().sum::<f64>() / count;
            assert!(mean.abs() < 4.0 * wanted / count.sqrt(), "{mean}");
        }
    }

    #[test]
    fn depths_come_in_steps_of_depth_or_of_its_inverse() {
        let rays = rays(|x, y| 0.7 + 0.001 * (x + 3 * y) as f32);
        let steps = |sensor: &RangeSensor, of: fn(f64) -> f64, step: f64| {
            let image = taken(sensor, &rays, "scene");
            let exact = taken(&RangeSensor::default(), &rays, "scene");
            for (told, exact) in image.points.samples().iter().zip(exact.points.samples()) {
                let (told, exact) = (of(told.expect("one").z), of(exact.expect("one").z));
                assert!((told / step - (told / step).round()).abs() < 1e-6, "{told}");
                assert!((told - exact).abs() <= 0.5 * step + 1e-9, "{told} {exact}");
            }
        };
        let depth = RangeSensor { quantum_m: 0.01, ..RangeSensor::default() };
        steps(&depth, |depth| depth, 0.01);
        let inverse = RangeSensor { inverse_quantum_per_m: 0.003, ..RangeSensor::default() };
        steps(&inverse, |depth| 1.0 / depth, 0.003);
    }

    #[test]
    fn cells_drop_out_by_chance_and_leave_the_others_as_they_were() {
        let rays = rays(|_, _| 1.2);
        let noisy = RangeSensor { noise_m: 0.01, ..RangeSensor::default() };
        let silent = RangeSensor { dropout: 0.1, ..noisy.clone() };
        let (mut dropped, mut all) = (0.0, 0.0);
        for number in 0..20 {
            let name = number.to_string();
            let (whole, holed) = (taken(&noisy, &rays, &name), taken(&silent, &rays, &name));
            for (whole, holed) in whole.points.samples().iter().zip(holed.points.samples()) {
                all += 1.0;
                match holed {
                    None => dropped += 1.0,
                    Some(_) => assert_eq!(holed, whole),
                }
            }
        }
        let share = dropped / all;
        let error = (0.1_f64 * 0.9 / all).sqrt();
        assert!((share - 0.1).abs() < 4.0 * error, "{share}");
    }

    #[test]
    fn what_is_out_of_range_is_not_told() {
        let rays = rays(|x, _| 0.01 * (x as f32 + 1.0));
        let sensor = RangeSensor { min_depth_m: 0.5, max_depth_m: 2.0, ..RangeSensor::default() };
        let image = taken(&sensor, &rays, "scene");
        let told = |x: usize| image.points.at(x, 3).is_some();
        assert!(!told(5) && told(7) && told(24) && !told(25));
    }

    #[test]
    fn the_projector_s_shadow_falls_on_its_far_side() {
        // A box at 1 m in columns 96 to 159 of rays, before a wall at 2 m.
        let rays = rays(|x, _| if (96..160).contains(&x) { 1.0 } else { 2.0 });
        let shadowed = |baseline_m: f64| {
            let sensor =
                RangeSensor { width: 256, height: 192, baseline_m, ..RangeSensor::default() };
            let image = taken(&sensor, &rays, "scene");
            (0..256).filter(|&x| image.points.at(x, 50).is_none()).collect::<Vec<_>>()
        };
        // Of a projector at the right the light that passes the box's left side at 1 m meets the wall
        // at 2 m: 240 px of focal length times 0.105 m times (1 / 1 m - 1 / 2 m) = 12.6 columns further left.
        let left = shadowed(0.105);
        assert_eq!((left.first(), left.last(), left.len()), (Some(&84), Some(&95), 12));
        let right = shadowed(-0.105);
        assert_eq!((right.first(), right.last(), right.len()), (Some(&160), Some(&171), 12));
        assert!(shadowed(0.0).is_empty());
    }
}
