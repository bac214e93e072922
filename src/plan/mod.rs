//! What to measure: cameras and pipelines, each a chain of named algorithms with parameters.

mod alternatives;

use std::fs;
use std::path::Path;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use toml::Table;

use crate::detect::{DETECTORS, Detector};
use crate::error::{Error, Result};
use crate::grasp::{ESTIMATORS, FaceSelector, GraspEstimator, SELECTORS};
use crate::metrics::CornerRule;
use crate::refine::{REFINERS, Refiner};
use crate::registry::{self, Entry};
use crate::sensor::{CameraModel, Photographer, RangeSensor};
use crate::target::{EXTRACTORS, TargetExtractor};

/// What to measure, read and checked.
pub struct Plan {
    /// Its name: the file's.
    pub name: String,
    /// One line for `cornerbench list`.
    pub summary: String,
    /// The cameras, each with its name.
    pub cameras: Vec<Photographer>,
    /// How each of them photographs a scene.
    pub shots: Shots,
    /// Name of the range sensor.
    pub range_sensor: String,
    /// The range sensor.
    pub range_sensor_model: RangeSensor,
    /// What is asked for, and how near an answer must be.
    pub corner_rule: CornerRule,
    /// The pipelines, in the order of the file.
    pub pipelines: Vec<Pipeline>,
}

/// How often and where a camera photographs a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shots {
    /// Places of the pixels' grid on the image.
    pub phases: u32,
    /// Photographs at each, every one with noise of its own.
    pub repeats: u32,
}

impl Shots {
    /// Where in the film's image the centre of pixel (0, 0) is at a phase \[px\]: the first at (0, 0), the others
    /// evenly spread about it, however many (Roberts 2018, The Unreasonable Effectiveness of Quasirandom Sequences).
    pub fn phase_px(phase: u32) -> [f64; 2] {
        // The plastic number's powers: the least regular steps in two dimensions.
        const STEPS: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3];
        STEPS.map(|step| (0.5 + f64::from(phase) * step).fract() - 0.5)
    }
}

/// A chain of algorithms from an exposure to corners, and perhaps on to a grasp.
pub struct Pipeline {
    /// Its name; column `method` of the records.
    pub name: String,
    /// Where candidates come from.
    pub seeds: Seeds,
    /// Candidates to corners.
    pub refine: Stage<dyn Refiner>,
    /// Corners to a grasp; it ends with the corners where there is none.
    pub grasp: Option<GraspStages>,
}

/// Where candidates come from: which of the two tracks a pipeline is on.
pub enum Seeds {
    /// End to end: a detector finds them, or not, and others besides.
    Detected {
        /// Exposure to target region; the whole image is searched where there is none.
        target: Option<Stage<dyn TargetExtractor>>,
        /// Region to corner candidates.
        detect: Stage<dyn Detector>,
    },
    /// Refinement: about each corner that is asked for, anywhere in a disc; the refiner alone is judged.
    Disc {
        /// The disc's radius \[px\].
        radius_px: f64,
    },
}

impl Seeds {
    /// The target extractor, if there is one.
    pub fn target(&self) -> Option<&Stage<dyn TargetExtractor>> {
        match self {
            Self::Detected { target, .. } => target.as_ref(),
            Self::Disc { .. } => None,
        }
    }
}

/// A chain of algorithms from corners to a grasp.
pub struct GraspStages {
    /// Corners to the face to grasp.
    pub face: Stage<dyn FaceSelector>,
    /// Face to grasp point.
    pub point: Stage<dyn GraspEstimator>,
}

/// An algorithm with its parameters set.
pub struct Stage<T: ?Sized> {
    /// Its entry's name.
    pub name: &'static str,
    /// Its entry's version.
    pub version: u32,
    /// Its parameters, defaults included.
    pub parameters: Table,
    /// The algorithm.
    pub algorithm: Box<T>,
}

