//! The blurred junction that fits samples best: variable projection.
//!
//! Of rays that start in a vertex everything else is linear: of each sector a level and a ramp, in each channel.
//! They are solved for at every step; rays, vertex and blur follow the gradient of what is left, projected onto
//! what the linear parameters cannot explain (Golub & Pereyra 1973, in Kaufman's 1975 approximation), damped
//! after Levenberg and Marquardt.

mod columns;

use nalgebra::{Matrix2, SMatrix, SVector};

use super::rays::{Area, Fields, MOST_RAYS, Places, Rays};
use columns::{Basis, Multiply, Shape};

/// Parameters that are not linear: the vertex, the blur, and a direction of each ray.
pub const MOST_SHAPE: usize = 3 + MOST_RAYS;
/// Linear parameters of a channel: of each sector a level and a ramp along x and y.
pub const MOST_LEVELS: usize = 3 * MOST_RAYS;

/// A matrix over the parameters of shape, in the order vertex x, y, blur, rays.
pub type ShapeMatrix = SMatrix<f64, MOST_SHAPE, MOST_SHAPE>;
type ShapeVector = SVector<f64, MOST_SHAPE>;
type LevelMatrix = SMatrix<f64, MOST_LEVELS, MOST_LEVELS>;
type LevelVector = SVector<f64, MOST_LEVELS>;

/// Samples of one channel.
#[derive(Clone, Debug, Default)]
pub struct Channel {
    /// One of each place.
    pub samples: Vec<f32>,
    /// Its weight: the reciprocal of its standard deviation; 0 of what does not count.
    pub weights: Vec<f32>,
}

/// What a junction is fitted to.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    /// Where they are \[px\], about the middle.
    pub places: Places,
    /// So many of `channels` are in use.
    pub channel_count: usize,
    /// Of each channel, the same places.
    pub channels: [Channel; 3],
    /// A length that makes ramps of the size of levels \[px\].
    pub radius_px: f64,
}

impl Samples {
    /// Makes the places those of a square of pixels, row by row, so many from the middle to each side. Those
    /// that fill the last vector are in the middle and must have no weight.
    pub fn make_square(&mut self, reach: usize) {
        let side = 2 * reach + 1;
        let offset = -(reach as f32);
        self.places.fill(side, side, [f64::from(offset); 2]);
        self.places.x[side * side..].fill(0.0);
        self.places.y[side * side..].fill(0.0);
    }
}

/// What may vary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Freedom {
    /// Whether sectors have ramps.
    pub ramps: bool,
    /// How far the vertex may be from where it starts \[px\].
    pub max_shift_px: f64,
    /// The blur at most \[px\].
    pub max_sigma_px: f64,
    /// Steps at most.
    pub max_iterations: u32,
    /// The step of the vertex that ends the iteration \[px\].
    pub epsilon_px: f64,
}

/// Why no junction fits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoFit {
    /// The samples say nothing about some parameter.
    Singular,
    /// The vertex left its neighbourhood, or levels there left what samples show.
    Diverged,
}

/// Of each sector level, and ramps along x and y \[per `radius_px`\], about the middle of the places.
pub type Levels = [[f64; 3]; MOST_RAYS];

/// A junction that fits.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Its rays.
    pub rays: Rays,
    /// Of each channel its levels.
    pub levels: [Levels; 3],
    /// The squared residuals over their variances, summed.
    pub chi2: f64,
    /// Samples less parameters.
    pub degrees: f64,
    /// The largest step between neighbouring sectors at the vertex over the noise there, over all channels.
    pub contrast_over_noise: f64,
    /// Covariance of the shape.
    pub covariance: ShapeMatrix,
    /// Steps taken.
    pub iterations: u32,
    /// Whether the last step was short enough.
    pub converged: bool,
}

impl Fit {
    /// How many times as much is left as noise leaves; 1 where it is no more than five standard deviations of
    /// what noise leaves.
    pub fn excess(&self) -> f64 {
        let is_noise = self.chi2 <= self.degrees + 5.0 * (2.0 * self.degrees).sqrt();
        if is_noise { 1.0 } else { self.chi2 / self.degrees }
    }

