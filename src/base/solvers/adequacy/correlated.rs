//! Variances of parameters where residuals are correlated with their neighbours.
//!
//! The residuals of a run are taken as a first-order autoregression: the correlation of two of them is ρ to the power
//! of the steps between them. ρ and the scatter come from the residuals by restricted maximum likelihood, which allows
//! for what the parameters have absorbed (H. D. Patterson, R. Thompson, Biometrika 58 (1971), 545–554). The parameters
//! were fitted without regard to this, so their covariance is J⁺ C J⁺ᵀ with C of the residuals and J⁺ the
//! pseudo-inverse.

use super::Basis;
use nalgebra::{DMatrix, DVector};

/// Correlations of neighbours that are tried.
const TRIED: [f64; 16] = [0.0, 0.2, 0.35, 0.5, 0.6, 0.7, 0.78, 0.85, 0.9, 0.93, 0.95, 0.97, 0.98, 0.99, 0.995, 0.998];

/// Variance of each parameter, with the residuals' own scatter and their correlation along `runs`; residuals in no run
/// are independent.
pub fn variances(r: &[f64], basis: &Basis, runs: &[Vec<usize>]) -> Vec<f64> {
    let order = Order::new(r.len(), runs);
    let Some((rho, scale)) = order.likeliest(r, &basis.q) else { return basis.variances.clone() };
    let covered = |column: DVector<f64>| scale * column.dot(&order.correlated(&column, rho));
    basis.inverse.column_iter().map(|column| covered(column.into_owned())).collect()
}

/// Residuals by the one before them in their run.
struct Order {
    /// All residuals, run by run, and whether each begins a run.
    places: Vec<(usize, bool)>,
}

impl Order {
    fn new(m: usize, runs: &[Vec<usize>]) -> Order {
        let mut places: Vec<(usize, bool)> = Vec::with_capacity(m);
        let mut seen = vec![false; m];
        for run in runs {
            let mut first = true;
            for &k in run.iter().filter(|k| **k < m) {
                if !std::mem::replace(&mut seen[k], true) {
                    places.push((k, first));
                    first = false;
                }
            }
        }
        places.extend((0..m).filter(|k| !seen[*k]).map(|k| (k, true)));
        Order { places }
    }

    /// `x` times a root of the inverse correlation matrix: what is new in each residual, of variance 1.
    fn whitened(&self, x: impl Fn(usize) -> f64, rho: f64) -> DVector<f64> {
        let new = (1.0 - rho * rho).sqrt();
        let mut before = 0.0;
        let each = self.places.iter().map(|&(k, first)| {
            let value = x(k);
            let out = if first { value } else { (value - rho * before) / new };
            before = value;
            out
        });
        DVector::from_iterator(self.places.len(), each)
    }

    /// The correlation matrix times `x`.
    fn correlated(&self, x: &DVector<f64>, rho: f64) -> DVector<f64> {
        let mut out = x.clone();
        let mut sum = 0.0;
        for (i, &(k, first)) in self.places.iter().enumerate() {
            let before = if first { 0.0 } else { sum + x[self.places[i - 1].0] };
            sum = rho * before;
            out[k] += sum;
        }
        sum = 0.0;
        for i in (0..self.places.len()).rev() {
            let ends = self.places.get(i + 1).is_none_or(|next| next.1);
            let after = if ends { 0.0 } else { sum + x[self.places[i + 1].0] };
            sum = rho * after;
            out[self.places[i].0] += sum;
        }
        out
    }

    /// The likeliest correlation of neighbours, and the variance of a residual with it.
    fn likeliest(&self, r: &[f64], q: &DMatrix<f64>) -> Option<(f64, f64)> {
        let m = r.len();
        let freedom = m.checked_sub(q.ncols()).filter(|f| *f > 0)? as f64;
        let followers = self.places.iter().filter(|p| !p.1).count() as f64;
        let mut best: Option<(f64, f64, f64)> = None;
        for rho in TRIED {
            let white = self.whitened(|k| r[k], rho);
            let mut spanned = DMatrix::zeros(m, q.ncols());
            for j in 0..q.ncols() {
                spanned.set_column(j, &self.whitened(|k| q[(k, j)], rho));
            }
            let normal = spanned.transpose() * &spanned;
            let Some(root) = normal.cholesky() else { continue };
            let dots = spanned.transpose() * &white;
            let rest = white.norm_squared() - dots.dot(&root.solve(&dots));
            let scale = rest / freedom;
            if !(scale > 0.0) {
                continue;
            }
            let log_root: f64 = root.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
            let likelihood = -0.5 * freedom * scale.ln() - 0.5 * followers * (1.0 - rho * rho).ln() - log_root;
            if best.is_none_or(|b| likelihood > b.0) {
                best = Some((likelihood, rho, scale));
            }
        }
        best.map(|(_, rho, scale)| (rho, scale))
    }
}