impl<T: ?Sized> Stage<T> {
    /// Name and version, as records have them: "harris 1".
    pub fn label(&self) -> String {
        format!("{} {}", self.name, self.version)
    }

    fn description(&self) -> serde_json::Value {
        serde_json::json!({
            "algorithm": self.name,
            "version": self.version,
            "parameters": self.parameters,
        })
    }
}

/// What to measure: a camera and pipelines.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(title = "Plan", extend("required" = ["pipelines"]))]
struct PlanFile {
    /// One line for `cornerbench list`.
    summary: String,
    /// Files of the folder `cameras`: one, or a list.
    camera: Names,
    /// Places of the pixels' grid on the image: the first as rendered, the others evenly spread.
    #[schemars(range(min = 1, max = 65536))]
    phases: u32,
    /// Photographs at each phase, every one with noise of its own.
    #[schemars(range(min = 1, max = 100_000))]
    repeats: u32,
    /// A file of the folder `range-sensors`.
    range_sensor: String,
    /// How far a detection may lie from the corner it is matched to \[px\].
    #[schemars(range(min = 0.01, max = 100.0))]
    gate_px: f64,
    /// How far two edges of a corner must be seen from it for it to be asked for \[px\].
    #[schemars(range(min = 0.0, max = 1000.0))]
    least_edge_px: f64,
    /// The largest bound on a corner's place with which it is asked for \[px\].
    #[schemars(range(min = 0.0, max = 1000.0))]
    most_bound_px: f64,
    /// Chains of algorithms, each measured by itself. Where one of them gives several values, each combination is
    /// a pipeline of its own.
    #[schemars(with = "Vec<PipelineFile>", length(min = 1))]
    pipelines: Vec<Table>,
}

/// A name, or several.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
enum Names {
    One(String),
    Several(Vec<String>),
}

impl Default for PlanFile {
    fn default() -> Self {
        Self {
            summary: String::new(),
            camera: Names::One("ideal".into()),
            phases: 1,
            repeats: 1,
            range_sensor: "ideal".into(),
            gate_px: 5.0,
            least_edge_px: 3.0,
            most_bound_px: 0.5,
            pipelines: Vec::new(),
        }
    }
}

/// A chain of algorithms from an exposure to corners, and perhaps on to a grasp.
#[derive(Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(title = "Pipeline")]
struct PipelineFile {
    /// Column `method` of the records, with what was chosen behind it; that alone where there is no name.
    #[schemars(regex(pattern = r"^[a-z0-9_-]+$"))]
    name: String,
    /// Instead of `detect`: about each corner that is asked for; the refiner alone is judged.
    #[schemars(schema_with = "seeds_schema")]
    seeds: Option<Table>,
    /// Exposure to target region; without it the whole image is searched.
    #[schemars(schema_with = "target_schema")]
    target: Option<Table>,
    /// Region to corner candidates.
    #[schemars(schema_with = "detect_schema")]
    detect: Option<Table>,
    /// Candidates to corners; without it they stay where they are.
    #[schemars(schema_with = "refine_schema")]
    refine: Option<Table>,
    /// Corners to the face to grasp; with `grasp`, or neither.
    #[schemars(schema_with = "face_schema")]
    face: Option<Table>,
    /// Face to grasp point.
    #[schemars(schema_with = "grasp_schema")]
    grasp: Option<Table>,
}

/// Where seeds are.
#[derive(Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
struct SeedsFile {
    /// Radius of the disc about the corner in which they are, evenly spread \[px\].
    #[schemars(range(min = 0.0, max = 100.0))]
    disc_px: f64,
}

fn seeds_schema(_: &mut SchemaGenerator) -> Schema {
    let mut schema = registry::schema::<SeedsFile>();
    if let Some(properties) = schema.get_mut("properties").and_then(|value| value.as_object_mut()) {
        properties.values_mut().for_each(allow_several);
    }
    schema
}

