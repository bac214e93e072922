//! Precision over recall, a panel for each method.

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::error::{Error, Result};
use crate::report::detection::Sweep;
use crate::report::summary::{MethodSummary, Summary};
use crate::report::words::by_average_precision;

const COLUMNS: usize = 4;
const PANEL_PX: [u32; 2] = [260, 230];
const OTHERS: RGBColor = RGBColor(205, 205, 205);
const OWN: RGBColor = RGBColor(0, 84, 159);
const BEST: RGBColor = RGBColor(200, 30, 30);

/// Draws the curves of all methods over the share of the strongest response, as an SVG: each in a panel of
/// its own, the best first, those of the others behind it in grey, a dot where the harmonic mean is largest.
///
/// # Errors
/// [`Error::Other`] from the drawing library.
pub(super) fn draw(summary: &Summary) -> Result<String> {
    let methods = by_average_precision(summary);
    let rows = methods.len().div_ceil(COLUMNS).max(1);
    let columns = methods.len().clamp(1, COLUMNS);
    let count = |value: usize| u32::try_from(value).unwrap_or(u32::MAX);
    let size = (PANEL_PX[0] * count(columns), PANEL_PX[1] * count(rows));
    let mut text = String::new();
    let failed = |error: DrawingAreaErrorKind<_>| {
        Error::Other(format!("the curves of precision and recall: {error}"))
    };
    {
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        root.fill(&WHITE).map_err(failed)?;
        for (panel, method) in root.split_evenly((rows, columns)).iter().zip(&methods) {
            draw_panel(panel, method, &methods).map_err(failed)?;
        }
        root.present().map_err(failed)?;
    }
    Ok(text)
}

type Panel<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Outcome<'a> =
    std::result::Result<(), DrawingAreaErrorKind<<SVGBackend<'a> as DrawingBackend>::ErrorType>>;

fn draw_panel<'a>(
    panel: &Panel<'a>,
    method: &MethodSummary,
    all: &[&MethodSummary],
) -> Outcome<'a> {
    let own = &method.detection.sweeps[0];
    let name = format!("{}: {:.2}", method.label, own.average_precision);
    let mut chart = ChartBuilder::on(panel)
        .margin(8)
        .caption(name, ("sans-serif", 15))
        .x_label_area_size(32)
        .y_label_area_size(36)
        .build_cartesian_2d(0.0..1.0, 0.0..1.0)?;
    chart
        .configure_mesh()
        .x_labels(5)
        .y_labels(5)
        .light_line_style(TRANSPARENT)
        .x_desc("recall")
        .y_desc("precision")
        .draw()?;
    for other in all.iter().filter(|other| other.label != method.label) {
        chart.draw_series(LineSeries::new(line(&other.detection.sweeps[0]), OTHERS))?;
    }
    chart.draw_series(LineSeries::new(line(own), OWN.stroke_width(2)))?;
    if let Some(best) = own.best {
        let dot = Circle::new((best.recall, best.precision), 4, BEST.filled());
        let anchor = Pos::new(HPos::Left, VPos::Bottom);
        let style = ("sans-serif", 12).into_font().color(&BEST).pos(anchor);
        let words = format!(" {:.2}, {:.2}", best.recall, best.precision);
        chart.draw_series([dot])?;
        chart.draw_series([Text::new(words, (best.recall.min(0.7), best.precision), style)])?;
    }
    Ok(())
}

/// The curve's points: recall, precision.
fn line(sweep: &Sweep) -> impl Iterator<Item = (f64, f64)> + '_ {
    sweep.curve.iter().map(|point| (point.recall, point.precision))
}
