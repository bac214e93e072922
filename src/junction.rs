//! The image of a blurred junction in closed form: straight edges that meet in a point, each sector
//! between two of them of one radiance, blurred by a Gaussian and integrated over pixels.
//!
//! A sector of less than half a turn is the set where two linear functions of the place are positive.
//! Blurred, it is the distribution function of two correlated normal variables:
//!
//! S = Phi2(h, k; rho), h = n1 (x - v) / sigma, k = n2 (x - v) / sigma, rho = n1 n2,
//!
//! with the inward normals n1 and n2 of the two edges and the vertex v. Sectors of more than half a
//! turn are what is left by the others. Rohr (1992), Recognizing corners by fitting parametric models,
//! has wedges blurred by a Gaussian; Olague & Hernandez (2005) junctions of several. Here the sector is
//! not approximated.

pub mod drawing;
pub mod fit;
pub mod rays;

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use serde::{Deserialize, Serialize};

use crate::geometry::ImagePoint;

/// What a corner looks like: what the edges make that are seen from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Junction {
    /// Two edges.
    L,
    /// Three edges, less than half a turn between any two neighbours.
    Y,
    /// Three edges on one side.
    #[serde(rename = "arrow")]
    Arrow,
    /// An edge that ends at another one, which goes on: an outline before an edge.
    T,
    /// Four edges, two and two in line: of a board.
    X,
    /// One edge.
    #[serde(rename = "edge end")]
    EdgeEnd,
}

impl Junction {
    /// The name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::L => "L",
            Self::Y => "Y",
            Self::Arrow => "arrow",
            Self::T => "T",
            Self::X => "X",
            Self::EdgeEnd => "edge end",
        }
    }
}

/// Straight edges that meet in a point, and the radiance between them.
#[derive(Clone, Debug, PartialEq)]
pub struct BlurredJunction {
    /// Where the edges meet.
    pub vertex: ImagePoint,
    /// Directions of the edges away from the vertex, from x right towards y down \[rad\], ascending by
    /// less than a turn in all; two or more.
    pub edges_rad: Vec<f64>,
    /// Of the sector between each edge and the next one (of the last: the first): its value.
    pub levels: Vec<f64>,
    /// Standard deviation of the blur \[px\].
    pub sigma_px: f64,
}

/// Nodes and weights of Gauss and Legendre on \[-1, 1\], ten of them; the other half is symmetric.
const NODES: [(f64, f64); 5] = [
    (0.148_874_338_981_631_2, 0.295_524_224_714_752_87),
    (0.433_395_394_129_247_2, 0.269_266_719_309_996_35),
    (0.679_409_568_299_024_4, 0.219_086_362_515_982_04),
    (0.865_063_366_688_984_5, 0.149_451_349_150_580_6),
    (0.973_906_528_517_171_7, 0.066_671_344_308_688_14),
];

/// Integrates a function over an interval by ten nodes.
fn integral(from: f64, to: f64, mut function: impl FnMut(f64) -> f64) -> f64 {
    let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
    let sum: f64 = NODES
        .iter()
        .map(|(node, weight)| {
            weight * (function(middle - half * node) + function(middle + half * node))
        })
        .sum();
    half * sum
}

/// The normal distribution function.
pub fn normal_cdf(x: f64) -> f64 {
    0.5 * libm::erfc(-x * FRAC_1_SQRT_2)
}

