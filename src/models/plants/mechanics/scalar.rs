//! `f64` and `f32` under one name, so that the shader's formulas are written once: the `f32` form computes exactly the
//! formulas of the `f64` form.

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A floating-point number with the functions that bending needs.
pub trait BendingScalar:
    Copy
    + Debug
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// Number of terms with which a power series in a quantity below 1/9 reaches the type's precision.
    const SERIES: usize;
    /// The nearest number of this type.
    fn of(value: f64) -> Self;
    /// The same number in double precision.
    fn wide(self) -> f64;
    /// The square root.
    fn sqrt(self) -> Self;
    /// e to this power.
    fn exp(self) -> Self;
    /// The natural logarithm.
    fn ln(self) -> Self;
    /// The absolute value.
    fn abs(self) -> Self;

    /// 0.
    fn zero() -> Self {
        Self::of(0.0)
    }
    /// 1.
    fn one() -> Self {
        Self::of(1.0)
    }
    /// The larger of both; the other number where one is NaN.
    fn at_least(self, low: Self) -> Self {
        if self > low { self } else { low }
    }
    /// The smaller of both; the other number where one is NaN.
    fn at_most(self, high: Self) -> Self {
        if self < high { self } else { high }
    }
}

macro_rules! scalar {
    ($t:ty, $series:expr) => {
        impl BendingScalar for $t {
            const SERIES: usize = $series;
            fn of(value: f64) -> Self {
                value as $t
            }
            fn wide(self) -> f64 {
                f64::from(self)
            }
            fn sqrt(self) -> Self {
                self.sqrt()
            }
            fn exp(self) -> Self {
                self.exp()
            }
            fn ln(self) -> Self {
                self.ln()
            }
            fn abs(self) -> Self {
                self.abs()
            }
        }
    };
}

scalar!(f64, 16);
scalar!(f32, 8);
