//! The front: methods than which none is as fast and nearer; and its picture, error against time.

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{Candidate, Choice};
use crate::error::{Error, Result};
use crate::report::axis::steps;
use crate::report::words::three_digits;

const SIZE_PX: (u32, u32) = (760, 460);
const OTHERS: RGBColor = RGBColor(160, 160, 160);
const FRONT: RGBColor = RGBColor(0, 84, 159);
const CHOSEN: RGBColor = RGBColor(200, 30, 30);

/// Marks the candidates on the front, by time and the error on dev. One without a time is not on it.
pub(super) fn mark(candidates: &mut [&mut Candidate]) {
    let mut timed: Vec<&mut &mut Candidate> =
        candidates.iter_mut().filter(|candidate| candidate.time_us.is_some()).collect();
    timed.sort_by(|a, b| {
        let times = a.time_us.unwrap_or(0.0).total_cmp(&b.time_us.unwrap_or(0.0));
        times.then(a.dev_px.value.total_cmp(&b.dev_px.value))
    });
    let mut least_px = f64::INFINITY;
    for candidate in timed {
        candidate.is_on_front = candidate.dev_px.value < least_px;
        least_px = least_px.min(candidate.dev_px.value);
    }
}

/// Whether a method's name stands in the picture.
fn is_named(choice: &Choice, candidate: &Candidate) -> bool {
    candidate.is_on_front || choice.chosen.as_deref() == Some(candidate.method.as_str())
}

/// Draws error against time, that one logarithmic, as an SVG: the front in blue with its names, the chosen method in red,
/// the rest in grey, the budget as a line. `None` where no method has a time.
///
/// # Errors
/// [`Error::Other`] from the drawing library.
pub(super) fn draw(choice: &Choice, budget_us: Option<f64>) -> Result<Option<String>> {
    let points: Vec<(f64, f64, &Candidate)> = choice
        .candidates
        .iter()
        .filter_map(|one| Some((one.time_us?, one.dev_px.value, one)))
        .filter(|(time_us, error_px, _)| *time_us > 0.0 && *error_px > 0.0)
        .collect();
    if points.is_empty() {
        return Ok(None);
    }
    let times_us = || points.iter().map(|point| point.0).chain(budget_us);
    let least_us = times_us().fold(f64::INFINITY, f64::min);
    let most_us = times_us().fold(0.0, f64::max);
    // Room about the outermost points, more to the right: names stand there.
    let margin = (most_us / least_us).powf(0.08).max(1.2);
    let times = least_us / margin..most_us * margin.powi(4);
    let named = points.iter().filter(|(.., one)| is_named(choice, one)).count();
    // Names stand above one another.
    let most_px =
        (1.1 + 0.05 * named as f64) * points.iter().map(|point| point.1).fold(0.0, f64::max);
    let mut text = String::new();
    let failed = |error: DrawingAreaErrorKind<_>| {
        Error::Other(format!("the picture of error against time: {error}"))
    };
    {
        let root = SVGBackend::with_string(&mut text, SIZE_PX).into_drawing_area();
        root.fill(&WHITE).map_err(failed)?;
        let mut chart = ChartBuilder::on(&root)
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(56)
            .build_cartesian_2d(
                times.clone().log_scale().with_key_points(steps(&times)),
                0.0..most_px,
            )
            .map_err(failed)?;
        let unit = super::unit_words(&choice.track);
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .y_labels(6)
            .label_style(("sans-serif", 13))
            .axis_desc_style(("sans-serif", 14))
            .x_desc(format!("us a {unit}"))
            .y_desc("px per corner asked for, on dev")
            .x_label_formatter(&|value| three_digits(Some(*value)))
            .y_label_formatter(&|value| three_digits(Some(*value)))
            .draw()
            .map_err(failed)?;
        if let Some(budget_us) = budget_us {
            let line = [(budget_us, 0.0), (budget_us, most_px)];
            chart.draw_series(LineSeries::new(line, CHOSEN)).map_err(failed)?;
        }
        let mut front: Vec<(f64, f64)> = points
            .iter()
            .filter(|(.., one)| one.is_on_front)
            .map(|(time_us, error_px, _)| (*time_us, *error_px))
            .collect();
        front.sort_by(|a, b| a.0.total_cmp(&b.0));
        chart.draw_series(LineSeries::new(front, FRONT)).map_err(failed)?;
        for (time_us, error_px, one) in &points {
            let is_chosen = choice.chosen.as_deref() == Some(one.method.as_str());
            let colour = match (is_chosen, one.is_on_front) {
                (true, _) => CHOSEN,
                (_, true) => FRONT,
                _ => OTHERS,
            };
            let dot = Circle::new((*time_us, *error_px), 4, colour.filled());
            chart.draw_series([dot]).map_err(failed)?;
        }
        let mut names: Vec<_> = points
            .iter()
            .filter(|(.., one)| is_named(choice, one))
            .map(|(time_us, error_px, one)| (chart.backend_coord(&(*time_us, *error_px)), *one))
            .collect();
        names.sort_by_key(|(dot, _)| dot.0);
        let top = names.iter().map(|(dot, _)| dot.1).min().unwrap_or_default();
        // The leftmost the highest: no name stands on another's line.
        for (level, ((x, y), one)) in names.iter().rev().enumerate() {
            let is_chosen = choice.chosen.as_deref() == Some(one.method.as_str());
            let colour = if is_chosen { CHOSEN } else { FRONT };
            let at = top - 18 - 16 * i32::try_from(level).unwrap_or_default();
            let line = PathElement::new([(*x, *y), (*x, at)], colour.mix(0.4));
            root.draw(&line).map_err(failed)?;
            let anchor = Pos::new(HPos::Left, VPos::Center);
            let style = ("sans-serif", 13).into_font().color(&colour).pos(anchor);
            root.draw(&Text::new(format!(" {}", one.method), (*x, at), style)).map_err(failed)?;
        }
        root.present().map_err(failed)?;
    }
    Ok(Some(text))
}
