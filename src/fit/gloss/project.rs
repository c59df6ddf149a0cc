//! Variable projection on Gram sums (Golub & Pereyra 1973, in Kaufman's approximation): per channel ρd, ρs ≥ 0 are solved for
//! exactly, and m and the tilts see residuals from which every change that ρd and ρs could make is projected out.
//!
//! Everything a step needs are the weighted inner products of at most eight columns: D, S, their derivatives and the samples.

use super::traces::{COLUMNS, D, D_B, D_Y, S, S_B, S_M, S_Y};

/// Weighted inner products of one channel: columns in `traces` order, the samples last.
#[derive(Debug, Clone, Copy, Default)]
pub struct Gram(pub [[f64; COLUMNS + 1]; COLUMNS + 1]);

/// Position of the samples among the columns.
pub const Y: usize = COLUMNS;
/// Most nonlinear parameters: m, tilt, tilt_y.
pub const NONLINEAR: usize = 3;

/// One channel's linear solve.
#[derive(Debug, Clone, Copy, Default)]
pub struct Linear {
    pub rho_d: f64,
    pub rho_s: f64,
    /// Inverse of the 2 × 2 normal matrix of the unconstrained columns (zero rows where a bound is active).
    pub inverse: [[f64; 2]; 2],
    /// Σ w r² at the solution.
    pub chi2: f64,
}

impl Gram {
    /// Non-negative least squares for ρd and ρs.
    pub fn solve(&self) -> Linear {
        let g = &self.0;
        let (dd, ds, ss, dy, sy, yy) = (g[D][D], g[D][S], g[S][S], g[D][Y], g[S][Y], g[Y][Y]);
        let only = |gg: f64, gy: f64| if gg > 0.0 { (gy / gg).max(0.0) } else { 0.0 };
        let det = dd * ss - ds * ds;
        let (mut rho_d, mut rho_s, mut inverse) = (0.0, 0.0, [[0.0; 2]; 2]);
        if det > 1e-12 * dd * ss {
            (rho_d, rho_s) = ((ss * dy - ds * sy) / det, (dd * sy - ds * dy) / det);
            inverse = [[ss / det, -ds / det], [-ds / det, dd / det]];
        }
        if det <= 1e-12 * dd * ss || rho_d < 0.0 || rho_s < 0.0 {
            // One bound is active: the better of the two single columns.
            let (d, s) = (only(dd, dy), only(ss, sy));
            if d * dy >= s * sy {
                (rho_d, rho_s) = (d, 0.0);
                inverse = [[if dd > 0.0 { 1.0 / dd } else { 0.0 }, 0.0], [0.0; 2]];
            } else {
                (rho_d, rho_s) = (0.0, s);
                inverse = [[0.0; 2], [0.0, 1.0 / ss]];
            }
        }
        Linear { rho_d, rho_s, inverse, chi2: (yy - rho_d * dy - rho_s * sy).max(0.0) }
    }

    /// Adds this channel to the projected normal matrix and gradient of (ln m, tilt, tilt_y).
    pub fn accumulate(&self, linear: &Linear, m: f64, normal: &mut [[f64; NONLINEAR]; NONLINEAR], gradient: &mut [f64; NONLINEAR]) {
        let cross = self.cross(linear, m);
        for k in 0..NONLINEAR {
            let zy = self.inner(k, Y, linear, m);
            gradient[k] += zy - linear.rho_d * cross[k][0] - linear.rho_s * cross[k][1];
            for l in 0..=k {
                let mut zz = self.zz(k, l, linear, m);
                for i in 0..2 {
                    for j in 0..2 {
                        zz -= cross[k][i] * linear.inverse[i][j] * cross[l][j];
                    }
                }
                normal[k][l] += zz;
                if l < k {
                    normal[l][k] += zz;
                }
            }
        }
    }

    /// ⟨z_k, D⟩ and ⟨z_k, S⟩, z_k the change of the model by nonlinear parameter k.
    pub fn cross(&self, linear: &Linear, m: f64) -> [[f64; 2]; NONLINEAR] {
        std::array::from_fn(|k| [self.inner(k, D, linear, m), self.inner(k, S, linear, m)])
    }

    fn inner(&self, k: usize, column: usize, linear: &Linear, m: f64) -> f64 {
        parts(k, linear, m).iter().map(|&(c, f)| f * self.0[c][column]).sum()
    }

    fn zz(&self, k: usize, l: usize, linear: &Linear, m: f64) -> f64 {
        let (a, b) = (parts(k, linear, m), parts(l, linear, m));
        a.iter().map(|&(i, f)| b.iter().map(|&(j, g)| f * g * self.0[i][j]).sum::<f64>()).sum()
    }
}

/// z_k as columns times factors.
fn parts(k: usize, linear: &Linear, m: f64) -> [(usize, f64); 2] {
    match k {
        0 => [(S_M, linear.rho_s * m), (D, 0.0)],
        1 => [(D_B, linear.rho_d), (S_B, linear.rho_s)],
        _ => [(D_Y, linear.rho_d), (S_Y, linear.rho_s)],
    }
}
