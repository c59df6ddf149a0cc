//! Fits of a sky's harmonic coefficients over sun zenith angle and turbidity: linear least squares in several bases,
//! all judged by one measure.
//!
//! The measure of error is the same everywhere. At one sky and channel it is the root of the sum of squared coefficient
//! errors, divided by the smallest c00 of the domain (of all channels). The worst channel of the worst sky counts. The
//! domain is sun zenith 0 … π/2 and turbidity 2.5 … 6 (the dissertation's) unless stated otherwise.
//!
//! | to … | call |
//! |---|---|
//! | fit | [`fit`] with [`Options`]; [`SkyFit::form`] holds the polynomials in f64, [`SkyFitForm::narrow`] in f32 |
//! | the fit that the program itself uses | [`standard`]: made once, in milliseconds |
//! | judge | [`judge::judge`] |
//! | make and read a folder | [`folder::make`], [`folder::read`] |
//! | find sun and turbidity in a picture of the sky | [`panorama::record::make`], [`panorama::fit`] |

#![warn(missing_docs)]

pub mod evaluator;
pub mod folded;
pub mod folder;
pub mod judge;
mod nodes;
pub mod panorama;
mod tensor;
pub mod window;

use crate::record::FitPhase;
use mesophyll_base::error::{Error, Result};
use mesophyll_base::solvers::{Termination, Trace};
use mesophyll_sky::polynomials::{FoldedPolynomials, PolynomialTensor};
use mesophyll_sky::{HarmonicCoefficients, Preetham, SkyFamily, SkyModel, SkyRefusal, preetham};
use std::sync::OnceLock;
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};

/// Which polynomials, and how they are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum SkyFitMethod {
    /// Everything with a closed form folded out, a staircase of 124 terms: the smallest error.
    #[default]
    Fine,
    /// As `fine` with 80 terms: two thirds of the bytes, and about three times the error.
    Compact,
    /// Degree (13, 7) in scaled Chebyshev polynomials at 24 × 12 Chebyshev nodes.
    Chebyshev,
    /// The Chebyshev polynomials of that degree on the dissertation's uniform grid.
    ChebyshevGrid,
    /// The dissertation's monomials of degree (13, 7) on its uniform grid, by QR.
    MonomialsQr,
    /// The same monomials by normal equations, as the dissertation fits them.
    MonomialsNormal,
}

impl SkyFitMethod {
    /// Name in files and on the command line.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// The model over ground of this albedo, as a command names both.
///
/// # Errors
/// [`Error::Usage`] for an albedo outside 0 to 1.
pub fn over(model: SkyModel, albedo: f64) -> Result<Box<dyn SkyFamily>> {
    model.over(albedo).map_err(|refused| Error::Usage(format!("--{refused}")))
}

/// What a fit is told.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Which polynomials, and how they are found.
    pub method: SkyFitMethod,
    /// Bands N of the harmonics: N² coefficients a channel.
    pub bands: usize,
    /// Least and greatest turbidity that the fit holds for.
    pub turbidities: [f64; 2],
    /// Samples of each variable, for the methods on a uniform grid.
    pub grid: usize,
    /// Degrees in θs and τ of the tensor methods.
    pub degrees: [usize; 2],
}

impl Default for Options {
    fn default() -> Self {
        Options { method: SkyFitMethod::Fine, bands: 7, turbidities: preetham::TRUSTED, grid: 500, degrees: [13, 7] }
    }
}

/// Largest number of bands of a fit; beyond it, skies are integrated directly.
pub const MOST_BANDS: usize = 12;

/// Fitted polynomials of either form. A program holds only a handful of them, so their size on the stack does not
/// matter.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, PartialEq)]
pub enum SkyFitForm<T = f64> {
    /// Polynomials of what is left once the parts with a closed form are divided out.
    Folded(FoldedPolynomials<T>),
    /// Polynomials in sun zenith angle and turbidity, every power of one times every power of the other.
    Tensor(PolynomialTensor<T>),
}

impl<T: mesophyll_base::number::FloatingPoint> SkyFitForm<T> {
    /// N² coefficients in linear sRGB (kcd/m²), sun at azimuth 0.
    ///
    /// # Errors
    /// [`SkyRefusal`] outside what was fitted.
    pub fn coefficients(
        &self,
        sun_zenith: f64,
        turbidity: f64,
    ) -> std::result::Result<HarmonicCoefficients, SkyRefusal> {
        match self {
            SkyFitForm::Folded(f) => f.coefficients(sun_zenith, turbidity),
            SkyFitForm::Tensor(f) => f.coefficients(sun_zenith, turbidity),
        }
    }
    /// Bands N of the harmonics: N² coefficients a channel.
    pub fn bands(&self) -> usize {
        match self {
            SkyFitForm::Folded(f) => f.bands(),
            SkyFitForm::Tensor(f) => f.bands(),
        }
    }
    /// Least and greatest turbidity that the polynomials cover.
    pub fn turbidities(&self) -> [f64; 2] {
        match self {
            SkyFitForm::Folded(f) => f.turbidities(),
            SkyFitForm::Tensor(f) => f.turbidities(),
        }
    }
    /// Number of terms in a polynomial.
    pub fn terms(&self) -> usize {
        match self {
            SkyFitForm::Folded(f) => f.terms(),
            SkyFitForm::Tensor(f) => f.powers()[0] * f.powers()[1],
        }
    }
    /// Size of the coefficients of the polynomials, in bytes.
    pub fn bytes(&self) -> usize {
        match self {
            SkyFitForm::Folded(f) => f.bytes(),
            SkyFitForm::Tensor(f) => f.bytes(),
        }
    }
    /// The same polynomials in f32.
    pub fn narrow(&self) -> SkyFitForm<f32> {
        match self {
            SkyFitForm::Folded(f) => SkyFitForm::Folded(f.to()),
            SkyFitForm::Tensor(f) => SkyFitForm::Tensor(f.to()),
        }
    }
}

