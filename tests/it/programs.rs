//! Algorithms that are other programs, through the binary.

mod answers;
mod faults;
mod joining;
mod runners;
mod verify;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use cornerbench::record::{Record, read_records};
use serde_json::Value;

use crate::dataset::json;
use crate::support::{copy_folder, cornerbench, project, recipes};

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
