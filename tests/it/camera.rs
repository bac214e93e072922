//! The camera: what its data sheet says comes out of its pictures.

use std::process::Command;

use cornerbench::geometry::{Camera, Distortion, ImagePoint};
use cornerbench::image::Plane;
use cornerbench::junction::BlurredJunction;
use cornerbench::plan::{read_camera, recipe_names};
use cornerbench::scene::Film;
use cornerbench::sensor::{
    CameraModel, Colour, Curve, Photograph, Photographer, Sensor, Shot, Transfer,
};

use nalgebra::{Matrix3, Vector3};

use crate::support::{cornerbench, plain_dataset, project, python, run, stderr, succeed};

/// The cameras that come with the project and have a sensor.
fn sensors() -> Vec<(String, CameraModel, Sensor)> {
    let recipes = project().join("scenes");
    recipe_names(&recipes, "cameras")
        .into_iter()
        .filter_map(|name| {
            let model = read_camera(&recipes, &name).expect("a camera").model().clone();
            let sensor = model.sensor.clone()?;
            Some((name, model, sensor))
        })
        .collect()
}

fn pinhole(width: u32, height: u32) -> Camera {
    Camera {
        width,
        height,
        fx_px: 400.0,
        fy_px: 400.0,
        cx_px: 0.5 * f64::from(width - 1),
        cy_px: 0.5 * f64::from(height - 1),
        distortion: Distortion::NONE,
    }
}

fn flat(camera: &Camera, radiance: f32) -> Film {
    let plane = Plane::filled(camera.width as usize, camera.height as usize, radiance);
    Film { oversampling: 1, radiance: [plane.clone(), plane.clone(), plane] }
}

/// The raw numbers of a sensor: linear, nothing lost in rounding, white where the sensor saturates.
fn raw(name: &str, model: &CameraModel) -> Photographer {
    let mut model = model.clone();
    model.gain = 1.0;
    model.colour = Colour::Mono;
    model.optics = Default::default();
    model.output.rounded = false;
    model.output.jpeg_quality = 0;
    model.output.transfer = Curve::Linear;
    model.output.bit_depth = 16;
    Photographer::new(name, &model, None)
}

