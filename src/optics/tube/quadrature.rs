//! Node sets on [−1, 1]: Gauss–Legendre, and the trapezoid that is nearly exact for a bell that fits between the tube's ends.

/// Gauss–Legendre nodes and weights of order `n` ≥ 1, ascending, to rounding. Newton on P_n from Tricomi's start.
pub fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    let mut rule = vec![(0.0, 0.0); n];
    for i in 0..n.div_ceil(2) {
        let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..100 {
            let (mut p, mut before) = (x, 1.0);
            for k in 2..=n {
                let k = k as f64;
                (p, before) = (((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k, p);
            }
            if n == 1 {
                (p, before) = (x, 1.0);
            }
            slope = n as f64 * (x * p - before) / (x * x - 1.0);
            let dx = p / slope;
            x -= dx;
            if dx.abs() < 1e-15 {
                break;
            }
        }
        if n % 2 == 1 && i == n / 2 {
            x = 0.0;
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
    fn integrates_polynomials_of_degree_2n_minus_1() {
        for n in [1, 2, 3, 5, 8, 16, 33, 64] {
            let rule = gauss_legendre(n);
            for degree in [0, 1, 2 * n - 2, 2 * n - 1] {
                let got: f64 = rule.iter().map(|(x, w)| w * x.powi(degree as i32)).sum();
                let want = if degree % 2 == 1 { 0.0 } else { 2.0 / (degree as f64 + 1.0) };
                assert!((got - want).abs() < 1e-13, "n {n}, degree {degree}: {got}");
            }
        }
    }
}
