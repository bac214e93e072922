//! Executes a plan over a dataset, over drawn junctions, or over pictures of one's own: every scene photographed, every
//! pipeline run, every answer scored.
//!
//! Each scene's rows, those of a cell of drawn junctions, or those of a picture become a file of their own as soon as they
//! are there, and one file of them all in the end: a run that was killed goes on where it was, and memory does not grow
//! with the suite.

mod answers;
mod drawn;
mod failures;
mod given;
mod identity;
mod known;
mod merge;
mod own;
mod parts;
mod photographs;
mod pictures;
mod scene;
mod score;
mod timing;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::files::{write_json, write_whole};
use crate::plan::{Cell, Pipeline, Plan, Seeds, Shots};
use crate::record::{FailureCount, Record, join_records, kind, read_records, write_records};
use crate::scene::{Dataset, Split};
use crate::sensor::Photographer;

use drawn::Booth;
use parts::Parts;

pub use known::{KNOWN_GATE_PX, Known, known_answers};
pub use merge::merge;
pub use own::Album;
pub use photographs::{Photographs, Wanted, photograph};

/// Which scenes of a dataset, or which pictures, are measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// Those of one split.
    pub split: Option<Split>,
    /// Of these every N-th.
    pub shard: Option<Shard>,
}

/// Every `count`-th scene from number `first` on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 0 to `count` - 1.
    pub first: usize,
    /// At least 1.
    pub count: usize,
}

impl std::str::FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(first, count)| {
            Some(Self { first: first.parse().ok()?, count: count.parse().ok()? })
        });
        numbers
            .filter(|shard| shard.first < shard.count)
            .ok_or_else(|| format!("{text:?} is no shard, must be I/N with I from 0 to N - 1"))
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{}/{}", self.first, self.count)
    }
}

/// What a run did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// Scenes that were measured, by all cameras.
    pub scenes: usize,
    /// Scenes of which something could not be read or photographed.
    pub unreadable: usize,
    /// Scenes that an earlier run, which did not end, had measured already.
    pub resumed: usize,
    /// Exposures to which a pipeline's program gave no answer, of all pipelines.
    pub failed: usize,
}

/// What became of a scene.
struct Done {
    /// Whether an earlier run had measured it.
    was_there: bool,
    /// Whether something of it could not be read or photographed.
    is_unreadable: bool,
    failures: Vec<FailureCount>,
}

/// What records call the suite of drawn junctions.
const DRAWN: &str = "drawn";

/// A run that is to be: all that decides what is measured.
pub struct Run<'a> {
    plan: &'a Plan,
    source: Source<'a>,
    /// All of them.
    units: Vec<Unit<'a>>,
    shard: Option<Shard>,
}

/// Where images come from.
#[derive(Clone, Copy)]
enum Source<'a> {
    Dataset(&'a Dataset),
    Album(&'a Album<'a>),
    Drawn,
}

/// What is measured as a whole, and has a group of rows of its own.
struct Unit<'a> {
    name: String,
    images: Images<'a>,
}

enum Images<'a> {
    /// A scene of the dataset, by all cameras.
    Scene(&'a Dataset),
    /// A picture of one's own: which.
    Picture(&'a Album<'a>, usize),
    /// Drawn junctions, by one camera.
    Drawn(&'a Cell, &'a Photographer),
}

/// How much a run has to do.
#[derive(Clone, Debug, PartialEq)]
pub struct Extent {
    /// Scenes, pictures, or cells of drawn junctions, each by a camera.
    pub scenes: usize,
    /// Photographs, of all of them.
    pub exposures: usize,
    /// Pipelines, each on every photograph.
    pub methods: usize,
    /// How long the first scene took on one core, or the first cell on all; `None` where it cannot be read.
    pub one_scene: Option<Duration>,
    /// How long all would take that are as quick.
    pub expected: Option<Duration>,
}

impl<'a> Run<'a> {
    /// The run of a plan over the scenes of `choice`.
    ///
    /// # Errors
    /// When the dataset has none of these.
    pub fn new(plan: &'a Plan, dataset: &'a Dataset, choice: Choice) -> Result<Self> {
        let families = &plan.families;
        let is_any = choice.split.is_none() && families.is_empty();
        // A scene whose description cannot be read is no less unreadable for belonging to a split or a family.
        let is_wanted = |name: &&str| {
            is_any
                || dataset.describe(name).map_or(true, |scene| {
                    choice.split.is_none_or(|wanted| scene.split == wanted)
                        && (families.is_empty() || families.contains(&scene.family))
                })
        };
        let unit = |name: &str| Unit { name: name.to_owned(), images: Images::Scene(dataset) };
        let units: Vec<Unit> = dataset.scenes().filter(is_wanted).map(unit).collect();
        if units.is_empty() && !is_any {
            let split = choice.split.map(|split| format!("split {}", split.name()));
            let families =
                (!families.is_empty()).then(|| format!("families {}", families.join(", ")));
            return Err(Error::Other(format!(
                "plan {}: suite {} has no scene of {}; measure another dataset, or a plan without them",
                plan.name,
                dataset.suite(),
                split.into_iter().chain(families).collect::<Vec<_>>().join(" and of "),
            )));
        }
        let cameras: Vec<&str> = plan.cameras.iter().map(Photographer::name).collect();
        plan.check_answers(&dataset.scenes().collect::<Vec<_>>(), &cameras)?;
        Ok(Self { plan, source: Source::Dataset(dataset), units, shard: choice.shard })
    }

