//! What formulas need of a number, where they are written once for several kinds of it.
//!
//! [`Arithmetic`] is what all kinds share. [`FloatingPoint`] is `f32` or `f64`: what a shader computes is written once
//! and is evaluated in both. The traits that go further differ in kind and stay where they are used: a
//! [`crate::solvers::qr::MatrixScalar`] may have more digits than `f64`, and proofs add elementary functions to it
//! (`PreciseReal`); the optics' `Scalar` may be complex or carry derivatives, so it has no order and no nearest `f64`.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A number that can be added, subtracted, multiplied and divided.
pub trait Arithmetic:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
}

impl<T> Arithmetic for T where
    T: Copy + Add<Output = T> + Sub<Output = T> + Mul<Output = T> + Div<Output = T> + Neg<Output = T>
{
}

/// `f32` or `f64`: the `f32` form computes exactly the formulas of the `f64` form.
pub trait FloatingPoint: Arithmetic + AddAssign + PartialOrd + Debug + Default + Send + Sync + 'static {
    /// The nearest number of this type.
    fn of(value: f64) -> Self;
    /// The same number in double precision.
    fn wide(self) -> f64;
    /// self · b + c; fused if `FUSED` is set (only for processors that have the instruction: on others it is a slow
    /// call).
    fn fma<const FUSED: bool>(self, b: Self, c: Self) -> Self;
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

macro_rules! floating_point {
    ($t:ty) => {
        impl FloatingPoint for $t {
            #[inline(always)]
            fn of(value: f64) -> Self {
                value as $t
            }
            #[inline(always)]
            fn wide(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn fma<const FUSED: bool>(self, b: Self, c: Self) -> Self {
                if FUSED { self.mul_add(b, c) } else { self * b + c }
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                self.sqrt()
            }
            #[inline(always)]
            fn exp(self) -> Self {
                self.exp()
            }
            #[inline(always)]
            fn ln(self) -> Self {
                self.ln()
            }
            #[inline(always)]
            fn abs(self) -> Self {
                self.abs()
            }
        }
    };
}

floating_point!(f32);
floating_point!(f64);

#[cfg(test)]
mod tests {
    use super::*;

    /// The functions of a number x of the type `T`, and what they must be for its value in double precision.
    fn errors<T: FloatingPoint>(x: f64) -> f64 {
        let number = T::of(x);
        let wide = number.wide();
        [
            (number.sqrt().wide(), wide.sqrt()),
            (number.exp().wide(), wide.exp()),
            (number.ln().wide(), wide.ln()),
            ((-number).abs().wide(), wide),
            (number.fma::<false>(number, T::one()).wide(), wide * wide + 1.0),
            (number.fma::<true>(number, T::one()).wide(), wide * wide + 1.0),
        ]
        .map(|(found, want)| (found - want).abs() / want.abs().max(1.0))
        .into_iter()
        .fold(0.0, f64::max)
    }

    #[test]
    fn both_precisions_compute_the_same_functions() {
        for x in [0.01, 0.5, 1.0, 1.7, 12.3] {
            assert!(errors::<f64>(x) < 1e-15 && errors::<f32>(x) < 1e-6, "{x}");
        }
        assert_eq!(f32::of(0.1).wide(), f64::from(0.1f32));
    }

    #[test]
    fn bounds_leave_no_nan() {
        fn check<T: FloatingPoint>() {
            let nan = T::of(f64::NAN);
            assert!(nan.at_least(T::zero()) == T::zero() && nan.at_most(T::one()) == T::one());
            let two = T::of(2.0);
            assert!(two.at_least(T::one()) == two && two.at_most(T::one()) == T::one());
            assert!(T::zero().at_least(T::one()) == T::one() && T::zero().at_most(T::one()) == T::zero());
        }
        check::<f32>();
        check::<f64>();
    }
}
