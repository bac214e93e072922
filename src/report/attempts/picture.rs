//! Success over the error of corners: a line for each estimator where corners were moved on purpose, a dot for each
//! method that found them. And risk over coverage: a line for each method.

use std::collections::BTreeMap;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{AttemptSummary, MethodAttempts};
use crate::error::{Error, Result};

const SIZE_PX: (u32, u32) = (820, 480);
const LINES: [RGBColor; 6] = [
    RGBColor(0, 84, 159),
    RGBColor(200, 30, 30),
    RGBColor(20, 130, 60),
    RGBColor(150, 80, 170),
    RGBColor(220, 120, 0),
    RGBColor(90, 90, 90),
];
const DOTS: RGBColor = RGBColor(40, 40, 40);
// Names of no more dots than these stand in the picture: the best ones.
const NAMED: usize = 8;
// Height of a line of names on the axis of percents.
const LINE: f64 = 4.0;
// Width of a name, and of the gap between it and its dot, as shares of the axis.
const NAME: f64 = 0.2;
const GAP: f64 = 0.012;

/// A point of the picture.
struct Point<'a> {
    error_px: f64,
    percent: f64,
    between: [f64; 2],
    of: &'a MethodAttempts,
}

/// Draws it as an SVG; `None` where no corner has a known error.
///
/// # Errors
/// [`Error::Other`] from the drawing library.
pub(super) fn success(summary: &AttemptSummary) -> Result<Option<String>> {
    let points: Vec<Point> = summary
        .methods
        .iter()
        .filter_map(|of| {
            let (error_px, success) = (of.corner_rmse_px?, of.success?);
            let percent = 100.0 * success.value;
            let between = [success.low, success.high].map(|end| end.map_or(percent, |e| 100.0 * e));
            Some(Point { error_px, percent, between, of })
        })
        .collect();
    if points.is_empty() {
        return Ok(None);
    }
    let mut lines: BTreeMap<(&str, &str), Vec<&Point>> = BTreeMap::new();
    let mut dots = Vec::new();
    for point in &points {
        match (&point.of.grasp_estimator, &point.of.camera) {
            (Some(estimator), Some(camera)) if point.of.seed_disc_px.is_some() => {
                lines.entry((estimator, camera)).or_default().push(point);
            }
            _ => dots.push(point),
        }
    }
    let most_px = points.iter().map(|point| point.error_px).fold(0.1, f64::max) * 1.05;
    let mut text = String::new();
    paint(&mut text, summary, most_px, &mut lines, &dots).map_err(|error| {
        Error::Other(format!("the picture of success over the error of corners: {error}"))
    })?;
    Ok(Some(text))
}

type Outcome<'a> =
    std::result::Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

