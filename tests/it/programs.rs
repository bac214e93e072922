//! Algorithms that are other programs, through the binary: what they do wrong, they do to themselves.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use cornerbench::record::{Record, kind, read_records};
use serde_json::Value;

use crate::dataset::json;
use crate::support::{
    copy_folder, cornerbench, plain_dataset, project, python, recipes, run, stderr, stdout, succeed,
};

const CORNERS: usize = 8;

/// A folder with recipes whose plan `own` draws a few junctions, for one own refiner, and with a table of a program.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let recipes_folder = folder.path().join("recipes");
        copy_folder(&recipes(), &recipes_folder);
        fs::copy(
            project().join("scenes/cameras/noise-free.toml"),
            recipes_folder.join("cameras/noise-free.toml"),
        )
        .expect("copied");
        let plan = format!(
            "camera = 'noise-free'
             [[drawn]]
             junction = 'L'
             gaussian_sigma_px = 0.7
             corners = {CORNERS}
             [[pipelines]]
             name = 'given'
             seeds.disc_px = 0.5
             refine = 'corner_sub_pix'"
        );
        fs::write(recipes_folder.join("plans/own.toml"), plan).expect("written");
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a table of a program.
    fn table(&self, name: &str, lines: &str) -> PathBuf {
        let file = self.path(&format!("{name}.toml"));
        fs::write(&file, format!("['{name}']\n{lines}\n")).expect("written");
        file
    }

    /// A program with one fault, and the file of its table.
    fn faulty(&self, fault: &str, more: &str) -> PathBuf {
        let program = project().join("tests/programs/faults.py");
        let command = [Path::new("python3"), &program, Path::new(fault), self.folder.path()];
        let command = serde_json::json!(command.map(|word| word.display().to_string()));
        let lines = format!("does = 'refine'\ntime_limit_s = 1\ncommand = {command}\n{more}");
        self.table("faulty", &lines)
    }

    fn measure(&self, with: &Path) -> Command {
        let mut command = cornerbench();
        command.args(["measure", "own", "--quiet", "--no-timing", "--threads", "1", "--recipes"]);
        command.arg(self.path("recipes")).arg("-o").arg(self.path("run")).arg("--with").arg(with);
        command
    }

    fn records(&self) -> Vec<Record> {
        read_records(&self.path("run/records.parquet")).expect("records")
    }

    fn run_json(&self) -> Value {
        json(&self.path("run/run.json"))
    }
}

/// What a faulty program's run was.
struct Outcome {
    output: Output,
    /// Status and reason of each failure.
    failures: Vec<(String, String)>,
    /// Corners that the program answered.
    answered: usize,
}

fn outcome(bench: &Bench, with: &Path) -> Outcome {
    let output = run(&mut bench.measure(with));
    let records = bench.records();
    let of = |method: &'static str, kind: &'static str| {
        records.iter().filter(move |row| row.method == method && row.kind == kind)
    };
    // The own refiner's answers, and a row for each corner of both, whatever happened.
    let own = of("given", kind::CORNER).filter(|row| row.refine_status.as_deref() == Some("ok"));
    assert_eq!(own.count(), CORNERS);
    assert_eq!(of("faulty", kind::CORNER).count(), CORNERS);
    let status = |row: &&Record| row.refine_status.clone().expect("a status");
    let answered = of("faulty", kind::CORNER).filter(|row| status(row) == "ok");
    for row in of("faulty", kind::CORNER).filter(|row| status(row) == "failed") {
        assert!(row.reason.is_some(), "{row:?}");
        assert_eq!((row.detected_x_px, row.detected_y_px), (row.refined_x_px, row.refined_y_px));
    }
    let said = |row: &Record| (row.status.clone(), row.reason.clone().expect("a reason"));
    Outcome {
        failures: of("faulty", kind::FAILURE).map(said).collect(),
        answered: answered.count(),
        output,
    }
}

/// A fault: how many times it happens, what records call it, and what the reason says.
type Fault = (&'static str, usize, &'static str, &'static [&'static str]);

