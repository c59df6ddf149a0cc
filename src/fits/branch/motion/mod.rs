//! How a branch sways: resonance, damping and gain from its measured deflections.
//!
//! A branch in gusts is an oscillator that is pushed at random: its tip's deflection has the one-sided power density
//!
//! ```text
//! S(f) = G² R(f)² (1 + f/v)^(−5/3),      R(f) = 2π f_h² / √((2π(f_h² − f²))² + (f γ)²)
//! ```
//!
//! (H9 Eq. 4.15 and 4.16, with the denominator that the equation of motion gives;
//! [`mesophyll_plants::mechanics::wind`]). f_h is the resonance (Hz), γ the damping (1/s), v the wind's mean speed
//! (m/s; the f/v of Eq. 4.15 means f · 1 m/v), and G the gain: √S at low frequencies (mm/√Hz). v is also fitted where
//! it is not given.
//!
//! The estimate is that of P. Whittle, "Estimation and information in stationary time series", Ark. Mat. 2 (1953),
//! 423–434. The periodogram I_k at each frequency is about exponentially distributed around its mean E_k, so Σ ln E_k +
//! I_k/E_k is minimised. E_k is not S(f_k), because a record of finite length and step, with gaps, leaks and folds. It
//! is computed from the autocovariance (A. M. Sykulski et al., "The debiased Whittle likelihood", Biometrika 106
//! (2019), 251–266; with gaps: A. P. Guillaumin et al., "The debiased spatial Whittle likelihood", J. R. Stat. Soc. B
//! 84 (2022), 1526–1557). With ρ = I/E, the sum is written as squares of residuals ±√(2(ρ − 1 − ln ρ)), so that the
//! certified solver can minimise it. Standard errors come from Fisher's information Σ ∂ln E ∂ln E.
//!
//! A branch that was pulled and let go moves in another way ([`decay`]): nothing about it is random. Which of the two a
//! record is, its likelihood says.

mod adequacy;
mod cleaning;
mod clock;
pub mod decay;
pub mod design;
mod fisher;
mod grid;
pub mod gusts;
pub mod reader;
pub mod spectra;
mod spikes;
#[cfg(test)]
pub(crate) mod tests;
mod verdict;
pub mod whittle;

use mesophyll_base::error::Status;
pub use spectra::periodogram;

/// Readings at even times.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MotionRecord {
    /// Time between readings (s).
    pub step: f64,
    /// Deflections (mm) in one direction or in two; NaN where a reading is missing.
    pub channels: Vec<Vec<f64>>,
    /// Line of the file that each reading stands in, for messages; empty where there is no file, 0 at gaps.
    pub lines: Vec<usize>,
}

/// What kind of motion a record shows.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    strum::Display,
    strum::EnumString,
    strum::EnumIter,
    strum::EnumMessage,
    strum::IntoStaticStr,
)]
#[strum(serialize_all = "kebab-case")]
pub enum MotionKind {
    /// whichever of the others the record's likelihood is larger for
    #[default]
    Auto,
    /// a branch that gusts push at random
    Gusts,
    /// a branch that was pulled and let go in calm air
    FreeDecay,
}

/// What is known beforehand.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MotionPrior {
    /// Kind of motion.
    pub kind: MotionKind,
    /// Mean speed of the wind (m/s); fitted where it is not given.
    pub speed: Option<f64>,
    /// Standard deviation of the wind's speed over its mean; with the speed it turns the gain into mm per m/s.
    pub turbulence: Option<f64>,
    /// Standard error of a reading (mm), besides its rounding.
    pub noise: f64,
    /// Range of frequencies that is used (Hz). Without an upper end it goes up to twice the resonance, as far as motion
    /// textures go. An upper end also says that no resonance lies above it.
    pub band: [Option<f64>; 2],
}

/// A number and its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionEstimate {
    /// The best estimate.
    pub value: f64,
    /// Its standard error; infinite where nothing is known.
    pub error: f64,
}

/// How a branch sways.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionFit {
    /// What it was taken for; never [`MotionKind::Auto`].
    pub kind: MotionKind,
    /// f_h (Hz).
    pub resonance: MotionEstimate,
    /// γ (1/s).
    pub damping: MotionEstimate,
    /// γ over the critical damping 4π f_h.
    pub ratio: MotionEstimate,
    /// G of every channel (mm/√Hz); none for a free decay.
    pub gains: Vec<MotionEstimate>,
    /// 1/v (s/m); exact where the speed was given, NaN for a free decay.
    pub slowness: MotionEstimate,
    /// Number of frequencies used, in all channels together; 0 for a free decay.
    pub bins: usize,
    /// Mean of 2(ρ − 1 − ln ρ); 2γ_Euler = 1.154 is expected of Gaussian motion with this spectrum. NaN for a free
    /// decay.
    pub deviance: f64,
    /// What was left out or taken out of the record: one phrase each.
    pub taken_out: Vec<String>,
    /// Why the record was taken for this kind of motion.
    pub why: String,
    /// Whether the numbers can be relied on.
    pub status: Status,
}

/// Fewest frequencies that a fit is made from.
const FEWEST: usize = 16;
/// At least this share of the times must have readings.
const PRESENT: f64 = 0.5;
/// Least share of the movement that a free decay explains where gusts describe the record, too.
const EXPLAINED: f64 = 0.5;

/// Fits a record.
///
/// # Errors
/// A sentence that says why there is no answer: too few readings, too many gaps, no motion, a band without frequencies.
pub fn fit(record: &MotionRecord, known: &MotionPrior) -> Result<MotionFit, String> {
    let n = record.channels.first().map_or(0, Vec::len);
    for (k, channel) in record.channels.iter().enumerate() {
        let name = ["u_mm", "v_mm"][k.min(1)];
        let there = channel.iter().filter(|r| !r.is_nan()).count();
        if there < 4 * FEWEST {
            return Err(format!("{there} readings, expected at least {}", 4 * FEWEST));
        }
        if (there as f64) < PRESENT * n as f64 {
            return Err(format!(
                "{name} has readings at {there} of {n} times, {} s apart; expected half of them or more: \
                 give the parts of the record one by one",
                record.step
            ));
        }
        let first = channel.iter().copied().find(|r| !r.is_nan());
        if channel.iter().filter(|r| !r.is_nan()).all(|r| Some(*r) == first) {
            return Err(format!("nothing moves in {name}"));
        }
    }
    let cleaned = cleaning::clean(record);
    // Rounded readings are off by up to half a step, evenly distributed.
    let noise = known.noise.hypot(cleaned.resolution / 12f64.sqrt());
    let stepped = MotionPrior { noise, ..*known };
    let gusts = match known.kind {
        MotionKind::FreeDecay => Err(String::new()),
        _ => {
            let smooth = cleaning::smooth(&cleaned);
            gusts::fit(&smooth.channels, record.step, &stepped).map(|g| (g, smooth.wild))
        }
    };
    // Where gusts describe the record, a decay has to explain most of it to be thought of.
    let least = if gusts.as_ref().is_ok_and(|(g, _)| g.lack.is_none()) { EXPLAINED } else { 0.0 };
    let decay = match known.kind {
        MotionKind::Gusts => Err(String::new()),
        _ => decay::fit(&cleaned.channels, record.step, known, cleaned.resolution, least),
    };
    verdict::choose(record, known, &stepped, cleaned, gusts, decay)
}
