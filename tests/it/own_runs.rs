//! `cornerbench measure` on pictures of one's own, through the binary: with known corners and without, in shards, broken.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use cornerbench::record::{Record, kind, read_records, status, track};
use serde_json::Value;

use crate::dataset::json;
use crate::own::{COUNT, folder};
use crate::support::{copy_folder, cornerbench, plain_dataset, recipes, run, stderr, succeed};

const PLAN: &str = "camera = 'ideal'
     [[pipelines]]
     name = 'found'
     target = 'red_difference'
     detect = { algorithm = 'harris', threshold_rel = 0.001, channel = 'colour' }
     refine = ['junction_fit', 'corner_sub_pix', 'none']
     [[pipelines]]
     name = 'given'
     seeds.disc_px = 1
     refine = ['junction_fit', 'none']";

const GIVEN: &str = "camera = 'ideal'
     [[pipelines]]
     name = 'given'
     seeds.disc_px = 1
     refine = 'junction_fit'";

/// The plain dataset measured by a plan, and its photographs by the same camera as pictures.
struct Bench {
    folder: tempfile::TempDir,
    /// What is known of the dataset's own corners.
    dataset: Vec<Record>,
}

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let at = |name: &str| folder.path().join(name);
        copy_folder(&recipes(), &at("recipes"));
        fs::write(at("recipes/plans/own.toml"), PLAN).expect("written");
        fs::write(at("recipes/plans/given.toml"), GIVEN).expect("written");
        let mut expose = cornerbench();
        expose.args(["expose", "--quiet", "--camera", "ideal", "--recipes"]).arg(at("recipes"));
        succeed(expose.arg(plain_dataset()).arg("-o").arg(at("photographs")));
        fs::create_dir(at("pictures")).expect("a folder");
        for scene in ["above", "oblique"] {
            let photograph = at(&format!("photographs/{scene}/exposure-0.png"));
            fs::copy(photograph, at(&format!("pictures/{scene}.png"))).expect("copied");
        }
        let bench = Self { dataset: Vec::new(), folder };
        succeed(bench.measure("own", plain_dataset(), "dataset").arg("--no-timing"));
        Self { dataset: bench.rows("dataset"), ..bench }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn measure(&self, plan: &str, images: &Path, output: &str) -> Command {
        let mut command = cornerbench();
        command.args(["measure", plan, "--recipes"]).arg(self.at("recipes"));
        command.arg("-o").arg(self.at(output)).arg(images);
        command
    }

    /// Measures the pictures.
    fn own(&self, output: &str, more: &[&str]) -> Command {
        let mut command = self.measure("own", &self.at("pictures"), output);
        command.args(more);
        command
    }

    /// A file of the corners asked for in the dataset, so far off; of some scenes only.
    fn known(&self, offset_px: f64, scenes: &[&str]) -> String {
        let mut text = "image,x_px,y_px\n".to_owned();
        let is_asked = |row: &&Record| {
            row.kind == kind::CORNER
                && row.method == "found-none"
                && [status::OK, status::MISSED].contains(&row.status.as_str())
                && scenes.contains(&row.scene.as_str())
        };
        for row in self.dataset.iter().filter(is_asked) {
            let [x, y] = [row.true_x_px, row.true_y_px].map(|at| at.expect("truth") + offset_px);
            text.push_str(&format!("{}.png,{x},{y}\n", row.scene));
        }
        let path = self.at("known.csv");
        fs::write(&path, text).expect("written");
        path.to_string_lossy().into_owned()
    }

    fn rows(&self, run: &str) -> Vec<Record> {
        read_records(&self.at(run).join("records.parquet")).expect("records")
    }

    fn page(&self, run: &str) -> String {
        let page = fs::read_to_string(self.at(run).join("report/index.html")).expect("a page");
        assert!(!page.contains("NaN") && !page.contains("undefined"));
        page
    }

    fn summary(&self, run: &str) -> Value {
        json(&self.at(run).join("summary.json"))
    }
}

const BOTH: [&str; 2] = ["above", "oblique"];