    /// The run of a plan over the junctions that it draws.
    pub fn of_drawn(plan: &'a Plan, shard: Option<Shard>) -> Self {
        let unit = |cell: &'a Cell, camera: &'a Photographer| Unit {
            name: format!("{}-{}", cell.name, camera.name()),
            images: Images::Drawn(cell, camera),
        };
        let of_cell = |cell| plan.cameras.iter().map(move |camera| unit(cell, camera));
        let units = plan.cells.iter().flat_map(of_cell).collect();
        Self { plan, source: Source::Drawn, units, shard }
    }

    /// The run of a plan over the pictures of `choice`. Pipelines end with corners; cameras, phases and repeats of the
    /// plan do not apply.
    ///
    /// # Errors
    /// When all pipelines are given seeds about known corners, and none is known.
    pub fn of_album(plan: &'a Plan, album: &'a Album<'a>, choice: Choice) -> Result<Self> {
        let is_given = |pipeline: &Pipeline| matches!(pipeline.seeds, Seeds::Disc { .. });
        if album.without_known_corners().count() == album.len()
            && plan.pipelines.iter().all(is_given)
        {
            return Err(Error::Other(format!(
                "plan {}: all of its pipelines are given seeds about known corners, and of these pictures no corner is \
                 known; give --known FILE, or take a plan with a detector: cornerbench list plans",
                plan.name
            )));
        }
        let names: Vec<&str> = album.names().map(|(name, _)| name).collect();
        plan.check_answers(&names, &[album.camera_name()])?;
        let units = album
            .names()
            .enumerate()
            .filter(|(_, (_, split))| choice.split.is_none_or(|wanted| *split == wanted))
            .map(|(index, (name, _))| Unit {
                name: name.to_owned(),
                images: Images::Picture(album, index),
            });
        let units = units.collect();
        Ok(Self { plan, source: Source::Album(album), units, shard: choice.shard })
    }

