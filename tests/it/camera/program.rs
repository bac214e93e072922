//! Cameras as the program reads them, and what it writes of them.

use cornerbench::plan::read_camera;
use cornerbench::sensor::{CameraModel, Photographer, Transfer};

use super::{flat, pinhole};
use crate::support::{
    copy_folder, cornerbench, plain_dataset, project, recipes, run, stderr, succeed,
};

#[test]
fn cameras_that_cannot_be_are_refused_with_key_and_range() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    copy_folder(&project().join("scenes"), folder.path());
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

/// The tests' recipes with their camera `ideal` replaced.
fn recipes_with(camera: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    copy_folder(&recipes(), folder.path());
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