/// Raw numbers above black of a photograph of [`raw`] \[DN\].
fn numbers(sensor: &Sensor, photograph: &Photograph) -> Vec<f64> {
    let most = sensor.saturation_dn() - sensor.black_level_dn;
    photograph.exposure.rgb()[0].samples().iter().map(|&v| f64::from(v) / 65535.0 * most).collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Mean of two pictures of the same light, variance over time and over space, as EMVA 1288 has them.
fn transfer(sensor: &Sensor, camera: &Photographer, light: f32) -> (f64, f64, f64) {
    let pinhole = pinhole(1024, 1024);
    let film = flat(&pinhole, light);
    let take = |which: &str| {
        let name = ["photon transfer", &light.to_string(), which];
        numbers(sensor, &camera.take(&film, &pinhole, [0.0, 0.0], &name).expect("a photograph"))
    };
    let (first, second) = (take("a"), take("b"));
    let both: Vec<f64> = first.iter().zip(&second).map(|(a, b)| 0.5 * (a + b)).collect();
    let centre = mean(&both);
    let over_time =
        mean(&first.iter().zip(&second).map(|(a, b)| 0.5 * (a - b).powi(2)).collect::<Vec<_>>());
    let over_both = mean(&both.iter().map(|v| (v - centre).powi(2)).collect::<Vec<_>>());
    (centre, over_time, over_both - 0.5 * over_time)
}

#[test]
fn photon_transfer_gives_back_the_data_sheet_of_every_camera() {
    let sensors = sensors();
    assert!(sensors.len() >= 3, "{}", sensors.len());
    for (name, model, sensor) in sensors {
        let camera = raw(&name, &model);
        let electrons: f64 = sensor.electrons_at_one().iter().sum();
        let at = |share: f64| {
            #[allow(clippy::cast_possible_truncation, reason = "a radiance")]
            let light = (share * sensor.full_well_e / electrons) as f32;
            transfer(&sensor, &camera, light)
        };
        let gain = sensor.gain_dn_per_e;
        // Light scaled so that the darkest one is far below what is dark.
        let (dark_mean, dark_time, dark_space) = at(0.0);
        let lit: Vec<(f64, f64, f64)> = (1..=7).map(|step| at(0.1 * f64::from(step))).collect();
        // The slope of variance over mean, through all of them.
        let slope = {
            let x: Vec<f64> = lit.iter().map(|(m, _, _)| m - dark_mean).collect();
            let y: Vec<f64> = lit.iter().map(|(_, v, _)| v - dark_time).collect();
            x.iter().zip(&y).map(|(x, y)| x * y).sum::<f64>() / x.iter().map(|x| x * x).sum::<f64>()
        };
        assert!((slope / gain - 1.0).abs() < 0.01, "{name}: gain {slope}, {gain}");
        // Rounding adds a twelfth; dark current its own shot noise.
        let read = (dark_time - 1.0 / 12.0) / (gain * gain) - sensor.dark_e();
        let ratio = read.sqrt() / sensor.read_noise_e;
        assert!((ratio - 1.0).abs() < 0.01, "{name}: read noise {ratio} of the data sheet's");
        let dsnu = (dark_space - 0.0).max(0.0).sqrt() / gain;
        assert!((dsnu / sensor.dsnu_e - 1.0).abs() < 0.05, "{name}: DSNU {dsnu} e-");
        let (bright, _, bright_space) = lit[4];
        let prnu = (bright_space - dark_space).max(0.0).sqrt() / (bright - dark_mean);
        assert!((prnu / sensor.prnu - 1.0).abs() < 0.05, "{name}: PRNU {prnu}");
        // Far beyond saturation every pixel is full: there the sensor's numbers end.
        let (full, time, _) = at(3.0);
        assert!(
            (full / (gain * sensor.full_well_e) - 1.0).abs() < 0.01,
            "{name}: full well {full}"
        );
        assert!(time < 2.0 * dark_time, "{name}: what is full has no shot noise");
    }
}

#[test]
fn the_noise_model_says_what_the_noise_is() {
    for (name, mut model, _) in sensors() {
        model.optics = Default::default();
        model.output.jpeg_quality = 0;
        model.colour = if model.colour == Colour::Mono { Colour::Mono } else { Colour::Rgb };
        // Few raw numbers rounded again to few others are not those and a twelfth.
        model.output.bit_depth = 16;
        let camera = Photographer::new(&name, &model, None);
        let pinhole = pinhole(512, 512);
        for light in [0.05, 0.3, 0.7] {
            let photograph = camera
                .take(&flat(&pinhole, light), &pinhole, [0.0, 0.0], &["noise", &light.to_string()])
                .expect("a photograph");
            for channel in 0..3 {
                let plane = &photograph.exposure.rgb()[channel];
                let values: Vec<f64> = plane.samples().iter().map(|&v| f64::from(v)).collect();
                let centre = mean(&values);
                let found = mean(&values.iter().map(|v| (v - centre).powi(2)).collect::<Vec<_>>());
                let said = photograph.exposure.variance_dn2(channel, centre);
                // A curved encoding is linear over the noise to a few in a hundred only.
                let most = if model.output.transfer == Curve::Linear { 0.03 } else { 0.1 };
                assert!(
                    (found / said - 1.0).abs() < most,
                    "{name} {light} {channel}: {found} is not {said}"
                );
            }
        }
    }
}

#[test]
fn saturated_pixels_are_marked_and_others_are_not() {
    for (name, mut model, sensor) in sensors() {
        model.optics = Default::default();
        let camera = Photographer::new(&name, &model, None);
        let pinhole = pinhole(64, 32);
        let electrons = sensor.electrons_at_one();
        let full = match model.colour {
            Colour::Mono => electrons.iter().sum::<f64>(),
            _ => electrons.iter().copied().fold(0.0, f64::max),
        };
        #[allow(clippy::cast_possible_truncation, reason = "a radiance")]
        let bright = (1.5 * sensor.full_well_e / full) as f32;
        let plane =
            Plane::from_fn(64, 32, |x, _| if x < 32 { 0.02 * bright / 50.0 } else { bright });
        let film = Film { oversampling: 1, radiance: [plane.clone(), plane.clone(), plane] };
        let photograph = camera.take(&film, &pinhole, [0.0, 0.0], &["full"]).expect("a photograph");
        let saturated = photograph.exposure.saturated();
        for y in 0..32 {
            for x in (0..64).filter(|x| !(28..36).contains(x)) {
                assert_eq!(saturated.at(x, y), x >= 32, "{name} {x} {y}");
            }
        }
    }
}

#[test]
fn a_window_is_that_part_of_the_whole_picture() {
    let recipes = project().join("scenes");
    for name in recipe_names(&recipes, "cameras") {
        let camera = read_camera(&recipes, &name).expect("a camera");
        if camera.model().output.jpeg_quality > 0 {
            continue; // Its blocks begin at the picture's corner.
        }
        let pinhole = pinhole(90, 70);
        let plane = Plane::from_fn(180, 140, |x, y| ((x * 31 + y * 17) % 64) as f32 / 80.0);
        let film = Film { oversampling: 2, radiance: [plane.clone(), plane.clone(), plane] };
        let kernel = camera.kernel(2, [0.2, -0.4]);
        let window = cornerbench::image::PixelRange { x0: 13, y0: 8, x1: 61, y1: 55 };
        let shot = |window| cornerbench::sensor::Shot { name: &["window"], window };
        let mut buffers = Default::default();
        let whole = camera.expose(&film, &pinhole, &kernel, &shot(None), &mut buffers);
        let part = camera.expose(&film, &pinhole, &kernel, &shot(Some(window)), &mut buffers);
        for (whole, part) in whole.exposure.rgb().iter().zip(part.exposure.rgb()) {
            assert_eq!(whole.crop(window), *part, "{name}");
        }
        let (whole, part) = (whole.camera, part.camera);
        assert!((whole.cx_px - part.cx_px - 13.0).abs() < 1e-12);
        assert!((whole.cy_px - part.cy_px - 8.0).abs() < 1e-12);
    }
}

/// Side of the window of the shifted films \[px\], and their film cells per pixel.
const SIDE_PX: u32 = 40;
const OVERSAMPLING: u32 = 4;

/// Films that Mitsuba renders of one scene with shifted grids: by shift, and by pass with other noise.
fn rendered_at(shifts: &[[f64; 2]], passes: usize) -> Vec<Vec<Film>> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("films.f32");
    let mut command = Command::new(python());
    command.arg(project().join("scripts/tests/peers/shifted_films.py"));
    command.arg(&file).arg(passes.to_string()).arg("--");
    command.args(shifts.iter().map(|[x, y]| format!("{x},{y}")));
    succeed(&mut command);
    let bytes = std::fs::read(&file).expect("films");
    let side = (SIDE_PX * OVERSAMPLING) as usize;
    let numbers: Vec<f32> = bytes
        .chunks_exact(4)
        .map(|four| f32::from_le_bytes(four.try_into().expect("four bytes")))
        .collect();
    let planes: Vec<Plane<f32>> = numbers
        .chunks_exact(side * side)
        .map(|samples| Plane::from_samples(side, side, samples.to_vec()))
        .collect();
    let films: Vec<Film> = planes
        .chunks_exact(3)
        .map(|rgb| Film {
            oversampling: OVERSAMPLING,
            radiance: [rgb[0].clone(), rgb[1].clone(), rgb[2].clone()],
        })
        .collect();
    assert_eq!(films.len(), shifts.len() * passes);
    films.chunks_exact(passes).map(<[Film]>::to_vec).collect()
}

