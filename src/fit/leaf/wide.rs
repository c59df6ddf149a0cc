//! The leaf-wide problem: one σa and σs a channel for the whole leaf, a thickness h + δ and albedo factors γ a texel.
//!
//! Minimise Σ over texels and channels of (ρt − T(σ, h + δ))²/variance with the gauges mean(h + δ) = h and mean γ = 1 a channel,
//! where γ = ρd / R(σ, h + δ) exactly. δ is eliminated texel by texel (the Schur complement of an arrow-shaped normal matrix is
//! what remains for ln σ), γ in closed form, so each iteration solves six unknowns under four constraints, however many texels
//! there are. Wang et al. 2005 solve every texel and average instead (`paper.rs`).

use crate::fit::leaf::curve::{Curve, Incidence};
use crate::solve::{Termination, Trace, TraceRow};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use rayon::prelude::*;
use std::time::Instant;

type V6 = SVector<f64, 6>;
type M6 = SMatrix<f64, 6, 6>;

/// Texels a work unit: fixed, so that sums do not depend on the number of threads.
const UNIT: usize = 4096;

/// What the texels say, good ones only.
#[derive(Debug, Clone, Copy)]
pub struct Texel {
    pub rho_d: [f64; 3],
    pub rho_d_err: [f64; 3],
    pub rho_t: [f64; 3],
}

/// Noise of a measured transmittance: variance = (relative·T)² + floor².
#[derive(Debug, Clone, Copy)]
pub struct Noise {
    pub relative: f64,
    pub floor: [f64; 3],
}

/// Thickness and albedo factors of one texel.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Local {
    /// h + δ (mm)
    pub thickness: f64,
    pub thickness_err: f64,
    pub gamma: [f64; 3],
    pub gamma_err: [f64; 3],
    /// χ² of the transmittance (three channels, one unknown).
    pub chi2: f64,
    /// 1 for a texel that the fit believes, less for one it weighs down.
    pub weight: f64,
}

/// The fitted leaf.
#[derive(Debug, Clone)]
pub struct Wide {
    pub sigma_a: [f64; 3],
    pub sigma_s: [f64; 3],
    /// Covariance of (ln σa, ln σs) a channel: r_a, r_s, g_a, g_s, b_a, b_s. Statistical only; an error of h adds.
    pub covariance: M6,
    pub locals: Vec<Local>,
    pub termination: Termination,
    pub trace: Trace,
    pub condition: f64,
    pub rank: usize,
    pub curves: [Curve; 3],
    /// What is left of the gauges: mean thickness − h (mm) and mean γ − 1.
    pub gauge: [f64; 4],
}

/// Settings of [`fit`].
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    pub h: f64,
    pub incidence: Incidence,
    pub noise: Noise,
    /// Weigh down texels whose transmittance no thickness explains.
    pub robust: bool,
    pub iterations: usize,
}

/// Sums over texels for one Gauss–Newton step.
#[derive(Clone)]
struct Sums {
    cost: f64,
    hessian: M6,
    gradient: V6,
    gauge: [f64; 4],
    jacobian: SMatrix<f64, 4, 6>,
    /// Covariance of the gauges' own noise (sums of squares).
    gauge_noise: SMatrix<f64, 4, 4>,
}

impl Sums {
    fn zero() -> Self {
        Sums {
            cost: 0.0,
            hessian: M6::zeros(),
            gradient: V6::zeros(),
            gauge: [0.0; 4],
            jacobian: SMatrix::zeros(),
            gauge_noise: SMatrix::zeros(),
        }
    }
    fn add(mut self, o: &Sums) -> Self {
        self.cost += o.cost;
        self.hessian += o.hessian;
        self.gradient += o.gradient;
        for k in 0..4 {
            self.gauge[k] += o.gauge[k];
        }
        self.jacobian += o.jacobian;
        self.gauge_noise += o.gauge_noise;
        self
    }
}

