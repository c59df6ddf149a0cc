//! Whether the errors of fitted motions are right, and what the fit says of motions that are hard to fit.
//!
//! Motions are made by an inverse transform eight times as long as the record, with random sizes and phases: a Gaussian
//! motion of known spectrum that does not repeat within the record.

use crate::stress::StressRow;
use mesophyll_base::fourier::Complex;
use mesophyll_fits::branch::motion::{MotionFit, MotionKind, MotionPrior, MotionRecord, fit};
use mesophyll_fits::gloss::synthetic::GaussianDeviates;
use mesophyll_plants::mechanics::wind::Oscillator;
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::time::Instant;

/// Number of motions in the set over which coverage is counted.
pub const MOTIONS: usize = 400;
/// Share of truths that 95 % intervals must contain.
const RIGHT: std::ops::RangeInclusive<f64> = 0.93..=0.97;

/// A motion whose parameters are known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionProofTruth {
    /// f_h (Hz).
    pub resonance: f64,
    /// γ over the critical damping.
    pub ratio: f64,
    /// √S at low frequencies (mm/√Hz).
    pub gain: f64,
    /// Mean speed of the wind (m/s).
    pub speed: f64,
}

/// A record of `readings` readings at intervals of `step` (s).
pub fn record(
    truth: &MotionProofTruth,
    readings: usize,
    step: f64,
    channels: usize,
    noise: f64,
    seed: u64,
) -> MotionRecord {
    let mut chance = GaussianDeviates::new(seed);
    let damping = truth.ratio * 2.0 * TAU * truth.resonance;
    let oscillator = Oscillator { resonance: truth.resonance, damping };
    let n = (8 * readings).next_power_of_two();
    let spacing = 1.0 / (n as f64 * step);
    let one = |chance: &mut GaussianDeviates| {
        let mut line = vec![Complex::new(0.0, 0.0); n];
        for k in 1..n / 2 {
            let f = k as f64 * spacing;
            let density = (truth.gain * oscillator.response(f)).powi(2) * (1.0 + f / truth.speed).powf(-5.0 / 3.0);
            // Half of a one-sided density belongs to each side, and half of that to each of the real and imaginary
            // parts.
            let size = (0.25 * density * spacing).sqrt();
            line[k] = Complex::new(size * chance.normal(), size * chance.normal());
            line[n - k] = line[k].conj();
        }
        mesophyll_base::fourier::inverse(n).process(&mut line);
        line[..readings].iter().map(|c| c.re + noise * chance.normal()).collect()
    };
    MotionRecord { step, channels: (0..channels).map(|_| one(&mut chance)).collect(), ..MotionRecord::default() }
}

/// How many 95 % intervals of resonance, damping and gain contain the truth, and for how many motions values were
/// promised.
pub fn coverage(motions: usize, seed: u64) -> ([usize; 3], usize) {
    let inside = |k: usize| -> Option<[bool; 3]> {
        let mut chance = GaussianDeviates::new(seed + k as u64);
        let truth = MotionProofTruth {
            resonance: chance.uniform(0.8f64.ln(), 3f64.ln()).exp(),
            ratio: chance.uniform(0.03f64.ln(), 0.3f64.ln()).exp(),
            gain: chance.uniform(0.0, 3.0).exp(),
            speed: chance.uniform(1.5, 8.0),
        };
        let record = record(&truth, 4000, 0.05, 2, 0.0, 7919 * (seed + k as u64) + 1);
        let known = MotionPrior { speed: k.is_multiple_of(2).then_some(truth.speed), ..MotionPrior::default() };
        let found = fit(&record, &known).ok().filter(|m| m.status.is_ok())?;
        let holds = |v: mesophyll_fits::branch::motion::MotionEstimate, t: f64| (v.value - t).abs() <= 1.96 * v.error;
        let damping = truth.ratio * 2.0 * TAU * truth.resonance;
        Some([
            holds(found.resonance, truth.resonance),
            holds(found.damping, damping),
            holds(found.gains[0], truth.gain),
        ])
    };
    let all: Vec<[bool; 3]> = (0..motions).into_par_iter().filter_map(inside).collect();
    (std::array::from_fn(|p| all.iter().filter(|a| a[p]).count()), all.len())
}

/// Readings 20 times a second.
fn of(readings: Vec<f64>) -> MotionRecord {
    MotionRecord { step: 0.05, channels: vec![readings], ..MotionRecord::default() }
}

/// A branch that is let go, seen for 30 s with a noise of .05 mm: modes of f_h (Hz), damping (1/s) and size (mm).
fn let_go(modes: &[[f64; 3]], seed: u64) -> Vec<f64> {
    let mut chance = GaussianDeviates::new(seed);
    let one = |t: f64| -> f64 {
        let mode = |[f, damping, size]: &[f64; 3]| {
            let turn = ((TAU * f).powi(2) - 0.25 * damping * damping).sqrt();
            size * (-0.5 * damping * t).exp() * (turn * t).cos()
        };
        modes.iter().map(mode).sum()
    };
    (0..600).map(|k| one(0.05 * f64::from(k)) + 0.05 * chance.normal()).collect()
}

fn row(case: String, expected: &str, verdict: String, ms: f64) -> StressRow {
    StressRow { model: "motion".into(), case, expected: expected.into(), verdict, digits: None, condition: None, ms }
}