fn paint<'a>(
    text: &'a mut String,
    summary: &AttemptSummary,
    most_px: f64,
    lines: &mut BTreeMap<(&str, &str), Vec<&Point>>,
    dots: &[&Point],
) -> Outcome<'a> {
    let root = SVGBackend::with_string(text, SIZE_PX).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(14)
        .caption(format!("{} with {}", summary.robot, summary.gripper), ("sans-serif", 16))
        .x_label_area_size(40)
        .y_label_area_size(52)
        .build_cartesian_2d(0.0..most_px, 0.0..103.0)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .y_labels(6)
        .label_style(("sans-serif", 13))
        .axis_desc_style(("sans-serif", 14))
        .x_desc("root mean square error of the corners, px")
        .y_desc("grasps that succeed, %")
        .draw()?;
    let cameras: std::collections::BTreeSet<&str> = lines.keys().map(|key| key.1).collect();
    for (((estimator, camera), points), colour) in lines.iter_mut().zip(LINES.iter().cycle()) {
        points.sort_by(|a, b| a.error_px.total_cmp(&b.error_px));
        let line = points.iter().map(|point| (point.error_px, point.percent));
        let name = estimator.split(' ').next().unwrap_or(estimator);
        let name = if cameras.len() > 1 { format!("{name}, {camera}") } else { name.to_owned() };
        let colour = *colour;
        chart
            .draw_series(LineSeries::new(line, colour.stroke_width(2)))?
            .label(format!("{name}, corners moved"))
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
        let whiskers = points.iter().map(|point| {
            let [low, high] = point.between;
            PathElement::new([(point.error_px, low), (point.error_px, high)], colour)
        });
        chart.draw_series(whiskers)?;
    }
    for point in dots {
        let at = (point.error_px, point.percent);
        let [low, high] = point.between;
        let whisker = PathElement::new([(at.0, low), (at.0, high)], DOTS.mix(0.4));
        chart.draw_series([whisker])?;
        chart.draw_series([Circle::new(at, 4, DOTS.filled())])?;
    }
    // Names below one another where they would stand on one another, the most successful first.
    let mut taken: Vec<(f64, f64)> = Vec::new();
    for point in dots.iter().take(NAMED) {
        let (x, mut y) = (point.error_px, point.percent);
        while let Some(other) = taken
            .iter()
            .find(|other| (other.0 - x).abs() < NAME * most_px && (other.1 - y).abs() < LINE)
        {
            y = other.1 - LINE;
        }
        taken.push((x, y));
        let is_right = x > 0.7 * most_px;
        let side = if is_right { HPos::Right } else { HPos::Left };
        let beside = if is_right { x - GAP * most_px } else { x + GAP * most_px };
        let style = ("sans-serif", 12).into_font().color(&DOTS).pos(Pos::new(side, VPos::Center));
        chart.draw_series([Text::new(point.of.method.clone(), (beside, y), style)])?;
    }
    if !lines.is_empty() {
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.8))
            .label_font(("sans-serif", 13))
            .draw()?;
    }
    root.present()
}

/// Draws the share of failures over the share of grasps that are carried out, the most certain first, as an SVG; `None`
/// where no method states how certain it is.
///
/// # Errors
/// [`Error::Other`] from the drawing library.
pub(super) fn risk(summary: &AttemptSummary) -> Result<Option<String>> {
    let stating = |method: &&MethodAttempts| {
        !method.is_control && !method.is_moved() && method.risk_coverage.len() > 1
    };
    let methods: Vec<&MethodAttempts> =
        summary.methods.iter().filter(stating).take(LINES.len()).collect();
    if methods.is_empty() {
        return Ok(None);
    }
    let mut text = String::new();
    paint_risk(&mut text, summary, &methods)
        .map_err(|error| Error::Other(format!("the picture of risk over coverage: {error}")))?;
    Ok(Some(text))
}

fn paint_risk<'a>(
    text: &'a mut String,
    summary: &AttemptSummary,
    methods: &[&MethodAttempts],
) -> Outcome<'a> {
    let points = methods.iter().flat_map(|method| &method.risk_coverage);
    let most = points.map(|point| 100.0 * point.risk).fold(5.0, f64::max) * 1.1;
    let root = SVGBackend::with_string(text, SIZE_PX).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(14)
        .caption(format!("{} with {}", summary.robot, summary.gripper), ("sans-serif", 16))
        .x_label_area_size(40)
        .y_label_area_size(52)
        .build_cartesian_2d(0.0..100.0, 0.0..most)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .label_style(("sans-serif", 13))
        .axis_desc_style(("sans-serif", 14))
        .x_desc("scenes in which a grasp is carried out, the most certain first, %")
        .y_desc("grasps that fail, %")
        .draw()?;
    let cameras: std::collections::BTreeSet<_> = methods.iter().map(|of| &of.camera).collect();
    for (method, colour) in methods.iter().zip(LINES) {
        let curve = &method.risk_coverage;
        let line = curve.iter().map(|point| (100.0 * point.coverage, 100.0 * point.risk));
        let end = line.clone().next_back();
        let name = match &method.camera {
            Some(camera) if cameras.len() > 1 => format!("{}, {camera}", method.method),
            _ => method.method.clone(),
        };
        chart
            .draw_series(LineSeries::new(line, colour.stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
        chart.draw_series(end.map(|at| Circle::new(at, 4, colour.filled())))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(WHITE.mix(0.8))
        .label_font(("sans-serif", 13))
        .draw()?;
    root.present()
}
