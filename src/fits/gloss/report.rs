//! Standard errors of a fitted texel from the full normal matrix, and the verdict: which parameters are not determined,
//! and what is wrong.

use super::covariance::{Matrix, covariance};
use super::projection::{ChannelProjection, NONLINEAR, S};
use super::texel::{Job, State, bounded};
use super::{
    AMBIGUOUS, GlossTexelFit, M_RANGE, NARROW, NOT_CONVERGED, NOT_EXPLAINED, TILT_LIMIT, UndeterminedSet, normal_of,
    normal_slopes,
};
use mesophyll_base::solvers::Termination;

/// Minima whose χ² differ by less than this (three standard deviations) cannot be told apart.
const RIVAL: f64 = 9.0;

impl Job<'_> {
    /// Reports a texel without gloss: ρd and the tilts come from the fit without gloss (diffuse light shows tilts,
    /// too). Faint gloss may be present all the same; the difference to the fit with gloss widens the errors.
    pub(super) fn report_matte(
        &mut self,
        full: State,
        (bare, termination): (State, Termination),
        counts: [usize; 3],
        parameters: usize,
        outliers: usize,
    ) -> GlossTexelFit {
        let mut fit = self.report(bare, termination, counts, true, parameters, outliers);
        for c in (0..3).filter(|&c| counts[c] > 0) {
            fit.rho_d_err[c] = fit.rho_d_err[c].hypot(bare.channels[c].rho_d - full.channels[c].rho_d);
        }
        for k in 0..self.tilts {
            fit.tilt_err[k] = fit.tilt_err[k].hypot(bare.p[1 + k] - full.p[1 + k]);
        }
        // A tilt t that no pass shows darkens a matte texel by cos t.
        let unseen = if self.tilts == 1 { self.fitter.unseen } else { 0.0 };
        for c in (0..3).filter(|&c| counts[c] > 0) {
            fit.rho_d_err[c] = fit.rho_d_err[c].hypot(fit.rho_d[c] * unseen * unseen);
        }
        fit.undetermined = UndeterminedSet::default();
        self.judge(&mut fit, counts, true);
        fit
    }

    /// Widens every error by the effect that a tilt out of the plane of travel may have on it. The effect grows with
    /// the square of the tilt. Twice the effect of one standard deviation is added, so that an interval of two standard
    /// errors holds 95 % of such texels.
    pub(super) fn unseen(&mut self, fit: &mut GlossTexelFit, best: &State, counts: [usize; 3]) {
        let tilt = self.fitter.unseen;
        if self.tilts != 1 || tilt <= 0.0 {
            return;
        }
        let mut moved = [0.0f64; 2];
        let mut moved_rho = [[0.0f64; 2]; 3];
        for away in [-tilt, tilt] {
            let start = self.evaluate([best.p[0], best.p[1], away]);
            let (there, _) = self.descend(start, 0.1, false);
            for k in 0..2 {
                moved[k] = moved[k].max((there.p[k] - best.p[k]).abs());
            }
            for (to, (a, b)) in moved_rho.iter_mut().zip(there.channels.iter().zip(&best.channels)) {
                to[0] = to[0].max((a.rho_d - b.rho_d).abs());
                to[1] = to[1].max((a.rho_s - b.rho_s).abs());
            }
        }
        fit.m_err = fit.m_err.hypot(2.0 * fit.m * moved[0]);
        fit.tilt_err[0] = fit.tilt_err[0].hypot(2.0 * moved[1]);
        for c in (0..3).filter(|&c| counts[c] > 0) {
            fit.rho_d_err[c] = fit.rho_d_err[c].hypot(2.0 * moved_rho[c][0]);
            fit.rho_s_err[c] = fit.rho_s_err[c].hypot(2.0 * moved_rho[c][1]);
        }
        let slopes = normal_slopes(fit.tilt);
        for (axis, error) in fit.normal_err.iter_mut().enumerate().filter(|(axis, _)| *axis != 1) {
            *error = error.hypot(slopes[0][axis] * 2.0 * moved[1]);
        }
        self.evaluate(best.p);
        let defect = fit.defect;
        self.judge(fit, counts, false);
        fit.defect = defect;
    }

    /// Marks the texel as ambiguous where another minimum fits as well at other parameters.
    pub(super) fn compare(&self, fit: &mut GlossTexelFit, best: &State, rivals: &[State]) {
        let apart = |r: &State| {
            let tilt = (0..self.tilts).any(|k| (r.p[1 + k] - best.p[1 + k]).abs() > 2.5 * fit.tilt_err[k]);
            tilt || (r.p[0].exp() - fit.m).abs() > 2.5 * fit.m_err
        };
        if fit.defect.is_none() && rivals.iter().any(|r| r.chi2 < best.chi2 + RIVAL && apart(r)) {
            fit.defect = Some(AMBIGUOUS);
        }
    }

    /// `counts`: how many readings each channel had before rejection. A channel without readings stays NaN.
    pub(super) fn report(
        &mut self,
        mut state: State,
        termination: Termination,
        counts: [usize; 3],
        matte: bool,
        parameters: usize,
        outliers: usize,
    ) -> GlossTexelFit {
        let count = 1 + self.tilts;
        if matte {
            // The error of ρs is computed at a slope that leaves usually have; the fitted slope means nothing here.
            let fitted = state;
            state = self.evaluate([0.3f64.ln(), state.p[1], state.p[2]]);
            for (c, old) in state.channels.iter_mut().zip(&fitted.channels) {
                (c.rho_d, c.rho_s) = (old.rho_d, 0.0);
            }
            self.slopes(&mut state);
            state.chi2 = fitted.chi2;
        } else {
            // The last step was taken linearly, so the sums still belong to the point before it, which is a fraction of
            // a standard error away.
            let (p, chi2, rho) = (state.p, state.chi2, state.channels.map(|c| [c.rho_d, c.rho_s]));
            self.slopes(&mut state);
            (state.p, state.chi2) = (p, chi2);
            for (c, [d, s]) in state.channels.iter_mut().zip(rho) {
                (c.rho_d, c.rho_s) = (d, s);
            }
        }
        let m = state.p[0].exp();
        let mut inverses = [[[0.0; 2]; 2]; 3];
        let (mut normal, mut gradient) = (Matrix::default(), [0.0; NONLINEAR]);
        for (c, inverse) in state.channels.iter().zip(&mut inverses) {
            // These are the errors of the problem without bounds: a ρ that lies at its bound has an error, too.
            let det = c.dd * c.ss - c.ds * c.ds;
            *inverse = if det > 1e-12 * c.dd * c.ss {
                [[c.ss / det, -c.ds / det], [-c.ds / det, c.dd / det]]
            } else {
                c.inverse
            };
            c.accumulate(inverse, &mut normal, &mut gradient);
        }
        let (cov, condition) = covariance(&normal, count, matte);
        let samples = counts.iter().sum::<usize>() - outliers;
        let mut fit = GlossTexelFit {
            m,
            tilt: [state.p[1], state.p[2]],
            normal: normal_of([state.p[1], state.p[2]]),
            chi2: state.chi2,
            samples,
            outliers,
            parameters,
            termination,
            condition,
            iterations: self.iterations,
            evaluations: self.evaluations,
            correlation: 0.0,
            defect: None,
            ..GlossTexelFit::refused("")
        };
        let levels = self.levels();
        fit.chi2 -= levels.as_ref().map_or(0.0, |levels| self.explained_by_dark(&state, levels));
        // Residuals that the stated noise cannot explain (χ² more than 5 of its standard deviations too large) widen
        // every error.
        let freedom = samples.saturating_sub(parameters).max(1) as f64;
        let inflate = if fit.chi2 > freedom + 5.0 * (2.0 * freedom).sqrt() { (fit.chi2 / freedom).sqrt() } else { 1.0 };
        let sd = |v: f64| if v.is_finite() { v.max(0.0).sqrt() * inflate } else { f64::INFINITY };
        fit.m_err = m * sd(cov[0][0]);
        fit.tilt_err = std::array::from_fn(|k| if k < self.tilts { sd(cov[1 + k][1 + k]) } else { f64::INFINITY });
        for c in (0..3).filter(|&c| counts[c] > 0) {
            let (channel, inverse) = (&state.channels[c], &inverses[c]);
            (fit.rho_d[c], fit.rho_s[c]) = (channel.rho_d, channel.rho_s);
            // cov ρ = G⁻¹ + (G⁻¹ Φᵀz) cov(p) (G⁻¹ Φᵀz)ᵀ, where G is the normal matrix of the columns Φ = (D, S).
            let pull: [[f64; 2]; NONLINEAR] = channel.zphi.map(|[zd, zs]| inverse.map(|row| row[0] * zd + row[1] * zs));
            let mut own = *inverse;
            for k in 0..count {
                for j in 0..count {
                    if cov[k][j].is_finite() {
                        for (a, row) in own.iter_mut().enumerate() {
                            for (b, v) in row.iter_mut().enumerate() {
                                *v += pull[k][a] * cov[k][j] * pull[j][b];
                            }
                        }
                    }
                }
            }
            if own[0][0] > 0.0 && own[1][1] > 0.0 {
                (fit.rho_d_err[c], fit.rho_s_err[c]) = (sd(own[0][0]), sd(own[1][1]));
                if channel.rho_s > 0.0 {
                    fit.correlation = fit.correlation.min(own[0][1] / (own[0][0] * own[1][1]).sqrt());
                }
            }
        }
        if let Some(levels) = levels {
            self.add_dark_error(&mut fit, &state, &cov, &inverses, levels);
        }
        let slopes = normal_slopes(fit.tilt);
        fit.normal_err = std::array::from_fn(|axis| {
            let part = |k: usize| if slopes[k][axis] == 0.0 { 0.0 } else { slopes[k][axis] * fit.tilt_err[k] };
            part(0).hypot(part(1))
        });
        self.judge(&mut fit, counts, matte);
        fit
    }

    /// Linear sums and solution of each channel for samples that are all one; `None` where the dark level has no error.
    fn levels(&self) -> Option<[ChannelProjection; 3]> {
        let ws = &*self.ws;
        let ones = vec![1.0; ws.y[0].len()];
        let known = self.noise.dark_error.iter().all(|e| *e <= 0.0);
        (!known).then(|| {
            std::array::from_fn(|c| ChannelProjection::solve(self.fitter.level, &ws.columns, &ones, &ws.w[c], false))
        })
    }

    /// How much of χ² an error of each channel's dark level explains: the largest decrease of χ² + (level/σ)² over all
    /// levels, σ being the standard error of the dark level. Without this every texel's χ² would contain the noise of
    /// its own dark frame.
    fn explained_by_dark(&self, state: &State, levels: &[ChannelProjection; 3]) -> f64 {
        let ws = &*self.ws;
        let of_channel = |c: usize| {
            let (sigma, channel, level) = (self.noise.dark_error[c], &state.channels[c], &levels[c]);
            let sum: f64 = ws.w[c].iter().zip(&ws.y[c]).map(|(w, y)| w * y).sum();
            let pull = sum - channel.rho_d * level.dy - channel.rho_s * level.sy;
            if sigma > 0.0 { pull * pull / (1.0 / (sigma * sigma) + level.chi2) } else { 0.0 }
        };
        (0..3).map(of_channel).sum()
    }

    /// Adds to every error the effect of an error of each channel's dark level: the response of the fit when one is
    /// added to all samples.
    fn add_dark_error(
        &self,
        fit: &mut GlossTexelFit,
        state: &State,
        cov: &Matrix,
        inverses: &[[[f64; 2]; 2]; 3],
        levels: [ChannelProjection; 3],
    ) {
        let (ws, level, count) = (&*self.ws, self.fitter.level, 1 + self.tilts);
        let ones = vec![1.0; ws.y[0].len()];
        let mut variance = [0.0; NONLINEAR];
        let mut linear = [[0.0; 2]; 3];
        for (c, (channel, mut level_sums)) in state.channels.iter().zip(levels).enumerate() {
            let sigma = self.noise.dark_error[c];
            let direct = inverses[c].map(|row| row[0] * level_sums.dy + row[1] * level_sums.sy);
            (level_sums.rho_d, level_sums.rho_s) = (channel.rho_d, channel.rho_s);
            level_sums.slopes(level, &ws.columns, &ones, &ws.w[c], state.p[0].exp(), self.tilts);
            let pull: [f64; NONLINEAR] = std::array::from_fn(|k| {
                level_sums.zy[k] - direct[0] * channel.zphi[k][0] - direct[1] * channel.zphi[k][1]
            });
            let moved: [f64; NONLINEAR] = std::array::from_fn(|k| {
                if k < count {
                    (0..count).filter(|&j| cov[k][j].is_finite()).map(|j| cov[k][j] * pull[j]).sum()
                } else {
                    0.0
                }
            });
            for k in 0..count {
                variance[k] += (sigma * moved[k]).powi(2);
            }
            for (other, (to, inverse)) in linear.iter_mut().zip(inverses).enumerate() {
                let zphi = &state.channels[other].zphi;
                for (a, row) in inverse.iter().enumerate() {
                    let follow: f64 = (0..count).map(|k| (row[0] * zphi[k][0] + row[1] * zphi[k][1]) * moved[k]).sum();
                    let shift = if other == c { direct[a] } else { 0.0 } - follow;
                    to[a] += (sigma * shift).powi(2);
                    if other == c && a == 0 {
                        fit.rho_d_by_dark[c] = sigma * shift;
                    }
                }
            }
        }
        fit.m_err = fit.m_err.hypot(fit.m * variance[0].sqrt());
        for k in 0..self.tilts {
            fit.tilt_err[k] = fit.tilt_err[k].hypot(variance[1 + k].sqrt());
        }
        for c in 0..3 {
            fit.rho_d_err[c] = fit.rho_d_err[c].hypot(linear[c][0].sqrt());
            fit.rho_s_err[c] = fit.rho_s_err[c].hypot(linear[c][1].sqrt());
        }
    }

    /// In a curved valley of χ², the curvature at the minimum makes errors look too small. So the tilt is moved away
    /// from the minimum while the other parameters follow. Where χ² rises less than a parabola would, every error grows
    /// by that factor.
    pub(super) fn profile(&mut self, fit: &mut GlossTexelFit, best: &State, counts: [usize; 3]) {
        let err = fit.tilt_err[0];
        if !(err > 0.0 && err < 0.5) {
            return;
        }
        let base = self.evaluate(best.p).chi2;
        let mut stretch = 1.0f64;
        for by in [-2.5 * err, 2.5 * err, -0.1, 0.1] {
            if by.abs() < 2.4 * err {
                continue;
            }
            let away = self.evaluate(bounded(&best.p, &[0.0, by, 0.0]));
            self.held = true;
            let (away, _) = self.descend(away, 0.1, false);
            self.held = false;
            let rise = (away.chi2 - base).max(0.25);
            // Beyond five standard deviations the errors need no widening.
            if rise < 25.0 {
                stretch = stretch.max(by.abs() / (err * rise.sqrt()));
            }
        }
        if stretch > 1.1 {
            fit.m_err *= stretch;
            for e in
                fit.tilt_err.iter_mut().chain(&mut fit.rho_d_err).chain(&mut fit.rho_s_err).chain(&mut fit.normal_err)
            {
                *e *= stretch;
            }
            self.evaluate(best.p);
            let defect = fit.defect;
            self.judge(fit, counts, false);
            fit.defect = defect;
        }
    }

    /// Names the parameters that are not determined, and the defect if there is one.
    fn judge(&self, fit: &mut GlossTexelFit, counts: [usize; 3], matte: bool) {
        let mut names = UndeterminedSet::default();
        let parallel = fit.correlation < -0.99;
        for c in (0..3).filter(|&c| counts[c] > 0) {
            if parallel || unsure(fit.rho_d_err[c], fit.rho_d[c]) {
                names.insert(UndeterminedSet::RHO_D[c]);
            }
            if parallel || unsure(fit.rho_s_err[c], fit.rho_s[c]) {
                names.insert(UndeterminedSet::RHO_S[c]);
            }
        }
        let at_bound = fit.m <= 1.0001 * M_RANGE[0] || fit.m >= 0.9999 * M_RANGE[1];
        let narrow = !matte && self.lobe_frames() < 2;
        if matte || at_bound || narrow || parallel || unsure(fit.m_err, fit.m) {
            names.insert(UndeterminedSet::M);
        }
        for (k, flag) in [UndeterminedSet::TILT, UndeterminedSet::TILT_Y].into_iter().enumerate().take(self.tilts) {
            let at_bound = fit.tilt[k].abs() >= TILT_LIMIT - 1e-9;
            if at_bound || unsure(fit.tilt_err[k], fit.tilt[k].abs().max(0.35)) {
                names.insert(flag);
            }
        }
        if matte {
            // There is no lobe, so no slope is reported.
            (fit.m, fit.m_err) = (f64::NAN, f64::INFINITY);
        }
        fit.undetermined = names;
        let freedom = fit.samples.saturating_sub(fit.parameters).max(1) as f64;
        fit.defect = if !fit.termination.converged() {
            Some(NOT_CONVERGED)
        } else if fit.chi2 > freedom + 8.0 * (2.0 * freedom).sqrt() {
            Some(NOT_EXPLAINED)
        } else if narrow {
            Some(NARROW)
        } else {
            None
        };
    }

    /// The largest number of readings in one pass that lie within the lobe's half maximum.
    fn lobe_frames(&self) -> usize {
        let count = |range: std::ops::Range<usize>| {
            let s = &self.ws.columns[S][range.clone()];
            let half = 0.5 * s.iter().copied().fold(0.0, f64::max);
            range.zip(s).filter(|(k, v)| **v >= half && self.ws.used.iter().any(|u| u[*k] > 0.0)).count()
        };
        self.frames().into_iter().map(count).max().unwrap_or(0)
    }
}

/// Whether one standard deviation exceeds a tenth of the value (or is not a number).
fn unsure(err: f64, value: f64) -> bool {
    !matches!(err.partial_cmp(&(0.1 * value)), Some(std::cmp::Ordering::Less | std::cmp::Ordering::Equal))
}
