//! A program in a plan: its pipelines, its times.

use std::fs;

use cornerbench::record::{Record, kind, read_records, status};
use serde_json::Value;

use super::{Bench, CORNERS};
use crate::dataset::json;
use crate::support::*;

#[test]
fn a_new_user_s_refiner_in_python_is_a_method_as_the_documentation_says() {
    let text = fs::read_to_string(project().join("scripts/PROTOCOL.md")).expect("a page");
    let code = text.split("```python\n").nth(1).and_then(|rest| rest.split("```").next());
    let code = code.expect("an example");
    assert!(code.lines().count() <= 15, "{code}");
    let bench = Bench::new();
    let file = bench.path("mine.py");
    fs::write(&file, code).expect("written");
    python();
    let output = run(bench.measure(&file).env_remove("VIRTUAL_ENV").env_remove("CONDA_PREFIX"));
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let records = bench.records();
    let rows: Vec<&Record> = records.iter().filter(|row| row.method == "mine").collect();
    assert_eq!(rows.len(), CORNERS);
    for row in rows {
        assert!(row.refiner.starts_with("mine 1 (numpy "), "{}", row.refiner);
        assert_eq!((row.refined_x_px, row.refined_y_px), (row.detected_x_px, row.detected_y_px));
    }
}

#[test]
fn a_program_joins_each_stage_that_does_what_it_does_and_moves_no_other_method() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let list = |plan: &str, with: &[&str]| {
        let mut command = cornerbench();
        command.args(["measure", plan, "--list", "--json", "--recipes"]).arg(recipes());
        command.arg(plain_dataset());
        for does in with {
            let file = folder.path().join(format!("{does}.toml"));
            let table = format!("['own-{does}']\ndoes = '{does}'\ncommand = ['no such program']\n");
            fs::write(&file, table).expect("written");
            command.arg("--with").arg(file);
        }
        let said: Value = serde_json::from_str(&succeed(&mut command)).expect("JSON");
        let names = said["methods"].as_array().expect("methods").iter();
        names.map(|name| name.as_str().expect("a name").to_owned()).collect::<Vec<String>>()
    };
    let plain = list("seeds", &[]);
    let joined = list("seeds", &["refine"]);
    assert!(plain.iter().all(|name| joined.contains(name)), "{joined:?}");
    let new: Vec<&str> =
        joined.iter().filter(|name| !plain.contains(name)).map(String::as_str).collect();
    assert_eq!(
        new,
        ["given-disc_px=0.5-own-refine", "given-disc_px=2-own-refine", "found-own-refine"]
    );
    assert_eq!(list("plain", &["refine"]), ["paper", "own-refine"]);
    assert_eq!(list("plain", &["detect"]), ["paper", "own-detect"]);
    assert_eq!(list("plain", &["grasp"]), ["paper", "own-grasp"]);
    assert_eq!(
        list("plain", &["detect", "refine"]),
        ["paper", "own-refine", "own-detect", "own-detect-own-refine"]
    );
}

#[test]
fn times_are_a_program_s_own_with_the_protocol_s_beside_and_none_of_one_that_fails() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = folder.path().join("run");
    let command = |fault: &str| {
        let program = project().join("tests/programs/faults.py");
        serde_json::json!(["python3", program.display().to_string(), fault])
    };
    let tables = format!(
        "[well]\ncommand = {}\n[badly]\ncommand = {}\ndoes = 'refine'\n",
        command("none"),
        command("says_so")
    );
    let file = folder.path().join("two.toml");
    fs::write(&file, tables).expect("written");
    let mut measure = cornerbench();
    measure.args(["measure", "plain", "--quiet", "--recipes"]).arg(recipes());
    let done = run(measure.arg(plain_dataset()).arg("-o").arg(&output).arg("--with").arg(&file));
    let timing = json(&output.join("timing.json"));
    let of = |name: &str| {
        let methods = timing["methods"].as_array().expect("methods");
        methods.iter().find(|method| method["method"] == name).cloned()
    };
    let well = of("well").expect("times");
    // Its own clock says 1 us, to which comes what is done here before it is asked.
    let own_us = well["refine_us"]["median"].as_f64();
    assert!(own_us.is_some_and(|us| (1.0..5.0).contains(&us)), "{well}");
    assert!(well["protocol_us"][1]["median"].as_f64().is_some_and(|us| us > 10.0), "{well}");
    assert!(of("paper").is_some_and(|paper| paper.get("protocol_us").is_none()));
    // Two scenes, and its third question is the first to be timed: whatever was measured before, it has no time.
    assert!(of("badly").is_none(), "{}", stdout(&done));
    let programs = timing["programs"].as_array().expect("programs");
    let well = programs.iter().find(|program| program["name"] == "well").expect("the program");
    if cfg!(target_os = "linux") {
        assert!(well["threads"].as_u64() >= Some(1) && well["processors"].is_string(), "{well}");
    }
    let page = fs::read_to_string(output.join("report/index.html")).expect("a page");
    assert!(page.contains(" + "), "own time and the protocol's");
}

