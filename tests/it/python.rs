//! The Python side: its tests, its linters.

use std::process::Command;

use crate::support::{project, python, succeed};

fn module(name: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new(python());
    command.arg("-m").arg(name).args(arguments).current_dir(project().join("scripts"));
    command
}

#[test]
fn python_tests_pass() {
    succeed(&mut module("pytest", &[]));
}

#[test]
fn python_is_clean_by_ruff() {
    succeed(&mut module("ruff", &["check", "."]));
    succeed(&mut module("ruff", &["format", "--check", "."]));
}

#[test]
fn python_is_clean_by_pyright() {
    let interpreter = python().to_string_lossy();
    succeed(&mut module("pyright", &["--pythonpath", &interpreter]));
}
