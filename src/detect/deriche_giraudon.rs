//! Deriche and Giraudon's corner detector: two scales tell where the vertex is.
//!
//! ```text
//! # Method      The maximum of DET (hessian_determinant) in a wedge lies on its bisector, the farther from
//!               the vertex the larger the scale. Corners: maxima of DET at sigma_d, each followed to
//!               its maximum at sigma_large; on the line from that one through it the first place where
//!               the Laplacian at sigma_d changes its sign: the vertex.
//! # Input       the channel as encoded [DN].
//! # Parameters  channel       none, luma     luma, red, red_difference; colour: the measures added up
//!               sigma_d       px, 1.5        range [0.5, 8]
//!               sigma_large   px, 2.5        range [0.5, 8]; larger than sigma_d
//!               border        replicate      how the image continues: replicate, reflect
//!               those of peaks (peaks.rs: thresholds, the strongest so many, suppression radius,
//!               margin around a region), for the maxima at sigma_d
//! # Output      places between pixels, in the order of the maxima, strongest first; response DET at
//!               sigma_d in DN^2. Maxima that do not move, or whose line crosses no change of sign within
//!               4 sigma_d, are no corners.
//! # Border      no maximum nearer to an edge than ceil(3 sigma_d) px.
//! # Cost        O(pixels of the image); four planes of f32.
//! # Departures  Gaussian derivatives instead of their recursive ones. Maxima are interpolated by a
//!               parabola in each direction, the Laplacian bilinearly.
//! # Source      Deriche & Giraudon, A computational approach for corner and vertex detection,
//!               International Journal of Computer Vision 10(2), 1993.
//! # Checked by  tests/it/contract.rs (all),
//!               tests/it/detectors.rs::two_scales_cancel_most_of_the_determinant_s_displacement
//! ```

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::detect::area::SearchArea;
use crate::detect::hessian_determinant::HessianDeterminant;
use crate::detect::jet::{Derivatives, Jet, MeasureJet};
use crate::detect::peaks::{Response, ResponseMemory};
use crate::detect::{Detection, Detector, Peaks, Scratch};
use crate::geometry::ImagePoint;
use crate::image::{PixelRange, Plane};
use crate::registry::{Entry, defaults, in_range, parameters, schema};
use crate::sensor::Exposure;
use crate::target::TargetRegion;
use crate::vector::Real;

/// The registry's line.
pub const ENTRY: Entry<dyn Detector> = Entry {
    name: "deriche_giraudon",
    summary: "vertex on the line through maxima of DET at two scales, at the Laplacian's zero",
    reference: "Deriche & Giraudon 1993",
    version: 1,
    defaults: defaults::<DericheGiraudon>,
    schema: schema::<DericheGiraudon>,
    build: |place, table| {
        let detector: DericheGiraudon = parameters(place, table)?;
        in_range(place, "sigma_large", detector.sigma_large, detector.jet.sigma_d + 0.1..=8.0)?;
        Ok(Box::new(detector))
    },
};

/// The detector; the header above explains its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct DericheGiraudon {
    /// The larger scale \[px\].
    #[schemars(range(min = 0.5, max = 8.0))]
    pub sigma_large: f64,
    /// How derivatives are measured at the smaller scale.
    #[serde(flatten)]
    pub jet: Jet,
    /// When a maximum of the smaller scale is a corner.
    #[serde(flatten)]
    pub peaks: Peaks,
}

impl Default for DericheGiraudon {
    fn default() -> Self {
        Self { sigma_large: 2.5, jet: Jet::default(), peaks: Peaks::default() }
    }
}

/// Ixx + Iyy.
struct Laplacian;

impl MeasureJet for Laplacian {
    #[inline(always)]
    fn of<R: Real>(&self, derivatives: Derivatives<R>) -> R {
        derivatives.xx + derivatives.yy
    }
}

impl Detector for DericheGiraudon {
    fn detect_into(
        &self,
        exposure: &Exposure,
        region: Option<&TargetRegion>,
        scratch: &mut Scratch,
        found: &mut Vec<Detection>,
    ) {
        let Self { jet, peaks, .. } = self;
        let small = HessianDeterminant { jet: jet.clone(), peaks: peaks.clone() };
        let large = HessianDeterminant {
            jet: Jet { sigma_d: self.sigma_large, ..jet.clone() },
            peaks: peaks.clone(),
        };
        small.detect_into(exposure, region, scratch, found);
        if found.is_empty() {
            return;
        }
        let size = [exposure.width(), exposure.height()];
        let whole = PixelRange { x0: 0, y0: 0, x1: size[0], y1: size[1] };
        let planes = Planes {
            small: plane(&small.jet.measured(&small), exposure, whole),
            large: plane(&large.jet.measured(&large), exposure, whole),
            laplacian: plane(&jet.measured(&Laplacian), exposure, whole),
        };
        let area = SearchArea::new(size, 0, region, peaks.margin_px, 1);
        found.retain_mut(|detection| {
            let vertex = planes.vertex(detection.point, self);
            let vertex = vertex.filter(|vertex| area.contains(vertex.x, vertex.y));
            vertex.is_some_and(|vertex| {
                detection.point = vertex;
                true
            })
        });
    }
}

