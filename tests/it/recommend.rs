//! GOSPA in reports, times of runs, and recommendations.

use std::fs;
use std::path::Path;
use std::process::Command;

use cornerbench::geometry::ImagePoint;
use cornerbench::metrics;
use cornerbench::record::{Record, kind, read_records, read_timing, status, track};
use cornerbench::report::gospa::{self, Cost};

use crate::dataset::json;
use crate::support::{
    copy_folder, cornerbench, plain_dataset, recipes, run, stderr, stdout, succeed,
};

fn measure(plan: &str, output: &Path, more: &[&str]) -> Command {
    let mut command = cornerbench();
    command.args(["measure", plan, "--quiet", "--recipes"]).arg(recipes()).args(more);
    command.arg("--output").arg(output).arg(plain_dataset());
    command
}

#[test]
fn the_report_s_gospa_is_the_metric_s_where_the_assignment_is_the_same() {
    assert_eq!(gospa::CUTOFF_PX.to_bits(), metrics::CUTOFF_PX.to_bits());
    // Truth far apart, one answer near each but the third; a false answer far from all.
    let truth = [[0.0, 0.0], [50.0, 0.0], [100.0, 0.0], [150.0, 0.0]];
    let answers = [Some([0.3, 0.4]), Some([50.0, 2.9]), None, Some([154.0, 0.0])];
    let false_answer = [80.0, 80.0];
    let mut rows: Vec<Record> = truth
        .iter()
        .zip(&answers)
        .map(|(truth, answer)| Record {
            track: track::END_TO_END.into(),
            kind: kind::CORNER.into(),
            status: if answer.is_some() { status::OK } else { status::MISSED }.into(),
            refine_status: answer.map(|_| "ok".into()),
            refined_error_px: answer.map(|[x, y]: [f64; 2]| (x - truth[0]).hypot(y - truth[1])),
            ..Record::default()
        })
        .collect();
    rows.push(Record {
        kind: kind::FALSE_CORNER.into(),
        status: status::FALSE.into(),
        ..Record::default()
    });
    let points = |places: Vec<[f64; 2]>| places.into_iter().map(ImagePoint::from).collect();
    let truth: Vec<ImagePoint> = points(truth.to_vec());
    let answers: Vec<ImagePoint> =
        points(answers.into_iter().flatten().chain([false_answer]).collect());
    let metric = metrics::gospa(&truth, &answers, metrics::CUTOFF_PX);

    let summary = gospa::summarise(&rows.iter().collect::<Vec<_>>(), |_| true);
    let per_photograph_px = summary.per_photograph_px.expect("a photograph").value;
    assert!((per_photograph_px - metric.distance_px).abs() < 1e-12);
    let sum = |of: fn(&Cost) -> f64| rows.iter().map(|row| of(&Cost::of(row))).sum::<f64>();
    assert!((sum(|cost| cost.localisation_px2) - metric.localisation_px2).abs() < 1e-12);
    assert!((sum(|cost| cost.missed_px2) - metric.missed_px2).abs() < 1e-12);
    assert!((sum(|cost| cost.false_px2) - metric.false_px2).abs() < 1e-12);
}

/// A run of plan `seeds` whose first scene is of split dev, the second of split test.
fn run_of_both_splits(folder: &Path) {
    let dataset = folder.join("dataset");
    copy_folder(plain_dataset(), &dataset);
    let manifest_path = dataset.join("dataset.json");
    let mut manifest = json(&manifest_path);
    for (scene, split) in [("above", "dev"), ("oblique", "test")] {
        let path = dataset.join(scene).join("scene.json");
        let mut description = json(&path);
        description["split"] = split.into();
        let text = description.to_string();
        let entry = &mut manifest["scenes"][scene]["files"]["scene.json"];
        entry["sha256"] = cornerbench::files::sha256_hex(text.as_bytes()).into();
        if !entry["bytes"].is_null() {
            entry["bytes"] = text.len().into();
        }
        fs::write(path, text).expect("written");
    }
    fs::write(manifest_path, manifest.to_string()).expect("written");
    let mut command = cornerbench();
    command.args(["measure", "seeds", "--quiet", "--recipes"]).arg(recipes());
    succeed(command.arg("--output").arg(folder.join("run")).arg(&dataset));
}

fn recommend(run: &Path, more: &[&str]) -> Command {
    let mut command = cornerbench();
    command.arg("recommend").arg(run).args(more);
    command
}

