//! A record as that of a branch that was pulled and let go: a damped oscillation, by least squares.
//!
//! ```text
//! u = e^(−γt/2) (a cos ω t + b sin ω t) + offset,      ω² = (2π f_h)² − γ²/4
//! ```
//!
//! solves ẍ + γ ẋ + (2π f_h)² x = 0. Channels share f_h and γ. Slow drift is a polynomial beside the offset, of the
//! degree that Schwarz's criterion asks for. The noise is estimated from the scatter where none is stated.

use super::spectra::{Periodograms, legendre, without_trend};
use super::{FEWEST, MotionPrior};
use mesophyll_base::fourier::Complex;
use mesophyll_base::solvers::adequacy::{self, Adequacy, ReadingOrder, SolutionResiduals};
use mesophyll_base::solvers::{ClosureProblem, Options, ResidualNoise, lm};
use mesophyll_base::statistics::{NORMAL_SCATTER, median_of};
use std::f64::consts::{PI, TAU};

/// Damping times length of the record, in units of 2, at which fits begin.
const STARTS: [f64; 7] = [0.1, 0.5, 1.5, 4.0, 10.0, 25.0, 60.0];
/// Highest degree of the polynomial of drift.
const DEGREE: usize = 5;
/// The release is where the deflection was last this share of its largest value.
const PULLED: f64 = 0.9;

/// A residual this many standard deviations off is wild, ...
const WILD: f64 = 7.0;
/// ... also among this many on each side.
const AROUND: usize = 5;
/// How often wild readings are taken out, and the most that are, as a share.
const ROUNDS: usize = 5;
const MANY: f64 = 0.02;

/// The best fit to a record.
#[derive(Debug, Clone)]
pub struct DecayFit {
    /// f_h (Hz) and γ (1/s).
    pub values: [f64; 2],
    /// Their standard errors, widened where the fit does not describe the record.
    pub errors: [f64; 2],
    /// Standard error of γ/f_h over γ/f_h, likewise.
    pub ratio_error: f64,
    /// Degree of the polynomial beside the oscillation; 0 is an offset.
    pub degree: usize,
    /// Readings before the release, which were left out.
    pub before: usize,
    /// Whether the readings follow the fit to within their noise.
    pub adequacy: Adequacy,
    /// What is left of the readings; NaN at gaps.
    pub residuals: Vec<Vec<f64>>,
    /// Readings that were used.
    pub readings: usize,
    /// Wild readings that were left out: channel and place.
    pub wild: Vec<(usize, usize)>,
}

/// Fits channels in which NaN is a gap, `step` (s) apart and written in steps of `resolution` (mm). The first part is
/// left out where the rest, from the release on, is described by the oscillation and the whole is not. An oscillation
/// that explains less than the share `least` of the movement is not looked at further.
///
/// # Errors
/// A sentence that says why there is no answer.
pub fn fit(
    channels: &[Vec<f64>],
    step: f64,
    known: &MotionPrior,
    resolution: f64,
    least: f64,
) -> Result<DecayFit, String> {
    let whole = oscillation(channels, step, known, resolution, least);
    if whole.as_ref().is_ok_and(|d| d.adequacy.describes()) {
        return whole;
    }
    let at = release(channels);
    if at > 0 {
        let rest: Vec<Vec<f64>> = channels.iter().map(|c| c[at..].to_vec()).collect();
        if let Ok(mut found) = oscillation(&rest, step, known, resolution, least)
            && found.adequacy.describes()
        {
            found.before = at;
            found.wild.iter_mut().for_each(|(_, k)| *k += at);
            return Ok(found);
        }
    }
    whole
}

/// The place from which the branch, held or moved before, swings freely, if it is not the beginning.
fn release(channels: &[Vec<f64>]) -> usize {
    let one = |c: &Vec<f64>| {
        let tail: Vec<f64> = c[3 * c.len() / 4..].iter().copied().filter(|v| !v.is_nan()).collect();
        let rest = tail.iter().sum::<f64>() / tail.len().max(1) as f64;
        let largest = c.iter().filter(|v| !v.is_nan()).map(|v| (v - rest).abs()).fold(0.0, f64::max);
        (largest, c.iter().rposition(|v| (v - rest).abs() >= PULLED * largest).unwrap_or(0))
    };
    let (_, at) = channels.iter().map(one).fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a });
    if at > channels[0].len() / 2 { 0 } else { at }
}

/// The readings that a fit uses, channel after channel.
struct Used<'a> {
    /// Channel, time (s), share of the record and reading of each.
    all: Vec<(usize, f64, f64, f64)>,
    channels: &'a [Vec<f64>],
    degree: usize,
}

