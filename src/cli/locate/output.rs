//! What was located, in words, as JSON and as CSV.

use std::path::Path;

use serde_json::json;

use super::{Options, Task};
use crate::cli::own::NO_CAMERA;
use crate::cli::{Global, print, print_line};
use crate::error::{Error, Result};
use crate::files::write_whole;
use crate::geometry::ImagePoint;
use crate::picture::{
    Agreement, Located, Score, Spread, agreement, deviation_px, likely_origin, score,
};
use crate::refine::Corner;
use crate::report::terminal::table_of;
use crate::report::words::Words;

/// A table of corners shows at most so many seeds.
const MOST_SEEDS: usize = 100;

/// Of a refiner's answer to a seed all that is shown.
struct Row<'a> {
    picture: &'a Located,
    seed: usize,
    refiner: usize,
    corner: &'a Corner,
}

impl Row<'_> {
    /// The index of the known corner that it is.
    fn known(&self) -> Option<usize> {
        self.picture.known_of[self.refiner][self.seed]
    }

    fn known_px(&self) -> Option<ImagePoint> {
        Some(self.picture.known[self.known()?].point)
    }

    fn label(&self) -> Option<&str> {
        self.picture.known[self.known()?].label.as_deref()
    }

    fn error_px(&self) -> Option<f64> {
        self.picture.offset_px(self.refiner, self.seed).map(|[dx, dy]| dx.hypot(dy))
    }

    /// Its position, where that is an answer.
    fn answer(&self) -> Option<ImagePoint> {
        self.corner.status.answered().then_some(self.corner.position)
    }
}

/// Every row: by picture, seed and refiner.
fn rows(located: &[Located]) -> impl Iterator<Item = Row<'_>> {
    located.iter().flat_map(|picture| {
        let seeds = picture.corners.first().map_or(0, Vec::len);
        (0..seeds).flat_map(move |seed| {
            let corners = picture.corners.iter().enumerate();
            corners.map(move |(refiner, corners)| Row {
                picture,
                seed,
                refiner,
                corner: &corners[seed],
            })
        })
    })
}

/// Prints what was located, and writes it where that is asked for.
pub(super) fn show(
    global: &Global,
    options: &Options,
    task: &Task,
    located: &[Located],
) -> Result<()> {
    if let Some(path) = &options.output {
        write_csv(path, task, located)?;
    }
    let has_covariance = rows(located).any(|row| row.corner.covariance_px2.is_some());
    if options.own.camera.is_none() && has_covariance {
        global.say(NO_CAMERA);
    }
    let unknown = located.iter().filter(|picture| picture.known.is_empty()).count();
    if task.known.is_some() && unknown > 0 {
        global.say(format!("no corner is known of {unknown} of {} pictures", located.len()));
    }
    if global.json {
        return show_json(options, task, located);
    }
    let is_one_picture = options.images.len() == 1 && !options.images[0].is_dir();
    if is_one_picture && task.refiners.len() == 1 && task.known.is_none() {
        return rows(located).try_for_each(|row| print_line(line(&row)));
    }
    print(table(task, located))?;
    print(if task.known.is_some() {
        scores(options, task, located)
    } else {
        agreements(task, located)
    })
}

fn line(row: &Row) -> String {
    let (seed, at) = (row.corner.seed.point, row.corner.position);
    let deviation = deviation_px(row.corner)
        .map_or_else(String::new, |value| format!(" +- {}", px(Some(value))));
    let status = row.corner.status.name();
    format!("({:.3}, {:.3}) -> ({:.4}, {:.4}){deviation}  {status}", seed.x, seed.y, at.x, at.y)
}

