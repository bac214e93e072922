//! What pipelines take: after all is measured, on one thread, in turns.

use std::ops::AddAssign;
use std::path::Path;
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::answers::{Begun, Faces, GraspAnswer, begin, grasp};
use super::scene::{Station, points, range_image, seeds_in_disc};
use super::{Run, Source};
use crate::detect::Detection;
use crate::error::{Error, Result};
use crate::external::{Failure, Program, Reply};
use crate::files::write_json;
use crate::plan::{Pipeline, Seeds, Shots};
use crate::record::{MethodTime, ProgramTime, Spread, TIMING_FILE, Timing};
use crate::scene::Dataset;
use crate::sensor::{Exposure, PhotographBuffers, Photographer, RangeImage, Rig};
use crate::stats::quantile;

/// No more scenes are photographed.
const MOST_SCENES: usize = 8;
/// Rounds that are timed: so many, or at least the fewest where these take long.
const ROUNDS: usize = 5;
const FEWEST_ROUNDS: usize = 2;
const LONG: Duration = Duration::from_secs(10);

/// A photograph that pipelines are timed on.
struct Photograph {
    exposure: Exposure,
    rig: Rig,
    range: RangeImage,
    /// The seeds that each pipeline is given; none of one that detects.
    given: Vec<Vec<Detection>>,
}

/// What a pipeline took on one photograph, or on several \[us\].
#[derive(Clone, Copy, Debug, Default)]
struct Took {
    /// Find, refine, grasp: another program's by its own clock, where it says.
    stages: [f64; 3],
    /// What asking such a program took beside that.
    protocol: [f64; 3],
}

impl AddAssign for Took {
    fn add_assign(&mut self, more: Self) {
        self.stages.iter_mut().zip(more.stages).for_each(|(sum, more)| *sum += more);
        self.protocol.iter_mut().zip(more.protocol).for_each(|(sum, more)| *sum += more);
    }
}

impl Run<'_> {
    /// Times every pipeline on photographs of some of the scenes, evenly chosen, and writes `output`/timing.json. All
    /// pipelines take turns on each photograph, none is always first; the first round, which warms caches up and
    /// derives the planes that algorithms share (luma, red difference), does not count. A scene that cannot be read or photographed is left out. Of drawn junctions and of pictures of one's own there is
    /// no such file.
    ///
    /// # Errors
    /// When the file cannot be written, or one thread cannot be had.
    pub fn time(&self, output: &Path) -> Result<()> {
        // Drawn junctions are so small that fixed costs would be most of a time.
        let Source::Dataset(dataset) = self.source else { return Ok(()) };
        let own: Vec<&str> = self.own().iter().map(|unit| unit.name.as_str()).collect();
        let count = own.len().min(MOST_SCENES);
        let scenes: Vec<&str> = (0..count).map(|index| own[index * own.len() / count]).collect();
        let cameras: Vec<Vec<Photograph>> = self
            .plan
            .cameras
            .iter()
            .map(|camera| {
                scenes.par_iter().filter_map(|scene| self.take(dataset, scene, camera)).collect()
            })
            .collect();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let pool = pool.map_err(|error| Error::Other(format!("times: no thread: {error}")))?;
        let (rounds, methods) = pool.install(|| self.rounds(&cameras));
        let timing = Timing {
            cornerbench_version: env!("CARGO_PKG_VERSION").to_owned(),
            machine: machine(),
            threads: 1,
            clock_resolution_us: clock_resolution_us(),
            rounds,
            scenes: scenes.iter().map(|&scene| scene.to_owned()).collect(),
            methods,
            programs: self.plan.programs().into_iter().map(|program| ran(program)).collect(),
        };
        for program in self.plan.programs() {
            // How it ends was seen when all was measured.
            let _ = program.end();
        }
        write_json(&output.join(TIMING_FILE), &timing)
    }

    /// A scene's first photograph by a camera, as it is measured; `None` where there is none.
    fn take(&self, dataset: &Dataset, scene: &str, camera: &Photographer) -> Option<Photograph> {
        let (plan, suite) = (self.plan, dataset.suite());
        let scene = dataset.read(scene).ok()?;
        let bent = camera.through_lens(&scene.film, &scene.description.camera).ok()?;
        let film = bent.as_ref().unwrap_or(&scene.film);
        let kernel = camera.kernel(film.oversampling, Shots::phase_px(0));
        let station = Station { plan, suite, scene: &scene, camera, kernel: &kernel, phase: 0 };
        station.show(film, 0, &mut PhotographBuffers::default(), |shown| {
            let given = |pipeline: &Pipeline| match pipeline.seeds {
                Seeds::Disc { radius_px } => {
                    seeds_in_disc(points(shown.asked), radius_px, &shown.name)
                }
                Seeds::Detected { .. } | Seeds::Elsewhere(_) => Vec::new(),
            };
            Some(Photograph {
                exposure: shown.exposure.clone(),
                rig: *shown.rig,
                range: range_image(&plan.range_sensor_model, &scene, &shown.name).ok()?,
                given: plan.pipelines.iter().map(given).collect(),
            })
        })
    }

    /// How many rounds there were, and what each camera's photographs took each pipeline.
    #[allow(clippy::cast_precision_loss, reason = "counts far below 2^52")]
    fn rounds(&self, cameras: &[Vec<Photograph>]) -> (usize, Vec<MethodTime>) {
        let pipelines = &self.plan.pipelines;
        // Of each camera and pipeline: corners of one round, and the stages of each.
        let mut corners = vec![vec![0; pipelines.len()]; cameras.len()];
        let mut times: Vec<Vec<Vec<Took>>> = vec![vec![Vec::new(); pipelines.len()]; cameras.len()];
        // No time is that of an answer that was none.
        let is_elsewhere = |one: &Pipeline| matches!(one.seeds, Seeds::Elsewhere(_));
        let untimed: Vec<bool> = pipelines.iter().map(is_elsewhere).collect();
        let mut has_failed = vec![untimed; cameras.len()];
        let mut round = |turn: usize| {
            let of_each = cameras.iter().zip(&mut corners).zip(&mut times).zip(&mut has_failed);
            for (((photographs, corners), times), has_failed) in of_each {
                corners.fill(0);
                times.iter_mut().for_each(|rounds| rounds.push(Took::default()));
                for (place, photograph) in photographs.iter().enumerate() {
                    for index in 0..pipelines.len() {
                        let index = (index + turn + place) % pipelines.len();
                        if has_failed[index] {
                            continue;
                        }
                        let Ok((took, count)) = photograph.time(&pipelines[index], index) else {
                            has_failed[index] = true;
                            continue;
                        };
                        corners[index] += count;
                        times[index]
                            .iter_mut()
                            .next_back()
                            .into_iter()
                            .for_each(|sum| *sum += took);
                    }
                }
            }
        };
        round(0);
        let begun = Instant::now();
        let mut rounds = 0;
        while rounds < FEWEST_ROUNDS || (rounds < ROUNDS && begun.elapsed() < LONG) {
            rounds += 1;
            round(rounds);
        }
        let mut methods = Vec::new();
        for ((((camera, photographs), corners), times), has_failed) in
            self.plan.cameras.iter().zip(cameras).zip(&corners).zip(&times).zip(&has_failed)
        {
            if photographs.is_empty() {
                continue;
            }
            let count = photographs.len() as f64;
            let of_each = pipelines.iter().zip(corners).zip(times).zip(has_failed);
            for ((pipeline, corners), times) in
                of_each.filter(|(_, has_failed)| !**has_failed).map(|(one, _)| one)
            {
                let spread = |of: &dyn Fn(&Took) -> f64| {
                    spread(&times[1..].iter().map(|took| of(took) / count).collect::<Vec<_>>())
                };
                methods.push(MethodTime {
                    camera: camera.name().to_owned(),
                    method: pipeline.name.clone(),
                    photographs: photographs.len(),
                    corners: *corners as f64 / count,
                    detect_us: spread(&|took| took.stages[0]),
                    refine_us: spread(&|took| took.stages[1]),
                    grasp_us: spread(&|took| took.stages[2]),
                    whole_us: spread(&|took| took.stages.iter().sum()),
                    protocol_us: pipeline
                        .programs()
                        .next()
                        .map(|_| [0, 1, 2].map(|stage| spread(&|took| took.protocol[stage]))),
                });
            }
        }
        (rounds, methods)
    }
}

