//! Edges of a junction as straight lines: what they tell of their meeting, and whether it is a corner.

use nalgebra::{Matrix2, Vector2};

use crate::geometry::ImagePoint;
use crate::junction::rays::{MOST_RAYS, Rays};
use crate::refine::RefineStatus;

/// A straight edge that leaves a junction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// The point on it from which lengths along it count: near the junction \[px\].
    pub origin: Vector2<f64>,
    /// Its direction away from the junction, from x right towards y down \[rad\].
    pub angle_rad: f64,
    /// Covariance of how far the origin is off across the line \[px\] and of its direction \[rad\].
    pub covariance: Matrix2<f64>,
}

impl Line {
    /// The unit vector along it.
    pub fn direction(&self) -> Vector2<f64> {
        let (sine, cosine) = self.angle_rad.sin_cos();
        Vector2::new(cosine, sine)
    }

    /// The unit vector across it, to where angles are larger.
    pub fn normal(&self) -> Vector2<f64> {
        let (sine, cosine) = self.angle_rad.sin_cos();
        Vector2::new(-sine, cosine)
    }

    /// How far the line may be off across itself, so far along it: the variance \[px^2\].
    pub fn variance_px2(&self, along_px: f64) -> f64 {
        let c = &self.covariance;
        c[(0, 0)] + along_px * (2.0 * c[(0, 1)] + along_px * c[(1, 1)])
    }

    /// The same line, its lengths counted from the point nearest to another one.
    pub fn counted_from(&self, point: Vector2<f64>) -> Self {
        let along_px = self.direction().dot(&(point - self.origin));
        let shift = Matrix2::new(1.0, along_px, 0.0, 1.0);
        Self {
            origin: self.origin + along_px * self.direction(),
            covariance: shift * self.covariance * shift.transpose(),
            ..*self
        }
    }
}

/// The rays of a start as lines: how far they may be off is what circles tell.
pub fn lines_of(rays: &Rays) -> [Line; MOST_RAYS] {
    const OFF_PX: f64 = 0.7;
    const TURNED_RAD: f64 = 0.07;
    let covariance = Matrix2::new(OFF_PX * OFF_PX, 0.0, 0.0, TURNED_RAD * TURNED_RAD);
    let origin = Vector2::from(rays.vertex);
    rays.angles_rad.map(|angle_rad| Line { origin, angle_rad, covariance })
}

/// Where lines meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// The point \[px\].
    pub point: Vector2<f64>,
    /// Its covariance, larger where three lines meet in no point \[px^2\].
    pub covariance_px2: Matrix2<f64>,
}

/// The point nearest to two or three lines, each weighted by its variance there: v = N^-1 sum n (n . q) / s^2,
/// N = sum n n^T / s^2 is the inverse of its covariance. `None` where the lines are parallel.
pub fn meet(lines: &[Line]) -> Option<Meeting> {
    const SURELY: f64 = 9.0;
    const LEAST_SINE: f64 = 0.03;
    // Of two lines the determinant is the squared sine of the angle between them.
    let across: Matrix2<f64> =
        lines.iter().map(|line| line.normal() * line.normal().transpose()).sum();
    if across.determinant() < LEAST_SINE * LEAST_SINE {
        return None;
    }
    let mut meeting: Option<Meeting> = None;
    // Variances are those at the meeting: that it must be near is not known the first time.
    for _ in 0..2 {
        let (mut normal, mut right, mut squares) = (Matrix2::zeros(), Vector2::zeros(), 0.0);
        let weighted = lines.iter().map(|line| {
            let along_px = meeting.map_or(0.0, |m| line.direction().dot(&(m.point - line.origin)));
            (line, line.normal(), 1.0 / line.variance_px2(along_px).max(1e-12))
        });
        for (line, across, weight) in weighted {
            let far_px = across.dot(&line.origin);
            normal += weight * across * across.transpose();
            right += weight * far_px * across;
            squares += weight * far_px * far_px;
        }
        let inverse = normal.try_inverse()?;
        let point = inverse * right;
        let left_over = squares - point.dot(&right);
        let excess = if lines.len() > 2 && left_over > SURELY { left_over } else { 1.0 };
        meeting = Some(Meeting { point, covariance_px2: excess * inverse });
    }
    meeting.filter(|found| found.point.iter().all(|place| place.is_finite()))
}

/// Whether lines that leave a point make a corner of it: not where two are one straight edge, to within three
/// standard deviations and no less than `least_rad`.
///
/// # Errors
/// Singular of two such lines, false corner where a third one ends at them.
pub fn corner(lines: &[Line], least_rad: f64) -> Result<(), RefineStatus> {
    for (index, a) in lines.iter().enumerate() {
        for b in &lines[index + 1..] {
            let turn = (a.angle_rad - b.angle_rad).rem_euclid(std::f64::consts::TAU);
            let deviation = (a.covariance[(1, 1)] + b.covariance[(1, 1)]).sqrt();
            if (turn - std::f64::consts::PI).abs() < least_rad.max(3.0 * deviation) {
                let is_edge = lines.len() == 2;
                return Err(if is_edge {
                    RefineStatus::Singular
                } else {
                    RefineStatus::FalseCorner
                });
            }
        }
    }
    Ok(())
}

/// The point as one of the image.
pub fn image_point(point: Vector2<f64>) -> ImagePoint {
    ImagePoint::new(point.x, point.y)
}
