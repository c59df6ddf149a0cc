//! Gauss–Legendre rules, for every room that integrates: nodes by Newton's method on P_n, from Tricomi's cosines. The
//! reference renderer has one of its own, so that it shares nothing with what it judges.

#![warn(missing_docs)]

use std::f64::consts::PI;

/// Nodes and weights on [0, 1], ascending: exact for polynomials of degree below 2n. `n` ≥ 1.
pub fn unit(n: usize) -> Vec<(f64, f64)> {
    let mut rule = vec![(0.5, 1.0); n];
    for k in 0..n.div_ceil(2) {
        let (x, slope) = root(n, (PI * (k as f64 + 0.75) / (n as f64 + 0.5)).cos(), 1e-16);
        let w = 1.0 / ((1.0 - x * x) * slope * slope);
        rule[n - 1 - k] = (0.5 + 0.5 * x, w);
        rule[k] = (0.5 - 0.5 * x, w);
    }
    rule
}

/// The same on [−1, 1], ascending; symmetric to the last bit, the middle node of an odd rule exactly 0.
pub fn symmetric(n: usize) -> Vec<(f64, f64)> {
    let mut rule = vec![(0.0, 2.0); n];
    for k in 0..n.div_ceil(2) {
        let middle = n % 2 == 1 && k == n / 2;
        let start = if middle { 0.0 } else { (PI * (k as f64 + 0.75) / (n as f64 + 0.5)).cos() };
        let (mut x, slope) = root(n, start, 1e-15);
        if middle {
            x = 0.0;
        }
        let w = 2.0 / ((1.0 - x * x) * slope * slope);
        rule[k] = (-x, w);
        rule[n - 1 - k] = (x, w);
    }
    rule
}

/// The root of P_n near `x` and the slope there.
fn root(n: usize, mut x: f64, tolerance: f64) -> (f64, f64) {
    let mut slope = 1.0;
    for _ in 0..100 {
        let (p, d) = legendre(n, x);
        slope = d;
        let step = p / d;
        x -= step;
        if step.abs() < tolerance {
            break;
        }
    }
    (x, slope)
}

fn legendre(n: usize, x: f64) -> (f64, f64) {
    let (mut before, mut p) = (1.0, x);
    for j in 2..=n {
        let j = j as f64;
        (before, p) = (p, ((2.0 * j - 1.0) * x * p - (j - 1.0) * before) / j);
    }
    (p, n as f64 * (x * p - before) / (x * x - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_of_degree_below_2n_are_exact() {
        for n in [1, 2, 3, 4, 5, 7, 12, 24, 33, 64, 200] {
            for power in [0, 1, n, 2 * n - 2, 2 * n - 1] {
                let p = power as f64;
                let on_unit: f64 = unit(n).iter().map(|(x, w)| w * x.powi(power as i32)).sum();
                assert!((on_unit * (p + 1.0) - 1.0).abs() < 1e-12, "n {n}, power {power}: {on_unit}");
                let whole: f64 = symmetric(n).iter().map(|(x, w)| w * x.powi(power as i32)).sum();
                let want = if power % 2 == 1 { 0.0 } else { 2.0 / (p + 1.0) };
                assert!((whole - want).abs() < 1e-13, "n {n}, power {power}: {whole}");
            }
        }
    }
}
