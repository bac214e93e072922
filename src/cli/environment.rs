//! The Python environment that renders: made from a lock, whole or not at all.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::error::{Error, Result};
use crate::files::sha256_hex;

/// What an environment is for; decides which lock it is made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// Rendering.
    Rendering,
    /// Rendering by the machines of a Ray cluster.
    Ray,
    /// Rendering, and the Python tests and linters.
    Development,
    /// Timing our detectors beside those of OpenCV and of scikit-image.
    Peers,
    /// Timing them beside those of kornia, too.
    Kornia,
    /// Learned detectors through onnxruntime.
    Onnx,
    /// Grasps in physics.
    Mujoco,
}

impl Purpose {
    fn name(self) -> &'static str {
        match self {
            Self::Rendering => "rendering",
            Self::Ray => "ray",
            Self::Development => "development",
            Self::Peers => "peers",
            Self::Kornia => "kornia",
            Self::Onnx => "onnx",
            Self::Mujoco => "mujoco",
        }
    }

    fn lock(self) -> &'static str {
        match self {
            Self::Rendering => "requirements.txt",
            Self::Ray => "requirements-ray.txt",
            Self::Development => "requirements-dev.txt",
            Self::Peers => "requirements-peers.txt",
            Self::Kornia => "requirements-kornia.txt",
            Self::Onnx => "requirements-onnx.txt",
            Self::Mujoco => "requirements-mujoco.txt",
        }
    }
}

/// The file that is written into an environment when all of it is there.
const COMPLETE: &str = ".complete";

/// The Python program of the environment, which is made first where it is missing.
///
/// One process at a time makes environments; the others wait for it.
///
/// # Errors
/// When Python is missing or too old, or a package cannot be fetched; nothing is left behind then.
pub(super) fn python(root: &Path, purpose: Purpose, say: &dyn Fn(&str)) -> Result<PathBuf> {
    let folder = folder(root, purpose)?;
    if is_complete(&folder) {
        return Ok(program(&folder));
    }
    let home = home(root);
    fs::create_dir_all(&home).map_err(Error::io(&home, "create"))?;
    let path = home.join(".lock");
    let turn = fs::File::create(&path).map_err(Error::io(&path, "create"))?;
    turn.lock().map_err(Error::io(&path, "lock"))?;
    if !is_complete(&folder) {
        say(&format!("setting up Python for {} in {}", purpose.name(), folder.display()));
        // Incomplete ones, and those of another lock.
        let prefix = format!("{}-", purpose.name());
        remove_all(&home, &prefix);
        if let Err(error) = install(&folder, &lock(root, purpose)) {
            remove_all(&home, &prefix);
            return Err(error);
        }
        let marker = folder.join(COMPLETE);
        fs::write(&marker, "").map_err(Error::io(&marker, "write"))?;
    }
    Ok(program(&folder))
}

/// The Python program of an environment of the project in the folder `root`, where it is set up.
///
/// # Errors
/// When the environment's lock cannot be read.
pub fn present_python(root: &Path, purpose: Purpose) -> Result<Option<PathBuf>> {
    let folder = folder(root, purpose)?;
    Ok(is_complete(&folder).then(|| program(&folder)))
}

/// The Python program of an environment that holds what the one of a name does, where such is set up. "" is the one that
/// the user has activated, else the project's that holds most.
pub fn python_with(root: &Path, name: &str) -> Option<PathBuf> {
    use Purpose::{Development, Kornia, Mujoco, Onnx, Peers, Ray, Rendering};
    let active = ["VIRTUAL_ENV", "CONDA_PREFIX"].into_iter().find_map(std::env::var_os);
    if let Some(active) = active.filter(|_| name.is_empty()) {
        return Some(program(Path::new(&active)));
    }
    let holding: &[Purpose] = match name {
        "" => &[Kornia, Development, Peers, Onnx, Rendering, Mujoco, Ray],
        "rendering" => &[Rendering, Development, Peers, Kornia, Onnx, Mujoco, Ray],
        "mujoco" => &[Mujoco, Development],
        "onnx" => &[Onnx, Development],
        "peers" => &[Peers, Kornia, Development],
        "kornia" => &[Kornia],
        "development" => &[Development],
        "ray" => &[Ray],
        _ => &[],
    };
    holding.iter().find_map(|purpose| present_python(root, *purpose).ok().flatten())
}