/// A photograph at a phase is one of a film that was rendered with its grid there, to the noise of the
/// renders: over the pixels the squares of their differences, in standard errors, have the mean that
/// they should. The blur, of 0.6 px, is that of a sharp lens: without any, an edge within a film cell
/// could be told from one that is spread over it.
#[test]
fn a_photograph_at_a_phase_is_one_of_a_film_rendered_there() {
    const PASSES: usize = 16;
    let shifts = [
        [0.0, 0.0],
        [0.25, 0.0],
        [0.0, -0.5],
        [0.1, 0.2],
        [-0.33, 0.41],
        [0.47, -0.13],
        [-0.06, -0.29],
        [0.38, 0.38],
        [0.55, -0.7],
    ];
    let films = rendered_at(&shifts, PASSES);
    let mut model = CameraModel::default();
    model.optics.gaussian_sigma_px = 0.6;
    model.output.rounded = false;
    model.output.transfer = Curve::Linear;
    let camera = Photographer::new("phase", &model, None);
    let pinhole = pinhole(SIDE_PX, SIDE_PX);
    let light = |film: &Film, phase: [f64; 2]| {
        camera.take(film, &pinhole, phase, &["phase"]).expect("a photograph").light
    };
    // Mean over the passes and its variance, of every pixel well inside, in every channel.
    let statistics = |films: &[Film], phase: [f64; 2]| -> Vec<(f64, f64)> {
        let all: Vec<Vec<Plane<f32>>> = films.iter().map(|film| light(film, phase)).collect();
        let mut found = Vec::new();
        for channel in 0..3 {
            for y in 6..SIDE_PX as usize - 6 {
                for x in 6..SIDE_PX as usize - 6 {
                    let values: Vec<f64> =
                        all.iter().map(|l| f64::from(l[channel].at(x, y))).collect();
                    let centre = mean(&values);
                    let square: f64 = values.iter().map(|v| (v - centre).powi(2)).sum();
                    let count = values.len() as f64;
                    found.push((centre, square / (count - 1.0) / count));
                }
            }
        }
        found
    };
    // The mean square of Student's t with so many degrees of freedom.
    let degrees = 2.0 * (PASSES as f64 - 1.0);
    let expected = degrees / (degrees - 2.0);
    let compared = |ours: &[(f64, f64)], theirs: &[(f64, f64)]| {
        let squares: Vec<f64> = ours
            .iter()
            .zip(theirs)
            .map(|((a, va), (b, vb))| (a - b).powi(2) / (va + vb).max(1e-30))
            .collect();
        mean(&squares)
    };
    // Neighbours share film cells, and the channels paths: of the 2352 differences of a shift some
    // two hundred are independent, so their mean square is known to a tenth.
    let mut all = Vec::new();
    for (shift, fresh) in shifts.iter().zip(&films).skip(1) {
        let theirs = statistics(fresh, [0.0, 0.0]);
        let found = compared(&statistics(&films[0], *shift), &theirs) / expected;
        assert!((found - 1.0).abs() < 0.4, "{shift:?}: {found} of what noise makes");
        all.push(found);
        // A tenth of a pixel beside it is beside it.
        let beside = [shift[0] + 0.1, shift[1] - 0.1];
        let far = compared(&statistics(&films[0], beside), &theirs) / expected;
        assert!(far > found + 0.6, "{shift:?}: the test cannot tell {beside:?}: {far}, {found}");
    }
    assert!((mean(&all) - 1.0).abs() < 0.2, "{all:?}");
}

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

