//! Runners and adapters do what they are said to do.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use cornerbench::record::{Record, kind, read_records};

use super::{Bench, CORNERS};
use crate::support::*;

/// A program that is compiled for the tests.
fn compiled(bench: &Bench, source: &str, compilers: &[&[&str]]) -> PathBuf {
    let program = bench.path(&source.replace('.', "_"));
    let source = project().join("scripts/external").join(source);
    let mut said = Vec::new();
    for words in compilers {
        let mut command = Command::new(words[0]);
        command.args(["-O2", "-Wall", "-Wextra", "-Werror", "-o"]).arg(&program).arg(&source);
        let output = run(command.args(&words[1..]));
        if output.status.success() {
            return program;
        }
        said.push(stderr(&output));
    }
    panic!("{}", said.join("\n"));
}

/// The answers of two methods, corner by corner.
fn pairs(records: &[Record], methods: [&str; 2]) -> Vec<[[f64; 2]; 2]> {
    let of = |method: &str| -> Vec<[f64; 2]> {
        let rows = records.iter().filter(|row| row.method == method && row.kind == kind::CORNER);
        rows.map(|row| [row.refined_x_px, row.refined_y_px].map(|value| value.expect("a place")))
            .collect()
    };
    let [own, other] = methods.map(of);
    assert!(own.len() == CORNERS && other.len() == CORNERS, "{} and {}", own.len(), other.len());
    own.into_iter().zip(other).map(|(own, other)| [own, other]).collect()
}

fn farthest_px(pairs: &[[[f64; 2]; 2]]) -> f64 {
    pairs.iter().map(|[[a, b], [c, d]]| (a - c).hypot(b - d)).fold(0.0, f64::max)
}

#[test]
fn the_runners_in_c_and_in_cpp_do_what_the_own_refiner_does() {
    let bench = Bench::new();
    let c = compiled(&bench, "minimal.c", &[&["cc", "-std=c99", "-lm"]]);
    let with_opencv =
        ["c++", "-std=c++17", "-I/usr/include/opencv4", "-lopencv_imgproc", "-lopencv_core"];
    let cpp = compiled(&bench, "minimal.cpp", &[&with_opencv, &["c++", "-std=c++17"]]);
    let output = run(bench.measure(&c).arg("--with").arg(&cpp));
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let records = bench.records();
    // The same method on samples of 8 bits, where the own one sees all of them.
    let far_px = farthest_px(&pairs(&records, ["given", "minimal_c"]));
    assert!(far_px < 0.05, "{far_px}");
    let has_opencv = records.iter().any(|row| row.refiner.contains("opencv"));
    let far_px = farthest_px(&pairs(&records, ["minimal_c", "minimal_cpp"]));
    assert!(!has_opencv || far_px < 0.005, "{far_px}");
}

/// Calls cornerSubPix on the photographs that `expose` wrote, from the seeds that records have.
const DIRECTLY: &str = "
import sys, cv2, numpy, pandas
records, photographs = sys.argv[1:]
rows = pandas.read_parquet(records).query(\"method == 'given' and kind == 'corner' and status == 'ok'\")
wrong = 0
for scene, of_scene in rows.groupby('scene'):
    rgb = cv2.imread(f'{photographs}/{scene}/exposure-0.png', cv2.IMREAD_UNCHANGED)[:, :, ::-1].astype(float)
    grey = numpy.floor(rgb @ [0.299, 0.587, 0.114] + 0.5).astype(numpy.uint8)
    seeds = of_scene[['detected_x_px', 'detected_y_px']].to_numpy().astype(numpy.float32)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
    moved = cv2.cornerSubPix(grey, seeds.reshape(-1, 1, 2).copy(), (5, 5), (-1, -1), criteria).reshape(-1, 2)
    answered = of_scene[['refined_x_px', 'refined_y_px']].to_numpy()
    wrong += int((moved.astype(float) != answered).any(axis=1).sum())
print(len(rows), wrong)
";

#[test]
fn opencv_through_the_adapter_answers_as_opencv_called_directly_to_the_last_bit() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (recipes_folder, output) = (folder.path().join("recipes"), folder.path().join("run"));
    copy_folder(&recipes(), &recipes_folder);
    let plan = "camera = 'ideal'\n[[pipelines]]\nname = 'given'\nseeds.disc_px = 1.5\nrefine = 'opencv-corner_sub_pix'\n";
    fs::write(recipes_folder.join("plans/own.toml"), plan).expect("written");
    python();
    let mut measure = cornerbench();
    measure.args([
        "measure",
        "own",
        "--quiet",
        "--no-timing",
        "--with",
        "opencv-corner_sub_pix",
        "--recipes",
    ]);
    succeed(measure.arg(&recipes_folder).arg(plain_dataset()).arg("-o").arg(&output));
    // What the plan names does not join it once more.
    let records = read_records(&output.join("records.parquet")).expect("records");
    assert!(records.iter().all(|row| row.method == "given"));
    let photographs = folder.path().join("photographs");
    let mut expose = cornerbench();
    expose.args(["expose", "--camera", "ideal", "--quiet", "--recipes"]).arg(&recipes_folder);
    succeed(expose.arg(plain_dataset()).arg("-o").arg(&photographs));
    let said = succeed(
        Command::new(python())
            .args(["-c", DIRECTLY])
            .arg(output.join("records.parquet"))
            .arg(photographs),
    );
    let numbers: Vec<usize> =
        said.split_whitespace().map(|word| word.parse().expect("a number")).collect();
    assert!(numbers[0] >= 8 && numbers[1] == 0, "{said}");
}

#[test]
fn the_crate_chess_corners_takes_part_and_finds_xs() {
    let build = "build --release --locked --quiet --manifest-path scripts/external/chess_corners/Cargo.toml --target-dir \
                 target/external";
    succeed(Command::new(env!("CARGO")).current_dir(project()).args(build.split_whitespace()));
    let said = succeed(cornerbench().args(["verify", "chess_corners-chess"]));
    assert!(said.contains("chess_corners-chess 1 (chess-corners 2."), "{said}");
    // Of three kinds one is its own.
    assert!(said.contains("32 of 96 corners"), "{said}");
}