/// One row for each seed, in it one line for each refiner.
fn table(task: &Task, located: &[Located]) -> String {
    let mut header = vec!["image", "seed px", "refiner", "position px", "+- px", "status"];
    if task.known.is_some() {
        header.push("error px");
    }
    let rows: Vec<Row> = rows(located).collect();
    let seeds = rows.chunk_by(|row, next| row.refiner < next.refiner);
    let lines = |rows: &[Row], of: &dyn Fn(&Row) -> String| {
        rows.iter().map(of).collect::<Vec<_>>().join("\n")
    };
    let cells = |rows: &[Row]| {
        let (image, seed) = (rows[0].picture.image.file_name(), rows[0].corner.seed.point);
        let mut cells = vec![
            image.unwrap_or_default().to_string_lossy().into_owned(),
            format!("{:.2}, {:.2}", seed.x, seed.y),
            lines(rows, &|row| task.refiners[row.refiner].name.clone()),
            lines(rows, &|row| match row.answer() {
                Some(at) => format!("{:.4}, {:.4}", at.x, at.y),
                None => "-".to_owned(),
            }),
            lines(rows, &|row| px(deviation_px(row.corner))),
            lines(rows, &|row| row.corner.status.name().to_owned()),
        ];
        if task.known.is_some() {
            cells.push(lines(rows, &|row| px(row.error_px())));
        }
        cells
    };
    let words = Words {
        header: header.iter().map(|&text| text.to_owned()).collect(),
        rows: seeds.clone().take(MOST_SEEDS).map(cells).collect(),
    };
    let mut text = format!("{}\n", table_of(&words));
    let more = seeds.count().saturating_sub(MOST_SEEDS);
    if more > 0 {
        text.push_str(&format!("{more} seeds more: -o FILE.csv or --json has them all\n"));
    }
    text
}

/// A length to a ten-thousandth, or two digits of a smaller one; "-" of nothing.
fn px(value: Option<f64>) -> String {
    match value {
        None => "-".to_owned(),
        Some(value) if value != 0.0 && value.abs() < 0.001 => format!("{value:.1e}"),
        Some(value) => format!("{value:.4}"),
    }
}

fn spread(spread: Option<Spread>) -> [String; 3] {
    let of = |value: fn(Spread) -> f64| px(spread.map(value));
    [of(|spread| spread.rms_px), of(|spread| spread.median_px), of(|spread| spread.largest_px)]
}

fn summary(header: &[&str], rows: Vec<Vec<String>>) -> String {
    let header = header.iter().map(|&text| text.to_owned()).collect();
    format!("\n{}\n", table_of(&Words { header, rows }))
}

fn scores(options: &Options, task: &Task, located: &[Located]) -> String {
    let header = [
        "refiner",
        "answered",
        "rms error px",
        "median px",
        "largest px",
        "bias x px",
        "bias y px",
        "predicted rms px",
        "elsewhere",
    ];
    let rows = task.refiners.iter().enumerate().map(|(refiner, named)| {
        let Score { asked, answered, elsewhere, error, bias_px, predicted_rms_px } =
            score(located, refiner);
        let mut cells = vec![named.name.clone(), format!("{answered} of {asked}")];
        cells.extend(spread(error));
        cells.extend([px(bias_px.map(|bias| bias[0])), px(bias_px.map(|bias| bias[1]))]);
        cells.extend([px(predicted_rms_px), elsewhere.to_string()]);
        cells
    });
    let mut text = summary(&header, rows.collect());
    text.push_str(&format!(
        "answered: within {} px of a known corner. No error is known better than the known corners themselves.\n",
        Located::GATE_PX
    ));
    if task.seeds_known {
        text.push_str(
            "The seeds are the known corners: what stays near its seed looks better than it is. --detector NAME finds \
             others.\n",
        );
    }
    if let Some(origin) = likely_origin(located, options.own.origin()) {
        text.push_str(&format!("NOTE: {}\n", origin.note()));
    }
    text
}

/// Which refiners have an opinion of their own.
fn counted(task: &Task) -> Vec<bool> {
    task.refiners.iter().map(|named| named.name != "none").collect()
}

