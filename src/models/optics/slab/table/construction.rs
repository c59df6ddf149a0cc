//! How the committed table is made: `cargo test --release slab_table_is_made_again -- --ignored`.

use super::{DELTA_MAX, DELTA_MIN, EXTRAPOLATED, ORDER, Patch, WIDTH, absorbed_at};
use crate::slab::medium;
use mesophyll_base::chebyshev;
use rayon::prelude::*;

/// Rows of equal width in ln Δ.
const ROWS: usize = 19;
/// Check points of the committed table in each direction: the nodes of the interpolation, and as many between them.
pub(super) const CHECKS: usize = ORDER;
/// A patch is split in ξ until its largest error in ρd (relative) and ln ρt (absolute) at check points is below
/// this.
const TOLERANCE: f64 = 2e-10;

/// What a table is made of.
pub(crate) struct Source<'a> {
    /// Range of Δ.
    pub delta: [f64; 2],
    /// Twice the extrapolated distance: the slab's poles lie near 1 − ω = −π²/3 over the square of Δ plus this.
    pub extrapolated: f64,
    /// About the largest error.
    pub tolerance: f64,
    /// Check points in each direction of a patch, at most [`ORDER`]: nodes of the interpolation, and points between
    /// them.
    pub checks: usize,
    /// G₁ and G₂ at ω, 1−ω and Δ.
    pub scaled: &'a (dyn Fn(f64, f64, f64) -> [f64; 2] + Sync),
}

impl Source<'_> {
    fn truth(&self, q: f64, xi: f64) -> [f64; 2] {
        let delta = q.exp();
        let absorbed = absorbed_at(xi, delta, self.extrapolated);
        (self.scaled)(1.0 - absorbed, absorbed, delta)
    }
}

/// G₁ and G₂ of the slab without reflecting faces, from the exact solution.
pub(crate) fn matched(omega: f64, absorbed: f64, delta: f64) -> [f64; 2] {
    let (rho_d, log_t) = medium::solve_log(1.0, omega, absorbed, delta);
    [rho_d * (1.0 + delta) / (omega * delta), -log_t / delta]
}

/// Chebyshev interpolation, turned into powers.
fn fit(source: &Source, low: [f64; 2], high: [f64; 2]) -> Patch {
    let node = |k: usize| chebyshev::node(k, ORDER);
    // powers[m][k]: coefficient of x^k in T_m
    let mut powers = [[0.0; ORDER]; ORDER];
    powers[0][0] = 1.0;
    powers[1][1] = 1.0;
    for m in 2..ORDER {
        for k in 0..ORDER {
            powers[m][k] = if k > 0 { 2.0 * powers[m - 1][k - 1] } else { 0.0 } - powers[m - 2][k];
        }
    }
    // lagrange[i][k]: coefficient of x^k in the polynomial that is 1 at node i and 0 at the others
    let mut lagrange = [[0.0; ORDER]; ORDER];
    for i in 0..ORDER {
        for m in 0..ORDER {
            let weight = if m == 0 { 1.0 } else { 2.0 } / ORDER as f64 * (m as f64 * node(i).acos()).cos();
            for k in 0..ORDER {
                lagrange[i][k] += weight * powers[m][k];
            }
        }
    }
    let place = |d: usize, t: f64| 0.5 * (low[d] + high[d]) + 0.5 * (high[d] - low[d]) * t;
    let mut coefficients = vec![[0.0; WIDTH]; ORDER];
    for i in 0..ORDER {
        for j in 0..ORDER {
            let g = source.truth(place(0, node(j)), place(1, node(i)));
            for a in 0..ORDER {
                for b in 0..ORDER {
                    for s in 0..2 {
                        coefficients[a][2 * b + s] += g[s] * lagrange[i][a] * lagrange[j][b];
                    }
                }
            }
        }
    }
    Patch::new(low, high, coefficients)
}

