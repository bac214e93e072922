//! Grasps in physics, by the program: what becomes of a run's grasps, resumed, refused, failed and shown.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::support::{
    board_dataset, copy_of_plain, cornerbench, plain_dataset, python, recipes, run, stderr, stdout,
    succeed,
};

/// A run of the tests' plan on a dataset.
fn measured(dataset: &Path) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut command = cornerbench();
    command.args(["measure", "grasping"]).arg(dataset).arg("-o").arg(folder.path());
    succeed(command.arg("--recipes").arg(recipes()).args(["--no-timing", "--quiet"]));
    folder
}

/// The command for a run's grasps; Python is there.
fn grasp(dataset: &Path, run: &Path) -> Command {
    python();
    let mut command = cornerbench();
    command.arg("grasp").arg(dataset).arg(run);
    command
}

fn outcomes(run: &Path) -> PathBuf {
    run.join("grasps/parallel-160-flying")
}

fn method<'a>(summary: &'a Value, name: &str) -> &'a Value {
    let methods = summary["methods"].as_array().expect("methods");
    methods.iter().find(|method| method["method"] == name).expect(name)
}

#[test]
fn grasps_from_true_corners_hold_and_the_same_command_carries_out_none_twice() {
    let folder = measured(plain_dataset());
    let said = succeed(grasp(plain_dataset(), folder.path()).arg("--json"));
    let summary: Value = serde_json::from_str(&said).expect("JSON");
    assert_eq!(summary["reachable"], summary["scenes"]);
    let value = |name: &str, share: &str| method(&summary, name)[share]["value"].as_f64();
    assert_eq!(value("true: reachable", "success"), Some(1.0));
    assert_eq!(value("true: moved 30 mm", "success"), Some(0.0));
    let exact = method(&summary, "given-disc_px=0");
    assert_eq!(exact["corner_rmse_px"].as_f64().map(|error_px| error_px < 1e-9), Some(true));
    assert!(value("given-disc_px=0", "success") >= value("given-disc_px=20", "success"));
    let asked = |name: &str| method(&summary, name)["asked"].as_u64();
    assert_eq!(asked("found"), summary["scenes"].as_u64());

    let folder_of = outcomes(folder.path());
    for file in ["attempts.parquet", "summary.json", "index.html", "success.svg"] {
        assert!(folder_of.join(file).is_file(), "{file}");
    }
    let scenes: Vec<PathBuf> = fs::read_dir(folder_of.join("scenes"))
        .expect("a folder")
        .map(|entry| entry.expect("an entry").path())
        .collect();
    let read = |path: &Path| fs::read(path).expect("a file");
    let rows = read(&folder_of.join("attempts.parquet"));
    let contents: Vec<Vec<u8>> = scenes.iter().map(|path| read(path)).collect();
    fs::remove_file(&scenes[0]).expect("a file");
    fs::write(folder_of.join("scenes/.rendering-x~1"), "half").expect("written");
    let again = run(&mut grasp(plain_dataset(), folder.path()));
    assert!(again.status.success(), "{}", stderr(&again));
    let there = format!("the grasps of {} of {} scenes", scenes.len() - 1, scenes.len());
    assert!(stderr(&again).contains(&there), "{}", stderr(&again));
    assert!(stdout(&again).contains("true: reachable"), "{}", stdout(&again));
    assert_eq!(read(&folder_of.join("attempts.parquet")), rows);
    for (path, content) in scenes.iter().zip(&contents) {
        assert_eq!(&read(path), content, "{}", path.display());
    }
    assert!(!folder_of.join("scenes/.rendering-x~1").exists());
}

#[test]
fn the_rows_say_of_every_grasp_asked_for_what_became_of_it() {
    let folder = measured(plain_dataset());
    succeed(grasp(plain_dataset(), folder.path()).args(["--robot", "youbot", "--quiet"]));
    let path = folder.path().join("grasps/parallel-160-youbot/attempts.parquet");
    let program = "import pandas, sys
rows = pandas.read_parquet(sys.argv[1])
run = pandas.read_parquet(sys.argv[2])
asked = run[run.kind == 'grasp']
methods = rows[~rows.is_control]
assert len(methods) == len(asked)
assert (methods.outcome.str.len() > 0).all()
none = methods[methods.outcome == 'no_grasp']
assert len(none) == (asked.status != 'ok').sum() and none.reason.notna().all()
assert set(rows.robot) == {'youbot'} and not methods[methods.outcome == 'unreachable'].executed.any()
together = methods.merge(asked, on=['scene', 'camera', 'exposure', 'method'])
assert len(together) == len(asked) and together.grasp_error_mm_x.equals(together.grasp_error_mm_y)
corners = run[(run.kind == 'corner') & (run.status == 'ok')]
errors = (corners.refined_error_px ** 2).groupby([corners.scene, corners.method]).mean() ** 0.5
for row in methods[methods.corner_rmse_px.notna()].itertuples():
    assert abs(errors[row.scene, row.method] - row.corner_rmse_px) < 1e-12";
    let records = folder.path().join("records.parquet");
    succeed(Command::new(python()).args(["-c", program]).arg(path).arg(records));
}

#[test]
fn what_cannot_be_grasped_is_refused_with_the_way_out() {
    let folder = measured(plain_dataset());
    let refused = |command: &mut Command| {
        let output = run(command);
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        stderr(&output)
    };
    let unknown = refused(grasp(plain_dataset(), folder.path()).args(["--gripper", "paralel-160"]));
    assert!(unknown.contains("did you mean \"parallel-160\""), "{unknown}");
    let unknown = refused(grasp(plain_dataset(), folder.path()).args(["--method", "fond"]));
    assert!(unknown.contains("did you mean \"found\""), "{unknown}");
    let other = refused(&mut grasp(board_dataset(), folder.path()));
    assert!(other.contains("name the dataset that the run is of"), "{other}");
    let scene = refused(grasp(plain_dataset(), folder.path()).args(["--show", "nowhere"]));
    assert!(scene.contains("nowhere"), "{scene}");
    let corners = tempfile::tempdir().expect("a temporary folder");
    let mut command = cornerbench();
    command.args(["measure", "seeds"]).arg(plain_dataset()).arg("-o").arg(corners.path());
    succeed(command.arg("--recipes").arg(recipes()).args(["--no-timing", "--quiet"]));
    let none = refused(&mut grasp(plain_dataset(), corners.path()));
    assert!(none.contains("has no grasps; measure a plan"), "{none}");
}

#[test]
fn a_scene_that_cannot_be_rebuilt_is_rows_with_its_reason() {
    let dataset = copy_of_plain();
    let folder = measured(dataset.path());
    let scene = fs::read_dir(dataset.path())
        .expect("a folder")
        .map(|entry| entry.expect("an entry").path())
        .find(|path| path.is_dir())
        .expect("a scene");
    fs::write(scene.join("scene.json"), "{}").expect("written");
    let output = run(grasp(dataset.path(), folder.path()).arg("--json"));
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("scene.json: KeyError"), "{}", stderr(&output));
    let summary: Value = serde_json::from_str(&stdout(&output)).expect("JSON");
    assert_eq!(method(&summary, "given-disc_px=0")["outcomes"]["failed"], 1);
}
