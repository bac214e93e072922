//! A plan as its file has it, and the schema by which editors complete and check it.

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use toml::Table;

use super::drawn::Factors;
use crate::detect::DETECTORS;
use crate::grasp::{ESTIMATORS, SELECTORS};
use crate::refine::REFINERS;
use crate::registry::{self, Entry};
use crate::target::EXTRACTORS;

/// What to measure: a camera and pipelines.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(title = "Plan", extend("required" = ["pipelines"]))]
pub(super) struct PlanFile {
    /// One line for `cornerbench list`.
    pub summary: String,
    /// Files of the folder `cameras`: one, or a list.
    pub camera: Names,
    /// Families of the scenes to measure, as the folder `families` has them; none is all.
    pub families: Vec<String>,
    /// Places of the pixels' grid on the image: the first as rendered, the others evenly spread.
    #[schemars(range(min = 1, max = 65536))]
    pub phases: u32,
    /// Photographs at each phase, every one with noise of its own.
    #[schemars(range(min = 1, max = 100_000))]
    pub repeats: u32,
    /// A file of the folder `range-sensors`.
    pub range_sensor: String,
    /// How far a detection may lie from the corner it is matched to \[px\].
    #[schemars(range(min = 0.01, max = 100.0))]
    pub gate_px: f64,
    /// How far two edges of a corner must be seen from it for it to be asked for \[px\].
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub least_edge_px: f64,
    /// The largest bound on a corner's place with which it is asked for \[px\].
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub most_bound_px: f64,
    /// Junctions to draw instead of a rendered suite. Where a table gives several values, each combination is a cell
    /// of its own.
    #[schemars(schema_with = "drawn_schema")]
    pub drawn: Vec<Table>,
    /// Chains of algorithms, each measured by itself. Where one of them gives several values, each combination is
    /// a pipeline of its own.
    #[schemars(with = "Vec<PipelineFile>", length(min = 1))]
    pub pipelines: Vec<Table>,
}

/// A name, or several.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub(super) enum Names {
    One(String),
    Several(Vec<String>),
}

impl Default for PlanFile {
    fn default() -> Self {
        Self {
            summary: String::new(),
            camera: Names::One("ideal".into()),
            families: Vec::new(),
            phases: 1,
            repeats: 1,
            range_sensor: "ideal".into(),
            gate_px: 5.0,
            least_edge_px: 3.0,
            most_bound_px: 0.5,
            drawn: Vec::new(),
            pipelines: Vec::new(),
        }
    }
}

/// A chain of algorithms from an exposure to corners, and perhaps on to a grasp.
#[derive(Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
#[schemars(title = "Pipeline")]
pub(super) struct PipelineFile {
    /// Column `method` of the records, with what was chosen behind it; that alone where there is no name.
    #[schemars(regex(pattern = r"^[a-z0-9_-]+$"))]
    pub name: String,
    /// Instead of `detect`: about each corner that is asked for; the refiner alone is judged.
    #[schemars(schema_with = "seeds_schema")]
    pub seeds: Option<Table>,
    /// Exposure to target region; without it the whole image is searched.
    #[schemars(schema_with = "target_schema")]
    pub target: Option<Table>,
    /// Region to corner candidates.
    #[schemars(schema_with = "detect_schema")]
    pub detect: Option<Table>,
    /// Candidates to corners; without it they stay where they are.
    #[schemars(schema_with = "refine_schema")]
    pub refine: Option<Table>,
    /// Corners to the face to grasp; with `grasp`, or neither. With `seeds` it is left out: it is known which corner is
    /// which.
    #[schemars(schema_with = "face_schema")]
    pub face: Option<Table>,
    /// Face to grasp point.
    #[schemars(schema_with = "grasp_schema")]
    pub grasp: Option<Table>,
}

/// Where seeds are.
#[derive(Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub(super) struct SeedsFile {
    /// Radius of the disc about the corner in which they are, evenly spread \[px\].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub disc_px: f64,
}

fn seeds_schema(_: &mut SchemaGenerator) -> Schema {
    several_of_each(registry::schema::<SeedsFile>())
}

fn drawn_schema(_: &mut SchemaGenerator) -> Schema {
    let mut cell = several_of_each(registry::schema::<Factors>());
    cell.remove("$schema");
    json_schema!({ "type": "array", "items": cell })
}

/// A schema of whose keys each may have several values.
fn several_of_each(mut schema: Schema) -> Schema {
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
