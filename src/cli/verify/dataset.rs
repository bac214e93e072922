//! A dataset: it is whole, its image is where its truth says, and answers that are known beforehand
//! score what they must.

use std::collections::BTreeSet;
use std::path::Path;

use serde::Serialize;
use serde_json::{Value, json};

use super::Options;
use crate::cli::{Ended, Global, print_line, project};
use crate::convention::{
    CornerOffset, Evidence, MeanOffset, corner_offsets, is_sharp, mean_offset, root_mean_square_px,
};
use crate::error::{Error, Result};
use crate::plan::read_camera;
use crate::report::refinement::Estimate;
use crate::report::summary::{MethodSummary, summarise};
use crate::report::words;
use crate::run::{KNOWN_GATE_PX, known_answers};
use crate::scene::{Dataset, Scene, TrueCorner, Visibility};

/// What passes of one kind of evidence.
struct Limits {
    /// Its name.
    name: &'static str,
    /// The largest mean offset \[px\], to which come [`CERTAIN`] of its standard errors.
    mean_px: f64,
    /// The largest root mean square of the offsets \[px\].
    root_mean_square_px: Option<f64>,
    /// A single corner fails when it is off by more than this and five standard errors \[px\].
    far_px: f64,
}

const COVERAGE: Limits =
    Limits { name: "coverage", mean_px: 0.002, root_mean_square_px: Some(0.005), far_px: 0.02 };
const RADIANCE: Limits =
    Limits { name: "radiance", mean_px: 0.01, root_mean_square_px: None, far_px: 0.02 };

/// An offset counts as larger than allowed when it is so by this many standard errors.
const CERTAIN: f64 = 2.0;

/// Sub-pixel phases are told apart on a grid of so many cells per pixel and direction.
const PHASES: f64 = 32.0;

pub(super) fn run(global: &Global, options: &Options) -> Result<Ended> {
    let folder = Path::new(&options.what);
    let dataset = Dataset::open(folder)?;
    let (mut in_coverage, mut in_radiance) = (Vec::new(), Vec::new());
    let (mut unreadable, mut not_sharp, mut visible) = (Vec::new(), 0, 0);
    for name in dataset.scenes() {
        match measure(&dataset, name) {
            Ok(None) => not_sharp += 1,
            Ok(Some(measured)) => {
                visible += measured.visible;
                in_coverage.extend(measured.in_coverage.into_iter().map(|offset| (name, offset)));
                in_radiance.extend(measured.in_radiance.into_iter().map(|offset| (name, offset)));
            }
            Err(error) => {
                eprintln!("{name} skipped: {}", error.chain());
                unreadable.push(json!({ "scene": name, "reason": error.chain() }));
            }
        }
    }
    let found = [Found::of(&COVERAGE, &in_coverage), Found::of(&RADIANCE, &in_radiance)];
    let [Some(coverage), radiance] = found else {
        return Err(Error::Other(format!(
            "{}: {} of {visible} visible sharp corners can be measured, at least 2 are needed to \
             tell the offset; render suite bare",
            folder.display(),
            in_coverage.len()
        )));
    };
    let passed = coverage.passed && radiance.as_ref().is_none_or(|found| found.passed);
    let known = if unreadable.is_empty() {
        let camera = read_camera(&project::recipes(global)?, &options.camera)?;
        let records = known_answers(&dataset, camera)?;
        summarise(&records, KNOWN_GATE_PX).methods.iter().map(KnownAnswer::of).collect()
    } else {
        Vec::new()
    };
    let passed = passed && unreadable.is_empty() && known.iter().all(|known| known.passed);
    if global.json {
        print_line(json!({
            "coverage": coverage.json(&in_coverage),
            "radiance": radiance.map(|found| found.json(&in_radiance)),
            "visible": visible,
            "not_sharp": not_sharp,
            "unreadable": unreadable,
            "known_answers": known,
            "passed": passed,
        }))?;
    } else {
        print_line(coverage.sentence(visible))?;
        match radiance {
            Some(found) => print_line(found.sentence(visible))?,
            None => print_line("radiance: fewer than 2 corners are clean enough to be measured")?,
        }
        for known in &known {
            print_line(known.sentence())?;
        }
        print_line(format_args!(
            "{} scenes unreadable, {not_sharp} not measured because edges are rounded or out of \
             focus: {}",
            unreadable.len(),
            if passed { "renderer, reader and projection agree" } else { "FAILED" },
        ))?;
    }
    Ok(if passed { Ended::Well } else { Ended::Partly })
}

/// What answers that are known beforehand scored, and whether that is right.
#[derive(Serialize)]
struct KnownAnswer {
    name: String,
    found: String,
    expected: &'static str,
    passed: bool,
}

