//! The fit of one texel: start from the bank, Levenberg–Marquardt on the projected problem, weights from the model, robust
//! rejection where the residuals ask for it, errors from the full normal matrix.
#![allow(clippy::needless_range_loop)] // small matrices read better by index

use super::project::{Gram, Linear, NONLINEAR, Y};
use super::start::{Bank, Start};
use super::traces::{Basis, COLUMNS, D, S};
use super::{Device, M_RANGE, Robust, TILT_LIMIT, TexelFit, Undetermined, normal_of, normal_slopes};
use crate::optics::tube::{Model, Precision, Travel};
use crate::solve::Termination;

/// Steps at most; a texel needs five to ten.
const ITERATIONS: usize = 60;
/// A predicted decrease of χ² below this ends the fit: the step is then below a few thousandths of a standard error.
const CONVERGED: f64 = 1e-5;
/// Templates tried where the best leads nowhere.
const STARTS: usize = 4;
/// A residual beyond this many standard deviations is an outlier (in 300 samples noise does so once in 500 texels).
const OUTLIER: f64 = 4.5;
/// ρs is taken for zero where leaving it out costs less χ² than this (four parameters, and the search over lobes).
const MATTE: f64 = 25.0;

/// Fits texels of one device; shared by threads.
pub struct TexelFitter {
    device: Device,
    model: Model,
    passes: Vec<Pass>,
    pub robust: Robust,
}

struct Pass {
    travel: Travel,
    positions: Vec<f64>,
    bank: Bank,
}

/// Scratch of one thread.
#[derive(Debug, Default)]
pub struct Workspace {
    basis: Basis,
    y: [Vec<f64>; 3],
    w: [Vec<f64>; 3],
    /// 1 for a reading in use, 0 for none or an outlier.
    used: [Vec<f64>; 3],
    sum: Vec<f64>,
    sum_w: Vec<f64>,
    starts: Vec<Start>,
}

/// Where the solver stands.
#[derive(Debug, Clone, Copy)]
struct State {
    /// ln m, tilt, tilt_y.
    p: [f64; NONLINEAR],
    linear: [Linear; 3],
    gram: [Gram; 3],
    chi2: f64,
}

impl TexelFitter {
    /// Tube positions along the travel (mm), a frame each, of pass x and, where there is one, pass y.
    pub fn new(device: &Device, pass_x_positions_mm: &[f64], pass_y_positions_mm: Option<&[f64]>) -> Self {
        Self::with_precision(device, pass_x_positions_mm, pass_y_positions_mm, &Precision::default())
    }

    /// The same with a stated quadrature.
    pub fn with_precision(device: &Device, x_mm: &[f64], y_mm: Option<&[f64]>, precision: &Precision) -> Self {
        let mut passes = vec![Pass { travel: Travel::X, positions: x_mm.to_vec(), bank: Bank::new(device, Travel::X, x_mm, [-0.35, 0.6]) }];
        if let Some(y) = y_mm {
            passes.push(Pass { travel: Travel::Y, positions: y.to_vec(), bank: Bank::new(device, Travel::Y, y, [-0.6, 0.6]) });
        }
        let model = Model::new(device.tube(), device.camera, device.lobe, precision);
        TexelFitter { device: device.clone(), model, passes, robust: Robust::default() }
    }

    pub fn workspace(&self) -> Workspace {
        Workspace::default()
    }

    /// Fits one texel at `texel_mm` on the blade; samples in frame order, NaN (or infinite) = no reading. A channel without a
    /// single reading stays out of the fit and is returned as NaN.
    pub fn fit(&self, ws: &mut Workspace, texel_mm: [f64; 2], trace_x: &[[f32; 3]], trace_y: Option<&[[f32; 3]]>) -> TexelFit {
        let given = [Some(trace_x), trace_y];
        let fits = self.passes.iter().enumerate().all(|(k, p)| given[k].is_none_or(|t| t.len() == p.positions.len()));
        if !fits || (trace_y.is_some() && self.passes.len() < 2) {
            return TexelFit::refused("the traces and the tube positions differ in length");
        }
        let passes: Vec<(&Pass, &[[f32; 3]])> = self.passes.iter().zip(given).filter_map(|(p, t)| t.map(|t| (p, t))).collect();
        ws.load(&passes);
        let mut job = Job {
            fitter: self,
            ws,
            texel: texel_mm,
            passes: passes.iter().map(|p| p.0).collect(),
            evaluations: 0,
            iterations: 0,
            matte: false,
        };
        job.run()
    }
}