/// Third questions go wrong; a program that was started again is asked three more times till it does so again.
const FAULTS: [Fault; 24] = [
    ("crash", 2, "crashed", &["ended with exit code 7", "about to fail"]),
    ("killed", 2, "crashed", &["signal: 9"]),
    ("hang", 2, "timed_out", &["gave no answer within 1 s"]),
    (
        "no_newline",
        2,
        "timed_out",
        &["gave no whole line within 1 s", "bytes without a line's end"],
    ),
    ("gigabyte", 2, "invalid_answer", &["wrote more than 32 MiB without a line's end"]),
    ("gigabyte_of_lines", 2, "invalid_answer", &["yyy"]),
    ("nan", 2, "invalid_answer", &["NaN is no answer", "null"]),
    ("infinity", 2, "invalid_answer", &["Infinity is no answer"]),
    ("stray_output", 2, "invalid_answer", &["loading model weights"]),
    ("unknown_field", 2, "invalid_answer", &["unknown field `confidence`", "took_us"]),
    ("wrong_id", 2, "invalid_answer", &["answered question 4 when asked 3"]),
    ("negative_time", 2, "invalid_answer", &["says that it took -1 us"]),
    ("impossible_time", 2, "invalid_answer", &["says that it took 1000000000000 us"]),
    ("too_many", 1, "invalid_answer", &["2 points for 1 seeds", "one for each"]),
    ("too_few", 1, "invalid_answer", &["0 points for 1 seeds"]),
    ("no_points", 1, "invalid_answer", &["points are missing"]),
    ("wrong_field", 1, "invalid_answer", &["responses answers no question of task \"refine\""]),
    ("unknown_status", 1, "invalid_answer", &["status 0 is \"fine\"", "max_iterations"]),
    ("covariance", 1, "invalid_answer", &["covariance 0, [1, 3, 1], is none"]),
    ("says_so", 1, "failed", &["ran out of memory"]),
    ("crash_at_start", 8, "not_available", &["exit code 1", "no licence found", "pip install it"]),
    ("missing_package", 8, "not_available", &["a_package_that_nobody_has", "pip install it"]),
    ("no_version", 8, "not_available", &["says no version"]),
    ("other_protocol", 8, "not_available", &["speaks version 99 of the protocol, this program 1"]),
];

#[test]
fn a_fault_is_a_row_with_its_reason_and_the_run_goes_on() {
    for (fault, count, status, words) in FAULTS {
        let bench = Bench::new();
        let found = outcome(&bench, &bench.faulty(fault, "install = 'pip install it'"));
        assert_eq!(found.output.status.code(), Some(1), "{fault}: {}", stderr(&found.output));
        assert_eq!(found.failures.len(), count, "{fault}: {:?}", found.failures);
        assert_eq!(found.answered, CORNERS - count, "{fault}");
        for (found, reason) in &found.failures {
            assert_eq!(found, status, "{fault}: {reason}");
            assert!(reason.starts_with("faulty: "), "{fault}: {reason}");
            // Questions are numbered from the first one on; the second fault is another number.
            let is_second = words[0].contains("when asked") && reason.contains("when asked 6");
            assert!(
                is_second || words.iter().all(|word| reason.contains(word)),
                "{fault}: {reason}"
            );
        }
        let times = if count == 1 { "once".to_owned() } else { format!("{count} times") };
        assert!(stdout(&found.output).contains(&format!("faulty had no answer {times} of ")));
        let run = bench.run_json();
        assert_eq!(run["failures"][0]["count"], count, "{fault}");
        let page = fs::read_to_string(bench.path("run/report/index.html")).expect("a page");
        assert!(page.contains("had no answer"), "{fault}");
    }
}

#[test]
fn no_fault_is_no_failure() {
    let bench = Bench::new();
    let found = outcome(&bench, &bench.faulty("none", ""));
    assert_eq!(found.output.status.code(), Some(0), "{}", stderr(&found.output));
    assert!(found.failures.is_empty() && found.answered == CORNERS);
    let label =
        bench.records().iter().find(|row| row.method == "faulty").map(|row| row.refiner.clone());
    assert_eq!(label.as_deref(), Some("faulty 1"));
    assert_eq!(bench.run_json()["programs"][0]["version"], "1");
}

#[test]
fn a_program_that_becomes_another_one_is_not_measured_any_more() {
    let bench = Bench::new();
    let found = outcome(&bench, &bench.faulty("version_changes", ""));
    assert_eq!(found.output.status.code(), Some(1));
    let kinds: Vec<&str> = found.failures.iter().map(|(status, _)| status.as_str()).collect();
    assert_eq!(kinds, [["crashed"].as_slice(), &["version_changed"; 5]].concat());
    let (_, reason) = &found.failures[1];
    assert!(reason.contains("was version 1 and is 2 when started again"), "{reason}");
    assert_eq!(found.answered, 2);
}

#[test]
fn a_crash_after_the_last_answer_takes_no_answer_away() {
    let bench = Bench::new();
    let found = outcome(&bench, &bench.faulty("crash_at_exit", ""));
    assert_eq!(found.output.status.code(), Some(1), "{}", stderr(&found.output));
    assert_eq!(found.answered, CORNERS);
    let [(status, reason)] = &found.failures[..] else { panic!("{:?}", found.failures) };
    assert_eq!(status, "crashed");
    assert!(reason.contains("when all was asked it ended with exit code 9"), "{reason}");
    assert!(reason.contains("double free"), "{reason}");
}

/// Whether a process runs; one that has ended and that nobody has asked about is none.
#[cfg(target_os = "linux")]
fn runs(id: &str) -> bool {
    fs::read_to_string(format!("/proc/{id}/stat"))
        .is_ok_and(|stat| !stat.rsplit(") ").next().is_some_and(|rest| rest.starts_with('Z')))
}

