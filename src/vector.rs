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

    /// The largest lane.
    #[inline(always)]
    pub fn largest(self) -> f32 {
        self.simd.reduce_max_f32s(self.values)
    }
}

/// The operators that are a vector instruction each.
macro_rules! operators {
    ($($operator:ident, $name:ident, $instruction:ident;)*) => {$(
        impl<S: Simd> $operator for Lanes<S> {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                Self { simd: self.simd, values: self.simd.$instruction(self.values, other.values) }
            }
        }
    )*};
}

operators! {
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
}