/// The result of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct SkyFit {
    /// What was asked for.
    pub options: Options,
    /// Name of the sky's model.
    pub model: String,
    /// The polynomials; `None` where the method failed.
    pub form: Option<SkyFitForm>,
    /// How the fit ended.
    pub termination: Termination,
    /// Why the fit failed, or a remark on it; empty where all is well.
    pub remark: String,
    /// Condition number of the method's design matrix, with unscaled columns; infinite where it lacks rank.
    pub condition: f64,
    /// Rank of the design matrix; the fit is unique where it equals `columns`.
    pub rank: usize,
    /// Columns of the design matrix.
    pub columns: usize,
    /// Number of samples times number of functions.
    pub samples: usize,
    /// Root mean square of the residuals at the samples (kcd/m², weighted as the fit weighs them).
    pub rms: f64,
    /// Largest residual at the samples, in the unit of `rms`.
    pub worst: f64,
    /// The steps of the solver, each with its cost.
    pub trace: Trace,
    /// What the time was spent on.
    pub phases: Vec<FitPhase>,
}

impl SkyFit {
    /// Wall time of all phases (s).
    pub fn seconds(&self) -> f64 {
        self.phases.iter().map(|p| p.seconds).sum()
    }
}

/// Fits Preetham's sky.
///
/// # Errors
/// Bands, turbidities, degrees or a grid that cannot be fitted.
pub fn fit(options: &Options) -> Result<SkyFit> {
    check(options)?;
    Ok(match options.method {
        SkyFitMethod::Fine => folded::fit(options, &folded::FINE),
        SkyFitMethod::Compact => folded::fit(options, &folded::COMPACT),
        _ => tensor::fit(options, &Preetham),
    })
}

/// Fits any model by [`SkyFitMethod::Chebyshev`] as a black box: nothing but its values is used.
///
/// # Errors
/// As [`fit`]; any other method.
pub fn fit_model(options: &Options, model: &dyn SkyFamily) -> Result<SkyFit> {
    check(options)?;
    if options.method != SkyFitMethod::Chebyshev {
        let found = options.method.name();
        return Err(Error::Usage(format!(
            "method {found} is made for preetham; {} is fitted by chebyshev",
            model.name()
        )));
    }
    Ok(tensor::fit(options, model))
}

fn check(options: &Options) -> Result<()> {
    if !(1..=MOST_BANDS).contains(&options.bands) {
        return Err(Error::Usage(format!("{} bands cannot be fitted; expected 1 to {MOST_BANDS}", options.bands)));
    }
    let ([low, high], [least, most]) = (options.turbidities, preetham::TURBIDITIES);
    if !(least <= low && low + 0.1 <= high && high <= most) {
        return Err(Error::Usage(format!(
            "turbidities {low} to {high}; expected {least} to {most}, at least 0.1 apart"
        )));
    }
    let [a, b] = options.degrees;
    if !(2..=2000).contains(&options.grid) || a >= options.grid || b >= options.grid || a > 23 || b > 11 {
        return Err(Error::Usage(format!(
            "degrees ({a}, {b}) on a grid of {0} x {0}; expected at most (23, 11), fewer than the grid's 2 to 2000",
            options.grid
        )));
    }
    Ok(())
}

/// The fit that the program uses itself ([`SkyFitMethod::Fine`], 7 bands, turbidity 2.5 to 6), in f32. It is made at
/// the first call.
///
/// # Errors
/// As [`fit`].
pub fn standard() -> Result<&'static FoldedPolynomials<f32>> {
    static MADE: OnceLock<Option<FoldedPolynomials<f32>>> = OnceLock::new();
    MADE.get_or_init(|| match fit(&Options::default()).ok()?.form? {
        SkyFitForm::Folded(f) => Some(f.to()),
        SkyFitForm::Tensor(_) => None,
    })
    .as_ref()
    .ok_or_else(|| Error::Missed("the standard fit of the sky failed".into()))
}

#[cfg(test)]
mod tests;
