//! Forward-mode derivatives: a value with its gradient by `N` parameters. They are exact to rounding, and there is no
//! step length to choose.

// The product and quotient rules mix operators by nature.
#![allow(clippy::suspicious_arithmetic_impl)]

use super::dd::DoubleDouble;
use super::real::PreciseReal;
use mesophyll_base::solvers::qr::MatrixScalar;
use std::array::from_fn;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number and its derivatives to `N` parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreciseDual<T, const N: usize> {
    pub v: T,
    pub d: [T; N],
}

impl<T: PreciseReal, const N: usize> PreciseDual<T, N> {
    /// The parameter numbered `index`: its derivative by itself is 1.
    pub fn variable(v: T, index: usize) -> Self {
        PreciseDual { v, d: from_fn(|k| if k == index { T::one() } else { T::zero() }) }
    }

    /// `value` with every derivative multiplied by `slope` (the chain rule).
    fn chain(self, value: T, slope: T) -> Self {
        PreciseDual { v: value, d: self.d.map(|x| slope * x) }
    }
}

impl<T: PreciseReal, const N: usize> Add for PreciseDual<T, N> {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        PreciseDual { v: self.v + b.v, d: from_fn(|k| self.d[k] + b.d[k]) }
    }
}

impl<T: PreciseReal, const N: usize> Sub for PreciseDual<T, N> {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        PreciseDual { v: self.v - b.v, d: from_fn(|k| self.d[k] - b.d[k]) }
    }
}

impl<T: PreciseReal, const N: usize> Mul for PreciseDual<T, N> {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        PreciseDual { v: self.v * b.v, d: from_fn(|k| self.d[k] * b.v + self.v * b.d[k]) }
    }
}

impl<T: PreciseReal, const N: usize> Div for PreciseDual<T, N> {
    type Output = Self;
    fn div(self, b: Self) -> Self {
        let v = self.v / b.v;
        PreciseDual { v, d: from_fn(|k| (self.d[k] - v * b.d[k]) / b.v) }
    }
}

impl<T: PreciseReal, const N: usize> Neg for PreciseDual<T, N> {
    type Output = Self;
    fn neg(self) -> Self {
        PreciseDual { v: -self.v, d: self.d.map(|x| -x) }
    }
}

impl<T: PreciseReal, const N: usize> MatrixScalar for PreciseDual<T, N> {
    fn constant(value: f64) -> Self {
        PreciseDual { v: T::constant(value), d: [T::zero(); N] }
    }
    fn value(self) -> f64 {
        self.v.value()
    }
    fn sqrt(self) -> Self {
        let root = self.v.sqrt();
        self.chain(root, T::constant(0.5) / root)
    }
}

impl<T: PreciseReal, const N: usize> PreciseReal for PreciseDual<T, N> {
    fn precise(value: DoubleDouble) -> Self {
        PreciseDual { v: T::precise(value), d: [T::zero(); N] }
    }
    fn exp(self) -> Self {
        let e = self.v.exp();
        self.chain(e, e)
    }
    fn ln(self) -> Self {
        self.chain(self.v.ln(), T::one() / self.v)
    }
    fn sin(self) -> Self {
        let (sin, cos) = self.v.sin_cos();
        self.chain(sin, cos)
    }
    fn cos(self) -> Self {
        let (sin, cos) = self.v.sin_cos();
        self.chain(cos, -sin)
    }
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = self.v.sin_cos();
        (self.chain(sin, cos), self.chain(cos, -sin))
    }
    fn atan(self) -> Self {
        self.chain(self.v.atan(), T::one() / (T::one() + self.v * self.v))
    }
}
