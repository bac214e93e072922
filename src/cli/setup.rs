//! `cornerbench setup`: the Python environment alone.

use super::environment::{Purpose, python};
use super::{Ended, Global, print_line, project};
use crate::error::Result;

#[derive(clap::Args)]
#[group(multiple = false)]
pub(super) struct Options {
    /// Set up what the Python tests and linters need, too.
    #[arg(long)]
    dev: bool,
    /// Set up another environment, with Ray: for `render --ray`, and for the cluster's machines.
    #[arg(long)]
    ray: bool,
    /// Set up another environment, with OpenCV and scikit-image: for their algorithms (`cornerbench list programs`), and
    /// for what `cargo bench` times our detectors beside.
    #[arg(long)]
    peers: bool,
    /// Set up what --peers does, and kornia: on Linux its PyTorch takes 5 GB.
    #[arg(long)]
    kornia: bool,
    /// Set up another environment, with onnxruntime: for learned detectors (`cornerbench list programs`).
    #[arg(long)]
    onnx: bool,
    /// Set up another environment, with MuJoCo: for `cornerbench grasp`, which else does so itself.
    #[arg(long)]
    mujoco: bool,
}

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let purpose = match options {
        Options { dev: true, .. } => Purpose::Development,
        Options { ray: true, .. } => Purpose::Ray,
        Options { peers: true, .. } => Purpose::Peers,
        Options { kornia: true, .. } => Purpose::Kornia,
        Options { onnx: true, .. } => Purpose::Onnx,
        Options { mujoco: true, .. } => Purpose::Mujoco,
        _ => Purpose::Rendering,
    };
    let program = python(&project::root()?, purpose, &|line| global.say(line))?;
    if global.json {
        print_line(serde_json::json!({ "python": program }))?;
    } else {
        print_line(program.display())?;
    }
    Ok(Ended::Well)
}
