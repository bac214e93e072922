//! What `verify` says of algorithms.

use std::fs;
use std::path::PathBuf;

use serde_json::Value;

use super::Bench;
use crate::support::{cornerbench, project, python, run, stderr, stdout};

/// Something that `verify` tried, whether it passed, and its words.
type Tried = (String, Option<bool>, String);

/// What `verify` finds of a refiner with a habit, with its exit code.
fn verified(habit: &str) -> (Option<i32>, Vec<Tried>) {
    let bench = Bench::new();
    let program = project().join("tests/programs/habits.py");
    let command = [python().to_owned(), program, PathBuf::from(habit)];
    let command = serde_json::json!(command.map(|word| word.display().to_string()));
    let file = bench.table("habit", &format!("does = 'refine'\ncommand = {command}"));
    let output = run(cornerbench().args(["verify", "--json"]).arg(&file));
    let said: Value =
        serde_json::from_str(&stdout(&output)).unwrap_or_else(|_| panic!("{}", stderr(&output)));
    let findings = said[0]["findings"].as_array().expect("findings").iter();
    let findings = findings.map(|finding| {
        let text = |key: &str| finding[key].as_str().expect("a text").to_owned();
        (text("what"), finding["passed"].as_bool(), text("words"))
    });
    (output.status.code(), findings.collect())
}

#[test]
fn verify_says_what_a_refiner_gets_wrong_and_what_to_do_about_it() {
    let (code, findings) = verified("none");
    assert_eq!(code, Some(0), "{findings:?}");
    for (habit, what, words) in [
        ("pixel's corner", "coordinates", "they count from the pixel's corner; subtract 0.5"),
        ("from one", "coordinates", "they count from 1; subtract 1"),
        ("swapped", "coordinates", "x and y look swapped"),
        ("random", "the same twice", "no random numbers without a seed"),
        ("sorted", "order of seeds", "give one for each seed, in their order"),
        ("grid", "moved", "not on where or how bright they are"),
        ("bright", "gain", "not on where or how bright they are"),
        ("declines all", "answers", "all of 96 corners (L, Y and X) are declined"),
        ("crash on small pictures", "next to nothing", "index 3 is out of bounds (habits.py:"),
    ] {
        let (code, findings) = verified(habit);
        assert_eq!(code, Some(1), "{habit}: {findings:?}");
        let found = findings.iter().find(|(name, ..)| name == what).expect("tried");
        assert_eq!(found.1, Some(false), "{habit}: {findings:?}");
        assert!(found.2.contains(words), "{habit}: {}", found.2);
    }
}

/// The first block of code of a page.
fn example(page: &str) -> String {
    let text = fs::read_to_string(project().join(page)).expect("a page");
    let code = text.split("```python\n").nth(1).and_then(|rest| rest.split("```").next());
    code.expect("an example").to_owned()
}

#[test]
fn the_examples_of_the_documentation_keep_what_all_promise() {
    let bench = Bench::new();
    let file = bench.path("mine.py");
    for page in ["README.md", "scripts/PROTOCOL.md"] {
        fs::write(&file, example(page)).expect("written");
        let output = run(cornerbench().env("VIRTUAL_ENV", environment()).arg("verify").arg(&file));
        assert_eq!(output.status.code(), Some(0), "{page}: {}{}", stdout(&output), stderr(&output));
    }
}

/// The Python environment that has what tests need.
fn environment() -> PathBuf {
    python().ancestors().nth(2).expect("a folder").to_owned()
}

/// OpenCV's detector, with something done to its answers.
const DETECTOR: &str = "import cv2
from cornerbench import serve
def detect(exposure):
    points = cv2.goodFeaturesToTrack(exposure.image, 50, 0.05, 5)
    return [] if points is None else (points.reshape(-1, 2)) HABIT
serve(detect=detect, version='1')
";

#[test]
fn verify_says_where_a_detector_counts_from_and_in_which_order() {
    let bench = Bench::new();
    let file = bench.path("detector.py");
    for (habit, code, words) in [
        ("", Some(0), "coordinates      passed"),
        ("+ 0.5", Some(1), "they count from the pixel's corner; subtract 0.5"),
        ("[:, ::-1]", Some(1), "x and y look swapped"),
    ] {
        fs::write(&file, DETECTOR.replace("HABIT", habit)).expect("written");
        let output = run(cornerbench().env("VIRTUAL_ENV", environment()).arg("verify").arg(&file));
        let said = stdout(&output);
        assert_eq!(output.status.code(), code, "{habit}: {said}{}", stderr(&output));
        assert!(said.contains(words), "{habit}: {said}");
    }
}

#[test]
fn verify_says_what_is_wrong_with_a_file_and_which() {
    let bench = Bench::new();
    let with = |name: &str, text: &str| {
        let file = bench.path(name);
        fs::write(&file, text).expect("written");
        let output = run(cornerbench().env("VIRTUAL_ENV", environment()).arg("verify").arg(&file));
        assert_ne!(output.status.code(), Some(0), "{name}: {}", stdout(&output));
        stderr(&output)
    };
    let said = with("bad.toml", "[a]\ncommand = ['x']\ntimelimit_s = 1\n");
    assert!(said.contains("bad.toml: [a]: ") && said.contains("time_limit_s"), "{said}");
    let serve = "from cornerbench import serve\n";
    let refine = "serve(refine=lambda exposure, seeds: seeds, version='1')\n";
    fs::write(bench.path("plain.py"), format!("{serve}print('hello')\n{refine}")).expect("written");
    let table = "[a]\ncommand = ['{python}', 'plain.py']\nparameters.half = 3\n";
    let said = with("parameters.toml", table);
    assert!(said.contains("refine(exposure, seeds, half=3): got an unexpected"), "{said}");
    let said = with("early.py", &format!("print('hello')\n{serve}{refine}"));
    assert!(said.contains("print to standard error, in its line \"hello\""), "{said}");
    // Behind the module's import nothing that is printed comes between.
    let output = run(cornerbench()
        .env("VIRTUAL_ENV", environment())
        .arg("verify")
        .arg(bench.path("plain.py")));
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let output = run(cornerbench().args(["verify", "./mime.py"]));
    assert!(stderr(&output).contains("./mime.py: there is no such file"), "{}", stderr(&output));
}

#[test]
fn verify_finds_nothing_wrong_with_own_algorithms() {
    for name in [
        "corner_sub_pix",
        "junction_fit",
        "edge_intersection",
        "harris",
        "line_junctions",
        "foerstner",
    ] {
        let output = run(cornerbench().args(["verify", name]));
        assert_eq!(output.status.code(), Some(0), "{name}: {}", stdout(&output));
        assert!(stdout(&output).contains("coordinates"), "{}", stdout(&output));
    }
    let output = run(cornerbench().args(["verify", "corner_sub_pics"]));
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("did you mean \"corner_sub_pix\""), "{}", stderr(&output));
}