impl Used<'_> {
    /// Linear coefficients of a channel: a, b and those of the polynomial.
    fn each(&self) -> usize {
        3 + self.degree
    }

    /// Values and slopes (by ln f_h and γ) of the two oscillations at a time.
    fn oscillations(p: &[f64], t: f64) -> [[f64; 3]; 2] {
        let (w0, gamma) = (TAU * p[0].exp(), p[1]);
        let w = (w0 * w0 - 0.25 * gamma * gamma).sqrt();
        let [by_f, by_gamma] = [w0 * w0 / w, -0.25 * gamma / w];
        let ((sin, cos), fade) = ((w * t).sin_cos(), (-0.5 * gamma * t).exp());
        [
            [fade * cos, -fade * sin * t * by_f, fade * (-0.5 * t * cos - sin * t * by_gamma)],
            [fade * sin, fade * cos * t * by_f, fade * (-0.5 * t * sin + cos * t * by_gamma)],
        ]
    }

    /// The linear coefficients that are best for ln f_h and γ, and Σ r² there.
    fn linear(&self, p: &[f64]) -> Option<(Vec<f64>, f64)> {
        let each = self.each();
        let (mut out, mut cost): (Vec<f64>, f64) = (Vec::new(), 0.0);
        for c in 0..self.channels.len() {
            let mut normal = nalgebra::DMatrix::zeros(each, each);
            let mut right = nalgebra::DVector::zeros(each);
            let mut squares = 0.0;
            for (_, t, x, u) in self.all.iter().filter(|r| r.0 == c) {
                let [a, b] = Self::oscillations(p, *t).map(|o| o[0]);
                let mut row = vec![a, b];
                row.extend(legendre(*x, self.degree));
                for i in 0..each {
                    for j in 0..=i {
                        normal[(i, j)] += row[i] * row[j];
                    }
                    right[i] += row[i] * u;
                }
                squares += u * u;
            }
            normal.fill_upper_triangle_with_lower_triangle();
            let found = normal.cholesky()?.solve(&right);
            cost += squares - found.dot(&right);
            out.extend(found.iter());
        }
        cost.is_finite().then_some((out, cost))
    }

    fn model(&self, p: &[f64], (c, t, x, _): (usize, f64, f64, f64)) -> f64 {
        let own = &p[2 + c * self.each()..][..self.each()];
        let [a, b] = Self::oscillations(p, t).map(|o| o[0]);
        own[0] * a + own[1] * b + legendre(x, self.degree).iter().zip(&own[2..]).map(|(l, k)| l * k).sum::<f64>()
    }

    /// ∂model/∂p, column by column, times `factor`.
    fn slopes(&self, p: &[f64], factor: f64, out: &mut [f64]) {
        let m = self.all.len();
        out.fill(0.0);
        for (i, (c, t, x, _)) in self.all.iter().enumerate() {
            let base = 2 + c * self.each();
            let [a, b] = Self::oscillations(p, *t);
            out[i] = factor * (p[base] * a[1] + p[base + 1] * b[1]);
            out[m + i] = factor * (p[base] * a[2] + p[base + 1] * b[2]);
            for (k, value) in [a[0], b[0]].into_iter().chain(legendre(*x, self.degree)).enumerate() {
                out[(base + k) * m + i] = factor * value;
            }
        }
    }
}

/// The fit without readings that are far off it while their neighbours are not.
fn oscillation(
    channels: &[Vec<f64>],
    step: f64,
    known: &MotionPrior,
    resolution: f64,
    least: f64,
) -> Result<DecayFit, String> {
    let mut left = channels.to_vec();
    let mut wild = Vec::new();
    let mut found = once(&left, step, known, resolution, least)?;
    for _ in 0..ROUNDS {
        let more: Vec<(usize, usize)> = (0..left.len())
            .flat_map(|c| wildest(&found.residuals[c], resolution).into_iter().map(move |k| (c, k)))
            .collect();
        if more.is_empty() || (wild.len() + more.len()) as f64 > MANY * found.readings as f64 {
            break;
        }
        for (c, k) in &more {
            left[*c][*k] = f64::NAN;
        }
        wild.extend(more);
        found = once(&left, step, known, resolution, least)?;
    }
    wild.sort_unstable();
    found.wild = wild;
    Ok(found)
}

