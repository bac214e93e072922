//! What the lens bends, and the truth with it.

use cornerbench::geometry::{Camera, Distortion, ImagePoint};
use cornerbench::image::Plane;
use cornerbench::scene::Film;
use cornerbench::sensor::{CameraModel, Photographer};
use nalgebra::{Matrix3, Vector3};

use super::{mean, pinhole};

/// Dots on a dark film, far from each other: places of their middles \[px\].
fn dots(camera: &Camera, oversampling: u32) -> (Film, Vec<ImagePoint>) {
    let scale = f64::from(oversampling);
    let (width, height) = (camera.width * oversampling, camera.height * oversampling);
    let mut plane = Plane::filled(width as usize, height as usize, 0.0_f32);
    let mut places = Vec::new();
    for row in 0..14_u32 {
        for column in 0..14_u32 {
            let number = row * 14 + column;
            // Squares of two pixels' side at 196 different sub-pixel places.
            let at = |index: u32, step: u32| {
                12.0 + 36.0 * f64::from(index) + f64::from(number * step % 197) / 197.0
            };
            let middle = ImagePoint::new(at(column, 61), at(row, 113));
            let [x, y] = middle.to_film(oversampling);
            let share = |cell: usize, middle: f64| {
                let (from, to) = (middle - scale, middle + scale);
                let cell = cell as f64;
                (to.min(cell + 1.0) - from.max(cell)).clamp(0.0, 1.0)
            };
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside")]
            let first = |middle: f64| (middle - scale).floor() as usize;
            let span = 2 * oversampling as usize + 1;
            for v in first(y)..=first(y) + span {
                for u in first(x)..=first(x) + span {
                    #[allow(clippy::cast_possible_truncation, reason = "in [0, 1]")]
                    let value = (share(u, x) * share(v, y)) as f32;
                    plane.row_mut(v)[u] += 0.5 * value;
                }
            }
            places.push(middle);
        }
    }
    (Film { oversampling, radiance: [plane.clone(), plane.clone(), plane] }, places)
}

/// Where a dot is seen: the centroid of light about a point \[px\].
fn centroid(light: &Plane<f32>, about: ImagePoint) -> ImagePoint {
    let (mut sum, mut x_sum, mut y_sum) = (0.0, 0.0, 0.0);
    for y in 0..light.height() {
        for x in 0..light.width() {
            let (dx, dy) = (x as f64 - about.x, y as f64 - about.y);
            if dx.abs() < 9.0 && dy.abs() < 9.0 {
                let value = f64::from(light.at(x, y));
                sum += value;
                x_sum += value * x as f64;
                y_sum += value * y as f64;
            }
        }
    }
    ImagePoint::new(x_sum / sum, y_sum / sum)
}

#[test]
fn distortion_and_phase_move_the_truth_with_the_image() {
    let pinhole = pinhole(512, 512);
    let (film, places) = dots(&pinhole, 4);
    let bent = Distortion { k1: -0.12, k2: 0.03, p1: 0.003, p2: -0.002, k3: 0.0 };
    let mut seen = 0;
    for (distortion, phase) in
        [(Distortion::NONE, [0.3, -0.2]), (bent, [0.0, 0.0]), (bent, [-0.4, 0.25])]
    {
        let mut model = CameraModel::default();
        model.optics.distortion = distortion;
        model.optics.gaussian_sigma_px = 0.5;
        let camera = Photographer::new("bent", &model, None);
        let taken = camera.take(&film, &pinhole, phase, &["bent"]).expect("a photograph");
        let mut offsets = Vec::new();
        for place in &places {
            let ray = pinhole.unproject(*place, 1.0);
            let truth = taken.camera.project(&ray).expect("in front");
            if (20.0..490.0).contains(&truth.x) && (20.0..490.0).contains(&truth.y) {
                let found = centroid(&taken.light[0], truth);
                offsets.push([found.x - truth.x, found.y - truth.y]);
            }
        }
        for axis in 0..2 {
            let along: Vec<f64> = offsets.iter().map(|offset| offset[axis]).collect();
            assert!(mean(&along).abs() < 5e-4, "{distortion:?}: mean {}", mean(&along));
            let far = along.iter().map(|value| value.abs()).fold(0.0, f64::max);
            assert!(far < 5e-3, "{distortion:?}: {far}");
        }
        seen += offsets.len();
    }
    assert!(seen > 400, "{seen}");
}

