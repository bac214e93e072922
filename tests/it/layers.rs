//! Dependency runs one way: what each module may use of the others.

use std::fs;
use std::path::{Path, PathBuf};

use crate::support::project;

/// Modules in layers; one may use those of lower layers and, where named, of its own.
const LAYERS: &[&[&str]] = &[
    &[
        "error", "geometry", "cuboid", "image", "junction", "vector", "filter", "stats", "random",
        "registry", "files",
    ],
    &["scene"],
    &["sensor"],
    &["target", "detect", "refine", "grasp"],
    &["external"],
    &["bound", "matching", "metrics", "convention", "export", "picture"],
    &["plan", "run", "record", "contract"],
    &["report"],
    &["cli"],
];

/// Stages may use `sensor` and the stages before them, nothing of `scene`: truth is there. Other programs are asked by what
/// stages are asked by.
const STAGES: &[&str] = &["target", "detect", "refine", "grasp", "external"];

fn layer(module: &str) -> usize {
    LAYERS
        .iter()
        .position(|modules| modules.contains(&module))
        .unwrap_or_else(|| panic!("module {module} stands in no layer of tests/it/layers.rs"))
}

fn allowed(from: &str, to: &str) -> bool {
    let place = |module: &str| STAGES.iter().position(|stage| *stage == module);
    match (place(from), place(to)) {
        (Some(from), Some(to)) => to <= from,
        (Some(_), None) => to != "scene" && layer(to) < layer(from),
        // The plan builds stages, matching and metrics read their output, the sensor reads film.
        // Reports read records and run nothing.
        _ if from == "report" => to == "record" || layer(to) == 0,
        _ => layer(to) <= layer(from),
    }
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder of sources").flatten() {
        let path = entry.path();
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
    found
}

/// The modules that a source names behind `crate::`, whether in a `use` or in a path.
fn uses(text: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    for (line, text) in text.lines().enumerate().filter(|(_, t)| !t.trim_start().starts_with("//"))
    {
        assert!(!text.contains("super::super"), "line {}: name it by crate::", line + 1);
        for part in text.split("crate::").skip(1) {
            assert!(!part.starts_with('{'), "line {}: one use for each module", line + 1);
            let name: String =
                part.chars().take_while(|c| c.is_ascii_lowercase() || *c == '_').collect();
            if !name.is_empty() {
                found.push((line + 1, name));
            }
        }
    }
    found
}

#[test]
fn dependency_runs_one_way() {
    let root = project().join("src");
    let mut wrong = Vec::new();
    for path in sources(&root) {
        let inside = path.strip_prefix(&root).expect("below src");
        let first = inside.components().next().expect("a name").as_os_str().to_string_lossy();
        let module = first.trim_end_matches(".rs");
        if matches!(module, "lib" | "main") {
            continue;
        }
        let text = fs::read_to_string(&path).expect("a source");
        for (line, used) in uses(&text) {
            if used != module && !allowed(module, &used) {
                wrong.push(format!("{}:{line} uses {used}", inside.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "against the layers:\n{}", wrong.join("\n"));
}

#[test]
fn a_use_is_seen_in_imports_and_in_paths() {
    let text = "use crate::scene::Truth;\n// crate::report\nlet x = crate::run::measure();\n";
    assert_eq!(uses(text), [(1, "scene".to_owned()), (3, "run".to_owned())]);
}

#[test]
#[should_panic(expected = "one use for each module")]
fn a_grouped_import_cannot_hide_a_module() {
    uses("use crate::{scene::Truth, image::Plane};");
}

#[test]
fn no_algorithm_may_use_truth() {
    for stage in STAGES {
        assert!(!allowed(stage, "scene"), "{stage} may use scene");
        assert!(!allowed(stage, "metrics"), "{stage} may use metrics");
    }
    assert!(!allowed("detect", "refine"));
    assert!(allowed("refine", "detect"));
}
