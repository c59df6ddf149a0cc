//! Chebyshev polynomials T_n: the zeros at which functions are sampled, values, slopes and sums of series.
//!
//! Interpolation that judges other code is written apart from this module on purpose: `synth::slab_truth` makes the
//! truth of made-up leaves, and `optics::slab::chebyshev` checks the renderer's own table.

use std::f64::consts::PI;

/// Angle of zero `k` of T_n, from the right end of [−1, 1].
pub fn angle(k: usize, n: usize) -> f64 {
    PI * (k as f64 + 0.5) / n as f64
}

/// Zero `k` of T_n. Zeros descend: the first is next to 1.
pub fn node(k: usize, n: usize) -> f64 {
    angle(k, n).cos()
}

/// Fills `out` with T_first, T_first+step, … at x. `step` is 1, or 2 for one parity only.
#[inline]
pub fn fill(x: f64, first: usize, step: usize, out: &mut [f64]) {
    // T_{n+2s} = 2 T_s... for s = 1: 2x T − T; for s = 2: 2 T₂ T − T
    let twice = if step == 2 { 2.0 * (2.0 * x * x - 1.0) } else { 2.0 * x };
    // T_{first} and T_{first−step} (T₋₁ = x, T₋₂ = T₂)
    let (mut value, mut before) = match (first, step) {
        (0, 2) => (1.0, 2.0 * x * x - 1.0),
        (0, _) => (1.0, x),
        (_, 2) => (x, x),
        _ => (x, 1.0),
    };
    for v in out.iter_mut() {
        *v = value;
        (value, before) = (twice * value - before, value);
    }
}

/// T_0 … T_(n−1) at `x`.
pub fn values(x: f64, n: usize) -> Vec<f64> {
    let mut out = vec![0.0; n];
    fill(x, 0, 1, &mut out);
    out
}

/// T_0 … T_(N−1) at `x` and their derivatives. N is at least 2.
pub fn slopes<const N: usize>(x: f64) -> ([f64; N], [f64; N]) {
    let (mut value, mut slope) = ([1.0; N], [0.0; N]);
    (value[1], slope[1]) = (x, 1.0);
    for k in 2..N {
        value[k] = 2.0 * x * value[k - 1] - value[k - 2];
        slope[k] = 2.0 * value[k - 1] + 2.0 * x * slope[k - 1] - slope[k - 2];
    }
    (value, slope)
}

/// The sums Σ c_n T_n(x) of several series of at least one term, side by side (Clenshaw).
pub fn sums<const N: usize>(series: &[[f64; N]], x: f64) -> [f64; N] {
    let (mut b1, mut b2) = ([0.0; N], [0.0; N]);
    for c in series.iter().skip(1).rev() {
        let next = std::array::from_fn(|k| 2.0 * x * b1[k] - b2[k] + c[k]);
        (b1, b2) = (next, b1);
    }
    std::array::from_fn(|k| series[0][k] + x * b1[k] - b2[k])
}

/// The sum Σ c_n T_n(x) of one series of at least one term.
#[inline]
pub fn sum(series: &[f64], x: f64) -> f64 {
    sums(series.as_chunks::<1>().0, x)[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACES: [f64; 5] = [-1.0, -0.3, 0.0, 0.8, 1.0];

    #[test]
    fn chebyshev_is_the_cosine() {
        for x in PLACES {
            let angle = f64::acos(x);
            for (first, step) in [(0, 1), (1, 1), (0, 2), (1, 2)] {
                let mut t = [0.0; 12];
                fill(x, first, step, &mut t);
                for (k, v) in t.iter().enumerate() {
                    let want = ((first + step * k) as f64 * angle).cos();
                    assert!((v - want).abs() < 1e-13, "T{} at {x}: {v} {want}", first + step * k);
                }
            }
        }
    }

    #[test]
    fn nodes_are_the_zeros() {
        for n in 1..20 {
            for k in 0..n {
                let t = values(node(k, n), n + 1);
                assert!(t[n].abs() < 1e-13, "zero {k} of T{n}: {}", t[n]);
                assert!(k == 0 || node(k, n) < node(k - 1, n));
            }
        }
    }

    #[test]
    fn slopes_are_differences() {
        const STEP: f64 = 1e-6;
        for x in [-0.95, -0.3, 0.0, 0.8] {
            let (value, slope) = slopes::<9>(x);
            for n in 0..9 {
                let at = |x: f64| (n as f64 * x.acos()).cos();
                assert!((value[n] - at(x)).abs() < 1e-13);
                let difference = (at(x + STEP) - at(x - STEP)) / (2.0 * STEP);
                assert!((slope[n] - difference).abs() < 1e-6 * (1 + n * n) as f64, "T{n} at {x}");
            }
        }
    }

    #[test]
    fn sums_are_those_of_cosines() {
        let series: Vec<[f64; 2]> = (0..9).map(|n| [1.0 / f64::from(1 + n), (0.7 * f64::from(n)).sin()]).collect();
        for x in PLACES {
            for terms in 1..=series.len() {
                let found = sums(&series[..terms], x);
                for k in 0..2 {
                    let one: Vec<f64> = series[..terms].iter().map(|c| c[k]).collect();
                    let want: f64 = one.iter().enumerate().map(|(n, c)| c * (n as f64 * x.acos()).cos()).sum();
                    assert!((found[k] - want).abs() < 1e-13, "{terms} terms at {x}");
                    assert_eq!(found[k].to_bits(), sum(&one, x).to_bits());
                }
            }
        }
    }
}
