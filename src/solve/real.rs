//! What a model needs of a number, so that it is written once and evaluated in double precision, in double-double, and
//! with derivatives.

use super::dd::Dd;
use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real number with the elementary functions. Implemented by `f64`, [`Dd`] (about 31 digits) and [`super::Dual`]
/// (value and gradient).
pub trait Real:
    Copy + Debug + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// A constant: exact in every implementation.
    fn constant(value: f64) -> Self;
    /// A constant known to double-double precision, rounded to what the type holds.
    fn precise(value: Dd) -> Self;
    /// The nearest `f64`.
    fn value(self) -> f64;
    fn sqrt(self) -> Self;
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    fn sin(self) -> Self;
    fn cos(self) -> Self;
    fn atan(self) -> Self;

    /// Sine and cosine, where together they cost what one does.
    fn sin_cos(self) -> (Self, Self) {
        (self.sin(), self.cos())
    }

    fn zero() -> Self {
        Self::constant(0.0)
    }

    fn one() -> Self {
        Self::constant(1.0)
    }

    fn square(self) -> Self {
        self * self
    }

    /// `self` to a real power, `exp(power ln self)`: for positive `self`, NaN otherwise.
    fn pow(self, power: Self) -> Self {
        (power * self.ln()).exp()
    }

    /// The circle constant.
    fn pi() -> Self {
        Self::precise(Dd::PI)
    }
}

impl Real for f64 {
    fn constant(value: f64) -> Self {
        value
    }
    fn precise(value: Dd) -> Self {
        value.value()
    }
    fn value(self) -> f64 {
        self
    }
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    fn exp(self) -> Self {
        f64::exp(self)
    }
    fn ln(self) -> Self {
        f64::ln(self)
    }
    fn sin(self) -> Self {
        f64::sin(self)
    }
    fn cos(self) -> Self {
        f64::cos(self)
    }
    fn atan(self) -> Self {
        f64::atan(self)
    }
    fn pow(self, power: Self) -> Self {
        f64::powf(self, power)
    }
}