    /// Covariance of the vertex \[px^2\], larger where more is left than noise.
    pub fn vertex_covariance_px2(&self) -> Matrix2<f64> {
        self.excess() * self.covariance.fixed_view::<2, 2>(0, 0).into_owned()
    }
}

/// Memory for fits; one serves all.
#[derive(Clone, Debug, Default)]
pub struct Fitter {
    fields: Fields,
    /// Weighted: of the levels, of the shape, the samples and what is left of them; each of all places.
    columns: Vec<f32>,
}

/// The state of a fit at one shape.
#[derive(Clone, Debug)]
struct State {
    rays: Rays,
    levels: [Levels; 3],
    chi2: f64,
    /// The projected normal equations.
    normal: ShapeMatrix,
    right: ShapeVector,
}

/// Inner products of columns; the last one is the rest of the samples.
type Products = SMatrix<f64, COLUMNS, COLUMNS>;
/// Levels, shape, samples.
const COLUMNS: usize = MOST_LEVELS + MOST_SHAPE + 1;
const REST: usize = COLUMNS - 1;

impl Fitter {
    /// Fits a junction of as many rays as `start` has.
    ///
    /// # Errors
    /// When the samples do not determine it, or it is not where it starts.
    pub fn fit(
        &mut self,
        samples: &Samples,
        start: &Rays,
        freedom: &Freedom,
    ) -> Result<Fit, NoFit> {
        let mut damping = 1e-3;
        let mut state = self.state(samples, start, freedom).ok_or(NoFit::Singular)?;
        let mut iterations = 0;
        let mut converged = false;
        while iterations < freedom.max_iterations {
            iterations += 1;
            let mut damped = state.normal;
            for i in 0..MOST_SHAPE {
                damped[(i, i)] *= 1.0 + damping;
            }
            let Some(cholesky) = damped.cholesky() else { return Err(NoFit::Singular) };
            let step = cholesky.solve(&state.right);
            let next = stepped(&state.rays, &step, freedom);
            let moved_px = (next.vertex[0] - state.rays.vertex[0])
                .hypot(next.vertex[1] - state.rays.vertex[1]);
            let shift_px =
                (next.vertex[0] - start.vertex[0]).hypot(next.vertex[1] - start.vertex[1]);
            if shift_px > freedom.max_shift_px && damping < 1.0 {
                damping *= 10.0;
                continue;
            }
            let is_ordered = (0..next.count).all(|ray| next.opening_rad(ray) > LEAST_OPENING_RAD);
            let is_junction = is_ordered && shift_px <= freedom.max_shift_px;
            if is_junction && moved_px <= freedom.epsilon_px && damping <= 1e-2 {
                // So short a step changes nothing else: what is known from before it holds behind it.
                state.rays = next;
                converged = true;
                break;
            }
            let trial = if is_junction { self.state(samples, &next, freedom) } else { None };
            match trial {
                Some(trial) if trial.chi2 <= state.chi2 * (1.0 + 1e-6) => {
                    state = trial;
                    damping = (0.1 * damping).max(1e-9);
                }
                _ => {
                    // Where a step no longer than this makes it worse, only rounding is left.
                    if moved_px <= 0.1 * freedom.epsilon_px {
                        converged = true;
                        break;
                    }
                    damping *= 10.0;
                    if damping > 1e9 {
                        return Err(NoFit::Diverged);
                    }
                }
            }
        }
        let covariance = state.normal.cholesky().ok_or(NoFit::Singular)?.inverse();
        let parameters = 3 + start.count + samples.channel_count * levels_of(start.count, freedom);
        let counted: usize = samples.channels[..samples.channel_count]
            .iter()
            .map(|channel| channel.weights.iter().filter(|weight| **weight > 0.0).count())
            .sum();
        if counted <= parameters || covariance.iter().any(|value| !value.is_finite()) {
            return Err(NoFit::Singular);
        }
        if !are_plausible(samples, &state) {
            return Err(NoFit::Diverged);
        }
        Ok(Fit {
            rays: state.rays,
            levels: state.levels,
            chi2: state.chi2,
            degrees: (counted - parameters) as f64,
            contrast_over_noise: contrast_over_noise(samples, &state),
            covariance,
            iterations,
            converged,
        })
    }

