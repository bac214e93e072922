//! A blurred junction and its derivatives on many pixels at once.
//!
//! The blurred sector of [`crate::junction`] falls into terms that belong to one ray each. With u and w the
//! place of a pixel along and across the ray, from the vertex and in units of the blur,
//!
//! S_i = A_i - A_(i+1) + (1/2 where w_i and w_(i+1) differ in sign),  A = Phi(w) / 2 - T(w, u / w)
//!
//! for a sector of less than half a turn from ray i to ray i+1 (Owen 1956, Tables for computing bivariate
//! normal probabilities, equation 2.1, T is his). What a sector gains where ray i moves is
//!
//! P = phi(w) Phi(u),  M = phi(w) (u Phi(u) + phi(u)),  Q = phi(w) ((u^2 + 1) Phi(u) + u phi(u)):
//!
//! the blurred ray, and its first and second moment along itself. All derivatives are sums of these:
//! grad S_i = (n_i P_i - n_(i+1) P_(i+1)) / sigma, and a sector with a ramp, x S + sigma^2 dS/dx, is exact.
//!
//! A pixel's square has the variance of a Gaussian, 1/12 px^2 along each axis, but less of the fourth order:
//! the logarithm of its transfer function, sin(f/2) / (f/2), is -f^2/24 - f^4/2880 - ... Over pixels,
//! therefore, S - (d^4/dx^4 + d^4/dy^4) S / 2880, which again is a term for each ray.

use pulp::Simd;

use crate::vector::{Lanes, Real};

/// So many rays at most.
pub const MOST_RAYS: usize = 3;

/// Where rays are and how they are blurred.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rays {
    /// Where they start \[px\].
    pub vertex: [f64; 2],
    /// Standard deviation of the blur \[px\]: over pixels with their area, `hypot(blur, 1 / sqrt(12))`.
    pub sigma_px: f64,
    /// How many there are: 2 or 3.
    pub count: usize,
    /// Their directions, from x right towards y down \[rad\], ascending by less than a turn in all.
    pub angles_rad: [f64; MOST_RAYS],
}

impl Rays {
    /// The ray after one.
    #[inline(always)]
    pub fn next(&self, ray: usize) -> usize {
        if ray + 1 == self.count { 0 } else { ray + 1 }
    }

    /// The angle from a ray to the next one \[rad\], in (0, 2 pi).
    pub fn opening_rad(&self, ray: usize) -> f64 {
        let next = self.next(ray);
        let turn = if next == 0 { std::f64::consts::TAU } else { 0.0 };
        self.angles_rad[next] + turn - self.angles_rad[ray]
    }

    /// The others, without one of three.
    pub fn without(&self, ray: usize) -> Self {
        let mut others = Self { count: 0, ..*self };
        for kept in (0..self.count).filter(|kept| *kept != ray) {
            others.angles_rad[others.count] = self.angles_rad[kept];
            others.count += 1;
        }
        others
    }

    /// All of them and one more, in order; of two.
    pub fn with(&self, angle_rad: f64) -> Self {
        let mut more = Self { count: self.count + 1, ..*self };
        more.angles_rad[self.count] = angle_rad;
        // All in one turn, and in order.
        for angle in &mut more.angles_rad[..more.count] {
            *angle = angle.rem_euclid(std::f64::consts::TAU);
        }
        more.angles_rad[..more.count].sort_by(f64::total_cmp);
        more
    }

    /// The sector that is widest: it is what the others leave.
    pub fn widest(&self) -> usize {
        (0..self.count)
            .max_by(|a, b| self.opening_rad(*a).total_cmp(&self.opening_rad(*b)))
            .unwrap_or(0)
    }
}

/// Where pixels are \[px\]; so many that they fill whole vectors of any machine: multiples of 16.
#[derive(Clone, Debug, Default)]
pub struct Places {
    /// Columns.
    pub x: Vec<f32>,
    /// Rows.
    pub y: Vec<f32>,
}

impl Places {
    /// Those of a picture's pixels, row by row, each this far from its centre; what fills the last vector is in
    /// the first pixel.
    pub fn fill(&mut self, width: usize, height: usize, [right, down]: [f64; 2]) {
        self.x.clear();
        self.y.clear();
        #[allow(clippy::cast_possible_truncation, reason = "places are in single precision")]
        for y in 0..height {
            self.x.extend((0..width).map(|x| (x as f64 + right) as f32));
            self.y.resize(self.x.len(), (y as f64 + down) as f32);
        }
        self.pad();
    }

    /// Fills the last vector with places in the middle.
    pub fn pad(&mut self) {
        let count = self.x.len().next_multiple_of(16);
        self.x.resize(count, 0.0);
        self.y.resize(count, 0.0);
    }
}

/// In units of the blur: what a Gaussian still has there, less than 1e-9, single precision does not know.
const FAR: f32 = 6.0;

