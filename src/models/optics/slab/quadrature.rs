//! Gauss–Legendre nodes on (0, 1), and the polynomials that the FN method expands in.

/// One node and its weight.
#[derive(Debug, Clone, Copy)]
pub struct QuadratureNode {
    /// Place of the node.
    pub x: f64,
    /// Its weight.
    pub w: f64,
}

/// The `n`-point Gauss–Legendre rule on (0, 1), ascending; the weights sum to 1.
pub fn gauss(n: usize) -> Vec<QuadratureNode> {
    mesophyll_base::quadrature::unit(n).into_iter().map(|(x, w)| QuadratureNode { x, w }).collect()
}

/// Shifted Legendre polynomials P*_0 … P*_{n−1} at x in [0, 1].
pub(crate) fn shifted_legendre(x: f64, out: &mut [f64]) {
    let t = 2.0 * x - 1.0;
    for j in 0..out.len() {
        out[j] = match j {
            0 => 1.0,
            1 => t,
            _ => ((2 * j - 1) as f64 * t * out[j - 1] - (j - 1) as f64 * out[j - 2]) / j as f64,
        };
    }
}
