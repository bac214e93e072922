//! A rendered dataset: conventions, integrity, resumption, the whole pipeline over it.

use std::fs;
use std::path::Path;

use serde_json::Value;

use cornerbench::files::sha256_hex;
use cornerbench::junction::Junction;
use cornerbench::record::{Record, kind, read_records};
use cornerbench::scene::{Dataset, FORMAT, TargetKind, TrueCorner};
use nalgebra::Point3;

use crate::support::{
    board_dataset, copy_of_plain, cornerbench, plain_dataset, recipes, render, run, stderr, stdout,
    succeed,
};

pub fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).expect("a file")).expect("JSON")
}

/// Replaces a file of a dataset and its hash in the manifest: an alteration that no hash betrays.
pub fn rewrite(dataset: &Path, scene: &str, file: &str, content: impl AsRef<[u8]>) {
    let path = dataset.join(scene).join(file);
    fs::write(&path, &content).expect("written");
    let manifest = dataset.join("dataset.json");
    let mut entries = json(&manifest);
    entries["scenes"][scene]["files"][file]["sha256"] = Value::from(sha256_hex(content.as_ref()));
    fs::write(&manifest, entries.to_string()).expect("written");
}

/// Moves every projected corner of the dataset's truth.
fn shift_truth(dataset: &Path, shift: impl Fn(f64, f64) -> [f64; 2]) {
    for scene in ["above", "oblique"] {
        let mut truth = json(&dataset.join(scene).join("truth.json"));
        for corner in truth["corners"].as_array_mut().expect("corners") {
            let point = &mut corner["image_point_px"];
            let [x, y] = [0, 1].map(|axis| point[axis].as_f64().expect("a number"));
            *point = serde_json::json!(shift(x, y));
        }
        rewrite(dataset, scene, "truth.json", truth.to_string());
    }
}

fn verify(dataset: &Path) -> (Option<i32>, Value) {
    let output = run(cornerbench().args(["verify", "--json"]).arg(dataset));
    let value = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output.status.code(), value)
}

#[test]
fn rendered_corners_are_where_the_projection_says_to_a_hundredth_of_a_pixel() {
    let (code, found) = verify(plain_dataset());
    assert_eq!(code, Some(0), "{found}");
    // Two of the visible corners end edges that are too short to be measured.
    assert_eq!(found["visible"], 13, "{found}");
    let known = found["known_answers"].as_array().expect("known answers");
    assert_eq!(known.len(), 4, "{found}");
    assert!(known.iter().all(|known| known["passed"] == true), "{found}");
    for (evidence, length_px, corners) in [("coverage", 0.002, 11), ("radiance", 0.01, 6)] {
        let found = &found[evidence];
        assert!(found["mean"]["length_px"].as_f64().expect("a length") < length_px, "{found}");
        assert!(found["mean"]["corners"].as_u64().expect("a count") >= corners, "{found}");
    }
    let spread = found["coverage"]["root_mean_square_px"].as_f64().expect("a number");
    assert!(spread < 0.005, "{found}");
}

#[test]
fn verify_finds_half_a_pixel_with_its_direction() {
    let copy = copy_of_plain();
    shift_truth(copy.path(), |x, y| [x + 0.5, y]);
    let (code, found) = verify(copy.path());
    assert_eq!(code, Some(1), "{found}");
    for evidence in ["coverage", "radiance"] {
        let x = found[evidence]["mean"]["mean_px"][0].as_f64().expect("a number");
        assert!((x + 0.5).abs() < 0.02, "{evidence}: {found}");
    }
}

#[test]
fn verify_finds_a_three_hundredth_of_a_pixel() {
    let copy = copy_of_plain();
    shift_truth(copy.path(), |x, y| [x, y - 0.003]);
    let (code, found) = verify(copy.path());
    assert_eq!(code, Some(1), "{found}");
    assert_eq!(found["coverage"]["passed"], false, "{found}");
}

#[test]
fn verify_finds_a_coverage_that_begins_one_pixel_beside_the_fovea() {
    let copy = copy_of_plain();
    let mut scene = json(&copy.path().join("above/scene.json"));
    let fovea = &mut scene["film"]["fovea_px"];
    for edge in [0, 2] {
        fovea[edge] = Value::from(fovea[edge].as_u64().expect("a whole number") + 1);
    }
    rewrite(copy.path(), "above", "scene.json", scene.to_string());
    let (code, found) = verify(copy.path());
    assert_eq!(code, Some(1), "{found}");
    assert_eq!(found["coverage"]["passed"], false, "{found}");
}