/// Fits the leaf-wide problem from `start` = (σa, σs) a channel. `texels` must not be empty.
pub fn fit(texels: &[Texel], start: [[f64; 2]; 3], settings: &Settings) -> Wide {
    let clock = Instant::now();
    let mut p = V6::from_fn(|k, _| start[k / 2][k % 2].max(1e-6).ln());
    let mut ln_t = vec![f64::NAN; texels.len()];
    let mut trace: Trace = Vec::new();
    let mut termination = Termination::IterationLimit;
    let n = texels.len() as f64;
    let mut damping = 0.0;
    let (mut curves, mut sums, mut locals) = evaluate(texels, &p, &mut ln_t, settings);
    let mut evaluations = 1;
    for iteration in 0..settings.iterations {
        let gauge = [sums.gauge[0] / n - settings.h, sums.gauge[1] / n - 1.0, sums.gauge[2] / n - 1.0, sums.gauge[3] / n - 1.0];
        let step = constrained_step(&sums, &gauge, n, damping);
        let limited = step * (0.7 / step.amax().max(0.7));
        let distance = gauge[0].abs() / settings.h + gauge[1].abs() + gauge[2].abs() + gauge[3].abs();
        trace.push(TraceRow {
            iteration,
            evaluations,
            elapsed_s: clock.elapsed().as_secs_f64(),
            cost: sums.cost,
            gradient: distance,
            step: limited.amax(),
            truth_error: None,
        });
        if !step.iter().all(|v| v.is_finite()) || !sums.cost.is_finite() {
            termination = Termination::NotFinite;
            break;
        }
        if limited.amax() < 1e-9 {
            termination = Termination::StepSmall;
            break;
        }
        // Accept a step that brings the gauges or the cost closer; otherwise damp the free directions and try again.
        let merit = |s: &Sums| {
            let g = [s.gauge[0] / n / settings.h - 1.0, s.gauge[1] / n - 1.0, s.gauge[2] / n - 1.0, s.gauge[3] / n - 1.0];
            s.cost / n + 1e3 * g.iter().map(|v| v.abs()).sum::<f64>()
        };
        let before = merit(&sums);
        let mut accepted = false;
        let mut scale = 1.0;
        for _ in 0..8 {
            let trial = p + limited * scale;
            let mut trial_t = ln_t.clone();
            let (c, s, l) = evaluate(texels, &trial, &mut trial_t, settings);
            evaluations += 1;
            let after = merit(&s);
            if after.is_finite() && after <= before * (1.0 + 1e-9) + 1e-12 {
                (p, ln_t, curves, sums, locals) = (trial, trial_t, c, s, l);
                accepted = true;
                break;
            }
            scale *= 0.4;
        }
        if accepted {
            damping *= 0.2;
        } else if limited.amax() < 1e-6 {
            termination = Termination::CostConverged;
            break;
        } else if damping > 1e6 {
            termination = Termination::NoProgress;
            break;
        } else {
            damping = if damping == 0.0 { 1e-3 } else { damping * 10.0 };
        }
    }
    let (covariance, condition, rank) = covariance(&sums, n);
    let gauge = [sums.gauge[0] / n - settings.h, sums.gauge[1] / n - 1.0, sums.gauge[2] / n - 1.0, sums.gauge[3] / n - 1.0];
    Wide {
        sigma_a: [0, 1, 2].map(|c: usize| p[2 * c].exp()),
        sigma_s: [0, 1, 2].map(|c: usize| p[2 * c + 1].exp()),
        covariance,
        locals,
        termination,
        trace,
        condition,
        rank,
        curves,
        gauge,
    }
}

/// Eliminates thickness and γ of every texel at σ = exp(p) and sums what the step needs.
fn evaluate(texels: &[Texel], p: &V6, ln_t: &mut [f64], settings: &Settings) -> ([Curve; 3], Sums, Vec<Local>) {
    let curves: Vec<Curve> =
        (0..3usize).into_par_iter().map(|c| Curve::new(p[2 * c].exp(), p[2 * c + 1].exp(), settings.h, settings.incidence)).collect();
    let curves: [Curve; 3] = [curves[0].clone(), curves[1].clone(), curves[2].clone()];
    let parts: Vec<(Sums, Vec<Local>)> = texels
        .par_chunks(UNIT)
        .zip(ln_t.par_chunks_mut(UNIT))
        .map(|(texels, ln_t)| {
            let mut sums = Sums::zero();
            let locals = texels.iter().zip(ln_t).map(|(x, t)| eliminate(x, t, &curves, settings, &mut sums)).collect();
            (sums, locals)
        })
        .collect();
    let mut locals = Vec::with_capacity(texels.len());
    let mut total = Sums::zero();
    for (sums, part) in parts {
        total = total.add(&sums);
        locals.extend(part);
    }
    (curves, total, locals)
}