impl Workspace {
    fn load(&mut self, passes: &[(&Pass, &[[f32; 3]])]) {
        let samples: usize = passes.iter().map(|p| p.1.len()).sum();
        self.basis.resize(samples);
        for c in 0..3 {
            for list in [&mut self.y[c], &mut self.w[c], &mut self.used[c]] {
                list.clear();
                list.resize(samples, 0.0);
            }
            let values = passes.iter().flat_map(|p| p.1.iter().map(|v| f64::from(v[c])));
            for (k, value) in values.enumerate() {
                if value.is_finite() {
                    self.y[c][k] = value;
                    self.used[c][k] = 1.0;
                }
            }
        }
    }
}

/// One texel being fitted.
struct Job<'a> {
    fitter: &'a TexelFitter,
    ws: &'a mut Workspace,
    texel: [f64; 2],
    passes: Vec<&'a Pass>,
    evaluations: usize,
    iterations: usize,
    /// ρs held at zero.
    matte: bool,
}

impl Job<'_> {
    fn run(&mut self) -> TexelFit {
        let used: usize = self.ws.used.iter().map(|u| u.iter().filter(|v| **v > 0.0).count()).sum();
        let channels: Vec<usize> = (0..3).filter(|&c| self.ws.used[c].iter().any(|v| *v > 0.0)).collect();
        if used == 0 {
            return TexelFit::refused("no readings");
        }
        let tilts = self.passes.len();
        let parameters = 2 * channels.len() + 1 + tilts;
        if used <= parameters || channels.iter().any(|&c| self.ws.used[c].iter().filter(|v| **v > 0.0).count() < 3) {
            return TexelFit::refused("too few readings");
        }
        if channels.iter().all(|&c| self.ws.y[c].iter().all(|y| *y <= 0.0)) {
            return TexelFit::refused("no light");
        }
        self.weigh_by_samples();
        let Some(start) = self.start(0) else { return TexelFit::refused("no template fits") };
        let (mut state, mut termination) = self.climb(start);
        // χ² that the noise makes unlikely (4 σ): another template may have been the right one.
        let freedom = (used - parameters) as f64;
        if !termination.converged() || state.chi2 > freedom + 4.0 * (2.0 * freedom).sqrt() {
            for rank in 1..STARTS {
                self.weigh_by_samples();
                let Some(start) = self.start(rank) else { break };
                let (other, reason) = self.climb(start);
                if reason.converged() >= termination.converged() && other.chi2 < state.chi2 {
                    (state, termination) = (other, reason);
                }
            }
            self.weigh_by_model(&state);
            state = self.evaluate(state.p);
        }
        let mut outliers = 0;
        if self.fitter.robust != Robust::Off {
            (state, termination, outliers) = self.reject(state, termination);
        }
        let mut matte = false;
        if self.gloss_chi2(&state) < 4.0 * MATTE {
            self.matte = true;
            let (bare, reason) = self.resolve(state, CONVERGED);
            if bare.chi2 - state.chi2 < MATTE {
                (state, termination, matte) = (bare, reason, true);
            }
            self.matte = false;
        }
        self.report(state, termination, &channels, matte, used - outliers, parameters, outliers)
    }

    /// Weights from the samples themselves: only good enough to start with.
    fn weigh_by_samples(&mut self) {
        let (relative, floor) = (self.fitter.device.noise_relative, self.floor());
        for c in 0..3 {
            for k in 0..self.ws.y[c].len() {
                let sd2 = (relative * self.ws.y[c][k]).powi(2) + floor * floor;
                self.ws.w[c][k] = self.ws.used[c][k] / sd2;
            }
        }
    }

    fn floor(&self) -> f64 {
        // Without any stated floor an exact zero would weigh infinitely.
        self.fitter.device.noise_floor.max(1e-6)
    }

    /// Weights from the fitted model: independent of the samples' own noise, so they do not bias.
    fn weigh_by_model(&mut self, state: &State) {
        let (relative, floor) = (self.fitter.device.noise_relative, self.floor());
        for c in 0..3 {
            let l = &state.linear[c];
            for k in 0..self.ws.y[c].len() {
                let value = l.rho_d * self.ws.basis.columns[D][k] + l.rho_s * self.ws.basis.columns[S][k];
                let sd2 = (relative * value).powi(2) + floor * floor;
                self.ws.w[c][k] = self.ws.used[c][k] / sd2;
            }
        }
    }

    /// Down from a start, first under weights from the samples, then from the model.
    fn climb(&mut self, start: [f64; NONLINEAR]) -> (State, Termination) {
        self.weigh_by_samples();
        let rough = self.solve(start, 1.0).0;
        self.weigh_by_model(&rough);
        self.resolve(rough, CONVERGED)
    }

    /// The start that the templates of the first pass rank `rank`th.
    fn start(&mut self, rank: usize) -> Option<[f64; NONLINEAR]> {
        let mut p = [0.3f64.ln(), 0.0, 0.0];
        let mut offset = 0;
        for (k, pass) in self.passes.iter().enumerate() {
            let ws = &mut *self.ws;
            ws.sum.clear();
            ws.sum_w.clear();
            for i in offset..offset + pass.positions.len() {
                let (mut y, mut w) = (0.0, 0.0);
                for c in 0..3 {
                    // A channel's weighted mean would mix colours where one reading is missing: use the frame only when all are there.
                    y += ws.y[c][i];
                    w += if ws.w[c][i] > 0.0 { 1.0 / ws.w[c][i] } else { 0.0 };
                }
                let whole = (0..3).all(|c| ws.used[c][i] > 0.0 || ws.used[c].iter().all(|u| *u == 0.0));
                ws.sum.push(y);
                ws.sum_w.push(if whole && w > 0.0 { 1.0 / w } else { 0.0 });
            }
            pass.bank.best(self.texel, &ws.sum, &ws.sum_w, STARTS, &mut ws.starts);
            let best = ws.starts.get(if k == 0 { rank } else { 0 })?;
            if k == 0 {
                p[0] = best.m.ln();
            }
            p[1 + k] = best.tilt;
            offset += pass.positions.len();
        }
        Some(p)
    }

    fn solve(&mut self, p: [f64; NONLINEAR], tolerance: f64) -> (State, Termination) {
        let state = self.evaluate(p);
        self.descend(state, tolerance)
    }

    /// From the same point under new weights: the basis is still right.
    fn resolve(&mut self, state: State, tolerance: f64) -> (State, Termination) {
        let state = self.evaluate(state.p);
        self.descend(state, tolerance)
    }

    fn evaluate(&mut self, p: [f64; NONLINEAR]) -> State {
        self.evaluations += 1;
        let mut offset = 0;
        for pass in &self.passes {
            self.ws.basis.fill(&self.fitter.model, pass.travel, &pass.positions, self.texel, p[0].exp(), [p[1], p[2]], offset);
            offset += pass.positions.len();
        }
        self.project(p)
    }

    fn project(&self, p: [f64; NONLINEAR]) -> State {
        let mut state = State { p, linear: [Linear::default(); 3], gram: [Gram::default(); 3], chi2: 0.0 };
        for c in 0..3 {
            let g = &mut state.gram[c].0;
            let (y, w) = (&self.ws.y[c], &self.ws.w[c]);
            for k in 0..y.len() {
                if w[k] == 0.0 {
                    continue;
                }
                let row: [f64; COLUMNS + 1] = std::array::from_fn(|j| if j == Y { y[k] } else { self.ws.basis.columns[j][k] });
                for i in 0..=COLUMNS {
                    let wi = w[k] * row[i];
                    for j in 0..=i {
                        g[i][j] += wi * row[j];
                    }
                }
            }
            for i in 0..=COLUMNS {
                for j in 0..i {
                    g[j][i] = g[i][j];
                }
            }
            if self.matte {
                for i in 0..=COLUMNS {
                    g[S][i] = 0.0;
                    g[i][S] = 0.0;
                }
            }
            state.linear[c] = state.gram[c].solve();
            state.chi2 += state.linear[c].chi2;
        }
        state
    }

    fn normal_matrix(state: &State) -> ([[f64; NONLINEAR]; NONLINEAR], [f64; NONLINEAR]) {
        let (mut normal, mut gradient) = ([[0.0; NONLINEAR]; NONLINEAR], [0.0; NONLINEAR]);
        for c in 0..3 {
            state.gram[c].accumulate(&state.linear[c], state.p[0].exp(), &mut normal, &mut gradient);
        }
        (normal, gradient)
    }

    /// Levenberg–Marquardt with Marquardt's scaling, until the predicted decrease of χ² is below `tolerance`.
    fn descend(&mut self, mut state: State, tolerance: f64) -> (State, Termination) {
        let count = 1 + self.passes.len();
        let mut lambda = 1e-3;
        if !state.chi2.is_finite() {
            return (state, Termination::NotFinite);
        }
        for _ in 0..ITERATIONS {
            self.iterations += 1;
            let (normal, gradient) = Self::normal_matrix(&state);
            let mut better = None;
            for _ in 0..12 {
                let Some((step, predicted)) = damped_step(&normal, &gradient, lambda, count) else {
                    return (state, Termination::NotFinite);
                };
                let trial = bounded(&state.p, &step);
                if predicted < tolerance && lambda < 1e-2 {
                    if trial == state.p {
                        return (state, Termination::CostConverged);
                    }
                    let last = self.evaluate(trial);
                    if last.chi2 <= state.chi2 {
                        state = last;
                    } else {
                        self.evaluate(state.p);
                    }
                    return (state, Termination::CostConverged);
                }
                if trial == state.p {
                    return (state, Termination::StepSmall);
                }
                let next = self.evaluate(trial);
                if next.chi2 < state.chi2 {
                    better = Some(next);
                    break;
                }
                lambda *= 10.0;
            }
            match better {
                Some(next) => {
                    let gain = state.chi2 - next.chi2;
                    state = next;
                    lambda = (lambda * 0.1).max(1e-9);
                    if gain < 1e-3 * tolerance {
                        return (state, Termination::CostConverged);
                    }
                }
                None => {
                    self.evaluate(state.p);
                    return (state, Termination::NoProgress);
                }
            }
        }
        (state, Termination::IterationLimit)
    }

    /// Standardised residual of sample `k` in channel `c` at the basis of the last evaluation.
    fn residual(&self, state: &State, c: usize, k: usize) -> f64 {
        let l = &state.linear[c];
        let value = l.rho_d * self.ws.basis.columns[D][k] + l.rho_s * self.ws.basis.columns[S][k];
        let sd2 = (self.fitter.device.noise_relative * value).powi(2) + self.floor().powi(2);
        (self.ws.y[c][k] - value) / sd2.sqrt()
    }

    /// Huber steps, then hard rejection beyond `OUTLIER` scales and a plain fit of the rest: clean data keep full efficiency.
    fn reject(&mut self, state: State, termination: Termination) -> (State, Termination, usize) {
        let readings: Vec<(usize, usize)> =
            (0..3).flat_map(|c| (0..self.ws.y[c].len()).map(move |k| (c, k))).filter(|&(c, k)| self.ws.used[c][k] > 0.0).collect();
        let worst = readings.iter().map(|&(c, k)| self.residual(&state, c, k).abs()).fold(0.0, f64::max);
        if worst <= OUTLIER && self.fitter.robust == Robust::Auto {
            return (state, termination, 0);
        }
        let (plain, reason) = (state, termination);
        let mut state = state;
        for _ in 0..8 {
            let scale = self.scale(&state, &readings);
            self.weigh_by_model(&state);
            for &(c, k) in &readings {
                let r = self.residual(&state, c, k).abs() / scale;
                self.ws.w[c][k] *= (1.345 / r).min(1.0);
            }
            state = self.resolve(state, 0.1).0;
        }
        let mut termination = termination;
        let mut outliers = 0;
        for _ in 0..4 {
            let scale = self.scale(&state, &readings);
            let gone: Vec<bool> = readings.iter().map(|&(c, k)| self.residual(&state, c, k).abs() > OUTLIER * scale).collect();
            let changed = readings.iter().zip(&gone).any(|(&(c, k), &g)| (self.ws.used[c][k] == 0.0) != g);
            outliers = gone.iter().filter(|g| **g).count();
            if outliers * 4 > readings.len() {
                // A quarter of the samples off is no accident: the model does not fit, and the plain fit says so in χ².
                for &(c, k) in &readings {
                    self.ws.used[c][k] = 1.0;
                }
                self.weigh_by_model(&plain);
                let (state, _) = self.resolve(plain, CONVERGED);
                return (state, reason, 0);
            }
            for (&(c, k), &g) in readings.iter().zip(&gone) {
                self.ws.used[c][k] = if g { 0.0 } else { 1.0 };
            }
            self.weigh_by_model(&state);
            (state, termination) = self.resolve(state, CONVERGED);
            if !changed {
                break;
            }
        }
        (state, termination, outliers)
    }

    /// Robust scale of the standardised residuals, at least 1.
    fn scale(&self, state: &State, readings: &[(usize, usize)]) -> f64 {
        let mut r: Vec<f64> = readings.iter().map(|&(c, k)| self.residual(state, c, k).abs()).collect();
        let middle = r.len() / 2;
        let (_, median, _) = r.select_nth_unstable_by(middle, f64::total_cmp);
        (1.4826 * *median).max(1.0)
    }

    /// What χ² would rise by if ρs were zero, the rest fixed but ρd.
    fn gloss_chi2(&self, state: &State) -> f64 {
        (0..3)
            .map(|c| {
                let (g, l) = (&state.gram[c].0, &state.linear[c]);
                let own = g[S][S] - if g[D][D] > 0.0 { g[D][S] * g[D][S] / g[D][D] } else { 0.0 };
                l.rho_s * l.rho_s * own
            })
            .sum()
    }

    #[allow(clippy::too_many_arguments)]
    fn report(
        &mut self,
        mut state: State,
        termination: Termination,
        channels: &[usize],
        matte: bool,
        samples: usize,
        parameters: usize,
        outliers: usize,
    ) -> TexelFit {
        let tilts = self.passes.len();
        if matte {
            // ρs's error is quoted at a leaf's usual slope; the fitted one means nothing.
            state.p[0] = 0.3f64.ln();
            let linear = state.linear;
            state = self.evaluate(state.p);
            for (l, old) in state.linear.iter_mut().zip(linear) {
                (l.rho_d, l.rho_s) = (old.rho_d, 0.0);
            }
            state.chi2 = linear.iter().map(|l| l.chi2).sum();
        }
        let m = state.p[0].exp();
        let mut free = [Linear::default(); 3];
        let (mut normal, mut gradient) = ([[0.0; NONLINEAR]; NONLINEAR], [0.0; NONLINEAR]);
        for &c in channels {
            // Errors are those of the unconstrained problem: a ρ at its bound still has one.
            free[c] = state.linear[c];
            let g = &state.gram[c].0;
            let det = g[D][D] * g[S][S] - g[D][S] * g[D][S];
            if det > 1e-12 * g[D][D] * g[S][S] {
                free[c].inverse = [[g[S][S] / det, -g[D][S] / det], [-g[D][S] / det, g[D][D] / det]];
            }
            state.gram[c].accumulate(&free[c], m, &mut normal, &mut gradient);
        }
        let (cov, condition) = covariance(&normal, 1 + tilts, matte);
        let mut fit = TexelFit::refused("");
        fit.defect = None;
        fit.m = m;
        fit.tilt = [state.p[1], state.p[2]];
        fit.normal = normal_of(fit.tilt);
        fit.chi2 = state.chi2;
        fit.samples = samples;
        fit.outliers = outliers;
        fit.parameters = parameters;
        fit.termination = termination;
        fit.condition = condition;
        fit.iterations = self.iterations;
        fit.evaluations = self.evaluations;
        // Residuals that the stated noise cannot explain (5 σ of χ²) widen every error.
        let freedom = samples.saturating_sub(parameters).max(1) as f64;
        let inflate = if fit.chi2 > freedom + 5.0 * (2.0 * freedom).sqrt() { (fit.chi2 / freedom).sqrt() } else { 1.0 };
        let sd = |v: f64| if v.is_finite() { v.max(0.0).sqrt() * inflate } else { f64::INFINITY };
        fit.m_err = m * sd(cov[0][0]);
        fit.tilt_err = std::array::from_fn(|k| if k < tilts { sd(cov[1 + k][1 + k]) } else { f64::INFINITY });
        fit.correlation = 0.0;
        for &c in channels {
            let l = &free[c];
            (fit.rho_d[c], fit.rho_s[c]) = (l.rho_d, l.rho_s);
            let cross = state.gram[c].cross(l, m);
            let pull: [[f64; 2]; NONLINEAR] =
                std::array::from_fn(|k| std::array::from_fn(|j| l.inverse[j][0] * cross[k][0] + l.inverse[j][1] * cross[k][1]));
            let mut own = l.inverse;
            for k in 0..NONLINEAR {
                for j in 0..NONLINEAR {
                    if cov[k][j].is_finite() {
                        for a in 0..2 {
                            for b in 0..2 {
                                own[a][b] += pull[k][a] * cov[k][j] * pull[j][b];
                            }
                        }
                    }
                }
            }
            let known = own[0][0] > 0.0 && own[1][1] > 0.0;
            (fit.rho_d_err[c], fit.rho_s_err[c]) = if known { (sd(own[0][0]), sd(own[1][1])) } else { (f64::INFINITY, f64::INFINITY) };
            if known && l.rho_s > 0.0 {
                fit.correlation = fit.correlation.min(own[0][1] / (own[0][0] * own[1][1]).sqrt());
            }
        }
        let slopes = normal_slopes(fit.tilt);
        fit.normal_err = std::array::from_fn(|axis| {
            (0..2).map(|k| if slopes[k][axis] == 0.0 { 0.0 } else { (slopes[k][axis] * fit.tilt_err[k]).powi(2) }).sum::<f64>().sqrt()
        });
        self.judge(&mut fit, channels, matte);
        fit
    }

    /// Names what is not determined, and what is wrong.
    fn judge(&self, fit: &mut TexelFit, channels: &[usize], matte: bool) {
        let mut names = Undetermined::default();
        let parallel = fit.correlation < -0.99;
        for &c in channels {
            if unsure(fit.rho_d_err[c], fit.rho_d[c]) || parallel {
                names.insert(Undetermined::RHO_D[c]);
            }
            if unsure(fit.rho_s_err[c], fit.rho_s[c]) || parallel {
                names.insert(Undetermined::RHO_S[c]);
            }
        }
        let at_bound = fit.m <= 1.0001 * M_RANGE[0] || fit.m >= 0.9999 * M_RANGE[1];
        let lit = self.lobe_frames();
        let narrow = !matte && lit < 2;
        if matte || at_bound || narrow || unsure(fit.m_err, fit.m) {
            names.insert(Undetermined::M);
        }
        for (k, flag) in [Undetermined::TILT, Undetermined::TILT_Y].into_iter().enumerate().take(self.passes.len()) {
            let at_bound = fit.tilt[k].abs() >= TILT_LIMIT - 1e-9;
            if at_bound || unsure(fit.tilt_err[k], fit.tilt[k].abs().max(0.35)) {
                names.insert(flag);
            }
        }
        if matte {
            // Never a guess: there is no lobe to have a slope.
            (fit.m, fit.m_err) = (f64::NAN, f64::INFINITY);
        }
        fit.undetermined = names;
        fit.defect = if !fit.termination.converged() {
            Some("not converged")
        } else if fit.reduced_chi2() > 1.0 + 8.0 * (2.0 / (fit.samples.saturating_sub(fit.parameters)).max(1) as f64).sqrt() {
            Some("residuals exceed the noise")
        } else if narrow {
            Some("lobe narrower than two frames")
        } else {
            None
        };
    }

    /// Most readings within the lobe's half maximum in any pass.
    fn lobe_frames(&self) -> usize {
        let mut offset = 0;
        let mut most = 0;
        for pass in &self.passes {
            let range = offset..offset + pass.positions.len();
            let s = &self.ws.basis.columns[S][range.clone()];
            let peak = s.iter().copied().fold(0.0, f64::max);
            most = most.max(range.zip(s).filter(|(k, v)| **v >= 0.5 * peak && self.ws.used.iter().any(|u| u[*k] > 0.0)).count());
            offset += pass.positions.len();
        }
        most
    }
}

