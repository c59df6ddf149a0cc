//! Gauss–Legendre rules on [−1, 1], made once and kept.

use std::sync::{Arc, Mutex, OnceLock};

/// Nodes and weights, ascending.
pub type Nodes = Arc<Vec<(f64, f64)>>;

/// The rule of order `n` ≥ 1: exact for polynomials of degree 2n−1. Rules are kept for the life of the program.
pub fn gauss(n: usize) -> Nodes {
    static KEPT: OnceLock<Mutex<Vec<Option<Nodes>>>> = OnceLock::new();
    let kept = KEPT.get_or_init(|| Mutex::new(Vec::new()));
    // A worker that panicked while holding the lock left whole rules behind.
    let mut kept = kept.lock().unwrap_or_else(|e| e.into_inner());
    if kept.len() <= n {
        kept.resize(n + 1, None);
    }
    kept[n].get_or_insert_with(|| Arc::new(make(n.max(1)))).clone()
}

/// Newton on P_n from Tricomi's start (Abramowitz and Stegun 25.4.29).
fn make(n: usize) -> Vec<(f64, f64)> {
    let mut rule = vec![(0.0, 0.0); n];
    for i in 0..n.div_ceil(2) {
        let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
        if n % 2 == 1 && i == n / 2 {
            x = 0.0;
        }
        let mut slope = 1.0;
        for _ in 0..50 {
            let (mut p, mut before) = (x, 1.0);
            for k in 2..=n {
                let k = k as f64;
                (p, before) = (((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k, p);
            }
            slope = n as f64 * (x * p - before) / (x * x - 1.0);
            let step = p / slope;
            x -= step;
            if step.abs() < 1e-15 {
                break;
            }
        }
        let w = 2.0 / ((1.0 - x * x) * slope * slope);
        rule[i] = (-x, w);
        rule[n - 1 - i] = (x, w);
    }
    rule
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_for_polynomials() {
        for n in [1, 2, 5, 24, 64, 200] {
            let rule = gauss(n);
            for degree in [0, 1, 2 * n - 2, 2 * n - 1] {
                let got: f64 = rule.iter().map(|(x, w)| w * x.powi(degree as i32)).sum();
                let want = if degree % 2 == 1 { 0.0 } else { 2.0 / (degree as f64 + 1.0) };
                assert!((got - want).abs() < 1e-13, "n {n}, degree {degree}: {got} {want}");
            }
        }
        assert!(Arc::ptr_eq(&gauss(24), &gauss(24)));
    }
}
