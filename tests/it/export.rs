//! Exports: opened by the public readers, whole or not at all, nothing foreign overwritten.

use std::fs;
use std::io::Cursor;
use std::path::Path;
use std::process::{Command, Output};

use exr::prelude::{FlatSamples, WritableImage, read_all_flat_layers_from_file};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::dataset::{json, rewrite};
use crate::support::{
    board_dataset, copy_of_plain, cornerbench, plain_dataset, project, python, run, stderr, succeed,
};

/// Pixels from which something hides the target of `oblique`: a hole in its visible mask.
const HIDDEN_HALF_WIDTH_PX: f64 = 6.0;

fn export(dataset: &Path, format: &str, output: &Path) -> Output {
    let mut command = cornerbench();
    command.args(["export", "--format", format]).arg(dataset).arg("--output").arg(output);
    run(&mut command)
}

/// Has Python's pytest check an export beside its dataset.
fn check_by(peer: &str, dataset: &Path, output: &Path) {
    succeed(
        Command::new(python())
            .args(["-m", "pytest", "--quiet"])
            .arg(Path::new("tests/peers").join(peer))
            .env("CORNERBENCH_DATASET", dataset)
            .env("CORNERBENCH_EXPORT", output)
            .current_dir(project().join("scripts")),
    );
}

/// The plain dataset with something small before the middle of one target.
fn partly_hidden() -> TempDir {
    let copy = copy_of_plain();
    let scene = copy.path().join("oblique");
    let truth = json(&scene.join("truth.json"));
    let corners = truth["corners"].as_array().expect("corners");
    let middle = [0, 1].map(|axis| {
        let of_corner = |corner: &Value| corner["image_point_px"][axis].as_f64().expect("a number");
        corners.iter().map(of_corner).sum::<f64>() / 8.0
    });
    let path = scene.join("geometry.exr");
    let mut image = read_all_flat_layers_from_file(&path).expect("OpenEXR");
    let layer = &mut image.layer_data[0];
    let width = layer.size.width();
    for channel in &mut layer.channel_data.list {
        let name = channel.name.to_string();
        let mut set = |place: usize| match (&mut channel.sample_data, name.as_str()) {
            (FlatSamples::F32(depth), "depth.Z") => depth[place] = 0.5,
            (FlatSamples::U32(id), "object.id") => id[place] = 10,
            (FlatSamples::U32(id), "face.id") => id[place] = 255,
            _ => {}
        };
        for place in 0..layer.size.area() {
            let (x, y) = ((place % width) as f64, (place / width) as f64);
            if (x - middle[0]).abs().max((y - middle[1]).abs()) < HIDDEN_HALF_WIDTH_PX {
                set(place);
            }
        }
    }
    let mut bytes = Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).expect("written");
    rewrite(copy.path(), "oblique", "geometry.exr", bytes.into_inner());
    copy
}

#[test]
fn a_bop_export_is_what_bop_s_rules_say() {
    let dataset = partly_hidden();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = folder.path().join("bop");
    let ended = export(dataset.path(), "bop", &output);
    assert_eq!(ended.status.code(), Some(0), "{}", stderr(&ended));
    check_by("bop_export.py", dataset.path(), &output);
}

#[test]
fn a_coco_export_is_read_by_pycocotools() {
    let dataset = partly_hidden();
    // One corner that another object hides, and two outside the image, which has its own word for the
    // one of them only.
    let mut truth = json(&dataset.path().join("oblique/truth.json"));
    let corners = truth["corners"].as_array_mut().expect("corners");
    let find = |corners: &[Value], visibility: &str| {
        let is = |corner: &Value| corner["visibility"] == visibility;
        corners.iter().position(is).expect("such a corner")
    };
    let hidden = find(corners, "self-occluded");
    corners[hidden]["image_point_px"] = json!([20.0, 1e4]);
    for visibility in ["occluded", "outside"] {
        let seen = find(corners, "visible");
        corners[seen]["visibility"] = json!(visibility);
    }
    let outside = find(corners, "outside");
    corners[outside]["image_point_px"] = json!([-0.6, 20.0]);
    rewrite(dataset.path(), "oblique", "truth.json", truth.to_string());

    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = folder.path().join("coco");
    let ended = export(dataset.path(), "coco", &output);
    assert_eq!(ended.status.code(), Some(0), "{}", stderr(&ended));
    check_by("coco_export.py", dataset.path(), &output);
}