/// Whether one standard deviation exceeds a tenth of the value (or is not a number).
fn unsure(err: f64, value: f64) -> bool {
    !matches!(err.partial_cmp(&(0.1 * value)), Some(std::cmp::Ordering::Less | std::cmp::Ordering::Equal))
}

/// Applies a step, kept short and within the bounds.
fn bounded(p: &[f64; NONLINEAR], step: &[f64; NONLINEAR]) -> [f64; NONLINEAR] {
    let shrink = [1.0 / step[0].abs().max(1.0), 0.3 / step[1].abs().max(0.3), 0.3 / step[2].abs().max(0.3)].into_iter().fold(1.0, f64::min);
    [
        (p[0] + shrink * step[0]).clamp(M_RANGE[0].ln(), M_RANGE[1].ln()),
        (p[1] + shrink * step[1]).clamp(-TILT_LIMIT, TILT_LIMIT),
        (p[2] + shrink * step[2]).clamp(-TILT_LIMIT, TILT_LIMIT),
    ]
}

/// Solves (N + λ diag N) δ = g over the first `count` parameters; the decrease of χ² that the linear model predicts.
fn damped_step(
    normal: &[[f64; NONLINEAR]; NONLINEAR],
    gradient: &[f64; NONLINEAR],
    lambda: f64,
    count: usize,
) -> Option<([f64; NONLINEAR], f64)> {
    let mut a = *normal;
    let mut step = [0.0; NONLINEAR];
    let mut live = [false; NONLINEAR];
    for k in 0..count {
        live[k] = normal[k][k] > 0.0;
        a[k][k] *= 1.0 + lambda;
    }
    // Cholesky of at most 3 × 3; a parameter without influence keeps its place.
    let mut l = [[0.0; NONLINEAR]; NONLINEAR];
    for i in 0..count {
        if !live[i] {
            continue;
        }
        for j in 0..=i {
            if !live[j] {
                continue;
            }
            let dot: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            if i == j {
                let d = a[i][i] - dot;
                if !d.is_finite() {
                    return None;
                }
                if d <= 1e-14 * a[i][i] {
                    live[i] = false;
                    l[i] = [0.0; NONLINEAR];
                } else {
                    l[i][i] = d.sqrt();
                }
            } else {
                l[i][j] = (a[i][j] - dot) / l[j][j];
            }
        }
    }
    let mut y = [0.0; NONLINEAR];
    for i in (0..count).filter(|&i| live[i]) {
        y[i] = (gradient[i] - (0..i).map(|k| l[i][k] * y[k]).sum::<f64>()) / l[i][i];
    }
    for i in (0..count).rev().filter(|&i| live[i]) {
        step[i] = (y[i] - (i + 1..count).map(|k| l[k][i] * step[k]).sum::<f64>()) / l[i][i];
    }
    // Decrease of χ² (not of half of it): 2 g·δ − δᵀNδ.
    let mut predicted = 0.0;
    for i in 0..count {
        predicted += 2.0 * gradient[i] * step[i];
        for j in 0..count {
            predicted -= step[i] * normal[i][j] * step[j];
        }
    }
    step.iter().all(|s| s.is_finite()).then_some((step, predicted))
}

