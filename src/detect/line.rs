//! Straight lines in the image.

use crate::geometry::ImagePoint;

/// A straight line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Line {
    /// A point of it: the mean of those that it was fitted to.
    pub(super) point: ImagePoint,
    /// Along it, a unit vector.
    pub(super) direction: [f64; 2],
}

/// Sums of points, of which one more can be taken at any time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sums {
    /// What all coordinates are counted from, so that nothing is lost where the image is large.
    origin: ImagePoint,
    count: f64,
    first: [f64; 2],
    second: [f64; 3],
}

impl Sums {
    /// Of no points; those to come lie near `origin`.
    pub(super) fn new(origin: ImagePoint) -> Self {
        Self { origin, count: 0.0, first: [0.0; 2], second: [0.0; 3] }
    }

    /// Takes one more.
    pub(super) fn add(&mut self, point: ImagePoint) {
        let (x, y) = (point.x - self.origin.x, point.y - self.origin.y);
        self.count += 1.0;
        self.first = [self.first[0] + x, self.first[1] + y];
        self.second = [self.second[0] + x * x, self.second[1] + x * y, self.second[2] + y * y];
    }

    /// The line of least squared distances from the points; along x where all are one point.
    pub(super) fn line(&self) -> Line {
        let count = self.count.max(1.0);
        let [x, y] = self.first.map(|sum| sum / count);
        let scatter = [
            self.second[0] - count * x * x,
            self.second[1] - count * x * y,
            self.second[2] - count * y * y,
        ];
        let (sine, cosine) = (0.5 * (2.0 * scatter[1]).atan2(scatter[0] - scatter[2])).sin_cos();
        Line {
            point: ImagePoint::new(self.origin.x + x, self.origin.y + y),
            direction: [cosine, sine],
        }
    }
}

impl Line {
    /// The line of least squared distances from points.
    pub(super) fn through(points: impl IntoIterator<Item = ImagePoint>) -> Self {
        let mut points = points.into_iter().peekable();
        let mut sums = Sums::new(points.peek().copied().unwrap_or(ImagePoint::new(0.0, 0.0)));
        points.for_each(|point| sums.add(point));
        sums.line()
    }

    /// How far along the line, from its point, a point lies \[px\].
    pub(super) fn along(&self, point: ImagePoint) -> f64 {
        self.direction[0] * (point.x - self.point.x) + self.direction[1] * (point.y - self.point.y)
    }

    /// How far from the line a point lies, to the right of its direction as seen \[px\].
    pub(super) fn off(&self, point: ImagePoint) -> f64 {
        self.direction[0] * (point.y - self.point.y) - self.direction[1] * (point.x - self.point.x)
    }

    /// The point so far along the line \[px\].
    pub(super) fn at(&self, along: f64) -> ImagePoint {
        ImagePoint::new(
            self.point.x + along * self.direction[0],
            self.point.y + along * self.direction[1],
        )
    }

    /// The sine of the angle from this line's direction to another's.
    pub(super) fn sine(&self, other: &Self) -> f64 {
        self.direction[0] * other.direction[1] - self.direction[1] * other.direction[0]
    }

    /// Where two lines meet; `None` of parallel ones.
    pub(super) fn intersection(&self, other: &Self) -> Option<ImagePoint> {
        let along = other.off(self.point) / self.sine(other);
        let point = self.at(along);
        (point.x.is_finite() && point.y.is_finite()).then_some(point)
    }
}

/// The point of least weighted squared distances from lines; `None` where all are parallel.
pub(super) fn meeting(lines: impl Iterator<Item = (Line, f64)>) -> Option<ImagePoint> {
    let (mut matrix, mut vector) = ([0.0; 3], [0.0; 2]);
    let mut origin = None;
    for (line, weight) in lines {
        let origin = *origin.get_or_insert(line.point);
        let normal = [-line.direction[1], line.direction[0]];
        let distance = -line.off(origin);
        matrix[0] += weight * normal[0] * normal[0];
        matrix[1] += weight * normal[0] * normal[1];
        matrix[2] += weight * normal[1] * normal[1];
        vector[0] += weight * normal[0] * distance;
        vector[1] += weight * normal[1] * distance;
    }
    let origin = origin?;
    let determinant = matrix[0] * matrix[2] - matrix[1] * matrix[1];
    let x = (matrix[2] * vector[0] - matrix[1] * vector[1]) / determinant;
    let y = (matrix[0] * vector[1] - matrix[1] * vector[0]) / determinant;
    (x.is_finite() && y.is_finite()).then(|| ImagePoint::new(origin.x + x, origin.y + y))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(x: f64, y: f64, degrees: f64) -> Line {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        Line { point: ImagePoint::new(x, y), direction: [cosine, sine] }
    }

    #[test]
    fn a_line_is_fitted_through_its_points_at_any_angle() {
        for degrees in [0.0, 30.0, 45.0, 90.0, 100.0, 179.0] {
            let drawn = line(800.0, 500.0, degrees);
            let found = Line::through((0..20).map(|k| drawn.at(f64::from(k))));
            assert!(found.sine(&drawn).abs() < 1e-9, "{degrees}");
            assert!(found.off(ImagePoint::new(800.0, 500.0)).abs() < 1e-9, "{degrees}");
        }
    }

    #[test]
    fn lines_meet_where_they_were_drawn_through() {
        let middle = ImagePoint::new(40.3, 22.9);
        let through = |degrees: f64, along: f64| {
            let drawn = line(middle.x, middle.y, degrees);
            Line { point: drawn.at(along), ..drawn }
        };
        let lines = [through(10.0, 30.0), through(75.0, -12.0), through(140.0, 9.0)];
        let pair = lines[0].intersection(&lines[1]).expect("not parallel");
        assert!(pair.distance_px(middle) < 1e-9, "{pair:?}");
        let all = meeting(lines.into_iter().map(|line| (line, 2.0))).expect("not parallel");
        assert!(all.distance_px(middle) < 1e-9, "{all:?}");
        assert!(lines[0].intersection(&lines[0]).is_none());
        assert!(meeting(std::iter::empty()).is_none());
    }

    #[test]
    fn right_of_a_line_is_positive() {
        assert!(line(0.0, 0.0, 0.0).off(ImagePoint::new(3.0, 2.0)) > 1.9);
    }
}
