//! Double-double arithmetic: a number is the unevaluated sum of two `f64` and has about 31 decimal digits. With it a
//! final Gauss–Newton step sees residuals that double precision rounds away. The range is that of `f64`; products above
//! about 1e300 are not finite.
//!
//! Sums and products: T. J. Dekker, "A floating-point technique for extending the available precision", Numer. Math. 18
//! (1971), 224–242.

// A comparison with NaN is false, so `!(a < b)` is written where NaN must fail.
#![allow(clippy::neg_cmp_op_on_partial_ord)]

use super::real::PreciseReal;
use mesophyll_base::solvers::qr::MatrixScalar;
use std::cmp::Ordering;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// `hi + lo` with |lo| ≤ ulp(hi)/2.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DoubleDouble {
    hi: f64,
    lo: f64,
}

/// Sum and its rounding error, exactly (Knuth's two-sum).
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let s = a + b;
    let bb = s - a;
    (s, (a - (s - bb)) + (b - bb))
}

/// The same where |a| ≥ |b| (Dekker's fast two-sum).
fn quick_two_sum(a: f64, b: f64) -> (f64, f64) {
    let s = a + b;
    (s, b - (s - a))
}

/// Product and its rounding error, exactly: Dekker's splitting, for processors whose fused multiply-add is a slow
/// library call.
fn two_product(a: f64, b: f64) -> (f64, f64) {
    const SPLITTER: f64 = 134_217_729.0; // 2²⁷ + 1
    let split = |x: f64| {
        let t = SPLITTER * x;
        let high = t - (t - x);
        (high, x - high)
    };
    let p = a * b;
    let (ah, al) = split(a);
    let (bh, bl) = split(b);
    (p, ((ah * bh - p) + ah * bl + al * bh) + al * bl)
}

impl DoubleDouble {
    pub const PI: DoubleDouble = DoubleDouble { hi: std::f64::consts::PI, lo: 1.224_646_799_147_353_2e-16 };
    const HALF_PI: DoubleDouble = DoubleDouble { hi: std::f64::consts::FRAC_PI_2, lo: 6.123_233_995_736_766e-17 };
    const LN_2: DoubleDouble = DoubleDouble { hi: std::f64::consts::LN_2, lo: 2.319_046_813_846_299_6e-17 };

    /// The exact sum of two doubles.
    pub fn sum(a: f64, b: f64) -> Self {
        let (hi, lo) = two_sum(a, b);
        DoubleDouble { hi, lo }
    }

    /// The part beyond double precision.
    pub fn tail(self) -> f64 {
        self.lo
    }

    pub fn abs(self) -> Self {
        if self.hi < 0.0 { -self } else { self }
    }

    pub fn is_finite(self) -> bool {
        self.hi.is_finite() && self.lo.is_finite()
    }

    /// Reads a decimal number (`-1.5E-03`) to full double-double precision: data given with 14 digits are not spoilt by
    /// rounding to `f64`.
    pub fn parse(text: &str) -> Option<Self> {
        let text = text.trim();
        // The standard parser decides what a number is; hexadecimal or named values do not pass.
        let nearest: f64 = text.parse().ok()?;
        if !nearest.is_finite()
            || !text.bytes().all(|b| b.is_ascii_digit() || matches!(b, b'+' | b'-' | b'.' | b'e' | b'E'))
        {
            return None;
        }
        let (mantissa, exponent) = match text.find(['e', 'E']) {
            Some(at) => (&text[..at], text[at + 1..].parse::<i32>().ok()?),
            None => (text, 0),
        };
        let (mut digits, mut scale) = (DoubleDouble::default(), exponent);
        let mut after_point = false;
        for b in mantissa.bytes() {
            match b {
                b'.' => after_point = true,
                b'0'..=b'9' => {
                    digits = digits * DoubleDouble::constant(10.0) + DoubleDouble::constant(f64::from(b - b'0'));
                    scale -= i32::from(after_point);
                }
                _ => {}
            }
        }
        let magnitude = if scale >= 0 {
            digits * DoubleDouble::power_of_ten(scale)
        } else {
            digits / DoubleDouble::power_of_ten(-scale)
        };
        let value = if mantissa.starts_with('-') { -magnitude } else { magnitude };
        // Exponents that this method cannot hold fall back to the nearest double.
        Some(if value.is_finite() { value } else { DoubleDouble::constant(nearest) })
    }

