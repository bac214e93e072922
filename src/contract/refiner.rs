//! What a refiner promises.

use super::pictures::{Motion, Picture, SIZE_PX, degenerate, edge};
use super::{Finding, GATE_PX, SAME_PX, convention, pictures};
use crate::detect::Detection;
use crate::error::Result;
use crate::geometry::ImagePoint;
use crate::plan::AnyStage;
use crate::random::Stream;
use crate::refine::{Corner, Refiner};
use crate::sensor::Exposure;
use crate::stats::median;

/// How far seeds are from their corners \[px\].
const SEEDS_PX: f64 = 1.0;

type Refined = std::result::Result<Vec<Corner>, String>;

/// Tries a refiner.
///
/// # Errors
/// Never: pictures are drawn here.
pub fn try_refiner(refiner: &AnyStage<dyn Refiner>) -> Result<Vec<Finding>> {
    let refine = |exposure: &Exposure, seeds: &[Detection]| -> Refined {
        refiner.refine(exposure, seeds).map(|reply| reply.answer).map_err(|failure| failure.reason)
    };
    let pictures = pictures()?;
    let asked: Vec<(&Picture, Vec<Detection>)> =
        pictures.iter().map(|picture| (picture, seeds_about(picture, SEEDS_PX))).collect();
    let answered = asked.iter().map(|(picture, seeds)| refine(&picture.exposure, seeds));
    let answers = match answered.collect::<std::result::Result<Vec<_>, _>>() {
        Ok(answers) => answers,
        Err(reason) => return Ok(vec![Finding::tried("answers", Err(reason))]),
    };
    let mut findings = vec![of_answers(&asked, &answers)];
    let pairs: Vec<[ImagePoint; 2]> = asked
        .iter()
        .zip(&answers)
        .flat_map(|((picture, _), corners)| picture.corners.iter().zip(corners))
        .filter(|(_, corner)| corner.status.answered())
        .map(|(truth, corner)| [*truth, corner.position])
        .collect();
    findings.push(convention(&pairs));
    let (picture, seeds) = &asked[0];
    let first = &answers[0];
    findings.push(Finding::tried("the same twice", again(refine(&picture.exposure, seeds), first)));
    findings.push(Finding::tried("order of seeds", order(&refine, picture, seeds, first)));
    for (what, motion) in
        [("moved", &Motion::ALL[0]), ("turned", &Motion::ALL[1]), ("gain", &Motion::GAIN)]
    {
        let exposure = motion.picture(&picture.exposure)?;
        let moved: Vec<Detection> = seeds
            .iter()
            .map(|seed| Detection { point: motion.point(seed.point), ..*seed })
            .collect();
        let found = refine(&exposure, &moved);
        let declines = |corners: &[Corner]| corners.iter().all(|one| !one.status.answered());
        findings.push(match &found {
            Ok(found) if declines(first) && declines(found) => {
                let words = "all corners of the picture are declined, before and after";
                Finding::told(what, format!("{}: {words}", motion.words))
            }
            _ => Finding::tried(what, found.and_then(|found| follows(motion, first, &found))),
        });
    }
    findings.push(Finding::tried("next to nothing", of_degenerate(&refine)?));
    findings.push(on_an_edge(&refine)?);
    findings.extend([0.0, 2.0, 3.0, 5.0].map(|far_px| with_bad_seeds(&refine, &pictures, far_px)));
    Ok(findings)
}

/// A seed of each corner, so far from it, in any direction.
fn seeds_about(picture: &Picture, far_px: f64) -> Vec<Detection> {
    let seed = |(index, corner): (usize, &ImagePoint)| {
        let name = format!("{} {}", corner.x, index);
        let turn = std::f64::consts::TAU * Stream::named(&["contract", "seed", &name]).uniform();
        let (y, x) = turn.sin_cos();
        Detection::new(ImagePoint::new(corner.x + far_px * x, corner.y + far_px * y), 1.0)
    };
    picture.corners.iter().enumerate().map(seed).collect()
}

fn of_answers(asked: &[(&Picture, Vec<Detection>)], answers: &[Vec<Corner>]) -> Finding {
    let all = answers.iter().map(Vec::len).sum::<usize>();
    let errors_px: Vec<f64> = asked
        .iter()
        .zip(answers)
        .flat_map(|((picture, _), corners)| picture.corners.iter().zip(corners))
        .filter(|(_, corner)| corner.status.answered())
        .map(|(truth, corner)| truth.distance_px(corner.position))
        .collect();
    if errors_px.is_empty() {
        let words =
            format!("all of {all} corners (L, Y and X) are declined: nothing can be told of it");
        return Finding::tried("answers", Err(words));
    }
    let near = errors_px.iter().filter(|error_px| **error_px <= 0.5).count();
    Finding::told(
        "answers",
        format!(
            "{} of {all} corners (L, Y and X, blur 0.7 px, no noise, seeds {SEEDS_PX} px off), {near} of them within 0.5 px, \
             median error {:.3} px",
            errors_px.len(),
            median(&errors_px).unwrap_or_default()
        ),
    )
}

fn far_px(one: &Corner, other: &Corner) -> f64 {
    one.position.distance_px(other.position)
}

