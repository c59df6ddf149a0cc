//! Patterns in residuals, compared with what noise alone gives after a fit.
//!
//! A pattern is measured by rᵀA r/rᵀr. With M = I − QQᵀ, which takes out what the parameters absorb, residuals of a
//! right model are r = M e with independent normal e. With ν degrees of freedom the ratio has exactly the mean tr(MA)/ν
//! and the variance 2(ν tr((MA)²) − tr(MA)²)/(ν²(ν + 2)), because it is independent of its denominator (J. Durbin,
//! G. S. Watson, "Testing for serial correlation in least squares regression I", Biometrika 37 (1950), 409–428).

use nalgebra::DMatrix;
use std::f64::consts::PI;

/// How strong a pattern is.
pub struct Pattern {
    /// How many standard deviations it is stronger than noise gives; normally distributed for a right model.
    pub score: f64,
    /// Its size for the reader: the correlation of neighbours, or the share of the scatter.
    pub share: f64,
}

/// Slow waves have at most this many half periods in a run, and at least [`READINGS`] readings to each.
const WAVES: usize = 8;
const READINGS: usize = 3;

/// How strongly residuals `r` agree with their neighbours in `runs`, and how much of them slow waves explain. `q` has
/// orthonormal columns that span what the parameters absorb; `freedom` is the number of residuals less its columns.
pub fn scores(r: &[f64], q: &DMatrix<f64>, runs: &[Vec<usize>], freedom: usize) -> [Pattern; 2] {
    let square: f64 = r.iter().map(|v| v * v).sum();
    let p = q.ncols();
    let scored = |value: f64, t1: f64, t2: f64, definite: bool| {
        let nu = freedom as f64;
        if !(t2 > 1e-9) {
            return 0.0;
        }
        let (ratio, mean) = (value / square, t1 / nu);
        let variance = 2.0 * (nu * t2 - t1 * t1) / (nu * nu * (nu + 2.0));
        if !(variance > 1e-12) {
            return 0.0;
        }
        if definite { beta_score(ratio, mean, variance) } else { (ratio - mean) / variance.sqrt() }
    };

    // Neighbours: A has a half at both places of each pair.
    let (mut pairs, mut value, mut between) = (0usize, 0.0, 0.0);
    let mut moved = DMatrix::<f64>::zeros(q.nrows(), p);
    for pair in runs.iter().flat_map(|run| run.windows(2)) {
        let (a, b) = (pair[0], pair[1]);
        pairs += 1;
        value += r[a] * r[b];
        between += 0.5 * (r[a] * r[a] + r[b] * r[b]);
        for j in 0..p {
            moved[(a, j)] += 0.5 * q[(b, j)];
            moved[(b, j)] += 0.5 * q[(a, j)];
        }
    }
    let g = q.transpose() * &moved;
    let t1 = -g.trace();
    let t2 = 0.5 * pairs as f64 - 2.0 * moved.norm_squared() + (&g * &g).trace();
    let share = if between > 0.0 { value / between } else { 0.0 };
    let neighbours = Pattern { score: scored(value, t1, t2, false), share };

    // Slow waves: A = Σ w c cᵀ over cosines c of length 1 in each run, slower ones with larger weights w.
    let (mut value, mut whole, mut trace, mut squares) = (0.0, 0.0, 0.0, 0.0);
    let mut g = DMatrix::<f64>::zeros(p, p);
    let mut g2 = 0.0;
    for run in runs {
        let n = run.len();
        for k in 1..=WAVES.min(n / READINGS) {
            let cosine = |i: usize| (2.0 / n as f64).sqrt() * (PI * k as f64 * (i as f64 + 0.5) / n as f64).cos();
            let weight = 1.0 / k as f64;
            let (mut dot, mut along) = (0.0, nalgebra::DVector::<f64>::zeros(p));
            for (i, &place) in run.iter().enumerate() {
                let c = cosine(i);
                dot += c * r[place];
                for j in 0..p {
                    along[j] += c * q[(place, j)];
                }
            }
            value += weight * dot * dot;
            whole += dot * dot;
            trace += weight;
            squares += weight * weight;
            g2 += weight * weight * along.norm_squared();
            g.ger(weight, &along, &along, 1.0);
        }
    }
    let t1 = trace - g.trace();
    let t2 = squares - 2.0 * g2 + (&g * &g).trace();
    let slow = Pattern { score: scored(value, t1, t2, true), share: whole / square };
    [neighbours, slow]
}

/// Normal score of a share whose distribution is about a beta distribution with this mean and variance, through the
/// approximation of F by E. Paulson, Ann. Math. Stat. 13 (1942), 233–235.
fn beta_score(share: f64, mean: f64, variance: f64) -> f64 {
    let common = mean * (1.0 - mean) / variance - 1.0;
    if !(common > 0.0) {
        return 0.0;
    }
    let (a, b) = (mean * common, (1.0 - mean) * common);
    let share = share.clamp(0.0, 1.0 - 1e-12);
    let f = (share / a) / ((1.0 - share) / b);
    let (u, v) = (1.0 / (9.0 * a), 1.0 / (9.0 * b));
    ((1.0 - v) * f.cbrt() - (1.0 - u)) / (u + v * f.cbrt().powi(2)).sqrt()
}
