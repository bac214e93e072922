//! Record: one flat, versioned row; the only thing reports read.
//!
//! The columns are described in `scenes/FORMAT.md`. A value that does not apply is null, never NaN.

mod attempt;
mod run;
mod timing;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parquet::column::writer::ColumnCloseResult;
use parquet::file::metadata::{ParquetMetaData, ParquetMetaDataReader};
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::record::{Field, RecordWriter};
use parquet::schema::types::Type;
use parquet_derive::ParquetRecordWriter;
use serde::Deserialize;

use crate::error::{Error, Result};

pub use attempt::{Attempt, outcome, write_attempts};
pub use run::{
    FailureCount, PicturesDescription, RunDescription, Sketch, pictures_folder, read_run,
    read_sketch,
};
pub use timing::{MethodTime, ProgramTime, Spread, TIMING_FILE, Timing, read_timing};

/// Version of the columns.
pub const RECORD_VERSION: i32 = 7;

/// What a row is about: the words of column `kind`.
pub mod kind {
    /// One vertex of the target.
    pub const CORNER: &str = "corner";
    /// One answer that belongs to no vertex asked for.
    pub const FALSE_CORNER: &str = "false_corner";
    /// One point of the image that looks like a vertex of the target and is none.
    pub const FALSE_JUNCTION: &str = "false_junction";
    /// The target region, the face and the grasp point of one exposure.
    pub const GRASP: &str = "grasp";
    /// A scene that could not be read.
    pub const SCENE: &str = "scene";
    /// An exposure to which another program gave no answer.
    pub const FAILURE: &str = "failure";
}

/// What is judged: the words of column `track`.
pub mod track {
    /// A detector, and a refiner of its answers.
    pub const END_TO_END: &str = "end_to_end";
    /// A refiner alone: seeds are given.
    pub const REFINEMENT: &str = "refinement";
}

/// What became of it: the words of column `status`.
pub mod status {
    /// A visible corner that was found; a grasp point that was computed.
    pub const OK: &str = "ok";
    /// A visible corner that was not found.
    pub const MISSED: &str = "missed";
    /// A corner that is not visible: neither asked for nor counted.
    pub const HIDDEN: &str = "hidden";
    /// A corner of whose edges too little is seen: neither asked for nor counted.
    pub const TOO_SMALL: &str = "too_small";
    /// A corner whose place noise hides: neither asked for nor counted.
    pub const TOO_UNCERTAIN: &str = "too_uncertain";
    /// An answer in a picture of which nobody knows the corners: neither right nor wrong.
    pub const UNKNOWN: &str = "unknown";
    /// An answer where no corner is.
    pub const FALSE: &str = "false";
    /// An answer at a corner that is not asked for: neither right nor wrong.
    pub const IGNORED: &str = "ignored";
    /// A false junction at which an answer lies.
    pub const ANSWERED: &str = "answered";
    /// A false junction at which none does.
    pub const SILENT: &str = "silent";
    /// No pixel has the target's colour.
    pub const NO_TARGET: &str = "no_target";
    /// The target was found, no corner was.
    pub const NO_CORNER: &str = "no_corner";
    /// Corners were found, no face was.
    pub const NO_FACE: &str = "no_face";
    /// A face was chosen, the range sensor saw nothing there.
    pub const NO_RANGE: &str = "no_range";
    /// No grasp point could be computed from the face: the reason says why.
    pub const NO_GRASP: &str = "no_grasp";
    /// A face was chosen, and the program that estimates a grasp gave no answer.
    pub const FAILED: &str = "failed";
    /// A file of the scene is missing, truncated or altered.
    pub const UNREADABLE: &str = "unreadable";
}

