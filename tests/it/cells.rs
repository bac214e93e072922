//! Drawn junctions as images of a plan, through the binary.

use std::fs;
use std::path::Path;
use std::process::Command;

use cornerbench::record::{Record, kind, read_records};
use serde_json::Value;

use crate::dataset::json;
use crate::support::{
    copy_folder, cornerbench, plain_dataset, project, recipes, run, stderr, succeed,
};

/// Recipes with a plan of one's own, and the cameras that junctions are drawn for.
fn with_plan(folder: &Path, plan: &str) {
    copy_folder(&recipes(), folder);
    for camera in ["bench", "noise-free", "bench-malvar"] {
        let name = format!("cameras/{camera}.toml");
        fs::copy(project().join("scenes").join(&name), folder.join(name)).expect("copied");
    }
    fs::write(folder.join("plans/own.toml"), plan).expect("written");
}

fn measure(recipes: &Path, output: &Path) -> Command {
    let mut command = cornerbench();
    command.args(["measure", "own", "--quiet", "--recipes"]).arg(recipes).arg("-o").arg(output);
    command
}

/// Rows and summary of a plan.
fn measured(plan: &str) -> (Vec<Record>, Value) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (recipes, output) = (folder.path().join("recipes"), folder.path().join("run"));
    with_plan(&recipes, plan);
    succeed(&mut measure(&recipes, &output));
    let records = read_records(&output.join("records.parquet")).expect("records");
    (records, json(&output.join("summary.json")))
}

fn number(value: &Value, key: &str) -> f64 {
    let found = &value["refined"][key]["value"];
    found.as_f64().unwrap_or_else(|| panic!("no number {key} in {}", value["method"]))
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    values.iter().sum::<f64>() / values.len() as f64
}

#[test]
fn the_fits_are_on_the_bound_and_opencv_s_method_is_not() {
    let (_, summary) = measured(
        "camera = 'bench'
         [[drawn]]
         junction = ['L', 'Y', 'arrow']
         gaussian_sigma_px = [0.5, 1]
         contrast_over_noise = [20, 50, 100]
         corners = 200
         [[pipelines]]
         seeds.disc_px = 1
         refine = ['junction_fit', 'edge_intersection', 'corner_sub_pix', 'none']",
    );
    let cells = summary["cells"].as_array().expect("cells");
    assert_eq!(cells.len(), 18);
    let of = |method: usize, key: &'static str| {
        cells.iter().map(move |cell| number(&cell["methods"][method], key))
    };
    // 200 corners tell a root mean square to 3.5 %, the mean of 18 such to 0.8 %.
    let ratio = mean(of(0, "rmse_over_bound"));
    assert!((0.96..1.04).contains(&ratio), "{ratio}");
    for (method, range) in [(0, 1.85..2.15), (1, 1.7..2.5)] {
        let nees = mean(of(method, "nees"));
        assert!(range.contains(&nees), "{method}: {nees}");
    }
    assert!(mean(of(0, "failed")) < 0.005);
    // More is seen of an edge than the bound's disc of 10 px holds.
    assert!(mean(of(1, "rmse_over_bound")) < 0.95);
    assert!(mean(of(2, "rmse_over_bound")) > 4.0);
    // Seeds are evenly spread over the disc.
    let unrefined = mean(of(3, "rmse_px"));
    assert!((unrefined - 0.5_f64.sqrt()).abs() < 0.01, "{unrefined}");
}