/// The distribution function of two normal variables of variance 1 and correlation `rho`: the
/// probability that they lie below `h` and `k`.
///
/// Drezner & Wesolowsky (1990), On the computation of the bivariate normal integral, equation 3, its
/// integral split ever more finely towards a correlation of one.
pub fn bivariate_normal_cdf(h: f64, k: f64, rho: f64) -> f64 {
    let end = rho.clamp(-1.0, 1.0).asin();
    let integrand = |angle: f64| {
        let (sine, cosine) = angle.sin_cos();
        let square = cosine * cosine;
        // Beyond 1e-300 nothing is left of it.
        if square < 1e-300 {
            return 0.0;
        }
        (-(h * h + k * k - 2.0 * h * k * sine) / (2.0 * square)).exp()
    };
    let mut sum = 0.0;
    let mut from = 0.0;
    // Panels end a half, a quarter, an eighth of a right angle before it.
    let mut left = 0.25 * PI;
    while from < end.abs() {
        let to = if left < 1e-12 { end.abs() } else { (0.5 * PI - left).min(end.abs()) };
        sum += integral(from, to, |angle| integrand(angle.copysign(end)));
        from = to;
        left *= 0.5;
    }
    (normal_cdf(h) * normal_cdf(k) + sum.copysign(end) / (2.0 * PI)).clamp(0.0, 1.0)
}

impl BlurredJunction {
    /// An L: one surface before another, its edges at `first_rad` and, clockwise as seen, `opening_rad`
    /// further on. Levels are those inside and outside.
    pub fn l(
        vertex: ImagePoint,
        [first_rad, opening_rad]: [f64; 2],
        levels: [f64; 2],
        sigma_px: f64,
    ) -> Self {
        let edges_rad = vec![first_rad, first_rad + opening_rad];
        Self { vertex, edges_rad, levels: levels.to_vec(), sigma_px }
    }

    /// A Y, if less than half a turn lies between neighbours of the three edges; an arrow, if more lies
    /// between two of them.
    pub fn y_or_arrow(
        vertex: ImagePoint,
        edges_rad: [f64; 3],
        levels: [f64; 3],
        sigma_px: f64,
    ) -> Self {
        Self { vertex, edges_rad: edges_rad.to_vec(), levels: levels.to_vec(), sigma_px }
    }

    /// A T: at a straight edge in the directions `bar_rad` and opposite, an edge ends that comes from
    /// `stem_rad` further on, less than half a turn. Levels are those on either side of the stem and
    /// beyond the bar. A true corner that is hidden but for one of its edges, an edge end, looks the same.
    pub fn t(
        vertex: ImagePoint,
        [bar_rad, stem_rad]: [f64; 2],
        levels: [f64; 3],
        sigma_px: f64,
    ) -> Self {
        Self::y_or_arrow(vertex, [bar_rad, bar_rad + stem_rad, bar_rad + PI], levels, sigma_px)
    }

    /// An X: two straight edges that cross, one in the directions `first_rad` and opposite, the other
    /// `opening_rad` further on, less than half a turn. Levels are those of opposite sectors.
    pub fn x(
        vertex: ImagePoint,
        [first_rad, opening_rad]: [f64; 2],
        [first, second]: [f64; 2],
        sigma_px: f64,
    ) -> Self {
        let edges_rad = [0.0, opening_rad, PI, opening_rad + PI].map(|turn| first_rad + turn);
        let levels = vec![first, second, first, second];
        Self { vertex, edges_rad: edges_rad.to_vec(), levels, sigma_px }
    }

    /// The value at a place, without the pixel's area.
    pub fn value(&self, x: f64, y: f64) -> f64 {
        let (dx, dy) = ((x - self.vertex.x) / self.sigma_px, (y - self.vertex.y) / self.sigma_px);
        let count = self.edges_rad.len();
        let last = self.levels[count - 1];
        // Of the last sector is what no other one covers.
        (0..count - 1)
            .map(|sector| {
                let (from, to) = (self.edges_rad[sector], self.edges_rad[sector + 1]);
                (self.levels[sector] - last) * covered(dx, dy, from, to)
            })
            .sum::<f64>()
            + last
    }

    /// The mean over a pixel's aperture, a square of side `aperture_px` about the pixel's centre.
    pub fn over_pixel(&self, x: usize, y: usize, aperture_px: f64) -> f64 {
        // Ten nodes see a blur of a fifth of their interval to better than 1e-6.
        let parts = (0.25 * aperture_px / self.sigma_px).ceil().max(1.0);
        let width = aperture_px / parts;
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a small number"
        )]
        let parts = parts as usize;
        let start =
            |centre: usize, part: usize| centre as f64 - 0.5 * aperture_px + part as f64 * width;
        let mut sum = 0.0;
        for row in 0..parts {
            for column in 0..parts {
                let (left, top) = (start(x, column), start(y, row));
                sum += integral(top, top + width, |v| {
                    integral(left, left + width, |u| self.value(u, v))
                });
            }
        }
        sum / (aperture_px * aperture_px)
    }
}