/// One row: a scene, an exposure, a method, and a corner, a false corner, a false junction or a grasp.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, ParquetRecordWriter)]
#[serde(default, deny_unknown_fields)]
pub struct Record {
    /// [`RECORD_VERSION`].
    pub record_version: i32,
    /// Version of cornerbench that measured.
    pub cornerbench_version: String,
    /// The suite.
    pub suite: String,
    /// The scene.
    pub scene: String,
    /// Hash of what the scene was rendered from.
    pub scene_recipe_sha256: String,
    /// The family the scene was drawn from.
    pub family: String,
    /// Name of the camera's pose.
    pub pose: String,
    /// "dev" or "test".
    pub split: Option<String>,
    /// Name of the camera model.
    pub camera: String,
    /// Of drawn junctions their cell: the kind and all that differs in the plan; `scene` is a block of them.
    pub cell: Option<String>,
    /// What drawn junctions are of: "grey" or "red".
    pub surface: Option<String>,
    /// Blur that the cell has instead of the camera's: standard deviation of a Gaussian \[px\].
    pub gaussian_sigma_px: Option<f64>,
    /// The same: radius of the disc of a point out of focus \[px\].
    pub defocus_radius_px: Option<f64>,
    /// The same: radius of the first dark ring of the diffraction pattern \[px\].
    pub airy_radius_px: Option<f64>,
    /// The same: length of a uniform straight motion \[px\].
    pub motion_length_px: Option<f64>,
    /// The largest difference of a drawn junction's levels over the read noise.
    pub contrast_over_noise: Option<f64>,
    /// How much brighter each of its sectors becomes, as a share of that difference \[1/px\].
    pub ramp_per_px: Option<f64>,
    /// How far along its first edge another corner is \[px\].
    pub neighbour_px: Option<f64>,
    /// Radius of the circle that rounds it \[px\].
    pub rounding_px: Option<f64>,
    /// Which of the camera's photographs of the scene: phase by phase, at each the repeats.
    pub exposure: Option<i32>,
    /// Where in the film's image the centre of pixel (0, 0) is \[px\].
    pub phase_x_px: Option<f64>,
    /// Where in the film's image the centre of pixel (0, 0) is \[px\].
    pub phase_y_px: Option<f64>,
    /// Standard deviation of the camera's blur and the pixel's area along one axis \[px\].
    pub blur_px: Option<f64>,
    /// Name of the pipeline.
    pub method: String,
    /// One of [`track`].
    pub track: String,
    /// On the refinement track the radius of the disc about the true corner in which seeds are \[px\].
    pub seed_disc_px: Option<f64>,
    /// Target extractor and its version: "red_difference 1"; null where the whole image is searched.
    pub target_extractor: Option<String>,
    /// Detector and its version; null on the refinement track.
    pub detector: Option<String>,
    /// Refiner and its version.
    pub refiner: String,
    /// Face selector and its version; null of a pipeline that ends with corners.
    pub face_selector: Option<String>,
    /// Grasp estimator and its version; null of a pipeline that ends with corners.
    pub grasp_estimator: Option<String>,
    /// One of [`kind`].
    pub kind: String,
    /// One of [`status`].
    pub status: String,
    /// Why, where the status alone does not say it.
    pub reason: Option<String>,
    /// Share of the target's image area that nothing hides.
    pub target_visible_fraction: Option<f64>,