#[test]
fn recommend_chooses_on_dev_confirms_on_test_and_gives_a_pipeline_for_a_plan() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    run_of_both_splits(folder.path());
    let measured = folder.path().join("run");

    // Times of every camera and method, of the stages that there are.
    let timing = read_timing(&measured).expect("times").expect("a file");
    assert_eq!((timing.methods.len(), timing.threads), (2 * 10, 1));
    assert!(timing.rounds >= 2 && timing.clock_resolution_us > 0.0);
    for time in &timing.methods {
        let is_given = time.method.starts_with("given");
        assert!(is_given || time.detect_us.median > 1.0, "{time:?}");
        let parts = time.detect_us.median + time.refine_us.median + time.grasp_us.median;
        assert!(time.whole_us.median > 0.5 * parts && time.photographs == 2, "{time:?}");
    }
    let summary = json(&measured.join("summary.json"));
    assert!(summary.get("timing").is_none(), "records and summary are the same each time");

    let said = succeed(&mut recommend(&measured, &[]));
    for words in [
        "ideal, end to end\n",
        "noisy, refiners alone, seeds up to 0.5 px off\n",
        "px on dev, ",
        "[[pipelines]]\n",
        "! dev: 1 scenes: too few",
        "recommendation/index.html",
    ] {
        assert!(said.contains(words), "{words}: {said}");
    }
    let found = json(&measured.join("recommendation/recommendation.json"));
    let choices = found["choices"].as_array().expect("choices");
    // Two cameras, end to end and two discs of seeds; one family.
    assert_eq!(choices.len(), 2 * 3);
    for choice in choices {
        let candidates = choice["candidates"].as_array().expect("candidates");
        let best = candidates.iter().find(|one| one["is_control"] == false).expect("a method");
        assert_eq!(choice["chosen"], best["method"], "the best on dev comes first");
        assert!(candidates.iter().any(|one| one["is_on_front"] == true));
    }
    assert!(measured.join("recommendation/pareto-ideal-end_to_end.svg").is_file());

    // What is printed can be pasted into a plan.
    let copy = folder.path().join("recipes");
    copy_folder(&recipes(), &copy);
    let pipelines = found["pipelines"].as_object().expect("pipelines");
    let text: String = pipelines.values().filter_map(|one| one.as_str()).collect();
    fs::write(copy.join("plans/pasted.toml"), text).expect("written");
    let list = succeed(
        cornerbench()
            .args(["measure", "pasted", "--list", "--recipes"])
            .arg(&copy)
            .arg(plain_dataset()),
    );
    assert!(pipelines.keys().all(|name| list.contains(&format!("{name}\n"))), "{list}");

    // A budget leaves out who is slower.
    let strict = stdout(&run(&mut recommend(&measured, &["--json", "--budget-us", "5"])));
    let strict: serde_json::Value = serde_json::from_str(&strict).expect("JSON");
    for choice in strict["choices"].as_array().expect("choices") {
        for candidate in choice["candidates"].as_array().expect("candidates") {
            let keeps = candidate["time_us"].as_f64().expect("a time") <= 5.0;
            assert_eq!(candidate["keeps_budget"], keeps);
        }
    }

    // Without times there is neither a front nor a budget.
    fs::remove_file(measured.join("timing.json")).expect("removed");
    let said = succeed(&mut recommend(&measured, &[]));
    assert!(said.contains("no timing.json: no front"), "{said}");
    let refused = run(&mut recommend(&measured, &["--budget-ms", "1"]));
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("measure again without --no-timing"), "{}", stderr(&refused));
}

#[test]
fn recommend_refuses_one_split_and_bad_budgets_and_records_do_not_depend_on_times() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [timed, untimed] = ["timed", "untimed"].map(|name| folder.path().join(name));
    succeed(&mut measure("plain", &timed, &[]));
    succeed(&mut measure("plain", &untimed, &["--no-timing"]));
    for file in ["records.parquet", "summary.json"] {
        let read = |run: &Path| fs::read(run.join(file)).expect("a file");
        assert!(read(&timed) == read(&untimed), "{file} differs");
    }
    assert!(timed.join("timing.json").is_file() && !untimed.join("timing.json").exists());
    let splits: Vec<_> = read_records(&timed.join("records.parquet"))
        .expect("records")
        .into_iter()
        .filter_map(|record| record.split)
        .collect();
    let has = |name: &str| splits.iter().any(|split| split == name);
    if !(has("dev") && has("test")) {
        let output = run(&mut recommend(&timed, &[]));
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains("no scenes of split"), "{}", stderr(&output));
    }
    for (budget, words) in [("0", "--budget-us is 0"), ("-1", "--budget-us is -1")] {
        let budget = format!("--budget-us={budget}");
        let output = run(&mut recommend(&timed, &[&budget]));
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains(words), "{}", stderr(&output));
    }
}