#[test]
fn a_target_of_which_nothing_is_seen_has_no_coco_annotation() {
    let copy = copy_of_plain();
    let mut scene = json(&copy.path().join("above/scene.json"));
    scene["target"]["object_id"] = json!(99);
    rewrite(copy.path(), "above", "scene.json", scene.to_string());
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = folder.path().join("coco");
    let ended = export(copy.path(), "coco", &output);
    assert_eq!(ended.status.code(), Some(0), "{}", stderr(&ended));
    let content = json(&output.join("annotations.json"));
    assert_eq!(content["images"].as_array().map(Vec::len), Some(2));
    assert_eq!(content["annotations"].as_array().map(Vec::len), Some(1));
    assert_eq!(content["annotations"][0]["image_id"], content["images"][1]["id"]);
}

#[test]
fn a_board_is_a_flat_box_to_bop_and_has_keypoints_of_its_own_in_coco() {
    let truth = json(&board_dataset().join("board/truth.json"));
    let folder = tempfile::tempdir().expect("a temporary folder");
    for format in ["bop", "coco"] {
        let ended = export(board_dataset(), format, &folder.path().join(format));
        assert_eq!(ended.status.code(), Some(0), "{}", stderr(&ended));
    }
    let model = &json(&folder.path().join("bop/models/models_info.json"))["1"];
    for (key, size_mm) in [("size_x", 210.0), ("size_y", 150.0), ("size_z", 4.0)] {
        let found = model[key].as_f64().expect("a number");
        assert!((found - size_mm).abs() < 1e-9, "{key} is {found}");
    }
    // Upside down it shows no pattern.
    assert_eq!(model["symmetries_discrete"].as_array().map(Vec::len), Some(1), "{model}");
    let seen = &json(&folder.path().join("bop/test/000000/scene_gt_info.json"))["0"][0];
    assert!(seen["visib_fract"].as_f64().expect("a number") > 0.99, "{seen}");

    let content = json(&folder.path().join("coco/annotations.json"));
    let category = &content["categories"][0];
    assert_eq!(category["name"], "board-24");
    assert_eq!(category["supercategory"], "board");
    assert_eq!(category["keypoints"].as_array().map(Vec::len), Some(24));
    let edges = truth["edges"].as_array().map(Vec::len);
    assert_eq!(category["skeleton"].as_array().map(Vec::len), edges);
    let annotation = &content["annotations"][0];
    assert_eq!(annotation["num_keypoints"], 24);
    for (place, corner) in truth["corners"].as_array().expect("corners").iter().enumerate() {
        let [x, y] = [0, 1].map(|axis| &corner["image_point_px"][axis]);
        assert_eq!(&annotation["keypoints"][3 * place], x);
        assert_eq!(&annotation["keypoints"][3 * place + 1], y);
    }
}

#[test]
fn a_scene_that_cannot_be_read_is_named_and_counted_and_the_rest_is_exported() {
    for format in ["bop", "coco"] {
        let copy = copy_of_plain();
        fs::remove_file(copy.path().join("above/film.exr")).expect("removed");
        let folder = tempfile::tempdir().expect("a temporary folder");
        let output = folder.path().join("export");
        let ended = export(copy.path(), format, &output);
        assert_eq!(ended.status.code(), Some(1), "{}", stderr(&ended));
        assert!(stderr(&ended).contains("above skipped"), "{}", stderr(&ended));
        let manifest = json(&output.join("export.json"));
        assert_eq!(manifest["unreadable"][0]["scene"], "above");
        assert_eq!(manifest["scenes"].as_array().map(Vec::len), Some(1));
        // Ids are those of the places in the dataset, whatever is missing.
        assert_eq!(manifest["scenes"][0]["place"], 1);
        if format == "bop" {
            assert!(output.join("test/000001/rgb/000000.png").is_file());
            assert!(!output.join("test/000000").exists());
        } else {
            assert_eq!(json(&output.join("annotations.json"))["images"][0]["id"], 2);
        }
    }
}

