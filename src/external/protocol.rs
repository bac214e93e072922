//! What is said to a program and what it answers: one line of JSON each. `scripts/PROTOCOL.md` is for people.

use nalgebra::{Matrix2, Matrix3, Unit, Vector3};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use toml::Table;

use super::needs::Needs;
use crate::detect::Detection;
use crate::geometry::{Camera, ImagePoint};
use crate::grasp::{Approach, Face, Grasp};
use crate::image::PixelRange;
use crate::refine::{Corner, RefineStatus};
use crate::sensor::{Exposure, RangeImage, Rig, Sensor, Transfer};

/// Version of what is said.
pub const PROTOCOL: u32 = 1;

/// What a program does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Task {
    /// Finds corner candidates.
    Detect,
    /// Moves candidates to their sub-pixel positions.
    Refine,
    /// Computes a grasp point from a face.
    Grasp,
}

impl Task {
    /// What files call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Detect => "detect",
            Self::Refine => "refine",
            Self::Grasp => "grasp",
        }
    }

    /// What messages call who does it.
    pub fn doer(self) -> &'static str {
        match self {
            Self::Detect => "detector",
            Self::Refine => "refiner",
            Self::Grasp => "grasp estimator",
        }
    }
}

/// The first line to a program.
#[derive(Serialize)]
pub(super) struct Greeting<'a> {
    pub protocol: u32,
    pub parameters: &'a Table,
}

/// Its answer.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Ready {
    pub protocol: u32,
    #[serde(default)]
    pub version: Option<String>,
    /// Versions of what it is made of, by name.
    #[serde(default)]
    pub libraries: BTreeMap<String, String>,
    #[serde(default)]
    pub does: Option<Vec<Task>>,
    #[serde(default)]
    pub needs: Option<Needs>,
}

/// A question about one exposure.
#[derive(Serialize)]
pub(super) struct Question<'a> {
    pub id: u64,
    pub task: Task,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image: Option<Image<'a>>,
    /// What to refine: x, y \[px\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seeds: Option<Vec<ImagePoint>>,
    /// Where to find corners: first column and row, and those behind the last.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region: Option<[usize; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub face: Option<[ImagePoint; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<Range>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// Rows of three numbers and a place \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub world_from_camera: Option<[[f64; 4]; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub object_size_m: Option<[f64; 3]>,
}

/// Where the samples of an exposure are, and what is known of them.
#[derive(Serialize)]
pub(super) struct Image<'a> {
    file: &'a Path,
    width: usize,
    height: usize,
    channels: usize,
    #[serde(flatten)]
    needs: Described,
    bit_depth: u8,
    curve: Transfer,
    black_dn: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    mosaic: Option<[usize; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    noise: Option<Noise<'a>>,
}

#[derive(Serialize)]
struct Described {
    #[serde(rename = "type")]
    sample: super::needs::Sample,
    encoding: super::needs::Meaning,
}

#[derive(Serialize)]
struct Noise<'a> {
    sensor: &'a Sensor,
    light_per_dn: [f64; 3],
}

impl<'a> Image<'a> {
    pub fn new(file: &'a Path, exposure: &'a Exposure, needs: Needs) -> Self {
        let encoding = exposure.encoding();
        Self {
            file,
            width: exposure.width(),
            height: exposure.height(),
            channels: needs.channels(),
            needs: Described { sample: needs.sample, encoding: needs.encoding },
            bit_depth: encoding.bit_depth,
            curve: encoding.transfer,
            black_dn: encoding.black_dn,
            mosaic: exposure.mosaic(),
            noise: exposure
                .noise()
                .map(|noise| Noise { sensor: &noise.sensor, light_per_dn: noise.light_per_dn }),
        }
    }
}

/// A range image: its camera, where it stands, and what each cell tells, row by row.
#[derive(Serialize)]
pub(super) struct Range {
    camera: Camera,
    world_from_range: [[f64; 4]; 3],
    points_m: Vec<Option<[f64; 3]>>,
}

