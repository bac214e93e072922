//! The paper's figures 2 to 5, with truth.

use std::fs;
use std::path::Path;

use serde::Serialize;

use crate::error::{Error, Result};
use crate::geometry::ImagePoint;
use crate::record::{Record, Sketch, pictures_folder};
use crate::report::svg::{Drawing, Marker, View, png_address};

/// How wide a figure is drawn on a screen \[screen px\].
const WIDTH: f64 = 560.0;
/// How wide a magnified corner is drawn \[screen px\], and how much of the image it shows \[px\].
const PATCH_WIDTH: f64 = 200.0;
const PATCH_PX: f64 = 14.0;

/// A picture of the report.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Figure {
    /// File name within the report's folder.
    pub file: String,
    /// The paper's figure that it answers to, and what it shows.
    pub caption: String,
    /// Which group it belongs to: "scene", "depth", "target", "corners", "patch", "grasp", "worst".
    pub group: &'static str,
    #[serde(skip)]
    pub svg: String,
}

/// Draws the figures of one scene, camera and method.
pub(super) fn draw(
    run: &Path,
    camera: &str,
    method: &str,
    sketch: &Sketch,
    rows: &[&Record],
) -> Result<Vec<Figure>> {
    let folder = pictures_folder(run, &sketch.scene, camera);
    let png = |name: &str| -> Result<String> {
        let path = folder.join(name);
        Ok(png_address(&fs::read(&path).map_err(Error::io(&path, "read"))?))
    };
    let (width, height) = (sketch.width, sketch.height);
    let whole = View { x: -0.5, y: -0.5, width: f64::from(width), height: f64::from(height) };
    let close = close_up(sketch);
    let exposure = png("exposure.png")?;
    let name = |part: &str| format!("{method}-{camera}-{}-{part}.svg", sketch.scene);
    let mut figures = Vec::new();
    let mut add = |group: &'static str, part: &str, caption: String, drawing: Drawing| {
        let svg = drawing.finish(&format!("{}: {caption}", sketch.scene));
        figures.push(Figure { file: name(part), caption, group, svg });
    };

    let mut scene = Drawing::new(whole, WIDTH);
    scene.picture(&exposure, width, height);
    add("scene", "fig2-scene", "Figure 2, scene: the colour camera's image".to_owned(), scene);

    let mut depth = Drawing::new(whole, WIDTH);
    depth.picture(&png("depth.png")?, width, height);
    let [near, far] = sketch.depth_range_m;
    let caption = format!("Figure 2, depth: from {near:.2} m (yellow) to {far:.2} m (violet)");
    add("depth", "fig2-depth", caption, depth);

    let mut target = Drawing::new(whole, WIDTH);
    let caption = if let (Some(corners), Some([x0, y0, x1, y1])) =
        (&sketch.quadrilateral, sketch.target_range)
    {
        target.picture(&png(&format!("{method}-target.png"))?, width, height);
        target.outline(corners, "#ffd400");
        format!(
            "Figure 3, target: {} red pixels in columns {x0} to {x1}, rows {y0} to {y1}, and the \
             smallest circumscribed quadrilateral",
            sketch.target_pixels
        )
    } else {
        target.picture(&exposure, width, height);
        "Figure 3, target: no red region was found".to_owned()
    };
    add("target", "fig3-target", caption, target);

    let mut corners = Drawing::new(close, WIDTH);
    corners.picture(&exposure, width, height);
    draw_corners(&mut corners, sketch, rows);
    let caption =
        "Figure 4, corners: detected (square), refined (ring), true (cross); thin lines are \
                   the true edges"
            .to_owned();
    add("corners", "fig4-corners", caption, corners);

    for (index, record) in magnified(rows).iter().enumerate() {
        let (Some(x), Some(y)) = (record.true_x_px, record.true_y_px) else { continue };
        let view = View {
            x: x - 0.5 * PATCH_PX,
            y: y - 0.5 * PATCH_PX,
            width: PATCH_PX,
            height: PATCH_PX,
        };
        let mut patch = Drawing::new(view, PATCH_WIDTH);
        patch.picture(&exposure, width, height);
        draw_corners(&mut patch, sketch, rows);
        let caption = format!(
            "corner {}: {} px before, {} px after",
            record.corner_index.unwrap_or(-1),
            crate::report::words::px(record.detected_error_px),
            crate::report::words::px(record.refined_error_px),
        );
        add("patch", &format!("fig4-corner{index}"), caption, patch);
    }

    let mut grasp = Drawing::new(close, WIDTH);
    grasp.picture(&exposure, width, height);
    if let Some(face) = &sketch.true_face {
        grasp.outline(face, "#fff");
    }
    let mut caption = "Figure 5, grasp: the least occluded true face (white)".to_owned();
    if let Some(face) = &sketch.face {
        grasp.outline(face, "#00e5ff");
        caption.push_str(", the chosen face (cyan)");
    } else {
        caption.push_str("; no face was chosen");
    }
    if let Some(point) = sketch.true_grasp {
        grasp.marker(point, Marker::True);
        caption.push_str(", its true centre (cross)");
    }
    if let Some(point) = sketch.grasp {
        grasp.marker(point, Marker::Grasp);
        caption.push_str(", the grasp point (star)");
    }
    add("grasp", "fig5-grasp", caption, grasp);
    Ok(figures)
}

