//! Gloss of one texel from its traces under a linear light source (W §3 "Fitting BRDF and BTDF"; G3). Each channel has
//! a diffuse reflectance ρd and a gloss reflectance ρs. Both enter linearly and are eliminated by variable projection.
//! The channels share the slope m of the gloss and the normal.
//!
//! A single pass of the tube shows only the tilt in its plane of travel; a second pass makes the full normal known. The
//! noise has the standard deviation √((relative·value)² + floor²). It is evaluated at the model's value, not at the
//! noisy sample, so that the weights cause no bias.

mod covariance;
pub mod geometry;
mod outliers;
mod projection;
mod report;
pub mod samples;
mod start;
pub mod synthetic;
mod texel;

pub use texel::{GlossFitStart, GlossFitWorkspace, GlossTexelFitter};

use mesophyll_base::rgb::Rgb;
use mesophyll_base::solvers::Termination;
use mesophyll_files::table::{OutputRow, Status};
use mesophyll_optics::gloss::Lobe;
use mesophyll_optics::tube::Tube;
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};

/// What a fit needs to know about the device. Lengths in mm.
#[derive(Debug, Clone, PartialEq)]
pub struct GlossFitDevice {
    /// Height of the tube's axis over the blade.
    pub height_mm: f64,
    /// Lit length, centred on the blade.
    pub length_mm: f64,
    /// Radius of the tube; 0 is a thin one.
    pub radius_mm: f64,
    /// Unit vector towards the camera, z up.
    pub camera: [f64; 3],
    /// The gloss lobe that texels are fitted with.
    pub lobe: Lobe,
    /// Standard deviation of a sample: √((noise_relative·value)² + noise_floor²).
    pub noise_relative: f64,
    /// The part of the noise that does not grow with the value.
    pub noise_floor: f64,
}

impl GlossFitDevice {
    /// The tube alone.
    pub fn tube(&self) -> Tube {
        Tube { height_mm: self.height_mm, length_mm: self.length_mm, radius_mm: self.radius_mm }
    }

    /// The noise of readings that were neither divided by a white sheet nor had a dark frame subtracted.
    pub fn noise(&self) -> ReadingNoise {
        ReadingNoise {
            relative: self.noise_relative,
            floor: Rgb::splat(self.noise_floor),
            dark: Rgb::default(),
            dark_error: Rgb::default(),
        }
    }
}

/// Noise of one texel's calibrated readings. A reading of value v in channel c has the standard deviation
/// √((relative·(v + dark_c))² + floor_c²). In addition, all readings of a channel share one unknown error of the dark
/// level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReadingNoise {
    /// The part of the noise that grows with the signal, as a share of it.
    pub relative: f64,
    /// The part of the noise that does not depend on the signal, a channel each.
    pub floor: Rgb,
    /// The dark level that was subtracted from the readings. This part of the signal does not depend on light, but it
    /// has noise.
    pub dark: Rgb,
    /// Standard deviation of that dark level as measured. It is not fitted; it widens the errors.
    pub dark_error: Rgb,
}

impl ReadingNoise {
    /// The three numbers from which the variance in channel `c` is computed: relative, dark, floor. The floor is kept
    /// above zero, because a zero floor would give a reading of exactly zero an infinite weight.
    pub fn terms(&self, c: usize) -> [f64; 3] {
        [self.relative, self.dark[c], self.floor[c].max(1e-6)]
    }

    /// Variance of a reading of `value` in channel `c`.
    pub fn variance(&self, c: usize, value: f64) -> f64 {
        let [relative, dark, floor] = self.terms(c);
        (relative * (value + dark)).powi(2) + floor * floor
    }
}

/// When samples are reweighted against outliers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum RobustWeighting {
    /// Never.
    Off,
    /// Only where the first fit leaves residuals that the stated noise does not explain.
    #[default]
    Auto,
    /// Always.
    On,
}

/// A set of parameters that the data do not determine within 10 % (tilts: within 2°).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct UndeterminedSet(pub u16);

impl UndeterminedSet {
    /// Diffuse reflectance, a channel each.
    pub const RHO_D: [UndeterminedSet; 3] = [UndeterminedSet(1), UndeterminedSet(2), UndeterminedSet(4)];
    /// Gloss reflectance, a channel each.
    pub const RHO_S: [UndeterminedSet; 3] = [UndeterminedSet(8), UndeterminedSet(16), UndeterminedSet(32)];
    /// Slope of the gloss.
    pub const M: UndeterminedSet = UndeterminedSet(64);
    /// Tilt in the plane x–z.
    pub const TILT: UndeterminedSet = UndeterminedSet(128);
    /// Tilt out of that plane; it can be in the set only where there was a second pass.
    pub const TILT_Y: UndeterminedSet = UndeterminedSet(256);