impl Question<'_> {
    pub fn new(task: Task) -> Self {
        Self {
            id: 0,
            task,
            image: None,
            seeds: None,
            region: None,
            face: None,
            range: None,
            camera: None,
            world_from_camera: None,
            object_size_m: None,
        }
    }

    pub fn of_region(self, PixelRange { x0, y0, x1, y1 }: PixelRange) -> Self {
        Self { region: Some([x0, y0, x1, y1]), ..self }
    }

    pub fn of_face(self, face: &Face, rig: &Rig, range: &RangeImage) -> Self {
        let points = range.points.samples().iter();
        Self {
            face: Some(face.corners),
            camera: Some(rig.camera),
            world_from_camera: Some(rows(&rig.world_from_camera)),
            range: Some(Range {
                camera: range.camera,
                world_from_range: rows(&range.world_from_range),
                points_m: points.map(|point| point.map(|p| [p.x, p.y, p.z])).collect(),
            }),
            ..self
        }
    }
}

fn rows(pose: &crate::geometry::Pose) -> [[f64; 4]; 3] {
    let matrix = pose.to_homogeneous();
    [0, 1, 2].map(|row| [0, 1, 2, 3].map(|column| matrix[(row, column)]))
}

/// An answer to a question. Which of its fields must be there depends on the task.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Answer {
    pub id: u64,
    /// What it took by the program's own clock \[us\].
    #[serde(default)]
    pub took_us: Option<f64>,
    /// Why there is no answer.
    #[serde(default)]
    pub error: Option<String>,
    #[serde(default)]
    points: Option<Vec<Option<[f64; 2]>>>,
    #[serde(default)]
    responses: Option<Vec<f64>>,
    #[serde(default)]
    statuses: Option<Vec<String>>,
    #[serde(default)]
    covariances_px2: Option<Vec<Option<[f64; 3]>>>,
    #[serde(default)]
    iterations: Option<Vec<u32>>,
    #[serde(default)]
    point: Option<[f64; 2]>,
    #[serde(default)]
    point_in_camera_m: Option<[f64; 3]>,
    #[serde(default)]
    approach: Option<[f64; 3]>,
    #[serde(default)]
    jaw: Option<[f64; 3]>,
    #[serde(default)]
    opening_m: Option<f64>,
    #[serde(default)]
    covariance_m2: Option<[f64; 6]>,
}

/// Reads a line.
///
/// # Errors
/// What is wrong with it, with the line's beginning.
pub(super) fn read<T: DeserializeOwned>(line: &[u8]) -> Result<T, String> {
    let text = String::from_utf8_lossy(line);
    serde_json::from_slice(line).map_err(|error| {
        let problem = match ["NaN", "Infinity"].iter().find(|word| text.contains(**word)) {
            Some(word) => format!("{word} is no answer; say null for a corner that is not there"),
            None if !text.trim_start().starts_with('{') => {
                "no answer; standard output is the protocol's alone, print to standard error"
                    .to_owned()
            }
            None if error.is_eof() => "no whole answer; each is one line".to_owned(),
            None => error.to_string(),
        };
        let beginning: String = text.chars().take(80).collect();
        let dots = if text.chars().count() > 80 { "..." } else { "" };
        format!("{problem}, in its line {beginning:?}{dots}")
    })
}

impl Answer {
    /// The candidates, strongest first; where the program gives no responses, as it gives them.
    pub fn detections(self) -> Result<Vec<Detection>, String> {
        self.only("detect", &["points", "responses"])?;
        let points = self.points.ok_or("points are missing")?;
        let count = points.len();
        let responses = match self.responses {
            Some(responses) => of_each("responses", responses, count, "points")?,
            None => (0..count).map(|place| (count - place) as f64).collect(),
        };
        let mut found = Vec::with_capacity(count);
        for (place, (point, response)) in points.into_iter().zip(responses).enumerate() {
            let [x, y] = point.ok_or_else(|| format!("point {place} is null"))?;
            found.push(Detection::new(ImagePoint::new(x, y), response));
        }
        found.sort_by(|a, b| b.response.total_cmp(&a.response));
        Ok(found)
    }

