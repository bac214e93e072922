//! The corners that a refiner misses most, as they look.

use std::io::Cursor;
use std::path::Path;

use crate::error::{Error, Result};
use crate::geometry::ImagePoint;
use crate::record::{Record, kind, pictures_folder, status};
use crate::report::figures::Figure;
use crate::report::svg::{Drawing, Marker, View, png_address};
use crate::report::words;

/// How many corners of a refiner are shown.
const MOST: usize = 6;
/// How wide one is drawn on a screen \[screen px\], and how much of the image it shows to each side \[px\].
const WIDTH: f64 = 200.0;
const REACH_PX: u32 = 16;

/// Draws the corners, of those that were found, that one method's refiner answers worst, or declines.
pub(super) fn draw(run: &Path, method: &str, records: &[&Record]) -> Result<Vec<Figure>> {
    let mut found: Vec<(&Record, f64)> = records
        .iter()
        .filter(|record| record.kind == kind::CORNER && record.status == status::OK)
        .filter_map(|record| Some((*record, record.refined_error_px?)))
        .collect();
    found.sort_by(|a, b| b.1.total_cmp(&a.1));
    found
        .into_iter()
        .take(MOST)
        .enumerate()
        .filter_map(|(index, (record, error_px))| {
            let truth = point(record.true_x_px, record.true_y_px)?;
            Some(patch(run, method, index, record, error_px, truth))
        })
        .collect()
}

fn point(x: Option<f64>, y: Option<f64>) -> Option<ImagePoint> {
    Some(ImagePoint::new(x?, y?))
}

fn patch(
    run: &Path,
    method: &str,
    index: usize,
    record: &Record,
    error_px: f64,
    truth: ImagePoint,
) -> Result<Figure> {
    let path = pictures_folder(run, &record.scene, &record.camera).join("exposure.png");
    let picture = image::open(&path).map_err(|error| {
        Error::malformed(&path, format!("cannot be read as a picture: {error}"))
    })?;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in the image")]
    let [left, top] =
        [truth.x, truth.y].map(|place| (place.round().max(0.0) as u32).saturating_sub(REACH_PX));
    let side = 2 * REACH_PX + 1;
    let crop = picture.crop_imm(left, top, side, side);
    let mut png = Vec::new();
    crop.write_to(&mut Cursor::new(&mut png), image::ImageFormat::Png)
        .map_err(|error| Error::Other(format!("{}: a part of it: {error}", path.display())))?;
    let place = |pixel: u32| f64::from(pixel) - 0.5;
    let (width, height) = (f64::from(crop.width()), f64::from(crop.height()));
    let mut drawing = Drawing::new(View { x: place(left), y: place(top), width, height }, WIDTH);
    drawing.picture_at(&png_address(&png), [left, top], [crop.width(), crop.height()]);
    let points = [
        (point(record.detected_x_px, record.detected_y_px), Marker::Detected),
        (point(record.refined_x_px, record.refined_y_px), Marker::Refined),
        (Some(truth), Marker::True),
    ];
    for (at, marker) in points {
        if let Some(at) = at {
            drawing.marker(at, marker);
        }
    }
    let occluder = record.nearest_occluder_px.map_or_else(
        || "nothing before it".to_owned(),
        |occluder_px| format!("{occluder_px:.0} px beside what is before it"),
    );
    let caption = format!(
        "{}, corner {} ({}), {}: {} px, {occluder}",
        record.scene,
        record.corner_index.unwrap_or(-1),
        record.junction.as_deref().unwrap_or("-"),
        record.refine_status.as_deref().unwrap_or("-").replace('_', " "),
        words::px(Some(error_px)),
    );
    let svg = drawing.finish(&caption);
    Ok(Figure {
        file: format!("{method}-{}-worst{index}.svg", record.camera),
        caption,
        group: "worst",
        svg,
    })
}
