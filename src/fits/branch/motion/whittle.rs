//! The mean of a periodogram of a motion in gusts, and the fit to one.

use super::MotionPrior;
use super::spectra::Periodograms;
use mesophyll_base::fourier::{Complex, FourierTransform};
use mesophyll_base::solvers::{ClosureProblem, Options, lm};
use std::cell::RefCell;
use std::f64::consts::PI;
use std::sync::OnceLock;

/// ln f_h, ln γ, ln G of every channel, 1/v where the wind's speed is fitted, and ln of the drift's density at the
/// lowest frequency of the band for every channel where drift is fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct GustParameters(pub Vec<f64>);

impl GustParameters {
    /// f_h (Hz).
    pub fn resonance(&self) -> f64 {
        self.0[0].exp()
    }

    /// γ (1/s).
    pub fn damping(&self) -> f64 {
        self.0[1].exp()
    }

    /// G of a channel (mm/√Hz).
    pub fn gain(&self, channel: usize) -> f64 {
        self.0[2 + channel].exp()
    }
}

/// How often frequencies above the highest one that the step resolves are folded back, where the resonance is below
/// it. Frequencies further up contribute less than .2 % of the rest.
const FOLDS: i32 = 1;
/// The same for resonances up to three times that frequency.
const ALIAS_FOLDS: i32 = 3;
/// Drift begins with a density this far below that of the motion.
const LITTLE_DRIFT: f64 = 1e-3;

/// The mean of the periodograms of a record, as far as the band goes.
pub struct ExpectedPeriodograms<'a> {
    pub(super) spectra: &'a Periodograms,
    pub(super) known: MotionPrior,
    /// First and last frequency that are used, in units of 1/T.
    pub band: (usize, usize),
    folds: i32,
    /// Bounds of the resonance (Hz).
    bounds: (f64, f64),
    /// Mean periodogram of drift over the band for every window, 1 at the band's beginning; empty where none is
    /// fitted.
    pub(super) drift: Vec<Vec<f64>>,
    /// Points of the grid on which the power density is given.
    grid: usize,
    inverse: FourierTransform,
    forward: FourierTransform,
    /// Cube roots of the gusts' factor at every frequency, in the order of [`Self::frequency`], where the wind's speed
    /// is known. They take as long as all else of a density.
    roots: OnceLock<Vec<f64>>,
}

