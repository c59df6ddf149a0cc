//! Gauss–Legendre rules on [−1, 1], made once and kept.

use std::sync::{Arc, Mutex, OnceLock};

/// Nodes and weights, ascending.
pub type QuadratureNodes = Arc<Vec<(f64, f64)>>;

/// The rule of order `n` ≥ 1: exact for polynomials of degree 2n−1. Rules are kept for the life of the program.
pub fn gauss(n: usize) -> QuadratureNodes {
    static KEPT: OnceLock<Mutex<Vec<Option<QuadratureNodes>>>> = OnceLock::new();
    let kept = KEPT.get_or_init(|| Mutex::new(Vec::new()));
    // A worker that panicked while holding the lock left whole rules behind.
    let mut kept = kept.lock().unwrap_or_else(|e| e.into_inner());
    if kept.len() <= n {
        kept.resize(n + 1, None);
    }
    kept[n].get_or_insert_with(|| Arc::new(mesophyll_base::quadrature::symmetric(n.max(1)))).clone()
}
