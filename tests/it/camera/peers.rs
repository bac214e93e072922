//! The same photograph made in another way: through a window, in NumPy, without a film.

use std::process::Command;

use cornerbench::geometry::{Distortion, ImagePoint};
use cornerbench::image::{PixelRange, Plane};
use cornerbench::junction::BlurredJunction;
use cornerbench::plan::{read_camera, recipe_names};
use cornerbench::scene::Film;
use cornerbench::sensor::{CameraModel, Colour, Curve, Photograph, Photographer, Shot};

use super::{mean, pinhole};
use crate::support::{project, python, succeed};

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
        let window = PixelRange { x0: 13, y0: 8, x1: 61, y1: 55 };
        let shot = |window| Shot { name: &["window"], window };
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