    /// Levels, what is left, and the normal equations at a shape.
    fn state(&mut self, samples: &Samples, rays: &Rays, freedom: &Freedom) -> Option<State> {
        self.fields.compute(rays, &samples.places, Area::Pixel);
        self.columns.resize(COLUMNS * samples.places.x.len(), 0.0);
        let mut state = State {
            rays: *rays,
            levels: Default::default(),
            chi2: 0.0,
            normal: ShapeMatrix::zeros(),
            right: ShapeVector::zeros(),
        };
        let per_sector = if freedom.ramps { 3 } else { 1 };
        for (channel, levels) in
            samples.channels[..samples.channel_count].iter().zip(&mut state.levels)
        {
            let count = per_sector * rays.count;
            let mut products = self.products_of_levels(samples, channel, rays, per_sector);
            let mut normal: LevelMatrix =
                products.fixed_view::<MOST_LEVELS, MOST_LEVELS>(0, 0).into_owned();
            let largest = (0..count).map(|i| normal[(i, i)]).fold(0.0, f64::max);
            for i in 0..MOST_LEVELS {
                normal[(i, i)] += if i < count { RIDGE * largest } else { 1.0 };
            }
            let cholesky = normal.cholesky()?;
            let right: LevelVector = products.fixed_view::<MOST_LEVELS, 1>(0, REST).into_owned();
            let solved = cholesky.solve(&right);
            for sector in 0..rays.count {
                for term in 0..per_sector {
                    levels[sector][term] = solved[per_sector * sector + term];
                }
            }
            self.add_products_of_shape(&mut products, samples, channel, rays, per_sector, levels);

            // Shape beside levels, and what levels explain of it.
            let mixed = products.fixed_view::<MOST_LEVELS, MOST_SHAPE>(0, MOST_LEVELS).into_owned();
            let explained = cholesky.solve(&mixed);
            let shape = products.fixed_view::<MOST_SHAPE, MOST_SHAPE>(MOST_LEVELS, MOST_LEVELS);
            state.normal += shape - mixed.transpose() * explained;
            let left_of_levels = products.fixed_view::<MOST_LEVELS, 1>(0, REST);
            state.right += products.fixed_view::<MOST_SHAPE, 1>(MOST_LEVELS, REST)
                - explained.transpose() * left_of_levels;
            state.chi2 += products[(REST, REST)];
        }
        for i in 3 + rays.count..MOST_SHAPE {
            state.normal[(i, i)] = 1.0;
        }
        state.chi2.is_finite().then_some(state)
    }
}

impl Fitter {
    /// Fills the columns of levels and of samples, and multiplies them; fields are known.
    fn products_of_levels(
        &mut self,
        samples: &Samples,
        channel: &Channel,
        rays: &Rays,
        per_sector: usize,
    ) -> Products {
        let Self { fields, columns } = self;
        let arch = pulp::Arch::new();
        let mut products = Products::zeros();
        arch.dispatch(Basis { fields, columns, samples, channel, rays, per_sector });
        let levels: [usize; MOST_LEVELS] = std::array::from_fn(|index| index);
        let levels = &levels[..per_sector * rays.count];
        arch.dispatch(Multiply { columns, products: &mut products, rows: levels, others: levels });
        let rest = &[REST];
        arch.dispatch(Multiply { columns, products: &mut products, rows: rest, others: levels });
        products
    }