#[test]
fn verify_counts_what_it_cannot_measure() {
    let copy = copy_of_plain();
    let mut scene = json(&copy.path().join("above/scene.json"));
    scene["target"]["bevel_radius_m"] = Value::from(0.001);
    rewrite(copy.path(), "above", "scene.json", scene.to_string());
    let mut scene = json(&copy.path().join("oblique/scene.json"));
    let (code, found) = verify(copy.path());
    assert_eq!(code, Some(0), "{found}");
    assert_eq!(found["not_sharp"], 1, "{found}");
    scene["lens"] = serde_json::json!({ "aperture_radius_m": 0.01, "focus_distance_m": 1.0 });
    rewrite(copy.path(), "oblique", "scene.json", scene.to_string());
    assert_eq!(verify(copy.path()).0, Some(2), "nothing is left to be measured");
}

#[test]
fn a_board_s_corners_are_read_row_by_row_and_are_where_the_projection_says() {
    let (code, found) = verify(board_dataset());
    assert_eq!(code, Some(0), "{found}");
    assert_eq!(found["coverage"]["mean"]["corners"], 24, "{found}");

    let dataset = Dataset::open(board_dataset()).expect("a dataset");
    let scene = dataset.read("board").expect("a scene");
    let target = &scene.description.target;
    assert_eq!(target.kind, TargetKind::Board);
    assert_eq!(scene.truth.corners.len(), 24);
    for corner in &scene.truth.corners {
        let (column, row) = (corner.index % 6, corner.index / 6);
        let inside = (1..5).contains(&column) && (1..3).contains(&row);
        let junction = if inside { Junction::X } else { Junction::L };
        assert_eq!(corner.junction, Some(junction), "corner {}", corner.index);
        let own = Point3::new(0.03 * (column as f64 - 2.5), 0.03 * (row as f64 - 1.5), 0.004);
        let expected = target.world_from_target * own;
        let off_m = (expected - Point3::from(corner.position_m)).norm();
        assert!(off_m < 1e-12, "corner {} is {off_m} m off", corner.index);
    }
}

#[test]
fn a_truth_whose_parts_do_not_fit_together_is_unreadable() {
    let alterations: [fn(&mut Value); 4] = [
        |truth| truth["corners"][0]["edges"][0]["edge"] = Value::from(12),
        |truth| truth["edges"][0]["visible"][0]["end"] = Value::from(1.01),
        |truth| truth["edges"][3]["corners"][1] = Value::from(8),
        |truth| truth["false_junctions"][0]["edge"] = Value::from(12),
    ];
    for alter in alterations {
        let copy = copy_of_plain();
        let mut truth = json(&copy.path().join("oblique/truth.json"));
        alter(&mut truth);
        rewrite(copy.path(), "oblique", "truth.json", truth.to_string());
        let dataset = Dataset::open(copy.path()).expect("a dataset");
        let said = dataset.read("oblique").expect_err("nonsense").chain();
        assert!(said.contains("oblique/truth.json: corners, edges and faces"), "{said}");
    }
}

/// The rows of a run over `dataset`.
fn records_of(dataset: &Path, more: &[&str]) -> Vec<Record> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = measure(dataset, folder.path(), more);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    read_records(&folder.path().join("records.parquet")).expect("records")
}

#[test]
fn the_grasp_goes_where_the_range_sensor_s_own_pose_says() {
    let copy = copy_of_plain();
    for scene in ["above", "oblique"] {
        let mut description = json(&copy.path().join(scene).join("scene.json"));
        let x = &mut description["world_from_range"][0][3];
        *x = Value::from(x.as_f64().expect("a number") + 0.125);
        rewrite(copy.path(), scene, "scene.json", description.to_string());
    }
    let grasps = |dataset: &Path| -> Vec<[f64; 3]> {
        let rows = records_of(dataset, &[]);
        let point =
            |row: &Record| Some([row.grasp_world_x_m?, row.grasp_world_y_m?, row.grasp_world_z_m?]);
        rows.iter().filter(|row| row.kind == kind::GRASP).filter_map(point).collect()
    };
    let (before, after) = (grasps(plain_dataset()), grasps(copy.path()));
    assert!(!before.is_empty() && before.len() == after.len(), "{before:?} {after:?}");
    for ([x, y, z], moved) in before.iter().zip(&after) {
        for (expected, found) in [x + 0.125, *y, *z].iter().zip(moved) {
            assert!((expected - found).abs() < 1e-9, "{before:?} {after:?}");
        }
    }
}