/// Squares of 22 px, each turned another way, and their corners, clockwise as seen.
fn squares(camera: &Camera, oversampling: u32) -> (Film, Vec<[ImagePoint; 4]>) {
    let side = (camera.width * oversampling) as usize;
    let scale = f64::from(oversampling);
    let mut plane = Plane::filled(side, side, 0.05_f32);
    let mut all = Vec::new();
    for row in 0..12_u32 {
        for column in 0..12_u32 {
            let number = f64::from(12 * row + column);
            let middle =
                |index: u32, step: f64| 35.0 + 40.0 * f64::from(index) + (number * step).fract();
            let (x, y) = (middle(column, 0.618), middle(row, 0.377));
            let (sine, cosine) = (0.11 + 0.71 * number).sin_cos();
            let corners =
                [(-11.0, -11.0), (11.0, -11.0), (11.0, 11.0), (-11.0, 11.0)].map(|(u, v)| {
                    ImagePoint::new(x + u * cosine - v * sine, y + u * sine + v * cosine)
                });
            let [left, top] = ImagePoint::new(x - 17.0, y - 17.0).to_film(oversampling);
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside")]
            let (left, top, count) = (left as usize, top as usize, (34.0 * scale) as usize);
            for v in top..top + count {
                for u in left..left + count {
                    const PARTS: u32 = 12;
                    let part = |index: u32| (f64::from(index) + 0.5) / f64::from(PARTS);
                    let inside = (0..PARTS * PARTS).filter(|index| {
                        let at = ImagePoint::from_film(
                            u as f64 + part(index % PARTS),
                            v as f64 + part(index / PARTS),
                            oversampling,
                        );
                        let (dx, dy) = (at.x - x, at.y - y);
                        (dx * cosine + dy * sine).abs() < 11.0
                            && (dy * cosine - dx * sine).abs() < 11.0
                    });
                    #[allow(clippy::cast_possible_truncation, reason = "in [0, 1]")]
                    let share = (inside.count() as f64 / f64::from(PARTS * PARTS)) as f32;
                    plane.row_mut(v)[u] += 0.6 * share;
                }
            }
            all.push(corners);
        }
    }
    (Film { oversampling, radiance: [plane.clone(), plane.clone(), plane] }, all)
}

/// How far an edge lies from the straight line between two points, as a parabola in the distance from
/// the first \[px\]: where the light across it says, at places along it away from its ends.
fn edge_offset(light: &Plane<f32>, from: ImagePoint, to: ImagePoint) -> Vector3<f64> {
    let length = (to.x - from.x).hypot(to.y - from.y);
    let (ux, uy) = ((to.x - from.x) / length, (to.y - from.y) / length);
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    let mut along = 5.0;
    while along < length - 5.0 {
        // Of a symmetric blur the share of light on one side tells the edge's place.
        let at = |across: f64| {
            light.bilinear(ImagePoint::new(
                from.x + along * ux - across * uy,
                from.y + along * uy + across * ux,
            ))
        };
        let (low, high) = (at(-4.0), at(4.0));
        let steps = 400;
        let share: f64 = (0..steps)
            .map(|step| {
                let across = -4.0 + (f64::from(step) + 0.5) * 8.0 / f64::from(steps);
                (at(across) - low) / (high - low) * 8.0 / f64::from(steps)
            })
            .sum();
        let powers = Vector3::new(1.0, along, along * along);
        normal += powers * powers.transpose();
        right += powers * (4.0 - share);
        along += 0.5;
    }
    normal.try_inverse().expect("enough places") * right
}

#[test]
fn a_corner_fitted_on_a_distorted_photograph_is_where_the_distorted_truth_is() {
    let pinhole = pinhole(512, 512);
    let (film, squares) = squares(&pinhole, 4);
    let bent = Distortion { k1: -0.12, k2: 0.03, p1: 0.003, p2: -0.002, k3: 0.01 };
    for (distortion, phase) in
        [(Distortion::NONE, [0.0, 0.0]), (bent, [0.0, 0.0]), (bent, [0.37, -0.21])]
    {
        let mut model = CameraModel::default();
        model.optics.distortion = distortion;
        model.optics.gaussian_sigma_px = 0.9;
        let camera = Photographer::new("bent", &model, None);
        let taken = camera.take(&film, &pinhole, phase, &["bent"]).expect("a photograph");
        let mut offsets = Vec::new();
        for square in &squares {
            let truth = square.map(|corner| {
                taken.camera.project(&pinhole.unproject(corner, 1.0)).expect("in front")
            });
            if truth.iter().any(|p| !(8.0..504.0).contains(&p.x) || !(8.0..504.0).contains(&p.y)) {
                continue;
            }
            for index in 0..4 {
                let at = truth[index];
                // Both edges as lines through the corner's truth, seen from it, light on the left or right.
                let (next, last) = (truth[(index + 1) % 4], truth[(index + 3) % 4]);
                let (one, other) = (
                    edge_offset(&taken.light[0], at, next),
                    edge_offset(&taken.light[0], last, at),
                );
                let unit = |from: ImagePoint, to: ImagePoint| {
                    let length = (to.x - from.x).hypot(to.y - from.y);
                    ([(to.x - from.x) / length, (to.y - from.y) / length], length)
                };
                let (([ax, ay], _), ([bx, by], length)) = (unit(at, next), unit(last, at));
                // Where both parabolas meet, near the corner.
                let (mut dx, mut dy) = (0.0, 0.0);
                for _ in 0..20 {
                    let parabola = |c: Vector3<f64>, t: f64| c[0] + c[1] * t + c[2] * t * t;
                    let first = parabola(one, dx * ax + dy * ay);
                    let second = parabola(other, length + dx * bx + dy * by);
                    // -ay dx + ax dy = first, -by dx + bx dy = second.
                    let determinant = -ay * bx + ax * by;
                    dx = (first * bx - ax * second) / determinant;
                    dy = (-ay * second + by * first) / determinant;
                }
                offsets.push([dx, dy]);
            }
        }
        assert!(offsets.len() > 300, "{}", offsets.len());
        for axis in 0..2 {
            let along: Vec<f64> = offsets.iter().map(|offset| offset[axis]).collect();
            assert!(mean(&along).abs() < 1e-3, "{distortion:?}: mean {}", mean(&along));
            let squares: Vec<f64> = along.iter().map(|value| value * value).collect();
            assert!(mean(&squares).sqrt() < 0.01, "{distortion:?}: {}", mean(&squares).sqrt());
        }
    }
}