#[test]
fn cameras_that_cannot_be_are_refused_with_key_and_range() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    crate::support::copy_folder(&project().join("scenes"), folder.path());
    let text = std::fs::read_to_string(project().join("scenes/cameras/webcam.toml")).expect("TOML");
    let refused = |old: &str, new: &str| {
        assert!(text.contains(old), "{old}");
        let file = folder.path().join("cameras/mine.toml");
        std::fs::write(file, text.replace(old, new)).expect("written");
        read_camera(folder.path(), "mine").expect_err(new).chain()
    };
    for (old, new, problem) in [
        (
            "read_noise_e = 3.0",
            "read_noise_e = -1.0",
            "sensor.read_noise_e is -1, must be in [0, 10000]",
        ),
        (
            "read_noise_e = 3.0",
            "read_noise = 3.0",
            "unknown key of sensor \"read_noise\"; did you mean \"read_noise_e\"?",
        ),
        (
            "black_level_dn = 64.0",
            "black_level_dn = 600.0",
            "sensor.black_level_dn is 600, must be below half of the largest sample, 511.5",
        ),
        (
            "gain_dn_per_e = 0.17",
            "gain_dn_per_e = 0.0001",
            "sensor.full_well_e is 5500, must be large enough",
        ),
        (
            "[0.45, 0.55, 0.50]",
            "[0.45, 1.55, 0.50]",
            "sensor.quantum_efficiency is [0.45, 1.55, 0.5], must be three numbers in (0, 1]",
        ),
        (
            "dark_current_e_per_s = 20.0",
            "dark_current_e_per_s = 1e6",
            "sensor.dark_current_e_per_s is 1000000, must be so small",
        ),
        (
            "read_noise_e = 3.0",
            "read_noise_e = 2000.0",
            "sensor.read_noise_e is 2000 (dsnu_e is 1.5), must be so small, both together",
        ),
        ("bit_depth = 8\n", "bit_depth = 12\n", "output.jpeg_quality is 85, must be 0 unless"),
        (
            "gaussian_sigma_px = 0.7",
            "gaussian_sigma_px = nan",
            "optics.gaussian_sigma_px is NaN, must be in [0, 8]",
        ),
        (
            "gaussian_sigma_px = 0.7",
            "psf_image = \"../ideal.toml\"",
            "optics.psf_image is \"../ideal.toml\", must be the name of a file in this folder",
        ),
        ("gaussian_sigma_px = 0.7", "psf_image = \"webcam.toml\"", "webcam.toml"),
        ("k1 = -0.06", "k1 = -60.0", "optics.distortion.k1 is -60, must be in [-10, 10]"),
    ] {
        let found = refused(old, new);
        assert!(found.contains(problem), "{new}: {found}");
    }
    let dark = image::GrayImage::new(5, 5);
    dark.save(folder.path().join("cameras/dark.png")).expect("a picture");
    let found = refused("gaussian_sigma_px = 0.7", "psf_image = \"dark.png\"");
    assert!(found.contains("its samples sum to 0, must be positive and finite"), "{found}");

    let mut model = CameraModel::default();
    model.optics.distortion.k1 = -0.9;
    let camera = Photographer::new("folds", &model, None);
    let pinhole = pinhole(512, 512);
    let problem = camera.take(&flat(&pinhole, 0.1), &pinhole, [0.0, 0.0], &[]).expect_err("folds");
    assert!(problem.chain().contains("optics.distortion is"), "{}", problem.chain());
    assert!(
        problem.chain().contains("no two points of a 512 x 512 px image"),
        "{}",
        problem.chain()
    );
}