/// A grasp estimator that looks up the nearest range cell of the face's middle, and tells how to close on it.
const GRASPS: &str = "import numpy as np
from cornerbench import Grasp, serve


def grasp(question):
    middle = question.face.mean(axis=0)
    points = question.range_points_m.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    world = points @ question.world_from_range[:, :3].T + question.world_from_range[:, 3]
    turn, place = question.world_from_camera[:, :3], question.world_from_camera[:, 3]
    seen = (world - place) @ turn
    camera = question.camera
    x = camera['fx_px'] * seen[:, 0] / seen[:, 2] + camera['cx_px']
    y = camera['fy_px'] * seen[:, 1] / seen[:, 2] + camera['cy_px']
    nearest = np.hypot(x - middle[0], y - middle[1]).argmin()
    up = turn.T @ [0.0, 0.0, 1.0]
    return Grasp(middle, seen[nearest], up, turn.T @ [0.6, 0.8, 0.5], 0.1, 4e-6 * np.eye(3))


serve(version='1', grasp=grasp)
";

#[test]
fn a_program_s_grasp_has_approach_jaws_and_covariance_in_the_world() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (file, output) = (folder.path().join("own.py"), folder.path().join("run"));
    fs::write(&file, GRASPS).expect("written");
    python();
    let mut measure = cornerbench();
    measure.args(["measure", "plain", "--quiet", "--no-timing", "--recipes"]).arg(recipes());
    measure.arg(plain_dataset()).arg("-o").arg(&output).arg("--with").arg(&file);
    succeed(measure.env_remove("VIRTUAL_ENV").env_remove("CONDA_PREFIX"));
    let records = read_records(&output.join("records.parquet")).expect("records");
    let grasps = |method: &str| -> Vec<&Record> {
        let of = |row: &&Record| row.method == method && row.kind == kind::GRASP;
        records.iter().filter(of).collect()
    };
    let answered: Vec<&Record> =
        grasps("own").into_iter().filter(|row| row.status == status::OK).collect();
    assert!(!answered.is_empty());
    for row in answered {
        let close = |value: Option<f64>, wanted: f64| {
            let value = value.expect("a number");
            assert!((value - wanted).abs() < 1e-9, "{value} {wanted}");
        };
        close(row.approach_world_z, 1.0);
        // Made square to the approach: what it was along the approach is gone.
        close(row.jaw_world_x, 0.6);
        close(row.jaw_world_y, 0.8);
        close(row.jaw_world_z, 0.0);
        close(row.opening_m, 0.1);
        close(row.grasp_sigma_mm, 12.0_f64.sqrt());
        assert!(row.approach_error_deg.is_some() && row.grasp_nees.is_some());
        assert_eq!(row.approach_sigma_deg, None);
        // The same point, looked up the same way.
        let own = grasps("paper").into_iter().find(|own| own.scene == row.scene).expect("a row");
        close(row.grasp_world_x_m, own.grasp_world_x_m.expect("a number"));
        close(row.grasp_error_mm, own.grasp_error_mm.expect("a number"));
    }
}