/// Largest errors at check points between the nodes of q (first) and of ξ (second).
fn worst(source: &Source, patch: &Patch, low: [f64; 2], high: [f64; 2]) -> [f64; 2] {
    let mut worst = [0.0; 2];
    let checks = source.checks;
    for i in 0..checks {
        for j in 0..checks {
            // At a node of one direction only the other's error shows.
            let node = -chebyshev::node(i * ORDER / checks, ORDER);
            let between = -1.0 + 2.0 * j as f64 / (checks - 1) as f64;
            for direction in 0..2 {
                let (x, y) = if direction == 0 { (node, between) } else { (between, node) };
                let q = 0.5 * (low[0] + high[0]) + 0.5 * (high[0] - low[0]) * y;
                let xi = 0.5 * (low[1] + high[1]) + 0.5 * (high[1] - low[1]) * x;
                let (got, want) = (patch.evaluate(x, y).0, source.truth(q, xi.min(1.0 - 1e-12)));
                let delta = q.exp();
                // Below e^−72 (about 5e-32) only the order of magnitude of the transmittance matters.
                let deep = if want[1] * delta > 72.0 { 1e-5 } else { 1.0 };
                let error = (got[0] / want[0] - 1.0).abs().max((got[1] - want[1]).abs() * delta.max(1e-3) * deep);
                worst[direction] = error.max(worst[direction]);
            }
        }
    }
    worst
}

/// The patches of one row and their largest error; `None` where the row is too wide.
fn row(source: &Source, q0: f64, q1: f64) -> Option<(Vec<(f64, Patch)>, f64)> {
    let mut done = Vec::new();
    let mut todo = vec![(0.0, 1.0)];
    let mut largest: f64 = 0.0;
    while let Some((left, right)) = todo.pop() {
        let patch = fit(source, [q0, left], [q1, right]);
        let error = worst(source, &patch, [q0, left], [q1, right]);
        let allowed = source.tolerance * (q1.exp() / 4.0).powi(3).clamp(1.0, 25.0);
        if error[0].max(error[1]) <= allowed {
            largest = largest.max(error[0]).max(error[1]);
            done.push((right, patch));
        } else if error[0] <= 0.5 * allowed || error[0] < 0.1 * error[1] {
            let middle = 0.5 * (left + right);
            todo.push((middle, right));
            todo.push((left, middle));
        } else {
            return None;
        }
    }
    Some((done, largest))
}

/// A row of patches from q₀ to q₁ with its largest error.
type Made = (f64, f64, Vec<(f64, Patch)>, f64);

/// Rows that cover q₀ to q₁, ascending; a row that is too wide is halved.
fn rows_between(source: &Source, q0: f64, q1: f64) -> Vec<Made> {
    match row(source, q0, q1) {
        Some((patches, largest)) => vec![(q0, q1, patches, largest)],
        None => {
            let middle = 0.5 * (q0 + q1);
            let mut rows = rows_between(source, q0, middle);
            rows.extend(rows_between(source, middle, q1));
            rows
        }
    }
}

/// The bytes of the committed table; `say` is called with a line for each row.
pub fn bytes(say: impl FnMut(String)) -> Vec<u8> {
    let delta = [DELTA_MIN, DELTA_MAX];
    bytes_of(&Source { delta, extrapolated: EXTRAPOLATED, tolerance: TOLERANCE, checks: CHECKS, scaled: &matched }, say)
}

/// The bytes of a table.
pub(crate) fn bytes_of(source: &Source, mut say: impl FnMut(String)) -> Vec<u8> {
    let [bottom, top] = source.delta.map(f64::ln);
    // Rows are as wide as the committed table's; a loose tolerance allows wider ones.
    let widest = (DELTA_MAX / DELTA_MIN).ln() / ROWS as f64 * if source.tolerance > 1e-7 { 2.0 } else { 1.0 };
    let count = ((top - bottom) / widest).round().max(1.0) as usize;
    let edge = |r: usize| bottom + (top - bottom) * r as f64 / count as f64;
    let rows: Vec<Made> =
        (0..count).into_par_iter().flat_map_iter(|r| rows_between(source, edge(r), edge(r + 1))).collect();
    for (q0, q1, patches, largest) in &rows {
        say(format!("Δ {:9.2e} … {:9.2e}: {} patches, largest error {largest:.1e}", q0.exp(), q1.exp(), patches.len()));
    }
    let mut numbers = vec![rows.len() as f64];
    for (q0, q1, patches, _) in rows {
        numbers.extend([q0, q1, patches.len() as f64]);
        for (right, patch) in patches {
            numbers.push(right);
            numbers.extend(patch.coefficients.iter().flatten());
        }
    }
    numbers.iter().flat_map(|x| x.to_le_bytes()).collect()
}