#[cfg(target_os = "linux")]
#[test]
fn everything_that_a_program_started_ends_with_it() {
    for (fault, status, count) in
        [("children", "timed_out", 4), ("crash_with_children", "crashed", 2)]
    {
        let bench = Bench::new();
        let found = outcome(&bench, &bench.faulty(fault, ""));
        assert!(found.failures.iter().all(|(found, _)| found == status), "{:?}", found.failures);
        let children = fs::read_to_string(bench.path("children")).expect("their numbers");
        assert_eq!(children.lines().count(), count, "{fault}");
        let begun = Instant::now();
        while children.lines().any(runs) {
            assert!(begun.elapsed() < Duration::from_secs(5), "{fault}: {children}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

#[test]
fn a_child_that_cannot_be_ended_and_has_the_pipes_is_not_waited_for() {
    let bench = Bench::new();
    let begun = Instant::now();
    let found = outcome(&bench, &bench.faulty("hidden_child", ""));
    assert_eq!(found.failures.len(), 2, "{:?}", found.failures);
    assert_eq!(found.answered, CORNERS - 2);
    // Twice a second that was allowed; each child has six.
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
}

#[test]
fn a_program_that_does_not_greet_is_not_waited_for() {
    let bench = Bench::new();
    let found = outcome(&bench, &bench.faulty("hang_at_start", "start_limit_s = 1"));
    assert_eq!(found.failures.len(), CORNERS);
    assert!(found.failures[0].1.contains("within 1 s"), "{:?}", found.failures[0]);
}

#[test]
fn what_is_not_there_is_said_with_the_way_to_get_it() {
    let bench = Bench::new();
    for (lines, words) in [
        ("command = ['python3.999']", "python3.999 is not there"),
        ("command = ['./no such program']", "no such program is not there"),
        ("command = ['python3', 'no such file.py']", "No such file"),
        ("command = ['{python:kornia-not-there}', 'x.py']", "cornerbench setup --kornia-not-there"),
        ("command = ['true']\nversion_command = ['false']", "exit code 1"),
        ("command = ['true']\nversion_command = ['echo']", "its version command says nothing"),
    ] {
        let file = bench.table("faulty", &format!("{lines}\ndoes = 'refine'\ninstall = 'ask me'"));
        let found = outcome(&bench, &file);
        assert_eq!(found.failures.len(), CORNERS, "{lines}");
        let (status, reason) = &found.failures[0];
        assert_eq!(status, "not_available");
        assert!(
            reason.contains(words) && reason.ends_with("to install it: ask me"),
            "{lines}: {reason}"
        );
    }
}

#[test]
fn names_and_paths_may_have_spaces_and_letters_of_any_alphabet() {
    let bench = Bench::new();
    let folder = bench.path("größer als 1 pixel");
    fs::create_dir(&folder).expect("made");
    fs::copy(project().join("tests/programs/faults.py"), folder.join("меньше 1.py"))
        .expect("copied");
    let file = folder.join("Präzise Ecke.toml");
    let lines = "['Präzise Ecke']\ndoes = 'refine'\ncommand = ['python3', 'меньше 1.py', 'none']";
    fs::write(&file, lines).expect("written");
    let output = run(&mut bench.measure(&file));
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let records = bench.records();
    assert_eq!(records.iter().filter(|row| row.method == "pr_zise_ecke").count(), CORNERS);
}

#[test]
fn tables_that_make_no_sense_say_why() {
    let bench = Bench::new();
    for (lines, words) in [
        ("comand = ['x']", "did you mean \"command\""),
        ("does = 'refine'", "command is missing"),
        ("command = ['x']\ntime_limit_s = -1", "time_limit_s is -1"),
        ("command = ['x']\ndoes = 'refin'", "does"),
        ("command = ['x']\nneeds.encoding = 'linear'", "too coarse for linear light"),
        ("command = ['true']", "ended with exit code 0"),
        ("command = ['true']\ndoes = 'grasp'", "faulty does grasp, and no pipeline has that stage"),
    ] {
        let output = run(&mut bench.measure(&bench.table("faulty", lines)));
        assert_eq!(output.status.code(), Some(2), "{lines}: {}", stdout(&output));
        assert!(stderr(&output).contains(words), "{lines}: {}", stderr(&output));
    }
    let output = run(&mut bench.measure(Path::new("opencv-corner_sub_pics")));
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("unknown program or file"), "{}", stderr(&output));
}

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
        ("mine 2,oblique,x,1,1", "invalid float"),
    ] {
        fs::write(&file, format!("{text}{row}\n")).expect("written");
        let done = measure_answers(&file, &output);
        assert_eq!(done.status.code(), Some(2), "{row}: {}", stdout(&done));
        assert!(stderr(&done).contains(words), "{row}: {}", stderr(&done));
    }
}

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
