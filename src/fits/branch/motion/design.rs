//! How long and how often a branch has to be read in gusts.
//!
//! A periodogram's value at each frequency k/T is about exponentially distributed around its mean E, so Fisher's
//! information is Σ ∂ln E ∂ln E over the frequencies (Whittle 1953). E is the density of the motion and that of the
//! readings' noise. The density is folded at half the rate, as readings at that rate see it.

use mesophyll_plants::mechanics::wind::Oscillator;
use nalgebra::DMatrix;
use std::f64::consts::PI;

/// A branch and how it will be read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionDesign {
    /// Resonance f_h (Hz).
    pub resonance_hz: f64,
    /// Damping γ (1/s).
    pub damping_per_s: f64,
    /// Mean speed of the wind (m/s).
    pub speed: f64,
    /// Whether the speed is measured; otherwise it is fitted.
    pub speed_known: bool,
    /// Standard deviation of the tip's deflection (mm).
    pub sway_mm: f64,
    /// Standard error of a reading (mm).
    pub noise_mm: f64,
    /// Directions that are read, 1 or 2.
    pub channels: usize,
}

/// What is known before any reading, as shares: resonance, damping, gain of each channel, 1/v.
const KNOWN: f64 = 3.0;
/// Foldings that are counted.
const FOLDS: i32 = 3;

impl MotionDesign {
    /// One-sided density (mm²/Hz) for a gain of 1.
    fn density(&self, f: f64, p: [f64; 3]) -> f64 {
        let oscillator = Oscillator { resonance: p[0].exp(), damping: p[1].exp() };
        oscillator.response(f).powi(2) * (1.0 + f * p[2]).powf(-5.0 / 3.0)
    }

    fn start(&self) -> [f64; 3] {
        [self.resonance_hz.ln(), self.damping_per_s.ln(), 1.0 / self.speed]
    }

    /// Gain (mm/√Hz) that makes the deflection scatter as stated.
    pub fn gain(&self) -> f64 {
        // The density is smooth in the logarithm of the frequency but for the resonance, which is resolved.
        let step = 0.02 * self.damping_per_s.min(self.resonance_hz) / (2.0 * PI);
        let steps = ((20.0 * self.resonance_hz / step) as usize).min(2_000_000);
        let sum: f64 = (0..steps).map(|k| self.density((k as f64 + 0.5) * step, self.start())).sum();
        self.sway_mm / (sum * step).sqrt()
    }

    /// Standard errors of ln f_h and ln γ of a record of `seconds` at `rate` readings a second. Frequencies above twice
    /// the resonance are left out, as the fit does.
    pub fn errors(&self, seconds: f64, rate: f64) -> [f64; 2] {
        let gain = self.gain();
        let p = self.start();
        let floor = 2.0 * self.noise_mm.powi(2) / rate;
        let folded = |f: f64, p: [f64; 3]| -> f64 {
            (-FOLDS..=FOLDS).map(|m| self.density((f + f64::from(m) * rate).abs(), p)).sum()
        };
        let highest = (2.0 * self.resonance_hz).min(0.5 * rate);
        let last = (highest * seconds).floor() as usize;
        let mut information = DMatrix::from_diagonal_element(4, 4, KNOWN.powi(-2));
        information[(3, 3)] = if self.speed_known { 1e18 } else { (KNOWN / self.speed).powi(-2) };
        // Of very long records every so many frequencies stand for those around them.
        let every = last.div_ceil(20_000).max(1);
        for k in (1..=last).step_by(every) {
            let f = k as f64 / seconds;
            let (value, mut slopes) = (folded(f, p), [0.0; 4]);
            let whole = gain * gain * value + floor;
            let share = gain * gain * value / whole;
            for (j, slope) in [0, 1, 3].into_iter().zip(0..3) {
                let h = if slope == 2 { 1e-5 * p[2].max(1e-3) } else { 1e-5 };
                let moved = |by: f64| {
                    let mut q = p;
                    q[slope] += by;
                    folded(f, q)
                };
                slopes[j] = share * (moved(h) - moved(-h)) / (2.0 * h * value);
            }
            slopes[2] = 2.0 * share;
            for i in 0..4 {
                for j in 0..4 {
                    information[(i, j)] += every as f64 * self.channels as f64 * slopes[i] * slopes[j];
                }
            }
        }
        let inverse = information.try_inverse();
        [0, 1].map(|k| inverse.as_ref().map_or(f64::INFINITY, |v| v[(k, k)].max(0.0).sqrt()))
    }

