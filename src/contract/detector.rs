//! What a detector promises.

use super::pictures::{Motion, Picture, degenerate};
use super::{Finding, GATE_PX, SAME_PX, SWAPPED, convention, pictures};
use crate::detect::{Detection, Detector};
use crate::error::Result;
use crate::geometry::ImagePoint;
use crate::plan::AnyStage;
use crate::sensor::Exposure;
use crate::stats::median;

type Found = std::result::Result<Vec<Detection>, String>;

/// Answers farther from the picture's border than this are compared when it is moved \[px\].
const BORDER_PX: f64 = 16.0;

/// Tries a detector.
///
/// # Errors
/// Never: pictures are drawn here.
pub fn try_detector(detector: &AnyStage<dyn Detector>) -> Result<Vec<Finding>> {
    let detect = |exposure: &Exposure| -> Found {
        detector.detect(exposure, None).map(|reply| reply.answer).map_err(|failure| failure.reason)
    };
    let pictures = pictures()?;
    let found = pictures.iter().map(|picture| detect(&picture.exposure));
    let answers = match found.collect::<std::result::Result<Vec<_>, _>>() {
        Ok(answers) => answers,
        Err(reason) => return Ok(vec![Finding::tried("answers", Err(reason))]),
    };
    let nearest = |corner: &ImagePoint, found: &[Detection]| {
        let points = found.iter().map(|one| one.point);
        points.min_by(|a, b| a.distance_px(*corner).total_cmp(&b.distance_px(*corner)))
    };
    let all: usize = pictures.iter().map(|picture| picture.corners.len()).sum();
    let count: usize = answers.iter().map(Vec::len).sum();
    let of_pictures = || pictures.iter().zip(&answers);
    let swapped = |found: &[Detection]| -> Vec<Detection> {
        let turn = |one: &Detection| Detection {
            point: ImagePoint::new(one.point.y, one.point.x),
            ..*one
        };
        found.iter().map(turn).collect()
    };
    let pairs = |turn: &dyn Fn(&[Detection]) -> Vec<Detection>| -> Vec<[ImagePoint; 2]> {
        of_pictures()
            .flat_map(|(picture, found)| {
                let found = turn(found);
                let of_corner = |corner: &ImagePoint| Some([*corner, nearest(corner, &found)?]);
                picture.corners.iter().filter_map(of_corner).collect::<Vec<_>>()
            })
            .filter(|[corner, found]| corner.distance_px(*found) <= GATE_PX)
            .collect()
    };
    let (plain, turned) = (pairs(&<[Detection]>::to_vec), pairs(&swapped));
    if plain.is_empty() && turned.is_empty() {
        let words = format!(
            "none of {all} corners (L, Y and X) is found within {GATE_PX} px: nothing can be told of it"
        );
        return Ok(vec![Finding::tried("answers", Err(words))]);
    }
    let errors_px = plain.iter().map(|[corner, found]| corner.distance_px(*found));
    let errors_px: Vec<f64> = errors_px.collect();
    let mut findings = vec![Finding::told(
        "answers",
        format!(
            "{} of {all} corners (L, Y and X, blur 0.7 px, no noise) are found within {GATE_PX} px, median error {:.2} px; {count} \
             answers in all",
            plain.len(),
            median(&errors_px).unwrap_or_default()
        ),
    )];
    findings.push(if turned.len() > 2 * plain.len() {
        let words = format!(
            "x and y look swapped: {} corners are found, and {} the other way round; {SWAPPED}",
            plain.len(),
            turned.len()
        );
        Finding::tried("coordinates", Err(words))
    } else {
        convention(&plain)
    });
    let ascending = answers
        .iter()
        .flat_map(|found| found.windows(2))
        .any(|two| two[0].response < two[1].response);
    findings.push(Finding::tried(
        "strongest first",
        if ascending {
            Err("answers are not sorted by their response".to_owned())
        } else {
            Ok("responses descend".to_owned())
        },
    ));
    let picture = &pictures[0];
    let second = detect(&picture.exposure).and_then(|second| {
        if second == answers[0] {
            Ok("the same picture has the same answer, to the last bit".to_owned())
        } else {
            Err("the same picture has two answers: use no clock and no random numbers without a seed".to_owned())
        }
    });
    findings.push(Finding::tried("the same twice", second));
    for (what, motion) in [("moved", &Motion::ALL[0]), ("turned", &Motion::ALL[1])] {
        let exposure = motion.picture(&picture.exposure)?;
        let words =
            detect(&exposure).and_then(|found| follows(motion, picture, &answers[0], &found));
        findings.push(Finding::tried(what, words));
    }
    findings.push(Finding::tried("next to nothing", of_degenerate(&detect)?));
    Ok(findings)
}

/// Whether answers far from the border moved with the picture.
fn follows(
    motion: &Motion,
    picture: &Picture,
    before: &[Detection],
    after: &[Detection],
) -> std::result::Result<String, String> {
    let [width, height] = [picture.exposure.width() as f64, picture.exposure.height() as f64];
    let is_inside = |value: f64, size: f64| value >= BORDER_PX && value <= size - 1.0 - BORDER_PX;
    let inside: Vec<&Detection> = before
        .iter()
        .filter(|one| is_inside(one.point.x, width) && is_inside(one.point.y, height))
        .collect();
    let is_there = |one: &&&Detection| {
        let moved = motion.point(one.point);
        after.iter().any(|other| other.point.distance_px(moved) <= SAME_PX)
    };
    let there = inside.iter().filter(is_there).count();
    let words =
        format!("{}: {there} of {} answers follow to {SAME_PX} px", motion.words, inside.len());
    if 8 * (inside.len() - there) <= inside.len() {
        Ok(words)
    } else {
        Err(format!(
            "{words}; an answer should depend on the pixels about it, not on where they are"
        ))
    }
}

fn of_degenerate(
    detect: &impl Fn(&Exposure) -> Found,
) -> Result<std::result::Result<String, String>> {
    for (name, exposure) in degenerate()? {
        let [width, height] = [exposure.width() as f64, exposure.height() as f64];
        match detect(&exposure) {
            Err(reason) => {
                return Ok(Err(format!(
                    "no answer to a picture of {name}: {reason}; nothing found is an empty list"
                )));
            }
            Ok(found) => {
                let is_outside = |point: ImagePoint| {
                    !(-1.0..=width).contains(&point.x) || !(-1.0..=height).contains(&point.y)
                };
                if let Some(one) = found.iter().find(|one| is_outside(one.point)) {
                    let ImagePoint { x, y } = one.point;
                    return Ok(Err(format!(
                        "({x:.1}, {y:.1}) lies outside of a picture of {name}"
                    )));
                }
            }
        }
    }
    Ok(Ok("pictures of one pixel, one row, grey, black, white and noise have answers inside of them, or none".to_owned()))
}