#[test]
fn errors_are_those_of_the_dataset_whose_photographs_the_pictures_are() {
    let bench = Bench::new();
    let known = bench.known(0.0, &BOTH);
    let said = succeed(&mut bench.own("run", &["--known", &known, "--camera", "ideal"]));
    assert!(said.contains("rms error px") && !said.contains("No corners are known"), "{said}");
    let rows = bench.rows("run");
    assert!(rows.iter().all(|row| row.camera == "ideal" && row.suite == "pictures"));
    let found = |rows: &[Record], method: &str| -> Vec<Record> {
        let is_found = |row: &&Record| {
            row.method == method && row.kind == kind::CORNER && row.status == status::OK
        };
        rows.iter().filter(is_found).cloned().collect()
    };
    for method in ["found-junction_fit", "found-corner_sub_pix", "found-none"] {
        let (own, wanted) = (found(&rows, method), found(&bench.dataset, method));
        assert!(wanted.len() > 5, "{method}: {}", wanted.len());
        assert_eq!(own.len(), wanted.len(), "{method}");
        for (own, wanted) in own.iter().zip(&wanted) {
            assert_eq!(own.scene, format!("{}.png", wanted.scene));
            assert_eq!(own.refine_status, wanted.refine_status);
            assert_eq!(own.found_at_response, wanted.found_at_response);
            let [own_px, wanted_px] = [own, wanted].map(|row| row.refined_error_px.expect("one"));
            assert!((own_px - wanted_px).abs() < 1e-6, "{method}: {own_px}, not {wanted_px}");
        }
    }
    // Every answer is a corner's own, or a false one; nothing is known of anything else.
    assert!(rows.iter().all(|row| row.bound_px.is_none() && row.status != status::UNKNOWN));
    let false_corners = rows.iter().filter(|row| row.kind == kind::FALSE_CORNER);
    assert!(false_corners.clone().count() > 0);
    for row in false_corners {
        let is_near = row.nearest_corner_px.expect("a distance") <= 5.0;
        let cause = if is_near { "duplicate" } else { "background" };
        assert_eq!(row.cause.as_deref(), Some(cause));
    }
    // Given seeds lie in the disc, and no refiner has another's.
    for row in rows.iter().filter(|row| row.track == track::REFINEMENT) {
        assert!(row.detected_error_px.expect("a seed") <= 1.0 && row.status == status::OK);
    }
    assert!(bench.page("run").contains("Where each refiner is farthest off"));
    let summary = bench.summary("run");
    assert!(summary["agreements"].is_null(), "{summary}");
    let asked = &summary["methods"][0]["corners"]["visible"];
    let lines = fs::read_to_string(&known).expect("a file").lines().count();
    assert_eq!(*asked, lines - 1, "{asked}");
    // The same pictures, the same rows: compare and recommend take them, as they take scenes.
    let compared = run(cornerbench().arg("compare").args([bench.at("run"), bench.at("run")]));
    assert_eq!(compared.status.code(), Some(0), "{}", stderr(&compared));
    succeed(cornerbench().arg("recommend").arg(bench.at("run")));
}

#[test]
fn half_a_pixel_of_origin_is_recognised() {
    let (pictures, output) = (folder("16.png", 0.5), tempfile::tempdir().expect("a folder"));
    let recipes_folder = output.path().join("recipes");
    copy_folder(&recipes(), &recipes_folder);
    fs::write(recipes_folder.join("plans/given.toml"), GIVEN).expect("written");
    let measured = |name: &str, more: &[&str]| {
        let mut command = cornerbench();
        command.args(["measure", "given", "-o"]).arg(output.path().join(name));
        command.arg(pictures.path()).arg("--known").arg(pictures.path().join("known.csv"));
        let said = succeed(command.arg("--recipes").arg(&recipes_folder).args(more));
        let page = output.path().join(name).join("report/index.html");
        let summary = json(&output.path().join(name).join("summary.json"));
        let refined = &summary["methods"][0]["refinement"]["all"];
        assert_eq!(refined["answered"], COUNT, "{summary}");
        let rmse_px = refined["rmse_px"]["value"].as_f64().expect("answers");
        (said, fs::read_to_string(page).expect("a page"), rmse_px)
    };
    let words = "your known corners look as if counted from the pixel";
    let (said, page, rmse_px) = measured("half", &[]);
    assert!(said.contains(words) && said.contains("try --origin pixel-corner"), "{said}");
    assert!(page.contains("try --origin pixel-corner"));
    assert!((rmse_px - 0.5_f64.sqrt()).abs() < 0.01, "{rmse_px}");
    let (said, page, rmse_px) = measured("whole", &["--origin", "pixel-corner"]);
    assert!(!said.contains("--origin") && !page.contains("try --origin"), "{said}");
    assert!(rmse_px < 0.01, "{rmse_px}");
    assert_eq!(json(&output.path().join("whole/run.json"))["pictures"]["origin"], "pixel-corner");
}

