//! A record as that of an oscillator in gusts: band, drift, and whether this describes it.

use super::adequacy::{STRANGE, gamma_score};
use super::spectra::Periodograms;
use super::whittle::{ExpectedPeriodograms, GustParameters};
use super::{FEWEST, MotionPrior};
use std::ops::RangeInclusive;

/// The band ends at this many times the resonance.
const WIDE: f64 = 2.0;
/// Shares of the critical damping that a fit starts from.
const STARTS: [f64; 3] = [0.15, 0.04, 0.5];
/// A mean deviance within these belongs to a motion with the fitted spectrum; 1.154 is expected.
const DESCRIBED: RangeInclusive<f64> = 0.9..=1.3;
/// Drift is looked for where its score is this many standard errors.
const SCORE: f64 = 3.5;
/// Drift is there where it raises the log-likelihood by this: odds of 400 to 1.
const DRIFT: f64 = 6.0;
/// How drift is taken out: the share of the record over which the ends are faded, ...
pub const TAPER: f64 = 0.2;
/// ... and the degree of the polynomial.
pub const DEGREE: usize = 3;
/// Frequencies with more drift than this share of the swaying are not used.
const DRIFTING: f64 = 0.3;
/// Where drift reaches up to this share of the resonance, it hides the swaying.
const HIDDEN: f64 = 0.7;
/// A resonance above half the sampling rate whose log-likelihood is less than this below that of the best fit (odds of
/// 400 to 1) explains the record as well.
const ALIAS: f64 = 6.0;

/// The best fit to a record.
#[derive(Debug, Clone)]
pub struct GustFit {
    /// The parameters.
    pub found: GustParameters,
    /// What they were fitted to.
    pub spectra: Periodograms,
    /// First and last frequency, in units of 1/T.
    pub band: (usize, usize),
    /// Log-likelihood below that of a periodogram that is its own mean.
    pub cost: f64,
    /// Whether drift was taken out.
    pub drift: bool,
    /// Why this does not describe the record, if so.
    pub lack: Option<String>,
    /// Factor on the standard errors, 1 where it describes the record.
    pub widening: f64,
}

impl GustFit {
    /// The mean periodogram that it was fitted with.
    pub fn expected(&self, known: &MotionPrior) -> ExpectedPeriodograms<'_> {
        ExpectedPeriodograms::new(&self.spectra, known, self.band, self.drift)
    }

    /// Mean of 2(ρ − 1 − ln ρ).
    pub fn deviance(&self) -> f64 {
        2.0 * self.cost / ((self.band.1 + 1 - self.band.0) * self.spectra.powers.len()) as f64
    }

    /// Minus the log-likelihood of the periodograms in the band.
    pub fn surprise(&self, known: &MotionPrior) -> f64 {
        let expected = self.expected(known);
        let whole = expected.whole(&self.found);
        expected.measured().iter().zip(&whole).map(|(i, e)| e.ln() + i / e).sum()
    }

    /// A frequency of the band (Hz).
    pub fn hertz(&self, k: usize) -> f64 {
        k as f64 * self.spectra.resolution()
    }

    /// A resonance (Hz) above half the sampling rate that explains the periodograms as well.
    pub fn alias(&self, known: &MotionPrior) -> Option<f64> {
        let rate = 1.0 / self.spectra.step;
        let expected = self.expected(known).aliased();
        let measured = expected.measured();
        let ratio = (self.found.damping() / (4.0 * std::f64::consts::PI * self.found.resonance())).min(0.9);
        let f = self.found.resonance();
        let resonances =
            [rate - f, rate + f, 0.55 * rate, 0.65 * rate, 0.8 * rate, 0.95 * rate, 1.1 * rate, 1.25 * rate];
        let inside = resonances.into_iter().filter(|f| (0.5 * rate..=1.5 * rate).contains(f));
        // The same damping in 1/s, the same share of the critical one, and a smaller one.
        let starts = inside.flat_map(|at| [ratio, ratio * f / at, 0.3 * ratio * f / at].map(|r| expected.start(at, r)));
        let mut ranked: Vec<(f64, GustParameters)> = starts
            .map(|start| {
                let whole = expected.whole(&start);
                let cost = measured.iter().zip(&whole).map(|(i, e)| i / e - 1.0 - (i / e).ln()).sum();
                (cost, start)
            })
            .filter(|(cost, _): &(f64, _)| cost.is_finite())
            .collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        let fits = ranked.iter().take(3).filter_map(|(_, start)| expected.fit(start));
        fits.filter(|(_, cost)| *cost < self.cost + ALIAS).map(|(p, _)| p.resonance()).next()
    }
}