    /// Vertex of the target.
    pub corner_index: Option<i32>,
    /// "visible", "self-occluded", "occluded", "outside".
    pub visibility: Option<String>,
    /// What a visible corner looks like: "L", "Y", "arrow", "X", "edge end".
    pub junction: Option<String>,
    /// Smallest angle between two edges of a corner asked for \[degrees\].
    pub junction_angle_deg: Option<f64>,
    /// How far a visible corner's second longest edge is seen from it \[px\].
    pub second_edge_px: Option<f64>,
    /// The second largest contrast of a visible corner's edges, before the camera's curve and noise
    /// \[share of full scale\].
    pub contrast_fraction: Option<f64>,
    /// Distance in the image from a visible corner to where something nearer begins \[px\]; null beyond 64.
    pub nearest_occluder_px: Option<f64>,
    /// Least root mean square error that the exposure's noise allows, from the first 10 px of a visible
    /// corner's edges, their directions unknown \[px\]; null where they bound nothing.
    pub bound_px: Option<f64>,
    /// The same of the pixels within 5 px, numerically: levels, ramps, directions and blur unknown \[px\].
    pub bound_r5_px: Option<f64>,
    /// The same of the pixels within 10 px \[px\].
    pub bound_r10_px: Option<f64>,
    /// The same of the pixels within 15 px \[px\].
    pub bound_r15_px: Option<f64>,
    /// In closed form from all that is seen of the corner's edges \[px\].
    pub bound_edges_px: Option<f64>,
    /// In closed form from all edges of one cuboid of unknown size, the camera calibrated \[px\].
    pub bound_object_px: Option<f64>,
    /// Error of the true corner's place that the render's noise alone enforces \[px\].
    pub render_noise_floor_px: Option<f64>,
    /// True position, of a false junction its own \[px\].
    pub true_x_px: Option<f64>,
    /// True position, of a false junction its own \[px\].
    pub true_y_px: Option<f64>,
    /// The detector's position \[px\].
    pub detected_x_px: Option<f64>,
    /// The detector's position \[px\].
    pub detected_y_px: Option<f64>,
    /// The detector's response, in its own unit; at a false junction the strongest of the answers there.
    pub response: Option<f64>,
    /// The largest threshold on the response with which this corner is found, whichever answer within the
    /// gate finds it.
    pub found_at_response: Option<f64>,
    /// Where an answer lies that belongs to no corner asked for: "duplicate" (at one that has another), "T",
    /// "shadow", "texture", "distractor", "room" (at a false junction of that cause), "edge" (of the target),
    /// "target", "object", "background"; of an ignored one "hidden corner", "small corner", "uncertain
    /// corner". Of a false junction its cause.
    pub cause: Option<String>,
    /// Distance of such an answer from the nearest corner asked for \[px\].
    pub nearest_corner_px: Option<f64>,
    /// The refiner's position \[px\].
    pub refined_x_px: Option<f64>,
    /// The refiner's position \[px\].
    pub refined_y_px: Option<f64>,
    /// "ok", "max_iterations", "reverted", "diverged", "singular", "out_of_bounds", "not_applicable",
    /// "false_corner", "failed".
    pub refine_status: Option<String>,
    /// The refiner's covariance of its position, where it has one \[px^2\].
    pub covariance_xx_px2: Option<f64>,
    /// The refiner's covariance of its position, where it has one \[px^2\].
    pub covariance_xy_px2: Option<f64>,
    /// The refiner's covariance of its position, where it has one \[px^2\].
    pub covariance_yy_px2: Option<f64>,
    /// Iterations of the refiner.
    pub iterations: Option<i32>,
    /// Distance of the detector's position from the truth \[px\].
    pub detected_error_px: Option<f64>,
    /// Distance of the refiner's position from the truth \[px\].
    pub refined_error_px: Option<f64>,
    /// Its part along the bisector of the corner's smallest angle, positive into the angle \[px\].
    pub refined_along_px: Option<f64>,
    /// Its part across that, positive where that axis turned from x towards y by a quarter points \[px\].
    pub refined_across_px: Option<f64>,

    /// Answers of the method in this exposure.
    pub answers: Option<i32>,
    /// The true face that the chosen quadrilateral covers; null when it covers none.
    pub chosen_face: Option<i32>,
    /// The true face that is least occluded.
    pub least_occluded_face: Option<i32>,
    /// Whether the chosen face is that one, or as little occluded to half a percent of its area.
    pub face_is_right: Option<bool>,
    /// Share of the chosen face's pixels that are not the target's, as the method saw it.
    pub face_gap_fraction: Option<f64>,
    /// Cuboids that were fitted to what is seen of which no two are the same.
    pub face_hypotheses: Option<i32>,
    /// By what share the chosen one has more evidence than the next; 1 where there is no other.
    pub face_margin: Option<f64>,
    /// The image point whose range was looked up \[px\].
    pub grasp_x_px: Option<f64>,
    /// The image point whose range was looked up \[px\].
    pub grasp_y_px: Option<f64>,
    /// Distance of that image point from the projected centre of the true face \[px\].
    pub grasp_image_error_px: Option<f64>,
    /// The grasp point in the world \[m\].
    pub grasp_world_x_m: Option<f64>,
    /// The grasp point in the world \[m\].
    pub grasp_world_y_m: Option<f64>,
    /// The grasp point in the world \[m\].
    pub grasp_world_z_m: Option<f64>,
    /// Distance of the grasp point from the centre of the true face \[mm\]: of the chosen face, or
    /// of the least occluded one where the quadrilateral covers none.
    pub grasp_error_mm: Option<f64>,
    /// Its part along the optical axis, positive when too far \[mm\].
    pub grasp_axial_error_mm: Option<f64>,
    /// Its part across the optical axis \[mm\].
    pub grasp_lateral_error_mm: Option<f64>,
    /// Its part along the true face's outward normal, positive when in front of it \[mm\].
    pub grasp_normal_error_mm: Option<f64>,
    /// Its part in the true face \[mm\].
    pub grasp_in_face_error_mm: Option<f64>,
    /// What the method says of its error: the root of the sum of its variances \[mm\].
    pub grasp_sigma_mm: Option<f64>,
    /// The error's square over the covariance that the method says: 3 on average where that is right.
    pub grasp_nees: Option<f64>,
    /// Out of the face, the way a gripper comes from, in the world.
    pub approach_world_x: Option<f64>,
    /// The same.
    pub approach_world_y: Option<f64>,
    /// The same.
    pub approach_world_z: Option<f64>,
    /// The way the jaws move, in the world.
    pub jaw_world_x: Option<f64>,
    /// The same.
    pub jaw_world_y: Option<f64>,
    /// The same.
    pub jaw_world_z: Option<f64>,
    /// How far they are apart when they touch \[m\].
    pub opening_m: Option<f64>,
    /// Between the approach and the true face's normal \[deg\].
    pub approach_error_deg: Option<f64>,
    /// What the method says of that \[deg\].
    pub approach_sigma_deg: Option<f64>,
    /// Between the jaws' way and the true face's shorter side, either side of a square \[deg\].
    pub jaw_error_deg: Option<f64>,
    /// Of the opening, positive when too wide \[mm\].
    pub opening_error_mm: Option<f64>,
    /// Mean distance of the cuboid's vertices, of all rotations that leave it the same the least \[mm\].
    pub pose_add_mm: Option<f64>,
    /// Mean distance of the true vertices from the nearest \[mm\].
    pub pose_add_s_mm: Option<f64>,
    /// Largest distance of a vertex, of all such rotations the least \[mm\].
    pub pose_mssd_mm: Option<f64>,
    /// The same in the image \[px\].
    pub pose_mspd_px: Option<f64>,
}