impl Photograph {
    /// What a pipeline takes, and how many corners it refines.
    fn time(
        &self,
        pipeline: &Pipeline,
        index: usize,
    ) -> std::result::Result<(Took, usize), Failure> {
        let Self { exposure, rig, range, given } = self;
        let begun = Instant::now();
        let Begun { region, seeds } = begin(pipeline, exposure, &given[index]);
        let seeds = seeds?;
        let detected = Instant::now();
        let corners = pipeline.refine.refine(exposure, &seeds.answer)?;
        let refined = Instant::now();
        // Of corners that are known to be which, choosing a face takes no time, and what follows is timed elsewhere.
        let faces = Faces { exposure, region: region.as_ref(), true_face: None };
        let grasp = grasp(pipeline, &faces, &corners.answer, rig, range);
        let ended = Instant::now();
        let count = corners.answer.len();
        let protocol = [seeds.protocol_us, corners.protocol_us, grasp.map_or(Ok(0.0), of_grasp)?];
        let passed = [detected - begun, refined - detected, ended - refined];
        let own = |stage: usize| 1e6 * passed[stage].as_secs_f64() - protocol[stage];
        Ok((Took { stages: [0, 1, 2].map(own), protocol }, count))
    }
}

fn of_grasp(reply: Reply<GraspAnswer>) -> std::result::Result<f64, Failure> {
    match reply.answer {
        GraspAnswer::Failed(_, failure) => Err(failure),
        _ => Ok(reply.protocol_us),
    }
}

/// How a program ran that was timed.
fn ran(program: &Program) -> ProgramTime {
    let status = program.process_id().and_then(|id| {
        // Elsewhere than on Linux nobody tells.
        std::fs::read_to_string(format!("/proc/{id}/status")).ok()
    });
    let value = |key: &str| {
        let mut lines = status.as_deref()?.lines();
        lines.find_map(|line| line.strip_prefix(key)).map(|value| value.trim().to_owned())
    };
    ProgramTime {
        name: program.name().to_owned(),
        version: program.version(),
        threads: value("Threads:").and_then(|count| count.parse().ok()),
        processors: value("Cpus_allowed_list:"),
    }
}

fn spread(values: &[f64]) -> Spread {
    let [lower_quartile, median, upper_quartile] =
        [0.25, 0.5, 0.75].map(|share| quantile(values, share).unwrap_or(0.0));
    Spread { median, lower_quartile, upper_quartile }
}

/// The least time between two looks at the clock that differ \[us\].
fn clock_resolution_us() -> f64 {
    let step = |_| {
        let begun = Instant::now();
        std::iter::repeat_with(|| begun.elapsed()).take(1000).find(|time| !time.is_zero())
    };
    (0..100).filter_map(step).min().map_or(0.0, |time| 1e6 * time.as_secs_f64())
}

/// The processor's model where the system tells it.
fn machine() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = text.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    model.map_or_else(
        || format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        |(_, model)| model.trim().to_owned(),
    )
}
