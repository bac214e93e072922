//! Formulas written once, for one number or for as many as the machine's vectors hold.

use std::ops::{Add, Div, Mul, Sub};

use pulp::Simd;

/// Single-precision arithmetic: of an `f32`, or of [`Lanes`] of them at once.
pub trait Real:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Add<f32, Output = Self>
    + Mul<f32, Output = Self>
{
    /// `self * factor + summand`, rounded once.
    fn mul_add(self, factor: Self, summand: Self) -> Self;
    /// The square root; of what is not negative.
    fn sqrt(self) -> Self;
    /// The absolute value.
    fn abs(self) -> Self;
    /// The larger of two.
    fn max(self, other: Self) -> Self;
    /// The smaller of two.
    fn min(self, other: Self) -> Self;
    /// `self` where `value` is at least `least`, 0 elsewhere.
    fn where_at_least(self, value: Self, least: Self) -> Self;
    /// The absolute value with the sign of `other`.
    fn copysign(self, other: Self) -> Self;
    /// The exponential function, to 2e-7 of its value; of at most 80. Below -87 it is next to 0.
    fn exp(self) -> Self;
}

impl Real for f32 {
    #[inline(always)]
    fn mul_add(self, factor: Self, summand: Self) -> Self {
        f32::mul_add(self, factor, summand)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f32::sqrt(self)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        f32::abs(self)
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        f32::max(self, other)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        f32::min(self, other)
    }

    #[inline(always)]
    fn where_at_least(self, value: Self, least: Self) -> Self {
        if value >= least { self } else { 0.0 }
    }

    #[inline(always)]
    fn copysign(self, other: Self) -> Self {
        f32::copysign(self, other)
    }

    #[inline(always)]
    fn exp(self) -> Self {
        f32::exp(self)
    }
}

/// As many numbers as one of the machine's vectors holds.
#[derive(Clone, Copy, Debug)]
pub struct Lanes<S: Simd> {
    simd: S,
    values: S::f32s,
}

impl<S: Simd> Lanes<S> {
    /// All the same.
    #[inline(always)]
    pub fn splat(simd: S, value: f32) -> Self {
        Self { simd, values: simd.splat_f32s(value) }
    }

    /// The samples from `first` on, which must be there for every lane.
    #[inline(always)]
    pub fn load(simd: S, samples: &[f32], first: usize) -> Self {
        let samples = &samples[first..first + S::F32_LANES];
        Self { simd, values: S::as_simd_f32s(samples).0[0] }
    }

    /// The samples from `first` on, and 0 for those lanes that have none.
    #[inline(always)]
    pub fn load_part(simd: S, samples: &[f32], first: usize) -> Self {
        if samples.len() - first >= S::F32_LANES {
            return Self::load(simd, samples, first);
        }
        Self { simd, values: simd.partial_load_f32s(&samples[first..]) }
    }

    /// Writes all lanes to the samples from `first` on.
    #[inline(always)]
    pub fn store(self, samples: &mut [f32], first: usize) {
        let samples = &mut samples[first..first + S::F32_LANES];
        S::as_mut_simd_f32s(samples).0[0] = self.values;
    }

    /// Writes as many lanes as there are samples from `first` on.
    #[inline(always)]
    pub fn store_part(self, samples: &mut [f32], first: usize) {
        if samples.len() - first >= S::F32_LANES {
            return self.store(samples, first);
        }
        self.simd.partial_store_f32s(&mut samples[first..], self.values);
    }

    /// The sum of all lanes.
    #[inline(always)]
    pub fn total(self) -> f32 {
        self.simd.reduce_sum_f32s(self.values)
    }

    /// Each lane that of so many further on; the first ones come last.
    #[inline(always)]
    pub fn rotated_left(self, lanes: usize) -> Self {
        Self { simd: self.simd, values: self.simd.rotate_left_f32s(self.values, lanes) }
    }

    /// The smallest lane.
    #[inline(always)]
    pub fn least(self) -> f32 {
        self.simd.reduce_min_f32s(self.values)
    }

    /// The largest lane.
    #[inline(always)]
    pub fn largest(self) -> f32 {
        self.simd.reduce_max_f32s(self.values)
    }
}

