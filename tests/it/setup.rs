//! Setting up Python where nothing can be fetched.

use std::fs;
use std::process::Command;

use crate::support::{copy_folder, project, run, stderr};

/// A project of which only the lock is there, and no package index.
#[test]
fn without_a_network_setup_names_what_could_not_be_fetched_and_keeps_nothing() {
    let copy = tempfile::tempdir().expect("a temporary folder");
    fs::create_dir_all(copy.path().join("scenes/suites")).expect("created");
    fs::create_dir_all(copy.path().join("scripts/cornerscenes")).expect("created");
    let lock = copy.path().join("scripts/requirements.txt");
    fs::copy(project().join("scripts/requirements.txt"), lock).expect("copied");

    let nowhere = "http://127.0.0.1:9/simple";
    let output = run(Command::new(env!("CARGO_BIN_EXE_cornerbench"))
        .arg("setup")
        .current_dir(copy.path())
        .env("PIP_CONFIG_FILE", "/dev/null")
        .env("PIP_INDEX_URL", nowhere)
        .env("PIP_DEFAULT_TIMEOUT", "5")
        .env_remove("PIP_FIND_LINKS")
        .env_remove("PIP_EXTRA_INDEX_URL")
        .env_remove("UV_INDEX")
        .env_remove("UV_INDEX_URL")
        .env_remove("UV_FIND_LINKS")
        .env("UV_DEFAULT_INDEX", nowhere)
        .env("UV_NO_CACHE", "1"));
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    let text = stderr(&output);
    let lock = fs::read_to_string(project().join("scripts/requirements.txt")).expect("a lock");
    let packages: Vec<&str> =
        lock.lines().filter_map(|line| line.split_once("==")).map(|(name, _)| name).collect();
    assert!(packages.len() > 5);
    assert!(packages.iter().any(|name| text.contains(name)), "no package is named: {text}");
    assert!(text.contains("nothing of it was kept"), "{text}");
    let left: Vec<_> = fs::read_dir(copy.path().join(".python"))
        .expect("there")
        .flatten()
        .filter(|entry| entry.file_name() != ".lock")
        .collect();
    assert!(left.is_empty(), "left behind: {left:?}");
}

/// A Python that is not there is named, with the version that is needed.
#[test]
fn without_python_setup_says_which_is_needed() {
    let copy = tempfile::tempdir().expect("a temporary folder");
    copy_folder(&project().join("scenes"), &copy.path().join("scenes"));
    fs::create_dir_all(copy.path().join("scripts/cornerscenes")).expect("created");
    fs::write(copy.path().join("scripts/requirements.txt"), "").expect("written");
    let output = run(Command::new(env!("CARGO_BIN_EXE_cornerbench"))
        .arg("setup")
        .current_dir(copy.path())
        .env("PATH", copy.path()));
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("Python 3.11 or newer is needed"), "{}", stderr(&output));
}