/// Thickness that explains three transmittances best, by Gauss–Newton in ln t from the last one (or a scan).
pub fn solve_thickness(rho_t: &[f64; 3], start: f64, curves: &[Curve; 3], noise: &Noise, h: f64) -> f64 {
    let [lo, hi] = curves[0].range().map(f64::ln);
    let cost = |t: f64| {
        (0..3)
            .map(|c| {
                let v = curves[c].at(t).ln_rho_t.exp();
                (rho_t[c] - v).powi(2) / ((noise.relative * v).powi(2) + noise.floor[c].powi(2))
            })
            .sum::<f64>()
    };
    let mut t = start;
    if t.is_nan() {
        // T falls with thickness in every channel: a coarse scan finds the basin.
        let scan = (0..=32).map(|k| lo + (hi - lo) * f64::from(k) / 32.0);
        t = scan.map(|t| (t, cost(t))).fold((h.ln(), f64::INFINITY), |a, b| if b.1 < a.1 { b } else { a }).0;
    }
    for _ in 0..30 {
        let (mut a, mut b) = (0.0, 0.0);
        for c in 0..3 {
            let q = curves[c].at(t);
            let v = q.ln_rho_t.exp();
            let w = 1.0 / ((noise.relative * v).powi(2) + noise.floor[c].powi(2));
            let slope = v * q.d_rho_t;
            a += w * slope * slope;
            b += w * slope * (rho_t[c] - v);
        }
        let step = (b / a.max(f64::MIN_POSITIVE)).clamp(-0.5, 0.5);
        let next = (t + step).clamp(lo, hi);
        let moved = (next - t).abs();
        t = next;
        if moved < 1e-13 {
            break;
        }
    }
    t
}

fn eliminate(x: &Texel, ln_t: &mut f64, curves: &[Curve; 3], settings: &Settings, sums: &mut Sums) -> Local {
    let noise = &settings.noise;
    *ln_t = solve_thickness(&x.rho_t, *ln_t, curves, noise, settings.h);
    let points = [0, 1, 2].map(|c: usize| curves[c].at(*ln_t));
    let (mut residual, mut slope, mut weight) = ([0.0; 3], [0.0; 3], [0.0; 3]);
    let (mut information, mut bend, mut chi2) = (0.0, 0.0, 0.0);
    for c in 0..3 {
        let v = points[c].ln_rho_t.exp();
        residual[c] = x.rho_t[c] - v;
        slope[c] = v * points[c].d_rho_t;
        weight[c] = 1.0 / ((noise.relative * v).powi(2) + noise.floor[c].powi(2));
        information += weight[c] * slope[c] * slope[c];
        bend += weight[c] * slope[c] * v * (points[c].dd_rho_t + points[c].d_rho_t.powi(2));
        chi2 += weight[c] * residual[c] * residual[c];
    }
    let information = information.max(f64::MIN_POSITIVE);
    let variance = 1.0 / information;
    // Two degrees of freedom: three transmittances less one thickness. Huber's weight beyond about 3.5 standard deviations.
    let trust = if settings.robust && chi2 > 12.0 { (12.0 / chi2).sqrt() } else { 1.0 };
    // d ln t / d p with the thickness re-solved
    let mut dt = V6::zeros();
    for c in 0..3 {
        let v = points[c].ln_rho_t.exp();
        for k in 0..2 {
            dt[2 * c + k] = -weight[c] * slope[c] * v * points[c].p_rho_t[k] * variance;
        }
    }
    for c in 0..3 {
        // row of the projected Jacobian: dT_c/dp with t following
        let v = points[c].ln_rho_t.exp();
        let mut row = dt * slope[c];
        for k in 0..2 {
            row[2 * c + k] += v * points[c].p_rho_t[k];
        }
        sums.hessian += row * row.transpose() * (weight[c] * trust);
        sums.gradient += row * (weight[c] * trust * residual[c]);
    }
    sums.cost += 0.5 * chi2 * trust.max(1e-12);
    // Second-order bias of the least-squares thickness (Box 1971): noise would otherwise shift the mean of 10⁵ texels visibly.
    let bias = -0.5 * variance * variance * bend;
    let usable = if variance.is_finite() && variance < 0.25 { 1.0 } else { 0.0 };
    let t = ln_t.exp();
    let mut local = Local { thickness: t, thickness_err: t * variance.sqrt(), chi2, weight: trust * usable, ..Local::default() };
    sums.gauge[0] += t * (1.0 - usable * (bias + 0.5 * variance));
    let mut noise_row = SMatrix::<f64, 4, 6>::zeros();
    for k in 0..6 {
        sums.jacobian[(0, k)] += t * dt[k];
    }
    for c in 0..3 {
        let (r, q) = (points[c].ln_rho_d.exp(), &points[c]);
        let gamma = x.rho_d[c] / r;
        // γ is convex in ln t: E[γ̂] = γ (1 − R′·bias + (R′² − R″)/2·variance), R″ of ln R being negligible.
        let curvature = 0.5 * q.d_rho_d * q.d_rho_d * variance;
        sums.gauge[1 + c] += gamma * (1.0 - usable * (curvature - q.d_rho_d * bias));
        for k in 0..6 {
            let own = if k / 2 == c { q.p_rho_d[k % 2] } else { 0.0 };
            sums.jacobian[(1 + c, k)] -= gamma * (own + q.d_rho_d * dt[k]);
        }
        local.gamma[c] = gamma;
        local.gamma_err[c] = ((x.rho_d_err[c] / r).powi(2) + (gamma * q.d_rho_d).powi(2) * variance).sqrt();
        noise_row[(1 + c, c)] = x.rho_d_err[c] / r;
    }
    // Noise of the gauges: three independent ρd and the thickness (from ρt) they share.
    let shared = SVector::<f64, 4>::from_fn(|k, _| if k == 0 { t } else { -local.gamma[k - 1] * points[k - 1].d_rho_d });
    sums.gauge_noise += shared * shared.transpose() * variance;
    for c in 0..3 {
        sums.gauge_noise[(1 + c, 1 + c)] += noise_row[(1 + c, c)].powi(2);
    }
    local
}

