//! Gloss from goniometer samples of a leaf: reflectance factors at many directions for one or few sources.
//!
//! The model is value_k = ρd_k + π ρs f_s(n, l, v; m) for every value column k (the values are BRF = π f_r). ρs is the
//! same for all columns (grey), and so are the slope m and the normal. ρd_k ≥ 0 and ρs ≥ 0 are linear and eliminated.
//! m, tilt and tilt_y are searched globally: first a grid over all three, then argmin's Nelder–Mead from the best
//! distinct grid points, then Levenberg–Marquardt from the winner, which gives the last digits and the errors.
//!
//! The errors are computed from the scatter of the residuals. They hold only where the lobe describes the leaf, so
//! every fit is judged ([`judge`]) and compared with the other lobes; where it fails, nothing is promised. Where the
//! scatter plainly grows with the reading, readings are weighted by it ([`scatter`]).

mod batch;
mod columns;
mod judge;
mod leaf;
mod scatter;
mod search;
#[cfg(test)]
mod tests;
mod verdict;

pub use batch::{answer, leaves, outputs, run};
pub use columns::sample;

use leaf::Leaf;
use mesophyll_optics::gloss::{Lobe, LobeKind};
use search::at_end;
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoEnumIterator, IntoStaticStr};

/// One direction.
#[derive(Debug, Clone, PartialEq)]
pub struct GlossSample {
    /// Unit vector towards the source; z points out of the leaf.
    pub light: [f64; 3],
    /// Unit vector towards the viewer.
    pub view: [f64; 3],
    /// Reflectance factors, NaN = no reading.
    pub values: Vec<f64>,
}

/// A leaf that was read in many directions.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredGloss {
    /// Its name.
    pub name: String,
    /// Its readings.
    pub samples: Vec<GlossSample>,
}

impl GlossSample {
    /// The source is at azimuth 0 in the x–z plane, so that view azimuth 180° is the side of the mirror direction.
    /// Angles in radians; a negative zenith angle lies at the opposite azimuth.
    pub fn from_angles(source_zenith: f64, view_zenith: f64, view_azimuth: f64, values: Vec<f64>) -> GlossSample {
        GlossSample::between([source_zenith, 0.0], [view_zenith, view_azimuth], values)
    }

    /// The same with a source at any azimuth: zenith and azimuth of the source, and of the view (rad).
    pub fn between(source: [f64; 2], view: [f64; 2], values: Vec<f64>) -> GlossSample {
        let dir = |[t, p]: [f64; 2]| [t.sin() * p.cos(), t.sin() * p.sin(), t.cos()];
        GlossSample { light: dir(source), view: dir(view), values }
    }
}

/// Which lobe is fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LobeChoice {
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
pub enum TiltChoice {
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
pub struct GlossFitSettings {
    /// The lobe.
    pub surface: LobeChoice,
    /// Index of refraction of lobes that have one; `None`: it is fitted, between the two of [`INDICES`].
    pub index: Option<f64>,
    /// Which tilts are fitted.
    pub tilts: TiltChoice,
    /// The view azimuth of the mirror side (degrees, 0 or 180) where it was stated; then large tilts are believed.
    pub mirror_azimuth: Option<u16>,
    /// Whether readings are per cent.
    pub percent: bool,
}

impl Default for GlossFitSettings {
    fn default() -> GlossFitSettings {
        GlossFitSettings {
            surface: LobeChoice::Usual,
            index: Some(INDEX),
            tilts: TiltChoice::Free,
            mirror_azimuth: None,
            percent: false,
        }
    }
}

/// A fitted leaf; errors are one standard deviation.
#[derive(Debug, Clone, PartialEq)]
pub struct GlossSampleFit {
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
    /// Lobes with about as much evidence, where nobody stated the lobe; their values have widened the errors.
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

/// Fits one leaf.
///
/// # Errors
/// A reason in words where there are too few readings.
pub fn fit(samples: &[GlossSample], settings: &GlossFitSettings) -> std::result::Result<GlossSampleFit, String> {
    let bands = samples.first().map_or(0, |s| s.values.len());
    if let Some(k) = (0..bands).find(|&k| samples.iter().all(|s| !s.values[k].is_finite())) {
        return Err(format!("value column {} has no reading", k + 1));
    }
    let wanted = match settings.surface {
        LobeChoice::Of(kind) => Some(kind),
        LobeChoice::Usual => Some(LobeKind::Beckmann),
        LobeChoice::Auto => None,
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
    if settings.surface == LobeChoice::Usual {
        // Nobody stated the lobe. Where another one describes the leaf as well, it may be that. What ρs means depends
        // on the lobe, so its error stays that of this one.
        let as_well = |k: &usize| (-TIED..=FAR_BETTER).contains(&(evidence[*k] - evidence[chosen])) && *k != chosen;
        let rho_s_err = out.rho_s_err;
        for k in (0..all.len()).filter(as_well) {
            out.tied.push(all[k].0);
            out.hold(&all[k].1.report());
        }
        out.rho_s_err = rho_s_err;
    }
    out.ask_index(samples, all[chosen].0, settings, evidence[chosen]);
    out.evidence = evidence;
    Ok(out)
}

impl GlossSampleFit {
    /// Whether the readings speak against the usual index of refraction, which was taken for granted: far better with
    /// another one, they are not described; better, the errors hold what it would change.
    fn ask_index(&mut self, samples: &[GlossSample], kind: LobeKind, settings: &GlossFitSettings, evidence: f64) {
        if settings.index != Some(INDEX) || self.lobe.index().is_none() {
            return;
        }
        let free = GlossFitSettings { index: None, ..settings.clone() };
        let Ok(leaf) = Leaf::fit(samples, self.rho_d.len(), kind, &free) else { return };
        let (gain, found) = (leaf.evidence() - evidence, leaf.report());
        if gain > FAR_BETTER {
            let (index, error) = (found.lobe.index().unwrap_or(INDEX), found.index_err);
            let asks = format!(
                "the readings ask for an index of refraction of {index:.3} ± {error:.3} where {INDEX} is taken; \
                 --index fit finds it"
            );
            self.misfit = Some(self.misfit.take().map_or(asks.clone(), |why| format!("{why}; {asks}")));
        } else if gain > 0.0 {
            let stated = self.index_err;
            self.hold(&found);
            self.index_err = stated;
        }
    }

    /// Widens every error so that it holds the value of another description of the same leaf.
    fn hold(&mut self, other: &GlossSampleFit) {
        let widen = |error: &mut f64, a: f64, b: f64| *error = error.hypot(a - b);
        for ((error, a), b) in self.rho_d_err.iter_mut().zip(&self.rho_d).zip(&other.rho_d) {
            widen(error, *a, *b);
        }
        widen(&mut self.rho_s_err, self.rho_s, other.rho_s);
        widen(&mut self.m_err, self.m, other.m);
        for k in 0..2 {
            widen(&mut self.tilt_err[k], self.tilt[k], other.tilt[k]);
        }
        if let (Some(a), Some(b)) = (self.lobe.index(), other.lobe.index()) {
            widen(&mut self.index_err, a, b);
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
