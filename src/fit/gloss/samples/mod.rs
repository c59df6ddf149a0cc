//! Gloss from goniometer samples of a leaf: reflectance factors at many directions for one or few sources.
//!
//! The model is value_k = ρd_k + π ρs f_s(n, l, v; m) for every value column k (the values are BRF = π f_r). ρs is the
//! same for all columns (grey), and so are the slope m and the normal. ρd_k ≥ 0 and ρs ≥ 0 are linear and eliminated.
//! m, tilt and tilt_y are searched globally: first a grid over all three, then argmin's Nelder–Mead from the best
//! distinct grid points, then Levenberg–Marquardt from the winner, which gives the last digits and the errors.
//!
//! The errors are computed from the scatter of the residuals. They hold only where the lobe describes the leaf, so every
//! fit is judged ([`judge`]) and compared with the other lobes; where it fails, nothing is promised. Where the scatter
//! plainly grows with the reading, readings are weighted by it ([`scatter`]).

mod batch;
mod columns;
mod judge;
mod scatter;
mod search;
#[cfg(test)]
mod tests;
mod verdict;

pub use batch::{answer, outputs, run};
pub use columns::sample;

use judge::Judgement;
use mesophyll_optics::gloss::{Lobe, LobeKind, dot};
use scatter::Residuals;
use search::{Point, Problem, at_end, even};
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoEnumIterator, IntoStaticStr};

/// One direction.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Unit vector towards the source; z points out of the leaf.
    pub light: [f64; 3],
    /// Unit vector towards the viewer.
    pub view: [f64; 3],
    /// Reflectance factors, NaN = no reading.
    pub values: Vec<f64>,
}

impl Sample {
    /// The source is at azimuth 0 in the x–z plane, so that view azimuth 180° is the side of the mirror direction.
    /// Angles in radians; a negative zenith angle lies at the opposite azimuth.
    pub fn from_angles(source_zenith: f64, view_zenith: f64, view_azimuth: f64, values: Vec<f64>) -> Sample {
        Sample::between([source_zenith, 0.0], [view_zenith, view_azimuth], values)
    }

    /// The same with a source at any azimuth: zenith and azimuth of the source, and of the view (rad).
    pub fn between(source: [f64; 2], view: [f64; 2], values: Vec<f64>) -> Sample {
        let dir = |[t, p]: [f64; 2]| [t.sin() * p.cos(), t.sin() * p.sin(), t.cos()];
        Sample { light: dir(source), view: dir(view), values }
    }
}

/// Which lobe is fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Surface {
    /// Beckmann's, because nothing else was said.
    #[default]
    Usual,
    /// The one that was asked for.
    Of(LobeKind),
    /// The one that describes the leaf best.
    Auto,
}

/// Which tilts of the normal are fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum Tilts {
    /// Both; but the tilt across a scan in one plane, which no reading shows, is taken as 0 and named
    #[default]
    Free,
    /// In the plane of azimuth 0 only; tilt_y is 0
    Along,
    /// None: the leaf lies level
    #[strum(serialize = "0")]
    Level,
}

/// How leaves are fitted.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The lobe.
    pub surface: Surface,
    /// Index of refraction of lobes that have one; `None`: it is fitted, between the two of [`INDICES`].
    pub index: Option<f64>,
    /// Which tilts are fitted.
    pub tilts: Tilts,
    /// The view azimuth of the mirror side (degrees, 0 or 180) where it was stated; then large tilts are believed.
    pub mirror_azimuth: Option<u16>,
    /// Whether readings are per cent.
    pub percent: bool,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            surface: Surface::Usual,
            index: Some(INDEX),
            tilts: Tilts::Free,
            mirror_azimuth: None,
            percent: false,
        }
    }
}

