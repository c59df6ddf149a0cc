//! Whether the periodograms of a motion in gusts are described by their fit.

use super::MotionPrior;
use super::gusts::GustFit;
use super::whittle::ExpectedPeriodograms;
use mesophyll_base::solvers::ResidualNoise;
use mesophyll_base::solvers::adequacy::{self, ReadingOrder, SolutionResiduals};

/// Mean and standard deviation of 2(ρ − 1 − ln ρ) for an exponentially distributed ρ, which a periodogram over its mean
/// is.
const DEVIANCE: [f64; 2] = [1.154, 1.606];
/// A mean deviance that is this many standard errors too small, or too large, is no chance. It has a longer tail
/// towards large values.
pub const STRANGE: [f64; 2] = [3.0, 4.0];
/// Frequencies in the smallest parts of the band that are compared with the fitted spectrum.
const PART: usize = 8;
/// Neighbouring frequencies whose mean is one residual.
const GROUP: usize = 4;

impl GustFit {
    /// Whether and why the fit does not describe the periodograms, and by how much errors have to be widened.
    pub(super) fn judge(&mut self, known: &MotionPrior) {
        let expected = ExpectedPeriodograms::new(&self.spectra, known, self.band, self.drift);
        let whole = expected.whole(&self.found);
        let rho: Vec<f64> = expected.measured().iter().zip(&whole).map(|(i, e)| i / e).collect();
        let width = self.band.1 + 1 - self.band.0;
        let spread = self.spectra.inflation * (1.0 + expected.coherence(&self.found));
        let off = (self.deviance() - DEVIANCE[0]) / (DEVIANCE[1] * (spread / rho.len() as f64).sqrt());
        let deviance = format!("deviance {:.3}, expected {}", self.deviance(), DEVIANCE[0]);
        let groups = self.groups(&expected, &rho);
        let along = [ReadingOrder { name: "frequency", runs: groups.runs }];
        let (residuals, jacobian) = (&groups.residuals[..], &groups.jacobian[..]);
        let readings =
            SolutionResiduals { residuals, jacobian, noise: ResidualNoise::Known, floor: 0.0, along: &along };
        let adequacy = adequacy::judge(&readings);
        let (worst, place, parts) = self.worst(&rho, width);
        // Either sign of any of the parts would be a finding.
        let chance = adequacy::normal_quantile(adequacy::ACCUSED / (2 * parts).max(1) as f64);
        self.lack = if off > STRANGE[1] {
            Some(format!("the motion has another spectrum: {deviance}"))
        } else if off < -STRANGE[0] {
            Some(format!(
                "no motion in gusts is as even as this one: {deviance}; was the branch let go, or the record smoothed?"
            ))
        } else if worst > chance {
            Some(format!("the motion has another spectrum: {place}"))
        } else {
            adequacy.why("branch")
        };
        self.widening = adequacy.widening.iter().copied().fold(1.0, f64::max);
        if self.lack.is_some() {
            self.widening = self.widening.max((self.deviance() / DEVIANCE[0]).sqrt());
        }
    }

    /// The part of the band, of any width, that is furthest from what was fitted: by how many standard deviations, and
    /// which it is. Also returns how many parts there are.
    fn worst(&self, rho: &[f64], width: usize) -> (f64, String, usize) {
        let (mut worst, mut place, mut parts) = (0.0, String::new(), 0);
        let mut part = PART;
        while 2 * part <= width {
            for channel in rho.chunks(width) {
                for (k, of) in channel.windows(part).enumerate().step_by(part / 2) {
                    parts += 1;
                    let mean = of.iter().sum::<f64>() / part as f64;
                    let off = gamma_score(mean, part as f64 / self.spectra.inflation).abs();
                    if off > worst {
                        let (from, to) = (self.hertz(self.band.0 + k), self.hertz(self.band.0 + k + part - 1));
                        worst = off;
                        place = format!("from {from:.3} to {to:.3} Hz {mean:.2} times the power that was fitted");
                    }
                }
            }
            part *= 2;
        }
        (worst, place, parts)
    }

    /// Neighbouring frequencies together, as numbers that are normally distributed where the fit is right.
    fn groups(&self, expected: &ExpectedPeriodograms, rho: &[f64]) -> Groups {
        let width = self.band.1 + 1 - self.band.0;
        let each = GROUP as f64 / self.spectra.inflation;
        let columns = expected.derivatives(&self.found);
        let (mut residuals, mut starts, mut runs) = (Vec::new(), Vec::new(), Vec::new());
        for channel in 0..rho.len() / width {
            let mut run = Vec::new();
            for k in (0..width / GROUP).map(|g| channel * width + g * GROUP) {
                let mean = rho[k..k + GROUP].iter().sum::<f64>() / GROUP as f64;
                run.push(residuals.len());
                residuals.push(gamma_score(mean, each));
                starts.push((k, mean));
            }
            runs.push(run);
        }
        let slope = |column: &Vec<f64>, &(k, mean): &(usize, f64)| {
            let sum: f64 = (k..k + GROUP).map(|k| rho[k] * column[k]).sum::<f64>() / GROUP as f64;
            -(9.0 * each).sqrt() / 3.0 * mean.max(1e-30).powf(-2.0 / 3.0) * sum
        };
        let jacobian = columns.iter().flat_map(|c| starts.iter().map(move |s| slope(c, s))).collect();
        Groups { residuals, jacobian, runs }
    }
}

/// Residuals for the rule of lack of fit.
struct Groups {
    residuals: Vec<f64>,
    jacobian: Vec<f64>,
    runs: Vec<Vec<usize>>,
}

/// How many standard deviations the mean of `m` exponentially distributed numbers of mean 1 is off (E. B. Wilson & M.
/// M. Hilferty, PNAS 17 (1931), 684–688).
pub fn gamma_score(mean: f64, m: f64) -> f64 {
    (mean.cbrt() - 1.0 + 1.0 / (9.0 * m)) * (9.0 * m).sqrt()
}
