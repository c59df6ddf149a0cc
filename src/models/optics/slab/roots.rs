//! The roots of the secular equation of the discrete ordinates, 1 = ω Σ w/(1 − k²μ²), one between each two poles.

use super::ordinates::Ordinates;

/// The smallest root as (k²μ₀², 1 − k²μ₀²): of 1 = ω Σ w/(1 − k²μ²), or (1−ω)/ω = k² Σ wμ²/(1 − k²μ²).
pub(super) fn first_root<const N: usize>(o: &Ordinates<N>, omega: f64, absorbed: f64) -> (f64, f64) {
    let p = 1.0 / (o.mu[0] * o.mu[0]);
    let loss = absorbed / omega;
    let excess = |x: f64| {
        let (mut f, mut slope) = (-loss, 0.0);
        for i in 0..N {
            let m2 = o.mu[i] * o.mu[i];
            let d = 1.0 - x * m2;
            f += x * o.w[i] * m2 / d;
            slope += o.w[i] * m2 / (d * d);
        }
        (f, slope)
    };
    if excess(0.5 * p).0 >= 0.0 {
        // The function is convex and increasing, and 1/⟨μ²⟩ · loss lies to the right of the root, so Newton's method
        // descends to it.
        let mut x = (loss / o.mean_square).min(0.5 * p);
        for _ in 0..60 {
            let (f, slope) = excess(x);
            let next = (x - f / slope).max(0.0);
            let done = (next - x).abs() <= 4e-16 * x;
            x = next;
            if done {
                break;
            }
        }
        (x / p, 1.0 - x / p)
    } else {
        let y = root_between(o, omega, 0, 1.0);
        (1.0 - y, y)
    }
}

/// Root j (from 1 on) as (k²μ_j², 1 − k²μ_j²).
pub(super) fn next_root<const N: usize>(o: &Ordinates<N>, omega: f64, j: usize) -> (f64, f64) {
    // The lower pole 1/μ_{j−1}² lies at y = 1 − μ_j²/μ_{j−1}².
    let y = root_between(o, omega, j, o.gap[j - 1][j]);
    (1.0 - y, y)
}

/// The root y in (0, top) of 1 − ω Σ w_i/(gap_i + y (1−gap_i)), poles at both ends (at y = 0 only, for j = 0),
/// by rational interpolation of the two sums (the "middle way" of Li 1993).
fn root_between<const N: usize>(o: &Ordinates<N>, omega: f64, j: usize, top: f64) -> f64 {
    let (mut low, mut high) = (0.0, top);
    let mut y = if j == 0 { (omega * o.w[0]).max(0.5 * top * omega * o.w[0]) } else { 0.5 * top };
    y = y.min(0.5 * top);
    for _ in 0..100 {
        // gap is 0 for i = j, so that d is y there
        let sums = |range: std::ops::Range<usize>| {
            let (mut sum, mut slope) = (0.0, 0.0);
            for (&w, &gap) in o.w[range.clone()].iter().zip(&o.gap[j][range]) {
                let ratio = 1.0 - gap;
                let inverse = 1.0 / (gap + y * ratio);
                sum += w * inverse;
                slope += w * ratio * inverse * inverse;
            }
            (omega * sum, omega * slope)
        };
        let ((lower, below), (upper, above)) = (sums(0..j), sums(j..N));
        let f = 1.0 - lower - upper;
        if f > 0.0 {
            high = y
        } else {
            low = y
        }
        let p = above * y * y;
        let next = if j == 0 {
            p / (f + p / y)
        } else {
            let rest = top - y;
            let q = below * rest * rest;
            let cc = f + p / y - q / rest;
            let bb = cc * top + p + q;
            let root = (bb * bb - 4.0 * cc * p * top).max(0.0).sqrt();
            if bb >= 0.0 { 2.0 * p * top / (bb + root) } else { (bb - root) / (2.0 * cc) }
        };
        let next = if next > low && next < high { next } else { 0.5 * (low + high) };
        let done = (next - y).abs() <= 3e-16 * next;
        y = next;
        if done {
            break;
        }
    }
    y
}