    /// Fills the columns of the shape, takes from the samples what the levels explain, and multiplies these.
    fn add_products_of_shape(
        &mut self,
        products: &mut Products,
        samples: &Samples,
        channel: &Channel,
        rays: &Rays,
        per_sector: usize,
        levels: &Levels,
    ) {
        let Self { fields, columns } = self;
        let arch = pulp::Arch::new();
        arch.dispatch(Shape { fields, columns, samples, channel, rays, per_sector, levels });
        let shape = 3 + rays.count;
        let of_shape: [usize; MOST_SHAPE + 1] =
            std::array::from_fn(|index| if index < shape { MOST_LEVELS + index } else { REST });
        let rows = &of_shape[..=shape];
        arch.dispatch(Multiply { columns, products, rows, others: rows });
        let levels: [usize; MOST_LEVELS] = std::array::from_fn(|index| index);
        let others = &levels[..per_sector * rays.count];
        arch.dispatch(Multiply { columns, products, rows, others });
    }

    /// The levels that fit samples best, of rays that are known; `None` where they do not determine them.
    pub fn levels(&mut self, samples: &Samples, rays: &Rays, ramps: bool) -> Option<[Levels; 3]> {
        let freedom = Freedom {
            ramps,
            max_shift_px: 0.0,
            max_sigma_px: rays.sigma_px,
            max_iterations: 0,
            epsilon_px: 0.0,
        };
        self.state(samples, rays, &freedom).map(|state| state.levels)
    }

    /// What samples tell about each parameter of a junction with ramps: Fisher's information, by the samples'
    /// weights; their values do not matter. Ramps are per `radius_px`, about the middle of the places.
    pub fn information(
        &mut self,
        samples: &Samples,
        rays: &Rays,
        levels: &[Levels; 3],
    ) -> Information {
        self.fields.compute(rays, &samples.places, Area::Pixel);
        self.columns.resize(COLUMNS * samples.places.x.len(), 0.0);
        let channels = samples.channels[..samples.channel_count].iter().zip(levels);
        let of_channel = |(channel, levels): (&Channel, &Levels)| {
            let mut products = self.products_of_levels(samples, channel, rays, 3);
            self.add_products_of_shape(&mut products, samples, channel, rays, 3, levels);
            products
        };
        Information { rays: rays.count, channels: channels.map(of_channel).collect() }
    }
}

/// Which parameters beside the vertex are unknown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Unknown {
    /// Levels of the sectors.
    pub levels: bool,
    /// Directions of the rays.
    pub angles: bool,
    /// The blur.
    pub blur: bool,
    /// Ramps of the sectors.
    pub ramps: bool,
}

impl Unknown {
    /// All of them.
    pub const ALL: Self = Self { levels: true, angles: true, blur: true, ramps: true };
}

/// Fisher's information about a junction.
#[derive(Clone, Debug)]
pub struct Information {
    rays: usize,
    /// Of each channel.
    channels: Vec<Products>,
}

impl Information {
    /// The least covariance of the vertex of any estimate without bias \[px^2\]; `None` where nothing is told
    /// about one direction.
    pub fn vertex_covariance_px2(&self, unknown: Unknown) -> Option<Matrix2<f64>> {
        self.shape(unknown)?
            .try_inverse()
            .map(|inverse| inverse.fixed_view::<2, 2>(0, 0).into_owned())
    }

    /// Information about the shape, levels and ramps unknown or not; what is known of the shape is on the
    /// diagonal alone.
    pub fn shape(&self, unknown: Unknown) -> Option<ShapeMatrix> {
        let mut sum = ShapeMatrix::zeros();
        for products in &self.channels {
            let mut normal: LevelMatrix =
                products.fixed_view::<MOST_LEVELS, MOST_LEVELS>(0, 0).into_owned();
            let mut mixed =
                products.fixed_view::<MOST_LEVELS, MOST_SHAPE>(0, MOST_LEVELS).into_owned();
            for i in 0..MOST_LEVELS {
                let is_free = if i % 3 == 0 { unknown.levels } else { unknown.ramps };
                if !is_free || i >= 3 * self.rays {
                    normal.row_mut(i).fill(0.0);
                    normal.column_mut(i).fill(0.0);
                    normal[(i, i)] = 1.0;
                    mixed.row_mut(i).fill(0.0);
                }
            }
            let explained = normal.cholesky()?.solve(&mixed);
            let shape = products.fixed_view::<MOST_SHAPE, MOST_SHAPE>(MOST_LEVELS, MOST_LEVELS);
            sum += shape - mixed.transpose() * explained;
        }
        for i in 2..MOST_SHAPE {
            let is_free = if i == 2 { unknown.blur } else { unknown.angles && i < 3 + self.rays };
            if !is_free {
                sum.row_mut(i).fill(0.0);
                sum.column_mut(i).fill(0.0);
                sum[(i, i)] = 1.0;
            }
        }
        Some(sum)
    }
}

