//! What the documentation promises.

use std::fs;
use std::sync::Arc;

use parquet::record::RecordWriter;

use crate::support::{cornerbench, project, recipes, succeed};
use cornerbench::record::Record;

fn format_document() -> String {
    fs::read_to_string(project().join("scenes/FORMAT.md")).expect("FORMAT.md")
}

#[test]
fn every_column_of_the_records_is_described() {
    let schema: Arc<_> = [Record::default()].as_slice().schema().expect("a schema");
    let document = format_document();
    for column in schema.get_fields() {
        assert!(document.contains(&format!("`{}`", column.name())), "{} is not", column.name());
    }
}

#[test]
fn every_key_of_the_recipes_is_described() {
    let document = format_document();
    for (folder, name) in
        [("families", "paper"), ("suites", "quick"), ("plans", "paper"), ("cameras", "webcam")]
    {
        let path = project().join("scenes").join(folder).join(format!("{name}.toml"));
        let table: toml::Table =
            fs::read_to_string(&path).expect("a recipe").parse().expect("TOML");
        for (key, value) in &table {
            let inner = match value {
                toml::Value::Table(inner) => Some(inner),
                toml::Value::Array(items) => items.first().and_then(toml::Value::as_table),
                _ => None,
            };
            let names: Vec<&String> = match (key.as_str(), inner) {
                // Poses have names of their own; a pipeline's stages hold an algorithm's parameters.
                ("poses", Some(poses)) => poses
                    .values()
                    .filter_map(toml::Value::as_table)
                    .flat_map(|t| t.keys())
                    .collect(),
                (_, Some(inner)) => inner.keys().collect(),
                _ => vec![key],
            };
            for name in names {
                let described = document.contains(&format!("`{name}`"))
                    || document.contains(&format!(".{name}`"));
                assert!(described, "{folder}: {key}.{name} is not described");
            }
        }
    }
}

#[test]
fn every_key_of_cameras_range_sensors_grippers_and_robots_is_described() {
    fn keys(root: &serde_json::Value, schema: &serde_json::Value, found: &mut Vec<String>) {
        let alternatives = schema["anyOf"].as_array().into_iter().flatten();
        let named = schema["$ref"].as_str().and_then(|name| name.rsplit('/').next());
        let named = named.map(|name| &root["$defs"][name]);
        for schema in alternatives.chain([schema]).chain(named) {
            for (key, inner) in schema["properties"].as_object().into_iter().flatten() {
                let before = found.len();
                keys(root, inner, found);
                // A table's keys are described, each with the table's name before it.
                if found.len() == before {
                    found.push(key.clone());
                }
            }
        }
    }
    let document = format_document();
    for kind in ["camera", "range-sensor", "gripper", "robot"] {
        let path = project().join("scenes/schemas").join(format!("{kind}.json"));
        let text = fs::read_to_string(path).expect("a schema");
        let schema: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let mut found = Vec::new();
        keys(&schema, &schema, &mut found);
        assert!(found.len() > 10, "{kind}: {found:?}");
        for key in found {
            let described = ["`", "."].iter().any(|b| document.contains(&format!("{b}{key}`")));
            assert!(described, "{kind}: {key} is not described");
        }
    }
}

#[test]
fn the_readme_s_links_and_pictures_are_there() {
    let text = fs::read_to_string(project().join("README.md")).expect("a README");
    let links: Vec<&str> =
        text.split("](").skip(1).filter_map(|rest| rest.split(')').next()).collect();
    assert!(links.len() >= 3, "{links:?}");
    for link in links {
        assert!(project().join(link).is_file(), "{link} is missing");
    }
}

#[test]
fn every_algorithm_s_header_is_complete() {
    const SECTIONS: [&str; 9] = [
        "Method",
        "Input",
        "Parameters",
        "Output",
        "Border",
        "Cost",
        "Departures",
        "Source",
        "Checked by",
    ];
    for stage in ["target", "detect", "refine", "grasp"] {
        for path in algorithm_files(&project().join("src").join(stage)) {
            let text = fs::read_to_string(&path).expect("a source");
            let header: Vec<&str> =
                text.lines().take_while(|line| line.starts_with("//!")).collect();
            for section in SECTIONS {
                let found = header.iter().any(|line| line.starts_with(&format!("//! # {section}")));
                assert!(found, "{}: the header has no {section}", path.display());
            }
        }
    }
}

/// The files of a stage that register an algorithm.
fn algorithm_files(stage: &std::path::Path) -> Vec<std::path::PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(stage).expect("a stage").flatten() {
        let path = if entry.path().is_dir() { entry.path().join("mod.rs") } else { entry.path() };
        let is_entry = |text: String| text.contains("pub const ENTRY:");
        if fs::read_to_string(&path).is_ok_and(is_entry) {
            found.push(path);
        }
    }
    assert!(!found.is_empty(), "{} holds no algorithm", stage.display());
    found
}

#[test]
fn every_file_that_registers_an_algorithm_is_in_its_stage_s_list() {
    let names = |kind: &str| {
        let text =
            succeed(cornerbench().args(["list", kind, "--json", "--recipes"]).arg(recipes()));
        let rows: Vec<serde_json::Value> = serde_json::from_str(&text).expect("JSON");
        rows.len()
    };
    for (stage, kinds) in [
        ("target", &["targets"][..]),
        ("detect", &["detectors"]),
        ("refine", &["refiners"]),
        ("grasp", &["faces", "grasps"]),
    ] {
        let listed: usize = kinds.iter().map(|kind| names(kind)).sum();
        assert_eq!(listed, algorithm_files(&project().join("src").join(stage)).len(), "{stage}");
    }
}
