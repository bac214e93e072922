//! Runs: both tracks, several cameras and photographs, shards, runs that were killed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::time::Duration;

use cornerbench::record::{Record, kind, read_records, status, track};
use cornerbench::scene::Dataset;

use crate::dataset::json;
use crate::support::{
    copy_folder, cornerbench, plain_dataset, project, python, recipes, run, stderr, stdout, succeed,
};

/// A dataset of so many copies of the two plain scenes.
fn copies(folder: &Path, count: usize) -> PathBuf {
    let dataset = folder.join("dataset");
    let mut manifest = json(&plain_dataset().join("dataset.json"));
    let mut scenes = serde_json::Map::new();
    for index in 0..count {
        let original = ["above", "oblique"][index % 2];
        let name = format!("{original}-{index}");
        copy_folder(&plain_dataset().join(original), &dataset.join(&name));
        scenes.insert(name, manifest["scenes"][original].clone());
    }
    manifest["scenes"] = scenes.into();
    fs::write(dataset.join("dataset.json"), manifest.to_string()).expect("written");
    assert_eq!(Dataset::open(&dataset).expect("a dataset").scenes().count(), count);
    dataset
}

fn measure(plan: &str, dataset: &Path, output: &Path, more: &[&str]) -> Command {
    let mut command = cornerbench();
    command.args(["measure", plan, "--quiet", "--recipes"]).arg(recipes()).args(more);
    command.arg("--output").arg(output).arg(dataset);
    command
}

/// The rows of plan `seeds` over the plain dataset, measured once.
fn rows() -> &'static [Record] {
    static ROWS: OnceLock<Vec<Record>> = OnceLock::new();
    ROWS.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        succeed(&mut measure("seeds", plain_dataset(), folder.path(), &[]));
        read_records(&folder.path().join("records.parquet")).expect("records")
    })
}

fn is_asked_for(record: &&Record) -> bool {
    record.kind == kind::CORNER && [status::OK, status::MISSED].contains(&record.status.as_str())
}

#[test]
fn every_combination_is_measured_on_every_photograph() {
    let methods: BTreeSet<&str> = rows().iter().map(|record| record.method.as_str()).collect();
    assert_eq!(
        methods.into_iter().collect::<Vec<_>>(),
        [
            "found-junction_fit",
            "found-none",
            "given-disc_px=0.5-corner_sub_pix-half_window_px=3",
            "given-disc_px=0.5-corner_sub_pix-half_window_px=5",
            "given-disc_px=0.5-junction_fit",
            "given-disc_px=0.5-none",
            "given-disc_px=2-corner_sub_pix-half_window_px=3",
            "given-disc_px=2-corner_sub_pix-half_window_px=5",
            "given-disc_px=2-junction_fit",
            "given-disc_px=2-none",
        ]
    );
    let mut photographs: BTreeMap<(&str, &str, &str), BTreeSet<i32>> = BTreeMap::new();
    for record in rows() {
        let key = (record.scene.as_str(), record.camera.as_str(), record.method.as_str());
        photographs.entry(key).or_default().insert(record.exposure.expect("a number"));
    }
    assert_eq!(photographs.len(), 2 * 2 * 10);
    assert!(photographs.values().all(|found| found.iter().copied().eq(0..4)));
}

#[test]
fn given_seeds_lie_evenly_in_their_disc_and_judge_the_refiner_alone() {
    let given = || rows().iter().filter(|record| record.track == track::REFINEMENT);
    assert!(given().all(|record| record.kind == kind::CORNER && record.detector.is_none()));
    assert!(given().filter(is_asked_for).all(|record| record.status == status::OK));
    for disc_px in [0.5, 2.0] {
        let distances: Vec<f64> = given()
            .filter(|record| record.seed_disc_px == Some(disc_px))
            .filter(|record| record.method.ends_with("none"))
            .filter_map(|record| record.detected_error_px)
            .collect();
        assert!(distances.len() > 50, "{}", distances.len());
        assert!(distances.iter().all(|distance| *distance <= disc_px));
        let square = distances.iter().map(|d| d * d).sum::<f64>() / distances.len() as f64;
        // Half of the radius squared; so many seeds say it to within a quarter of that.
        let share = square / (disc_px * disc_px);
        assert!((share - 0.5).abs() < 0.13, "{share}");
    }
}

