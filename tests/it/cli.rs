//! The command line through the binary: what it says when something is wrong.

use std::fs;
use std::path::Path;

use crate::support::{copy_folder, cornerbench, recipes, run, stderr, stdout, succeed};

/// Runs `cornerbench measure plain` or `render plain` over recipes of which one file was edited;
/// returns exit code and standard error, with the recipes' folder as RECIPES.
fn with_edited(file: &str, from: &str, to: &str, subcommand: &str) -> (Option<i32>, String) {
    let copy = tempfile::tempdir().expect("a temporary folder");
    copy_folder(&recipes(), copy.path());
    let path = copy.path().join(file);
    let text = fs::read_to_string(&path).expect("a recipe");
    assert!(text.contains(from), "{file} holds no {from:?}");
    fs::write(&path, text.replacen(from, to, 1)).expect("written");
    let nowhere = copy.path().join("output");
    let mut command = cornerbench();
    command.args([subcommand, "plain", "--recipes"]).arg(copy.path()).arg("--output").arg(&nowhere);
    if subcommand == "measure" {
        command.arg(crate::support::plain_dataset());
    }
    let output = run(&mut command);
    (output.status.code(), stderr(&output).replace(&copy.path().display().to_string(), "RECIPES"))
}

#[track_caller]
fn says(outcome: &(Option<i32>, String), code: i32, words: &[&str]) {
    assert_eq!(outcome.0, Some(code), "{}", outcome.1);
    for word in words {
        assert!(outcome.1.contains(word), "{word:?} is not in: {}", outcome.1);
    }
}

#[test]
fn an_unknown_suite_plan_or_dataset_is_named_with_the_next_step() {
    let output = run(cornerbench().args(["render", "quikc"]));
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("unknown suite \"quikc\"; did you mean \"quick\"?"));
    let empty = tempfile::tempdir().expect("a temporary folder");
    let output = run(cornerbench().args(["measure", "paper"]).arg(empty.path()));
    assert_eq!(output.status.code(), Some(2));
    let text = stderr(&output);
    assert!(text.contains("no dataset here") && text.contains("cornerbench render"), "{text}");
}

#[test]
fn a_plan_s_unknown_key_is_named_with_file_key_and_nearest() {
    let outcome = with_edited("plans/plain.toml", "k = 0.04", "kk = 0.04", "measure");
    says(
        &outcome,
        2,
        &[
            "RECIPES/plans/plain.toml: pipelines.0.detect: unknown key \"kk\"",
            "did you mean \"k\"?",
            "nms_radius_px",
        ],
    );
}

#[test]
fn a_plan_s_value_out_of_range_is_named_with_found_and_allowed() {
    let outcome = with_edited("plans/plain.toml", "k = 0.04", "k = 0.4", "measure");
    says(&outcome, 2, &["pipelines.0.detect", "k is 0.4", "must be in"]);
}

#[test]
fn a_plan_s_unknown_algorithm_is_named_with_the_nearest() {
    let outcome = with_edited("plans/plain.toml", "\"harris\"", "\"haris\"", "measure");
    says(&outcome, 2, &["unknown detector \"haris\"; did you mean \"harris\"?"]);
}

#[test]
fn a_camera_out_of_range_is_named() {
    let outcome = with_edited("cameras/ideal.toml", "bit_depth = 8", "bit_depth = 7", "measure");
    says(&outcome, 2, &["RECIPES/cameras/ideal.toml", "output.bit_depth is 7", "in [8, 16]"]);
}

#[test]
fn a_family_s_unknown_key_is_named_with_file_key_and_nearest() {
    let outcome = with_edited("families/plain.toml", "yaw_deg", "yaw_degree", "render");
    says(
        &outcome,
        2,
        &[
            "RECIPES/families/plain.toml",
            "target.yaw_degree",
            "did you mean 'yaw_deg'?",
            "target.yaw_deg is missing",
        ],
    );
}

