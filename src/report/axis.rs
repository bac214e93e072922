//! What axes name.

use std::ops::Range;

/// Values that a logarithmic axis names: 1, 2, 5 and their decades, or these alone where they are many.
pub(super) fn steps(range: &Range<f64>) -> Vec<f64> {
    let of = |digits: &[f64]| -> Vec<f64> {
        let decades = (-9..10).map(|decade| 10_f64.powi(decade));
        let steps = decades.flat_map(|decade| digits.iter().map(move |digit| digit * decade));
        steps.filter(|step| range.contains(step)).collect()
    };
    let all = of(&[1.0, 2.0, 5.0]);
    if all.len() > 6 { of(&[1.0]) } else { all }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_axis_has_steps_within_its_decade_and_a_long_one_its_decades() {
        let near = |found: Vec<f64>, wanted: &[f64]| {
            assert_eq!(found.len(), wanted.len(), "{found:?}");
            let is_near = |(a, b): (&f64, &f64)| (a / b - 1.0).abs() < 1e-12;
            assert!(found.iter().zip(wanted).all(is_near), "{found:?}");
        };
        near(steps(&(0.03..0.6)), &[0.05, 0.1, 0.2, 0.5]);
        near(steps(&(0.03..60.0)), &[0.1, 1.0, 10.0]);
    }
}