#[test]
fn expose_writes_pictures_light_and_truth_of_every_scene() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = folder.path().join("photographs");
    let expose = |camera: &str| {
        let mut command = cornerbench();
        command.arg("expose").arg(plain_dataset()).args(["--camera", camera, "--repeats", "2"]);
        command.args(["--phase", "0,0", "--phase", "0.25,-0.5", "--output"]).arg(&output);
        command
    };
    succeed(&mut expose("webcam"));
    let all: serde_json::Value = serde_json::from_str(
        &std::fs::read_to_string(output.join("photographs.json")).expect("a manifest"),
    )
    .expect("JSON");
    let scenes = all["scenes"].as_array().expect("scenes");
    assert!(!scenes.is_empty());
    for scene in scenes {
        let folder = output.join(scene.as_str().expect("a name"));
        let described: serde_json::Value = serde_json::from_str(
            &std::fs::read_to_string(folder.join("exposures.json")).expect("exposures"),
        )
        .expect("JSON");
        let exposures = described["exposures"].as_array().expect("exposures");
        assert_eq!(exposures.len(), 4);
        let pictures: Vec<Vec<u8>> = exposures
            .iter()
            .map(|exposure| {
                assert!(folder.join(exposure["light"].as_str().expect("a name")).is_file());
                assert_eq!(exposure["camera"]["distortion"]["k1"], -0.06);
                let file = folder.join(exposure["picture"].as_str().expect("a name"));
                image::open(file).expect("a picture").to_rgb8().into_raw()
            })
            .collect();
        assert_ne!(pictures[0], pictures[1], "noise of their own");
        let x = |index: usize| {
            exposures[index]["corners"][0]["image_point_px"][0].as_f64().expect("a number")
        };
        assert!((x(2) - x(0) + 0.25).abs() < 1e-9, "a phase moves the truth the other way");
    }
    // Again: the same bytes.
    let first = std::fs::read(output.join("photographs.json")).expect("a manifest");
    let name = scenes[0].as_str().expect("a name");
    let picture = output.join(name).join("exposure-3.png");
    let before = std::fs::read(&picture).expect("a picture");
    succeed(expose("webcam").args(["--threads", "1"]));
    assert_eq!(std::fs::read(&picture).expect("a picture"), before);
    assert_ne!(first.len(), 0);

    let foreign = folder.path().join("mine");
    std::fs::create_dir(&foreign).expect("a folder");
    std::fs::write(foreign.join("thesis.tex"), "all of it").expect("written");
    let refused = run(cornerbench()
        .arg("expose")
        .arg(plain_dataset())
        .args(["--camera", "ideal", "--output"])
        .arg(&foreign));
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("would be overwritten"), "{}", stderr(&refused));
}