/// Gauss–Newton step under the linearised gauges: a particular solution plus the best move in their null space.
fn constrained_step(sums: &Sums, gauge: &[f64; 4], n: f64, damping: f64) -> V6 {
    let (particular, null) = split(&(sums.jacobian / n), gauge);
    let reduced = null.transpose() * sums.hessian * &null;
    let right = null.transpose() * (sums.gradient - sums.hessian * particular);
    let size = reduced.nrows();
    let scale = reduced.trace().max(f64::MIN_POSITIVE) / size.max(1) as f64;
    let damped = &reduced + DMatrix::identity(size, size) * (scale * (damping + 1e-12));
    let free = damped.svd(true, true).solve(&right, 1e-14 * scale).unwrap_or_else(|_| DVector::zeros(size));
    particular + V6::from_iterator((null * free).iter().copied())
}

/// Minimum-norm solution of C·dp = −gauge, and an orthonormal basis of C's null space (6 × (6 − rank)).
fn split(c: &SMatrix<f64, 4, 6>, gauge: &[f64; 4]) -> (V6, DMatrix<f64>) {
    // Pad to 6×6 so that the SVD yields a full right basis.
    let mut padded = DMatrix::<f64>::zeros(6, 6);
    padded.view_mut((0, 0), (4, 6)).copy_from(c);
    let svd = padded.svd(true, true);
    let (Some(u), Some(vt)) = (&svd.u, &svd.v_t) else { return (V6::zeros(), DMatrix::zeros(6, 0)) };
    let cut = svd.singular_values.max() * 1e-10;
    let mut particular = V6::zeros();
    let mut free = Vec::new();
    for k in 0..6 {
        let row: V6 = V6::from_iterator(vt.row(k).iter().copied());
        if svd.singular_values[k] > cut {
            let along: f64 = (0..4).map(|i| u[(i, k)] * -gauge[i]).sum();
            particular += row * (along / svd.singular_values[k]);
        } else {
            free.push(DVector::from_column_slice(row.as_slice()));
        }
    }
    let null = if free.is_empty() { DMatrix::zeros(6, 0) } else { DMatrix::from_columns(&free) };
    (particular, null)
}