/// A fitted leaf; errors are one standard deviation.
#[derive(Debug, Clone, PartialEq)]
pub struct SamplesFit {
    /// The lobe; with the fitted index where it was fitted.
    pub lobe: Lobe,
    /// Diffuse reflectance ρd, a value column each.
    pub rho_d: Vec<f64>,
    /// Gloss reflectance ρs, the same for all columns.
    pub rho_s: f64,
    /// Slope of the gloss, the same for all columns.
    pub m: f64,
    /// tilt, tilt_y (rad); normal = (sin tilt cos tilt_y, sin tilt_y, cos tilt cos tilt_y).
    pub tilt: [f64; 2],
    /// Root mean square of all residuals.
    pub rms: f64,
    /// Standard error of ρd, a value column each.
    pub rho_d_err: Vec<f64>,
    /// Standard error of ρs.
    pub rho_s_err: f64,
    /// Standard error of the slope.
    pub m_err: f64,
    /// Standard errors of tilt and tilt_y (rad); 0 for one that was stated.
    pub tilt_err: [f64; 2],
    /// Standard error of the index of refraction; 0 where it was stated or the lobe has none.
    pub index_err: f64,
    /// Readings used.
    pub readings: usize,
    /// Why the lobe does not describe the leaf, as a part of a sentence; `None` where it does.
    pub misfit: Option<String>,
    /// What was taken for granted of the normal because no reading shows it, as a sentence; `None` where all is shown.
    pub taken: Option<String>,
    /// A different solution that explains the readings as well, as a part of a sentence.
    pub rival: Option<String>,
    /// Logarithm of the evidence of each lobe, in the order of [`LobeKind`]: the likelihood of the readings with the
    /// noise at its best, less ½ ln n for each parameter. Only differences mean something; NaN: not computed.
    pub evidence: Vec<f64>,
    /// Lobes with as much evidence, where the lobe was chosen by it; their values have widened the errors.
    pub tied: Vec<LobeKind>,
    /// The lobe that describes the leaf far better, and whether it describes it to its noise.
    pub better: Option<(LobeKind, bool)>,
}

/// Largest tilt that is searched (rad).
const TILT: f64 = 0.8;
/// Index of refraction where none is stated: of a leaf's wax.
pub const INDEX: f64 = 1.45;
/// Least and largest index of refraction that is fitted.
pub const INDICES: [f64; 2] = [1.2, 1.7];
/// A lobe is far better where the readings are this much likelier with it (ln 1000).
const FAR_BETTER: f64 = 6.9;
/// Lobes are tied where the readings are not this much likelier with one of them (ln 20).
const TIED: f64 = 3.0;
/// Noise that is a larger share of the reading than this is no noise of an instrument.
const SCATTER: f64 = 0.1;
/// All directions within this angle of one plane (rad) are a scan in that plane.
const PLANE: f64 = 0.0175;
/// A tilt that is known worse than this (rad) is taken as 0, because leaves lie flatter than it tells.
const UNSEEN: f64 = 0.2;

/// Fits one leaf.
///
/// # Errors
/// A reason in words where there are too few readings.
pub fn fit(samples: &[Sample], settings: &Settings) -> std::result::Result<SamplesFit, String> {
    let bands = samples.first().map_or(0, |s| s.values.len());
    if let Some(k) = (0..bands).find(|&k| samples.iter().all(|s| !s.values[k].is_finite())) {
        return Err(format!("value column {} has no reading", k + 1));
    }
    let wanted = match settings.surface {
        Surface::Of(kind) => Some(kind),
        Surface::Usual => Some(LobeKind::Beckmann),
        Surface::Auto => None,
    };
    let all: Vec<(LobeKind, Leaf)> = LobeKind::iter()
        .map(|kind| Ok((kind, Leaf::fit(samples, bands, kind, settings)?)))
        .collect::<std::result::Result<_, String>>()?;
    let evidence: Vec<f64> = all.iter().map(|(_, leaf)| leaf.evidence()).collect();
    let best = (0..all.len()).max_by(|a, b| evidence[*a].total_cmp(&evidence[*b])).unwrap_or(0);
    let chosen = wanted.and_then(|kind| all.iter().position(|(k, _)| *k == kind)).unwrap_or(best);
    let leaf = &all[chosen].1;
    let mut out = leaf.report();
    if evidence[best] - evidence[chosen] > FAR_BETTER {
        out.better = Some((all[best].0, all[best].1.judgement.why.is_none()));
    }
    if wanted.is_none() {
        for k in (0..all.len()).filter(|k| *k != chosen && evidence[chosen] - evidence[*k] < TIED) {
            out.tied.push(all[k].0);
            out.hold(&all[k].1.report());
        }
    }
    out.evidence = evidence;
    Ok(out)
}