/// A schema that a value or a list of values keeps to.
fn allow_several(one: &mut serde_json::Value) {
    let several = serde_json::json!({ "type": "array", "items": one.clone(), "minItems": 1 });
    *one = serde_json::json!({ "anyOf": [one.clone(), several] });
}

fn target_schema(generator: &mut SchemaGenerator) -> Schema {
    stage_schema(generator, "Target", EXTRACTORS)
}

fn detect_schema(generator: &mut SchemaGenerator) -> Schema {
    stage_schema(generator, "Detect", DETECTORS)
}

fn refine_schema(generator: &mut SchemaGenerator) -> Schema {
    stage_schema(generator, "Refine", REFINERS)
}

fn face_schema(generator: &mut SchemaGenerator) -> Schema {
    stage_schema(generator, "Face", SELECTORS)
}

fn grasp_schema(generator: &mut SchemaGenerator) -> Schema {
    stage_schema(generator, "Grasp", ESTIMATORS)
}

/// The schema of a stage: a table with the name of one of its algorithms and that one's parameters, each a value
/// or several; or a name alone; or a list of these.
fn stage_schema<T: ?Sized>(
    generator: &mut SchemaGenerator,
    stage: &str,
    entries: &[Entry<T>],
) -> Schema {
    let names: Vec<&str> = entries.iter().map(|entry| entry.name).chain(["all"]).collect();
    let of_entry = |entry: &Entry<T>| {
        let parameters = (entry.schema)();
        let mut properties = json_schema!({
            "algorithm": { "const": entry.name, "description": entry.summary },
        });
        let own = parameters.get("properties").and_then(|keys| keys.as_object());
        let mut own = own.cloned().unwrap_or_default();
        own.values_mut().for_each(allow_several);
        properties.ensure_object().extend(own);
        json_schema!({
            "type": "object",
            "title": entry.name,
            "description": entry.summary,
            "properties": properties,
            "required": ["algorithm"],
        })
    };
    let of_several = json_schema!({
        "type": "object",
        "title": "several algorithms",
        "properties": {
            "algorithm": {
                "anyOf": [{ "const": "all" }, { "type": "array", "items": { "enum": names } }],
            },
        },
        "required": ["algorithm"],
    });
    let name = json_schema!({ "enum": names });
    let mut one: Vec<Schema> = entries.iter().map(of_entry).collect();
    one.extend([of_several, name]);
    // Said once, for one of them and for a list.
    let place = format!("#/$defs/{stage}");
    generator.definitions_mut().insert(stage.to_owned(), serde_json::json!({ "anyOf": one }));
    json_schema!({ "anyOf": [
        { "$ref": place },
        { "type": "array", "items": { "$ref": place }, "minItems": 1 },
    ] })
}

impl Plan {
    /// The JSON Schema of `plans/NAME.toml`.
    pub fn schema() -> Schema {
        registry::schema::<PlanFile>()
    }

    /// Reads `plans/NAME.toml` in the folder of recipes, and the cameras that it names.
    ///
    /// # Errors
    /// For an unknown name or key, or a value out of range: with file, key, found, allowed.
    pub fn read(recipes: &Path, name: &str) -> Result<Self> {
        let (place, table) = read_table(recipes, "plans", name)?;
        let file: PlanFile = registry::parameters(&place, &table)?;
        let cameras = match file.camera {
            Names::One(name) => vec![name],
            Names::Several(names) => names,
        };
        let cameras =
            cameras.iter().map(|name| read_camera(recipes, name)).collect::<Result<Vec<_>>>()?;
        if cameras.is_empty() {
            return Err(Error::Other(format!("{place}: camera is an empty list; name one")));
        }
        let range_sensor_model = read_range_sensor(recipes, &file.range_sensor)?;
        let mut pipelines = Vec::new();
        for (index, table) in file.pipelines.iter().enumerate() {
            let place = format!("{place}: pipelines.{index}");
            for table in alternatives::pipelines(&place, table)? {
                pipelines.push(Pipeline::build(&place, &table)?);
            }
        }
        if pipelines.is_empty() {
            return Err(Error::Other(format!("{place}: no pipelines; add a [[pipelines]] table")));
        }
        refuse_twice(&place, "pipelines", pipelines.iter().map(|one| one.name.as_str()))?;
        refuse_twice(&place, "cameras", cameras.iter().map(Photographer::name))?;
        Ok(Self {
            name: name.to_owned(),
            summary: file.summary,
            cameras,
            shots: Shots { phases: file.phases, repeats: file.repeats },
            range_sensor: file.range_sensor,
            range_sensor_model,
            corner_rule: CornerRule {
                gate_px: file.gate_px,
                least_edge_px: file.least_edge_px,
                most_bound_px: file.most_bound_px,
            },
            pipelines,
        })
    }
}