    /// The shortest record (s) at `rate` whose damping is known to the share `until`, or `None` below `longest`.
    pub fn shortest(&self, rate: f64, until: f64, longest: f64) -> Option<f64> {
        let enough = |seconds: f64| self.errors(seconds, rate)[1] <= until;
        let (mut least, mut most) = (4.0 / self.resonance_hz, longest);
        if !enough(most) {
            return None;
        }
        while most / least > 1.02 {
            let middle = (least * most).sqrt();
            if enough(middle) {
                most = middle;
            } else {
                least = middle;
            }
        }
        Some(most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::branch::motion::tests::stepped;
    use crate::branch::motion::{MotionPrior, MotionRecord, fit};
    use rayon::prelude::*;
    use std::f64::consts::TAU;

    const BRANCH: MotionDesign = MotionDesign {
        resonance_hz: 1.3,
        damping_per_s: 2.0,
        speed: 1e9,
        speed_known: true,
        sway_mm: 0.0,
        noise_mm: 0.0,
        channels: 1,
    };

    /// White force of density force² gives x a variance of force²/(2 γ ω²) and, one-sided, a density of 2 force²/ω⁴ at
    /// low frequencies.
    #[test]
    fn the_gain_is_that_of_an_oscillator() {
        let omega = TAU * 1.3;
        let design = MotionDesign { sway_mm: 3.0 / (2.0 * 2.0 * omega * omega).sqrt(), ..BRANCH };
        let expected = 2f64.sqrt() * 3.0 / (omega * omega);
        assert!((design.gain() / expected - 1.0).abs() < 2e-3, "{} {expected}", design.gain());
    }

    /// The errors of a plan are the scatter of fits to records of an oscillator that is stepped in time.
    #[test]
    fn planned_errors_are_the_scatter_of_fits() {
        let omega = TAU * 1.3;
        let design = MotionDesign { sway_mm: 3.0 / (2.0 * 2.0 * omega * omega).sqrt(), ..BRANCH };
        let (step, readings) = (0.1, 1024);
        let stated = design.errors(step * readings as f64, 1.0 / step);
        let found: Vec<[f64; 2]> = (0..48u64)
            .into_par_iter()
            .map(|seed| {
                let channels = vec![stepped(1.3, 2.0, 3.0, step, readings, 900 + seed)];
                let record = MotionRecord { step, channels, ..MotionRecord::default() };
                let known = MotionPrior { speed: Some(design.speed), ..MotionPrior::default() };
                let found = fit(&record, &known).unwrap();
                [(found.resonance.value / 1.3).ln(), (found.damping.value / 2.0).ln()]
            })
            .collect();
        for (k, stated) in stated.into_iter().enumerate() {
            let seen = (found.iter().map(|f| f[k] * f[k]).sum::<f64>() / found.len() as f64).sqrt();
            // 48 values scatter by 10 % in their root mean square.
            assert!((seen / stated - 1.0).abs() < 0.3, "{k}: {seen} {stated}");
        }
    }

    #[test]
    fn longer_records_are_better_by_the_root_of_their_length() {
        let design = MotionDesign { sway_mm: 5.0, noise_mm: 0.1, ..BRANCH };
        let (short, long) = (design.errors(100.0, 10.0), design.errors(400.0, 10.0));
        assert!((short[0] / long[0] / 2.0 - 1.0).abs() < 0.03, "{short:?} {long:?}");
        let seconds = design.shortest(10.0, long[1], 1e5).unwrap();
        assert!((seconds / 400.0 - 1.0).abs() < 0.05, "{seconds}");
        assert_eq!(design.shortest(10.0, 1e-9, 1e4), None);
    }
}