/// Fits channels in which NaN is a gap.
///
/// # Errors
/// A sentence that says why there is no answer.
pub fn fit(channels: &[Vec<f64>], step: f64, known: &MotionPrior) -> Result<GustFit, String> {
    let plain = settle(Periodograms::new(channels, step, known.noise, 0.0, 0), known, None);
    if let Ok(found) = &plain
        && found.lack.is_none()
        && !drifts(found, known)
    {
        return plain;
    }
    let raw = Periodograms::new(channels, step, known.noise, 0.0, 0);
    match (without_drift(channels, step, known), plain) {
        (Ok(found), _) if has_drift(&found, &raw, known) => Ok(found),
        (Ok(found), Err(_)) if found.lack.is_none() => Ok(found),
        (_, plain) => plain,
    }
}

/// Whether the periodograms of a fit ask for drift.
fn drifts(found: &GustFit, known: &MotionPrior) -> bool {
    if found.expected(known).drift_score(&found.found) < SCORE {
        return false;
    }
    let drifting = ExpectedPeriodograms::new(&found.spectra, known, found.band, true);
    drifting.fit(&drifting.with_drift(&found.found)).is_some_and(|(_, cost)| cost < found.cost - DRIFT)
}

/// Whether the record moves more at the frequencies that were left out than the swaying does.
fn has_drift(found: &GustFit, raw: &Periodograms, known: &MotionPrior) -> bool {
    let low = known.band[0].map_or(1, |f| (f / raw.resolution()).ceil() as usize).max(1);
    if found.band.0 <= low {
        return false;
    }
    let expected = ExpectedPeriodograms::new(raw, known, (low, found.band.0 - 1), false);
    let swaying = GustParameters(found.found.0[..2 + raw.powers.len() + usize::from(known.speed.is_none())].to_vec());
    let whole = expected.whole(&swaying);
    let rho: Vec<f64> = expected.measured().iter().zip(&whole).map(|(i, e)| i / e).collect();
    gamma_score(rho.iter().sum::<f64>() / rho.len() as f64, rho.len() as f64) > STRANGE[1]
}

/// The fit with the ends faded, a polynomial taken out, drift in the spectrum, and only frequencies at which there is
/// little of it.
fn without_drift(channels: &[Vec<f64>], step: f64, known: &MotionPrior) -> Result<GustFit, String> {
    let spectra = Periodograms::new(channels, step, known.noise, TAPER, DEGREE);
    let mut low = DEGREE + 1;
    let mut found = settle(spectra, known, Some((low, None)))?;
    for _ in 0..10 {
        let share = found.expected(known).drift_share(&found.found);
        let mut next = low.max(found.band.0) + share.iter().take_while(|s| **s > DRIFTING).count();
        // Frequencies at the lower end that hold more than their share.
        let whole = found.expected(known).whole(&found.found);
        let rho: Vec<f64> = found.expected(known).measured().iter().zip(&whole).map(|(i, e)| i / e).collect();
        let width = found.band.1 + 1 - found.band.0;
        for part in [2, 4, 8, 16] {
            for channel in rho.chunks(width).filter(|c| c.len() > 2 * part) {
                let mean = channel[..part].iter().sum::<f64>() / part as f64;
                if gamma_score(mean, part as f64 / found.spectra.inflation) > STRANGE[1] {
                    next = next.max(found.band.0 + part);
                }
            }
        }
        if next <= found.band.0 {
            break;
        }
        low = next;
        if found.hertz(low) > HIDDEN * found.found.resonance() {
            let why = format!("drift hides the swaying: it is as large up to {:.3} Hz", found.hertz(low));
            found.lack.get_or_insert(why);
            return Ok(found);
        }
        let from = found.found.clone();
        found = settle(found.spectra, known, Some((low, Some(from))))?;
    }
    Ok(found)
}

/// Band and resonance depend on each other, so both are found in turn. `drift` is the first frequency of the band and,
/// where there is one, a fit to begin with, where drift is to be fitted.
fn settle(
    spectra: Periodograms,
    known: &MotionPrior,
    drift: Option<(usize, Option<GustParameters>)>,
) -> Result<GustFit, String> {
    let resolution = spectra.resolution();
    let top = spectra.top();
    let low =
        known.band[0].map_or(1, |f| (f / resolution).ceil() as usize).max(1).max(drift.as_ref().map_or(1, |d| d.0));
    let low = low.min(top + 1);
    if low + FEWEST > top {
        return Err(format!(
            "no {FEWEST} frequencies from {:.4} to {:.4} Hz: a longer record, or another band",
            low as f64 * resolution,
            top as f64 * resolution
        ));
    }
    let mut best: Option<GustFit> = None;
    let mut failed = None;
    let from = drift.as_ref().and_then(|d| d.1.as_ref());
    let guesses = match from {
        Some(from) => vec![from.resonance()],
        None => guesses(&spectra, low, drift.is_some()),
    };
    for guess in guesses {
        match around(&spectra, known, low, guess, from, drift.is_some()) {
            Ok(found) => {
                let described = found.lack.is_none();
                if best.as_ref().is_none_or(|b| described || found.deviance() < b.deviance()) {
                    best = Some(found);
                }
                if described {
                    break;
                }
            }
            Err(why) => failed = failed.or(Some(why)),
        }
    }
    best.ok_or_else(|| failed.unwrap_or_else(|| "the fit did not come to an end".into()))
}

