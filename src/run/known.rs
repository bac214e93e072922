//! Answers whose scores are known beforehand: they check the scoring, not an algorithm.

use nalgebra::Matrix2;
use toml::{Table, Value};

use super::answers::Answers;
use super::scene::{Shown, Station};
use crate::detect::Detection;
use crate::error::Result;
use crate::geometry::ImagePoint;
use crate::metrics::CornerRule;
use crate::plan::{Pipeline, Plan, Shots};
use crate::random::Stream;
use crate::record::Record;
use crate::refine::{Corner, RefineStatus};
use crate::scene::{Dataset, TrueCorner};
use crate::sensor::{PhotographBuffers, Photographer, RangeSensor};

/// Answers whose scores are known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Known {
    /// The truth.
    Truth,
    /// The truth and so much \[px\].
    Offset([f64; 2]),
    /// The truth and normal noise as small as the bound from the pixels within 10 px, with its covariance.
    AtBound,
}

impl Known {
    /// What is checked, and what records call it.
    pub const ALL: [(&'static str, Self); 4] = [
        ("truth", Self::Truth),
        ("offset", Self::Offset([0.3, -0.2])),
        ("half-pixel", Self::Offset([0.5, 0.5])),
        ("at-bound", Self::AtBound),
    ];
}

/// Times that noise is drawn for each corner. A draw is what a scene is elsewhere: they do not depend on each other.
const DRAWS: u32 = 64;
/// Times that answers are given which are always the same: two, as one would have no interval.
const REPEATS: u32 = 2;

/// The gate of known answers \[px\]: those of `summarise`, too.
pub const KNOWN_GATE_PX: f64 = 5.0;

/// The records of all known answers on every scene of a dataset, photographed by a camera. What cannot be
/// photographed is left out.
///
/// # Errors
/// When a scene cannot be read.
pub fn known_answers(dataset: &Dataset, camera: Photographer) -> Result<Vec<Record>> {
    let pipelines = Known::ALL
        .iter()
        .map(|(name, _)| {
            let of = |key: &str, value: Value| Table::from_iter([(key.to_owned(), value)]);
            let table = Table::from_iter([
                ("name".to_owned(), (*name).into()),
                ("seeds".to_owned(), of("disc_px", 0.0.into()).into()),
                ("refine".to_owned(), of("algorithm", "none".into()).into()),
            ]);
            Pipeline::build("known answers", &table, &[])
        })
        .collect::<Result<Vec<_>>>()?;
    let plan = Plan {
        name: "known answers".into(),
        summary: String::new(),
        cameras: vec![camera],
        cells: Vec::new(),
        families: Vec::new(),
        shots: Shots { phases: 1, repeats: 1 },
        range_sensor: String::new(),
        range_sensor_model: RangeSensor::default(),
        corner_rule: CornerRule { gate_px: KNOWN_GATE_PX, least_edge_px: 3.0, most_bound_px: 0.5 },
        pipelines,
    };
    let camera = &plan.cameras[0];
    let mut buffers = PhotographBuffers::default();
    let mut records = Vec::new();
    for name in dataset.scenes() {
        let scene = dataset.read(name)?;
        let Ok(bent) = camera.through_lens(&scene.film, &scene.description.camera) else {
            continue;
        };
        let film = bent.as_ref().unwrap_or(&scene.film);
        let kernel = camera.kernel(film.oversampling, [0.0, 0.0]);
        let suite = dataset.suite();
        let station =
            Station { plan: &plan, suite, scene: &scene, camera, kernel: &kernel, phase: 0 };
        station.show(film, 0, &mut buffers, |shown| {
            for (pipeline, (_, known)) in plan.pipelines.iter().zip(Known::ALL) {
                let draws = if known == Known::AtBound { DRAWS } else { REPEATS };
                for draw in 0..draws {
                    let corners =
                        shown.asked.iter().map(|corner| known.answer(corner, shown, draw));
                    let answers = Answers {
                        region: None,
                        corners: corners.collect(),
                        grasp: None,
                        failure: None,
                    };
                    let template = station.template(pipeline, draw, shown.blur_px);
                    let template = Record { scene: format!("{name} {draw}"), ..template };
                    records.extend(shown.scorer.records(&template, pipeline, &answers));
                }
            }
        });
    }
    Ok(records)
}

impl Known {
    fn answer(self, corner: &TrueCorner, shown: &Shown, draw: u32) -> Corner {
        let truth = corner.image_point_px;
        let (offset_px, covariance_px2) = match self {
            Self::Truth => ([0.0; 2], None),
            Self::Offset(offset_px) => (offset_px, None),
            Self::AtBound => {
                let bounds = &shown.scorer.seen.bounds[corner.index];
                let bound_px = bounds.local_px[1].or(bounds.closed_px).unwrap_or(0.0);
                let sigma_px = bound_px * std::f64::consts::FRAC_1_SQRT_2;
                let (corner, draw) = (corner.index.to_string(), draw.to_string());
                let name = [&shown.name[..], &["at the bound", &corner, &draw]].concat();
                let mut stream = Stream::named(&name);
                let noise_px = [(); 2].map(|()| sigma_px * stream.normal());
                (noise_px, Some(Matrix2::identity() * sigma_px * sigma_px))
            }
        };
        Corner {
            seed: Detection::new(truth, 1.0),
            position: ImagePoint::new(truth.x + offset_px[0], truth.y + offset_px[1]),
            covariance_px2,
            iterations: 0,
            status: RefineStatus::Ok,
        }
    }
}