#[test]
fn one_split_is_measured_where_one_is_asked_for() {
    let truth = Dataset::open(plain_dataset()).expect("a dataset");
    for (split, scene) in [("dev", "above"), ("test", "oblique")] {
        let records = records_of(plain_dataset(), &["--split", split]);
        assert!(records.iter().all(|record| record.scene == scene), "{split}");
        assert!(records.iter().all(|record| record.split.as_deref() == Some(split)), "{split}");
        // Its corners with what the truth says of them.
        let corners = truth.read(scene).expect("a scene").truth.corners;
        let found = records.iter().filter(|record| record.kind == kind::CORNER);
        let found: Vec<_> =
            found.map(|row| (row.junction.as_deref(), row.render_noise_floor_px)).collect();
        let of_corner = |c: &TrueCorner| (c.junction.map(Junction::name), c.render_noise_floor_px);
        let expected: Vec<_> = corners.iter().map(of_corner).collect();
        for row in &expected {
            assert!(found.contains(row), "{split}: {row:?} is not in {found:?}");
        }
        assert!(expected.iter().filter(|(_, floor)| floor.is_some()).count() >= 4, "{expected:?}");
    }
}

#[test]
fn verify_does_not_pass_a_mirrored_projection() {
    let copy = copy_of_plain();
    let camera = json(&copy.path().join("above/scene.json"))["camera"].clone();
    let centre = camera["cx_px"].as_f64().expect("a number");
    shift_truth(copy.path(), |x, y| [2.0 * centre - x, y]);
    let (code, found) = verify(copy.path());
    assert_ne!(code, Some(0), "{found}");
}

fn measure(dataset: &Path, output: &Path, more: &[&str]) -> std::process::Output {
    run(cornerbench()
        .args(["measure", "plain", "--json", "--recipes"])
        .arg(recipes())
        .args(more)
        .arg("--output")
        .arg(output)
        .arg(dataset))
}

#[test]
fn the_whole_pipeline_finds_corners_and_a_grasp_near_the_truth() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = measure(plain_dataset(), folder.path(), &[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let summary: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let method = &summary["methods"][0];
    let corners = &method["corners"];
    assert!(corners["found"].as_u64().expect("a count") >= 8, "{corners}");
    assert!(corners["detected"]["median_px"].as_f64().expect("a number") < 2.0, "{corners}");
    assert!(corners["refined_errors"]["median_px"].as_f64().expect("a number") < 2.0, "{corners}");
    assert!(method["grasps"]["answered"].as_u64().expect("a count") >= 1, "{method}");
    // A range cell is 8 px or 28 mm wide at 1 m: its own point is within 20 mm of any in it.
    let grasp = method["grasps"]["median_error_mm"].as_f64().expect("a number");
    assert!(grasp < 30.0, "{method}");
    for name in ["records.parquet", "summary.json", "run.json", "report/index.html"] {
        assert!(folder.path().join(name).is_file(), "{name} is missing");
    }
}

#[test]
fn one_thread_and_two_give_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let read = |threads: &str| {
        let run = folder.path().join(threads);
        let output = measure(plain_dataset(), &run, &["--threads", threads]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        fs::read(run.join("records.parquet")).expect("records")
    };
    assert!(read("1") == read("2"), "records differ");
}

#[test]
fn an_altered_a_truncated_and_a_missing_file_are_named_skipped_and_counted() {
    for damage in ["altered", "truncated", "missing"] {
        let copy = copy_of_plain();
        let film = copy.path().join("above/film.exr");
        let mut bytes = fs::read(&film).expect("a film");
        match damage {
            "altered" => bytes[4321] ^= 1,
            "truncated" => bytes.truncate(1000),
            _ => {}
        }
        fs::write(&film, &bytes).expect("written");
        if damage == "missing" {
            fs::remove_file(&film).expect("removed");
        }
        let folder = tempfile::tempdir().expect("a temporary folder");
        let output = measure(copy.path(), folder.path(), &[]);
        assert_eq!(output.status.code(), Some(1), "{damage}: {}", stderr(&output));
        let summary: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        let skipped = &summary["unreadable"][0];
        assert_eq!(skipped["scene"], "above", "{damage}");
        let reason = skipped["reason"].as_str().expect("a reason");
        let expected = json(&copy.path().join("dataset.json"));
        let expected = expected["scenes"]["above"]["files"]["film.exr"]["sha256"].clone();
        assert!(reason.contains("above/film.exr"), "{damage}: {reason}");
        assert!(reason.contains(expected.as_str().expect("a hash")), "{damage}: {reason}");
        if damage == "missing" {
            assert!(reason.contains("no file"), "{reason}");
        } else {
            assert!(reason.contains(&sha256_hex(&bytes)), "{reason}");
        }
        let scenes = summary["methods"][0]["scenes"].as_array().expect("scenes");
        assert_eq!(scenes.len(), 1, "{damage}: the other scene is measured");
    }
}

#[test]
fn no_red_region_is_a_counted_status() {
    let copy = tempfile::tempdir().expect("a temporary folder");
    crate::support::copy_folder(&recipes(), copy.path());
    let plan = copy.path().join("plans/plain.toml");
    let text = fs::read_to_string(&plan).expect("a plan").replace("100.0", "254.0");
    fs::write(&plan, text).expect("written");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = run(cornerbench()
        .args(["measure", "plain", "--json", "--recipes"])
        .arg(copy.path())
        .arg("--output")
        .arg(folder.path())
        .arg(plain_dataset()));
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let summary: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let method = &summary["methods"][0];
    for scene in method["scenes"].as_array().expect("scenes") {
        assert_eq!(scene["grasp_status"], "no_target");
        assert_eq!(scene["grasp_reason"], "no_pixel");
    }
    assert_eq!(method["corners"]["found"], 0);
    assert_eq!(method["corners"]["detected"], Value::Null);
    assert!(!stdout(&output).contains("NaN"));
    let page = fs::read_to_string(folder.path().join("report/index.html")).expect("a page");
    assert!(!page.contains("NaN"), "NaN on the page");
}

#[test]
fn rendering_again_does_only_what_is_missing_or_changed() {
    let copy = copy_of_plain();
    let modified = |scene: &str| {
        fs::metadata(copy.path().join(scene).join("film.exr")).expect("a film").modified().ok()
    };
    let before = (modified("above"), modified("oblique"));
    render("plain", copy.path());
    assert_eq!((modified("above"), modified("oblique")), before, "nothing was missing");

    let truth = copy.path().join("above/truth.json");
    let damaged = fs::read_to_string(&truth).expect("truth").replacen('1', "2", 1);
    fs::write(&truth, damaged).expect("written");
    render("plain", copy.path());
    assert_eq!(modified("oblique"), before.1, "only the damaged scene is rendered again");
    assert_ne!(modified("above"), before.0);

    // The same recipe gives the same truth and, on the same machine, the same film.
    for file in ["truth.json", "scene.json", "film.exr", "geometry.exr", "range.exr"] {
        let read = |folder: &Path| fs::read(folder.join("above").join(file)).expect("a file");
        assert!(read(copy.path()) == read(plain_dataset()), "{file} differs");
    }
}

#[test]
fn a_manifest_that_points_outside_its_folder_is_refused() {
    let copy = copy_of_plain();
    let path = copy.path().join("dataset.json");
    let text = fs::read_to_string(&path).expect("a manifest").replace("\"above\"", "\"../above\"");
    fs::write(&path, text).expect("written");
    let output = run(cornerbench().arg("verify").arg(copy.path()));
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("../above"), "{}", stderr(&output));
}

