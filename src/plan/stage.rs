//! One algorithm of a pipeline: an own one, or another program, asked alike.

use std::sync::Arc;

use toml::{Table, Value};

use crate::detect::{Detection, Detector};
use crate::error::{Error, Result};
use crate::external::{Asked, Program, Reply, Task};
use crate::grasp::{Face, Grasp, GraspEstimator, NoGrasp};
use crate::refine::{Corner, Refiner};
use crate::registry::{self, Entry};
use crate::sensor::{Exposure, RangeImage, Rig};
use crate::target::TargetRegion;

/// An algorithm with its parameters set.
pub struct Stage<A> {
    /// What plans call it.
    pub name: String,
    /// Its entry's version, or what the program says.
    pub version: String,
    /// Its parameters, defaults included.
    pub parameters: Table,
    /// The algorithm.
    pub algorithm: A,
}

/// A stage whose algorithm is an own one.
pub type OwnStage<T> = Stage<Box<T>>;

/// A stage whose algorithm may be another program.
pub type AnyStage<T> = Stage<Algorithm<T>>;

/// Who does the work.
pub enum Algorithm<T: ?Sized> {
    /// This program.
    Own(Box<T>),
    /// Another one.
    Program(Arc<Program>),
}

impl<A> Stage<A> {
    /// Name and version, as records have them: "harris 1".
    pub fn label(&self) -> String {
        format!("{} {}", self.name, self.version)
    }

    pub(super) fn description(&self) -> serde_json::Value {
        serde_json::json!({
            "algorithm": self.name,
            "version": self.version,
            "parameters": self.parameters,
        })
    }
}

impl<T: ?Sized> OwnStage<T> {
    /// The algorithm that a stage's table names in its key `algorithm`; the rest of the table are its parameters.
    ///
    /// # Errors
    /// For an unknown name or key, or a value out of range.
    pub(super) fn build(
        place: &str,
        kind: &str,
        entries: &[Entry<T>],
        mut table: Table,
    ) -> Result<Self> {
        let name = algorithm_of(place, &mut table)?;
        Self::of_entry(registry::find(entries, kind, &name, place)?, place, table)
    }

    /// An algorithm with some of its parameters.
    ///
    /// # Errors
    /// For an unknown key, or a value out of range.
    fn of_entry(entry: &Entry<T>, place: &str, table: Table) -> Result<Self> {
        let algorithm = (entry.build)(place, &table)?;
        let mut parameters = (entry.defaults)();
        parameters.extend(table);
        let (name, version) = (entry.name.to_owned(), entry.version.to_string());
        Ok(Self { name, version, parameters, algorithm })
    }
}

impl<T: ?Sized> AnyStage<T> {
    /// The algorithm that a stage's table names in its key `algorithm`, among the own ones and the programs that do the
    /// task; the rest of the table are its parameters.
    ///
    /// # Errors
    /// For an unknown name or key, or a value out of range.
    pub(super) fn build(
        place: &str,
        entries: &[Entry<T>],
        programs: &[Arc<Program>],
        task: Task,
        mut table: Table,
    ) -> Result<Self> {
        let name = algorithm_of(place, &mut table)?;
        Self::choose(place, entries, programs, task, &name, table)
    }

    /// The algorithm of a name with some of its parameters.
    ///
    /// # Errors
    /// For an unknown name or key, or a value out of range.
    pub fn choose(
        place: &str,
        entries: &[Entry<T>],
        programs: &[Arc<Program>],
        task: Task,
        name: &str,
        table: Table,
    ) -> Result<Self> {
        let able = programs.iter().filter(|program| program.does().contains(&task));
        if let Some(program) = able.clone().find(|program| program.name() == name) {
            if let Some(key) = table.keys().next() {
                return Err(Error::Other(format!(
                    "{place}: {name} is another program, and {key} no parameter of it here; its own file has them: {}",
                    program.block().file.display()
                )));
            }
            return Ok(Self::of_program(program));
        }
        let Some(entry) = entries.iter().find(|entry| entry.name == name) else {
            let own = entries.iter().map(|entry| entry.name.to_owned());
            return Err(Error::UnknownName {
                place: place.to_owned(),
                kind: task.doer().to_owned(),
                found: name.to_owned(),
                known: own.chain(able.map(|program| program.name().to_owned())).collect(),
            });
        };
        Ok(OwnStage::of_entry(entry, place, table)?.into())
    }

    /// Another program.
    fn of_program(program: &Arc<Program>) -> Self {
        Self {
            name: program.name().to_owned(),
            version: program.version(),
            parameters: program.block().parameters.clone(),
            algorithm: Algorithm::Program(Arc::clone(program)),
        }
    }

    /// The program, where it is another one.
    pub fn program(&self) -> Option<&Arc<Program>> {
        match &self.algorithm {
            Algorithm::Own(_) => None,
            Algorithm::Program(program) => Some(program),
        }
    }
}

impl<T: ?Sized> From<OwnStage<T>> for AnyStage<T> {
    fn from(OwnStage { name, version, parameters, algorithm }: OwnStage<T>) -> Self {
        Self { name, version, parameters, algorithm: Algorithm::Own(algorithm) }
    }
}

fn algorithm_of(place: &str, table: &mut Table) -> Result<String> {
    match table.remove("algorithm") {
        Some(Value::String(name)) => Ok(name),
        Some(other) => Err(Error::out_of_range(place, "algorithm", other, "a name in quotes")),
        None => Err(Error::Other(format!("{place}: algorithm is missing"))),
    }
}

impl AnyStage<dyn Detector> {
    /// The candidates of an exposure, strongest first.
    ///
    /// # Errors
    /// What went wrong with another program.
    pub fn detect(
        &self,
        exposure: &Exposure,
        region: Option<&TargetRegion>,
    ) -> Asked<Vec<Detection>> {
        match &self.algorithm {
            Algorithm::Own(own) => Ok(Reply::own(own.detect(exposure, region))),
            Algorithm::Program(program) => program.detect(exposure, region),
        }
    }
}

impl AnyStage<dyn Refiner> {
    /// A corner for each seed, in their order.
    ///
    /// # Errors
    /// What went wrong with another program.
    pub fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Asked<Vec<Corner>> {
        match &self.algorithm {
            Algorithm::Own(own) => Ok(Reply::own(own.refine(exposure, seeds))),
            Algorithm::Program(program) => program.refine(exposure, seeds),
        }
    }
}

impl AnyStage<dyn GraspEstimator> {
    /// A grasp, or why there is none.
    ///
    /// # Errors
    /// What went wrong with another program.
    pub fn estimate(
        &self,
        face: &Face,
        rig: &Rig,
        range: &RangeImage,
    ) -> Asked<std::result::Result<Grasp, NoGrasp>> {
        match &self.algorithm {
            Algorithm::Own(own) => Ok(Reply::own(own.estimate(face, rig, range))),
            Algorithm::Program(program) => program.grasp(face, rig, range),
        }
    }
}