    fn power_of_ten(n: i32) -> Self {
        let (mut result, mut base, mut n) = (DoubleDouble::one(), DoubleDouble::constant(10.0), n);
        while n > 0 {
            if n & 1 == 1 {
                result = result * base;
            }
            base = base * base;
            n >>= 1;
        }
        result
    }

    /// Quotient by a double, which takes half the work of the general one.
    fn over(self, b: f64) -> Self {
        let q = self.hi / b;
        let (p, e) = two_product(q, b);
        let (hi, lo) = quick_two_sum(q, ((self.hi - p) - e + self.lo) / b);
        DoubleDouble { hi, lo }
    }

    /// Exact product with a power of two.
    fn ldexp(self, n: i32) -> Self {
        // The power is applied in two factors, so that results near the ends of the range do not pass through infinity
        // or zero.
        let (a, b) = (n / 2, n - n / 2);
        let (fa, fb) = (2f64.powi(a), 2f64.powi(b));
        DoubleDouble { hi: self.hi * fa * fb, lo: self.lo * fa * fb }
    }

    /// Sine and cosine of |x| ≤ π/4 by their power series.
    fn sin_cos_small(self) -> (Self, Self) {
        let square = self * self;
        let (mut sin, mut cos) = (self, DoubleDouble::one());
        let (mut sin_term, mut cos_term) = (self, DoubleDouble::one());
        for k in 1..=16 {
            let k = f64::from(k);
            cos_term = -(cos_term * square).over((2.0 * k - 1.0) * (2.0 * k));
            sin_term = -(sin_term * square).over((2.0 * k) * (2.0 * k + 1.0));
            cos = cos + cos_term;
            sin = sin + sin_term;
            if cos_term.hi.abs() < 1e-34 {
                break;
            }
        }
        (sin, cos)
    }

    fn both(self) -> (Self, Self) {
        if !self.is_finite() {
            return (DoubleDouble::constant(f64::NAN), DoubleDouble::constant(f64::NAN));
        }
        let quarter = (self.hi / DoubleDouble::HALF_PI.hi).round();
        let (s, c) = (self - DoubleDouble::constant(quarter) * DoubleDouble::HALF_PI).sin_cos_small();
        match quarter.rem_euclid(4.0) as i64 {
            0 => (s, c),
            1 => (c, -s),
            2 => (-s, -c),
            _ => (-c, s),
        }
    }
}

impl From<f64> for DoubleDouble {
    fn from(hi: f64) -> Self {
        DoubleDouble { hi, lo: 0.0 }
    }
}

impl PartialOrd for DoubleDouble {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        match self.hi.partial_cmp(&other.hi) {
            Some(Ordering::Equal) => self.lo.partial_cmp(&other.lo),
            unequal => unequal,
        }
    }
}

impl Neg for DoubleDouble {
    type Output = DoubleDouble;
    fn neg(self) -> DoubleDouble {
        DoubleDouble { hi: -self.hi, lo: -self.lo }
    }
}

impl Add for DoubleDouble {
    type Output = DoubleDouble;
    fn add(self, b: DoubleDouble) -> DoubleDouble {
        let (s, e) = two_sum(self.hi, b.hi);
        // ∞ − ∞ in the error terms must not turn an infinite sum into NaN.
        if !s.is_finite() {
            return DoubleDouble { hi: s, lo: 0.0 };
        }
        let (t, f) = two_sum(self.lo, b.lo);
        let (s, e) = quick_two_sum(s, e + t);
        let (hi, lo) = quick_two_sum(s, e + f);
        DoubleDouble { hi, lo }
    }
}

