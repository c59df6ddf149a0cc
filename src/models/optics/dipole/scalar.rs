//! The kinds of number that a kernel is evaluated with ([`crate::number`]), and two functions of them that lose no
//! digits. So one formula gives the value, its Hankel transform and its exact derivatives.

pub use crate::number::Scalar;

/// Number of parameters that a [`TissueDual`] is differentiated by.
pub const PARTIALS: usize = 4;

/// A number and its derivatives by σa, σs, g and the thickness factor.
pub type TissueDual<T> = crate::number::Dual<T, PARTIALS>;

/// (1 − e^(−x))/x, an entire function: no digits are lost at x = 0.
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
