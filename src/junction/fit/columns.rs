//! The columns of a fit, weighted, and their inner products: compiled for the machine's vectors.

use pulp::Simd;

use super::{COLUMNS, Channel, Levels, MOST_LEVELS, Products, REST, Samples};
use crate::junction::rays::{Fields, MOST_RAYS, Rays};
use crate::vector::{Lanes, Real};

/// Fills the columns of levels, and of the samples.
pub(super) struct Basis<'a> {
    pub fields: &'a Fields,
    pub columns: &'a mut [f32],
    pub samples: &'a Samples,
    pub channel: &'a Channel,
    pub rays: &'a Rays,
    pub per_sector: usize,
}

impl pulp::WithSimd for Basis<'_> {
    type Output = ();

    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "samples are in single precision")]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { fields, columns, samples, channel, rays, per_sector } = self;
        let splat = |value: f64| Lanes::splat(simd, value as f32);
        let count = samples.places.x.len();
        let scale = splat(1.0 / samples.radius_px);
        let sigma = splat(rays.sigma_px);
        let mut normals = [[splat(0.0); 2]; MOST_RAYS];
        for (normal, angle) in normals[..rays.count].iter_mut().zip(rays.angles_rad) {
            let (sine, cosine) = angle.sin_cos();
            *normal = [splat(-sine), splat(cosine)];
        }
        let mut first = 0;
        while first < count {
            let weight = Lanes::load(simd, &channel.weights, first);
            let scaled = weight * scale;
            let x = Lanes::load(simd, &samples.places.x, first);
            let y = Lanes::load(simd, &samples.places.y, first);
            for sector in 0..rays.count {
                let share = Lanes::load(simd, &fields.share[sector], first);
                let column = per_sector * sector * count + first;
                (weight * share).store(columns, column);
                if per_sector == 1 {
                    continue;
                }
                let next = rays.next(sector);
                let line = Lanes::load(simd, &fields.line[sector], first) * sigma;
                let other = Lanes::load(simd, &fields.line[next], first) * sigma;
                for (term, place) in [x, y].into_iter().enumerate() {
                    let slope = normals[sector][term] * line - normals[next][term] * other;
                    let value = scaled * place.mul_add(share, slope);
                    value.store(columns, column + (term + 1) * count);
                }
            }
            let sample = Lanes::load(simd, &channel.samples, first);
            (weight * sample).store(columns, REST * count + first);
            first += S::F32_LANES;
        }
    }
}

/// Fills the columns of the shape, and takes what the levels explain from the samples.
pub(super) struct Shape<'a> {
    pub fields: &'a Fields,
    pub columns: &'a mut [f32],
    pub samples: &'a Samples,
    pub channel: &'a Channel,
    pub rays: &'a Rays,
    pub per_sector: usize,
    pub levels: &'a Levels,
}