/// How much of a sector from one direction to another is seen at a place, in units of the blur.
fn covered(dx: f64, dy: f64, from: f64, to: f64) -> f64 {
    let turn = to - from;
    if turn > PI {
        return 1.0 - covered(dx, dy, to, from + 2.0 * PI);
    }
    let (sine_from, cosine_from) = from.sin_cos();
    let (sine_to, cosine_to) = to.sin_cos();
    let h = -sine_from * dx + cosine_from * dy;
    if PI - turn < 1e-7 {
        return normal_cdf(h); // One straight edge.
    }
    let k = sine_to * dx - cosine_to * dy;
    bivariate_normal_cdf(h, k, -turn.cos())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bivariate_distribution_is_the_integral_of_its_density() {
        // By the conditional distribution: the integral over x below h of phi(x) Phi((k - rho x) / s).
        for rho in [-0.995_f64, -0.9, -0.5, 0.0, 0.3, 0.77, 0.97, 0.999] {
            let s = (1.0 - rho * rho).sqrt();
            for h in [-3.0, -0.7, 0.0, 0.4, 2.5] {
                for k in [-2.0, -0.69, 0.0, 0.41, 3.0] {
                    let steps = 4000;
                    let width = (h + 9.0) / f64::from(steps);
                    let wanted: f64 = (0..steps)
                        .map(|step| {
                            let from = -9.0 + f64::from(step) * width;
                            integral(from, from + width, |x: f64| {
                                (-0.5 * x * x).exp() / (2.0 * PI).sqrt()
                                    * normal_cdf((k - rho * x) / s)
                            })
                        })
                        .sum();
                    let found = bivariate_normal_cdf(h, k, rho);
                    assert!((found - wanted).abs() < 1e-9, "{h} {k} {rho}: {found} {wanted}");
                }
            }
        }
        assert!((bivariate_normal_cdf(0.3, 0.9, 1.0) - normal_cdf(0.3)).abs() < 1e-9);
        assert!(
            (bivariate_normal_cdf(0.3, 0.9, -1.0) - (normal_cdf(0.3) + normal_cdf(0.9) - 1.0))
                .abs()
                < 1e-9
        );
    }

    /// Junctions of all kinds: two edges, three within and without half a turn, T, X, and one more than
    /// half a turn wide.
    fn some_junctions() -> Vec<BlurredJunction> {
        let vertex = ImagePoint::new(0.23, -0.41);
        let pair = |angles: [f64; 2]| angles.map(f64::to_radians);
        let three = |angles: [f64; 3]| angles.map(f64::to_radians);
        [0.3, 0.7, 1.5]
            .into_iter()
            .flat_map(|sigma| {
                [
                    BlurredJunction::l(vertex, pair([20.0, 90.0]), [1.0, 0.2], sigma),
                    BlurredJunction::l(vertex, pair([-40.0, 240.0]), [0.3, 0.9], sigma),
                    BlurredJunction::l(vertex, pair([33.0, 180.0]), [0.8, 0.1], sigma),
                    BlurredJunction::y_or_arrow(
                        vertex,
                        three([10.0, 130.0, 250.0]),
                        [0.9, 0.5, 0.2],
                        sigma,
                    ),
                    BlurredJunction::y_or_arrow(
                        vertex,
                        three([7.0, 57.0, 117.0]),
                        [0.9, 0.5, 0.1],
                        sigma,
                    ),
                    BlurredJunction::t(vertex, pair([30.0, 90.0]), [0.7, 0.4, 0.1], sigma),
                    BlurredJunction::t(vertex, pair([200.0, 27.0]), [0.1, 0.9, 0.5], sigma),
                    BlurredJunction::x(vertex, pair([15.0, 80.0]), [1.0, 0.0], sigma),
                ]
            })
            .collect()
    }

    /// Brute force: the pixel's box convolved with the blur, as weights of a fine grid of places whose
    /// sector is told by their angle.
    fn brute_force(junction: &BlurredJunction, x: usize, y: usize) -> f64 {
        const CELLS: i32 = 3200;
        let (sigma, reach) = (junction.sigma_px, 0.5 + 6.0 * junction.sigma_px);
        let width = 2.0 * reach / f64::from(CELLS);
        let weight =
            |offset: f64| normal_cdf((offset + 0.5) / sigma) - normal_cdf((offset - 0.5) / sigma);
        let weights: Vec<f64> =
            (0..CELLS).map(|cell| weight((f64::from(cell) + 0.5) * width - reach)).collect();
        let total: f64 = weights.iter().sum();
        let start = junction.edges_rad[0];
        let mut sum = 0.0;
        for (row, down) in (0..).zip(&weights) {
            let dy = y as f64 + (f64::from(row) + 0.5) * width - reach - junction.vertex.y;
            for (column, across) in (0..).zip(&weights) {
                let dx = x as f64 + (f64::from(column) + 0.5) * width - reach - junction.vertex.x;
                let angle = (dy.atan2(dx) - start).rem_euclid(2.0 * PI);
                let sector = junction.edges_rad.iter().rposition(|edge| edge - start <= angle);
                sum += down * across * junction.levels[sector.unwrap_or(0)];
            }
        }
        sum / (total * total)
    }

    #[test]
    fn pixels_of_every_junction_equal_brute_force() {
        for (junction, (x, y)) in
            some_junctions().iter().zip([(0, 0), (1, 0), (0, 1)].iter().cycle())
        {
            let (found, wanted) = (junction.over_pixel(*x, *y, 1.0), brute_force(junction, *x, *y));
            // Of edges along its rows or diagonals the grid would see the places to half a cell only.
            assert!((found - wanted).abs() < 1e-5, "{junction:?} {x} {y}: {found} {wanted}");
        }
    }

    #[test]
    fn a_t_s_bar_and_an_x_s_edges_are_straight() {
        let vertex = ImagePoint::new(3.0, 4.0);
        let t = BlurredJunction::t(vertex, [0.0, 0.5 * PI], [0.7, 0.4, 0.1], 0.5);
        // The bar is horizontal; the stem comes from below, what is right of it from the bar's first end.
        assert!((t.value(9.0, 9.0) - 0.7).abs() < 1e-9);
        assert!((t.value(-3.0, 9.0) - 0.4).abs() < 1e-9);
        for x in [-3.0, 3.0, 9.0] {
            assert!((t.value(x, -1.0) - 0.1).abs() < 1e-9);
        }
        let x = BlurredJunction::x(vertex, [0.0, 0.5 * PI], [1.0, 0.0], 0.5);
        for (dx, dy, wanted) in [(5.0, 5.0, 1.0), (-5.0, 5.0, 0.0), (-5.0, -5.0, 1.0)] {
            assert!((x.value(vertex.x + dx, vertex.y + dy) - wanted).abs() < 1e-9);
        }
        assert!((x.value(vertex.x, vertex.y) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn far_from_its_vertex_a_junction_is_its_sectors() {
        for junction in some_junctions() {
            let count = junction.edges_rad.len();
            for sector in 0..count {
                let to = junction.edges_rad.get(sector + 1).copied();
                let to = to.unwrap_or(junction.edges_rad[0] + 2.0 * PI);
                let (sine, cosine) = (0.5 * (junction.edges_rad[sector] + to)).sin_cos();
                let (x, y) = (junction.vertex.x + 60.0 * cosine, junction.vertex.y + 60.0 * sine);
                let found = junction.value(x, y);
                let wanted = junction.levels[sector];
                assert!((found - wanted).abs() < 1e-12, "{junction:?} {sector}: {found}");
            }
        }
    }
}