impl KnownAnswer {
    fn of(method: &MethodSummary) -> Self {
        let all = &method.refinement.all;
        let value = |estimate: Option<Estimate>| estimate.map_or(f64::NAN, |e| e.value);
        let is_near = |found: f64, wanted: f64| (found - wanted).abs() < 1e-9;
        // An interval misses once in twenty: twice as wide it does not.
        let holds = |estimate: Option<Estimate>, wanted: f64| {
            let ends = estimate.and_then(|e| Some((e.value, e.low?, e.high?)));
            ends.is_some_and(|(value, low, high)| {
                (2.0 * low - value..=2.0 * high - value).contains(&wanted)
            })
        };
        let offset = |wanted: [f64; 2]| {
            all.offset_px.iter().zip(wanted).all(|(found, wanted)| is_near(value(*found), wanted))
        };
        let is_all = all.answered == all.asked && all.asked > 0;
        let shift = method.refinement.shift;
        let [x, y] = all.offset_px.map(value);
        let (found, expected, passed) = match method.method.as_str() {
            "truth" => (
                format!(
                    "{} of {} answers, rms error {:.1e} px",
                    all.answered,
                    all.asked,
                    value(all.rmse_px).max(0.0)
                ),
                "all, 0 px",
                is_all && all.max_px.is_some_and(|error| error < 1e-9) && shift.is_none(),
            ),
            "offset" => (
                format!("mean offset ({x:+.4}, {y:+.4}) px"),
                "(+0.3, -0.2) px",
                is_all && offset([0.3, -0.2]) && shift.is_none(),
            ),
            "half-pixel" => (
                shift.unwrap_or("not recognised").to_owned(),
                "half a pixel, recognised",
                is_all
                    && offset([0.5, 0.5])
                    && shift.is_some_and(|words| words.contains("pixel's corner")),
            ),
            _ => (
                format!(
                    "efficiency {}, squared error over covariance {}",
                    words::between(all.efficiency, 3),
                    words::between(all.nees, 2)
                ),
                "efficiency 1, 2",
                is_all && holds(all.efficiency, 1.0) && holds(all.nees, 2.0),
            ),
        };
        Self { name: method.method.clone(), found, expected, passed }
    }

    fn sentence(&self) -> String {
        let verdict = if self.passed { "passed" } else { "FAILED" };
        format!(
            "known answers, {}: {} (expected: {}): {verdict}",
            self.name, self.found, self.expected
        )
    }
}

/// What was measured of a scene.
struct Measured {
    /// Corners that are visible, measured or not.
    visible: usize,
    in_coverage: Vec<CornerOffset>,
    in_radiance: Vec<CornerOffset>,
}

/// The offsets of a scene's corners; `None` where its edges are not sharp.
fn measure(dataset: &Dataset, name: &str) -> Result<Option<Measured>> {
    let scene: Scene = dataset.read(name)?;
    let coverage = dataset.read_coverage(&scene)?;
    if !is_sharp(&scene) {
        return Ok(None);
    }
    let is_visible = |corner: &&TrueCorner| corner.visibility == Visibility::Visible;
    Ok(Some(Measured {
        visible: scene.truth.corners.iter().filter(is_visible).count(),
        in_coverage: coverage
            .map(|coverage| corner_offsets(&scene, Evidence::Coverage(&coverage)))
            .unwrap_or_default(),
        in_radiance: corner_offsets(&scene, Evidence::Radiance),
    }))
}

/// What was found in one kind of evidence.
struct Found {
    limits: &'static Limits,
    mean: MeanOffset,
    root_mean_square_px: f64,
    phases: usize,
    far: Vec<String>,
    passed: bool,
}

impl Found {
    fn of(limits: &'static Limits, offsets: &[(&str, CornerOffset)]) -> Option<Self> {
        let all: Vec<CornerOffset> = offsets.iter().map(|(_, offset)| offset.clone()).collect();
        let mean = mean_offset(&all)?;
        let root_mean_square_px = root_mean_square_px(&all)?;
        let far: Vec<String> = offsets
            .iter()
            .filter(|(_, offset)| limits.is_far(offset))
            .map(|(scene, offset)| format!("{scene} corner {}", offset.corner))
            .collect();
        #[allow(clippy::cast_possible_truncation, reason = "in 0..32")]
        let phase = |value: f64| ((value - value.floor()) * PHASES) as i64;
        let phases: BTreeSet<[i64; 2]> = all
            .iter()
            .map(|offset| [phase(offset.image_point_px.x), phase(offset.image_point_px.y)])
            .collect();
        let [x_error, y_error] = mean.standard_error_px;
        let passed = mean.length_px <= limits.mean_px + CERTAIN * x_error.hypot(y_error)
            && limits.root_mean_square_px.is_none_or(|most| root_mean_square_px <= most)
            && far.is_empty();
        Some(Self { limits, mean, root_mean_square_px, phases: phases.len(), far, passed })
    }

    fn sentence(&self, visible: usize) -> String {
        let ([x, y], [x_error, y_error]) = (self.mean.mean_px, self.mean.standard_error_px);
        let most = self.limits.root_mean_square_px.map(|most| format!(" (at most {most})"));
        let far = if self.far.is_empty() {
            "none far off".to_owned()
        } else {
            format!("far off: {}", self.far.join(", "))
        };
        format!(
            "{}: {} of {visible} visible corners, {} different sub-pixel phases, mean offset ({x:+.5}, {y:+.5}) px +- \
             ({x_error:.5}, {y_error:.5}), length {:.5} px (at most {}), RMS {:.5} px{}, {far}: {}",
            self.limits.name,
            self.mean.corners,
            self.phases,
            self.mean.length_px,
            self.limits.mean_px,
            self.root_mean_square_px,
            most.unwrap_or_default(),
            if self.passed { "passed" } else { "FAILED" },
        )
    }

    fn json(&self, offsets: &[(&str, CornerOffset)]) -> Value {
        let rows: Vec<_> = offsets
            .iter()
            .map(|(scene, offset)| {
                json!({
                    "scene": scene,
                    "corner": offset.corner,
                    "offset_px": offset.offset_px,
                    "standard_error_px": offset.standard_error_px,
                    "far": self.limits.is_far(offset),
                })
            })
            .collect();
        json!({
            "corners": rows,
            "mean": self.mean,
            "root_mean_square_px": self.root_mean_square_px,
            "phases": self.phases,
            "far": self.far,
            "passed": self.passed,
        })
    }
}

impl Limits {
    /// Whether a corner's own offset is larger than its uncertainty explains.
    fn is_far(&self, offset: &CornerOffset) -> bool {
        let pairs = offset.offset_px.iter().zip(&offset.standard_error_px);
        pairs.into_iter().any(|(offset, error)| offset.abs() > self.far_px + 5.0 * error)
    }
}