/// A leaf with one lobe.
struct Leaf<'a> {
    problem: Problem<'a>,
    fit: Residuals,
    judgement: Judgement,
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
    fn fit(samples: &'a [Sample], bands: usize, kind: LobeKind, settings: &Settings) -> std::result::Result<Self, String> {
        let fit_index = settings.index.is_none() && kind.has_index();
        let mut problem = Problem {
            samples,
            kind,
            bands,
            weights: even(samples),
            turn: 0.0,
            free: [true, settings.tilts != Tilts::Level, settings.tilts == Tilts::Free, fit_index],
            index: settings.index.unwrap_or(INDEX),
        };
        let mut level = Level::Stated;
        if settings.tilts == Tilts::Free
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
            && settings.tilts == Tilts::Free
            && let Some(turn) = unseen(&problem, &fit)
        {
            (problem.turn, problem.free[2], level) = (turn, false, Level::Taken);
            ends = problem.search();
            fit = Residuals::at(&problem, &ends[0].1, floor);
        }
        let mut leaf = Leaf { taken: None, rivals: ends.split_off(1), judgement: Judgement::default(), problem, fit, level };
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
            let widening = std::mem::take(&mut self.judgement.widening);
            self.judgement = Judgement { why: judgement.why, widening };
        }
    }

    /// Logarithm of the evidence (Schwarz 1978: −BIC/2).
    fn evidence(&self) -> f64 {
        self.fit.likelihood - 0.5 * self.fit.live.len() as f64 * (self.fit.common.r.len() as f64).ln()
    }

    /// What a tilt across would do, as a sentence.
    fn across(&self) -> String {
        const TRIED: f64 = 5.0;
        let tilted = Problem { ..self.problem.clone() };
        let mut start = self.fit.p;
        start[2] = TRIED.to_radians();
        let there = tilted.descend([start].into_iter());
        let rho_s = tilted.at(&there[0].1).rho_s;
        let change = 100.0 * (rho_s / self.fit.solved.rho_s - 1.0);
        let told = if change.is_finite() {
            format!("; {TRIED:.0} degrees would change rho_s by {change:+.1} %")
        } else {
            String::new()
        };
        format!("the readings do not show the tilt across the plane of the scan, which is taken as 0{told}")
    }

    fn report(&self) -> SamplesFit {
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
        let mut out = SamplesFit {
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
    fn rival(&self, found: &SamplesFit) -> Option<String> {
        let best = self.fit.common.sum() + self.fit.contrasts.sum();
        let freedom = (self.fit.plain.len() - self.problem.bands - 1 - self.fit.live.len()).max(1) as f64;
        let far = |value: f64, other: f64, error: f64| (value - other).abs() > 2.5 * error;
        let other = self.rivals.iter().filter(|r| r.0 < best * (1.0 + 9.0 / freedom)).find(|(_, p)| {
            let tilts = self.problem.tilts(p);
            far(found.m, p[0].exp(), found.m_err) || (0..2).any(|k| far(found.tilt[k], tilts[k], found.tilt_err[k]))
        })?;
        let [tilt, tilt_y] = self.problem.tilts(&other.1);
        Some(format!(
            "m {:.3}, tilt {tilt:.3} and tilt_y {tilt_y:.3} explain the readings as well",
            other.1[0].exp()
        ))
    }
}

impl SamplesFit {
    /// Widens every error so that it holds the value of another description of the same leaf.
    fn hold(&mut self, other: &SamplesFit) {
        let widen = |error: &mut f64, a: f64, b: f64| *error = error.hypot(a - b);
        for ((error, a), b) in self.rho_d_err.iter_mut().zip(&self.rho_d).zip(&other.rho_d) {
            widen(error, *a, *b);
        }
        widen(&mut self.rho_s_err, self.rho_s, other.rho_s);
        widen(&mut self.m_err, self.m, other.m);
        for k in 0..2 {
            widen(&mut self.tilt_err[k], self.tilt[k], other.tilt[k]);
        }
    }

    /// The angle between the normal and the vertical (rad).
    pub fn leaning(&self) -> f64 {
        (self.tilt[0].cos() * self.tilt[1].cos()).clamp(-1.0, 1.0).acos()
    }

    /// Whether the slope or the index lies at an end of what is searched.
    fn ends(&self) -> [bool; 2] {
        let range = crate::gloss::M_RANGE;
        let slope = self.m <= 1.0001 * range[0] || self.m >= 0.9999 * range[1];
        [slope, self.index_err != 0.0 && self.lobe.index().is_some_and(at_end)]
    }
}

/// Residuals whose root mean square is below this are rounding of the table or of the arithmetic.
fn floor(samples: &[Sample]) -> f64 {
    let most = samples.iter().flat_map(|s| &s.values).filter(|v| v.is_finite()).fold(0.0f64, |a, v| a.max(v.abs()));
    (0.5 * scatter::rounding(samples)).max(1e-7 * most)
}

/// The azimuth (rad) of the plane in which all directions lie, if they do.
fn plane(samples: &[Sample]) -> Option<f64> {
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