impl Sub for DoubleDouble {
    type Output = DoubleDouble;
    fn sub(self, b: DoubleDouble) -> DoubleDouble {
        self + (-b)
    }
}

impl Mul for DoubleDouble {
    type Output = DoubleDouble;
    fn mul(self, b: DoubleDouble) -> DoubleDouble {
        let (p, e) = two_product(self.hi, b.hi);
        if !e.is_finite() {
            return DoubleDouble { hi: p, lo: 0.0 };
        }
        let (hi, lo) = quick_two_sum(p, e + (self.hi * b.lo + self.lo * b.hi));
        DoubleDouble { hi, lo }
    }
}

impl Div for DoubleDouble {
    type Output = DoubleDouble;
    fn div(self, b: DoubleDouble) -> DoubleDouble {
        let q1 = self.hi / b.hi;
        if !q1.is_finite() || b.hi.is_infinite() {
            return DoubleDouble { hi: q1, lo: 0.0 };
        }
        let r = self - b * DoubleDouble::constant(q1);
        let q2 = r.hi / b.hi;
        let r = r - b * DoubleDouble::constant(q2);
        let q3 = r.hi / b.hi;
        let (hi, lo) = quick_two_sum(q1, q2);
        DoubleDouble { hi, lo } + DoubleDouble::constant(q3)
    }
}

impl MatrixScalar for DoubleDouble {
    fn constant(value: f64) -> Self {
        DoubleDouble { hi: value, lo: 0.0 }
    }

    fn value(self) -> f64 {
        self.hi + self.lo
    }

    fn sqrt(self) -> Self {
        if self.hi <= 0.0 {
            return DoubleDouble::constant(self.hi.sqrt());
        }
        // One Newton step doubles the digits of the hardware's root.
        let root = DoubleDouble::constant(self.hi.sqrt());
        root + (self - root * root) / DoubleDouble::constant(2.0 * root.hi)
    }
}

impl PreciseReal for DoubleDouble {
    fn precise(value: DoubleDouble) -> Self {
        value
    }

    fn exp(self) -> Self {
        if !(self.hi.abs() < 700.0) {
            return DoubleDouble::constant(self.hi.exp());
        }
        // exp x = 2ᵏ (exp(r/512))^512 with |r| ≤ ln 2 / 2. The squarings work on exp − 1, which keeps the digits of the
        // small part.
        let k = (self.hi / DoubleDouble::LN_2.hi).round();
        let r = (self - DoubleDouble::constant(k) * DoubleDouble::LN_2).ldexp(-9);
        let (mut sum, mut term) = (r, r);
        for n in 2..=9 {
            term = (term * r).over(f64::from(n));
            sum = sum + term;
        }
        for _ in 0..9 {
            sum = sum.ldexp(1) + sum * sum;
        }
        (sum + DoubleDouble::one()).ldexp(k as i32)
    }

    fn ln(self) -> Self {
        if !(self.hi > 0.0 && self.hi.is_finite()) {
            return DoubleDouble::constant(self.hi.ln());
        }
        // Newton on exp y = x: y ← y + x exp(−y) − 1, two steps from the double-precision logarithm.
        let mut y = DoubleDouble::constant(self.hi.ln());
        for _ in 0..2 {
            y = y + self * (-y).exp() - DoubleDouble::one();
        }
        y
    }

    fn sin(self) -> Self {
        self.both().0
    }

    fn cos(self) -> Self {
        self.both().1
    }

    fn sin_cos(self) -> (Self, Self) {
        self.both()
    }

    fn atan(self) -> Self {
        let near = DoubleDouble::constant(self.hi.atan());
        if !self.is_finite() {
            return near;
        }
        // tan(atan x − y) = (x cos y − sin y)/(cos y + x sin y), of order 1e-16: its cube is below the last digit.
        let (s, c) = near.sin_cos();
        near + (self * c - s) / (c + self * s)
    }
}

#[cfg(test)]
#[path = "dd_tests.rs"]
mod tests;
