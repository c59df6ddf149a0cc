//! Variable projection on inner products (Golub & Pereyra 1973, in Kaufman's approximation). In each channel ρd ≥ 0 and
//! ρs ≥ 0 are solved for exactly. The residuals that m and the tilts are fitted to are projected, so that they hold no
//! change that ρd and ρs could make.
//!
//! The loops run by index and use no closures, because only `#[inline(always)]` functions carry the vector intrinsics
//! into their caller.
//!
//! A trial point costs six weighted sums a channel, an accepted point nine to fifteen more. No Jacobian is stored.

#![allow(clippy::needless_range_loop)]

use mesophyll_base::dispatch_lanes;
use mesophyll_base::lanes::DoubleLanes;
use mesophyll_base::processor::InstructionSet;
use mesophyll_optics::tube::evaluator::COLUMNS;

/// Columns of a pass, as [`mesophyll_optics::tube::evaluator`] fills them: D for diffuse light, S for gloss, S_M =
/// ∂S/∂m.
pub const D: usize = 0;
pub const S: usize = 1;
pub const S_M: usize = 2;
/// Most nonlinear parameters: ln m, tilt, tilt_y.
pub const NONLINEAR: usize = 3;

/// Inner products and linear solution of one channel. Weights are 1/sd².
#[derive(Debug, Clone, Copy, Default)]
pub struct ChannelProjection {
    pub dd: f64,
    pub ds: f64,
    pub ss: f64,
    pub dy: f64,
    pub sy: f64,
    pub yy: f64,
    pub rho_d: f64,
    pub rho_s: f64,
    /// Inverse of the 2 × 2 normal matrix of the free columns (zero rows where a bound is active).
    pub inverse: [[f64; 2]; 2],
    /// Σ w r² at the solution.
    pub chi2: f64,
    /// ⟨z_k, z_l⟩, ⟨z_k, D⟩, ⟨z_k, S⟩, ⟨z_k, y⟩. Here z_k is the change of the model by nonlinear parameter k at fixed
    /// ρd and ρs.
    pub zz: [[f64; NONLINEAR]; NONLINEAR],
    pub zphi: [[f64; 2]; NONLINEAR],
    pub zy: [f64; NONLINEAR],
}

impl ChannelProjection {
    /// Inner products of D, S and the samples, followed by non-negative least squares. `matte` holds ρs at zero.
    pub fn solve(
        level: InstructionSet,
        columns: &[Vec<f64>; COLUMNS],
        y: &[f64],
        w: &[f64],
        matte: bool,
    ) -> ChannelProjection {
        let (d, s) = (&columns[D][..], &columns[S][..]);
        let sums = dispatch_lanes!(level, F64, linear_sums(d: &[f64], s: &[f64], y: &[f64], w: &[f64]) -> [f64; 6]);
        let mut c = ChannelProjection {
            dd: sums[0],
            ds: sums[1],
            ss: sums[2],
            dy: sums[3],
            sy: sums[4],
            yy: sums[5],
            ..ChannelProjection::default()
        };
        let det = c.dd * c.ss - c.ds * c.ds;
        let both = !matte && det > 1e-12 * c.dd * c.ss;
        if both {
            (c.rho_d, c.rho_s) = ((c.ss * c.dy - c.ds * c.sy) / det, (c.dd * c.sy - c.ds * c.dy) / det);
            c.inverse = [[c.ss / det, -c.ds / det], [-c.ds / det, c.dd / det]];
        }
        if !both || c.rho_d < 0.0 || c.rho_s < 0.0 {
            // One bound is active: the better of the two fits with a single column is taken.
            let only = |gg: f64, gy: f64| if gg > 0.0 { (gy / gg).max(0.0) } else { 0.0 };
            let (rd, rs) = (only(c.dd, c.dy), if matte { 0.0 } else { only(c.ss, c.sy) });
            if rd * c.dy >= rs * c.sy {
                (c.rho_d, c.rho_s) = (rd, 0.0);
                c.inverse = [[if c.dd > 0.0 { 1.0 / c.dd } else { 0.0 }, 0.0], [0.0; 2]];
            } else {
                (c.rho_d, c.rho_s) = (0.0, rs);
                c.inverse = [[0.0; 2], [0.0, 1.0 / c.ss]];
            }
        }
        c.chi2 = (c.yy - c.rho_d * c.dy - c.rho_s * c.sy).max(0.0);
        c
    }