    fn own(&self) -> Vec<&Unit<'a>> {
        let Shard { first, count } = self.shard.unwrap_or(Shard { first: 0, count: 1 });
        self.units.iter().skip(first).step_by(count).collect()
    }

    /// How many scenes, pictures, or cells of drawn junctions, it measures itself.
    pub fn len(&self) -> usize {
        self.own().len()
    }

    /// Whether it measures none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How much there is to do; its first scene or cell is measured for that.
    pub fn extent(&self) -> Extent {
        let own = self.own();
        let one_scene = own.first().and_then(|unit| {
            let start = Instant::now();
            // Only the time counts.
            match unit.images {
                Images::Scene(dataset) => {
                    let scene = dataset.read(&unit.name).ok()?;
                    let _ = scene::measure(self.plan, dataset.suite(), &scene, None);
                }
                Images::Picture(album, index) => drop(album.rows(self.plan, index, None)),
                Images::Drawn(cell, camera) => drop(Booth::new(self.plan, cell, camera).rows()),
            }
            Some(start.elapsed())
        });
        let shots = self.plan.shots;
        let of_scene = self.plan.cameras.len() * (shots.phases * shots.repeats) as usize;
        let exposures = own.iter().map(|unit| match unit.images {
            Images::Scene(_) => of_scene,
            Images::Picture(..) => 1,
            Images::Drawn(cell, _) => cell.factors.count() as usize,
        });
        // With fewer scenes than threads some have nothing to do; a cell has work for all.
        let threads = if self.is_drawn() { 1 } else { rayon::current_num_threads() };
        let turns = u32::try_from(own.len().div_ceil(threads)).unwrap_or(u32::MAX);
        Extent {
            scenes: own.len(),
            exposures: exposures.sum(),
            methods: self.plan.pipelines.len(),
            one_scene,
            expected: one_scene.and_then(|one| one.checked_mul(turns)),
        }
    }

    /// Measures every scene by every pipeline and writes the run's folder: run.json, records.parquet and scenes/.
    /// Scenes, and the junctions of a cell, are done in parallel; the rows' order is the dataset's and the plan's,
    /// whatever the number of threads.
    /// What an earlier run of the same program left unfinished there is taken over. `on_scene` is called as each is
    /// done.
    ///
    /// # Errors
    /// When the folder cannot be written. A scene that cannot be read is a row, not an error.
    pub fn measure(
        &self,
        output: &Path,
        command: &str,
        on_scene: &(dyn Fn(&str) + Sync),
    ) -> Result<Outcome> {
        let own = self.own();
        let identity = self.identity();
        let parts = Parts::open(output, &identity, self.shard)?;
        for program in self.plan.programs() {
            program.log_to(&output.join(parts::LOGS));
        }
        let one = |unit: &&Unit| {
            let done = self.measure_one(unit, &parts.path(&unit.name), output)?;
            on_scene(&unit.name);
            Ok(done)
        };
        // A cell's junctions are many, and its rows: one cell after the other.
        let done: Result<Vec<Done>> = if self.is_drawn() {
            own.iter().map(one).collect()
        } else {
            own.par_iter().map(one).collect()
        };
        let done = done?;
        let mut paths: Vec<PathBuf> = own.iter().map(|unit| parts.path(&unit.name)).collect();
        let at_end = failures::end_programs(self.plan, self.suite());
        let of_scenes = done.iter().flat_map(|done| done.failures.clone());
        let failures = failures::sum(of_scenes.chain(failures::count(&at_end)));
        if !at_end.is_empty() {
            let path = parts.end_path();
            write_whole(&path, |path| write_records(path, &at_end))?;
            paths.push(path);
        }
        write_whole(&output.join("records.parquet"), |path| {
            join_records(path, paths.iter().map(|path| (path.as_path(), 0)))
        })?;
        let is_unreadable =
            |(unit, done): (&&Unit, &Done)| done.is_unreadable.then(|| unit.name.clone());
        let unreadable: Vec<String> = own.iter().zip(&done).filter_map(is_unreadable).collect();
        let outcome = Outcome {
            scenes: own.len() - unreadable.len(),
            unreadable: unreadable.len(),
            resumed: done.iter().filter(|done| done.was_there).count(),
            failed: failures::total(&failures),
        };
        let description = self.description(&identity, command, unreadable, failures);
        write_json(&output.join("run.json"), &description)?;
        parts.close()?;
        Ok(outcome)
    }

    fn is_drawn(&self) -> bool {
        matches!(self.source, Source::Drawn)
    }

    /// What takes the photographs, or took the pictures.
    fn cameras(&self) -> Vec<&'a Photographer> {
        match self.source {
            Source::Album(album) => album.camera().into_iter().collect(),
            _ => self.plan.cameras.iter().collect(),
        }
    }

    /// What records call the cameras.
    pub fn camera_names(&self) -> Vec<&str> {
        match self.source {
            Source::Album(album) => vec![album.camera_name()],
            _ => self.plan.cameras.iter().map(Photographer::name).collect(),
        }
    }

    /// What it measures one by one: "scene", "picture" or "cell".
    pub fn unit(&self) -> &'static str {
        match self.source {
            Source::Dataset(_) => "scene",
            Source::Album(_) => "picture",
            Source::Drawn => "cell",
        }
    }

    /// How often a scene is photographed.
    fn shots(&self) -> Shots {
        match self.source {
            Source::Album(_) => Shots { phases: 1, repeats: 1 },
            _ => self.plan.shots,
        }
    }

    /// Measures a scene, a picture or a cell, unless its part is there.
    fn measure_one(&self, unit: &Unit, part: &Path, output: &Path) -> Result<Done> {
        let done = |was_there: bool, records: &[Record]| Done {
            was_there,
            is_unreadable: records.iter().any(|record| record.kind == kind::SCENE),
            failures: failures::count(records),
        };
        if part.is_file() {
            return Ok(done(true, &read_records(part)?));
        }
        let records = match unit.images {
            Images::Scene(dataset) => {
                let (name, suite) = (&unit.name, dataset.suite());
                let pictures = output.join("scenes").join(name);
                match dataset.read(name) {
                    Ok(scene) => scene::measure(self.plan, suite, &scene, Some(&pictures))?,
                    Err(error) => scene::unreadable_by_all(self.plan, suite, name, &error),
                }
            }
            Images::Picture(album, index) => {
                album.rows(self.plan, index, Some(&output.join("scenes").join(&unit.name)))?
            }
            Images::Drawn(cell, camera) => Booth::new(self.plan, cell, camera).rows(),
        };
        write_whole(part, |path| write_records(path, &records))?;
        Ok(done(false, &records))
    }
}
