//! Pictures of one's own: read, answered by every pipeline as far as corners, scored where corners are known.
//!
//! Nobody knows what else is true of them: they have neither bounds nor false junctions, and no range image, so no grasp.

use std::fs;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde_json::{Value, json};

use super::answers::Answers;
use super::pictures::write_exposure;
use super::scene::seeds_in_disc;
use super::score::{
    failure_record, false_corner, known_corner, of_pipeline, unreadable, with_answer, with_reason,
    without_target,
};
use crate::error::{Error, Result};
use crate::files::sha256_hex;
use crate::geometry::{ImagePoint, Origin};
use crate::matching::assign;
use crate::metrics::found_at_responses;
use crate::picture::{KnownCorner, KnownCorners, Making, find_pictures, read_picture};
use crate::plan::{Pipeline, Plan, Seeds};
use crate::record::{PicturesDescription, Record, kind, status};
use crate::refine::Corner;
use crate::scene::Split;
use crate::sensor::{Exposure, Photographer};

/// What records call the family of pictures, and the suite where their folder has no name.
const PICTURES: &str = "pictures";
/// What records call the camera where nobody says which one it was.
const SOME_CAMERA: &str = "picture";

/// A folder of pictures, and what is known of them.
pub struct Album<'a> {
    suite: String,
    pictures: Vec<Picture>,
    making: Making<'a>,
    known: Option<KnownCorners>,
    origin: Origin,
}

/// A picture, not yet read.
struct Picture {
    path: PathBuf,
    name: String,
    known: Vec<KnownCorner>,
    /// In the order of their names they take turns.
    split: Split,
}

impl<'a> Album<'a> {
    /// Finds the pictures of a folder, and their corners in a file of known ones, if there is one; pictures are not yet
    /// read.
    ///
    /// # Errors
    /// When the folder holds no picture or the file is not one of its corners.
    pub fn open(
        folder: &Path,
        making: Making<'a>,
        known: Option<&Path>,
        origin: Origin,
    ) -> Result<Self> {
        let paths = find_pictures(folder)?;
        let known = known.map(|path| KnownCorners::read(path, origin)).transpose()?;
        let corners = match &known {
            Some(known) => known.of_pictures(&paths)?,
            None => vec![Vec::new(); paths.len()],
        };
        let picture = |(index, (path, known)): (usize, (PathBuf, Vec<KnownCorner>))| {
            let name = path.file_name().and_then(|name| name.to_str()).map(str::to_owned);
            let name = name.ok_or_else(|| {
                Error::malformed(
                    &path,
                    "its name is not Unicode, as names in records are; rename it",
                )
            })?;
            let split = if index % 2 == 0 { Split::Dev } else { Split::Test };
            Ok(Picture { path, name, known, split })
        };
        let pictures = paths.into_iter().zip(corners).enumerate().map(picture);
        let pictures = pictures.collect::<Result<Vec<_>>>()?;
        // Of "." there is none until it is resolved.
        let whole = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
        let suite = whole.file_name().and_then(|name| name.to_str()).unwrap_or(PICTURES).to_owned();
        Ok(Self { suite, pictures, making, known, origin })
    }

    /// How many pictures there are.
    pub fn len(&self) -> usize {
        self.pictures.len()
    }

    /// Whether there are none; there never are.
    pub fn is_empty(&self) -> bool {
        self.pictures.is_empty()
    }

    /// The folder's name.
    pub fn suite(&self) -> &str {
        &self.suite
    }

