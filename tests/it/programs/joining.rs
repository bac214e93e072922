//! A program in a plan: its pipelines, its times.

use std::fs;

use cornerbench::record::Record;
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