#[test]
fn without_truth_there_is_agreement_and_no_error() {
    let bench = Bench::new();
    let command = bench.own("run", &["--no-timing"]).output().expect("it starts");
    assert!(command.status.success(), "{}", stderr(&command));
    let (said, told) = (String::from_utf8_lossy(&command.stdout), stderr(&command));
    assert!(told.contains("2 of 5 pipelines are given seeds about known corners"), "{told}");
    assert!(said.contains("No corners are known in 2 of 2 pictures"), "{said}");
    assert!(said.contains("agreement is not accuracy"), "{said}");
    assert!(!said.contains("error px") && !said.contains("GOSPA"), "{said}");
    let rows = bench.rows("run");
    assert!(rows.iter().all(|row| row.kind == kind::CORNER && row.status == status::UNKNOWN));
    assert!(rows.iter().all(|row| row.true_x_px.is_none() && row.refined_error_px.is_none()));
    assert!(rows.iter().all(|row| row.camera == "picture" && row.corner_index.is_some()));
    assert!(rows.iter().any(|row| row.covariance_xx_px2.is_some()));
    let summary = bench.summary("run");
    assert_eq!(summary["methods"], Value::Array(Vec::new()), "none is scored");
    let agreement = &summary["agreements"][0];
    assert_eq!(agreement["methods"].as_array().map(Vec::len), Some(3));
    let pairs = agreement["pairs"].as_array().expect("pairs");
    assert_eq!(pairs.len(), 3);
    for pair in pairs {
        assert!(pair["distance_px"].as_f64().is_some_and(|px| px >= 0.0), "{pair}");
        let names = [&pair["methods"][0], &pair["methods"][1]];
        let methods = || agreement["methods"].as_array().expect("methods").iter();
        let of = |name: &Value| methods().find(|method| &method["method"] == name).expect("it");
        assert!(
            names.iter().all(|name| of(name)["answered"].as_u64() >= pair["answered"].as_u64())
        );
    }
    let page = bench.page("run");
    assert!(page.contains("agreement is not accuracy") && !page.contains("path-traced"));
    assert!(page.contains("How far do methods agree") && !page.contains("rms error px"));

    let refused = run(cornerbench().arg("recommend").arg(bench.at("run")));
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("no corner is known"), "{}", stderr(&refused));

    // Of one picture corners are known: both are told, each of its own pictures.
    let known = bench.known(0.0, &["above"]);
    let mixed = run(&mut bench.own("mixed", &["--known", &known]));
    assert!(stderr(&mixed).contains("no corner is known of 1 of 2 pictures"), "{}", stderr(&mixed));
    let said = String::from_utf8_lossy(&mixed.stdout);
    assert!(said.contains("known in 1 of 2 pictures") && said.contains("rms error px"), "{said}");
    let unknown = |row: &Record| row.status == status::UNKNOWN;
    assert!(bench.rows("mixed").iter().all(|row| unknown(row) == (row.scene == "oblique.png")));
}