/// So near to the vertex nothing is different.
const NEXT_TO_PX: f32 = 1e-6;

/// What a sample is the mean of, beside the blur.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Area {
    /// Nothing more: the value at a point.
    Point,
    /// The square of a pixel, whose variance is part of the blur.
    Pixel,
}

/// What rays make of places: shares of sectors, and what rays that move would change.
#[derive(Clone, Debug, Default)]
pub struct Fields {
    /// Of each sector from one ray to the next: its share.
    pub share: [Vec<f32>; MOST_RAYS],
    /// Of each ray: P.
    pub line: [Vec<f32>; MOST_RAYS],
    /// Of each ray: M.
    pub moment: [Vec<f32>; MOST_RAYS],
    /// Of each ray: Q.
    pub second_moment: [Vec<f32>; MOST_RAYS],
}

impl Fields {
    /// Computes all of them. What rays that move would change is that of a Gaussian alone.
    pub fn compute(&mut self, rays: &Rays, places: &Places, area: Area) {
        pulp::Arch::new().dispatch(Compute { fields: self, rays, places, area });
    }
}

struct Compute<'a> {
    fields: &'a mut Fields,
    rays: &'a Rays,
    places: &'a Places,
    area: Area,
}

impl pulp::WithSimd for Compute<'_> {
    type Output = ();

    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "samples are in single precision")]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { fields, rays, places, area } = self;
        let count = places.x.len();
        let Fields { share, line, moment, second_moment } = fields;
        for field in [&mut *share, line, moment, second_moment] {
            field[..rays.count].iter_mut().for_each(|of_one| of_one.resize(count, 0.0));
        }
        let splat = |value: f64| Lanes::splat(simd, value as f32);
        let zero = splat(0.0);
        let widest = rays.widest();
        let mut cosines = [zero; MOST_RAYS];
        let mut sines = [zero; MOST_RAYS];
        let mut squares = [Square::none(zero); MOST_RAYS];
        for ray in 0..rays.count {
            let (sine, cosine) = rays.angles_rad[ray].sin_cos();
            cosines[ray] = splat(cosine / rays.sigma_px);
            sines[ray] = splat(sine / rays.sigma_px);
            if area == Area::Pixel {
                squares[ray] = Square::of([sine, cosine], rays.sigma_px).map(splat);
            }
        }
        let [vertex_x, vertex_y] = rays.vertex.map(splat);
        let mut first = 0;
        while first < count {
            // On the vertex itself a ray's terms depend on where one comes from: for all rays from one side.
            let dx = Lanes::load(simd, &places.x, first) - vertex_x + NEXT_TO_PX;
            let dy = Lanes::load(simd, &places.y, first) - vertex_y;
            let mut halves = [zero; MOST_RAYS];
            let mut signs = [zero; MOST_RAYS];
            for ray in 0..rays.count {
                let u = dx.mul_add(cosines[ray], dy * sines[ray]);
                let w = dy.mul_add(cosines[ray], zero - dx * sines[ray]);
                let terms = Terms::of(simd, u, w, &squares[ray]);
                halves[ray] = terms.half;
                signs[ray] = splat(0.5).copysign(w);
                terms.line.store(&mut line[ray], first);
                terms.moment.store(&mut moment[ray], first);
                terms.second_moment.store(&mut second_moment[ray], first);
            }
            let mut rest = splat(1.0);
            for sector in 0..rays.count {
                if sector == widest {
                    continue;
                }
                let next = rays.next(sector);
                let differ = (signs[sector] - signs[next]).abs() * 0.5;
                let of_sector = halves[sector] - halves[next] + differ;
                rest = rest - of_sector;
                of_sector.store(&mut share[sector], first);
            }
            rest.store(&mut share[widest], first);
            first += S::F32_LANES;
        }
    }
}

/// Of a ray at a place.
struct Terms<R> {
    /// A.
    half: R,
    line: R,
    moment: R,
    second_moment: R,
}

/// What the square of a pixel adds to A: with B = phi(u) phi(w),
/// B (a (u^2 - 1) + b u w + c (w^2 - 1)) - d (w^3 - 3 w) P.
#[derive(Clone, Copy)]
struct Square<R> {
    a: R,
    b: R,
    c: R,
    d: R,
}

impl<R: Copy> Square<R> {
    #[inline(always)]
    fn none(zero: R) -> Self {
        Self { a: zero, b: zero, c: zero, d: zero }
    }
}

impl Square<f64> {
    /// -(d^3/dx^3 n_x + d^3/dy^3 n_y) P / (2880 sigma) of a ray in this direction.
    fn of([sine, cosine]: [f64; 2], sigma_px: f64) -> Self {
        let scale = -1.0 / (2880.0 * sigma_px.powi(4));
        let both = sine * cosine;
        let skew = both * (sine * sine - cosine * cosine);
        Self {
            a: scale * skew,
            b: scale * 6.0 * both * both,
            c: -3.0 * scale * skew,
            d: scale * (1.0 - 2.0 * both * both),
        }
    }