impl pulp::WithSimd for Shape<'_> {
    type Output = ();

    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, reason = "samples are in single precision")]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { fields, columns, samples, channel, rays, per_sector, levels } = self;
        let splat = |value: f64| Lanes::splat(simd, value as f32);
        let zero = splat(0.0);
        let count = samples.places.x.len();
        let sigma = rays.sigma_px;
        let [mut at_vertex, mut along] = [[zero; MOST_RAYS]; 2];
        let mut normals = [[zero; 2]; MOST_RAYS];
        let mut directions = [[zero; 2]; MOST_RAYS];
        for ray in 0..rays.count {
            let before = if ray == 0 { rays.count - 1 } else { ray - 1 };
            let jump = [0, 1, 2].map(|term| levels[ray][term] - levels[before][term]);
            let slope = [jump[1], jump[2]].map(|jump| jump / samples.radius_px);
            let (sine, cosine) = rays.angles_rad[ray].sin_cos();
            let there = jump[0] + slope[0] * rays.vertex[0] + slope[1] * rays.vertex[1];
            at_vertex[ray] = splat(there);
            along[ray] = splat(sigma * (slope[0] * cosine + slope[1] * sine));
            normals[ray] = [splat(sine / sigma), splat(-cosine / sigma)];
            directions[ray] = [splat(cosine / sigma), splat(sine / sigma)];
        }
        let mut coefficients = [zero; MOST_LEVELS];
        let used = per_sector * rays.count;
        for sector in 0..rays.count {
            for term in 0..per_sector {
                coefficients[per_sector * sector + term] = splat(levels[sector][term]);
            }
        }
        let [vertex_x, vertex_y] = rays.vertex.map(splat);
        let mut first = 0;
        while first < count {
            let weight = Lanes::load(simd, &channel.weights, first);
            let dx = Lanes::load(simd, &samples.places.x, first) - vertex_x;
            let dy = Lanes::load(simd, &samples.places.y, first) - vertex_y;
            let mut sums = [zero; 3];
            for ray in 0..rays.count {
                let line = Lanes::load(simd, &fields.line[ray], first);
                let moment = Lanes::load(simd, &fields.moment[ray], first);
                let second = Lanes::load(simd, &fields.second_moment[ray], first);
                let jump = weight * line.mul_add(at_vertex[ray], moment * along[ray]);
                let turn = weight * moment.mul_add(at_vertex[ray], second * along[ray]);
                sums[0] = jump.mul_add(normals[ray][0], sums[0]);
                sums[1] = jump.mul_add(normals[ray][1], sums[1]);
                let across = dy.mul_add(directions[ray][0], zero - dx * directions[ray][1]);
                sums[2] = sums[2] - jump * across;
                let column = MOST_LEVELS + 3 + ray;
                (zero - turn).store(columns, column * count + first);
            }
            sums[2] = sums[2] * splat(1.0 / sigma);
            for (index, sum) in sums.into_iter().enumerate() {
                sum.store(columns, (MOST_LEVELS + index) * count + first);
            }
            let mut rest = Lanes::load(simd, columns, REST * count + first);
            for (level, coefficient) in coefficients[..used].iter().enumerate() {
                let column = Lanes::load(simd, columns, level * count + first);
                rest = rest - column * *coefficient;
            }
            rest.store(columns, REST * count + first);
            first += S::F32_LANES;
        }
    }
}

/// Inner products of columns with others.
pub(super) struct Multiply<'a> {
    pub columns: &'a [f32],
    pub products: &'a mut Products,
    pub rows: &'a [usize],
    pub others: &'a [usize],
}

/// So many columns by so many others: their sums are in registers, a column is read for several of them.
const TILE: [usize; 2] = [3, 4];

impl pulp::WithSimd for Multiply<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { columns, products, rows, others } = self;
        let count = columns.len() / COLUMNS;
        let column = |index: usize| &columns[index * count..][..count];
        for of_rows in rows.chunks(TILE[0]) {
            for of_others in others.chunks(TILE[1]) {
                // Those that are no more are the first again.
                let of_tile: [usize; TILE[0]] =
                    std::array::from_fn(|i| of_rows[if i < of_rows.len() { i } else { 0 }]);
                let by: [usize; TILE[1]] =
                    std::array::from_fn(|i| of_others[if i < of_others.len() { i } else { 0 }]);
                let (rows, others) = (of_tile.map(column), by.map(column));
                let mut sums = [[Lanes::splat(simd, 0.0); TILE[1]]; TILE[0]];
                let mut first = 0;
                while first < count {
                    let mut values = [Lanes::splat(simd, 0.0); TILE[1]];
                    for (value, other) in values.iter_mut().zip(others) {
                        *value = Lanes::load(simd, other, first);
                    }
                    for (sums, row) in sums.iter_mut().zip(rows) {
                        let value = Lanes::load(simd, row, first);
                        for (sum, other) in sums.iter_mut().zip(values) {
                            *sum = value.mul_add(other, *sum);
                        }
                    }
                    first += S::F32_LANES;
                }
                for (row, sums) in of_tile.into_iter().zip(sums) {
                    for (other, sum) in by.into_iter().zip(sums) {
                        let value = f64::from(sum.total());
                        products[(row, other)] = value;
                        products[(other, row)] = value;
                    }
                }
            }
        }
    }
}