    /// One corner for each seed.
    pub fn corners(self, seeds: &[Detection]) -> Result<Vec<Corner>, String> {
        self.only("refine", &["points", "statuses", "covariances_px2", "iterations"])?;
        let count = seeds.len();
        let points = of_each("points", self.points.ok_or("points are missing")?, count, "seeds")?;
        let statuses = self.statuses.map(|all| of_each("statuses", all, count, "seeds"));
        let statuses = statuses.transpose()?;
        let covariances =
            self.covariances_px2.map(|all| of_each("covariances_px2", all, count, "seeds"));
        let covariances = covariances.transpose()?;
        let iterations = self.iterations.map(|all| of_each("iterations", all, count, "seeds"));
        let iterations = iterations.transpose()?;
        let mut corners = Vec::with_capacity(count);
        for (place, (seed, point)) in seeds.iter().zip(points).enumerate() {
            let said = statuses.as_ref().map(|all| status(place, &all[place])).transpose()?;
            let iterations = iterations.as_ref().map_or(0, |all| all[place]);
            let default =
                if point.is_some() { RefineStatus::Ok } else { RefineStatus::NotApplicable };
            let status = said.unwrap_or(default);
            let Some([x, y]) = point.filter(|_| status.answered()) else {
                if status.answered() {
                    return Err(format!(
                        "point {place} is null, and its status {:?}",
                        status.name()
                    ));
                }
                corners.push(Corner::at_seed(*seed, iterations, status));
                continue;
            };
            let covariance_px2 = match covariances.as_ref().and_then(|all| all[place]) {
                Some(values) => Some(covariance(place, values)?),
                None => None,
            };
            let position = ImagePoint::new(x, y);
            corners.push(Corner { seed: *seed, position, covariance_px2, iterations, status });
        }
        Ok(corners)
    }

    /// The grasp; `None` where there is none.
    pub fn grasp(self, rig: &Rig) -> Result<Option<Grasp>, String> {
        const KNOWN: [&str; 6] =
            ["point", "point_in_camera_m", "approach", "jaw", "opening_m", "covariance_m2"];
        self.only("grasp", &KNOWN)?;
        let (image_point, point_m) = match (self.point, self.point_in_camera_m) {
            (Some([x, y]), Some(point_m)) => (ImagePoint::new(x, y), point_m),
            (None, None) => return self.only("grasp", &[]).map(|()| None),
            (Some(_), None) => return Err("point_in_camera_m is missing".to_owned()),
            (None, Some(_)) => return Err("point is missing".to_owned()),
        };
        let approach = match (self.approach, self.jaw, self.opening_m) {
            (None, None, None) => None,
            (Some(normal), Some(jaw), Some(opening_m)) => Some(approach(normal, jaw, opening_m)?),
            _ => return Err("approach, jaw and opening_m are said together, or none".to_owned()),
        };
        Ok(Some(Grasp {
            approach,
            covariance_m2: self.covariance_m2.map(covariance_m2).transpose()?,
            ..Grasp::at(image_point, point_m.into(), rig)
        }))
    }

    /// Refuses what answers no question of the task.
    fn only(&self, task: &str, known: &[&str]) -> Result<(), String> {
        let given = [
            ("points", self.points.is_some()),
            ("responses", self.responses.is_some()),
            ("statuses", self.statuses.is_some()),
            ("covariances_px2", self.covariances_px2.is_some()),
            ("iterations", self.iterations.is_some()),
            ("point", self.point.is_some()),
            ("point_in_camera_m", self.point_in_camera_m.is_some()),
            ("approach", self.approach.is_some()),
            ("jaw", self.jaw.is_some()),
            ("opening_m", self.opening_m.is_some()),
            ("covariance_m2", self.covariance_m2.is_some()),
        ];
        match given.iter().find(|(name, is_given)| *is_given && !known.contains(name)) {
            Some((name, _)) if known.is_empty() => Err(format!("{name} without a point")),
            Some((name, _)) => {
                Err(format!("{name} answers no question of task {task:?}: {}", known.join(", ")))
            }
            None => Ok(()),
        }
    }
}

fn of_each<T>(what: &str, all: Vec<T>, count: usize, of: &str) -> Result<Vec<T>, String> {
    if all.len() == count {
        Ok(all)
    } else {
        Err(format!("{} {what} for {count} {of}; one for each, in their order", all.len()))
    }
}

/// Statuses that a program may give.
const STATUSES: [RefineStatus; 8] = [
    RefineStatus::Ok,
    RefineStatus::MaxIterations,
    RefineStatus::Reverted,
    RefineStatus::Diverged,
    RefineStatus::Singular,
    RefineStatus::OutOfBounds,
    RefineStatus::NotApplicable,
    RefineStatus::FalseCorner,
];

fn status(place: usize, name: &str) -> Result<RefineStatus, String> {
    STATUSES.into_iter().find(|status| status.name() == name).ok_or_else(|| {
        let known: Vec<&str> = STATUSES.iter().map(|status| status.name()).collect();
        format!("status {place} is {name:?}, must be one of {}", known.join(", "))
    })
}