fn draw_corners(drawing: &mut Drawing, sketch: &Sketch, rows: &[&Record]) {
    for [from, to] in &sketch.true_edges {
        drawing.line(*from, *to, "rgba(255,255,255,0.55)");
    }
    let point = |x: Option<f64>, y: Option<f64>| Some(ImagePoint::new(x?, y?));
    for record in rows {
        if let Some(at) = point(record.detected_x_px, record.detected_y_px) {
            drawing.marker(at, Marker::Detected);
        }
    }
    for record in rows {
        if let Some(at) = point(record.refined_x_px, record.refined_y_px) {
            drawing.marker(at, Marker::Refined);
        }
        let visible = record.visibility.as_deref() == Some("visible");
        if let Some(at) = point(record.true_x_px, record.true_y_px).filter(|_| visible) {
            drawing.marker(at, Marker::True);
        }
    }
}

/// Found corners, those with the largest difference between detector and refiner first, six at most.
fn magnified<'a>(rows: &[&'a Record]) -> Vec<&'a Record> {
    let moved = |record: &Record| {
        let dx = record.refined_x_px? - record.detected_x_px?;
        Some(dx.hypot(record.refined_y_px? - record.detected_y_px?))
    };
    let mut found: Vec<&Record> =
        rows.iter().copied().filter(|record| record.detected_error_px.is_some()).collect();
    found.sort_by(|a, b| moved(b).unwrap_or(0.0).total_cmp(&moved(a).unwrap_or(0.0)));
    found.truncate(6);
    found
}

/// The square around the true target and what was taken for it, kept inside the image.
fn close_up(sketch: &Sketch) -> View {
    let ends = sketch.true_edges.iter().flatten().chain(sketch.quadrilateral.iter().flatten());
    let (mut x0, mut y0, mut x1, mut y1) = (f64::MAX, f64::MAX, f64::MIN, f64::MIN);
    for point in ends {
        (x0, y0) = (x0.min(point.x), y0.min(point.y));
        (x1, y1) = (x1.max(point.x), y1.max(point.y));
    }
    let (width, height) = (f64::from(sketch.width), f64::from(sketch.height));
    let side = ((x1 - x0).max(y1 - y0) + 24.0).max(24.0).min(width.min(height));
    let place = |low: f64, high: f64, extent: f64| {
        (0.5 * (low + high) - 0.5 * side).clamp(-0.5, extent - 0.5 - side)
    };
    View { x: place(x0, x1, width), y: place(y0, y1, height), width: side, height: side }
}