/// The same camera in NumPy and SciPy: the light on the pixels, and the digital numbers, row by row.
fn by_numpy(film: &Film, model: &CameraModel, phase_px: [f64; 2]) -> (Vec<f32>, Vec<f32>) {
    let side = film.radiance[0].width() / film.oversampling as usize;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    let bytes: Vec<u8> = film
        .radiance
        .iter()
        .flat_map(|plane| plane.samples().iter().flat_map(|value| value.to_le_bytes()))
        .collect();
    std::fs::write(path("film.f32"), bytes).expect("written");
    let settings = serde_json::json!({
        "oversampling": film.oversampling, "side_px": side, "phase_px": phase_px, "repeats": 1,
        "camera": model,
    });
    std::fs::write(path("settings.json"), settings.to_string()).expect("written");
    let mut command = Command::new(python());
    command.arg(project().join("scripts/tests/peers/exposure_oracle.py"));
    command.args([path("film.f32"), path("out.f32"), path("settings.json")]);
    succeed(&mut command);
    let numbers: Vec<f32> = std::fs::read(path("out.f32"))
        .expect("an answer")
        .chunks_exact(4)
        .map(|four| f32::from_le_bytes(four.try_into().expect("four bytes")))
        .collect();
    let (light, raw) = numbers.split_at(numbers.len() / 2);
    (light.to_vec(), raw.to_vec())
}