fn home(root: &Path) -> PathBuf {
    root.join(".python")
}

fn lock(root: &Path, purpose: Purpose) -> PathBuf {
    root.join("scripts").join(purpose.lock())
}

/// An environment's folder; it is named after its lock's hash, so one that is complete is current.
fn folder(root: &Path, purpose: Purpose) -> Result<PathBuf> {
    let lock = lock(root, purpose);
    let bytes = fs::read(&lock).map_err(Error::io(&lock, "read"))?;
    Ok(home(root).join(format!("{}-{}", purpose.name(), &sha256_hex(&bytes)[..12])))
}

fn is_complete(environment: &Path) -> bool {
    environment.join(COMPLETE).is_file()
}

/// Removes the environments of one purpose. What cannot be removed does no harm: it lacks the marker
/// or has another name.
fn remove_all(home: &Path, prefix: &str) {
    for entry in fs::read_dir(home).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(prefix) {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}

fn program(environment: &Path) -> PathBuf {
    if cfg!(windows) {
        environment.join("Scripts").join("python.exe")
    } else {
        environment.join("bin").join("python")
    }
}

/// Makes the environment by uv where it is there, else by venv and pip.
fn install(environment: &Path, lock: &Path) -> Result<()> {
    if let Ok(found) = Command::new("uv").arg("--version").output()
        && found.status.success()
    {
        let mut create = Command::new("uv");
        create.args(["venv", "--quiet", "--python", ">=3.11"]).arg(environment);
        run("uv", create)?;
        let mut fetch = Command::new("uv");
        fetch.args(["pip", "install", "--quiet", "--require-hashes", "--only-binary", ":all:"]);
        fetch.arg("--python");
        fetch.arg(program(environment)).arg("-r").arg(lock);
        return run("uv", fetch);
    }
    let interpreter = system_python()?;
    let mut create = Command::new(interpreter);
    create.args(["-m", "venv"]).arg(environment);
    run("python3 -m venv (on Debian and Ubuntu: apt-get install python3-venv)", create)?;
    let mut fetch = Command::new(program(environment));
    fetch.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
    fetch.args(["--retries", "2", "--require-hashes", "--only-binary", ":all:", "-r"]).arg(lock);
    run("pip", fetch)
}

/// A Python of at least 3.11.
fn system_python() -> Result<&'static str> {
    let check = "import sys; print('%d.%d' % sys.version_info[:2]); \
                 sys.exit(sys.version_info < (3, 11))";
    let mut found = String::new();
    for name in ["python3", "python"] {
        match Command::new(name).args(["-c", check]).output() {
            Ok(output) if output.status.success() => return Ok(name),
            Ok(output) => found = format!(", found {}", String::from_utf8_lossy(&output.stdout)),
            Err(_) => {}
        }
    }
    Err(Error::Program {
        program: "python3".into(),
        problem: format!("Python 3.11 or newer is needed{}", found.trim_end()),
    })
}

fn run(program: &str, mut command: Command) -> Result<()> {
    let failed = |problem: String| Error::Program { program: program.to_owned(), problem };
    let output = command.output().map_err(|error| failed(format!("cannot start: {error}")))?;
    if output.status.success() {
        return Ok(());
    }
    let problem = format!(
        "{}; the Python environment was not set up and nothing of it was kept; check the network \
         and the package index, then run cornerbench setup",
        complaint(&output)
    );
    Err(failed(problem))
}

/// The lines in which a failed program says what it could not do, the last few at most.
fn complaint(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr);
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    let from = lines.len().saturating_sub(4);
    if lines.is_empty() {
        format!("ended with {}", output.status)
    } else {
        lines[from..].join(" | ")
    }
}
