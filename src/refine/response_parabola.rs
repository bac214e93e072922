//! The maximum of Harris's response between its samples, by a parabola.
//!
//! ```text
//! # Method      R, Harris's response, is computed about the seed; its largest sample R_0 within
//!               max_shift_px is the middle of 3 x 3 samples, over which its maximum is, by `method`,
//!                 axes      d = (R_- - R_+) / (2 (R_- - 2 R_0 + R_+)) along x and along y
//!                 gaussian  the same of ln R
//!                 quadric   where p x^2 + q y^2 + r x y + s x + t y + u, fitted to all nine by least
//!                           squares, has its maximum: [2p r; r 2q] d = -[s t]
//! # Input       the channel as encoded [DN]; gain and offset cancel.
//! # Parameters  method          "axes", "gaussian" or "quadric", the default
//!               max_shift_px    px, 3     range [0.5, 20]: how far the largest sample may be from the seed
//!               k               none, 0.04 range [0, 0.25): that of Harris's detector
//!               those of the structure tensor (src/detect/tensor.rs)
//! # Output      position, status, one iteration; no covariance. The maximum of R lies within an L's
//!               wedge, 0.9 to 4.4 px from its vertex by opening and blur, and near a Y's: that is no fault of
//!               the interpolation, which repeats it to hundredths of a pixel. singular: R is not positive
//!               or no more than noise (slopes of both directions three times its), or the parabola has no
//!               maximum within a sample of R_0, or with `gaussian` a sample is not positive; diverged: a
//!               larger sample lies beyond max_shift_px. Elsewhere the seed's own position.
//! # Border      the image continues as `border` says; out_of_bounds where one of the nine samples is not in
//!               it, or the seed.
//! # Cost        the tensor on (2 max_shift_px + 3)^2 samples and its support around them.
//! # Departures  Where the parabola says more than a sample, others clip the shift and call it an answer.
//! # Source      Harris & Stephens, Alvey Vision Conference 1988 (R); the parabolas are common property. The
//!               least squares over nine samples: Haralick & Watson, A facet model for image data, Computer
//!               Graphics and Image Processing 15, 1981.
//! # Checked by  tests/it/contract.rs (all), tests/it/peaks.rs, the unit tests below
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::harris::Harris;
use crate::detect::tensor::StructureTensor;
use crate::detect::{Detection, Peaks};
use crate::geometry::ImagePoint;
use crate::refine::response::Responses;
use crate::refine::{Corner, RefineStatus, Refiner};
use crate::registry::{Entry, defaults, parameters, schema};
use crate::sensor::Exposure;

/// The registry's line.
pub const ENTRY: Entry<dyn Refiner> = Entry {
    name: "response_parabola",
    summary: "the maximum of Harris's response between its samples, by a parabola",
    reference: "Harris & Stephens 1988; Haralick & Watson 1981",
    version: 1,
    defaults: defaults::<ResponseParabola>,
    schema: schema::<ResponseParabola>,
    build: |place, table| Ok(Box::new(parameters::<ResponseParabola>(place, table)?)),
};

/// Which parabola.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// One along x and one along y.
    Axes,
    /// The same of the logarithm.
    Gaussian,
    /// One quadric over 3 x 3 samples.
    #[default]
    Quadric,
}

/// The refiner; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct ResponseParabola {
    /// Which parabola.
    pub method: Method,
    /// How far from its seed the largest sample may be \[px\].
    #[schemars(range(min = 0.5, max = 20.0))]
    pub max_shift_px: f64,
    /// Weight of the squared trace.
    #[schemars(range(min = 0.0), extend("exclusiveMaximum" = 0.25))]
    pub k: f64,
    /// How the structure tensor is measured.
    #[serde(flatten)]
    pub tensor: StructureTensor,
}

impl Default for ResponseParabola {
    fn default() -> Self {
        let Harris { k, tensor, .. } = Harris::default();
        Self { method: Method::default(), max_shift_px: 3.0, k, tensor }
    }
}

impl Refiner for ResponseParabola {
    fn refine(&self, exposure: &Exposure, seeds: &[Detection]) -> Vec<Corner> {
        let Self { method, max_shift_px, k, ref tensor } = *self;
        let harris = Harris { k, tensor: tensor.clone(), peaks: Peaks::default() };
        let mut responses = Responses::new(exposure, &harris, max_shift_px, 1);
        let mut locate = |seed: ImagePoint| {
            let place = responses.largest(seed)?;
            let shift = method.shift(&responses.around(place)).ok_or(RefineStatus::Singular)?;
            Ok(responses.point([0, 1].map(|axis| place[axis] as f64 + shift[axis])))
        };
        let refined = |seed: &Detection| match locate(seed.point) {
            Ok(position) => Corner { position, ..Corner::at_seed(*seed, 1, RefineStatus::Ok) },
            Err(status) => Corner::at_seed(*seed, 1, status),
        };
        seeds.iter().map(refined).collect()
    }
}