/// Writes records as one Parquet file, in one group of rows.
///
/// # Errors
/// [`Error::Io`], or [`Error::Malformed`] from the encoder.
pub fn write_records(path: &Path, records: &[Record]) -> Result<()> {
    write_rows(path, records)
}

fn write_rows<T>(path: &Path, rows: &[T]) -> Result<()>
where
    for<'a> &'a [T]: RecordWriter<T>,
{
    let failed = |error| Error::malformed(path, error);
    let mut writer = writer::<T>(path)?;
    let mut group = writer.next_row_group().map_err(failed)?;
    rows.write_to_row_group(&mut group).map_err(failed)?;
    group.close().map_err(failed)?;
    writer.close().map_err(failed)?;
    Ok(())
}

fn writer<T>(path: &Path) -> Result<SerializedFileWriter<File>>
where
    for<'a> &'a [T]: RecordWriter<T>,
{
    let file = File::create(path).map_err(Error::io(path, "create"))?;
    let failed = |error| Error::malformed(path, error);
    let none: &[T] = &[];
    let schema = none.schema().map_err(failed)?;
    let properties = WriterProperties::builder()
        .set_compression(parquet::basic::Compression::SNAPPY)
        .set_created_by(concat!("cornerbench ", env!("CARGO_PKG_VERSION")).to_owned())
        .build();
    SerializedFileWriter::new(file, schema, Arc::new(properties)).map_err(failed)
}

/// Writes one Parquet file of groups of rows that others have, each named by its file and its place there, as
/// they are: the bytes do not depend on where a group comes from.
///
/// # Errors
/// [`Error::Io`], or [`Error::Malformed`] where a file is no Parquet or has no such group.
pub fn join_records<'a>(
    path: &Path,
    groups: impl Iterator<Item = (&'a Path, usize)>,
) -> Result<()> {
    let mut writer = writer::<Record>(path)?;
    let mut open: Option<(&Path, File, ParquetMetaData)> = None;
    for (from, index) in groups {
        let failed = |error| Error::malformed(from, error);
        if open.as_ref().is_none_or(|(path, ..)| *path != from) {
            let file = File::open(from).map_err(Error::io(from, "read"))?;
            let metadata = ParquetMetaDataReader::new().parse_and_finish(&file).map_err(failed)?;
            open = Some((from, file, metadata));
        }
        let Some((_, file, metadata)) = &open else { continue };
        let Some(group) = metadata.row_groups().get(index) else {
            return Err(Error::malformed(from, format!("has no group of rows {index}")));
        };
        let mut joined = writer.next_row_group().map_err(failed)?;
        for column in group.columns() {
            let copied = ColumnCloseResult {
                bytes_written: column.compressed_size().unsigned_abs(),
                rows_written: group.num_rows().unsigned_abs(),
                metadata: column.clone(),
                bloom_filter: None,
                column_index: None,
                offset_index: None,
            };
            joined.append_column(file, copied).map_err(failed)?;
        }
        joined.close().map_err(failed)?;
    }
    writer.close().map_err(|error| Error::malformed(path, error))?;
    Ok(())
}