    #[inline(always)]
    fn map<R>(self, of: impl Fn(f64) -> R) -> Square<R> {
        Square { a: of(self.a), b: of(self.b), c: of(self.c), d: of(self.d) }
    }
}

/// Nodes and weights of Gauss and Legendre on \[0, 1\], five of them.
const NODES: [(f32, f32); 5] = [
    (0.046_910_077, 0.118_463_44),
    (0.230_765_34, 0.239_314_33),
    (0.5, 0.284_444_45),
    (0.769_234_66, 0.239_314_33),
    (0.953_089_9, 0.118_463_44),
];

impl<S: Simd> Terms<Lanes<S>> {
    #[inline(always)]
    fn of(simd: S, u: Lanes<S>, w: Lanes<S>, square: &Square<Lanes<S>>) -> Self {
        const PER_TURN: f32 = 0.5 * std::f32::consts::FRAC_1_PI;
        let splat = |value: f32| Lanes::splat(simd, value);
        let one = splat(1.0);
        // Beside the ray and behind its start nothing changes.
        if w.abs().max(splat(0.0) - u).least() >= FAR {
            let (half, none) = (splat(0.25).copysign(w) + 0.25, splat(0.0));
            return Self { half, line: none, moment: none, second_moment: none };
        }
        let (bell_u, bell_w) = (bell(simd, u * u * -0.5), bell(simd, w * w * -0.5));
        let (below_u, below_w) = (normal_cdf(simd, u, bell_u), normal_cdf(simd, w, bell_w));

        // T(large, small / large), its integral by nodes; beyond the diagonal by his equation 2.2.
        let (across, along) = (w.abs(), u.abs());
        let small = across.min(along);
        let large = across.max(along).max(splat(1e-12));
        let ratio = small / large;
        let (ratio2, exponent) = (ratio * ratio, small * small * -0.5);
        let mut sum = splat(0.0);
        // Far from its start T's integral is nothing.
        if large.least() < FAR {
            for (node, weight) in NODES {
                let share = bell(simd, exponent * (node * node)) * weight;
                sum = sum + share / (ratio2 * (node * node) + 1.0);
            }
        }
        let within = ratio * PER_TURN * bell_u.min(bell_w) * sum;
        let (p, q) = (below_w.max(one - below_w), below_u.max(one - below_u));
        let beyond = (p + q) * 0.5 - p * q - within;
        let is_beyond = beyond.where_at_least(along, across) + within;
        let owen = is_beyond - within.where_at_least(along, across);
        let owen = owen.copysign(u * w);

        let density = bell_w * (PER_TURN * 2.0).sqrt() * std::f32::consts::FRAC_1_SQRT_2;
        let density_u = bell_u * (PER_TURN * 2.0).sqrt() * std::f32::consts::FRAC_1_SQRT_2;
        let line = density * below_u;
        let moment = density * u.mul_add(below_u, density_u);
        let (u2, w2) = (u * u, w * w);
        let hermite = square.a.mul_add(u2 - one, square.b * u * w);
        let hermite = square.c.mul_add(w2 - one, hermite);
        let of_square = density * density_u * hermite - square.d * w * (w2 + -3.0) * line;
        let half = below_w * 0.5 - owen + of_square;
        Self { half, line, moment, second_moment: u.mul_add(moment, line) }
    }
}

/// exp(x) of negative x, and 0 from -24 on, where single precision does not know it: products of four are still
/// far from the smallest numbers, with which machines are slow.
#[inline(always)]
fn bell<S: Simd>(simd: S, x: Lanes<S>) -> Lanes<S> {
    x.exp().where_at_least(x, Lanes::splat(simd, -24.0))
}

/// The normal distribution function at x, of which exp(-x^2 / 2) is known.
///
/// Abramowitz & Stegun (1964), Handbook of Mathematical Functions, 7.1.26: to 1e-7.
#[inline(always)]
fn normal_cdf<S: Simd>(simd: S, x: Lanes<S>, bell: Lanes<S>) -> Lanes<S> {
    let splat = |value: f32| Lanes::splat(simd, value);
    let t = splat(1.0) / (x.abs() * (0.327_591_1 * std::f32::consts::FRAC_1_SQRT_2) + 1.0);
    let mut sum = splat(1.061_405_4);
    for term in [-1.453_152, 1.421_413_7, -0.284_496_74, 0.254_829_6] {
        sum = sum.mul_add(t, splat(term));
    }
    let tail = sum * t * bell * 0.5;
    // 1/2 + (1/2 - tail), with x's sign.
    (splat(0.5) - tail).copysign(x) + 0.5
}