fn covariance(place: usize, [xx, xy, yy]: [f64; 3]) -> Result<Matrix2<f64>, String> {
    let matrix = Matrix2::new(xx, xy, xy, yy);
    if matrix.determinant() >= 0.0 && matrix.trace() > 0.0 {
        Ok(matrix)
    } else {
        Err(format!("covariance {place}, [{xx}, {xy}, {yy}], is none: xx yy must be at least xy^2"))
    }
}

fn approach(normal: [f64; 3], jaw: [f64; 3], opening_m: f64) -> Result<Approach, String> {
    const LEAST_SINE: f64 = 0.02;
    let unit = |name: &str, [x, y, z]: [f64; 3]| {
        Unit::try_new(Vector3::new(x, y, z), 1e-9)
            .ok_or_else(|| format!("{name}, [{x}, {y}, {z}], is no direction"))
    };
    let (normal, along) = (unit("approach", normal)?, unit("jaw", jaw)?);
    let across = along.into_inner() - normal.into_inner() * along.dot(&normal);
    let jaw =
        Unit::try_new(across, LEAST_SINE).ok_or("jaw is along approach, must be across it")?;
    if opening_m > 0.0 {
        Ok(Approach { normal, normal_sigma_rad: None, jaw, opening_m })
    } else {
        Err(format!("opening_m is {opening_m}, must be more than 0"))
    }
}

fn covariance_m2([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Result<Matrix3<f64>, String> {
    let matrix = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    match matrix.cholesky() {
        Some(_) => Ok(matrix),
        None => Err(format!(
            "covariance_m2, [{xx}, {xy}, {xz}, {yy}, {yz}, {zz}], is none: xx, xy, xz, yy, yz, zz of a matrix whose \
             eigenvalues are more than 0"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;

    fn grasp(answer: &str) -> Result<Option<Grasp>, String> {
        let rig = Rig {
            camera: Camera::pinhole(64, 64, 64.0),
            world_from_camera: Pose::identity(),
            object_size_m: None,
        };
        read::<Answer>(answer.as_bytes())?.grasp(&rig)
    }

    #[test]
    fn a_grasp_is_whole_or_says_what_is_wrong_with_it() {
        let point = r#""id": 1, "point": [3, 4], "point_in_camera_m": [0.1, 0.2, 1]"#;
        let with = |more: &str| grasp(&format!("{{{point}{more}}}"));
        assert_eq!(grasp(r#"{"id": 1}"#), Ok(None));
        let alone = with("").expect("a point").expect("a grasp");
        assert!(alone.approach.is_none() && alone.covariance_m2.is_none());
        let all = with(
            r#", "approach": [0, 0, -2], "jaw": [3, 0, 1], "opening_m": 0.1, "covariance_m2": [4, 1, 0, 5, 0, 6]"#,
        );
        let all = all.expect("a grasp").expect("a grasp");
        let approach = all.approach.expect("an approach");
        assert_eq!(approach.normal.into_inner(), -Vector3::z());
        assert_eq!(approach.jaw.into_inner(), Vector3::x());
        let covariance = all.covariance_m2.expect("a covariance");
        assert_eq!(covariance, Matrix3::new(4.0, 1.0, 0.0, 1.0, 5.0, 0.0, 0.0, 0.0, 6.0));
        for (more, problem) in [
            (r#", "approach": [0, 0, -1]"#, "said together"),
            (r#", "approach": [0, 0, 0], "jaw": [1, 0, 0], "opening_m": 1"#, "is no direction"),
            (r#", "approach": [0, 0, 1], "jaw": [0, 0, -3], "opening_m": 1"#, "across it"),
            (r#", "approach": [0, 0, 1], "jaw": [1, 0, 0], "opening_m": 0"#, "more than 0"),
            (
                r#", "covariance_m2": [1, 2, 0, 1, 0, 1]"#,
                "covariance_m2, [1, 2, 0, 1, 0, 1], is none",
            ),
            (r#", "points": []"#, "points answers no question of task \"grasp\""),
        ] {
            let said = with(more).expect_err(more);
            assert!(said.contains(problem), "{said}");
        }
        let said = grasp(r#"{"id": 1, "opening_m": 0.1}"#).expect_err("no point");
        assert!(said.contains("opening_m without a point"), "{said}");
    }
}