/// Residuals that are far larger than all, and than those around them.
fn wildest(residuals: &[f64], resolution: f64) -> Vec<usize> {
    let middle = |range: std::ops::Range<usize>| {
        median_of(residuals[range].iter().filter(|r| !r.is_nan()).map(|r| r.abs())).unwrap_or(0.0)
    };
    let usual = (NORMAL_SCATTER * middle(0..residuals.len())).max(resolution);
    let wild = |k: &usize| {
        let around = middle(k.saturating_sub(AROUND)..(k + AROUND + 1).min(residuals.len()));
        residuals[*k].abs() > WILD * usual.max(NORMAL_SCATTER * around)
    };
    (0..residuals.len()).filter(wild).collect()
}

fn once(
    channels: &[Vec<f64>],
    step: f64,
    known: &MotionPrior,
    resolution: f64,
    least: f64,
) -> Result<DecayFit, String> {
    let n = channels.first().map_or(0, Vec::len);
    let one = |(c, readings): (usize, &Vec<f64>)| -> Vec<(usize, f64, f64, f64)> {
        let used = readings.iter().enumerate().filter(|(_, u)| !u.is_nan());
        used.map(|(k, u)| (c, k as f64 * step, (k as f64 + 0.5) / n as f64, *u)).collect()
    };
    let mut used = Used { all: channels.iter().enumerate().flat_map(one).collect(), channels, degree: 0 };
    let m = used.all.len();
    if m < FEWEST + 2 + channels.len() * (3 + DEGREE) {
        return Err(format!("{m} readings are too few for a free decay"));
    }
    let length = n as f64 * step;
    let mut best: Option<(f64, usize, lm::Fit)> = None;
    // Drift can hide the oscillation from the first guess, so it is taken out of that, too.
    let mut since = 0;
    for degree in 0..=DEGREE {
        used.degree = degree;
        let start = match &best {
            Some((_, _, fit)) if since == 0 => vec![fit.params[0], fit.params[1]],
            _ => match guess(&used, channels, step, known, length) {
                Some((_, share)) if share < least && degree == 0 => {
                    return Err(format!("a damped oscillation explains {:.0} % of the movement", 100.0 * share));
                }
                Some((start, _)) => start,
                None => continue,
            },
        };
        let Some((linear, _)) = used.linear(&start) else { continue };
        let start: Vec<f64> = start.into_iter().chain(linear).collect();
        let residuals = |p: &[f64], out: &mut [f64]| {
            for (out, r) in out.iter_mut().zip(&used.all) {
                *out = used.model(p, *r) - r.3;
            }
        };
        let problem = ClosureProblem::new(start.len(), m, residuals).with_jacobian(|p, out| used.slopes(p, 1.0, out));
        let mut lower = vec![f64::NEG_INFINITY; start.len()];
        lower[1] = 0.0;
        let fit = lm::minimize(&problem, &start, &Options { max_iterations: 60, lower, ..Options::default() });
        if !(fit.cost.is_finite() && fit.params.iter().all(|v| v.is_finite())) {
            continue;
        }
        // Rounding is a noise that no model goes below.
        let scatter = (2.0 * fit.cost / m as f64).max(resolution * resolution / 12.0).max(f64::MIN_POSITIVE);
        let schwarz = m as f64 * scatter.ln() + start.len() as f64 * (m as f64).ln();
        if best.as_ref().is_none_or(|(b, ..)| schwarz < *b) {
            best = Some((schwarz, degree, fit));
            since = 0;
        } else {
            since += 1;
        }
        if since == 2 {
            break;
        }
    }
    let Some((_, degree, fit)) = best else { return Err("no damped oscillation was found".into()) };
    used.degree = degree;
    let stated = known.noise > 0.0;
    let noise = if stated { known.noise } else { 1.0 };
    let mut jacobian = vec![0.0; m * fit.params.len()];
    used.slopes(&fit.params, 1.0 / noise, &mut jacobian);
    let left: Vec<f64> = used.all.iter().map(|r| (r.3 - used.model(&fit.params, *r)) / noise).collect();
    let mut runs = vec![Vec::new(); channels.len()];
    for (k, r) in used.all.iter().enumerate() {
        runs[r.0].push(k);
    }
    let kind = if stated { ResidualNoise::Known } else { ResidualNoise::Estimated };
    let adequacy = adequacy::judge(&SolutionResiduals {
        residuals: &left,
        jacobian: &jacobian,
        noise: kind,
        floor: 0.5 * resolution / noise,
        along: &[ReadingOrder { name: "time", runs }],
    });
    // Readings that agree better than they are written do not make the errors smaller than that.
    let scatter = (2.0 * fit.cost / (m - fit.params.len()) as f64).sqrt();
    let scale = if stated { noise } else { scatter.max(resolution / 12f64.sqrt()) };
    used.slopes(&fit.params, 1.0 / scale, &mut jacobian);
    let covariance = covariance(&jacobian, m, fit.params.len()).ok_or("the oscillation is not determined")?;
    let widening = adequacy.widening[0].max(adequacy.widening[1]);
    let [f, gamma] = [fit.params[0].exp(), fit.params[1]];
    let [vf, vg, both] = [covariance[0][0], covariance[1][1], covariance[0][1]];
    let ratio = vf + vg / (gamma * gamma) - 2.0 * both / gamma;
    let mut residuals: Vec<Vec<f64>> = channels.iter().map(|c| vec![f64::NAN; c.len()]).collect();
    for (r, left) in used.all.iter().zip(&left) {
        residuals[r.0][(r.1 / step).round() as usize] = left * noise;
    }
    Ok(DecayFit {
        values: [f, gamma],
        errors: [f * vf.sqrt() * widening, vg.sqrt() * widening],
        ratio_error: ratio.max(0.0).sqrt() * widening,
        degree,
        before: 0,
        adequacy,
        residuals,
        readings: m,
        wild: Vec::new(),
    })
}

