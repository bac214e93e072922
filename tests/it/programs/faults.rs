//! What programs do wrong, they do to themselves.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::{Duration, Instant};

use cornerbench::record::{Record, kind, read_run};

use super::{Bench, CORNERS};
use crate::support::{project, run, stderr, stdout};

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
    (
        "stray_output",
        2,
        "invalid_answer",
        &["loading model weights", "the protocol's alone, print to standard error"],
    ),
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

/// A table of a copy of the faulty program, which may be edited.
fn copied(bench: &Bench, fault: &str) -> PathBuf {
    fs::copy(project().join("tests/programs/faults.py"), bench.path("own.py")).expect("copied");
    bench.table("faulty", &format!("command = ['python3', 'own.py', '{fault}', '.']"))
}

#[test]
fn a_program_that_is_edited_while_it_is_measured_is_not_started_again() {
    let bench = Bench::new();
    let found = outcome(&bench, &copied(&bench, "edited"));
    let kinds: Vec<&str> = found.failures.iter().map(|(status, _)| status.as_str()).collect();
    assert_eq!(kinds, [["crashed"].as_slice(), &["version_changed"; 5]].concat());
    assert!(found.failures[1].1.contains("is another file"), "{}", found.failures[1].1);
}

#[test]
fn a_program_with_other_code_is_another_run_whatever_version_it_says() {
    let bench = Bench::new();
    let table = copied(&bench, "none");
    let identity = || {
        assert_eq!(outcome(&bench, &table).answered, CORNERS);
        bench.run_json()["identity_sha256"].clone()
    };
    let before = identity();
    assert_eq!(identity(), before);
    let file = bench.path("own.py");
    let code = fs::read_to_string(&file).expect("code");
    fs::write(&file, code + "# better\n").expect("written");
    assert_ne!(identity(), before);
}

#[test]
fn what_a_program_says_is_kept_in_the_run_s_folder() {
    let bench = Bench::new();
    let table = copied(&bench, "crash");
    outcome(&bench, &table);
    let log = bench.path("run/programs/faulty.log");
    let said = fs::read_to_string(&log).expect("a log");
    assert_eq!(said, "about to fail\n".repeat(2));
    // Another run, and nothing to say: no log.
    outcome(&bench, &copied(&bench, "none"));
    assert!(!log.exists());
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
    let said = stdout(&found.output);
    assert!(said.contains("faulty did not end well (crashed)"), "{said}");
    let described = read_run(&bench.path("run")).expect("run.json");
    assert_eq!(described.unanswered("faulty"), 0);
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
        ("command = ['./faulty.toml']", "may not be executed: chmod +x it"),
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
        ("command = ['x']\ndoes = 'refin'", "must be \"detect\", \"refine\" or \"grasp\""),
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