#[test]
fn seeds_of_one_corner_are_the_same_for_every_refiner_and_in_proportion_for_every_disc() {
    let mut seen: BTreeMap<_, Vec<[f64; 2]>> = BTreeMap::new();
    let given = rows().iter().filter(|record| record.track == track::REFINEMENT);
    for record in given.filter(is_asked_for) {
        let key = (&record.scene, &record.camera, record.exposure, record.corner_index);
        let disc_px = record.seed_disc_px.expect("a radius");
        let off = |at: Option<f64>, truth: Option<f64>| Some((at? - truth?) / disc_px);
        let off = [
            off(record.detected_x_px, record.true_x_px).expect("a seed"),
            off(record.detected_y_px, record.true_y_px).expect("a seed"),
        ];
        seen.entry(key).or_default().push(off);
    }
    for (key, offs) in seen {
        assert_eq!(offs.len(), 8, "{key:?}");
        assert!(
            offs.iter().flatten().zip(offs[0].iter().cycle()).all(|(a, b)| (a - b).abs() < 1e-9)
        );
    }
}

#[test]
fn a_phase_moves_the_truth_and_a_repeat_the_noise_alone() {
    let of = |exposure: i32, camera: &str| -> Vec<&Record> {
        let method = "given-disc_px=2-junction_fit";
        rows()
            .iter()
            .filter(|r| r.method == method && r.camera == camera && r.exposure == Some(exposure))
            .filter(is_asked_for)
            .collect()
    };
    for camera in ["ideal", "noisy"] {
        let first = of(0, camera);
        assert!(first.iter().all(|r| (r.phase_x_px, r.phase_y_px) == (Some(0.0), Some(0.0))));
        for later in of(2, camera) {
            let [x, y] = [later.phase_x_px, later.phase_y_px].map(|phase| phase.expect("a phase"));
            assert!(x.abs() <= 0.5 && y.abs() <= 0.5 && x != 0.0);
            let same =
                |r: &&&Record| (&r.scene, r.corner_index) == (&later.scene, later.corner_index);
            let Some(before) = first.iter().find(same) else { continue };
            // The film's point at the phase is pixel (0, 0): truth moves the other way.
            let moved = |a: Option<f64>, b: Option<f64>| a.expect("truth") - b.expect("truth");
            assert!((moved(later.true_x_px, before.true_x_px) + x).abs() < 1e-9);
            assert!((moved(later.true_y_px, before.true_y_px) + y).abs() < 1e-9);
        }
    }
    let truths = |rows: Vec<&Record>| rows.iter().map(|r| r.true_x_px).collect::<Vec<_>>();
    assert_eq!(truths(of(0, "noisy")), truths(of(1, "noisy")));
    let places = |rows: Vec<&Record>| rows.iter().map(|r| r.refined_x_px).collect::<Vec<_>>();
    assert_ne!(places(of(0, "noisy")), places(of(1, "noisy")), "each has noise of its own");
}

#[test]
fn an_error_in_the_corners_own_frame_is_the_error() {
    let mut count = 0;
    for record in rows().iter().filter(|record| record.refined_along_px.is_some()) {
        let [along, across, error] =
            [record.refined_along_px, record.refined_across_px, record.refined_error_px]
                .map(|value| value.expect("a number"));
        assert!((along.hypot(across) - error).abs() < 1e-9, "{record:?}");
        count += 1;
    }
    assert!(count > 500, "{count}");
    // Harris's maxima lie inside a corner, junction_fit's answers on both sides of it.
    let mean = |method: &str| {
        let of_method = rows().iter().filter(|r| r.method == method && r.camera == "ideal");
        let along: Vec<f64> = of_method.filter_map(|r| r.refined_along_px).collect();
        along.iter().sum::<f64>() / along.len() as f64
    };
    let (inside, fitted) = (mean("found-none"), mean("given-disc_px=0.5-junction_fit"));
    assert!(inside > 0.3 && fitted.abs() < 0.2, "{inside} {fitted}");
}

#[test]
fn shards_merged_are_the_unsharded_run_byte_for_byte() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = copies(folder.path(), 5);
    let at = |name: &str| folder.path().join(name);
    succeed(&mut measure("seeds", &dataset, &at("whole"), &["--threads", "2"]));
    for shard in ["0/3", "1/3", "2/3"] {
        let name = shard.replace('/', "of");
        succeed(&mut measure("seeds", &dataset, &at(&name), &["--shard", shard, "--threads", "1"]));
    }
    let merge = |shards: &[&str], output: &str| {
        let mut command = cornerbench();
        command.args(["merge", "--quiet"]).args(shards.iter().map(|name| at(name)));
        run(command.arg("-o").arg(at(output)))
    };
    let merged = merge(&["2of3", "0of3", "1of3"], "merged");
    assert!(merged.status.success(), "{}", stderr(&merged));
    for file in ["records.parquet", "summary.json", "report/index.html"] {
        let read = |run: &str| fs::read(at(run).join(file)).expect("a file");
        let is_page = file.ends_with("html"); // it names the command line
        assert!(is_page || read("whole") == read("merged"), "{file} differs");
    }

    let refused: [(&[&str], &str); 4] = [
        (&["0of3", "1of3"], "shard 2/3 is missing"),
        (&["0of3", "1of3", "1of3"], "are both shard 1/3"),
        (&["0of3", "whole"], "is a whole run, not a shard"),
        (&["0of3", "elsewhere"], "run.json"),
    ];
    for (shards, words) in refused {
        let output = merge(shards, "refused");
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains(words), "{words}: {}", stderr(&output));
    }
    let output = merge(&["0of3", "1of3", "2of3"], "merged");
    assert!(stderr(&output).contains("holds a run already"), "{}", stderr(&output));
}