fn again(second: Refined, first: &[Corner]) -> std::result::Result<String, String> {
    let second = second?;
    match first.iter().zip(&second).find(|(a, b)| a != b) {
        None => Ok("the same question has the same answer, to the last bit".to_owned()),
        Some((a, b)) => Err(format!(
            "the same question has two answers, {:.1e} px apart: use no clock and no random numbers without a seed, and sum \
             in a fixed order",
            far_px(a, b)
        )),
    }
}

fn order(
    refine: &impl Fn(&Exposure, &[Detection]) -> Refined,
    picture: &Picture,
    seeds: &[Detection],
    first: &[Corner],
) -> std::result::Result<String, String> {
    let reversed: Vec<Detection> = seeds.iter().rev().copied().collect();
    let found = refine(&picture.exposure, &reversed)?;
    let farthest_px = first
        .iter()
        .zip(found.iter().rev())
        .filter(|(a, b)| a.status.answered() && b.status.answered())
        .map(|(a, b)| far_px(a, b))
        .fold(0.0, f64::max);
    if farthest_px <= SAME_PX {
        Ok("answers come in the order of the seeds, whatever that is".to_owned())
    } else {
        Err(format!(
            "when seeds come in another order, answers differ by up to {farthest_px:.2} px: give one for each seed, in their \
             order, none depending on the others"
        ))
    }
}

/// Whether answers moved with the picture.
fn follows(
    motion: &Motion,
    before: &[Corner],
    after: &[Corner],
) -> std::result::Result<String, String> {
    let both = || before.iter().zip(after);
    let far = |a: &Corner, b: &Corner| motion.point(a.position).distance_px(b.position);
    let distances: Vec<f64> = both()
        .filter(|(a, b)| a.status.answered() && b.status.answered())
        .map(|(a, b)| far(a, b))
        .collect();
    let changed = both().filter(|(a, b)| a.status.answered() != b.status.answered()).count();
    let off = distances.iter().filter(|far| **far > SAME_PX).count();
    let most_px = distances.iter().copied().fold(0.0, f64::max);
    let words = format!(
        "{}: {} of {} answers follow to {SAME_PX} px, median {:.4} px, at most {most_px:.3} px; {changed} more are declined in one of the two",
        motion.words,
        distances.len() - off,
        distances.len(),
        median(&distances).unwrap_or_default()
    );
    // One in eight may be at a watershed.
    if 8 * (off + changed) <= before.len() {
        Ok(words)
    } else {
        Err(format!(
            "{words}; an answer should depend on the pixels about it, not on where or how bright they are"
        ))
    }
}

fn of_degenerate(
    refine: &impl Fn(&Exposure, &[Detection]) -> Refined,
) -> Result<std::result::Result<String, String>> {
    let mut count = 0;
    for (name, exposure) in degenerate()? {
        let [width, height] = [exposure.width() as f64, exposure.height() as f64];
        let places = [
            [0.0, 0.0],
            [0.5 * width, 0.5 * height],
            [width - 1.0, height - 1.0],
            [-3.0, 2.0],
            [1e6, -1e6],
        ];
        let seeds = places.map(|[x, y]| Detection::new(ImagePoint::new(x, y), 1.0));
        match refine(&exposure, &seeds) {
            Ok(corners) => count += corners.len(),
            Err(reason) => {
                return Ok(Err(format!(
                    "no answer to a picture of {name}: {reason}; decline a corner that cannot be refined (null, or a status)"
                )));
            }
        }
    }
    Ok(Ok(format!(
        "{count} seeds in pictures of one pixel, one row, grey, black, white and noise, some of them outside: all have an answer or are declined"
    )))
}

fn on_an_edge(refine: &impl Fn(&Exposure, &[Detection]) -> Refined) -> Result<Finding> {
    let seeds: Vec<Detection> = (0..9)
        .map(|place| {
            Detection::new(
                ImagePoint::new(31.3 + 0.75 * (4 - place) as f64, 19.2 + f64::from(place)),
                1.0,
            )
        })
        .collect();
    Ok(match refine(&edge()?, &seeds) {
        Ok(corners) => Finding::told(
            "on an edge",
            format!(
                "of {} seeds on a straight edge, where no corner is, {} are declined",
                corners.len(),
                corners.iter().filter(|corner| !corner.status.answered()).count()
            ),
        ),
        Err(reason) => Finding::tried("on an edge", Err(reason)),
    })
}

fn with_bad_seeds(
    refine: &impl Fn(&Exposure, &[Detection]) -> Refined,
    pictures: &[Picture],
    far_px: f64,
) -> Finding {
    let (mut near, mut declined, mut elsewhere) = (0, 0, 0);
    for picture in pictures {
        let corners = match refine(&picture.exposure, &seeds_about(picture, far_px)) {
            Ok(corners) => corners,
            Err(reason) => return Finding::tried("bad seeds", Err(reason)),
        };
        for (truth, corner) in picture.corners.iter().zip(&corners) {
            if !corner.status.answered() {
                declined += 1;
            } else if truth.distance_px(corner.position) <= 0.5 {
                near += 1;
            } else {
                elsewhere += 1;
            }
        }
    }
    Finding::told(
        "bad seeds",
        format!(
            "{far_px} px off: {near} answers within 0.5 px, {declined} declined, {elsewhere} elsewhere"
        ),
    )
}

const _: () = assert!(SIZE_PX[0] != SIZE_PX[1], "x and y can be told apart");
const _: () = assert!(GATE_PX > SEEDS_PX);