/// The rows of `stress coverage` that are about motions.
pub fn coverage_rows() -> Vec<StressRow> {
    let clock = Instant::now();
    let (inside, promised) = coverage(MOTIONS, 1);
    let ms = clock.elapsed().as_secs_f64() * 1e3 / MOTIONS as f64;
    let one = |(name, inside): (&str, usize)| {
        let share = inside as f64 / promised as f64;
        let case = format!("{name}: 95 % intervals of {MOTIONS} motions, {promised} of them promised");
        let right = RIGHT.contains(&share);
        let verdict = if right { "ok".into() } else { format!("{:.1} % hold the truth", 100.0 * share) };
        StressRow { model: "coverage".into(), ..row(case, "ok", verdict, ms) }
    };
    ["resonance", "damping", "gain of a motion"].into_iter().zip(inside).map(one).collect()
}

/// The rows of `stress motion`.
pub fn rows() -> Vec<StressRow> {
    let mut out = Vec::new();
    let usual = MotionProofTruth { resonance: 2.0, ratio: 0.1, gain: 5.0, speed: 3.0 };
    let verdict = |found: &Result<MotionFit, String>| match found {
        Ok(m) => m.status.to_string(),
        Err(why) => format!("refused: {why}"),
    };
    let mut case = |name: &str, expected: &str, record: MotionRecord, known: MotionPrior| {
        let clock = Instant::now();
        let found = fit(&record, &known);
        out.push(row(name.into(), expected, verdict(&found), clock.elapsed().as_secs_f64() * 1e3));
    };
    let none = MotionPrior::default();
    case("ten minutes, 20 readings a second", "ok", record(&usual, 12_000, 0.05, 1, 0.0, 3), none);
    case(
        "noise as large as a tenth of the motion",
        "ok",
        record(&usual, 6000, 0.05, 1, 0.7, 4),
        MotionPrior { noise: 0.7, ..none },
    );
    case("five readings a second", "ok", record(&usual, 3000, 0.2, 2, 0.0, 9), none);
    let given = MotionPrior { speed: Some(usual.speed), ..none };
    case("the wind is given", "ok", record(&usual, 6000, 0.05, 1, 0.0, 10), given);
    let white = MotionProofTruth { speed: 1e9, ..usual };
    case("a force of all frequencies alike", "ok", record(&white, 6000, 0.05, 2, 0.0, 11), none);
    case("hardly damped", "ok", record(&MotionProofTruth { ratio: 0.01, ..usual }, 12_000, 0.05, 2, 0.0, 5), none);
    case("ten seconds", "undetermined", record(&usual, 200, 0.05, 1, 0.0, 6), none);
    case("overdamped", "undetermined", record(&MotionProofTruth { ratio: 2.0, ..usual }, 2000, 0.05, 1, 0.0, 7), none);
    case("does not move", "refused", of(vec![1.0; 1000]), none);
    case("63 readings", "refused", record(&usual, 63, 0.05, 1, 0.0, 8), none);
    case("pulled and let go", "ok", of(let_go(&[[1.2, 0.75, 30.0]], 1)), none);
    // Wrong models: data that neither kind of motion describes.
    case("let go, with two modes", "undetermined", of(let_go(&[[1.2, 0.75, 30.0], [1.9, 0.8, 8.0]], 2)), none);
    let gusts = MotionPrior { kind: MotionKind::Gusts, ..none };
    case("let go, taken for gusts", "undetermined", of(let_go(&[[1.2, 0.75, 30.0]], 3)), gusts);
    let mut both = record(&usual, 6000, 0.05, 1, 0.0, 12);
    let second = record(&MotionProofTruth { resonance: 3.1, ..usual }, 6000, 0.05, 1, 0.0, 13);
    both.channels[0].iter_mut().zip(&second.channels[0]).for_each(|(a, b)| *a += b);
    case("two resonances in gusts", "undetermined", both, none);
    let slow = MotionProofTruth { resonance: 2.2, ..usual };
    case("a resonance above half the rate", "undetermined", record(&slow, 3000, 1.0 / 3.0, 1, 0.0, 14), none);
    let altered = |change: &dyn Fn(usize, &mut f64)| {
        let mut of = record(&usual, 6000, 0.05, 1, 0.0, 15);
        of.channels[0].iter_mut().enumerate().for_each(|(k, r)| change(k, r));
        of
    };
    case("the level drifts", "ok", altered(&|k, r| *r += 0.05 * k as f64), none);
    case("one wild reading", "ok", altered(&|k, r| *r += if k == 2000 { 400.0 } else { 0.0 }), none);
    case("a fifth is missing", "ok", altered(&|k, r| *r = if (k * 7919 / 13) % 5 == 0 { f64::NAN } else { *r }), none);
    case("a twentieth is wild", "undetermined", altered(&|k, r| *r += if k % 20 == 0 { 40.0 } else { 0.0 }), none);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A few motions of the set that `stress coverage` counts in full.
    #[test]
    fn intervals_hold_the_truth_about_as_often_as_they_say() {
        let (inside, promised) = coverage(24, 400);
        assert!(promised >= 20, "{promised}");
        for count in inside {
            // 95 % of 24 intervals, within three standard deviations of the count.
            assert!(count as f64 >= 0.95 * promised as f64 - 3.2, "{inside:?} of {promised}");
        }
    }
}
