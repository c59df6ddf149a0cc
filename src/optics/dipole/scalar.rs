//! The kinds of number that a kernel can be evaluated with: `f64`, complex numbers (for the contour of the Hankel
//! integral), and either of them with derivatives.
//!
//! Every formula is written once, for all of them. It then gives the value, its Hankel transform and its exact
//! derivatives.

// The product and quotient rules use other operators than the one they define.
#![allow(clippy::suspicious_arithmetic_impl)]

use mesophyll_fourier::Complex;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// What the formulas need of a number.
pub trait Scalar:
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
    /// A constant.
    fn of(x: f64) -> Self;
    /// e to the power of it.
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
    /// Its product with a real number.
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
    fn times(self, x: f64) -> f64 {
        self * x
    }
}

impl Scalar for Complex<f64> {
    fn of(x: f64) -> Self {
        Complex::new(x, 0.0)
    }
    fn exp(self) -> Self {
        // An infinite imaginary part would turn an exponential that is long 0 into NaN.
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
    fn times(self, x: f64) -> Self {
        self * x
    }
}

/// Number of parameters that a [`Dual`] is differentiated by.
pub const PARTIALS: usize = 4;

/// A number and its derivatives by σa, σs, g and the thickness factor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<T> {
    /// The number.
    pub value: T,
    /// Its derivatives.
    pub by: [T; PARTIALS],
}

impl<T: Scalar> Dual<T> {
    /// The `k`-th parameter itself.
    pub fn parameter(value: T, k: usize) -> Self {
        let mut by = [T::of(0.0); PARTIALS];
        by[k] = T::of(1.0);
        Dual { value, by }
    }

    /// f(self), given f and f′ at the value.
    pub fn chain(self, value: T, slope: T) -> Self {
        Dual { value, by: self.by.map(|d| d * slope) }
    }
}

impl<T: Scalar> Add for Dual<T> {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Dual { value: self.value + o.value, by: std::array::from_fn(|k| self.by[k] + o.by[k]) }
    }
}

impl<T: Scalar> Sub for Dual<T> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Dual { value: self.value - o.value, by: std::array::from_fn(|k| self.by[k] - o.by[k]) }
    }
}

impl<T: Scalar> Neg for Dual<T> {
    type Output = Self;
    fn neg(self) -> Self {
        Dual { value: -self.value, by: self.by.map(|d| -d) }
    }
}

impl<T: Scalar> Mul for Dual<T> {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Dual { value: self.value * o.value, by: std::array::from_fn(|k| self.by[k] * o.value + self.value * o.by[k]) }
    }
}

impl<T: Scalar> Div for Dual<T> {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        let value = self.value / o.value;
        Dual { value, by: std::array::from_fn(|k| (self.by[k] - value * o.by[k]) / o.value) }
    }
}

impl<T: Scalar> Scalar for Dual<T> {
    fn of(x: f64) -> Self {
        Dual { value: T::of(x), by: [T::of(0.0); PARTIALS] }
    }
    fn exp(self) -> Self {
        let e = self.value.exp();
        self.chain(e, e)
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, T::of(0.5) / root)
    }
    fn sin(self) -> Self {
        self.chain(self.value.sin(), self.value.cos())
    }
    fn cos(self) -> Self {
        self.chain(self.value.cos(), -self.value.sin())
    }
    fn re(self) -> f64 {
        self.value.re()
    }
    fn size(self) -> f64 {
        self.value.size()
    }
    fn times(self, x: f64) -> Self {
        Dual { value: self.value.times(x), by: self.by.map(|d| d.times(x)) }
    }
}

/// (1 − e^(−x))/x, entire: no digits lost at x = 0.
pub fn falling<T: Scalar>(x: T) -> T {
    if x.size() < 0.5 {
        // Σ (−x)^n/(n+1)!
        let mut sum = T::of(1.0);
        for n in (2..=15).rev() {
            sum = T::of(1.0) - (x * sum).times(1.0 / f64::from(n));
        }
        sum
    } else {
        (T::of(1.0) - (-x).exp()) / x
    }
}

/// sinh(√s)/√s for |s| ≤ about 1, entire in s.
pub fn rising<T: Scalar>(s: T) -> T {
    let mut sum = T::of(1.0);
    for n in (1..=9).rev() {
        let n = f64::from(2 * n);
        sum = T::of(1.0) + (s * sum).times(1.0 / (n * (n + 1.0)));
    }
    sum
}
