//! Numbers that the exact method computes with: `f64`, and numbers that carry derivatives. Every formula is written
//! once, for both.

// The product and quotient rules use other operators than the one they define.
#![allow(clippy::suspicious_arithmetic_impl)]

use std::ops::{Add, Div, Mul, Neg, Sub};

/// What the formulas need of a number.
pub trait Number:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Send
    + Sync
    + 'static
{
    /// Whether it carries derivatives.
    const DIFFERENTIATES: bool;
    /// A constant.
    fn of(x: f64) -> Self;
    /// Its value.
    fn value(self) -> f64;
    /// Σ slopes · self over several numbers, with a value of its own: the chain rule.
    fn chain<const K: usize>(value: f64, slopes: [(f64, Self); K]) -> Self;

    /// Its product with a constant.
    fn times(self, x: f64) -> Self {
        Self::chain(self.value() * x, [(x, self)])
    }
    /// Square root.
    fn sqrt(self) -> Self {
        let root = self.value().sqrt();
        Self::chain(root, [(0.5 / root, self)])
    }
    /// e to the power of it.
    fn exp(self) -> Self {
        let e = self.value().exp();
        Self::chain(e, [(e, self)])
    }
    /// Sine.
    fn sin(self) -> Self {
        Self::chain(self.value().sin(), [(self.value().cos(), self)])
    }
    /// Cosine.
    fn cos(self) -> Self {
        Self::chain(self.value().cos(), [(-self.value().sin(), self)])
    }
    /// Hyperbolic sine.
    fn sinh(self) -> Self {
        Self::chain(self.value().sinh(), [(self.value().cosh(), self)])
    }
    /// Its inverse.
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

impl Number for f64 {
    const DIFFERENTIATES: bool = false;
    fn of(x: f64) -> f64 {
        x
    }
    fn value(self) -> f64 {
        self
    }
    fn chain<const K: usize>(value: f64, _slopes: [(f64, f64); K]) -> f64 {
        value
    }
}

/// A number and its derivatives by `P` parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<const P: usize> {
    /// The number.
    pub value: f64,
    /// Its derivatives.
    pub by: [f64; P],
}

impl<const P: usize> Dual<P> {
    /// The `k`-th parameter itself.
    pub fn parameter(value: f64, k: usize) -> Self {
        let mut by = [0.0; P];
        by[k] = 1.0;
        Dual { value, by }
    }
}

impl<const P: usize> Add for Dual<P> {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Dual { value: self.value + o.value, by: std::array::from_fn(|k| self.by[k] + o.by[k]) }
    }
}

impl<const P: usize> Sub for Dual<P> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Dual { value: self.value - o.value, by: std::array::from_fn(|k| self.by[k] - o.by[k]) }
    }
}

impl<const P: usize> Neg for Dual<P> {
    type Output = Self;
    fn neg(self) -> Self {
        Dual { value: -self.value, by: self.by.map(|d| -d) }
    }
}

impl<const P: usize> Mul for Dual<P> {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Dual { value: self.value * o.value, by: std::array::from_fn(|k| self.by[k] * o.value + self.value * o.by[k]) }
    }
}

impl<const P: usize> Div for Dual<P> {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        let value = self.value / o.value;
        Dual { value, by: std::array::from_fn(|k| (self.by[k] - value * o.by[k]) / o.value) }
    }
}

impl<const P: usize> Number for Dual<P> {
    const DIFFERENTIATES: bool = true;
    fn of(x: f64) -> Self {
        Dual { value: x, by: [0.0; P] }
    }
    fn value(self) -> f64 {
        self.value
    }
    fn chain<const K: usize>(value: f64, slopes: [(f64, Self); K]) -> Self {
        // 0 · ∞ is what a parameter that a number does not depend on would make of an infinite slope.
        let by = |k: usize| slopes.iter().filter(|(_, x)| x.by[k] != 0.0).map(|(slope, x)| slope * x.by[k]).sum();
        Dual { value, by: std::array::from_fn(by) }
    }
    fn times(self, x: f64) -> Self {
        Dual { value: self.value * x, by: self.by.map(|d| d * x) }
    }
}