    /// Inner products of the model's changes by ln m and by `tilts` tilts.
    pub fn slopes(
        &mut self,
        level: InstructionSet,
        columns: &[Vec<f64>; COLUMNS],
        y: &[f64],
        w: &[f64],
        m: f64,
        tilts: usize,
    ) {
        let factors = [self.rho_s * m, self.rho_d, self.rho_s];
        let sums = dispatch_lanes!(
            level, F64,
            slope_sums(columns: &[Vec<f64>; COLUMNS], y: &[f64], w: &[f64], factors: [f64; 3],
                tilts: usize) -> [[f64; 6]; NONLINEAR]
        );
        for k in 0..NONLINEAR {
            for l in 0..=k {
                self.zz[k][l] = sums[k][l];
                self.zz[l][k] = sums[k][l];
            }
            self.zphi[k] = [sums[k][3], sums[k][4]];
            self.zy[k] = sums[k][5];
        }
    }

    /// Adds this channel to the projected normal matrix and gradient. `inverse` is a matrix like
    /// [`ChannelProjection::inverse`].
    pub fn accumulate(
        &self,
        inverse: &[[f64; 2]; 2],
        normal: &mut [[f64; NONLINEAR]; NONLINEAR],
        gradient: &mut [f64; NONLINEAR],
    ) {
        for k in 0..NONLINEAR {
            let [zd, zs] = self.zphi[k];
            gradient[k] += self.zy[k] - self.rho_d * zd - self.rho_s * zs;
            let pull = [inverse[0][0] * zd + inverse[0][1] * zs, inverse[1][0] * zd + inverse[1][1] * zs];
            for l in 0..=k {
                let zz = self.zz[k][l] - pull[0] * self.zphi[l][0] - pull[1] * self.zphi[l][1];
                normal[k][l] += zz;
                if l < k {
                    normal[l][k] += zz;
                }
            }
        }
    }
}

#[inline(always)]
fn linear_sums<L: DoubleLanes>(d: &[f64], s: &[f64], y: &[f64], w: &[f64]) -> [f64; 6] {
    let mut g = [L::splat(0.0); 6];
    for k in (0..y.len()).step_by(L::N) {
        let (d, s, y, w) = (L::load(&d[k..]), L::load(&s[k..]), L::load(&y[k..]), L::load(&w[k..]));
        let (wd, ws, wy) = (w.mul(d), w.mul(s), w.mul(y));
        g[0] = wd.fma(d, g[0]);
        g[1] = wd.fma(s, g[1]);
        g[2] = ws.fma(s, g[2]);
        g[3] = wd.fma(y, g[3]);
        g[4] = ws.fma(y, g[4]);
        g[5] = wy.fma(y, g[5]);
    }
    [g[0].sum(), g[1].sum(), g[2].sum(), g[3].sum(), g[4].sum(), g[5].sum()]
}

/// Row k: ⟨z_k, z_0…z_2⟩ (lower triangle), ⟨z_k, D⟩, ⟨z_k, S⟩, ⟨z_k, y⟩.
#[inline(always)]
fn slope_sums<L: DoubleLanes>(
    columns: &[Vec<f64>; COLUMNS],
    y: &[f64],
    w: &[f64],
    factors: [f64; 3],
    tilts: usize,
) -> [[f64; 6]; NONLINEAR] {
    let (by_m, rho_d, rho_s) = (L::splat(factors[0]), L::splat(factors[1]), L::splat(factors[2]));
    let mut g = [[L::splat(0.0); 6]; NONLINEAR];
    for k in (0..y.len()).step_by(L::N) {
        let (d, s, y, w) = (L::load(&columns[D][k..]), L::load(&columns[S][k..]), L::load(&y[k..]), L::load(&w[k..]));
        let by_tilt = rho_d.mul(L::load(&columns[3][k..])).add(rho_s.mul(L::load(&columns[4][k..])));
        let mut z = [by_m.mul(L::load(&columns[S_M][k..])), by_tilt, L::splat(0.0)];
        if tilts > 1 {
            z[2] = rho_d.mul(L::load(&columns[5][k..])).add(rho_s.mul(L::load(&columns[6][k..])));
        }
        for i in 0..=tilts {
            let wz = w.mul(z[i]);
            for j in 0..=i {
                g[i][j] = wz.fma(z[j], g[i][j]);
            }
            g[i][3] = wz.fma(d, g[i][3]);
            g[i][4] = wz.fma(s, g[i][4]);
            g[i][5] = wz.fma(y, g[i][5]);
        }
    }
    let mut out = [[0.0; 6]; NONLINEAR];
    for i in 0..=tilts {
        for j in 0..6 {
            out[i][j] = g[i][j].sum();
        }
    }
    out
}