#[test]
fn a_target_that_reaches_behind_the_camera_is_an_unreadable_scene() {
    let copy = copy_of_plain();
    let mut scene = json(&copy.path().join("above/scene.json"));
    scene["target"]["size_m"] = json!([0.1, 0.1, 100.0]);
    rewrite(copy.path(), "above", "scene.json", scene.to_string());
    let folder = tempfile::tempdir().expect("a temporary folder");
    let ended = export(copy.path(), "bop", &folder.path().join("bop"));
    assert_eq!(ended.status.code(), Some(1), "{}", stderr(&ended));
    assert!(stderr(&ended).contains("above/scene.json: the target reaches behind the camera"));
}

#[test]
fn nothing_appears_when_no_scene_can_be_read() {
    let copy = copy_of_plain();
    for scene in ["above", "oblique"] {
        fs::remove_file(copy.path().join(scene).join("truth.json")).expect("removed");
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let ended = export(copy.path(), "bop", &folder.path().join("bop"));
    assert_eq!(ended.status.code(), Some(2), "{}", stderr(&ended));
    assert!(stderr(&ended).contains("none of its 2 scenes"), "{}", stderr(&ended));
    assert_eq!(fs::read_dir(folder.path()).expect("there").count(), 0);
}

#[test]
fn an_export_replaces_an_export_and_nothing_else() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = folder.path().join("export");
    fs::create_dir(&output).expect("created");
    for format in ["bop", "coco"] {
        let ended = export(plain_dataset(), format, &output);
        assert_eq!(ended.status.code(), Some(0), "{}", stderr(&ended));
    }
    assert!(output.join("annotations.json").is_file() && !output.join("test").exists());
    assert_eq!(fs::read_dir(folder.path()).expect("there").count(), 1, "nothing is left beside it");

    fs::remove_file(output.join("export.json")).expect("removed");
    let ended = export(plain_dataset(), "bop", &output);
    assert_eq!(ended.status.code(), Some(2));
    assert!(stderr(&ended).contains("it is not an export"), "{}", stderr(&ended));
    assert!(output.join("annotations.json").is_file());
    let file = output.join("annotations.json");
    let before = fs::read(&file).expect("there");
    assert_eq!(export(plain_dataset(), "bop", &file).status.code(), Some(2));
    assert_eq!(fs::read(&file).expect("there"), before);
}

#[test]
fn an_unknown_format_and_camera_are_named_with_the_known_ones() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = folder.path().join("export");
    let ended = export(plain_dataset(), "coca", &output);
    assert_eq!(ended.status.code(), Some(2));
    let text = stderr(&ended);
    assert!(text.contains("'coca'") && text.contains("bop, coco"), "{text}");
    let mut command = cornerbench();
    command.args(["export", "--format", "bop", "--camera", "idael"]).arg(plain_dataset());
    let ended = run(command.arg("--output").arg(&output));
    assert_eq!(ended.status.code(), Some(2));
    let text = stderr(&ended);
    assert!(text.contains("unknown camera \"idael\"; did you mean \"ideal\"?"), "{text}");
    assert!(!output.exists());
}

#[test]
fn the_same_dataset_gives_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let bytes = |name: &str| {
        let output = folder.path().join(name);
        assert_eq!(export(plain_dataset(), "coco", &output).status.code(), Some(0));
        ["annotations.json", "images/above.png"].map(|file| fs::read(output.join(file)).ok())
    };
    let first = bytes("first");
    assert!(first[0].is_some() && first == bytes("second"));
}