/// The largest step between neighbouring sectors over the noise, over all channels.
fn contrast_over_noise(samples: &Samples, state: &State) -> f64 {
    let rays = &state.rays;
    let step2 = |ray: usize| {
        let other = rays.next(ray);
        let squares = state.levels.iter().zip(&samples.channels[..samples.channel_count]);
        squares
            .map(|(levels, channel)| {
                let weight = channel.weights.iter().copied().fold(0.0, f32::max);
                ((levels[ray][0] - levels[other][0]) * f64::from(weight)).powi(2)
            })
            .sum::<f64>()
    };
    (0..rays.count).map(step2).fold(0.0, f64::max).sqrt()
}

/// Whether the levels at the vertex are, to half of their range beyond it, those of the samples: ramps of a narrow
/// sector may lead anywhere.
fn are_plausible(samples: &Samples, state: &State) -> bool {
    let channels = samples.channels[..samples.channel_count].iter().zip(&state.levels);
    channels.into_iter().all(|(channel, levels)| {
        let counted = channel.samples.iter().zip(&channel.weights).filter(|(_, w)| **w > 0.0);
        let (least, most) = counted.fold((f32::MAX, f32::MIN), |(least, most), (sample, _)| {
            (least.min(*sample), most.max(*sample))
        });
        let (least, most) = (f64::from(least), f64::from(most));
        let margin = 0.5 * (most - least);
        let [x, y] = state.rays.vertex.map(|place| place / samples.radius_px);
        levels[..state.rays.count].iter().all(|[level, along_x, along_y]| {
            let there = level + along_x * x + along_y * y;
            (least - margin..=most + margin).contains(&there)
        })
    })
}

/// What keeps the levels of a sector that is hardly seen from being anything.
const RIDGE: f64 = 1e-7;

/// Neighbouring rays are farther apart than this \[rad\].
const LEAST_OPENING_RAD: f64 = 0.2;

fn levels_of(rays: usize, freedom: &Freedom) -> usize {
    if freedom.ramps { 3 * rays } else { rays }
}

/// The next shape, no farther than the linearisation may hold.
fn stepped(rays: &Rays, step: &ShapeVector, freedom: &Freedom) -> Rays {
    const MOST_PX: f64 = 2.0;
    const MOST_RAD: f64 = 0.4;
    let length_px = step[0].hypot(step[1]);
    let turn_rad = (0..rays.count).map(|ray| step[3 + ray].abs()).fold(0.0, f64::max);
    let scale = 1.0_f64.min(MOST_PX / length_px.max(1e-12)).min(MOST_RAD / turn_rad.max(1e-12));
    let mut next = *rays;
    next.vertex[0] += scale * step[0];
    next.vertex[1] += scale * step[1];
    let sigma_px = rays.sigma_px + scale * step[2];
    next.sigma_px = sigma_px.clamp(0.7 * rays.sigma_px, 1.6 * rays.sigma_px);
    next.sigma_px = next.sigma_px.clamp(LEAST_SIGMA_PX, freedom.max_sigma_px);
    for ray in 0..rays.count {
        next.angles_rad[ray] += scale * step[3 + ray];
    }
    next
}

/// The pixel's own area.
const LEAST_SIGMA_PX: f64 = 0.288;
