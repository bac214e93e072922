//! Curves over what differs between cells: a panel for each combination of the rest, a line for each method.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::sheet::{Panel, Sheet, Spot, factor_name};
use crate::error::{Error, Result};
use crate::report::axis::steps;
use crate::report::refinement::Estimate;

const PANEL_PX: [u32; 2] = [380, 300];
const COLUMNS: usize = 3;
const LEGEND_ROW_PX: u32 = 22;
const LEGEND_COLUMNS: usize = 3;

/// Colours that people tell apart, also those who see few (Okabe & Ito 2008), and some more.
const COLOURS: [RGBColor; 12] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(120, 60, 20),
    RGBColor(110, 110, 110),
    RGBColor(150, 40, 120),
    RGBColor(90, 140, 20),
    RGBColor(30, 60, 160),
    RGBColor(190, 20, 40),
];

fn colour(series: usize) -> RGBColor {
    COLOURS[series % COLOURS.len()]
}

/// What is drawn over x.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Quantity {
    /// Root mean square error, with its interval, and the bound.
    Error,
    /// Mean error along the bisector.
    Bias,
    /// Share of junctions that were not located.
    Failed,
}

impl Quantity {
    /// What it is, with its unit.
    pub fn name(self) -> &'static str {
        match self {
            Self::Error => "rms error px",
            Self::Bias => "bias into the angle px",
            Self::Failed => "failed %",
        }
    }

    fn of(self, spot: &Spot) -> Option<Estimate> {
        match self {
            Self::Error => spot.method.refined.rmse_px,
            Self::Bias => spot.method.refined.bias_along_px,
            Self::Failed => Some(Estimate { value: 100.0 * spot.failed(), low: None, high: None }),
        }
    }
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Failure<'a> = DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>;

/// Draws a sheet as an SVG.
///
/// # Errors
/// [`Error::Other`] from the drawing library.
pub(super) fn draw(sheet: &Sheet, quantity: Quantity) -> Result<String> {
    let count = |value: usize| u32::try_from(value).unwrap_or(u32::MAX);
    let columns = sheet.panels.len().clamp(1, COLUMNS);
    let rows = sheet.panels.len().div_ceil(columns).max(1);
    let legend_rows = (sheet.series.len() + 1).div_ceil(LEGEND_COLUMNS);
    let legend_px = LEGEND_ROW_PX * count(legend_rows) + 8;
    let width_px = (PANEL_PX[0] * count(columns)).max(760);
    let size = (width_px, legend_px + PANEL_PX[1] * count(rows));
    let mut text = String::new();
    let failed = |error: DrawingAreaErrorKind<_>| Error::Other(format!("the curves: {error}"));
    {
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        root.fill(&WHITE).map_err(failed)?;
        let (legend, below) = root.split_vertically(legend_px);
        draw_legend(&legend, sheet, quantity).map_err(failed)?;
        let (below, _) = below.split_horizontally(PANEL_PX[0] * count(columns));
        let range = range(sheet, quantity);
        for (area, panel) in below.split_evenly((rows, columns)).iter().zip(&sheet.panels) {
            let range = range.clone();
            match quantity {
                Quantity::Error => {
                    let scale = range.clone().log_scale().with_key_points(steps(&range));
                    draw_panel(area, sheet, panel, quantity, range.start, scale)
                }
                _ => draw_panel(area, sheet, panel, quantity, range.start, range),
            }
            .map_err(failed)?;
        }
        root.present().map_err(failed)?;
    }
    Ok(text)
}

fn draw_legend<'a>(
    area: &Area<'a>,
    sheet: &Sheet,
    quantity: Quantity,
) -> std::result::Result<(), Failure<'a>> {
    let names = sheet.series.iter().enumerate().map(|(index, name)| (colour(index), *name));
    let has_bound = sheet.has_bound() && quantity == Quantity::Error;
    let bound = has_bound.then_some((BLACK, "bound"));
    let (width_px, _) = area.dim_in_pixel();
    for (index, (colour, name)) in names.chain(bound).enumerate() {
        let signed = |value: usize| i32::try_from(value).unwrap_or(i32::MAX);
        let step_px = i32::try_from(width_px).unwrap_or(i32::MAX) / signed(LEGEND_COLUMNS);
        let x = 10 + step_px * signed(index % LEGEND_COLUMNS);
        let y = 8 + 22 * signed(index / LEGEND_COLUMNS);
        area.draw(&Rectangle::new([(x, y + 4), (x + 18, y + 8)], colour.filled()))?;
        area.draw(&Text::new(name.to_owned(), (x + 24, y - 1), ("sans-serif", 13)))?;
    }
    Ok(())
}