#[test]
fn a_family_s_value_out_of_range_is_named_with_found_and_allowed() {
    let from = "horizontal_field_of_view_deg = 34.0";
    let to = "horizontal_field_of_view_deg = 340.0";
    let outcome = with_edited("families/plain.toml", from, to, "render");
    says(
        &outcome,
        2,
        &["camera.horizontal_field_of_view_deg is 340.0", "less than or equal to 150"],
    );
}

#[test]
fn a_suite_s_unknown_family_and_pose_are_named() {
    let outcome = with_edited("suites/plain.toml", "\"plain\"", "\"plane\"", "render");
    says(&outcome, 2, &["unknown", "plane", "did you mean 'plain'?"]);
    let outcome = with_edited("suites/plain.toml", "\"overhead\"", "\"overhaed\"", "render");
    says(&outcome, 1, &["above failed", "overhaed", "did you mean 'overhead'?"]);
}

#[test]
fn locate_refines_given_points_and_says_what_became_of_each() {
    let picture = picture();
    let text = succeed(cornerbench().arg("locate").arg(picture.path()).args([
        "--at",
        "30.4,20.6",
        "--at",
        "2,2",
    ]));
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 2, "{text}");
    assert!(lines[0].ends_with("ok"), "{text}");
    assert!(lines[1].ends_with("singular"), "{text}");
}

#[test]
fn locate_finds_the_corners_of_a_picture() {
    let text = succeed(cornerbench().arg("locate").arg(picture().path()));
    assert_eq!(text.lines().count(), 4, "{text}");
}

#[test]
fn locate_says_which_line_of_the_points_is_none() {
    let points = tempfile::NamedTempFile::new().expect("a temporary file");
    fs::write(points.path(), "1,2\n3;4\n").expect("written");
    let mut command = cornerbench();
    let output =
        run(command.arg("locate").arg(picture().path()).arg("--points").arg(points.path()));
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("line 2"), "{}", stderr(&output));
}

#[test]
fn locate_names_a_picture_that_is_none() {
    let output = run(cornerbench().args(["locate", "Cargo.toml"]));
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("Cargo.toml"), "{}", stderr(&output));
}

/// A white rectangle with corners between pixels (30, 20) and (70, 50) on black.
fn picture() -> tempfile::NamedTempFile {
    let file = tempfile::Builder::new().suffix(".png").tempfile().expect("a temporary file");
    let inside = |x, y| (31..70).contains(&x) && (21..50).contains(&y);
    image::RgbImage::from_fn(100, 80, |x, y| image::Rgb([if inside(x, y) { 220 } else { 20 }; 3]))
        .save(file.path())
        .expect("saved");
    file
}

#[test]
fn every_kind_can_be_listed_and_each_name_has_a_summary() {
    for kind in [
        "suites",
        "families",
        "plans",
        "cameras",
        "range-sensors",
        "targets",
        "detectors",
        "refiners",
        "faces",
        "grasps",
    ] {
        let text = succeed(cornerbench().args(["list", kind, "--json"]));
        let rows: Vec<serde_json::Value> = serde_json::from_str(&text).expect("JSON");
        assert!(!rows.is_empty(), "{kind} has no entry");
        for row in rows {
            assert!(!row["summary"].as_str().unwrap_or("").is_empty(), "{kind}: {row}");
        }
    }
}

#[test]
fn the_readme_s_commands_are_those_of_the_program() {
    let readme = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md"))
        .expect("a README");
    let help = stdout(&run(cornerbench().arg("--help")));
    let named: Vec<&str> = readme
        .lines()
        .filter_map(|line| line.strip_prefix("    cornerbench "))
        .filter_map(|rest| rest.split_whitespace().next())
        .collect();
    assert!(named.len() >= 5, "the README shows {named:?}");
    for command in named {
        assert!(help.contains(&format!("\n  {command} ")), "the README names {command}:\n{help}");
    }
}