#[test]
fn shards_merged_are_the_whole_run_byte_for_byte() {
    let bench = Bench::new();
    let known = bench.known(0.0, &["above"]);
    fs::copy(bench.at("pictures/above.png"), bench.at("pictures/third one.png")).expect("copied");
    let more = ["--known", &known, "--quiet"];
    let said = succeed(bench.own("none", &more).arg("--list"));
    assert!(said.contains("5 methods on 3 photographs of 3 pictures (picture)"), "{said}");
    assert!(!bench.at("none").exists());
    succeed(bench.own("whole", &more).args(["--threads", "2"]));
    for shard in ["0/2", "1/2"] {
        succeed(bench.own(&shard.replace('/', "of"), &more).args(["--shard", shard]));
    }
    let mut merge = cornerbench();
    merge.args(["merge", "--quiet", "-o"]).arg(bench.at("merged"));
    succeed(merge.args(["1of2", "0of2"].map(|name| bench.at(name))));
    for file in ["records.parquet", "summary.json"] {
        let read = |run: &str| fs::read(bench.at(run).join(file)).expect("a file");
        assert!(read("whole") == read("merged"), "{file} differs");
    }
    // Other samples, another run.
    let identity = |run: &str| json(&bench.at(run).join("run.json"))["identity_sha256"].clone();
    assert_eq!(identity("whole"), identity("0of2"));
    fs::copy(bench.at("pictures/oblique.png"), bench.at("pictures/above.png")).expect("copied");
    succeed(&mut bench.own("other", &more));
    assert_ne!(identity("whole"), identity("other"));
}

#[test]
fn a_picture_that_cannot_be_read_is_a_row() {
    let bench = Bench::new();
    fs::write(bench.at("pictures/broken.png"), "text").expect("written");
    let known = bench.known(0.0, &BOTH);
    let output = run(&mut bench.own("run", &["--known", &known]));
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(String::from_utf8_lossy(&output.stdout).contains("skipped broken.png"));
    let rows = bench.rows("run");
    let broken: Vec<&Record> = rows.iter().filter(|row| row.scene == "broken.png").collect();
    let [row] = broken[..] else { panic!("one row: {broken:?}") };
    assert_eq!((row.kind.as_str(), row.status.as_str()), (kind::SCENE, status::UNREADABLE));
    assert!(row.reason.as_deref().is_some_and(|reason| reason.contains("is no picture")));
    assert!(rows.iter().any(|row| row.status == status::OK));
    assert_eq!(json(&bench.at("run/run.json"))["unreadable"][0], "broken.png");
}

#[test]
fn what_is_wrong_is_named_with_the_next_step() {
    let bench = Bench::new();
    let known = bench.known(0.0, &BOTH);
    let fails = |mut command: Command, words: &[&str]| {
        let output = run(&mut command);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{text}");
        for word in words {
            assert!(text.contains(word), "{word:?} is not in: {text}");
        }
    };
    fs::create_dir(bench.at("notes")).expect("a folder");
    fs::write(bench.at("notes/a.txt"), "text").expect("written");
    let words = ["no dataset here", "there is a.txt", ".tiff", "cornerbench render SUITE"];
    fails(bench.measure("own", &bench.at("notes"), "run"), &words);
    let mut command = bench.measure("own", plain_dataset(), "run");
    command.args(["--known", &known]);
    fails(command, &["is a dataset", "--known", "a folder of pictures"]);
    let words = ["no corner is known", "give --known FILE", "a plan with a detector"];
    fails(bench.measure("given", &bench.at("pictures"), "run"), &words);
    fs::write(bench.at("recipes/plans/drawn.toml"), format!("{GIVEN}\n[[drawn]]"))
        .expect("written");
    let mut command = cornerbench();
    command.args(["measure", "drawn", "--known", &known, "--recipes"]).arg(bench.at("recipes"));
    fails(command, &["draws its junctions", "--known", "leave it out"]);
    fails(bench.own("run", &["--known", "Cargo.toml"]), &["must end in .csv or .json"]);
    fails(bench.own("run", &["--camera", "idael"]), &["did you mean \"ideal\"?"]);
    fails(bench.own("run", &["--white", "0"]), &["--white is 0, must be in (0"]);
    assert!(!bench.at("run").exists());
}
