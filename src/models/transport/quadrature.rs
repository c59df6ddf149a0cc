//! Gauss–Legendre nodes, and an adaptive rule that uses them. Errors are absolute.

use std::f64::consts::PI;
use std::sync::OnceLock;

/// Nodes and weights on [−1, 1].
#[derive(Debug, Clone)]
pub struct QuadratureRule {
    /// The places where the function is evaluated.
    pub nodes: Vec<f64>,
    /// The weight of each node; they sum to 2.
    pub weights: Vec<f64>,
}

impl QuadratureRule {
    /// The `n`-point Gauss–Legendre rule, exact for polynomials of degree 2n−1, by Newton's method on P_n.
    pub fn legendre(n: usize) -> QuadratureRule {
        let mut rule = QuadratureRule { nodes: Vec::with_capacity(n), weights: Vec::with_capacity(n) };
        for i in 0..n {
            let mut x = -(PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..100 {
                let (mut before, mut p) = (0.0, 1.0);
                for k in 0..n {
                    let k = k as f64;
                    (before, p) = (p, ((2.0 * k + 1.0) * x * p - k * before) / (k + 1.0));
                }
                slope = n as f64 * (x * p - before) / (x * x - 1.0);
                let step = p / slope;
                x -= step;
                if step.abs() < 1e-15 {
                    break;
                }
            }
            rule.nodes.push(x);
            rule.weights.push(2.0 / ((1.0 - x * x) * slope * slope));
        }
        rule
    }

    /// ∫ f over [a, b].
    pub fn integrate(&self, a: f64, b: f64, mut f: impl FnMut(f64) -> f64) -> f64 {
        let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
        half * self.nodes.iter().zip(&self.weights).map(|(x, w)| w * f(middle + half * x)).sum::<f64>()
    }
}

/// The 16-point rule, computed once.
pub(crate) fn sixteen() -> &'static QuadratureRule {
    static RULE: OnceLock<QuadratureRule> = OnceLock::new();
    RULE.get_or_init(|| QuadratureRule::legendre(16))
}

/// ∫ f over [a, b]. Intervals are halved until one and two 16-point rules agree to `tolerance`, which is absolute and
/// divided by length.
pub fn adaptive(a: f64, b: f64, tolerance: f64, f: &mut impl FnMut(f64) -> f64) -> f64 {
    let whole = sixteen().integrate(a, b, &mut *f);
    halve(a, b, whole, tolerance, 40, f)
}

fn halve(a: f64, b: f64, whole: f64, tolerance: f64, depth: u32, f: &mut impl FnMut(f64) -> f64) -> f64 {
    let middle = 0.5 * (a + b);
    let (left, right) = (sixteen().integrate(a, middle, &mut *f), sixteen().integrate(middle, b, &mut *f));
    if depth == 0 || (left + right - whole).abs() <= tolerance {
        return left + right;
    }
    halve(a, middle, left, 0.5 * tolerance, depth - 1, f) + halve(middle, b, right, 0.5 * tolerance, depth - 1, f)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_are_exact_for_polynomials_and_kinks_are_found() {
        for n in [1, 2, 5, 16, 33] {
            let rule = QuadratureRule::legendre(n);
            let degree = 2 * n as i32 - 1;
            let value = rule.integrate(0.0, 1.0, |x| x.powi(degree));
            assert!((value * f64::from(degree + 1) - 1.0).abs() < 1e-13, "n {n}: {value}");
            assert!((rule.weights.iter().sum::<f64>() - 2.0).abs() < 1e-13);
        }
        let kink = adaptive(0.0, 1.0, 1e-12, &mut |x: f64| (x - 0.3).abs());
        assert!((kink - 0.29).abs() < 1e-11, "{kink}");
        let log = adaptive(0.0, 1.0, 1e-12, &mut |x: f64| -x.ln());
        assert!((log - 1.0).abs() < 1e-10, "{log}");
    }
}
