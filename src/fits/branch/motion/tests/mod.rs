mod faults;
mod free;

use super::spectra::Periodograms;
use super::whittle::{ExpectedPeriodograms, GustParameters};
use super::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use std::f64::consts::TAU;

fn normal(rng: &mut Pcg64) -> f64 {
    let (a, b): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
}

/// The oscillator ẍ + γẋ + ω²x = white noise, in time steps of a tenth of the readings' interval. It uses none of the
/// fit's formulas.
pub(crate) fn stepped(f: f64, gamma: f64, force: f64, step: f64, n: usize, seed: u64) -> Vec<f64> {
    let mut rng = Pcg64::seed_from_u64(seed);
    // So many steps between readings that each turns the oscillation by less than .03 (rounding of steps is then below
    // 1e-4).
    let sub = 20u32.max((TAU * f * step / 0.03).ceil() as u32);
    let (dt, omega2) = (step / f64::from(sub), (TAU * f).powi(2));
    let (mut x, mut v) = (0.0, 0.0);
    let kept = (-gamma * dt).exp();
    let mut out = Vec::with_capacity(n);
    for k in 0..n + 200 {
        for _ in 0..sub {
            // Half a step of the place, a full step of the speed with exact damping, and half a step of the place.
            x += 0.5 * dt * v;
            v = v * kept - omega2 * x * (1.0 - kept) / gamma + force * dt.sqrt() * normal(&mut rng);
            x += 0.5 * dt * v;
        }
        if k >= 200 {
            out.push(x);
        }
    }
    out
}

/// White force of one-sided density 2·force² moves the tip with a density of 2 force²/ω⁴ at low frequencies.
#[test]
fn an_oscillator_that_is_stepped_in_time_is_found_within_its_errors() {
    let (f, gamma, step) = (1.3f64, 2.0, 0.05);
    let gain = (2.0f64).sqrt() * 3.0 / (TAU * f).powi(2);
    let pulls: Vec<[f64; 3]> = (0..24u64)
        .into_par_iter()
        .map(|seed| {
            let record = MotionRecord {
                step,
                channels: vec![stepped(f, gamma, 3.0, step, 2048, seed)],
                ..MotionRecord::default()
            };
            let found = fit(&record, &MotionPrior { speed: Some(1e9), ..MotionPrior::default() }).unwrap();
            assert!(found.resonance.error < 0.05 && found.bins > 100);
            let pull = |v: MotionEstimate, truth: f64| (v.value - truth) / v.error;
            [pull(found.resonance, f), pull(found.damping, gamma), pull(found.gains[0], gain)]
        })
        .collect();
    for k in 0..3 {
        let mean = pulls.iter().map(|p| p[k]).sum::<f64>() / 24.0;
        let rms = (pulls.iter().map(|p| p[k] * p[k]).sum::<f64>() / 24.0).sqrt();
        println!("parameter {k}: mean pull {mean:.2}, root mean square {rms:.2}");
        // With 24 pulls, the mean scatters by .2 and the root mean square by .14.
        assert!(mean.abs() < 0.7 && (0.6..1.5).contains(&rms), "{k}: {mean} {rms}");
    }
}

/// The mean of many periodograms of the same motion is what the fit expects, including leakage and folding.
#[test]
fn the_mean_of_periodograms_is_as_expected() {
    let (f, gamma, step, n) = (2.0f64, 1.5, 0.1, 256);
    let known = MotionPrior { speed: Some(1e9), ..MotionPrior::default() };
    let spectra = Periodograms::new(&[vec![1.0; n]], step, 0.0, 0.0, 0);
    let expected = ExpectedPeriodograms::new(&spectra, &known, (1, n / 2 - 1), false);
    let gain2 = 2.0 / (TAU * f).powi(4);
    let mean = expected.mean(&GustParameters(vec![f.ln(), f64::ln(gamma), 0.0])).remove(0);
    let runs = 400;
    let all: Vec<Vec<f64>> =
        (0..runs).into_par_iter().map(|s| periodogram(&stepped(f, gamma, 1.0, step, n, 50 + s), step)).collect();
    // Bands of eight frequencies scatter by 1/√(8 · 400) = 1.8 %.
    for band in (1..n / 2 - 8).step_by(8) {
        let measured: f64 = (band..band + 8).map(|k| all.iter().map(|p| p[k]).sum::<f64>() / runs as f64).sum();
        let wanted: f64 = (band..band + 8).map(|k| gain2 * mean[k - 1]).sum();
        assert!((measured / wanted - 1.0).abs() < 0.09, "{band}: {measured} {wanted}");
    }
}

#[test]
fn what_cannot_be_fitted_says_why() {
    let still = MotionRecord { step: 0.1, channels: vec![vec![1.0; 200]], ..MotionRecord::default() };
    assert!(fit(&still, &MotionPrior::default()).unwrap_err().contains("nothing moves"));
    let short = MotionRecord { step: 0.1, channels: vec![vec![1.0; 20]], ..MotionRecord::default() };
    assert!(fit(&short, &MotionPrior::default()).unwrap_err().contains("20 readings"));
    let record =
        MotionRecord { step: 0.05, channels: vec![stepped(1.3, 2.0, 3.0, 0.05, 512, 1)], ..MotionRecord::default() };
    let none = MotionPrior { band: [Some(3.0), Some(3.1)], ..MotionPrior::default() };
    assert!(fit(&record, &none).unwrap_err().contains("frequencies from"));
    // The band begins beyond the frequencies that the readings resolve.
    for lowest in [100.0, 1e300] {
        let beyond = MotionPrior { band: [Some(lowest), None], ..MotionPrior::default() };
        assert!(fit(&record, &beyond).unwrap_err().contains("frequencies from"));
    }
}

/// Two oscillators together have a spectrum that is not in the model, so none of its numbers is promised.
#[test]
fn another_spectrum_is_not_called_found() {
    let step = 0.05;
    let [a, b] = [(1.0, 1), (1.9, 2)].map(|(f, seed)| stepped(f, 0.4, 3.0 * f, step, 4096, seed));
    let record = MotionRecord {
        step,
        channels: vec![a.iter().zip(&b).map(|(a, b)| a + b).collect()],
        ..MotionRecord::default()
    };
    let found = fit(&record, &MotionPrior::default()).unwrap();
    let Status::Undetermined(why) = &found.status else { panic!("{found:?}") };
    assert!(why.starts_with("resonance_hz") && why.contains("another spectrum"), "{why}");
    assert!(found.slowness.value >= 0.0 && found.kind == MotionKind::Gusts);
}
