//! Photon transfer, the noise, saturation.

use cornerbench::image::Plane;
use cornerbench::plan::{read_camera, recipe_names};
use cornerbench::scene::Film;
use cornerbench::sensor::{CameraModel, Colour, Curve, Photograph, Photographer, Sensor};

use super::{flat, mean, pinhole};
use crate::support::project;

/// The cameras that come with the project and have a sensor, but those to draw junctions for: beside their read noise,
/// which plans set, light's own is too little to be measured.
fn sensors() -> Vec<(String, CameraModel, Sensor)> {
    let recipes = project().join("scenes");
    recipe_names(&recipes, "cameras")
        .into_iter()
        .filter_map(|name| {
            let model = read_camera(&recipes, &name).expect("a camera").model().clone();
            let sensor = model.sensor.clone()?;
            let is_lit = sensor.read_noise_e.powi(2) < sensor.full_well_e;
            is_lit.then_some((name, model, sensor))
        })
        .collect()
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
