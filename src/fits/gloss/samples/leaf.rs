//! A leaf with one lobe: the search, what no reading shows of the normal, the weights of the readings, and the errors.

use super::judge::{self, Judgement};
use super::scatter::{self, Residuals};
use super::search::{Point, Problem, even};
use super::{GlossFitSettings, GlossSample, GlossSampleFit, INDEX, TiltChoice};
use mesophyll_optics::gloss::{LobeKind, dot};

/// Noise that is a larger share of the reading than this is no noise of an instrument.
const SCATTER: f64 = 0.1;
/// All directions within this angle of one plane (rad) are a scan in that plane.
const PLANE: f64 = 0.0175;
/// A tilt that is known worse than this (rad) is taken as 0, because leaves lie flatter than it tells.
const UNSEEN: f64 = 0.2;

/// A leaf with one lobe.
pub(super) struct Leaf<'a> {
    problem: Problem<'a>,
    fit: Residuals,
    pub judgement: Judgement,
    taken: Option<String>,
    /// Other ends of descents, best first.
    rivals: Vec<(f64, Point)>,
    level: Level,
}

/// What is known of the tilts without a reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Level {
    /// Whatever is not fitted was stated.
    Stated,
    /// The tilt across was taken as 0.
    Taken,
}

impl<'a> Leaf<'a> {
    pub fn fit(
        samples: &'a [GlossSample],
        bands: usize,
        kind: LobeKind,
        settings: &GlossFitSettings,
    ) -> std::result::Result<Self, String> {
        let fit_index = settings.index.is_none() && kind.has_index();
        let mut problem = Problem {
            samples,
            kind,
            bands,
            weights: even(samples),
            turn: 0.0,
            free: [true, settings.tilts != TiltChoice::Level, settings.tilts == TiltChoice::Free, fit_index],
            index: settings.index.unwrap_or(INDEX),
        };
        let mut level = Level::Stated;
        if settings.tilts == TiltChoice::Free
            && let Some(turn) = plane(samples)
        {
            (problem.turn, problem.free[2], level) = (turn, false, Level::Taken);
        }
        let readings = problem.weights.iter().filter(|w| **w > 0.0).count();
        let parameters = bands + 1 + problem.live().len();
        if readings <= parameters {
            return Err(format!("{readings} readings for {parameters} parameters"));
        }
        let floor = floor(samples);
        let mut ends = problem.search();
        let mut fit = Residuals::at(&problem, &ends[0].1, floor);
        if level == Level::Stated
            && settings.tilts == TiltChoice::Free
            && let Some(turn) = unseen(&problem, &fit)
        {
            (problem.turn, problem.free[2], level) = (turn, false, Level::Taken);
            ends = problem.search();
            fit = Residuals::at(&problem, &ends[0].1, floor);
        }
        let mut leaf =
            Leaf { taken: None, rivals: ends.split_off(1), judgement: Judgement::default(), problem, fit, level };
        leaf.judgement = judge::judge(samples, &leaf.fit, leaf.tilts(), floor);
        leaf.weigh(floor);
        leaf.taken = (level == Level::Taken).then(|| leaf.across());
        Ok(leaf)
    }

    fn tilts(&self) -> [f64; 2] {
        self.problem.tilts(&self.fit.p)
    }

