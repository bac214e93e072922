//! How often the bootstrap's intervals hold the truth, on drawn benchmarks.

use super::{Bootstrap, Interval};
use crate::random::Stream;

/// Of how many of `times` benchmarks of `scenes` the intervals hold the truth: of the first method's
/// RMSE and of the log ratio of both methods' RMSE, perhaps as if each corner were a scene.
///
/// A scene has 5 to 12 corners with Rayleigh errors, whose scale is a scene's and, less so, a scene's
/// and a method's, both lognormal.
fn coverage(scenes: usize, times: usize, by_corner: bool) -> [f64; 2] {
    const SCENE: f64 = 0.25;
    const METHOD: f64 = 0.15;
    let log_ratio = 1.3_f64.ln();
    // The mean square of Rayleigh errors is twice the scale's; that of a lognormal scale is known.
    let log_rmse = 0.5 * 2_f64.ln() + SCENE * SCENE + METHOD * METHOD;
    let mut held = [0_u32; 2];
    for time in 0..times {
        let [scenes_text, time_text] = [scenes, time].map(|number| number.to_string());
        let mut random = Stream::named(&["benchmark", &scenes_text, &time_text]);
        let mut clusters = Vec::new();
        for _ in 0..scenes {
            let scene = SCENE * random.normal();
            let scale =
                [0.0, log_ratio].map(|method| (scene + method + METHOD * random.normal()).exp());
            let corners: Vec<[f64; 3]> = (0..5 + random.below(8))
                .map(|_| {
                    let mut square =
                        |scale: f64| -2.0 * (1.0 - random.uniform()).ln() * scale * scale;
                    [square(scale[0]), square(scale[1]), 1.0]
                })
                .collect();
            if by_corner {
                clusters.extend(corners);
            } else {
                let sum = |part: usize| corners.iter().map(|corner| corner[part]).sum();
                clusters.push([sum(0), sum(1), sum(2)]);
            }
        }
        let name = ["resamples", &scenes_text, &time_text];
        let bootstrap = Bootstrap { resamples: 1000, ..Bootstrap::named(&name) };
        let intervals = [
            (log_rmse, bootstrap.of_sums(&clusters, |s| Some(0.5 * (s[0] / s[2]).ln()))),
            (log_ratio, bootstrap.of_sums(&clusters, |s| Some(0.5 * (s[1] / s[0]).ln()))),
        ];
        for (held, (truth, interval)) in held.iter_mut().zip(intervals) {
            let Interval { low, high, .. } = interval.expect("many scenes");
            *held += u32::from(low <= truth && truth <= high);
        }
    }
    held.map(|held| f64::from(held) / times as f64)
}

#[test]
fn intervals_of_95_percent_hold_the_truth_of_93_to_97_percent() {
    for (scenes, times) in [(20, 1000), (50, 1000), (200, 500)] {
        let [rmse, ratio] = coverage(scenes, times, false);
        assert!((0.93..=0.97).contains(&rmse), "{scenes} scenes: RMSE {rmse}");
        assert!((0.93..=0.97).contains(&ratio), "{scenes} scenes: ratio {ratio}");
    }
}

#[test]
fn corners_taken_for_scenes_promise_too_much() {
    let [rmse, ratio] = coverage(50, 300, true);
    assert!(rmse < 0.85 && ratio < 0.9, "RMSE {rmse}, ratio {ratio}");
}