/// Sets the weights to 1/sd², where sd² = (relative·model)² + floor² and the model is ρd D + ρs S. Returns the largest
/// squared standardised residual.
#[allow(clippy::too_many_arguments)]
pub fn weigh(
    level: InstructionSet,
    columns: &[Vec<f64>; COLUMNS],
    rho: [f64; 2],
    noise: [f64; 3],
    y: &[f64],
    used: &[f64],
    w: &mut [f64],
) -> f64 {
    let (d, s) = (&columns[D][..], &columns[S][..]);
    dispatch_lanes!(level, F64, weigh_lanes(d: &[f64], s: &[f64], rho: [f64; 2], noise: [f64; 3], y: &[f64],
        used: &[f64], w: &mut [f64]) -> f64)
}

#[inline(always)]
fn weigh_lanes<L: DoubleLanes>(
    d: &[f64],
    s: &[f64],
    rho: [f64; 2],
    noise: [f64; 3],
    y: &[f64],
    used: &[f64],
    w: &mut [f64],
) -> f64 {
    let (rho_d, rho_s) = (L::splat(rho[0]), L::splat(rho[1]));
    let (relative2, dark, floor2) = (L::splat(noise[0] * noise[0]), L::splat(noise[1]), L::splat(noise[2] * noise[2]));
    let mut worst = [0.0; 8];
    let mut most = L::splat(0.0);
    for k in (0..y.len()).step_by(L::N) {
        let model = rho_d.mul(L::load(&d[k..])).add(rho_s.mul(L::load(&s[k..])));
        let signal = model.add(dark);
        let weight = L::load(&used[k..]).div(signal.mul(signal).fma(relative2, floor2));
        let r = L::load(&y[k..]).sub(model);
        most = most.max(r.mul(r).mul(weight));
        weight.store(&mut w[k..]);
    }
    most.store(&mut worst);
    worst.into_iter().fold(0.0, f64::max)
}

/// Sets the weights from the samples themselves; `noise` is what [`super::ReadingNoise::terms`] gives for each channel.
/// Also writes the sum of the channels and its variance (infinite where a channel has no reading).
pub fn weigh_by_samples(
    level: InstructionSet,
    noise: [[f64; 3]; 3],
    y: &[Vec<f64>; 3],
    used: &[Vec<f64>; 3],
    w: &mut [Vec<f64>; 3],
    sum: &mut [Vec<f64>; 2],
) {
    dispatch_lanes!(
        level, F64,
        sample_lanes(noise: [[f64; 3]; 3], y: &[Vec<f64>; 3], used: &[Vec<f64>; 3], w: &mut [Vec<f64>; 3],
            sum: &mut [Vec<f64>; 2])
    );
}

#[inline(always)]
fn sample_lanes<L: DoubleLanes>(
    noise: [[f64; 3]; 3],
    y: &[Vec<f64>; 3],
    used: &[Vec<f64>; 3],
    w: &mut [Vec<f64>; 3],
    sum: &mut [Vec<f64>; 2],
) {
    let terms =
        noise.map(|[relative, dark, floor]| [L::splat(relative * relative), L::splat(dark), L::splat(floor * floor)]);
    let absent: [bool; 3] = std::array::from_fn(|c| used[c].iter().all(|u| *u == 0.0));
    for k in (0..y[0].len()).step_by(L::N) {
        let (mut total, mut variance, mut whole) = (L::splat(0.0), L::splat(0.0), L::splat(1.0));
        for c in 0..3 {
            if absent[c] {
                continue;
            }
            let (v, u) = (L::load(&y[c][k..]), L::load(&used[c][k..]));
            let [relative2, dark, floor2] = terms[c];
            let signal = v.add(dark);
            let sd2 = signal.mul(signal).fma(relative2, floor2);
            u.div(sd2).store(&mut w[c][k..]);
            total = total.add(v);
            variance = variance.add(sd2);
            // A frame counts only where all its colours were read: otherwise the sum would mix the colours differently
            // from frame to frame.
            whole = whole.mul(u);
        }
        total.store(&mut sum[0][k..]);
        variance.div(whole).store(&mut sum[1][k..]);
    }
}
