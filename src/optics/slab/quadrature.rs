//! Gauss–Legendre nodes on (0, 1), by Newton's method on the three-term recurrence (Abramowitz & Stegun 25.4.29).

/// One node and its weight.
#[derive(Debug, Clone, Copy)]
pub struct Node {
    pub x: f64,
    pub w: f64,
}

/// The `n`-point Gauss–Legendre rule on (0, 1), ascending; the weights sum to 1.
pub fn gauss(n: usize) -> Vec<Node> {
    let mut nodes = vec![Node { x: 0.5, w: 1.0 }; n];
    for k in 0..n.div_ceil(2) {
        let mut x = (std::f64::consts::PI * (k as f64 + 0.75) / (n as f64 + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..100 {
            let (p, d) = legendre_with_slope(n, x);
            slope = d;
            let step = p / d;
            x -= step;
            if step.abs() < 1e-16 {
                break;
            }
        }
        let w = 1.0 / ((1.0 - x * x) * slope * slope);
        nodes[n - 1 - k] = Node { x: 0.5 + 0.5 * x, w };
        nodes[k] = Node { x: 0.5 - 0.5 * x, w };
    }
    nodes
}

/// P_n(x) and its derivative, −1 < x < 1.
fn legendre_with_slope(n: usize, x: f64) -> (f64, f64) {
    let (mut p0, mut p1) = (1.0, x);
    for j in 2..=n {
        let j = j as f64;
        (p0, p1) = (p1, ((2.0 * j - 1.0) * x * p1 - (j - 1.0) * p0) / j);
    }
    (p1, n as f64 * (x * p1 - p0) / (x * x - 1.0))
}

/// Shifted Legendre polynomials P*_0 … P*_{n−1} at x in [0, 1].
pub fn shifted_legendre(x: f64, out: &mut [f64]) {
    let t = 2.0 * x - 1.0;
    for j in 0..out.len() {
        out[j] = match j {
            0 => 1.0,
            1 => t,
            _ => ((2 * j - 1) as f64 * t * out[j - 1] - (j - 1) as f64 * out[j - 2]) / j as f64,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integrates_powers_exactly() {
        for n in [2, 7, 24, 64] {
            let rule = gauss(n);
            for p in 0..(2 * n) {
                let sum: f64 = rule.iter().map(|q| q.w * q.x.powi(p as i32)).sum();
                assert!((sum * (p + 1) as f64 - 1.0).abs() < 1e-12, "n {n} power {p}: {sum}");
            }
        }
    }
}
