//! Refiners beside the Cramér-Rao bound, through the binary.

use std::fs;

use crate::support::{cornerbench, run, stderr, succeed};

fn number(score: &serde_json::Value, key: &str) -> f64 {
    score[key].as_f64().unwrap_or_else(|| panic!("no number {key} in {score}"))
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn the_junction_fit_is_on_the_bound_and_opencv_s_method_is_not() {
    let output = succeed(cornerbench().args([
        "limits",
        "--json",
        "--count",
        "40",
        "junction_fit",
        "corner_sub_pix",
    ]));
    let tables: serde_json::Value = serde_json::from_str(&output).expect("JSON");
    let rows: Vec<&serde_json::Value> = tables
        .as_array()
        .expect("tables")
        .iter()
        .flat_map(|table| table["rows"].as_array().expect("rows"))
        .collect();
    assert_eq!(rows.len(), 78);
    let of = |refiner: usize, key: &str| -> Vec<f64> {
        rows.iter().map(|row| number(&row["scores"][refiner], key)).collect()
    };
    // 40 corners tell a root mean square to 8 %, the mean of 78 such to 1 %.
    let ratio = mean(&of(0, "rmse_over_bound"));
    assert!((0.95..1.06).contains(&ratio), "{ratio}");
    let nees = mean(&of(0, "nees"));
    assert!((1.85..2.15).contains(&nees), "{nees}");
    let asked: f64 = of(0, "asked").iter().sum();
    let located: f64 = of(0, "located").iter().sum();
    assert!(located > 0.99 * asked, "{located} of {asked}");
    assert!(of(0, "bias_px").iter().all(|bias_px| *bias_px < 0.002));
    let theirs = mean(&of(1, "rmse_over_bound"));
    assert!(theirs > 4.0 * ratio, "{theirs}");
    // What is unknown makes a bound larger.
    let mut even = rows.iter().filter(|row| number(row, "ramp_per_px") == 0.0);
    assert!(even.all(|row| number(row, "bound_with_ramps_px") > number(row, "bound_px")));
}

#[test]
fn the_table_is_the_same_on_one_thread_and_on_many() {
    let of = |threads: &str| {
        let count = ["limits", "--json", "--count", "4", "junction_fit", "--threads"];
        succeed(cornerbench().args(count).arg(threads))
    };
    assert_eq!(of("1"), of("3"));
}

#[test]
fn the_table_goes_between_the_marks_of_a_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("table.md");
    let arguments = ["limits", "--quiet", "--count", "2", "none", "--write"];
    fs::write(&path, "no marks").expect("written");
    let output = run(cornerbench().args(arguments).arg(&path));
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("<!-- end of limits -->"), "{}", stderr(&output));
    fs::write(&path, "before\n<!-- limits -->\nold\n<!-- end of limits -->\nafter\n")
        .expect("written");
    succeed(cornerbench().args(arguments).arg(&path));
    let text = fs::read_to_string(&path).expect("the file");
    assert!(text.starts_with("before\n<!-- limits -->\n") && text.ends_with("\nafter\n"), "{text}");
    assert!(text.contains("| L 90 |") && !text.contains("old"), "{text}");
    let output = run(cornerbench().args(["limits", "corner_sub_pxi"]));
    assert!(stderr(&output).contains("did you mean \"corner_sub_pix\"?"), "{}", stderr(&output));
}