/// (JᵀJ)⁻¹ of the first two parameters, by QR.
fn covariance(jacobian: &[f64], m: usize, n: usize) -> Option<[[f64; 2]; 2]> {
    let factor = nalgebra::DMatrix::from_column_slice(m, n, jacobian).qr().r();
    let inverse = factor.try_inverse()?;
    let entry = |i: usize, j: usize| (0..n).map(|k| inverse[(i, k)] * inverse[(j, k)]).sum::<f64>();
    let out = [[entry(0, 0), entry(0, 1)], [entry(1, 0), entry(1, 1)]];
    out.iter().flatten().all(|v| v.is_finite()).then_some(out)
}

/// ln f_h and γ to begin with: of oscillations around the largest lines of the periodogram, with several dampings, the
/// one that leaves least; and the share of the movement that it explains.
fn guess(used: &Used, channels: &[Vec<f64>], step: f64, known: &MotionPrior, length: f64) -> Option<(Vec<f64>, f64)> {
    let spectra = Periodograms::new(channels, step, 0.0, 0.0, used.degree.max(1));
    let resolution = spectra.resolution();
    let from = known.band[0].map_or(2, |f| (f / resolution) as usize).max(2);
    let to = known.band[1].map_or(spectra.top(), |f| (f / resolution) as usize).min(spectra.top());
    let mut peaks: Vec<usize> = Vec::new();
    for exponent in [0, 1, 2] {
        let size = |k: usize| (k as f64).powi(exponent) * spectra.powers.iter().map(|p| p[k]).sum::<f64>();
        peaks.extend((from..=to).max_by(|a, b| size(*a).total_cmp(&size(*b))));
    }
    peaks.sort_unstable();
    peaks.dedup();
    let flat: Vec<Vec<f64>> = channels.iter().map(|c| without_trend(c, used.degree.max(1))).collect();
    let mut best: Option<(f64, Vec<f64>)> = None;
    for peak in peaks {
        for quarter in -4..=4 {
            let f = (peak as f64 + 0.25 * f64::from(quarter)) * resolution;
            for damping in STARTS.map(|s| 2.0 * s / length) {
                let explained: f64 = flat.iter().map(|c| explained(c, TAU * f * step, 0.5 * damping * step)).sum();
                if best.as_ref().is_none_or(|(b, _)| explained > *b) {
                    // The line stands near the damped frequency.
                    best = Some((explained, vec![f.hypot(damping / (4.0 * PI)).ln(), damping]));
                }
            }
        }
    }
    let all: f64 = flat.iter().flatten().filter(|u| !u.is_nan()).map(|u| u * u).sum();
    best.map(|(explained, p)| (p, explained / all))
}

/// Sum of squares that oscillations of this angle and fading a step take out of readings.
fn explained(readings: &[f64], angle: f64, fading: f64) -> f64 {
    let turn = Complex::from_polar((-fading).exp(), angle);
    let mut z = Complex::new(1.0, 0.0);
    let [mut cc, mut cs, mut ss, mut cu, mut su] = [0.0; 5];
    for u in readings {
        if !u.is_nan() {
            cc += z.re * z.re;
            cs += z.re * z.im;
            ss += z.im * z.im;
            cu += z.re * u;
            su += z.im * u;
        }
        z *= turn;
    }
    let size = cc * ss - cs * cs;
    if size > 1e-9 * cc * ss { (cu * cu * ss - 2.0 * cu * su * cs + su * su * cc) / size } else { 0.0 }
}
