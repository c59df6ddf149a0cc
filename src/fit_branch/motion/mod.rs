//! How a branch sways: resonance, damping and gain from its measured deflections, by Whittle's likelihood.
//!
//! The tip is an oscillator in gusts: its deflection has the one-sided power density
//!
//! ```text
//! S(f) = G² R(f)² (1 + f/v)^(−5/3),      R(f) = 2π f_h² / √((2π(f_h² − f²))² + (f γ)²)
//! ```
//!
//! (H9 Eq. 4.15 and 4.16, with the denominator that the equation of motion gives; [`mesophyll_plant::wind`]). f_h is
//! the resonance (Hz), γ the damping (1/s), v the wind's mean speed (m/s; the f/v of Eq. 4.15 means f · 1 m/v), and G
//! the gain: √S at low frequencies (mm/√Hz). v is also fitted where it is not given.
//!
//! The estimate is that of P. Whittle, "Estimation and information in stationary time series", Ark. Mat. 2 (1953),
//! 423–434. The periodogram I_k at each frequency is about exponentially distributed around its mean E_k, so Σ ln E_k +
//! I_k/E_k is minimised. E_k is not S(f_k), because a record of finite length and step leaks and folds. It is computed
//! from the autocovariance (A. M. Sykulski et al., "The debiased Whittle likelihood", Biometrika 106 (2019), 251–266).
//! With ρ = I/E, the sum is written as squares of residuals ±√(2(ρ − 1 − ln ρ)), so that the certified solver can
//! minimise it. Standard errors come from Fisher's information Σ ∂ln E ∂ln E.

pub mod read;
#[cfg(test)]
mod tests;
pub mod whittle;

use mesophyll_error::Status;
use mesophyll_fourier::Complex;
use whittle::{Expected, Parameters};

/// Readings at even times.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Record {
    /// Time between readings (s).
    pub step: f64,
    /// Deflections (mm) in one direction or in two.
    pub channels: Vec<Vec<f64>>,
}

/// What is known beforehand.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Known {
    /// Mean speed of the wind (m/s); fitted where it is not given.
    pub speed: Option<f64>,
    /// Standard deviation of the wind's speed over its mean; with the speed it turns the gain into mm per m/s.
    pub turbulence: Option<f64>,
    /// Standard error of a reading (mm).
    pub noise: f64,
    /// Range of frequencies that is used (Hz). Without an upper end it goes up to twice the resonance, as far as motion
    /// textures go.
    pub band: [Option<f64>; 2],
}

/// A number and its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Value {
    /// The best estimate.
    pub value: f64,
    /// Its standard error; infinite where nothing is known.
    pub error: f64,
}

/// How a branch sways.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// f_h (Hz).
    pub resonance: Value,
    /// γ (1/s).
    pub damping: Value,
    /// γ over the critical damping 4π f_h.
    pub ratio: Value,
    /// G of every channel (mm/√Hz).
    pub gains: Vec<Value>,
    /// 1/v (s/m); exact where the speed was given.
    pub slowness: Value,
    /// Number of frequencies used, in all channels together.
    pub bins: usize,
    /// Mean of 2(ρ − 1 − ln ρ); 2γ_Euler = 1.154 is expected of Gaussian motion with this spectrum.
    pub deviance: f64,
    /// Whether the numbers can be relied on.
    pub status: Status,
}

/// Fewest frequencies that a fit is made from.
const FEWEST: usize = 16;
/// The band ends at this many times the resonance.
const WIDE: f64 = 2.0;
/// Largest relative standard error of a value that counts as found.
const FOUND: f64 = 0.1;
/// Shares of the critical damping that a fit starts from.
const STARTS: [f64; 3] = [0.15, 0.04, 0.5];
/// Mean and standard deviation of 2(ρ − 1 − ln ρ) for an exponentially distributed ρ, which a periodogram over its mean
/// is.
const DEVIANCE: [f64; 2] = [1.154, 1.606];
/// A mean deviance that is this many standard errors too large is no chance.
const STRANGE: f64 = 4.0;
/// A mean deviance below this belongs to a motion with the fitted spectrum; 1.154 is expected.
const DESCRIBED: f64 = 1.3;

/// One-sided periodogram of readings (mm²/Hz) at k/T for k = 0 … n/2, without the mean.
pub fn periodogram(readings: &[f64], step: f64) -> Vec<f64> {
    let n = readings.len();
    let mean = readings.iter().sum::<f64>() / n as f64;
    let mut buffer: Vec<Complex<f64>> = readings.iter().map(|r| Complex::new(r - mean, 0.0)).collect();
    mesophyll_fourier::forward(n).process(&mut buffer);
    buffer[..=n / 2].iter().map(|c| 2.0 * step / n as f64 * c.norm_sqr()).collect()
}