#[test]
fn light_and_noise_are_those_of_the_version_in_numpy() {
    let pinhole = pinhole(128, 128);
    let plane = |step: usize| {
        Plane::from_fn(512, 512, |x, y| ((x / 9 * step + y / 7 * 5 + x * y % 3) % 32) as f32 / 45.0)
    };
    let film = Film { oversampling: 4, radiance: [plane(3), plane(4), plane(7)] };
    let recipes = project().join("scenes");
    for (name, sigma_px, fill_factor, phase_px) in
        [("industrial-mono", 0.6, 1.0, [0.3, -0.2]), ("webcam", 0.9, 0.5, [-0.41, 0.08])]
    {
        let mut model = read_camera(&recipes, name).expect("a camera").model().clone();
        model.colour = Colour::Rgb;
        model.optics = Default::default();
        model.optics.gaussian_sigma_px = sigma_px;
        model.optics.fill_factor = fill_factor;
        model.output = Default::default();
        model.output.rounded = false;
        model.output.transfer = Curve::Linear;
        let sensor = model.sensor.clone().expect("a sensor");
        let camera = Photographer::new(name, &model, None);
        let taken = camera.take(&film, &pinhole, phase_px, &["numpy"]).expect("a photograph");
        let (light, raw) = by_numpy(&film, &model, phase_px);
        let electrons = sensor.electrons_at_one();
        let most = electrons.iter().copied().fold(0.0, f64::max);
        for channel in 0..3 {
            let count = 128 * 128;
            let theirs = &light[channel * count..][..count];
            for (ours, theirs) in taken.light[channel].samples().iter().zip(theirs) {
                assert!((ours - theirs).abs() < 2e-6, "{name}: {ours} {theirs}");
            }
            // Both pictures' numbers from the mean that the light makes.
            let scale =
                electrons[channel] / most * (sensor.saturation_dn() - sensor.black_level_dn);
            let spread = |values: &[f64]| {
                let from_mean: Vec<f64> = values
                    .iter()
                    .zip(theirs)
                    .map(|(value, light)| {
                        let mean_e = f64::from(*light) * electrons[channel] + sensor.dark_e();
                        value - sensor.gain_dn_per_e * mean_e
                    })
                    .collect();
                let centre = mean(&from_mean);
                (centre, mean(&from_mean.iter().map(|v| (v - centre).powi(2)).collect::<Vec<_>>()))
            };
            let ours: Vec<f64> = taken.exposure.rgb()[channel]
                .samples()
                .iter()
                .map(|&value| f64::from(value) / 255.0 * scale)
                .collect();
            let raw: Vec<f64> = raw[channel * count..][..count]
                .iter()
                .map(|&value| f64::from(value) - sensor.black_level_dn)
                .collect();
            let ((ours_mean, ours_variance), (their_mean, their_variance)) =
                (spread(&ours), spread(&raw));
            let error = (2.0 * their_variance / count as f64).sqrt();
            assert!(
                (ours_mean - their_mean).abs() < 4.0 * error,
                "{name}: {ours_mean} {their_mean}"
            );
            let ratio = ours_variance / their_variance;
            // The ratio of two variances over so many pixels: 1.6 % is its standard error, at most.
            assert!((ratio - 1.0).abs() < 0.06, "{name} {channel}: variance is {ratio} of NumPy's");
        }
    }
}

#[test]
fn a_blurred_junction_goes_through_the_same_camera_as_a_film() {
    // A corner of three sectors, as a film of 16 cells a pixel and in closed form.
    let pinhole = pinhole(24, 24);
    let vertex = ImagePoint::new(11.3, 12.1);
    let edges_rad: Vec<f64> = [0.3, 2.1, 4.0].to_vec();
    let scale = 16;
    let sector = |x: f64, y: f64| {
        let angle = (y - vertex.y).atan2(x - vertex.x).rem_euclid(std::f64::consts::TAU);
        edges_rad.iter().rposition(|edge| *edge <= angle).unwrap_or(2)
    };
    let levels = [[0.6, 0.1, 0.3], [0.5, 0.2, 0.1], [0.1, 0.4, 0.2]];
    let radiance = [0, 1, 2].map(|channel: usize| {
        Plane::from_fn(24 * scale, 24 * scale, |x, y| {
            let at = ImagePoint::from_film(x as f64 + 0.5, y as f64 + 0.5, 16);
            #[allow(clippy::cast_possible_truncation, reason = "a radiance")]
            let value = levels[channel][sector(at.x, at.y)] as f32;
            value
        })
    });
    let film = Film { oversampling: 16, radiance };
    let mut model =
        read_camera(&project().join("scenes"), "webcam").expect("a camera").model().clone();
    model.optics.distortion = Distortion::NONE;
    model.output.jpeg_quality = 0;
    let camera = Photographer::new("webcam", &model, None);
    let junction = levels.map(|levels| BlurredJunction {
        vertex,
        edges_rad: edges_rad.clone(),
        levels: levels.to_vec(),
        sigma_px: model.optics.gaussian_sigma_px,
    });
    let shot = Shot { name: &["junction"], window: None };
    let ours = camera.expose_junction(&junction, &pinhole, &shot).expect("a photograph");
    let theirs = camera.take(&film, &pinhole, [0.0, 0.0], &["junction"]).expect("a photograph");
    let mut same = 0;
    for y in 5..19 {
        for x in 5..19 {
            let (a, b) = (ours.light[0].at(x, y), theirs.light[0].at(x, y));
            assert!((a - b).abs() < 2e-3, "{x} {y}: {a} {b}");
            let at = |photograph: &Photograph| photograph.exposure.rgb()[0].at(x, y);
            same += usize::from((at(&ours) - at(&theirs)).abs() <= 1.0);
        }
    }
    assert!(same > 14 * 14 * 9 / 10, "the noise is the same, too: {same}");

    let mut soft = junction.clone();
    soft[0].sigma_px = 3.0;
    let problem = camera.expose_junction(&soft, &pinhole, &shot).expect_err("another blur");
    assert!(problem.chain().contains("a Gaussian blur alone"), "{}", problem.chain());
}