/// The fit that begins with a resonance (Hz).
fn around(
    spectra: &Periodograms,
    known: &MotionPrior,
    low: usize,
    guess: f64,
    from: Option<&GustParameters>,
    drift: bool,
) -> Result<GustFit, String> {
    let resolution = spectra.resolution();
    let bin = |f: f64| ((f / resolution).floor() as usize).min(spectra.top());
    let mut high = known.band[1].map_or_else(|| bin(1.25 * WIDE * guess), bin);
    let mut best: Option<(GustParameters, f64)> = None;
    let mut band = (low, high);
    for _ in 0..6 {
        if high < low + FEWEST {
            return Err(format!(
                "{} frequencies from {:.4} to {:.4} Hz, expected {FEWEST} or more: a longer record, or another band",
                (high + 1).saturating_sub(low),
                low as f64 * resolution,
                high as f64 * resolution
            ));
        }
        band = (low, high);
        let expected = ExpectedPeriodograms::new(spectra, known, band, drift);
        best = match best.as_ref().map(|b| &b.0).or(from) {
            Some(found) => expected.fit(&expected.with_drift(found)),
            None => first(&expected, guess),
        };
        let Some((found, _)) = &best else { break };
        let next = if known.band[1].is_some() { high } else { bin(WIDE * found.resonance()) };
        if next.abs_diff(high) <= 1 + high / 200 {
            break;
        }
        high = next;
    }
    let Some((found, cost)) = best else { return Err("the fit did not come to an end".into()) };
    let mut out = GustFit { found, spectra: spectra.clone(), band, cost, drift, lack: None, widening: 1.0 };
    out.judge(known);
    Ok(out)
}

/// The best fit from several dampings. It stops at the first one that describes the motion.
fn first(expected: &ExpectedPeriodograms, resonance: f64) -> Option<(GustParameters, f64)> {
    let mut best: Option<(GustParameters, f64)> = None;
    for ratio in STARTS {
        let Some(found) = expected.fit(&expected.start(resonance, ratio)) else { continue };
        let described = DESCRIBED.contains(&(2.0 * found.1 / expected.bins() as f64));
        if best.as_ref().is_none_or(|b| found.1 < b.1) {
            best = Some(found);
        }
        if described {
            break;
        }
    }
    best
}

/// Resonances (Hz) to begin with: the root mean square frequencies of the deflection and of its speed, and the
/// frequency at which the speed is largest.
fn guesses(spectra: &Periodograms, low: usize, drift: bool) -> Vec<f64> {
    let mut out: Vec<f64> = [0, 2].iter().map(|e| middle(spectra, low, *e)).collect();
    let speed = |k: usize| (k * k) as f64 * spectra.powers.iter().map(|p| p[k]).sum::<f64>();
    let half = 2 + spectra.top() / 200;
    let around = |k: usize| (k.saturating_sub(half).max(low)..=(k + half).min(spectra.top())).map(speed).sum::<f64>();
    let peak = (low + half..=spectra.top()).step_by(half).max_by(|a, b| around(*a).total_cmp(&around(*b)));
    out.extend(peak.map(|k| k as f64));
    // Drift is slow, so the speed knows less of it.
    if drift {
        out.reverse();
    }
    // Nearly the same start leads to the same end.
    let all = out.clone();
    let new = |k: usize| all[..k].iter().all(|before: &f64| (all[k] / before).ln().abs() > 0.1);
    (0..all.len()).filter(|k| new(*k)).map(|k| all[k] * spectra.resolution()).collect()
}

/// Root mean square frequency of the motion, in units of 1/T, with the periodogram times this power of the frequency.
/// Frequencies far above it hold noise and are left out step by step.
fn middle(spectra: &Periodograms, low: usize, exponent: i32) -> f64 {
    let top = spectra.top();
    let mut high = top;
    let mut found = top as f64;
    for _ in 0..20 {
        let (mut sum, mut whole) = (0.0, 0.0);
        for p in &spectra.powers {
            for (k, value) in p.iter().enumerate().take(high + 1).skip(low) {
                let value = value * (k as f64).powi(exponent);
                sum += (k * k) as f64 * value;
                whole += value;
            }
        }
        found = if whole > 0.0 { f64::sqrt(sum / whole) } else { top as f64 };
        let next = ((2.5 * found) as usize).clamp((low + 4).min(top), top);
        if next >= high {
            break;
        }
        high = next;
    }
    found
}
