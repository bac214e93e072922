//! What the tests share: the project's folder, the program, Python, one rendered dataset.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// The project's folder.
pub fn project() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The recipes of the tests' own scenes.
pub fn recipes() -> PathBuf {
    project().join("tests/recipes")
}

/// The program, started in the project's folder.
pub fn cornerbench() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cornerbench"));
    command.current_dir(project());
    command
}

/// Runs a command to its end.
pub fn run(command: &mut Command) -> Output {
    command.output().expect("the program starts")
}

/// Standard output as text.
pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Standard error as text.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs a command that must end well; returns its standard output.
pub fn succeed(command: &mut Command) -> String {
    let output = run(command);
    assert!(
        output.status.success(),
        "{command:?} ended with {}\n{}\n{}",
        output.status,
        stdout(&output),
        stderr(&output)
    );
    stdout(&output)
}

/// The Python of the development environment, set up on first use.
pub fn python() -> &'static Path {
    static PYTHON: OnceLock<PathBuf> = OnceLock::new();
    PYTHON.get_or_init(|| {
        PathBuf::from(succeed(cornerbench().args(["setup", "--dev", "--quiet"])).trim())
    })
}

/// A folder that is kept for the next run of the tests, until the datasets' format changes.
pub fn kept(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", cornerbench::scene::FORMAT))
}

/// The dataset of suite `plain`, rendered on first use: a cuboid alone, from above and obliquely.
pub fn plain_dataset() -> &'static Path {
    static DATASET: OnceLock<PathBuf> = OnceLock::new();
    DATASET.get_or_init(|| {
        let folder = kept("plain");
        render("plain", &folder);
        folder
    })
}

/// The dataset of suite `board`, rendered on first use: one checkerboard of 5 x 3 squares.
pub fn board_dataset() -> &'static Path {
    static DATASET: OnceLock<PathBuf> = OnceLock::new();
    DATASET.get_or_init(|| {
        let folder = kept("board");
        render("board", &folder);
        folder
    })
}

/// Renders what is missing of a suite of the tests.
pub fn render(suite: &str, folder: &Path) -> String {
    succeed(
        cornerbench()
            .args(["render", suite, "--output"])
            .arg(folder)
            .arg("--recipes")
            .arg(recipes()),
    )
}

/// A copy of the plain dataset that a test may damage.
pub fn copy_of_plain() -> tempfile::TempDir {
    let copy = tempfile::tempdir().expect("a temporary folder");
    copy_folder(plain_dataset(), copy.path());
    copy
}

/// Copies a folder with all that is in it.
pub fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("a new folder");
    for entry in fs::read_dir(from).expect("a folder").flatten() {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy_folder(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).expect("copied");
        }
    }
}