/// Fits a record.
///
/// # Errors
/// A sentence that says why there is no answer: too few readings, no motion, a band without frequencies.
pub fn fit(record: &Record, known: &Known) -> Result<Motion, String> {
    let n = record.channels.first().map_or(0, Vec::len);
    if n < 4 * FEWEST {
        return Err(format!("{n} readings, expected at least {}", 4 * FEWEST));
    }
    let periodograms: Vec<Vec<f64>> = record.channels.iter().map(|c| periodogram(c, record.step)).collect();
    for (k, p) in periodograms.iter().enumerate() {
        if !(p.iter().sum::<f64>() > 0.0) {
            return Err(format!("nothing moves in {}", ["u_mm", "v_mm"][k.min(1)]));
        }
    }
    let resolution = 1.0 / (n as f64 * record.step);
    let low = known.band[0].map_or(1, |f| (f / resolution).ceil() as usize).max(1);
    let top = n / 2 - 1;
    let low = low.min(top + 1);
    if low + FEWEST > top {
        return Err(format!(
            "no {FEWEST} frequencies from {:.4} to {:.4} Hz: a longer record, or another band",
            low as f64 * resolution,
            top as f64 * resolution
        ));
    }
    let bin = |f: f64| ((f / resolution).floor() as usize).min(top);
    let usual = middle(&periodograms, low, top) * resolution;
    let mut high = known.band[1].map_or_else(|| bin(1.25 * WIDE * usual), bin);
    let mut best: Option<(Parameters, f64)> = None;
    let mut last = None;
    // The band depends on the resonance, so both are found in turn.
    for _ in 0..6 {
        if high < low + FEWEST {
            return Err(format!(
                "{} frequencies from {:.4} to {:.4} Hz, expected {FEWEST} or more: a longer record, or another band",
                (high + 1).saturating_sub(low),
                low as f64 * resolution,
                high as f64 * resolution
            ));
        }
        let expected = Expected::new(n, record.step, known, (low, high));
        best = match &best {
            Some((found, _)) => expected.fit(&periodograms, found),
            None => first(&expected, &periodograms, usual),
        };
        let Some((found, _)) = &best else { return Err("the fit did not come to an end".into()) };
        let next = if known.band[1].is_some() { high } else { bin(WIDE * found.resonance()) };
        let settled = next.abs_diff(high) <= 1 + high / 200;
        last = Some(expected);
        if settled {
            break;
        }
        high = next;
    }
    let (Some((found, cost)), Some(expected)) = (best, last) else {
        return Err("the fit did not come to an end".into());
    };
    let bins = expected.bins(periodograms.len());
    Ok(answer(&found, &expected, known, bins, 2.0 * cost / bins as f64))
}

/// The best fit from several starts. It stops at the first one that describes the motion.
fn first(expected: &Expected, periodograms: &[Vec<f64>], resonance: f64) -> Option<(Parameters, f64)> {
    let mut best: Option<(Parameters, f64)> = None;
    for ratio in STARTS {
        let Some(found) = expected.fit(periodograms, &expected.start(periodograms, resonance, ratio)) else { continue };
        let described = 2.0 * found.1 / expected.bins(periodograms.len()) as f64 <= DESCRIBED;
        if best.as_ref().is_none_or(|b| found.1 < b.1) {
            best = Some(found);
        }
        if described {
            break;
        }
    }
    best
}

/// Root mean square frequency of the motion, in bins. Frequencies far above it hold noise and are left out step by
/// step.
fn middle(periodograms: &[Vec<f64>], low: usize, top: usize) -> f64 {
    let mut high = top;
    let mut found = top as f64;
    for _ in 0..20 {
        let (mut sum, mut whole) = (0.0, 0.0);
        for p in periodograms {
            for (k, value) in p.iter().enumerate().take(high + 1).skip(low) {
                sum += (k * k) as f64 * value;
                whole += value;
            }
        }
        found = if whole > 0.0 { f64::sqrt(sum / whole) } else { top as f64 };
        let next = ((2.5 * found) as usize).clamp(low + 4, top);
        if next >= high {
            break;
        }
        high = next;
    }
    found
}

fn answer(found: &Parameters, expected: &Expected, known: &Known, bins: usize, deviance: f64) -> Motion {
    let covariance = expected.covariance(found);
    let variance = |weights: &[f64]| {
        covariance.as_ref().map_or(f64::INFINITY, |c| {
            let n = weights.len();
            (0..n).map(|i| (0..n).map(|j| weights[i] * weights[j] * c[(i, j)]).sum::<f64>()).sum::<f64>()
        })
    };
    let n = found.0.len();
    let unit = |k: usize| (0..n).map(|j| f64::from(u8::from(j == k))).collect::<Vec<_>>();
    // Logarithms were fitted, so their errors are relative errors.
    let log = |value: f64, weights: &[f64]| Value { value, error: value * variance(weights).sqrt() };
    let mut relative = unit(1);
    relative[0] = -1.0;
    let slowness = match known.speed {
        Some(speed) => Value { value: 1.0 / speed, error: 0.0 },
        None => Value { value: found.slowness(known), error: variance(&unit(n - 1)).sqrt() },
    };
    let mut motion = Motion {
        resonance: log(found.resonance(), &unit(0)),
        damping: log(found.damping(), &unit(1)),
        ratio: log(found.damping() / (4.0 * std::f64::consts::PI * found.resonance()), &relative),
        gains: (0..expected.channels(found)).map(|c| log(found.gain(c), &unit(2 + c))).collect(),
        slowness,
        bins,
        deviance,
        status: Status::Ok,
    };
    let gains = ["gain_u_mm_per_sqrt_hz", "gain_v_mm_per_sqrt_hz"].into_iter().zip(motion.gains.iter().copied());
    let values: Vec<(&str, Value)> =
        [("resonance_hz", motion.resonance), ("damping_per_s", motion.damping)].into_iter().chain(gains).collect();
    let names = |of: &dyn Fn(&Value) -> bool| -> Vec<&str> {
        values.iter().filter(|(_, value)| of(value)).map(|(name, _)| *name).collect()
    };
    let open = names(&|v| !(v.error <= FOUND * v.value.abs()));
    if !open.is_empty() {
        motion.status = Status::Undetermined(format!("{} (a standard error above 10 %)", open.join(" ")));
    } else if deviance > DEVIANCE[0] + STRANGE * DEVIANCE[1] / (bins as f64).sqrt() {
        motion.status = Status::Undetermined(format!(
            "{} (the motion has another spectrum: deviance {deviance:.3}, expected {})",
            names(&|_| true).join(" "),
            DEVIANCE[0]
        ));
    }
    motion
}