fn agreements(task: &Task, located: &[Located]) -> String {
    let header = [
        "refiner",
        "answered",
        "rms px from median",
        "median px",
        "largest px",
        "predicted rms px",
    ];
    let Agreement { pairs, refiners } = agreement(located, &counted(task));
    let rows = task.refiners.iter().zip(refiners).map(|(named, found)| {
        let mut cells = vec![named.name.clone(), format!("{} of {}", found.answered, found.asked)];
        cells.extend(spread(found.from_median));
        cells.push(px(found.predicted_rms_px));
        cells
    });
    let mut text = summary(&header, rows.collect());
    if let Some(pairs) = pairs {
        text.push_str(&format!(
            "Any two answers to a seed differ by {:.4} px (root mean square; median {:.4}, largest {:.4}).\n",
            pairs.rms_px, pairs.median_px, pairs.largest_px
        ));
    }
    text.push_str(
        "Agreement is not accuracy: methods may err together. --known FILE compares with corners that are known.\n",
    );
    text
}

fn show_json(options: &Options, task: &Task, located: &[Located]) -> Result<()> {
    for row in rows(located) {
        let corner = row.corner;
        let covariance =
            corner.covariance_px2.map(|c| [[c[(0, 0)], c[(0, 1)]], [c[(1, 0)], c[(1, 1)]]]);
        print_line(json!({
            "image": row.picture.image,
            "refiner": task.refiners[row.refiner].name,
            "seed_px": corner.seed.point,
            "position_px": corner.position,
            "covariance_px2": covariance,
            "status": corner.status.name(),
            "iterations": corner.iterations,
            "response": corner.seed.response,
            "known_px": row.known_px(),
            "label": row.label(),
            "error_px": row.error_px(),
        }))?;
    }
    let names = task.refiners.iter().map(|named| &named.name);
    if task.known.is_some() {
        let scores: Vec<_> = names
            .enumerate()
            .map(|(refiner, name)| json!({ "refiner": name, "score": score(located, refiner) }))
            .collect();
        let origin = likely_origin(located, options.own.origin()).map(|origin| origin.name());
        print_line(json!({ "scores": scores, "likely_origin": origin }))
    } else if task.refiners.len() > 1 {
        let Agreement { pairs, refiners } = agreement(located, &counted(task));
        let refiners: Vec<_> = names
            .zip(refiners)
            .map(|(name, found)| json!({ "refiner": name, "agreement": found }))
            .collect();
        print_line(json!({ "agreement": refiners, "pairs": pairs }))
    } else {
        Ok(())
    }
}

const COLUMNS: [&str; 17] = [
    "image",
    "refiner",
    "seed_x_px",
    "seed_y_px",
    "x_px",
    "y_px",
    "var_x_px2",
    "cov_xy_px2",
    "var_y_px2",
    "status",
    "iterations",
    "response",
    "label",
    "known_x_px",
    "known_y_px",
    "error_px",
    "deviation_px",
];

fn write_csv(path: &Path, task: &Task, located: &[Located]) -> Result<()> {
    let text = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    let failed = |error: csv::Error| Error::malformed(path, error);
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(COLUMNS).map_err(failed)?;
    for row in rows(located) {
        let Corner { seed, covariance_px2, status, iterations, .. } = *row.corner;
        let (at, known) = (row.answer(), row.known_px());
        let of_covariance = |r: usize, c: usize| text(covariance_px2.map(|matrix| matrix[(r, c)]));
        let cells = [
            row.picture.image.display().to_string(),
            task.refiners[row.refiner].name.clone(),
            seed.point.x.to_string(),
            seed.point.y.to_string(),
            text(at.map(|at| at.x)),
            text(at.map(|at| at.y)),
            of_covariance(0, 0),
            of_covariance(0, 1),
            of_covariance(1, 1),
            status.name().to_owned(),
            iterations.to_string(),
            seed.response.to_string(),
            row.label().unwrap_or_default().to_owned(),
            text(known.map(|known| known.x)),
            text(known.map(|known| known.y)),
            text(row.error_px()),
            text(deviation_px(row.corner)),
        ];
        writer.write_record(cells).map_err(failed)?;
    }
    let bytes = writer.into_inner().map_err(|error| Error::malformed(path, error))?;
    write_whole(path, |path| std::fs::write(path, &bytes).map_err(Error::io(path, "write")))
}
