//! Range sensors: what they tell of rendered scenes, and what they are told by.

use cornerbench::plan::{read_range_sensor, recipe_names};
use cornerbench::record::read_records;
use cornerbench::scene::{Dataset, Description};

use crate::support::{cornerbench, plain_dataset, project, succeed};

#[test]
fn range_sensors_that_cannot_be_are_refused_with_key_and_range() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    crate::support::copy_folder(&project().join("scenes"), folder.path());
    for (text, problem) in [
        ("noise_m = -0.1", "noise_m is -0.1, must be in [0, 10]"),
        ("noise = 0.1", "unknown key \"noise\"; did you mean \"noise_m\"?"),
        ("dropout = 1.5", "dropout is 1.5, must be in [0, 1]"),
        ("width = 32", "width is 32 x 0, must be 0 where height is 0, and only there"),
        ("min_depth_m = 3.0\nmax_depth_m = 2.0", "min_depth_m is 3, must be below max_depth_m, 2"),
    ] {
        std::fs::write(folder.path().join("range-sensors/mine.toml"), text).expect("written");
        let found = read_range_sensor(folder.path(), "mine").expect_err(text).chain();
        assert!(found.contains(problem), "{text}: {found}");
    }
    let found = read_range_sensor(folder.path(), "time-of-fligth").expect_err("a name").chain();
    assert!(found.contains("did you mean \"time-of-flight\"?"), "{found}");
}

#[test]
fn every_range_sensor_tells_points_near_the_surfaces_of_every_scene() {
    let recipes = project().join("scenes");
    let dataset = Dataset::open(plain_dataset()).expect("a dataset");
    for name in recipe_names(&recipes, "range-sensors") {
        let sensor = read_range_sensor(&recipes, &name).expect("a range sensor");
        for scene in dataset.scenes() {
            let scene = dataset.read(scene).expect("a scene");
            let Description { range_camera, world_from_range, .. } = &scene.description;
            let image = sensor
                .measure(&scene.range, range_camera, *world_from_range, &[&scene.name])
                .expect("a range image");
            // Against the ray through the cell of the dataset's own sensor that looks there.
            let (mut told, mut near) = (0, 0);
            for y in 0..image.points.height() {
                for x in 0..image.points.width() {
                    let Some(point) = image.points.at(x, y) else { continue };
                    told += 1;
                    let at = range_camera.project(&point).expect("in front");
                    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
                    let [column, row] = [at.x, at.y].map(|place| place.round() as usize);
                    let Some(truth) = scene.range.points.at(column, row) else { continue };
                    let noise_m = image.noise.standard_deviation_m(truth.z);
                    near += usize::from((point.z - truth.z).abs() < 4.0 * noise_m + 0.03);
                }
            }
            let all = image.points.width() * image.points.height();
            assert!(told > all / 2, "{name} {}: {told} of {all}", scene.name);
            assert!(near > told * 9 / 10, "{name} {}: {near} of {told}", scene.name);
        }
    }
}

#[test]
fn expose_writes_range_images_beside_the_photographs() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = folder.path().join("photographs");
    let mut command = cornerbench();
    command.arg("expose").arg(plain_dataset()).args(["--camera", "ideal", "--repeats", "2"]);
    succeed(command.args(["--range-sensor", "structured-light", "--output"]).arg(&output));
    let all: serde_json::Value = serde_json::from_str(
        &std::fs::read_to_string(output.join("photographs.json")).expect("a manifest"),
    )
    .expect("JSON");
    assert_eq!(all["range_sensor"][0], "structured-light");
    for scene in all["scenes"].as_array().expect("scenes") {
        let folder = output.join(scene.as_str().expect("a name"));
        let described: serde_json::Value = serde_json::from_str(
            &std::fs::read_to_string(folder.join("exposures.json")).expect("exposures"),
        )
        .expect("JSON");
        assert_eq!(described["range"]["camera"]["width"], 128);
        let read = |number: usize| {
            let file = &described["exposures"][number]["range"];
            let file = folder.join(file.as_str().expect("a name"));
            assert!(file.with_extension("png").is_file());
            let image = exr::prelude::read_first_flat_layer_from_file(file).expect("EXR");
            let channels = image.layer_data.channel_data.list;
            let names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
            assert_eq!(names, ["X", "Y", "Z"]);
            channels[2].sample_data.values_as_f32().collect::<Vec<_>>()
        };
        let (first, second) = (read(0), read(1));
        assert_eq!(first.len(), 128 * 128);
        assert_ne!(first, second, "noise of their own");
    }
}

#[test]
fn a_plan_s_range_sensor_is_used_and_named() {
    let recipes = tempfile::tempdir().expect("a temporary folder");
    crate::support::copy_folder(&crate::support::recipes(), recipes.path());
    // One that tells nothing: no grasp can be made.
    std::fs::write(recipes.path().join("range-sensors/blind.toml"), "dropout = 1.0").expect("file");
    let plan = recipes.path().join("plans/plain.toml");
    let text = std::fs::read_to_string(&plan).expect("a plan");
    std::fs::write(&plan, format!("range_sensor = \"blind\"\n{text}")).expect("written");
    let output = recipes.path().join("run");
    let mut command = cornerbench();
    command.args(["measure", "plain"]).arg(plain_dataset()).arg("--recipes").arg(recipes.path());
    succeed(command.arg("--output").arg(&output));
    let described: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(output.join("run.json")).expect("run.json"))
            .expect("JSON");
    assert_eq!(described["range_sensor"], "blind");
    let summary = std::fs::read_to_string(output.join("summary.json")).unwrap_or_default();
    let records = read_records(&output.join("records.parquet")).expect("records");
    let grasps: Vec<_> = records.iter().filter(|record| record.kind == "grasp").collect();
    assert!(!grasps.is_empty(), "{summary}");
    assert!(grasps.iter().all(|grasp| grasp.status != "ok"), "{summary}");
}