    /// Whether all of `other` is in the set.
    pub fn contains(self, other: UndeterminedSet) -> bool {
        self.0 & other.0 == other.0
    }
    /// Adds all of `other` to the set.
    pub fn insert(&mut self, other: UndeterminedSet) {
        self.0 |= other.0;
    }
    /// Whether everything is determined.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Every parameter of a one-pass fit.
    pub fn all(channels: usize) -> UndeterminedSet {
        UndeterminedSet(if channels == 1 { 1 | 8 | 64 | 128 } else { 255 })
    }

    /// Names as in the output columns; `channels` is 1 or 3.
    pub fn names(self, channels: usize) -> Vec<&'static str> {
        const NAMES: [&str; 9] =
            ["rho_d_r", "rho_d_g", "rho_d_b", "rho_s_r", "rho_s_g", "rho_s_b", "m", "tilt", "tilt_y"];
        let name = |k: usize| match (channels, k) {
            (1, 0) => "rho_d",
            (1, 3) => "rho_s",
            _ => NAMES[k],
        };
        (0..9).filter(|k| self.0 >> k & 1 == 1).map(name).collect()
    }
}

/// A fitted texel. Errors are one standard deviation; infinite where nothing is known.
#[derive(Debug, Clone, PartialEq)]
pub struct GlossTexelFit {
    /// Diffuse reflectance ρd, a channel each.
    pub rho_d: [f64; 3],
    /// Gloss reflectance ρs, a channel each.
    pub rho_s: [f64; 3],
    /// Slope m of the gloss, within [`M_RANGE`].
    pub m: f64,
    /// Unit normal (sin tilt cos tilt_y, sin tilt_y, cos tilt cos tilt_y); tilt_y = 0 without a second pass.
    pub normal: [f64; 3],
    /// Tilt in the plane x–z and out of it (rad).
    pub tilt: [f64; 2],
    /// Standard error of ρd, a channel each.
    pub rho_d_err: [f64; 3],
    /// The part of `rho_d_err` that comes from an error of the channel's own dark level, with its sign. It is the
    /// change of ρd when every reading of the channel is one standard deviation of the dark level too high.
    pub rho_d_by_dark: [f64; 3],
    /// Standard error of ρs, a channel each.
    pub rho_s_err: [f64; 3],
    /// Standard error of the slope m.
    pub m_err: f64,
    /// Standard errors of the normal's components.
    pub normal_err: [f64; 3],
    /// Standard errors of the two tilts (rad); infinite for a tilt that no pass shows.
    pub tilt_err: [f64; 2],
    /// Correlation of ρd and ρs, worst channel.
    pub correlation: f64,
    /// Σ (residual/sd)² over the samples used.
    pub chi2: f64,
    /// Samples used.
    pub samples: usize,
    /// Parameters fitted.
    pub parameters: usize,
    /// Samples that robust weighting took for outliers.
    pub outliers: usize,
    /// Condition number of the scaled normal matrix of ln m and the tilts.
    pub condition: f64,
    /// Steps of all descents together.
    pub iterations: usize,
    /// How often the model was evaluated.
    pub evaluations: usize,
    /// How the last descent ended.
    pub termination: Termination,
    /// Which parameters the samples do not determine.
    pub undetermined: UndeterminedSet,
    /// Why the texel is not to be trusted, if so.
    pub defect: Option<&'static str>,
}

/// Defect: the descent did not come to an end.
pub const NOT_CONVERGED: &str = "not converged";
/// Defect: χ² is larger than noise makes it.
pub const NOT_EXPLAINED: &str = "residuals exceed the noise";
/// Defect: two different lobes fit equally well.
pub const AMBIGUOUS: &str = "two lobes fit equally well";
/// Defect: no sample stands out of the noise.
pub const NO_LIGHT: &str = "no light above the noise";
/// Defect: the lobe falls between two frames.
pub const NARROW: &str = "lobe narrower than two frames";

/// Range of m (bounds of the fit).
pub const M_RANGE: [f64; 2] = [0.005, 1.2];
/// Range of either tilt (rad).
pub const TILT_LIMIT: f64 = 1.05;