impl Method {
    /// How far the maximum is from the middle of 3 x 3 samples, along x and y; `None` where there is none
    /// within a sample.
    fn shift(self, rows: &[[f64; 3]; 3]) -> Option<[f64; 2]> {
        let across = [rows[0][1], rows[1][1], rows[2][1]];
        let shift = match self {
            Self::Axes => [vertex(rows[1])?, vertex(across)?],
            Self::Gaussian => {
                if rows[1].iter().chain(&across).any(|sample| *sample <= 0.0) {
                    return None;
                }
                [vertex(rows[1].map(f64::ln))?, vertex(across.map(f64::ln))?]
            }
            Self::Quadric => quadric(rows)?,
        };
        shift.iter().all(|value| value.abs() <= 1.0).then_some(shift)
    }
}

/// Where a parabola through three samples has its maximum, from the middle one.
fn vertex([before, here, after]: [f64; 3]) -> Option<f64> {
    let bend = before - 2.0 * here + after;
    (bend < 0.0).then(|| 0.5 * (before - after) / bend)
}

/// Where the quadric that fits nine samples best has its maximum.
fn quadric(rows: &[[f64; 3]; 3]) -> Option<[f64; 2]> {
    let of_rows = rows.map(|row| row.iter().sum::<f64>());
    let of_columns = [0, 1, 2].map(|column| rows[0][column] + rows[1][column] + rows[2][column]);
    let bend = |[before, here, after]: [f64; 3]| (before - 2.0 * here + after) / 3.0;
    let slope = |[before, _, after]: [f64; 3]| (after - before) / 6.0;
    let (xx, yy) = (bend(of_columns), bend(of_rows));
    let xy = 0.25 * (rows[0][0] + rows[2][2] - rows[0][2] - rows[2][0]);
    let (x, y) = (slope(of_columns), slope(of_rows));
    let determinant = xx * yy - xy * xy;
    (xx < 0.0 && determinant > 0.0)
        .then(|| [(xy * y - yy * x) / determinant, (xy * x - xx * y) / determinant])
}

#[cfg(test)]
mod tests {
    use super::*;

    const METHODS: [Method; 3] = [Method::Axes, Method::Gaussian, Method::Quadric];

    fn sampled(value: impl Fn(f64, f64) -> f64) -> [[f64; 3]; 3] {
        [-1.0, 0.0, 1.0].map(|y| [-1.0, 0.0, 1.0].map(|x| value(x, y)))
    }

    #[test]
    fn each_method_is_exact_on_its_own_surface() {
        for (a, b) in [(0.0, 0.0), (0.3, -0.2), (-0.45, 0.4)] {
            let turned = |x: f64, y: f64| {
                let (x, y) = (x - a, y - b);
                7.0 - 2.0 * x * x - y * y + 0.8 * x * y
            };
            let upright = |x: f64, y: f64| 7.0 - 2.0 * (x - a).powi(2) - (y - b).powi(2);
            let bell = |x: f64, y: f64| upright(x, y).exp();
            for rows in [sampled(turned), sampled(upright)] {
                let [x, y] = Method::Quadric.shift(&rows).expect("a maximum");
                assert!((x - a).abs() < 1e-12 && (y - b).abs() < 1e-12, "{x} {y}");
            }
            for (method, rows) in
                [(Method::Axes, sampled(upright)), (Method::Gaussian, sampled(bell))]
            {
                let [x, y] = method.shift(&rows).expect("a maximum");
                assert!((x - a).abs() < 1e-12 && (y - b).abs() < 1e-12, "{x} {y}");
            }
        }
    }

    #[test]
    fn what_has_no_maximum_within_a_sample_has_no_shift() {
        let surfaces = [
            sampled(|_, _| 5.0),
            sampled(|x, y| 9.0 + x + 2.0 * y),
            sampled(|x, y| 9.0 + x * x - y * y),
            sampled(|x, y| 90.0 - (x - 3.0).powi(2) - y * y),
        ];
        for rows in &surfaces {
            for method in METHODS {
                // A logarithm bends a plane.
                if method == Method::Gaussian && rows[0][0].to_bits() == 6.0_f64.to_bits() {
                    continue;
                }
                assert_eq!(method.shift(rows), None, "{method:?} {rows:?}");
            }
        }
        assert_eq!(Method::Gaussian.shift(&sampled(|x, y| 1.0 - x * x - y * y)), None);
    }
}