/// Refuses two things of one name.
fn refuse_twice<'a>(place: &str, kind: &str, names: impl Iterator<Item = &'a str>) -> Result<()> {
    let mut names: Vec<&str> = names.collect();
    names.sort_unstable();
    match names.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(twice) => Err(Error::Other(format!("{place}: two {kind} are called {:?}", twice[0]))),
        None => Ok(()),
    }
}

impl Pipeline {
    /// Its algorithms with versions and parameters, for run.json.
    pub fn description(&self) -> serde_json::Value {
        serde_json::json!({
            "name": self.name,
            "seeds": match &self.seeds {
                Seeds::Disc { radius_px } => Some(serde_json::json!({ "disc_px": radius_px })),
                Seeds::Detected { .. } => None,
            },
            "target": self.seeds.target().map(Stage::description),
            "detect": match &self.seeds {
                Seeds::Disc { .. } => None,
                Seeds::Detected { detect, .. } => Some(detect.description()),
            },
            "refine": self.refine.description(),
            "face": self.grasp.as_ref().map(|grasp| grasp.face.description()),
            "grasp": self.grasp.as_ref().map(|grasp| grasp.point.description()),
        })
    }

    /// The pipeline of a table that has one value of each.
    pub(crate) fn build(place: &str, table: &Table) -> Result<Self> {
        let file: PipelineFile = registry::parameters(place, table)?;
        // A pipeline's name is part of file names and addresses.
        let legal = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_=.".contains(c);
        if file.name.is_empty() || !file.name.chars().all(legal) {
            return Err(Error::out_of_range(
                place,
                "name",
                format!("{:?}", file.name),
                "one or more of a-z, 0-9, -, _, = and .",
            ));
        }
        let has_target = file.target.is_some();
        let seeds = Self::build_seeds(place, file.seeds, file.target, file.detect)?;
        let unrefined = || Table::from_iter([("algorithm".to_owned(), "none".into())]);
        let refine = file.refine.unwrap_or_else(unrefined);
        let grasp = match (file.face, file.grasp) {
            (None, None) => None,
            (Some(_), Some(_)) if !has_target => {
                return Err(Error::Other(format!(
                    "{place}: a face is chosen in a target region, and there is no `target`; add \
                     it, or leave out `face` and `grasp`"
                )));
            }
            (Some(face), Some(point)) => Some(GraspStages {
                face: stage(place, "face", "face selector", SELECTORS, face)?,
                point: stage(place, "grasp", "grasp estimator", ESTIMATORS, point)?,
            }),
            (face, _) => {
                let (there, missing) =
                    if face.is_some() { ("face", "grasp") } else { ("grasp", "face") };
                return Err(Error::Other(format!(
                    "{place}: there is `{there}` but no `{missing}`; give both, or neither for a \
                     pipeline that ends with corners"
                )));
            }
        };
        Ok(Self {
            seeds,
            refine: stage(place, "refine", "refiner", REFINERS, refine)?,
            grasp,
            name: file.name,
        })
    }
}