    /// Weights readings by their noise where it grows with the reading. A fit that describes the leaf so is kept; of a
    /// leaf that the lobe does not describe, the plain least squares are kept, because then the scatter is no noise.
    fn weigh(&mut self, floor: f64) {
        let mut problem = self.problem.clone();
        let mut ends: Vec<Point> = [self.fit.p].into_iter().chain(self.rivals.iter().map(|r| r.1)).collect();
        let mut found: Option<(Residuals, f64)> = None;
        let samples = self.problem.samples;
        for _ in 0..5 {
            let before = found.as_ref().map(|f| f.1);
            let Some(growth) = found.as_ref().map_or(&self.fit, |f| &f.0).growth() else { break };
            if before.is_some_and(|b| (growth / b).ln().abs() < 0.05) {
                break;
            }
            let (column, solved) = found.as_ref().map_or_else(
                || (self.problem.column(&self.fit.p), &self.fit.solved),
                |(fit, _)| (problem.column(&fit.p), &fit.solved),
            );
            let computed = |i: usize, k: usize| (solved.rho_d[k] + solved.rho_s * column[i]).max(0.0);
            problem.weights = even(samples)
                .into_iter()
                .enumerate()
                .map(|(at, w)| w / (1.0 + (growth * computed(at / problem.bands, at % problem.bands)).powi(2)))
                .collect();
            let polished = problem.descend(ends.iter().copied());
            ends = polished.iter().map(|e| e.1).collect();
            found = Some((Residuals::at(&problem, &polished[0].1, floor), growth));
        }
        let Some((fit, growth)) = found else { return };
        let mut judgement = judge::judge(samples, &fit, problem.tilts(&fit.p), floor);
        let relative = growth * fit.variances()[0].sqrt();
        if relative > SCATTER && judgement.why.is_none() {
            judgement.why = Some(format!("the readings scatter about it by {:.0} % of themselves", 100.0 * relative));
        }
        if judgement.why.is_none() {
            self.rivals = problem.descend(ends.into_iter().skip(1));
            (self.problem, self.fit, self.judgement) = (problem, fit, judgement);
        } else {
            // The evidence is that of the likelier description of the scatter.
            self.fit.likelihood = self.fit.likelihood.max(fit.likelihood);
            let widening = self.judgement.widening.iter().zip(&judgement.widening).map(|(a, b)| a.max(*b)).collect();
            self.judgement = Judgement { why: judgement.why, widening };
        }
    }

    /// Logarithm of the evidence (Schwarz 1978: −BIC/2).
    pub fn evidence(&self) -> f64 {
        self.fit.likelihood - 0.5 * self.fit.live.len() as f64 * (self.fit.common.r.len() as f64).ln()
    }

    /// What a tilt across would do, as a sentence.
    fn across(&self) -> String {
        const TRIED: f64 = 5.0;
        let mut start = self.fit.p;
        start[2] = TRIED.to_radians();
        let there = self.problem.descend([start].into_iter());
        let rho_s = self.problem.at(&there[0].1).rho_s;
        let change = 100.0 * (rho_s / self.fit.solved.rho_s - 1.0);
        let told = if change.is_finite() {
            format!("; {TRIED:.0} degrees would change rho_s by {change:+.1} %")
        } else {
            String::new()
        };
        format!("the readings do not show the tilt across the plane of the scan, which is taken as 0{told}")
    }

    pub fn report(&self) -> GlossSampleFit {
        let (fit, bands) = (&self.fit, self.problem.bands);
        let widened = |k: usize| fit.error(k) * self.judgement.widening.get(k).copied().unwrap_or(1.0);
        let place = |component: usize| fit.live.iter().position(|k| *k == component).map(|k| bands + 1 + k);
        let error = |component: usize| place(component).map_or(0.0, &widened);
        let m = fit.p[0].exp();
        let (sin, cos) = self.problem.turn.sin_cos();
        let both = match (place(1), place(2)) {
            (Some(a), Some(b)) => fit.covariance[(a, b)] * error(1) * error(2) / (fit.error(a) * fit.error(b)),
            _ => 0.0,
        };
        let across = if self.level == Level::Taken { f64::INFINITY } else { error(2) };
        let mixed = |a: f64, b: f64| {
            // A factor of 0 leaves even an infinite error out.
            let part = |factor: f64, error: f64| if factor.abs() < 1e-6 { 0.0 } else { (factor * error).powi(2) };
            let cross = if (a * b).abs() < 1e-12 || !both.is_finite() { 0.0 } else { 2.0 * a * b * both };
            (part(a, error(1)) + part(b, across) + cross).max(0.0).sqrt()
        };
        let readings = fit.plain.len();
        let square: f64 = fit.plain.iter().map(|r| r.residual * r.residual).sum();
        let mut out = GlossSampleFit {
            lobe: self.problem.lobe(&fit.p),
            rho_d: fit.solved.rho_d.clone(),
            rho_s: fit.solved.rho_s,
            m,
            tilt: self.tilts(),
            rms: (square / readings as f64).sqrt(),
            rho_d_err: (0..bands).map(&widened).collect(),
            rho_s_err: widened(bands),
            m_err: m * error(0),
            tilt_err: [mixed(cos, -sin), mixed(sin, cos)],
            index_err: error(3),
            readings,
            misfit: self.judgement.why.clone(),
            taken: self.taken.clone(),
            rival: None,
            evidence: Vec::new(),
            tied: Vec::new(),
            better: None,
        };
        out.rival = self.rival(&out);
        out
    }