/// Covariance of p: noise of the gauges carried through the constraints, plus noise of the shape in the free directions.
fn covariance(sums: &Sums, n: f64) -> (M6, f64, usize) {
    let c = sums.jacobian / n;
    let (_, null) = split(&c, &[0.0; 4]);
    let size = null.ncols();
    let reduced = null.transpose() * sums.hessian * &null;
    let svd = reduced.clone().svd(true, true);
    let largest = svd.singular_values.iter().copied().fold(0.0, f64::max);
    let smallest = svd.singular_values.iter().copied().fold(f64::INFINITY, f64::min);
    let rank = 6 - size + svd.singular_values.iter().filter(|&&s| s > largest * 1e-12).count();
    let condition = if size == 0 { 1.0 } else { (largest / smallest).sqrt() };
    let inverse = reduced.pseudo_inverse(largest * 1e-14).unwrap_or_else(|_| DMatrix::zeros(size, size));
    let shape = &null * &inverse * null.transpose();
    // dp = P·(−gauge noise) + shape·(…): P maps gauge noise to p with the free directions re-optimised.
    let mut carry = SMatrix::<f64, 6, 4>::zeros();
    for k in 0..4 {
        let mut unit = [0.0; 4];
        unit[k] = -1.0;
        let (particular, _) = split(&c, &unit);
        let free = &shape * (sums.hessian * particular);
        for i in 0..6 {
            carry[(i, k)] = particular[i] - free[i];
        }
    }
    let gauge = carry * (sums.gauge_noise / (n * n)) * carry.transpose();
    let mut total = gauge;
    for i in 0..6 {
        for j in 0..6 {
            total[(i, j)] += shape[(i, j)];
        }
    }
    (total, condition, rank)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::slab;

    /// A leaf of known σ with thickness and albedo that vary, and noise where asked.
    pub fn leaf(n: usize, noise: f64, seed: u64) -> (Vec<Texel>, [[f64; 2]; 3], Vec<f64>, f64) {
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_pcg::Pcg64::seed_from_u64(seed);
        let sigma = [[9.0, 18.0], [2.6, 16.0], [22.0, 21.0]];
        let t: Vec<f64> = (0..n).map(|k| 0.2 * (1.0 + 0.35 * (k as f64 * 0.7).sin())).collect();
        let h = t.iter().sum::<f64>() / n as f64;
        let mut gamma: Vec<[f64; 3]> = (0..n).map(|k| [0, 1, 2].map(|c| 1.0 + 0.2 * (k as f64 * (0.3 + f64::from(c))).cos())).collect();
        for c in 0..3 {
            let mean = gamma.iter().map(|g| g[c]).sum::<f64>() / n as f64;
            gamma.iter_mut().for_each(|g| g[c] /= mean);
        }
        let mut normal = || {
            let (a, b): (f64, f64) = (rng.random(), rng.random());
            (-2.0 * a.max(1e-300).ln()).sqrt() * (std::f64::consts::TAU * b).cos()
        };
        let texels = (0..n)
            .map(|k| {
                let mut x = Texel { rho_d: [0.0; 3], rho_d_err: [0.0; 3], rho_t: [0.0; 3] };
                for c in 0..3 {
                    let r = slab::exact::response(sigma[c][0], sigma[c][1], t[k]);
                    let d = gamma[k][c] * r.rho_d;
                    x.rho_d_err[c] = (noise * d).max(1e-9);
                    x.rho_d[c] = d + noise * d * normal();
                    x.rho_t[c] = r.rho_t + (noise * r.rho_t) * normal();
                }
                x
            })
            .collect();
        (texels, sigma, t, h)
    }

    fn settings(h: f64, noise: f64) -> Settings {
        Settings {
            h,
            incidence: Incidence(1.0),
            noise: Noise { relative: noise.max(1e-6), floor: [1e-9; 3] },
            robust: true,
            iterations: 60,
        }
    }

    #[test]
    fn noise_free_leaves_are_recovered() {
        let (texels, sigma, t, h) = leaf(3000, 0.0, 1);
        let wide = fit(&texels, [[6.0, 12.0], [4.0, 12.0], [15.0, 30.0]], &settings(h, 0.0));
        assert!(wide.termination.converged(), "{:?} {:#?}", wide.termination, wide.trace);
        for c in 0..3 {
            assert!((wide.sigma_a[c] / sigma[c][0] - 1.0).abs() < 2e-4, "{:?} {:?}", wide.sigma_a, sigma);
            assert!((wide.sigma_s[c] / sigma[c][1] - 1.0).abs() < 2e-4, "{:?} {:?}", wide.sigma_s, sigma);
        }
        for (l, t) in wide.locals.iter().zip(&t) {
            assert!((l.thickness / t - 1.0).abs() < 5e-4);
        }
    }

    #[test]
    fn errors_cover_the_truth() {
        let (mut inside, mut total, mut delta_inside, mut delta_total) = (0, 0, 0, 0);
        for seed in 0..24 {
            let (texels, sigma, t, h) = leaf(600, 0.02, 100 + seed);
            let wide = fit(&texels, [[6.0, 12.0], [4.0, 12.0], [15.0, 30.0]], &settings(h, 0.02));
            for c in 0..3 {
                for k in 0..2 {
                    let found = if k == 0 { wide.sigma_a[c] } else { wide.sigma_s[c] };
                    let sd = wide.covariance[(2 * c + k, 2 * c + k)].sqrt();
                    total += 1;
                    inside += usize::from((found / sigma[c][k]).ln().abs() < 1.96 * sd);
                }
            }
            for (l, t) in wide.locals.iter().zip(&t) {
                delta_total += 1;
                delta_inside += usize::from((l.thickness - t).abs() < 1.96 * l.thickness_err);
            }
        }
        let share = inside as f64 / total as f64;
        assert!((0.88..=1.0).contains(&share), "{inside} of {total}");
        let share = delta_inside as f64 / delta_total as f64;
        assert!((0.93..=0.97).contains(&share), "{delta_inside} of {delta_total}");
    }
}