impl GlossTexelFit {
    /// A texel that cannot be fitted at all.
    pub fn refused(why: &'static str) -> GlossTexelFit {
        GlossTexelFit {
            rho_d: [f64::NAN; 3],
            rho_s: [f64::NAN; 3],
            m: f64::NAN,
            normal: [f64::NAN; 3],
            tilt: [f64::NAN; 2],
            rho_d_err: [f64::INFINITY; 3],
            rho_d_by_dark: [0.0; 3],
            rho_s_err: [f64::INFINITY; 3],
            m_err: f64::INFINITY,
            normal_err: [f64::INFINITY; 3],
            tilt_err: [f64::INFINITY; 2],
            correlation: f64::NAN,
            chi2: f64::NAN,
            samples: 0,
            parameters: 0,
            outliers: 0,
            condition: f64::INFINITY,
            iterations: 0,
            evaluations: 0,
            termination: Termination::Refused,
            undetermined: UndeterminedSet(0),
            defect: Some(why),
        }
    }

    /// The verdict as batches print it, for `channels` (1 or 3) channels. `ok` promises that every value is determined.
    pub fn status(&self, channels: usize) -> Status {
        if self.termination == Termination::Refused {
            return Status::Refused(self.defect.unwrap_or("no fit").into());
        }
        let mut names = self.undetermined;
        for c in (0..channels.min(3)).filter(|&c| self.rho_d[c].is_nan()) {
            // The channel has no reading.
            names.insert(UndeterminedSet::RHO_D[c]);
            names.insert(UndeterminedSet::RHO_S[c]);
        }
        if matches!(self.defect, Some(NOT_CONVERGED | NOT_EXPLAINED | AMBIGUOUS)) {
            // Something is wrong with the texel, so none of its numbers is promised.
            names = UndeterminedSet::all(channels);
        }
        Status::undetermined(names.names(channels), self.defect.unwrap_or_default())
    }

    /// Output columns of [`GlossTexelFit::answer`] for `channels` (1 or 3) channels: values, their errors, `chi2`.
    pub fn outputs(channels: usize) -> Vec<String> {
        let names: &[&str] = if channels == 1 {
            &["rho_d", "rho_s", "m", "tilt"]
        } else {
            &["rho_d_r", "rho_d_g", "rho_d_b", "rho_s_r", "rho_s_g", "rho_s_b", "m", "tilt"]
        };
        let errors = names.iter().map(|n| format!("{n}_err"));
        names.iter().map(|n| n.to_string()).chain(errors).chain(["chi2".into()]).collect()
    }

    /// The texel as the row of a batch.
    pub fn answer(&self, channels: usize) -> OutputRow {
        if self.termination == Termination::Refused {
            return OutputRow::refused(self.defect.unwrap_or("no fit"));
        }
        let mut values = Vec::with_capacity(17);
        let mut push = |d: &[f64; 3], s: &[f64; 3], m: f64, tilt: f64| {
            values.extend_from_slice(&d[..channels]);
            values.extend_from_slice(&s[..channels]);
            values.extend([m, tilt]);
        };
        push(&self.rho_d, &self.rho_s, self.m, self.tilt[0]);
        push(&self.rho_d_err, &self.rho_s_err, self.m_err, self.tilt_err[0]);
        values.push(self.chi2);
        OutputRow { values, status: self.status(channels) }
    }

    /// The same for a trace of a table, of which it was asked whether the lobe describes it
    /// ([`GlossTexelFitter::judge`]).
    pub fn judged(mut self, found: Option<&mesophyll_base::solvers::adequacy::Adequacy>, channels: usize) -> OutputRow {
        let why = found.and_then(|found| self.doubted(found));
        let answer = self.answer(channels);
        match why {
            // A defect that was found before says as much.
            Some(why) if !matches!(self.defect, Some(NOT_CONVERGED | NOT_EXPLAINED | AMBIGUOUS)) => {
                let names = UndeterminedSet::all(channels).names(channels);
                OutputRow { status: Status::undetermined(names, &why), ..answer }
            }
            _ => answer,
        }
    }

    /// χ² over the degrees of freedom: about 1 where the model and the stated noise are right.
    pub fn reduced_chi2(&self) -> f64 {
        self.chi2 / (self.samples.saturating_sub(self.parameters)).max(1) as f64
    }
}

/// (sin tilt cos tilt_y, sin tilt_y, cos tilt cos tilt_y).
pub fn normal_of(tilt: [f64; 2]) -> [f64; 3] {
    let ((s, c), (sy, cy)) = (tilt[0].sin_cos(), tilt[1].sin_cos());
    [s * cy, sy, c * cy]
}

/// ∂normal/∂tilt and ∂normal/∂tilt_y.
pub fn normal_slopes(tilt: [f64; 2]) -> [[f64; 3]; 2] {
    let ((s, c), (sy, cy)) = (tilt[0].sin_cos(), tilt[1].sin_cos());
    [[c * cy, 0.0, -s * cy], [-s * sy, cy, -c * sy]]
}