#[test]
fn a_run_killed_twenty_times_ends_with_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = copies(folder.path(), 8);
    let (whole, killed) = (folder.path().join("whole"), folder.path().join("killed"));
    succeed(&mut measure("plain", &dataset, &whole, &[]));
    let mut parts = 0;
    for kill in 0..20 {
        let mut command = measure("plain", &dataset, &killed, &["--threads", "1"]);
        let mut child =
            command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("it starts");
        // Early and late, on another way each time: within the first scene, or behind some.
        std::thread::sleep(Duration::from_millis(100 + 97 * kill % 900));
        child.kill().expect("it is killed");
        child.wait().expect("it ended");
        let there = fs::read_dir(killed.join("parts")).map_or(0, Iterator::count);
        if killed.join("run.json").is_file() {
            break;
        }
        assert!(there >= parts, "what was done is kept: {parts}, then {there}");
        parts = there;
    }
    assert!(parts > 0, "some scenes were done before a kill");
    succeed(&mut measure("plain", &dataset, &killed, &[]));
    for file in ["records.parquet", "summary.json"] {
        let read = |run: &Path| fs::read(run.join(file)).expect("a file");
        assert!(read(&whole) == read(&killed), "{file} differs");
    }
    assert!(!killed.join("parts").exists() && !killed.join("unfinished.json").exists());
}

#[test]
fn what_another_plan_left_unfinished_is_not_taken_over() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (output, fresh) = (folder.path().join("run"), folder.path().join("fresh"));
    succeed(&mut measure("plain", plain_dataset(), &output, &[]));
    succeed(&mut measure("seeds", plain_dataset(), &output, &[]));
    succeed(&mut measure("seeds", plain_dataset(), &fresh, &[]));
    let read = |run: &Path| fs::read(run.join("records.parquet")).expect("records");
    assert!(read(&output) == read(&fresh));
    assert!(!output.join("scenes/above/ideal/paper.json").exists(), "the other plan's sketches");
}

#[test]
fn list_says_what_would_run_and_measures_nothing() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let said = succeed(&mut measure(
        "seeds",
        plain_dataset(),
        &folder.path().join("run"),
        &["--list", "--shard", "1/2"],
    ));
    assert!(said.contains("given-disc_px=0.5-corner_sub_pix-half_window_px=3\n"), "{said}");
    let words = "10 methods on 8 photographs of 1 scenes (ideal, noisy)";
    assert!(said.contains(words) && said.contains("about "), "{said}");
    assert!(!folder.path().join("run").exists());
}

#[test]
fn a_plan_of_families_measures_their_scenes() {
    let copy = tempfile::tempdir().expect("a temporary folder");
    copy_folder(&recipes(), copy.path());
    let plan = "families = ['board', 'plain']\n[[pipelines]]\ndetect = 'harris'\nrefine = 'none'\n";
    fs::write(copy.path().join("plans/odd.toml"), plan).expect("written");
    let mut list = cornerbench();
    list.args(["measure", "odd", "--list", "--recipes"]).arg(copy.path()).arg(plain_dataset());
    let said = succeed(&mut list);
    assert!(said.contains("of 2 scenes"), "{said}");
}

#[test]
fn plans_that_make_no_sense_say_why() {
    let copy = tempfile::tempdir().expect("a temporary folder");
    copy_folder(&recipes(), copy.path());
    let cases = [
        ("camera = ['ideal', 'ideal']", "seeds.disc_px = 1", "two cameras are called \"ideal\""),
        ("camera = 'idael'", "seeds.disc_px = 1", "did you mean \"ideal\""),
        ("families = ['bord']", "seeds.disc_px = 1", "did you mean \"board\""),
        ("families = ['board']", "seeds.disc_px = 1", "has no scene of families board"),
        ("families = ['board']\n[[drawn]]", "seeds.disc_px = 1", "leave out `families`"),
        ("phases = 0", "seeds.disc_px = 1", "phases"),
        ("", "seeds.disc_px = -1", "disc_px"),
        ("", "seeds.disk_px = 1", "did you mean \"disc_px\""),
        ("", "seeds.disc_px = 1\ndetect = 'harris'", "leave out either"),
        ("", "refine = 'none'", "no candidates; give `detect`, or `seeds`"),
        ("", "detect = 'haris'", "did you mean \"harris\""),
        ("", "detect = ['harris', 'harris']", "two pipelines are called \"a-harris\""),
        ("", "detect = { algorithm = 'harris', kk = [0.04, 0.05] }", "did you mean \"k\""),
        ("", "detect = { algorithm = 'harris', k = [0.04, 5] }", "k is 5"),
    ];
    for (head, pipeline, words) in cases {
        let text = format!("{head}\n[[pipelines]]\nname = 'a'\n{pipeline}\n");
        fs::write(copy.path().join("plans/odd.toml"), &text).expect("written");
        let output = run(cornerbench()
            .args(["measure", "odd", "--recipes"])
            .arg(copy.path())
            .arg("-o")
            .arg(copy.path().join("run"))
            .arg(plain_dataset()));
        assert_eq!(output.status.code(), Some(2), "{text}: {}", stdout(&output));
        assert!(stderr(&output).contains(words), "{text}: {words}: {}", stderr(&output));
    }
}