    /// What took them, where somebody says so.
    pub fn camera(&self) -> Option<&'a Photographer> {
        self.making.camera
    }

    /// What records call that.
    pub fn camera_name(&self) -> &str {
        self.camera().map_or(SOME_CAMERA, Photographer::name)
    }

    /// The pictures in which nobody knows a corner.
    pub fn without_known_corners(&self) -> impl Iterator<Item = &str> {
        let unknown = self.pictures.iter().filter(|picture| picture.known.is_empty());
        unknown.map(|picture| picture.name.as_str())
    }

    /// Names and splits of the pictures, in their order.
    pub(super) fn names(&self) -> impl Iterator<Item = (&str, Split)> {
        self.pictures.iter().map(|picture| (picture.name.as_str(), picture.split))
    }

    pub(super) fn description(&self) -> PicturesDescription {
        PicturesDescription {
            without_known_corners: self.without_known_corners().map(str::to_owned).collect(),
            origin: self.origin,
            transfer: self.making.transfer,
            white: self.making.white,
        }
    }

    /// All that decides what the pictures' samples mean, and where their corners are.
    pub(super) fn identity(&self) -> Value {
        let of_picture = |picture: &Picture| {
            // One that cannot be read is a row of its own.
            let bytes = fs::read(&picture.path).ok();
            let points: Vec<ImagePoint> = picture.known.iter().map(|known| known.point).collect();
            json!([picture.name, bytes.map(|bytes| sha256_hex(&bytes)), points])
        };
        let pictures: Vec<Value> = self.pictures.par_iter().map(of_picture).collect();
        let camera = self.camera().map(Photographer::identity);
        json!([pictures, camera, self.making.transfer, self.making.white, self.origin])
    }

    /// The rows of a picture. What a report draws of it goes into `folder`/CAMERA, where corners are known.
    ///
    /// # Errors
    /// When that cannot be written. A picture that cannot be read is a row.
    pub(super) fn rows(
        &self,
        plan: &Plan,
        index: usize,
        folder: Option<&Path>,
    ) -> Result<Vec<Record>> {
        let picture = &self.pictures[index];
        let exposure = match self.read(picture) {
            Ok(exposure) => exposure,
            Err(error) => {
                return Ok(vec![unreadable(
                    &self.suite,
                    &picture.name,
                    self.camera_name(),
                    &error,
                )]);
            }
        };
        if let Some(folder) = folder.filter(|_| !picture.known.is_empty()) {
            let folder = folder.join(self.camera_name());
            fs::create_dir_all(&folder).map_err(Error::io(&folder, "create"))?;
            write_exposure(&folder.join("exposure.png"), &exposure)?;
        }
        let of_pipeline = |pipeline| self.answered(plan, pipeline, picture, &exposure);
        Ok(plan.pipelines.iter().flat_map(of_pipeline).collect())
    }

    fn read(&self, picture: &Picture) -> Result<Exposure> {
        let exposure = read_picture(&picture.path, &self.making)?;
        if let Some(known) = &self.known {
            known.check_inside(&picture.known, exposure.width(), exposure.height())?;
        }
        Ok(exposure)
    }

    /// The rows of a pipeline; none of one that is given seeds about corners that nobody knows.
    fn answered(
        &self,
        plan: &Plan,
        pipeline: &Pipeline,
        picture: &Picture,
        exposure: &Exposure,
    ) -> Vec<Record> {
        let known: Vec<ImagePoint> = picture.known.iter().map(|known| known.point).collect();
        let given = match pipeline.seeds {
            Seeds::Disc { radius_px } => {
                let name = [self.suite.as_str(), &picture.name, "0"];
                seeds_in_disc(known.iter().copied().enumerate(), radius_px, &name)
            }
            Seeds::Detected { .. } | Seeds::Elsewhere(_) => Vec::new(),
        };
        let Answers { region, corners, failure, .. } = match &pipeline.seeds {
            Seeds::Elsewhere(file) => {
                Answers::from_elsewhere(file.answers(self.camera_name(), &picture.name, 0))
            }
            _ => Answers::of_corners(pipeline, exposure, &given),
        };
        let template = with_reason(&self.template(pipeline, picture), failure.as_ref());
        let failed = failure.as_ref().map(|failure| failure_record(&template, failure));
        if known.is_empty() {
            return of_unknown(&template, &corners).into_iter().chain(failed).collect();
        }
        let gate_px = plan.corner_rule.gate_px;
        let (own, found_at) = match pipeline.seeds {
            // One for each of them, in their order.
            Seeds::Disc { .. } => ((0..known.len()).map(Some).collect(), vec![None; known.len()]),
            Seeds::Detected { .. } | Seeds::Elsewhere(_) => {
                let found_at = found_at_responses(&known, &corners, gate_px);
                (matched(&known, &corners, gate_px), found_at)
            }
        };
        let no_target = without_target(region.as_ref());
        let mut is_taken = vec![false; corners.len()];
        let mut records = Vec::new();
        for (index, (truth, own)) in known.iter().zip(own).enumerate() {
            own.iter().for_each(|own| is_taken[*own] = true);
            let record = known_corner(&template, index, *truth, own.map(|own| &corners[own]));
            let reason =
                no_target.clone().filter(|_| own.is_none()).or_else(|| record.reason.clone());
            records.push(Record { found_at_response: found_at[index], reason, ..record });
        }
        let others = corners.iter().zip(&is_taken).filter(|(_, is_taken)| !**is_taken);
        records.extend(others.map(|(corner, _)| {
            let distances_px = known.iter().map(|truth| truth.distance_px(corner.seed.point));
            let nearest_px = distances_px.min_by(f64::total_cmp);
            let is_near = nearest_px.is_some_and(|nearest_px| nearest_px <= gate_px);
            let cause = if is_near { "duplicate" } else { "background" };
            false_corner(&template, corner, cause, nearest_px)
        }));
        records.extend(failed);
        records
    }

    /// A record with all that is the same for all rows of a picture and method.
    fn template(&self, pipeline: &Pipeline, picture: &Picture) -> Record {
        Record {
            suite: self.suite.clone(),
            scene: picture.name.clone(),
            family: PICTURES.to_owned(),
            split: Some(picture.split.name().to_owned()),
            camera: self.camera_name().to_owned(),
            exposure: Some(0),
            face_selector: None,
            grasp_estimator: None,
            ..of_pipeline(pipeline)
        }
    }
}

/// The rows of answers of which nobody knows whether they are right.
fn of_unknown(template: &Record, corners: &[Corner]) -> Vec<Record> {
    let row = |(index, corner): (usize, &Corner)| Record {
        kind: kind::CORNER.to_owned(),
        status: status::UNKNOWN.to_owned(),
        corner_index: i32::try_from(index).ok(),
        ..with_answer(template, corner)
    };
    corners.iter().enumerate().map(row).collect()
}

/// Of each known corner the answer that is its own, by the detector's position.
fn matched(known: &[ImagePoint], corners: &[Corner], gate_px: f64) -> Vec<Option<usize>> {
    let is_near =
        |corner: &Corner| known.iter().any(|truth| truth.distance_px(corner.seed.point) <= gate_px);
    // Only what may be given at all: an assignment's cost grows with the cube.
    let near: Vec<usize> = (0..corners.len()).filter(|&index| is_near(&corners[index])).collect();
    let points: Vec<ImagePoint> = near.iter().map(|&index| corners[index].seed.point).collect();
    let assigned = assign(known, &points, gate_px).answer_of_truth;
    assigned.into_iter().map(|answer| answer.map(|answer| near[answer])).collect()
}