/// Covariance of the nonlinear parameters and the condition number of the scaled matrix; unknown ones are infinite.
fn covariance(normal: &[[f64; NONLINEAR]; NONLINEAR], count: usize, matte: bool) -> ([[f64; NONLINEAR]; NONLINEAR], f64) {
    let mut cov = [[0.0; NONLINEAR]; NONLINEAR];
    let live: Vec<usize> = (0..count).filter(|&k| normal[k][k] > 0.0 && !(matte && k == 0)).collect();
    for k in 0..count {
        if !live.contains(&k) {
            cov[k][k] = f64::INFINITY;
        }
    }
    let n = live.len();
    let scale: Vec<f64> = live.iter().map(|&k| normal[k][k].sqrt()).collect();
    let scaled = nalgebra::DMatrix::from_fn(n, n, |i, j| normal[live[i]][live[j]] / (scale[i] * scale[j]));
    let eigen = scaled.clone().symmetric_eigen().eigenvalues;
    let (least, most) = (eigen.min(), eigen.max());
    let condition = if least > 0.0 { most / least } else { f64::INFINITY };
    match scaled.cholesky().filter(|_| least > 1e-13) {
        Some(factor) => {
            let inverse = factor.inverse();
            for i in 0..n {
                for j in 0..n {
                    cov[live[i]][live[j]] = inverse[(i, j)] / (scale[i] * scale[j]);
                }
            }
        }
        None => {
            for &k in &live {
                cov[k][k] = f64::INFINITY;
            }
        }
    }
    (cov, condition)
}

#[cfg(test)]
mod tests;
