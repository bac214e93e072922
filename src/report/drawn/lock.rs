//! How an error depends on the vertex's place in its pixel: pixel locking.

use serde::Serialize;

use crate::record::Record;
use crate::report::refinement::is_answered;

/// Mean errors by the vertex's place in its pixel, over all turns.
#[derive(Clone, Debug, Serialize)]
pub struct Lock {
    /// Places along each side.
    pub grid: usize,
    /// Row by row from the pixel's top left corner: the mean error along x and y \[px\]; none where nothing was
    /// answered.
    pub bias_px: Vec<Option<[f64; 2]>>,
    /// Root mean square of these about their mean \[px\].
    pub amplitude_px: f64,
    /// Of the error along x its first harmonic over the place along x: its amplitude \[px\].
    pub harmonic_px: f64,
}

/// Errors by place, as they are collected from rows.
pub(super) struct Places {
    grid: usize,
    /// Of each place the errors along x and y, and how many there are.
    sums: Vec<[f64; 3]>,
}

impl Places {
    pub fn new(grid: usize) -> Self {
        Self { grid, sums: vec![[0.0; 3]; grid * grid] }
    }

    /// Adds a row of a corner that a refiner was given, if it answered.
    pub fn add(&mut self, record: &Record) {
        let both = |x: Option<f64>, y: Option<f64>| x.zip(y).filter(|_| is_answered(record));
        let truth = both(record.true_x_px, record.true_y_px);
        let found = both(record.refined_x_px, record.refined_y_px);
        let Some((truth, found)) = truth.zip(found) else { return };
        // From the pixel's border, whose centre is a whole number.
        let place = |at: f64| {
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "in [0, grid)"
            )]
            let place = ((at + 0.5).rem_euclid(1.0) * self.grid as f64) as usize;
            place.min(self.grid - 1)
        };
        let sum = &mut self.sums[place(truth.1) * self.grid + place(truth.0)];
        *sum = [sum[0] + found.0 - truth.0, sum[1] + found.1 - truth.1, sum[2] + 1.0];
    }

    /// What they come to; nothing of no answers.
    pub fn lock(&self) -> Option<Lock> {
        let Self { grid, ref sums } = *self;
        let mean = |[x, y, count]: &[f64; 3]| (*count > 0.0).then(|| [x / count, y / count]);
        let bias_px: Vec<Option<[f64; 2]>> = sums.iter().map(mean).collect();
        let known: Vec<[f64; 2]> = bias_px.iter().copied().flatten().collect();
        if known.is_empty() {
            return None;
        }
        let of = |value: &dyn Fn(&[f64; 2]) -> f64| {
            known.iter().map(value).sum::<f64>() / known.len() as f64
        };
        let [x, y] = [of(&|bias| bias[0]), of(&|bias| bias[1])];
        let square = of(&|bias| (bias[0] - x).powi(2) + (bias[1] - y).powi(2));
        let by_column = bias_px.iter().enumerate().filter_map(|(index, bias)| {
            let place = ((index % grid) as f64 + 0.5) / grid as f64;
            Some((std::f64::consts::TAU * place, (*bias)?[0]))
        });
        let wave = by_column.fold([0.0; 2], |[cosine, sine], (angle, bias)| {
            [cosine + bias * angle.cos(), sine + bias * angle.sin()]
        });
        let harmonic_px = 2.0 * wave[0].hypot(wave[1]) / known.len() as f64;
        Some(Lock { grid, bias_px, amplitude_px: square.sqrt(), harmonic_px })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wave_over_the_pixel_has_its_amplitude_and_a_constant_error_none() {
        const GRID: usize = 8;
        let of = |constant_px: f64, wave_px: f64| {
            let mut places = Places::new(GRID);
            for index in 0..GRID * GRID {
                let place = |at: usize| (at as f64 + 0.5) / GRID as f64 - 0.5;
                let (x, y) = (20.0 + place(index % GRID), 30.0 + place(index / GRID));
                let error_px = constant_px + wave_px * (std::f64::consts::TAU * x).sin();
                places.add(&Record {
                    true_x_px: Some(x),
                    true_y_px: Some(y),
                    refined_x_px: Some(x + error_px),
                    refined_y_px: Some(y),
                    refine_status: Some("ok".into()),
                    ..Record::default()
                });
            }
            places.lock().expect("answers")
        };
        let constant = of(0.3, 0.0);
        assert!(constant.amplitude_px < 1e-9 && constant.harmonic_px < 1e-9);
        let wave = of(0.3, 0.1);
        assert!((wave.harmonic_px - 0.1).abs() < 1e-9, "{wave:?}");
        assert!((wave.amplitude_px - 0.1 * 0.5_f64.sqrt()).abs() < 1e-9, "{wave:?}");
        // The first place is the pixel's top left corner: there the sine falls below 0.
        assert!(wave.bias_px[1].expect("answers")[0] > 0.3 - 0.1);
        assert_eq!(wave.bias_px.len(), GRID * GRID);
    }
}
