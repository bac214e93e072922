//! Times: what pipelines took, beside the records and apart from them. Records are the same each time, times are not.

use std::io::ErrorKind;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::run::read_json;
use crate::error::{Error, Result};

/// The file in a run's folder.
pub const TIMING_FILE: &str = "timing.json";

/// What each pipeline took; RUN/timing.json.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Version of cornerbench.
    pub cornerbench_version: String,
    /// The processor's model, or operating system and architecture where it is not known.
    pub machine: String,
    /// Threads.
    pub threads: usize,
    /// The least time that the clock told apart from none \[us\].
    pub clock_resolution_us: f64,
    /// How often each pipeline was timed on each photograph.
    pub rounds: usize,
    /// The scenes photographed, once by each camera.
    pub scenes: Vec<String>,
    /// Each camera and method.
    pub methods: Vec<MethodTime>,
    /// The other programs that were timed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub programs: Vec<ProgramTime>,
}

/// How another program ran while it was timed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProgramTime {
    /// What plans call it.
    pub name: String,
    /// Its version and those of its libraries.
    pub version: String,
    /// Its threads, waiting ones too; `None` where the system does not tell.
    pub threads: Option<usize>,
    /// The processors that it may use, as the system names them: "0-3".
    pub processors: Option<String>,
}

/// What one pipeline took on the photographs of one camera; medians and quartiles are over rounds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MethodTime {
    /// The camera.
    pub camera: String,
    /// The method.
    pub method: String,
    /// Photographs.
    pub photographs: usize,
    /// Corners that were refined, per photograph.
    pub corners: f64,
    /// Target and detector, per photograph; nothing where seeds are given.
    pub detect_us: Spread,
    /// Refiner, per photograph.
    pub refine_us: Spread,
    /// Face and grasp point, per photograph.
    pub grasp_us: Spread,
    /// All of it, per photograph.
    pub whole_us: Spread,
    /// Of a pipeline with another program, which is timed by its own clock: what asking it to detect, to refine and to
    /// grasp took beside that, per photograph. No part of the others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub protocol_us: Option<[Spread; 3]>,
}

/// The middle of some values, in their unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Half of them are below.
    pub median: f64,
    /// A quarter of them is below.
    pub lower_quartile: f64,
    /// A quarter of them is above.
    pub upper_quartile: f64,
}

impl Timing {
    /// What a method took, if it was timed.
    pub fn of(&self, camera: &str, method: &str) -> Option<&MethodTime> {
        self.methods.iter().find(|one| one.camera == camera && one.method == method)
    }
}

impl MethodTime {
    /// The refiner's time per corner \[us\]; `None` where none was refined.
    pub fn refine_us_per_corner(&self) -> Option<f64> {
        (self.corners > 0.0).then(|| self.refine_us.median / self.corners)
    }
}

/// Reads RUN/timing.json; `None` where there is none.
///
/// # Errors
/// When it cannot be read or is not one.
pub fn read_timing(run: &Path) -> Result<Option<Timing>> {
    match read_json(&run.join(TIMING_FILE)) {
        Err(Error::Io { source, .. }) if source.kind() == ErrorKind::NotFound => Ok(None),
        read => read.map(Some),
    }
}