/// The tests' recipes with their camera `ideal` replaced.
fn recipes_with(camera: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    crate::support::copy_folder(&crate::support::recipes(), folder.path());
    std::fs::write(folder.path().join("cameras/ideal.toml"), camera).expect("written");
    folder
}

#[test]
fn a_scene_that_a_lens_folds_is_a_counted_row_and_costs_no_other() {
    let recipes = recipes_with("[optics.distortion]\nk1 = -3.0\n");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = run(cornerbench()
        .args(["measure", "plain"])
        .arg(plain_dataset())
        .arg("--recipes")
        .arg(recipes.path())
        .arg("--output")
        .arg(folder.path().join("run")));
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(folder.path().join("run/records.parquet").is_file());
}

#[test]
fn samples_that_are_not_rounded_are_written_as_floats() {
    let recipes = recipes_with("[output]\nrounded = false\ntransfer = \"linear\"\n");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = folder.path().join("photographs");
    let mut command = cornerbench();
    command.arg("expose").arg(plain_dataset()).args(["--camera", "ideal", "--recipes"]);
    succeed(command.arg(recipes.path()).arg("--output").arg(&output));
    let scene = std::fs::read_dir(&output)
        .expect("photographs")
        .flatten()
        .find(|entry| entry.path().is_dir())
        .expect("a scene");
    let read = |name: &str| {
        exr::prelude::read_first_flat_layer_from_file(scene.path().join(name)).expect("EXR")
    };
    let (picture, light) = (read("exposure-0.exr"), read("light-0.exr"));
    // For people: through the sRGB curve.
    let preview = image::open(scene.path().join("preview-0.png")).expect("a picture").to_rgb8();
    let middle = light.layer_data.size.width() / 2 + light.layer_data.size.width() * 40;
    let red = &light.layer_data.channel_data.list[2];
    assert_eq!(red.name.to_string(), "R");
    let linear = red.sample_data.values_as_f32().nth(middle).expect("a sample");
    let shown = preview.pixels().nth(middle).expect("a pixel").0[0];
    let wanted = 255.0 * Transfer::Srgb.encode(f64::from(linear));
    assert!((f64::from(shown) - wanted).abs() <= 0.5 + 1e-3, "{shown} {wanted}");
    for (samples, light) in
        picture.layer_data.channel_data.list.iter().zip(&light.layer_data.channel_data.list)
    {
        for (sample, light) in
            samples.sample_data.values_as_f32().zip(light.sample_data.values_as_f32())
        {
            assert!((sample - 255.0 * light).abs() < 1e-3 * sample.max(1.0), "{sample} {light}");
        }
    }
}
