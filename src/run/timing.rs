//! What pipelines take: after all is measured, on one thread, in turns.

use std::path::Path;
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::answers::{grasp, seeds};
use super::scene::{Station, points, range_image, seeds_in_disc};
use super::{Run, Source};
use crate::detect::Detection;
use crate::error::{Error, Result};
use crate::files::write_json;
use crate::plan::{Pipeline, Seeds, Shots};
use crate::record::{MethodTime, Spread, TIMING_FILE, Timing};
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

/// What a pipeline took on one photograph, or on several: find, refine, grasp \[us\].
type Stages = [f64; 3];

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
        };
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
                Seeds::Detected { .. } => Vec::new(),
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
        let mut times: Vec<Vec<Vec<Stages>>> =
            vec![vec![Vec::new(); pipelines.len()]; cameras.len()];
        let mut round = |turn: usize| {
            for ((photographs, corners), times) in cameras.iter().zip(&mut corners).zip(&mut times)
            {
                corners.fill(0);
                times.iter_mut().for_each(|rounds| rounds.push(Stages::default()));
                for (place, photograph) in photographs.iter().enumerate() {
                    for index in 0..pipelines.len() {
                        let index = (index + turn + place) % pipelines.len();
                        let (took, count) = photograph.time(&pipelines[index], index);
                        corners[index] += count;
                        let sums = times[index].iter_mut().next_back().into_iter().flatten();
                        sums.zip(took).for_each(|(sum, took_us)| *sum += took_us);
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
        for (((camera, photographs), corners), times) in
            self.plan.cameras.iter().zip(cameras).zip(&corners).zip(&times)
        {
            if photographs.is_empty() {
                continue;
            }
            let count = photographs.len() as f64;
            for ((pipeline, corners), times) in pipelines.iter().zip(corners).zip(times) {
                let spread = |of: &dyn Fn(&Stages) -> f64| {
                    spread(&times[1..].iter().map(|stages| of(stages) / count).collect::<Vec<_>>())
                };
                methods.push(MethodTime {
                    camera: camera.name().to_owned(),
                    method: pipeline.name.clone(),
                    photographs: photographs.len(),
                    corners: *corners as f64 / count,
                    detect_us: spread(&|stages| stages[0]),
                    refine_us: spread(&|stages| stages[1]),
                    grasp_us: spread(&|stages| stages[2]),
                    whole_us: spread(&|stages| stages.iter().sum()),
                });
            }
        }
        (rounds, methods)
    }
}

impl Photograph {
    /// What a pipeline takes, and how many corners it refines.
    fn time(&self, pipeline: &Pipeline, index: usize) -> (Stages, usize) {
        let Self { exposure, rig, range, given } = self;
        let begun = Instant::now();
        let (region, found) = seeds(pipeline, exposure, &given[index]);
        let detected = Instant::now();
        let corners = pipeline.refine.algorithm.refine(exposure, &found);
        let refined = Instant::now();
        // Only the time counts.
        let _ = grasp(pipeline, exposure, region.as_ref(), &corners, rig, range);
        let times = [detected - begun, refined - detected, refined.elapsed()];
        (times.map(|time| 1e6 * time.as_secs_f64()), corners.len())
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
