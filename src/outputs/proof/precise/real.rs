//! The operations that a model needs of a number. With them it is written once and evaluated in double precision, in
//! double-double, and with derivatives.

use super::dd::DoubleDouble;
use mesophyll_base::solvers::qr::MatrixScalar;
use std::fmt::Debug;

/// A real number with the elementary functions. Implemented by `f64`, [`DoubleDouble`] (about 31 digits) and
/// [`super::PreciseDual`] (value and gradient).
pub trait PreciseReal: MatrixScalar + Debug {
    /// A constant known to double-double precision, rounded to what the type holds.
    fn precise(value: DoubleDouble) -> Self;
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    fn sin(self) -> Self;
    fn cos(self) -> Self;
    fn atan(self) -> Self;

    /// Sine and cosine, for types where both together cost as much as one.
    fn sin_cos(self) -> (Self, Self) {
        (self.sin(), self.cos())
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
        Self::precise(DoubleDouble::PI)
    }
}

impl PreciseReal for f64 {
    fn precise(value: DoubleDouble) -> Self {
        value.value()
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