/// The operators that are a vector instruction each.
macro_rules! operators {
    ($lanes:ident: $($operator:ident, $name:ident, $instruction:ident;)*) => {$(
        impl<S: Simd> $operator for $lanes<S> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self { simd: self.simd, values: self.simd.$instruction(self.values, other.values) }
            }
        }
    )*};
}

operators! {
    Lanes:
    Add, add, add_f32s;
    Sub, sub, sub_f32s;
    Mul, mul, mul_f32s;
    Div, div, div_f32s;
}

impl<S: Simd> Add<f32> for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: f32) -> Self {
        self + Self::splat(self.simd, other)
    }
}

impl<S: Simd> Mul<f32> for Lanes<S> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: f32) -> Self {
        self * Self::splat(self.simd, other)
    }
}

impl<S: Simd> Real for Lanes<S> {
    #[inline(always)]
    fn mul_add(self, factor: Self, summand: Self) -> Self {
        let values = self.simd.mul_add_f32s(self.values, factor.values, summand.values);
        Self { simd: self.simd, values }
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self { simd: self.simd, values: self.simd.sqrt_f32s(self.values) }
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self { simd: self.simd, values: self.simd.abs_f32s(self.values) }
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self { simd: self.simd, values: self.simd.max_f32s(self.values, other.values) }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self { simd: self.simd, values: self.simd.min_f32s(self.values, other.values) }
    }

    #[inline(always)]
    fn where_at_least(self, value: Self, least: Self) -> Self {
        let mask = self.simd.greater_than_or_equal_f32s(value.values, least.values);
        let none = self.simd.splat_f32s(0.0);
        Self { simd: self.simd, values: self.simd.select_f32s(mask, self.values, none) }
    }

    #[inline(always)]
    fn copysign(self, other: Self) -> Self {
        let simd = self.simd;
        let sign = simd.and_f32s(other.values, simd.splat_f32s(-0.0));
        Self { simd, values: simd.or_f32s(simd.abs_f32s(self.values), sign) }
    }

    /// 2^n e^r, n the nearest whole number to x / ln 2 and r what is left, by its Taylor polynomial.
    #[inline(always)]
    fn exp(self) -> Self {
        // Added to a number, it leaves the nearest whole number in the lowest bits.
        const WHOLE: f32 = 12_582_912.0;
        // The natural logarithm of 2, in two parts: the first has few bits, its multiples are exact.
        const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];
        let simd = self.simd;
        let splat = |value: f32| Self::splat(simd, value);
        let x = self.max(splat(-87.0));
        let shifted = x.mul_add(splat(std::f32::consts::LOG2_E), splat(WHOLE));
        let n = shifted - splat(WHOLE);
        let r = n.mul_add(splat(-LN_2[0]), x);
        let r = n.mul_add(splat(-LN_2[1]), r);
        let mut sum = splat(1.0 / 5040.0);
        for term in [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0] {
            sum = sum.mul_add(r, splat(term));
        }
        let bits = simd.transmute_u32s_f32s(shifted.values);
        let exponent = simd.wrapping_dyn_shl_u32s(bits, simd.splat_u32s(23));
        let scale = simd.add_u32s(exponent, simd.splat_u32s(1.0_f32.to_bits()));
        sum * Self { simd, values: simd.transmute_f32s_u32s(scale) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Exponentials<'a>(&'a [f32], &'a mut [f32]);

    impl pulp::WithSimd for Exponentials<'_> {
        type Output = ();

        fn with_simd<S: Simd>(self, simd: S) {
            for first in (0..self.0.len()).step_by(S::F32_LANES) {
                Lanes::load_part(simd, self.0, first).exp().store_part(self.1, first);
            }
        }
    }

    #[test]
    fn the_exponential_function_of_lanes_is_that_of_single_numbers() {
        let numbers: Vec<f32> = (-8700..=8000).map(|hundredth| hundredth as f32 / 100.0).collect();
        let mut found = vec![0.0; numbers.len()];
        pulp::Arch::new().dispatch(Exponentials(&numbers, &mut found));
        for (x, found) in numbers.iter().zip(found) {
            let wanted = f64::from(*x).exp();
            assert!((f64::from(found) / wanted - 1.0).abs() < 2e-7, "{x}: {found} {wanted}");
        }
        let mut ends = [1.0; 2];
        pulp::Arch::new().dispatch(Exponentials(&[-1e30, f32::NEG_INFINITY], &mut ends));
        assert!(ends.iter().all(|end| (0.0..2e-38).contains(end)), "{ends:?}");
    }
}