/// Reads the records of one Parquet file.
///
/// # Errors
/// When the file is missing, not Parquet, or its columns are another version's.
pub fn read_records(path: &Path) -> Result<Vec<Record>> {
    let file = RecordFile::open(path)?;
    let mut records = Vec::new();
    for group in 0..file.groups() {
        records.append(&mut file.read(group, &[])?);
    }
    Ok(records)
}

/// A Parquet file of records, to be read group by group.
pub struct RecordFile {
    path: PathBuf,
    reader: SerializedFileReader<File>,
}

impl RecordFile {
    /// Opens it.
    ///
    /// # Errors
    /// When the file is missing or not Parquet.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(Error::io(path, "read"))?;
        let reader =
            SerializedFileReader::new(file).map_err(|error| Error::malformed(path, error))?;
        Ok(Self { path: path.to_owned(), reader })
    }

    /// How many groups of rows it has: one of each scene, or of each cell of drawn junctions and camera.
    pub fn groups(&self) -> usize {
        self.reader.num_row_groups()
    }

    /// Reads a group: the columns that are named, `record_version` among them, or all where none is. Of those that are
    /// not read records have nothing.
    ///
    /// # Errors
    /// When the group cannot be read, or its columns are another version's.
    pub fn read(&self, group: usize, columns: &[&str]) -> Result<Vec<Record>> {
        self.read_where(group, columns, |_, _| true)
    }

    /// Reads the rows of a group whose camera and method are wanted.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_where(
        &self,
        group: usize,
        columns: &[&str],
        is_wanted: impl Fn(&str, &str) -> bool,
    ) -> Result<Vec<Record>> {
        let mut records = Vec::new();
        self.for_each(group, columns, is_wanted, |record| records.push(record))?;
        Ok(records)
    }

    /// Calls `f` with the rows of a group whose camera and method are wanted, one after the other.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn for_each(
        &self,
        group: usize,
        columns: &[&str],
        is_wanted: impl Fn(&str, &str) -> bool,
        mut f: impl FnMut(Record),
    ) -> Result<()> {
        let failed = |error| Error::malformed(&self.path, error);
        let schema = self.reader.metadata().file_metadata().schema();
        let wanted = (!columns.is_empty()).then(|| {
            let fields = schema.get_fields().iter();
            let fields = fields.filter(|field| columns.contains(&field.name())).cloned();
            Type::group_type_builder(schema.name()).with_fields(fields.collect()).build()
        });
        let wanted = wanted.transpose().map_err(failed)?;
        let group = self.reader.get_row_group(group).map_err(failed)?;
        for (index, row) in group.get_row_iter(wanted).map_err(failed)?.enumerate() {
            let row = row.map_err(failed)?;
            let text = |name: &str| match row.get_column_iter().find(|(other, _)| *other == name) {
                Some((_, Field::Str(text))) => text.as_str(),
                _ => "",
            };
            if !is_wanted(text("camera"), text("method")) {
                continue;
            }
            let row = row.to_json_value();
            let version = row.get("record_version").and_then(serde_json::Value::as_i64);
            if version != Some(RECORD_VERSION.into()) {
                let found = version.map_or_else(|| "none".to_owned(), |found| found.to_string());
                let problem = format!(
                    "records of version {found}, this program reads {RECORD_VERSION}; measure again"
                );
                return Err(Error::malformed(&self.path, problem));
            }
            f(serde_json::from_value::<Record>(row)
                .map_err(|error| Error::malformed(&self.path, format!("row {index}: {error}")))?);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_read_back_as_they_were_written_nulls_included() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("records.parquet");
        let first = Record {
            record_version: RECORD_VERSION,
            scene: "a".into(),
            true_x_px: Some(0.125),
            face_is_right: Some(true),
            ..Record::default()
        };
        let second =
            Record { record_version: RECORD_VERSION, reason: Some("ü".into()), ..first.clone() };
        let written = vec![first, second];
        write_records(&path, &written).expect("written");
        assert_eq!(read_records(&path).expect("read"), written);
    }

    #[test]
    fn records_of_another_version_are_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("records.parquet");
        write_records(&path, &[Record { record_version: 99, ..Record::default() }]).expect("ok");
        let error = read_records(&path).expect_err("version 99");
        assert!(error.to_string().contains("version 99"), "{error}");
    }
}