impl<'a> ExpectedPeriodograms<'a> {
    /// At the frequencies k/T for k in `band`, both ends included. With `drift`, every channel has a part ∝ 1/f² beside
    /// the swaying: the density of a random walk, and how steps and trends leak.
    pub fn new(
        spectra: &'a Periodograms,
        known: &MotionPrior,
        band: (usize, usize),
        drift: bool,
    ) -> ExpectedPeriodograms<'a> {
        let grid = (2 * spectra.readings).next_power_of_two();
        let mut out = ExpectedPeriodograms {
            spectra,
            known: *known,
            band,
            folds: FOLDS,
            // A resonance beyond these leaves nothing in the band but a slope.
            bounds: (0.1 * spectra.resolution(), 1.0 / spectra.step),
            drift: Vec::new(),
            grid,
            inverse: mesophyll_base::fourier::inverse(grid),
            forward: mesophyll_base::fourier::forward(spectra.readings),
            roots: OnceLock::new(),
        };
        if drift {
            // What is slower than the trend that was taken out is no longer there.
            let slowest = (PI * spectra.step * spectra.resolution() * 0.5 * (spectra.degree + 1) as f64).sin().powi(2);
            let walk = |f: f64| 1.0 / ((PI * f * spectra.step).sin().powi(2) + slowest);
            let [covariances] = out.autocovariances(|_, f| [[walk(f), 0.0]], 0);
            let shape = |w: usize| out.leaked(&covariances, w).into_iter().next().unwrap_or_default();
            out.drift = (0..spectra.windows.len()).map(shape).collect();
            for shape in &mut out.drift {
                let first = shape[0];
                shape.iter_mut().for_each(|v| *v = (*v / first).max(f64::MIN_POSITIVE));
            }
        }
        out
    }

    /// The same for resonances from half the sampling rate up to one and a half times the rate.
    pub fn aliased(mut self) -> ExpectedPeriodograms<'a> {
        let rate = 1.0 / self.spectra.step;
        self.folds = ALIAS_FOLDS;
        self.roots = OnceLock::new();
        self.bounds = (0.5 * rate, 1.5 * rate);
        self
    }

    /// Frequencies used, in all channels.
    pub fn bins(&self) -> usize {
        (self.band.1 + 1 - self.band.0) * self.channels()
    }

    /// The number of channels.
    pub fn channels(&self) -> usize {
        self.spectra.powers.len()
    }

    pub(super) fn fitted_speed(&self) -> bool {
        self.known.speed.is_none()
    }

    /// Position of the drift's parameters.
    pub(super) fn drifts(&self) -> usize {
        2 + self.channels() + usize::from(self.fitted_speed())
    }

    /// 1/v (s/m).
    pub fn slowness(&self, p: &GustParameters) -> f64 {
        self.known.speed.map_or_else(|| p.0[2 + self.channels()], |v| 1.0 / v)
    }

    /// One-sided density by frequency (its place and Hz) for a gain of 1, and its derivatives by ln f_h, ln γ and 1/v:
    /// [`Oscillator::response`] squared times the gusts' share, in a form that is quickly computed.
    ///
    /// [`Oscillator::response`]: mesophyll_plants::mechanics::wind::Oscillator::response
    fn density(&self, p: &GustParameters) -> impl Fn(usize, f64) -> [f64; 4] {
        let (square, damping) = (p.resonance().powi(2), p.damping());
        let slowness = self.slowness(p);
        let top = (2.0 * PI * square).powi(2);
        let roots = self.known.speed.map(|_| self.roots.get_or_init(|| self.roots(slowness)));
        move |place, f| {
            let off = 2.0 * PI * (square - f * f);
            let damped = (f * damping).powi(2);
            let bottom = off * off + damped;
            let gusts = 1.0 + f * slowness;
            let third = roots.map_or_else(|| gusts.cbrt(), |roots| roots[place]);
            let value = top / (bottom * gusts * third * third);
            [
                value,
                value * (4.0 - 8.0 * PI * square * off / bottom),
                value * (-2.0 * damped / bottom),
                value * (-5.0 / 3.0 * f / gusts),
            ]
        }
    }

    /// The m-th fold of the k-th frequency of the grid (Hz).
    fn frequency(&self, k: usize, m: i32) -> f64 {
        let rate = 1.0 / self.spectra.step;
        (k as f64 * rate / self.grid as f64 + f64::from(m) * rate).abs()
    }

    /// Cube roots of the gusts' factor at all frequencies.
    fn roots(&self, slowness: f64) -> Vec<f64> {
        let folds = |k: usize| (-self.folds..=self.folds).map(move |m| (k, m));
        let root = |(k, m)| (1.0 + self.frequency(k, m) * slowness).cbrt();
        (0..=self.grid / 2).flat_map(folds).map(root).collect()
    }

    /// Autocovariances, for distances of 0, 1, 2 … steps, of readings with pairs of one-sided densities. These are
    /// given the place of a frequency in the order of `roots`, and the frequency (Hz).
    fn autocovariances<const N: usize>(
        &self,
        densities: impl Fn(usize, f64) -> [[f64; 2]; N],
        folds: i32,
    ) -> [[Vec<f64>; 2]; N] {
        let half = self.grid / 2;
        let mut lines = [(); N].map(|()| vec![Complex::new(0.0, 0.0); self.grid]);
        let mut place = 0;
        for k in 0..=half {
            let mut folded = [Complex::new(0.0, 0.0); N];
            for m in -folds..=folds {
                for (sum, [a, b]) in folded.iter_mut().zip(densities(place, self.frequency(k, m))) {
                    *sum += Complex::new(a, b);
                }
                place += 1;
            }
            for (line, folded) in lines.iter_mut().zip(folded) {
                line[k] = 0.5 * folded;
                line[(self.grid - k) % self.grid] = line[k];
            }
        }
        let scale = 1.0 / self.spectra.step / self.grid as f64;
        lines.map(|mut line| {
            // Both are even, so their transforms are real and stay apart.
            self.inverse.process(&mut line);
            line.truncate(self.spectra.readings);
            [line.iter().map(|c| c.re * scale).collect(), line.iter().map(|c| c.im * scale).collect()]
        })
    }

    /// One-sided means of the periodogram over the band of readings with these autocovariances: each is weighted by the
    /// share of pairs of readings that have each distance.
    fn leaked(&self, covariances: &[Vec<f64>; 2], window: usize) -> [Vec<f64>; 2] {
        let lags = &self.spectra.windows[window];
        let [a, b] = covariances;
        let mut weighted: Vec<Complex<f64>> =
            lags.iter().zip(a.iter().zip(b)).map(|(w, (a, b))| Complex::new(a * w, b * w)).collect();
        self.forward.process(&mut weighted);
        let n = weighted.len();
        let sum = |k: usize| weighted[k] + weighted[n - k];
        let range = self.band.0..=self.band.1;
        let step = 2.0 * self.spectra.step;
        [range.clone().map(|k| step * (sum(k).re - a[0])).collect(), range.map(|k| step * (sum(k).im - b[0])).collect()]
    }

    /// Mean of the periodogram over the band for a gain of 1, without noise and drift, for every window.
    pub fn mean(&self, p: &GustParameters) -> Vec<Vec<f64>> {
        let density = self.density(p);
        let [covariances] = self.autocovariances(|place, f| [[density(place, f)[0], 0.0]], self.folds);
        (0..self.spectra.windows.len())
            .map(|w| self.leaked(&covariances, w).into_iter().next().unwrap_or_default())
            .collect()
    }

    /// The same, and its derivatives by ln f_h, ln γ and 1/v.
    pub(super) fn slopes(&self, p: &GustParameters) -> Vec<[Vec<f64>; 4]> {
        let density = self.density(p);
        let pairs = |place: usize, f: f64| {
            let [value, resonance, damping, slowness] = density(place, f);
            [[value, resonance], [damping, slowness]]
        };
        let [first, second] = self.autocovariances(pairs, self.folds);
        let one = |w: usize| {
            let ([a, b], [c, d]) = (self.leaked(&first, w), self.leaked(&second, w));
            [a, b, c, d]
        };
        (0..self.spectra.windows.len()).map(one).collect()
    }

    /// Density of the drift of a channel at the k-th frequency of the band.
    pub(super) fn drift(&self, p: &GustParameters, channel: usize, k: usize) -> f64 {
        let Some(shape) = self.drift.get(self.spectra.window_of[channel]) else { return 0.0 };
        p.0[self.drifts() + channel].exp() * shape[k]
    }

    /// Mean of the periodogram over the band, channel after channel.
    pub fn whole(&self, p: &GustParameters) -> Vec<f64> {
        self.sum(p, &self.mean(p))
    }

    pub(super) fn sum(&self, p: &GustParameters, mean: &[Vec<f64>]) -> Vec<f64> {
        let one = |c: usize| {
            let (power, mean) = (p.gain(c).powi(2), &mean[self.spectra.window_of[c]]);
            mean.iter().enumerate().map(move |(k, e)| power * e + self.drift(p, c, k) + self.spectra.floor)
        };
        (0..self.channels()).flat_map(one).collect()
    }

    /// The periodograms over the band, channel after channel.
    pub fn measured(&self) -> Vec<f64> {
        self.spectra.powers.iter().flat_map(|p| p[self.band.0..=self.band.1].iter().copied()).collect()
    }

    /// Drift over swaying at every frequency of the band, the larger one of the channels.
    pub fn drift_share(&self, p: &GustParameters) -> Vec<f64> {
        let mean = self.mean(p);
        let width = self.band.1 + 1 - self.band.0;
        let share = |c: usize, k: usize| {
            self.drift(p, c, k) / (p.gain(c).powi(2) * mean[self.spectra.window_of[c]][k] + self.spectra.floor)
        };
        (0..width).map(|k| (0..self.channels()).map(|c| share(c, k)).fold(0.0, f64::max)).collect()
    }

    /// Parameters to begin with, for a resonance (Hz) and a share of the critical damping.
    pub fn start(&self, resonance: f64, ratio: f64) -> GustParameters {
        let mut p = vec![resonance.ln(), (ratio * 4.0 * PI * resonance).ln()];
        p.extend((0..self.channels()).map(|_| 0.0));
        if self.fitted_speed() {
            p.push(0.2);
        }
        let mut out = GustParameters(p);
        let mean = self.mean(&out);
        for c in 0..self.channels() {
            let range = self.band.0..=self.band.1;
            let expected = &mean[self.spectra.window_of[c]];
            // Frequencies around the resonance tell its size even where drift is larger below.
            let near = |k: usize| (0.5..1.5).contains(&(k as f64 * self.spectra.resolution() / resonance));
            let some = range.clone().any(near);
            let (mut measured, mut whole) = (0.0, 0.0);
            for k in range.filter(|k| !some || near(*k)) {
                measured += self.spectra.powers[c][k];
                whole += expected[k - self.band.0];
            }
            out.0[2 + c] = 0.5 * (measured / whole).ln();
        }
        self.with_drift(&out)
    }

    /// The same parameters with a little drift, where drift is fitted and they have none.
    pub fn with_drift(&self, p: &GustParameters) -> GustParameters {
        let mut out = p.clone();
        out.0.truncate(self.drifts());
        if !self.drift.is_empty() {
            let mean = self.mean(&out);
            let some = |c: usize| {
                let measured = self.spectra.powers[c][self.band.0] * LITTLE_DRIFT;
                (measured + LITTLE_DRIFT * p.gain(c).powi(2) * mean[self.spectra.window_of[c]][0]).ln()
            };
            let all: Vec<f64> = (0..self.channels()).map(some).collect();
            out.0.extend(all);
        }
        out
    }

    /// Whittle's estimate, and half the sum of squares there: the log-likelihood below that of a periodogram that is
    /// its own mean. `None` where the solver finds none.
    pub fn fit(&self, start: &GustParameters) -> Option<(GustParameters, f64)> {
        let measured = self.measured();
        // The solver asks for derivatives where it asked for residuals last.
        let last: RefCell<(Vec<f64>, Vec<f64>)> = RefCell::default();
        let residuals = |params: &[f64], out: &mut [f64]| {
            let whole = self.whole(&GustParameters(params.to_vec()));
            for ((out, i), e) in out.iter_mut().zip(&measured).zip(&whole) {
                *out = deviance(i / e);
            }
            *last.borrow_mut() = (params.to_vec(), whole);
        };
        let jacobian = |params: &[f64], out: &mut [f64]| {
            let p = GustParameters(params.to_vec());
            let last = last.borrow();
            let whole = if last.0 == params { last.1.clone() } else { self.whole(&p) };
            for (column, out) in self.derivatives(&p).iter().zip(out.chunks_mut(measured.len())) {
                for (k, (out, slope)) in out.iter_mut().zip(column).enumerate() {
                    let rho = measured[k] / whole[k];
                    let r = deviance(rho);
                    // d√(2(ρ − 1 − ln ρ)) = (ρ − 1)/r d ln ρ, which is 1 + (ρ − 1)/3 … around ρ = 1.
                    let factor = if (rho - 1.0).abs() < 1e-4 { 1.0 + (rho - 1.0) / 3.0 } else { (rho - 1.0) / r };
                    *out = -factor * slope;
                }
            }
        };
        let problem = ClosureProblem::new(start.0.len(), measured.len(), residuals).with_jacobian(jacobian);
        let mut lower = vec![f64::NEG_INFINITY; start.0.len()];
        let mut upper = vec![f64::INFINITY; start.0.len()];
        (lower[0], upper[0]) = (self.bounds.0.ln(), self.bounds.1.ln());
        // The wind cannot blow backwards: below 0 the density has a pole.
        if self.fitted_speed() {
            lower[2 + self.channels()] = 0.0;
        }
        // Drift that is a billionth of what was measured is none.
        for c in 0..self.channels() * usize::from(!self.drift.is_empty()) {
            lower[self.drifts() + c] = start.0[self.drifts() + c] - 30.0;
        }
        // A tenth of a millionth of a standard error is precise enough.
        let options = Options {
            max_iterations: 60,
            cost_tolerance: 1e-12,
            step_tolerance: 1e-9,
            lower,
            upper,
            ..Options::default()
        };
        let found = lm::minimize(&problem, &start.0, &options);
        let usable = found.params.iter().all(|v| v.is_finite()) && found.cost.is_finite();
        usable.then_some((GustParameters(found.params), found.cost))
    }
}

/// ±√(2(ρ − 1 − ln ρ)), with the sign of ρ − 1.
fn deviance(rho: f64) -> f64 {
    let d = rho - 1.0;
    if d.abs() < 1e-4 {
        // 2(ρ − 1 − ln ρ) = d² − 2d³/3 + d⁴/2 − …
        return d * (1.0 - d / 3.0 + 7.0 * d * d / 36.0);
    }
    if !(rho > 0.0) {
        return if rho == 0.0 { -40.0 } else { f64::NAN };
    }
    (2.0 * (d - rho.ln())).max(0.0).sqrt().copysign(d)
}