/// As many numbers of double precision as one of the machine's vectors holds.
#[derive(Clone, Copy, Debug)]
pub struct Doubles<S: Simd> {
    simd: S,
    values: S::f64s,
}

impl<S: Simd> Doubles<S> {
    /// All the same.
    #[inline(always)]
    pub fn splat(simd: S, value: f64) -> Self {
        Self { simd, values: simd.splat_f64s(value) }
    }

    /// The samples from `first` on, which must be there for every lane.
    #[inline(always)]
    pub fn load(simd: S, samples: &[f64], first: usize) -> Self {
        let samples = &samples[first..first + S::F64_LANES];
        Self { simd, values: S::as_simd_f64s(samples).0[0] }
    }

    /// `self * factor + summand`, rounded once.
    #[inline(always)]
    pub fn mul_add(self, factor: Self, summand: Self) -> Self {
        let values = self.simd.mul_add_f64s(self.values, factor.values, summand.values);
        Self { simd: self.simd, values }
    }

    /// The sum of all lanes.
    #[inline(always)]
    pub fn total(self) -> f64 {
        self.simd.reduce_sum_f64s(self.values)
    }
}

operators! {
    Doubles:
    Add, add, add_f64s;
    Mul, mul, mul_f64s;
}

/// Machines' vectors of single precision that can be made double, which `pulp` has for none in common.
pub trait Widen: Simd {
    /// The first half and the second one; where a vector holds a single number, it and 0.
    fn widened(self, values: Self::f32s) -> [Self::f64s; 2];
}

impl<S: Widen> Lanes<S> {
    /// The first half and the second one in double precision.
    #[inline(always)]
    pub fn widen(self) -> [Doubles<S>; 2] {
        let [first, second] = self.simd.widened(self.values);
        [Doubles { simd: self.simd, values: first }, Doubles { simd: self.simd, values: second }]
    }
}

impl Widen for pulp::Scalar {
    #[inline(always)]
    fn widened(self, value: f32) -> [f64; 2] {
        [f64::from(value), 0.0]
    }
}

#[cfg(target_arch = "x86_64")]
impl Widen for pulp::x86::V3 {
    #[inline(always)]
    fn widened(self, values: Self::f32s) -> [Self::f64s; 2] {
        let [first, second]: [[f32; 4]; 2] = pulp::cast(values);
        [
            pulp::cast(self.avx._mm256_cvtps_pd(pulp::cast(first))),
            pulp::cast(self.avx._mm256_cvtps_pd(pulp::cast(second))),
        ]
    }
}

#[cfg(target_arch = "x86_64")]
impl Widen for pulp::x86::V4 {
    #[inline(always)]
    fn widened(self, values: Self::f32s) -> [Self::f64s; 2] {
        let [first, second]: [[f32; 8]; 2] = pulp::cast(values);
        [
            pulp::cast(self.avx512f._mm512_cvtps_pd(pulp::cast(first))),
            pulp::cast(self.avx512f._mm512_cvtps_pd(pulp::cast(second))),
        ]
    }
}

/// What is compiled for the machine's vectors, as [`pulp::WithSimd`], and widens some.
pub trait WithWiden {
    /// What it answers.
    type Output;
    /// Does it.
    fn with_simd<S: Widen>(self, simd: S) -> Self::Output;
}

/// Something to do and the vectors to do it with.
#[cfg(target_arch = "x86_64")]
struct Task<S, W>(S, W);

#[cfg(target_arch = "x86_64")]
impl<S: Widen, W: WithWiden> pulp::WithSimd for Task<S, W> {
    type Output = W::Output;

    #[inline(always)]
    fn with_simd<T: Simd>(self, _: T) -> W::Output {
        let Self(simd, work) = self;
        work.with_simd(simd)
    }
}

/// Does it with the machine's widest vectors; on other machines than x86-64 number by number.
#[inline]
pub fn dispatch_widening<W: WithWiden>(work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    {
        if let Some(simd) = pulp::x86::V4::try_new() {
            return Simd::vectorize(simd, Task(simd, work));
        }
        if let Some(simd) = pulp::x86::V3::try_new() {
            return Simd::vectorize(simd, Task(simd, work));
        }
    }
    work.with_simd(pulp::Scalar)
}