impl Pipeline {
    fn build_seeds(
        place: &str,
        seeds: Option<Table>,
        target: Option<Table>,
        detect: Option<Table>,
    ) -> Result<Seeds> {
        match (seeds, detect) {
            (Some(seeds), None) if target.is_none() => {
                let file: SeedsFile = registry::parameters(&format!("{place}.seeds"), &seeds)?;
                Ok(Seeds::Disc { radius_px: file.disc_px })
            }
            (None, Some(detect)) => Ok(Seeds::Detected {
                target: target
                    .map(|table| stage(place, "target", "target extractor", EXTRACTORS, table))
                    .transpose()?,
                detect: stage(place, "detect", "detector", DETECTORS, detect)?,
            }),
            (None, None) => Err(Error::Other(format!(
                "{place}: no candidates; give `detect`, or `seeds` about the true corners"
            ))),
            (Some(_), _) => Err(Error::Other(format!(
                "{place}: `seeds` are about the true corners, without `target` and `detect`; leave out \
                 either"
            ))),
        }
    }
}

/// Builds the algorithm that a stage's table names in its key `algorithm`; the rest of the table
/// are its parameters.
fn stage<T: ?Sized>(
    place: &str,
    key: &str,
    kind: &str,
    entries: &[Entry<T>],
    mut table: Table,
) -> Result<Stage<T>> {
    let place = format!("{place}.{key}");
    let name = match table.remove("algorithm") {
        Some(toml::Value::String(name)) => name,
        Some(other) => {
            return Err(Error::out_of_range(place, "algorithm", other, "a name in quotes"));
        }
        None => return Err(Error::Other(format!("{place}: algorithm is missing"))),
    };
    let entry = registry::find(entries, kind, &name, &place)?;
    let algorithm = (entry.build)(&place, &table)?;
    let mut parameters = (entry.defaults)();
    parameters.extend(table);
    Ok(Stage { name: entry.name, version: entry.version, parameters, algorithm })
}

/// Reads `cameras/NAME.toml` in the folder of recipes, and the files it names.
///
/// # Errors
/// For an unknown name or key, or a value out of range: with file, key, found, allowed.
pub fn read_camera(recipes: &Path, name: &str) -> Result<Photographer> {
    let (place, table) = read_table(recipes, "cameras", name)?;
    let model: CameraModel = registry::parameters(&place, &table)?;
    model.check(&place)?;
    let psf = model.read_psf(&recipes.join("cameras"))?;
    Ok(Photographer::new(name, &model, psf.as_ref()))
}

/// Reads `range-sensors/NAME.toml` in the folder of recipes.
///
/// # Errors
/// For an unknown name or key, or a value out of range: with file, key, found, allowed.
pub fn read_range_sensor(recipes: &Path, name: &str) -> Result<RangeSensor> {
    let (place, table) = read_table(recipes, "range-sensors", name)?;
    let sensor: RangeSensor = registry::parameters(&place, &table)?;
    sensor.check(&place)?;
    Ok(sensor)
}

/// The names of the recipes in a folder, sorted.
pub fn recipe_names(recipes: &Path, folder: &str) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(recipes.join(folder))
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .filter_map(|path| Some(path.file_stem()?.to_str()?.to_owned()))
        .collect();
    names.sort();
    names
}

/// The table of one recipe file, and the words that name the file in messages.
///
/// # Errors
/// For an unknown name, or a file that is not TOML.
pub fn read_table(recipes: &Path, folder: &str, name: &str) -> Result<(String, Table)> {
    let known = recipe_names(recipes, folder);
    if !known.iter().any(|one| one == name) {
        return Err(Error::UnknownName {
            place: recipes.join(folder).display().to_string(),
            kind: folder.trim_end_matches('s').replace('-', " "),
            found: name.to_owned(),
            known,
        });
    }
    let path = recipes.join(folder).join(format!("{name}.toml"));
    let text = fs::read_to_string(&path).map_err(Error::io(&path, "read"))?;
    let table = text
        .parse()
        .map_err(|error: toml::de::Error| Error::malformed(&path, error.to_string()))?;
    Ok((path.display().to_string(), table))
}