#[test]
fn other_programs_read_the_records_as_the_documentation_says() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let run_folder = folder.path().join("RUN");
    succeed(&mut measure("seeds", plain_dataset(), &run_folder, &[]));
    let text = fs::read_to_string(project().join("scenes/FORMAT.md")).expect("a file");
    let (_, code) = text.split_once("```python\nduckdb").expect("code");
    let (code, _) = code.split_once("```").expect("its end");
    let [duckdb, pandas, polars] = format!("duckdb{code}")
        .trim()
        .split('\n')
        .map(str::to_owned)
        .collect::<Vec<_>>()
        .try_into()
        .expect("three lines");
    let program = format!(
        "import json, duckdb, pandas, polars\n\
         print(json.dumps([dict({duckdb}.fetchall()), dict({pandas}), dict({polars}.rows())]))"
    );
    let said = succeed(Command::new(python()).current_dir(folder.path()).args(["-c", &program]));
    let found: Vec<BTreeMap<String, f64>> = serde_json::from_str(&said).expect("JSON");
    let summary = json(&run_folder.join("summary.json"));
    let mut cameras: BTreeMap<&str, usize> = BTreeMap::new();
    for method in summary["methods"].as_array().expect("methods") {
        *cameras.entry(method["method"].as_str().expect("a name")).or_default() += 1;
    }
    assert_eq!(found[0].len(), cameras.len());
    for other in &found[1..] {
        assert!(found[0].keys().eq(other.keys()));
        assert!(found[0].values().zip(other.values()).all(|(a, b)| (a - b).abs() < 1e-12));
    }
    // Of both cameras together, which the summary has one by one: between the two.
    for (name, median_px) in &found[0] {
        let methods = summary["methods"].as_array().expect("methods").iter();
        let medians: Vec<f64> = methods
            .filter(|method| method["method"] == name.as_str())
            .filter_map(|method| method["refinement"]["all"]["median_px"]["value"].as_f64())
            .collect();
        let low = medians.iter().copied().fold(f64::INFINITY, f64::min);
        let high = medians.iter().copied().fold(0.0, f64::max);
        assert!((low - 1e-9..=high + 1e-9).contains(median_px), "{name}: {median_px} {medians:?}");
    }
}

#[test]
fn compare_says_what_became_worse_and_ends_with_one() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = copies(folder.path(), 12);
    let recipes_of = |name: &str, pipelines: &str| {
        let copy = folder.path().join(name);
        copy_folder(&recipes(), &copy);
        let text = format!("camera = 'ideal'\n{pipelines}");
        fs::write(copy.join("plans/one.toml"), text).expect("written");
        let output = folder.path().join(format!("run-{name}"));
        let mut command = cornerbench();
        command.args(["measure", "one", "-q", "--recipes"]).arg(copy).arg("-o").arg(&output);
        succeed(command.arg(&dataset));
        output
    };
    let pipeline = |name: &str, disc_px: f64| {
        format!("[[pipelines]]\nname = '{name}'\nseeds.disc_px = {disc_px:?}\nrefine = 'none'")
    };
    let near = recipes_of("near", &pipeline("a", 0.5));
    let far = recipes_of("far", &pipeline("a", 2.0));
    let other = recipes_of("other", &pipeline("b", 2.0));
    let compare = |first: &Path, second: &Path| {
        let output = run(cornerbench().args(["compare", "--json"]).arg(first).arg(second));
        let said = serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap_or_default();
        (output.status.code(), said["methods"][0]["verdict"].clone(), stderr(&output))
    };
    for (first, second, code, verdict) in
        [(&near, &far, 1, "worse"), (&far, &near, 0, "better"), (&far, &far, 0, "same")]
    {
        let (found, words, _) = compare(first, second);
        assert_eq!((found, words), (Some(code), verdict.into()));
    }
    let (code, _, words) = compare(&far, &other);
    assert_eq!(code, Some(2));
    assert!(words.contains("share no method"), "{words}");
}