    /// Another minimum that explains the readings as well (within three standard deviations).
    fn rival(&self, found: &GlossSampleFit) -> Option<String> {
        let best = self.fit.common.sum() + self.fit.contrasts.sum();
        let freedom = (self.fit.plain.len() - self.problem.bands - 1 - self.fit.live.len()).max(1) as f64;
        let far = |value: f64, other: f64, error: f64| (value - other).abs() > 2.5 * error;
        let other = self.rivals.iter().filter(|r| r.0 < best * (1.0 + 9.0 / freedom)).find(|(_, p)| {
            let tilts = self.problem.tilts(p);
            far(found.m, p[0].exp(), found.m_err) || (0..2).any(|k| far(found.tilt[k], tilts[k], found.tilt_err[k]))
        })?;
        let [tilt, tilt_y] = self.problem.tilts(&other.1);
        Some(format!("m {:.3}, tilt {tilt:.3} and tilt_y {tilt_y:.3} explain the readings as well", other.1[0].exp()))
    }
}

/// Residuals whose root mean square is below this are rounding of the table or of the arithmetic.
fn floor(samples: &[GlossSample]) -> f64 {
    let most = samples.iter().flat_map(|s| &s.values).filter(|v| v.is_finite()).fold(0.0f64, |a, v| a.max(v.abs()));
    (0.5 * scatter::rounding(samples)).max(1e-7 * most)
}

/// The azimuth (rad) of the plane in which all directions lie, if they do.
fn plane(samples: &[GlossSample]) -> Option<f64> {
    let directions = || samples.iter().flat_map(|s| [s.light, s.view]);
    let [xx, xy, yy] = directions().fold([0.0; 3], |a, d| [a[0] + d[0] * d[0], a[1] + d[0] * d[1], a[2] + d[1] * d[1]]);
    let turn = snapped(0.5 * (2.0 * xy).atan2(xx - yy));
    let across = [-turn.sin(), turn.cos(), 0.0];
    directions().all(|d| dot(d, across).abs() < PLANE).then_some(turn)
}

/// The azimuth of the tilt that is shown where the tilt across it is not.
fn unseen(problem: &Problem, fit: &Residuals) -> Option<f64> {
    let at = |k: usize| fit.live.iter().position(|c| *c == k).map(|k| problem.bands + 1 + k);
    let (a, b) = (at(1)?, at(2)?);
    let cov = |i: usize, j: usize| fit.covariance[(i, j)];
    let (xx, xy, yy) = (cov(a, a), cov(a, b), cov(b, b));
    if !(xx.is_finite() && yy.is_finite()) {
        // The matrix is singular. Without gloss neither tilt is shown, and there is nothing to hold.
        return (fit.solved.rho_s > 0.0).then_some(0.0);
    }
    // The axis with the largest error is the one across.
    let worst = 0.5 * (2.0 * xy).atan2(xx - yy);
    let (sin, cos) = worst.sin_cos();
    let most = xx * cos * cos + 2.0 * xy * sin * cos + yy * sin * sin;
    let least = xx * sin * sin - 2.0 * xy * sin * cos + yy * cos * cos;
    (most.sqrt() > UNSEEN && least.sqrt() < UNSEEN).then(|| snapped(worst - std::f64::consts::FRAC_PI_2))
}

/// An azimuth of a line (rad), within (−π/2, π/2]; one that differs from an axis by rounding is that axis.
fn snapped(turn: f64) -> f64 {
    let quarter = std::f64::consts::FRAC_PI_2;
    let turn = if turn > quarter + 1e-9 {
        turn - 2.0 * quarter
    } else if turn <= -quarter + 1e-9 {
        turn + 2.0 * quarter
    } else {
        turn
    };
    [0.0, quarter].into_iter().find(|axis| (turn - axis).abs() < 1e-6).unwrap_or(turn)
}
