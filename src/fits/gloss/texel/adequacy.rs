//! Whether the lobe describes a trace of a table. Scans do not ask this of single texels: they compare whole passes
//! with frames that were held out.

use super::{GlossFitWorkspace, GlossTexelFitter, Job};
use crate::gloss::GlossTexelFit;
use mesophyll_base::solvers::adequacy::{self, Adequacy, ReadingOrder, SolutionResiduals};
use mesophyll_base::solvers::{ResidualNoise, Termination};
use mesophyll_optics::tube::evaluator::COLUMNS;

/// Root mean square of residuals (in standard deviations) below which they are the quadrature's error.
const FLOOR: f64 = 0.05;
/// Neighbours that agree by less than this (in standard deviations of noise) need no closer look.
const LOOK: f64 = 1.0;
/// Residuals beyond this are readings that the fit rejected.
const REJECTED: f64 = 4.5;

impl GlossTexelFitter {
    /// Judges a fit of [`GlossTexelFitter::fit`] with one pass: χ² against its spread, and the residuals along the
    /// travel. `None` where there is nothing to say: a refused fit, or residuals that look like noise at the first
    /// glance, which costs as little as one evaluation of the model.
    pub fn judge(&self, ws: &mut GlossFitWorkspace, trace: &[[f32; 3]], fit: &GlossTexelFit) -> Option<Adequacy> {
        if fit.termination == Termination::Refused {
            return None;
        }
        let mut job = Job {
            fitter: self,
            noise: self.device.noise(),
            ws,
            texel: [0.0; 2],
            tilts: 1,
            evaluations: 0,
            iterations: 0,
            matte: fit.m.is_nan(),
            earlier: None,
            held: false,
        };
        job.load([Some(trace), None]);
        // A texel without gloss has no slope; then the lobe's columns are not read.
        let slope = if job.matte { 0.3 } else { fit.m };
        job.evaluate([slope.ln(), fit.tilt[0], fit.tilt[1]]);
        let columns = job.ws.columns.each_ref().map(|c| &c[..]);
        let channels: Vec<usize> = (0..3).filter(|&c| fit.rho_d[c].is_finite()).collect();
        let seen = Seen { fit, columns, matte: job.matte, channels: &channels };
        let (mut residuals, mut rows, mut runs) = (Vec::new(), Vec::new(), Vec::new());
        for (place, &c) in channels.iter().enumerate() {
            let mut run = Vec::new();
            for k in (0..trace.len()).filter(|&k| job.ws.used[c][k] > 0.0) {
                let value = seen.value(c, k);
                let deviation = job.noise.variance(c, value).sqrt();
                let r = (job.ws.y[c][k] - value) / deviation;
                if fit.outliers > 0 && r.abs() > REJECTED {
                    continue;
                }
                run.push(residuals.len());
                residuals.push(r);
                rows.push((place, k, deviation));
            }
            runs.push(run);
        }
        let count = residuals.len() as f64;
        let pairs = runs.iter().flat_map(|run: &Vec<usize>| run.windows(2));
        let along: f64 = pairs.map(|p| residuals[p[0]] * residuals[p[1]]).sum();
        let square: f64 = residuals.iter().map(|r| r * r).sum();
        let agree = along / (square / count).max(1e-12) / count.sqrt();
        let excess = adequacy::chi2_score(square, (count - fit.parameters as f64).max(1.0));
        if agree < LOOK && excess < LOOK {
            return None;
        }
        let jacobian = seen.jacobian(&rows);
        let along = [ReadingOrder { name: "travel", runs }];
        Some(adequacy::judge(&SolutionResiduals {
            residuals: &residuals,
            jacobian: &jacobian,
            noise: ResidualNoise::Known,
            floor: FLOOR,
            along: &along,
        }))
    }
}

/// A fit with the columns of its model.
struct Seen<'a> {
    fit: &'a GlossTexelFit,
    columns: [&'a [f64]; COLUMNS],
    matte: bool,
    channels: &'a [usize],
}

impl Seen<'_> {
    fn value(&self, c: usize, k: usize) -> f64 {
        let gloss = if self.matte { 0.0 } else { self.fit.rho_s[c] * self.columns[1][k] };
        self.fit.rho_d[c] * self.columns[0][k] + gloss
    }

    /// ∂residual/∂(ρd, ρs of each channel, m, tilt), column by column; `rows` are place of the channel, frame and
    /// standard deviation of each residual.
    fn jacobian(&self, rows: &[(usize, usize, f64)]) -> Vec<f64> {
        let n = self.channels.len();
        let linear = |of: usize, place: usize| {
            rows.iter().map(move |&(at, k, sd)| if at == place { -self.columns[of][k] / sd } else { 0.0 })
        };
        let both = |d: Option<usize>, s: usize| {
            rows.iter().map(move |&(at, k, sd)| {
                let c = self.channels[at];
                let diffuse = d.map_or(0.0, |d| self.fit.rho_d[c] * self.columns[d][k]);
                let gloss = if self.matte { 0.0 } else { self.fit.rho_s[c] * self.columns[s][k] };
                -(diffuse + gloss) / sd
            })
        };
        let mut out: Vec<f64> = (0..n).flat_map(|place| linear(0, place)).collect();
        out.extend((0..n).flat_map(|place| linear(1, place)));
        out.extend(both(None, 2));
        out.extend(both(Some(3), 4));
        out
    }
}

impl GlossTexelFit {
    /// Takes a judgement into account: where the lobe does not describe the trace, errors are widened and the reason is
    /// returned.
    pub fn doubted(&mut self, found: &Adequacy) -> Option<String> {
        let why = found.why("trace")?;
        // Part of it was done for a χ² that is too large.
        let freedom = self.samples.saturating_sub(self.parameters).max(1) as f64;
        let done = if self.chi2 > freedom + 5.0 * (2.0 * freedom).sqrt() { (self.chi2 / freedom).sqrt() } else { 1.0 };
        let mut factors = found.widening.iter().map(|w| (w / done).max(1.0));
        let read: Vec<usize> = (0..3).filter(|&c| self.rho_d[c].is_finite()).collect();
        for (list, of) in [(&mut self.rho_d_err, &read), (&mut self.rho_s_err, &read)] {
            of.iter().for_each(|&c| list[c] *= factors.next().unwrap_or(1.0));
        }
        self.m_err *= factors.next().unwrap_or(1.0);
        self.tilt_err[0] *= factors.next().unwrap_or(1.0);
        Some(why)
    }
}
