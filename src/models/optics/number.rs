//! The kinds of number that a formula can be computed with: `f64`, complex numbers (for the contour of an integral),
//! and either of them with derivatives.
//!
//! Every formula is written once, for all of them.

// The product and quotient rules use other operators than the one they define.
#![allow(clippy::suspicious_arithmetic_impl)]

use mesophyll_base::fourier::Complex;
use mesophyll_base::number::Arithmetic;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// The operations that the formulas need.
pub trait Scalar: Arithmetic + Send + Sync + 'static {
    /// A constant.
    fn of(x: f64) -> Self;
    /// e to the power of `self`.
    fn exp(self) -> Self;
    /// Square root; of a complex number the one with a real part of at least 0.
    fn sqrt(self) -> Self;
    /// Sine.
    fn sin(self) -> Self;
    /// Cosine.
    fn cos(self) -> Self;
    /// Real part of the value.
    fn re(self) -> f64;
    /// Modulus of the value.
    fn size(self) -> f64;
    /// Whether the number is exactly 0.
    fn is_zero(self) -> bool;
    /// The product with a real number.
    fn times(self, x: f64) -> Self;
}

impl Scalar for f64 {
    fn of(x: f64) -> f64 {
        x
    }
    fn exp(self) -> f64 {
        f64::exp(self)
    }
    fn sqrt(self) -> f64 {
        f64::sqrt(self)
    }
    fn sin(self) -> f64 {
        f64::sin(self)
    }
    fn cos(self) -> f64 {
        f64::cos(self)
    }
    fn re(self) -> f64 {
        self
    }
    fn size(self) -> f64 {
        self.abs()
    }
    fn is_zero(self) -> bool {
        self == 0.0
    }
    fn times(self, x: f64) -> f64 {
        self * x
    }
}

impl Scalar for Complex<f64> {
    fn of(x: f64) -> Self {
        Complex::new(x, 0.0)
    }
    fn exp(self) -> Self {
        // The exponential is 0 here; an infinite imaginary part would turn it into NaN.
        if self.re < -745.0 { Complex::new(0.0, 0.0) } else { Complex::exp(self) }
    }
    fn sqrt(self) -> Self {
        Complex::sqrt(self)
    }
    fn sin(self) -> Self {
        Complex::sin(self)
    }
    fn cos(self) -> Self {
        Complex::cos(self)
    }
    fn re(self) -> f64 {
        self.re
    }
    fn size(self) -> f64 {
        self.norm()
    }
    fn is_zero(self) -> bool {
        self.re == 0.0 && self.im == 0.0
    }
    fn times(self, x: f64) -> Self {
        self * x
    }
}

/// A number and its derivatives by `P` parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<T, const P: usize> {
    /// The number.
    pub value: T,
    /// Its derivatives.
    pub by: [T; P],
}

impl<T: Scalar, const P: usize> Dual<T, P> {
    /// The `k`-th parameter itself.
    pub fn parameter(value: T, k: usize) -> Self {
        let mut by = [T::of(0.0); P];
        by[k] = T::of(1.0);
        Dual { value, by }
    }

    /// f(self), given f and f′ at the value. The derivative by a parameter that the number does not depend on stays 0,
    /// even where the slope is infinite.
    pub fn function(self, value: T, slope: T) -> Self {
        Dual { value, by: self.by.map(|d| if d.is_zero() { d } else { d * slope }) }
    }
}

impl<T: Scalar, const P: usize> Add for Dual<T, P> {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Dual { value: self.value + o.value, by: std::array::from_fn(|k| self.by[k] + o.by[k]) }
    }
}

impl<T: Scalar, const P: usize> Sub for Dual<T, P> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Dual { value: self.value - o.value, by: std::array::from_fn(|k| self.by[k] - o.by[k]) }
    }
}

impl<T: Scalar, const P: usize> Neg for Dual<T, P> {
    type Output = Self;
    fn neg(self) -> Self {
        Dual { value: -self.value, by: self.by.map(|d| -d) }
    }
}

impl<T: Scalar, const P: usize> Mul for Dual<T, P> {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Dual { value: self.value * o.value, by: std::array::from_fn(|k| self.by[k] * o.value + self.value * o.by[k]) }
    }
}

impl<T: Scalar, const P: usize> Div for Dual<T, P> {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        let value = self.value / o.value;
        Dual { value, by: std::array::from_fn(|k| (self.by[k] - value * o.by[k]) / o.value) }
    }
}

impl<T: Scalar, const P: usize> Scalar for Dual<T, P> {
    fn of(x: f64) -> Self {
        Dual { value: T::of(x), by: [T::of(0.0); P] }
    }
    fn exp(self) -> Self {
        let e = self.value.exp();
        self.function(e, e)
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.function(root, T::of(0.5) / root)
    }
    fn sin(self) -> Self {
        self.function(self.value.sin(), self.value.cos())
    }
    fn cos(self) -> Self {
        self.function(self.value.cos(), -self.value.sin())
    }
    fn re(self) -> f64 {
        self.value.re()
    }
    fn size(self) -> f64 {
        self.value.size()
    }
    fn is_zero(self) -> bool {
        self.value.is_zero()
    }
    fn times(self, x: f64) -> Self {
        Dual { value: self.value.times(x), by: self.by.map(|d| d.times(x)) }
    }
}

/// A real number, with or without derivatives.
pub trait Real: Scalar {
    /// Whether it carries derivatives.
    const DIFFERENTIATES: bool;
    /// Its value.
    fn value(self) -> f64;
    /// A number of the given value whose derivatives are Σ slope · (derivatives of the numbers): the chain rule.
    fn chain<const K: usize>(value: f64, slopes: [(f64, Self); K]) -> Self;

    /// Hyperbolic sine.
    fn sinh(self) -> Self {
        Self::chain(self.value().sinh(), [(self.value().cosh(), self)])
    }
    /// Inverse hyperbolic sine.
    fn asinh(self) -> Self {
        Self::chain(self.value().asinh(), [(1.0 / self.value().hypot(1.0), self)])
    }
    /// The angle whose sine and cosine are `self` and `cos`; the two must belong together.
    fn angle(self, cos: Self) -> Self {
        let (s, c) = (self.value(), cos.value());
        let square = s * s + c * c;
        Self::chain(s.atan2(c), [(c / square, self), (-s / square, cos)])
    }
}

impl Real for f64 {
    const DIFFERENTIATES: bool = false;
    fn value(self) -> f64 {
        self
    }
    fn chain<const K: usize>(value: f64, _slopes: [(f64, f64); K]) -> f64 {
        value
    }
}

impl<const P: usize> Real for Dual<f64, P> {
    const DIFFERENTIATES: bool = true;
    fn value(self) -> f64 {
        self.value
    }
    fn chain<const K: usize>(value: f64, slopes: [(f64, Self); K]) -> Self {
        // A parameter that a number does not depend on is left out: an infinite slope would make 0 · ∞ of it.
        let by = |k: usize| slopes.iter().filter(|(_, x)| x.by[k] != 0.0).map(|(slope, x)| slope * x.by[k]).sum();
        Dual { value, by: std::array::from_fn(by) }
    }
}
