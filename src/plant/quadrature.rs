//! Gauss–Legendre nodes and weights on (0, 1), by Newton's method on the three-term recurrence (Abramowitz & Stegun 25.4.29).

use std::sync::LazyLock;

/// Node and weight.
pub type Node = (f64, f64);

/// 12 nodes: exact to rounding for functions analytic in an ellipse of half axes summing to 5.8 (in units of half the interval).
pub static TWELVE: LazyLock<Vec<Node>> = LazyLock::new(|| gauss(12));
/// 24 nodes, where a result is the reference of others.
pub static TWENTY_FOUR: LazyLock<Vec<Node>> = LazyLock::new(|| gauss(24));

/// The `n`-point rule; the weights sum to 1.
pub fn gauss(n: usize) -> Vec<Node> {
    let mut nodes = vec![(0.5, 1.0); n];
    for k in 0..n.div_ceil(2) {
        let mut x = (std::f64::consts::PI * (k as f64 + 0.75) / (n as f64 + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..100 {
            let (p, d) = legendre(n, x);
            slope = d;
            let step = p / d;
            x -= step;
            if step.abs() < 1e-16 {
                break;
            }
        }
        let w = 1.0 / ((1.0 - x * x) * slope * slope);
        nodes[n - 1 - k] = (0.5 + 0.5 * x, w);
        nodes[k] = (0.5 - 0.5 * x, w);
    }
    nodes
}

/// P_n(x) and its derivative, −1 < x < 1.
fn legendre(n: usize, x: f64) -> (f64, f64) {
    let (mut before, mut p) = (1.0, x);
    for j in 2..=n {
        let j = j as f64;
        (before, p) = (p, ((2.0 * j - 1.0) * x * p - (j - 1.0) * before) / j);
    }
    (p, n as f64 * (x * p - before) / (x * x - 1.0))
}

/// Four nodes in closed form (Abramowitz & Stegun 25.4.30), on (0, 1): what a shader integrates arc length with.
pub fn four() -> [Node; 4] {
    let root = (6.0f64 / 5.0).sqrt();
    let (inner, outer) = ((3.0 / 7.0 - 2.0 / 7.0 * root).sqrt(), (3.0 / 7.0 + 2.0 / 7.0 * root).sqrt());
    let (heavy, light) = ((18.0 + 30f64.sqrt()) / 72.0, (18.0 - 30f64.sqrt()) / 72.0);
    [(0.5 - 0.5 * outer, light), (0.5 - 0.5 * inner, heavy), (0.5 + 0.5 * inner, heavy), (0.5 + 0.5 * outer, light)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_integrated_exactly() {
        for n in [4, 12, 24] {
            for power in 0..2 * n as i32 {
                let sum: f64 = gauss(n).iter().map(|(x, w)| w * x.powi(power)).sum();
                assert!((sum * f64::from(power + 1) - 1.0).abs() < 1e-13, "{n} nodes, power {power}");
            }
        }
        for (a, b) in gauss(4).iter().zip(four()) {
            assert!((a.0 - b.0).abs() < 1e-15 && (a.1 - b.1).abs() < 1e-15);
        }
    }
}
