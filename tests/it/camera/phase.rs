//! Where the pixels' grid lies.

use std::process::Command;

use cornerbench::image::Plane;
use cornerbench::scene::Film;
use cornerbench::sensor::{CameraModel, Curve, Photographer};

use super::{mean, pinhole};
use crate::support::{project, python, succeed};

/// Side of the window of the shifted films \[px\], and their film cells per pixel.
const SIDE_PX: u32 = 40;
const OVERSAMPLING: u32 = 4;

/// Films that Mitsuba renders of one scene with shifted grids: by shift, and by pass with other noise.
fn rendered_at(shifts: &[[f64; 2]], passes: usize) -> Vec<Vec<Film>> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("films.f32");
    let mut command = Command::new(python());
    command.arg(project().join("scripts/tests/peers/shifted_films.py"));
    command.arg(&file).arg(passes.to_string()).arg("--");
    command.args(shifts.iter().map(|[x, y]| format!("{x},{y}")));
    succeed(&mut command);
    let bytes = std::fs::read(&file).expect("films");
    let side = (SIDE_PX * OVERSAMPLING) as usize;
    let numbers: Vec<f32> = bytes
        .chunks_exact(4)
        .map(|four| f32::from_le_bytes(four.try_into().expect("four bytes")))
        .collect();
    let planes: Vec<Plane<f32>> = numbers
        .chunks_exact(side * side)
        .map(|samples| Plane::from_samples(side, side, samples.to_vec()))
        .collect();
    let films: Vec<Film> = planes
        .chunks_exact(3)
        .map(|rgb| Film {
            oversampling: OVERSAMPLING,
            radiance: [rgb[0].clone(), rgb[1].clone(), rgb[2].clone()],
        })
        .collect();
    assert_eq!(films.len(), shifts.len() * passes);
    films.chunks_exact(passes).map(<[Film]>::to_vec).collect()
}

/// A photograph at a phase is one of a film that was rendered with its grid there, to the noise of the
/// renders: over the pixels the squares of their differences, in standard errors, have the mean that
/// they should. The blur, of 0.6 px, is that of a sharp lens: without any, an edge within a film cell
/// could be told from one that is spread over it.
#[test]
fn a_photograph_at_a_phase_is_one_of_a_film_rendered_there() {
    const PASSES: usize = 16;
    let shifts = [
        [0.0, 0.0],
        [0.25, 0.0],
        [0.0, -0.5],
        [0.1, 0.2],
        [-0.33, 0.41],
        [0.47, -0.13],
        [-0.06, -0.29],
        [0.38, 0.38],
        [0.55, -0.7],
    ];
    let films = rendered_at(&shifts, PASSES);
    let mut model = CameraModel::default();
    model.optics.gaussian_sigma_px = 0.6;
    model.output.rounded = false;
    model.output.transfer = Curve::Linear;
    let camera = Photographer::new("phase", &model, None);
    let pinhole = pinhole(SIDE_PX, SIDE_PX);
    let light = |film: &Film, phase: [f64; 2]| {
        camera.take(film, &pinhole, phase, &["phase"]).expect("a photograph").light
    };
    // Mean over the passes and its variance, of every pixel well inside, in every channel.
    let statistics = |films: &[Film], phase: [f64; 2]| -> Vec<(f64, f64)> {
        let all: Vec<Vec<Plane<f32>>> = films.iter().map(|film| light(film, phase)).collect();
        let mut found = Vec::new();
        for channel in 0..3 {
            for y in 6..SIDE_PX as usize - 6 {
                for x in 6..SIDE_PX as usize - 6 {
                    let values: Vec<f64> =
                        all.iter().map(|l| f64::from(l[channel].at(x, y))).collect();
                    let centre = mean(&values);
                    let square: f64 = values.iter().map(|v| (v - centre).powi(2)).sum();
                    let count = values.len() as f64;
                    found.push((centre, square / (count - 1.0) / count));
                }
            }
        }
        found
    };
    // The mean square of Student's t with so many degrees of freedom.
    let degrees = 2.0 * (PASSES as f64 - 1.0);
    let expected = degrees / (degrees - 2.0);
    let compared = |ours: &[(f64, f64)], theirs: &[(f64, f64)]| {
        let squares: Vec<f64> = ours
            .iter()
            .zip(theirs)
            .map(|((a, va), (b, vb))| (a - b).powi(2) / (va + vb).max(1e-30))
            .collect();
        mean(&squares)
    };
    // Neighbours share film cells, and the channels paths: of the 2352 differences of a shift some
    // two hundred are independent, so their mean square is known to a tenth.
    let mut all = Vec::new();
    for (shift, fresh) in shifts.iter().zip(&films).skip(1) {
        let theirs = statistics(fresh, [0.0, 0.0]);
        let found = compared(&statistics(&films[0], *shift), &theirs) / expected;
        assert!((found - 1.0).abs() < 0.4, "{shift:?}: {found} of what noise makes");
        all.push(found);
        // A tenth of a pixel beside it is beside it.
        let beside = [shift[0] + 0.1, shift[1] - 0.1];
        let far = compared(&statistics(&films[0], beside), &theirs) / expected;
        assert!(far > found + 0.6, "{shift:?}: the test cannot tell {beside:?}: {far}, {found}");
    }
    assert!((mean(&all) - 1.0).abs() < 0.2, "{all:?}");
}