#[test]
fn a_dataset_of_another_format_says_how_to_render_it_again() {
    let copy = copy_of_plain();
    let path = copy.path().join("dataset.json");
    let text = fs::read_to_string(&path).expect("a manifest");
    let older = text.replacen(&format!("\"format\": {FORMAT}"), "\"format\": 1", 1);
    assert_ne!(older, text);
    fs::write(&path, older).expect("written");
    let output = run(cornerbench().arg("verify").arg(copy.path()));
    assert_eq!(output.status.code(), Some(2));
    let wanted = format!("format is 1, this program reads {FORMAT}; render it again");
    assert!(stderr(&output).contains(&wanted), "{}", stderr(&output));
    render("plain", copy.path());
    assert_eq!(verify(copy.path()).0, Some(0));
}

#[test]
fn a_folder_that_is_no_run_is_not_overwritten() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    fs::create_dir(folder.path().join("scenes")).expect("created");
    fs::write(folder.path().join("scenes/mine.toml"), "mine").expect("written");
    let output = measure(plain_dataset(), folder.path(), &[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("it is not a run"), "{}", stderr(&output));
    assert!(folder.path().join("scenes/mine.toml").is_file());
}

#[test]
fn a_dataset_of_another_suite_is_not_overwritten() {
    let copy = copy_of_plain();
    let output = run(cornerbench().args(["render", "quick", "--output"]).arg(copy.path()));
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("holds suite 'plain'"), "{}", stderr(&output));
    assert_eq!(verify(copy.path()).0, Some(0));
}

#[test]
fn a_run_says_which_parameters_made_it_defaults_included() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = measure(plain_dataset(), folder.path(), &[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let run = json(&folder.path().join("run.json"));
    let detect = &run["pipelines"][0]["detect"];
    assert_eq!(detect["algorithm"], "harris");
    assert_eq!(detect["parameters"]["k"], 0.04);
    assert!(detect["parameters"]["nms_radius_px"].is_number(), "{detect}");
    assert_eq!(run["cameras"]["ideal"]["output"]["bit_depth"], 8);
}

#[test]
fn a_report_is_written_again_from_the_records_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = measure(plain_dataset(), folder.path(), &[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let page = folder.path().join("report/index.html");
    let first = fs::read_to_string(&page).expect("a page");
    fs::remove_dir_all(folder.path().join("report")).expect("removed");
    succeed(cornerbench().arg("report").arg(folder.path()));
    assert_eq!(fs::read_to_string(&page).expect("a page"), first);
}