#[test]
fn without_noise_the_fit_is_exact_for_every_junction_that_it_knows() {
    let (records, summary) = measured(
        "camera = 'noise-free'
         [[drawn]]
         junction = ['L', 'Y', 'arrow', 'T', 'X']
         gaussian_sigma_px = 0.8
         phase_grid = 4
         turns = 3
         [[drawn]]
         angle_deg = [60, 120]
         gaussian_sigma_px = 0.8
         ramp_per_px = 0.005
         corners = 20
         [[pipelines]]
         seeds.disc_px = 0.5
         refine = ['junction_fit', 'saddle_polynomial']",
    );
    let cells = summary["cells"].as_array().expect("cells");
    let fit = |cell: usize| &cells[cell]["methods"][0];
    for cell in [0, 1, 2, 5, 6] {
        assert!(number(fit(cell), "rmse_px") < 1e-3, "{}", cells[cell]["cell"]);
        assert!(number(fit(cell), "failed") < 1e-9, "{}", cells[cell]["cell"]);
    }
    // A T is no corner of a cuboid, and X corners have a method of their own.
    assert!(number(fit(3), "failed") > 0.9);
    assert!(number(&cells[4]["methods"][1], "rmse_px") < 0.02);
    // Each place of the grid as often, in the middle of its part of the pixel.
    let mut places: Vec<[i32; 2]> = records
        .iter()
        .filter(|row| row.cell.as_deref() == Some("L") && row.method.ends_with("junction_fit"))
        .map(|row| {
            [row.true_x_px, row.true_y_px].map(|at| {
                let share = 4.0 * (at.expect("a corner") + 0.5).rem_euclid(1.0) - 0.5;
                (0..4)
                    .find(|place| (share - f64::from(*place)).abs() < 1e-9)
                    .unwrap_or_else(|| panic!("{share} is not the middle of a part"))
            })
        })
        .collect();
    places.sort_unstable();
    let wanted: Vec<[i32; 2]> = (0..48).map(|index| [index / 12, index / 3 % 4]).collect();
    assert_eq!(places, wanted);
    let lock = &fit(0)["lock"];
    assert_eq!(lock["bias_px"].as_array().map(Vec::len), Some(16));
    assert!(lock["amplitude_px"].as_f64().expect("a number") < 1e-3);
}

#[test]
fn neighbours_and_round_corners_mislead_and_mosaics_of_red_corners_tell_less() {
    let (_, summary) = measured(
        "camera = 'noise-free'
         [[drawn]]
         neighbour_px = [6, 30]
         gaussian_sigma_px = 0.7
         corners = 40
         [[drawn]]
         rounding_px = [0, 4]
         gaussian_sigma_px = 0.7
         corners = 40
         [[pipelines]]
         seeds.disc_px = 0
         refine = { algorithm = 'corner_sub_pix', half_window_px = 5 }",
    );
    let bias = |cell: usize| number(&summary["cells"][cell]["methods"][0], "bias_along_px");
    let error = |cell: usize| number(&summary["cells"][cell]["methods"][0], "rmse_px");
    assert!(error(0) > 2.0 * error(1), "{} {}", error(0), error(1));
    // The round corner is 4 (sqrt(2) - 1) = 1.66 px from where its edges meet; these pull the answer back.
    assert!((0.5..1.66).contains(&(bias(3) - bias(2))), "{} {}", bias(3), bias(2));

    let (records, summary) = measured(
        "camera = ['bench', 'bench-malvar']
         [[drawn]]
         surface = ['grey', 'red']
         gaussian_sigma_px = 0.7
         contrast_over_noise = 50
         corners = 60
         [[pipelines]]
         detect = 'harris'
         refine = 'junction_fit'",
    );
    let cells = summary["cells"].as_array().expect("cells");
    let bound = |cell: usize| cells[cell]["bound_px"].as_f64().expect("a bound");
    // A mosaic keeps a third of what three colours tell, and of red little but a quarter of the pixels.
    assert!(bound(3) > 1.5 * bound(1), "{} {}", bound(3), bound(1));
    assert!(number(&cells[0]["methods"][0], "rmse_over_bound") < 1.3);
    assert_eq!(records.iter().filter(|row| row.kind == kind::CORNER).count(), 4 * 60);
}

const PLAN: &str = "camera = 'bench'
     [[drawn]]
     junction = ['L', 'Y']
     gaussian_sigma_px = [0.2, 0.7]
     contrast_over_noise = 50
     corners = 30
     [[pipelines]]
     seeds.disc_px = [0.5, 2]
     refine = ['junction_fit', 'none']";

