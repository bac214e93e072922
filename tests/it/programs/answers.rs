//! Corners that were computed elsewhere.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use cornerbench::record::{Record, kind, read_records};

use crate::support::{cornerbench, plain_dataset, recipes, run, stderr, stdout, succeed};

/// The method `paper` on the plain dataset, and its answers as a file.
fn answers_of_paper(folder: &Path, change: impl Fn(String) -> String) -> (Vec<Record>, PathBuf) {
    let output = folder.join("paper");
    succeed(
        cornerbench()
            .args(["measure", "plain", "--quiet", "--no-timing", "--recipes"])
            .arg(recipes())
            .arg(plain_dataset())
            .arg("-o")
            .arg(&output),
    );
    let records = read_records(&output.join("records.parquet")).expect("records");
    let mut text = String::from("version,scene,y_px,x_px,response\n");
    for row in records.iter().filter(|row| row.refined_x_px.is_some()) {
        let value = |number: Option<f64>| number.expect("a number").to_string();
        let numbers = [row.refined_y_px, row.refined_x_px, row.response].map(value).join(",");
        text.push_str(&format!("mine 2,{},{numbers}\n", row.scene));
    }
    let file = folder.join("My answers.csv");
    fs::write(&file, change(text)).expect("written");
    (records, file)
}

fn measure_answers(file: &Path, output: &Path) -> Output {
    let mut measure = cornerbench();
    measure.args(["measure", "plain", "--quiet", "--no-timing", "--recipes"]).arg(recipes());
    run(measure.arg(plain_dataset()).arg("-o").arg(output).arg("--with").arg(file))
}

#[test]
fn corners_from_elsewhere_are_scored_as_if_they_had_been_found_here() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (before, file) = answers_of_paper(folder.path(), |text| text);
    let output = folder.path().join("run");
    let done = measure_answers(&file, &output);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let records = read_records(&output.join("records.parquet")).expect("records");
    let of = |records: &[Record], method: &str| -> Vec<(i32, Option<u64>)> {
        let rows = records.iter().filter(|row| row.method == method && row.kind == kind::CORNER);
        let found = rows.map(|row| {
            (row.corner_index.expect("an index"), row.refined_error_px.map(f64::to_bits))
        });
        found.collect()
    };
    let (own, elsewhere) = (of(&before, "paper"), of(&records, "my_answers"));
    assert!(own.iter().any(|(_, error)| error.is_some()), "{own:?}");
    assert_eq!(elsewhere, own);
    let row = records.iter().find(|row| row.method == "my_answers").expect("rows");
    assert_eq!(
        (row.detector.as_deref(), row.track.as_str()),
        (Some("my_answers mine 2"), "end_to_end")
    );
}

#[test]
fn a_file_of_answers_says_of_each_photograph_something_that_can_be_true() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = folder.path().join("run");
    // Without its rows a scene is a failure; with an empty one it has no corners.
    let without = |text: String| -> String {
        text.lines()
            .filter(|line| !line.contains("oblique"))
            .map(|line| format!("{line}\n"))
            .collect()
    };
    let (_, file) = answers_of_paper(folder.path(), without);
    let done = measure_answers(&file, &output);
    assert_eq!(done.status.code(), Some(1), "{}", stderr(&done));
    let records = read_records(&output.join("records.parquet")).expect("records");
    let failed = records.iter().find(|row| row.kind == kind::FAILURE).expect("a failure");
    assert_eq!((failed.scene.as_str(), failed.status.as_str()), ("oblique", "not_available"));
    let text = fs::read_to_string(&file).expect("answers");
    fs::write(&file, format!("{text}mine 2,oblique,,,\n")).expect("written");
    let done = measure_answers(&file, &output);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    for (row, words) in [
        ("mine 2,obliq,1,1,1", "did you mean \"oblique\""),
        ("mine 3,oblique,1,1,1", "version is \"mine 3\", must be one and the same"),
        ("mine 2,oblique,NaN,1,1", "y_px is NaN, must be a finite number"),
        ("mine 2,oblique,,1,1", "y_px is missing, must be there, or neither"),
        ("mine 2,oblique,x,1,1", "y_px is \"x\": invalid float"),
    ] {
        fs::write(&file, format!("{text}{row}\n")).expect("written");
        let done = measure_answers(&file, &output);
        assert_eq!(done.status.code(), Some(2), "{row}: {}", stdout(&done));
        assert!(stderr(&done).contains(words), "{row}: {}", stderr(&done));
    }
}
