//! The tapered beam in double-double arithmetic, by other formulas than the library's. The library's correct digits are
//! counted against it.

use crate::precise::{DoubleDouble, PreciseDual, PreciseReal};
use mesophyll_base::solvers::qr::MatrixScalar;

/// H9 Eq. 4.7 as printed, except that its prefactor F/(E′r₁⁴) is 1.
fn printed<T: PreciseReal>(alpha: T, x: T) -> T {
    let c = T::constant;
    let b = alpha - T::one();
    let w = T::one() + x * b;
    let inner = c(2.0) * x * b * (c(3.0) + (alpha - c(3.0)) * alpha) + c(3.0) * (c(4.0) + (alpha - c(2.0)) * alpha);
    let top = x * b * (c(6.0) + x * b * inner) - c(6.0) * w * w * w.ln();
    top / (c(3.0) * T::pi() * w * w * b.square().square())
}

/// u and u′ to at least 18 digits: Eq. 4.7 where |(1−α)x| > 0.3 (its slope by differentiation of the formula),
/// elsewhere the double integral of u″ = (2/π)(1−x)² Σ (k+3 over 3)(1−α)^k x^k, term by term.
pub fn exact(alpha: f64, x: f64) -> (DoubleDouble, DoubleDouble) {
    let beta = DoubleDouble::constant(alpha) - DoubleDouble::one();
    let at = DoubleDouble::constant(x);
    if (beta * at).value().abs() > 0.3 {
        let u =
            printed(PreciseDual::<DoubleDouble, 1>::constant(alpha), PreciseDual::<DoubleDouble, 1>::variable(at, 0));
        return (u.v, u.d[0]);
    }
    let (mut u, mut du) = (DoubleDouble::default(), DoubleDouble::default());
    let mut power = DoubleDouble::one(); // (−β x)^k
    for k in 0..70 {
        let k = f64::from(k);
        let binomial = DoubleDouble::constant((k + 1.0) * (k + 2.0) * (k + 3.0) / 6.0);
        // (1 − x)² x^k, integrated once and twice.
        for (m, sign) in [(k, 1.0), (k + 1.0, -2.0), (k + 2.0, 1.0)] {
            let raised = (k as i32..m as i32).fold(power, |p, _| p * at) * binomial * DoubleDouble::constant(sign);
            du = du + raised * at / DoubleDouble::constant(m + 1.0);
            u = u + raised * at * at / (DoubleDouble::constant(m + 1.0) * DoubleDouble::constant(m + 2.0));
        }
        power = -(power * beta * at);
    }
    let scale = DoubleDouble::constant(2.0) / DoubleDouble::PI;
    (u * scale, du * scale)
}

/// Correct digits of (u, u′), the worse of the two, at most 16; 0 is exact where the reference is 0.
pub fn digits(alpha: f64, x: f64, got: (f64, f64)) -> f64 {
    let (u, du) = exact(alpha, x);
    let each = |got: f64, want: DoubleDouble| {
        if want.value() == 0.0 {
            return if got == 0.0 { 16.0 } else { 0.0 };
        }
        let error = ((DoubleDouble::constant(got) - want) / want).value().abs();
        if error.is_nan() { 0.0 } else { (-error.log10()).clamp(0.0, 16.0) }
    };
    each(got.0, u).min(each(got.1, du))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_plants::mechanics::beam;

    /// The library's promise: 1e-12 for every taper from 1e-4 to 1 and every x.
    #[test]
    fn u_and_its_slope_are_exact_to_twelve_digits() {
        let mut alphas: Vec<f64> = (0..=60).map(|k| (1e-4f64.ln() * f64::from(k) / 60.0).exp()).collect();
        for k in 1..=14 {
            alphas.extend([1.0 - 10f64.powi(-k), 1.0 + 0.25 * 10f64.powi(-k)]);
        }
        alphas.extend([1.25, 1.01, 0.99, 0.5, 0.499_999_999]);
        let mut worst = (16.0, 0.0, 0.0);
        for &alpha in &alphas {
            for k in 0..=40 {
                let t = f64::from(k) / 40.0;
                for x in [t, 1.0 - 10f64.powf(-6.0 * t), 10f64.powf(-8.0 * t)] {
                    let d = digits(alpha, x, (beam::deflection(alpha, x), beam::slope(alpha, x)));
                    if d < worst.0 {
                        worst = (d, alpha, x);
                    }
                }
            }
        }
        println!("fewest correct digits: {:.2} at α = {}, x = {}", worst.0, worst.1, worst.2);
        assert!(worst.0 >= 12.0, "{worst:?}");
    }

    /// Compares the two references where both are valid.
    #[test]
    fn the_references_agree() {
        for x in [0.8, 0.9, 1.0] {
            for alpha in [0.71, 0.8, 1.2] {
                let series = exact(alpha, x);
                let closed = printed(
                    PreciseDual::<DoubleDouble, 1>::constant(alpha),
                    PreciseDual::<DoubleDouble, 1>::variable(DoubleDouble::constant(x), 0),
                );
                let close =
                    |a: DoubleDouble, b: DoubleDouble| assert!(((a - b) / b).value().abs() < 1e-18, "α {alpha}, x {x}");
                close(series.0, closed.v);
                close(series.1, closed.d[0]);
            }
        }
        // A reference value that does not come from mpmath: α = 1 in closed form.
        let (u, _) = exact(1.0, 1.0);
        assert!((u * DoubleDouble::PI * DoubleDouble::constant(2.0) - DoubleDouble::one()).value().abs() < 1e-30);
    }
}