fn plane(response: &impl Response, exposure: &Exposure, range: PixelRange) -> Plane<f32> {
    let mut plane = Plane::default();
    response.respond(exposure, range, &mut ResponseMemory::default(), &mut plane);
    plane
}

/// DET at both scales, and the Laplacian at the smaller one.
struct Planes {
    small: Plane<f32>,
    large: Plane<f32>,
    laplacian: Plane<f32>,
}

impl Planes {
    /// The vertex to which a maximum of the smaller scale belongs.
    fn vertex(&self, maximum: ImagePoint, detector: &DericheGiraudon) -> Option<ImagePoint> {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a pixel")]
        let pixel = [maximum.x as usize, maximum.y as usize];
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small")]
        let most_steps = (4.0 * detector.sigma_large) as usize;
        let near = interpolated(&self.small, pixel)?;
        let far = interpolated(&self.large, uphill(&self.large, pixel, most_steps)?)?;
        let moved_px = near.distance_px(far);
        // A maximum that does not move has no direction.
        if moved_px < 0.05 {
            return None;
        }
        let along = |t: f64| {
            let share = t / moved_px;
            ImagePoint::new(near.x + share * (near.x - far.x), near.y + share * (near.y - far.y))
        };
        let reach_px = 4.0 * detector.jet.sigma_d;
        let within = |point: &ImagePoint| {
            let (width, height) = (self.small.width() as f64, self.small.height() as f64);
            (0.0..=width - 1.0).contains(&point.x) && (0.0..=height - 1.0).contains(&point.y)
        };
        const STEP_PX: f64 = 0.25;
        let start = self.laplacian.bilinear(near);
        let mut before = start;
        let mut t = STEP_PX;
        while t <= reach_px {
            let here = self.laplacian.bilinear(along(t));
            // A change of sign, not the rounding of a flat place.
            if here * start < -1e-4 * start * start {
                let vertex = along(t - STEP_PX * here / (here - before));
                return Some(vertex).filter(within);
            }
            before = here;
            t += STEP_PX;
        }
        None
    }
}

/// From a pixel to the largest of its neighbours, and on until none is larger; `None` at the border, and
/// where that takes more steps.
fn uphill(plane: &Plane<f32>, [mut x, mut y]: [usize; 2], most_steps: usize) -> Option<[usize; 2]> {
    for _ in 0..=most_steps {
        if x == 0 || y == 0 || x + 1 >= plane.width() || y + 1 >= plane.height() {
            return None;
        }
        let neighbours = (y - 1..=y + 1).flat_map(|v| (x - 1..=x + 1).map(move |u| [u, v]));
        let [u, v] =
            neighbours.fold(
                [x, y],
                |[x, y], [u, v]| {
                    if plane.at(u, v) > plane.at(x, y) { [u, v] } else { [x, y] }
                },
            );
        if [u, v] == [x, y] {
            return Some([x, y]);
        }
        [x, y] = [u, v];
    }
    None
}

/// A maximum's place between the pixels, by a parabola in each direction.
fn interpolated(plane: &Plane<f32>, [x, y]: [usize; 2]) -> Option<ImagePoint> {
    if x == 0 || y == 0 || x + 1 >= plane.width() || y + 1 >= plane.height() {
        return None;
    }
    let offset = |before: f32, here: f32, after: f32| {
        let bend = 2.0 * f64::from(here) - f64::from(before) - f64::from(after);
        let slope = 0.5 * (f64::from(after) - f64::from(before));
        if bend > 0.0 { (slope / bend).clamp(-0.5, 0.5) } else { 0.0 }
    };
    let here = plane.at(x, y);
    Some(ImagePoint::new(
        x as f64 + offset(plane.at(x - 1, y), here, plane.at(x + 1, y)),
        y as f64 + offset(plane.at(x, y - 1), here, plane.at(x, y + 1)),
    ))
}
