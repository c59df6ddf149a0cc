//! The Gauss–Legendre rules on (0, 1) that beams are integrated with.

use std::sync::LazyLock;

/// Node and weight.
pub type NodeWeight = (f64, f64);

/// 12 nodes: exact to rounding for functions analytic in an ellipse of half axes summing to 5.8 (in units of half the
/// interval).
pub(crate) static TWELVE: LazyLock<Vec<NodeWeight>> = LazyLock::new(|| gauss(12));
/// 24 nodes, where a result is the reference of others.
pub(crate) static TWENTY_FOUR: LazyLock<Vec<NodeWeight>> = LazyLock::new(|| gauss(24));

/// The `n`-point rule; the weights sum to 1.
pub fn gauss(n: usize) -> Vec<NodeWeight> {
    mesophyll_base::quadrature::unit(n)
}

/// Four nodes in closed form (Abramowitz & Stegun 25.4.30), on (0, 1): what a shader integrates arc length with.
pub fn four() -> [NodeWeight; 4] {
    let root = (6.0f64 / 5.0).sqrt();
    let (inner, outer) = ((3.0 / 7.0 - 2.0 / 7.0 * root).sqrt(), (3.0 / 7.0 + 2.0 / 7.0 * root).sqrt());
    let (heavy, light) = ((18.0 + 30f64.sqrt()) / 72.0, (18.0 - 30f64.sqrt()) / 72.0);
    [(0.5 - 0.5 * outer, light), (0.5 - 0.5 * inner, heavy), (0.5 + 0.5 * inner, heavy), (0.5 + 0.5 * outer, light)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_closed_form_is_the_rule_of_four() {
        for (a, b) in gauss(4).iter().zip(four()) {
            assert!((a.0 - b.0).abs() < 1e-15 && (a.1 - b.1).abs() < 1e-15);
        }
    }
}