#[test]
fn rows_are_the_same_on_any_number_of_threads_and_in_shards() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let recipes = folder.path().join("recipes");
    with_plan(&recipes, PLAN);
    let at = |name: &str| folder.path().join(name);
    let bytes = |name: &str| fs::read(at(name).join("records.parquet")).expect("records");
    succeed(measure(&recipes, &at("one")).args(["--threads", "1"]));
    succeed(measure(&recipes, &at("three")).args(["--threads", "3"]));
    assert!(bytes("one") == bytes("three"));
    for shard in 0..3 {
        let name = format!("shard-{shard}");
        succeed(measure(&recipes, &at(&name)).args(["--shard", &format!("{shard}/3")]));
    }
    let shards = (0..3).map(|shard| at(&format!("shard-{shard}")));
    succeed(cornerbench().args(["merge", "--quiet", "-o"]).arg(at("merged")).args(shards));
    assert!(bytes("one") == bytes("merged"));
}

#[test]
fn tables_go_between_the_marks_of_a_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (recipes, output) = (folder.path().join("recipes"), folder.path().join("run"));
    with_plan(&recipes, PLAN);
    let said = succeed(measure(&recipes, &output).arg("--list"));
    assert!(said.contains("4 methods on 120 photographs of 4 cells (bench)"), "{said}");
    succeed(&mut measure(&recipes, &output));
    let page = fs::read_to_string(output.join("report/index.html")).expect("a page");
    assert!(page.contains("error-0.svg") && !page.contains("NaN"));
    let path = folder.path().join("table.md");
    let splice = |text: &str| {
        fs::write(&path, text).expect("written");
        let output = run(cornerbench().arg("report").arg(&output).arg("--into").arg(&path));
        let text = fs::read_to_string(&path).expect("the file");
        (output.status.code(), stderr(&output), text)
    };
    let (code, said, _) = splice("<!-- results of another: cells -->");
    assert_eq!(code, Some(2));
    assert!(said.contains("<!-- results of own: TABLE -->"), "{said}");
    let (_, said, _) = splice("<!-- results of own: cell -->\n<!-- end of results -->");
    assert!(said.contains("did you mean \"cells\"?"), "{said}");
    let (_, said, _) = splice("<!-- results of own: cells -->\n");
    assert!(said.contains("<!-- end of results -->"), "{said}");
    let marks = "before\n<!-- results of own: cells -->\nold\n<!-- end of results -->\nbetween\n\
                 <!-- results of own: methods --><!-- end of results -->\nafter\n";
    let (code, said, text) = splice(marks);
    assert_eq!(code, Some(0), "{said}");
    assert!(text.starts_with("before\n<!-- results of own: cells -->\n\n`cornerbench measure own"));
    assert!(text.contains("| Gaussian blur px | junction |") && !text.contains("old"), "{text}");
    assert!(text.contains("<!-- end of results -->\nbetween\n") && text.ends_with("\nafter\n"));
    assert_eq!(splice(&text).2, text, "again, and nothing changes");
}

#[test]
fn what_drawn_junctions_have_no_use_for_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let drawn = "[[drawn]]\n[[pipelines]]\nname = 'a'\nseeds.disc_px = 1";
    with_plan(folder.path(), drawn);
    let output = folder.path().join("run");
    let refused = run(measure(folder.path(), &output).arg(plain_dataset()));
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("which are no dataset"), "{}", stderr(&refused));
    let cases = [
        ("[[drawn]]\ncontrast_over_noise = 20", "seeds.disc_px = 1", "has no sensor"),
        ("[[drawn]]\ncorners = 0", "seeds.disc_px = 1", "corners is 0"),
        ("[[drawn]]\n[[drawn]]", "seeds.disc_px = 1", "two cells are called \"L\""),
        ("[[drawn]]", "detect = 'harris'\ntarget = 'red_difference'", "leave out `target`"),
        ("[[drawn]]\njunction = 'K'", "seeds.disc_px = 1", "junction"),
    ];
    for (head, pipeline, words) in cases {
        let plan = format!("{head}\n[[pipelines]]\nname = 'a'\n{pipeline}\n");
        with_plan(folder.path(), &plan);
        let refused = run(&mut measure(folder.path(), &output));
        assert_eq!(refused.status.code(), Some(2), "{plan}");
        assert!(stderr(&refused).contains(words), "{words}: {}", stderr(&refused));
    }
}