/// What all panels show of y.
fn range(sheet: &Sheet, quantity: Quantity) -> Range<f64> {
    let spots = sheet.panels.iter().flat_map(|panel| &panel.spots);
    let values = spots.flat_map(|spot| {
        let estimate = quantity.of(spot).map(|estimate| estimate.value);
        let bound = spot.cell.bound_px.filter(|_| quantity == Quantity::Error);
        [estimate, bound].into_iter().flatten()
    });
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    for value in values.filter(|value| quantity != Quantity::Error || *value > LEAST_PX) {
        (least, most) = (least.min(value), most.max(value));
    }
    match quantity {
        Quantity::Failed => 0.0..100.0,
        Quantity::Error if least < most => (0.8 * least)..(1.25 * most),
        Quantity::Bias if least < most => {
            let margin = 0.05 * (most - least);
            // Farther than a pixel is a failure, and drawn as such.
            (least - margin).max(-1.0)..(most + margin).min(1.0)
        }
        _ => 0.01..1.0,
    }
}

/// Smaller errors are none \[px\].
const LEAST_PX: f64 = 1e-5;

fn draw_panel<'a, Y>(
    area: &Area<'a>,
    sheet: &Sheet,
    panel: &Panel,
    quantity: Quantity,
    least: f64,
    y: Y,
) -> std::result::Result<(), Failure<'a>>
where
    Y: AsRangedCoord<Value = f64>,
    Y::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let last = sheet.x_labels.len().saturating_sub(1) as f64;
    let is_short = sheet.x_labels.iter().all(|label| label.len() <= 5);
    let mut chart = ChartBuilder::on(area)
        .margin(10)
        .caption(sheet.title(panel), ("sans-serif", 14))
        .x_label_area_size(if is_short { 36 } else { 110 })
        .y_label_area_size(56)
        .build_cartesian_2d(-0.3..(last + 0.3), y)?;
    let label_of = |x: &f64| {
        let index = x.round();
        let is_whole = (x - index).abs() < 1e-6 && index >= 0.0;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "an index")]
        let label = sheet.x_labels.get(index as usize).filter(|_| is_whole);
        label.cloned().unwrap_or_default()
    };
    chart
        .configure_mesh()
        .disable_x_mesh()
        .x_labels(if is_short { 2 * sheet.x_labels.len().max(2) } else { 0 })
        .x_label_formatter(&label_of)
        .x_label_style(("sans-serif", 11))
        .y_labels(6)
        // Zero has no sign.
        .y_label_formatter(&|value| format!("{}", (1e6 * value).round() / 1e6 + 0.0))
        .light_line_style(TRANSPARENT)
        .x_desc(if is_short { factor_name(sheet.x) } else { "" })
        .y_desc(quantity.name())
        .draw()?;
    if !is_short {
        // Long names stand upright, each from its place on the axis downwards.
        let turned = ("sans-serif", 11).into_font().transform(FontTransform::Rotate90);
        let style = TextStyle::from(turned).pos(Pos::new(HPos::Left, VPos::Center));
        let (left, top) = area.get_base_pixel();
        for (index, label) in sheet.x_labels.iter().enumerate() {
            let (x, y) = chart.backend_coord(&(index as f64, least));
            area.draw(&Text::new(label.clone(), (x - left, y - top + 6), style.clone()))?;
        }
    }
    if quantity == Quantity::Error {
        let mut bounds: Vec<(f64, f64)> = panel
            .spots
            .iter()
            .filter_map(|spot| Some((spot.x as f64, spot.cell.bound_px?)))
            .collect();
        bounds.sort_by(|a, b| a.0.total_cmp(&b.0));
        bounds.dedup();
        chart.draw_series(LineSeries::new(bounds, BLACK.stroke_width(3)))?;
    }
    for series in 0..sheet.series.len() {
        let mut spots: Vec<(usize, Estimate)> = panel
            .spots
            .iter()
            .filter(|spot| spot.series == series)
            .filter_map(|spot| Some((spot.x, quantity.of(spot)?)))
            .collect();
        spots.sort_by_key(|(x, _)| *x);
        let floor = if quantity == Quantity::Error { LEAST_PX } else { f64::NEG_INFINITY };
        let at = |(x, estimate): &(usize, Estimate)| (*x as f64, estimate.value.max(floor));
        // Nothing lies between a number and a word.
        for spots in spots.chunk_by(|a, b| sheet.is_number(a.0) == sheet.is_number(b.0)) {
            let line = spots.iter().map(at);
            chart.draw_series(LineSeries::new(line, colour(series).stroke_width(2)))?;
        }
        let circles = spots.iter().map(|spot| Circle::new(at(spot), 3, colour(series).filled()));
        chart.draw_series(circles)?;
        let ends = spots.iter().filter_map(|(x, estimate)| {
            let x = *x as f64;
            Some([(x, estimate.low?.max(floor)), (x, estimate.high?.max(floor))])
        });
        chart.draw_series(ends.map(|ends| PathElement::new(ends, colour(series))))?;
    }
    Ok(())
}
