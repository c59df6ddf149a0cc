//! Coefficients of skies, from whichever source covers them: one row of what `eval sky` prints.

use crate::sky::window::WindowKind;
use crate::sky::{Error, Options, Result, SkyFitForm, SkyFitMethod, fit, folder, over, standard};
use mesophyll_files::progress;
use mesophyll_sky::SkyModel;
use mesophyll_sky::window::HarmonicWindow;
use mesophyll_sky::{HarmonicCoefficients, SkyFamily, SkyRefusal, irradiance, projection};
use std::path::Path;
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};

/// Where a sky's coefficients come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum SkyFitSource {
    /// The fitted polynomials.
    #[default]
    #[strum(to_string = "fit", serialize = "fine")]
    Fit,
    /// Fitted polynomials of two thirds of the size, with about three times the error.
    Compact,
    /// Integrated.
    Direct,
    /// Chebyshev polynomials of Preetham as a black box.
    Chebyshev,
    /// Monomials of Preetham as a black box.
    MonomialsQr,
}

/// Evaluates skies one at a time.
pub struct SkyFitEvaluator {
    model: Box<dyn SkyFamily>,
    form: Option<SkyFitForm<f32>>,
    window: Option<HarmonicWindow>,
    bands: usize,
    worked: usize,
    ground: f64,
}

/// One sky's coefficients, and where they come from.
pub struct SkyEvaluation {
    /// N² coefficients a channel, N being the number of bands.
    pub coefficients: HarmonicCoefficients,
    /// Whether the sky had to be integrated although a fit was asked for.
    pub beyond_fit: bool,
    /// Whether the turbidity is outside the range that the model's authors vouch for.
    pub warned: bool,
}

impl SkyFitEvaluator {
    /// `bands` is N: functions of degree l < N. `ground` is the albedo, 0 to 1, of the level ground below the horizon.
    ///
    /// # Errors
    /// [`Error::Usage`] for arguments that do not fit together.
    pub fn new(
        source: SkyFitSource,
        model: SkyModel,
        albedo: f64,
        bands: usize,
        window: WindowKind,
        ground: f64,
    ) -> Result<SkyFitEvaluator> {
        let sky = over(model, albedo)?;
        let mut made = SkyFitEvaluator::without(sky, bands, window, ground)?;
        made.form = polynomials(source, model, made.worked)?;
        Ok(made)
    }

    /// Uses the fit of Preetham's sky in the folder `fit` (written by `fit sky`) instead of the built-in one.
    ///
    /// # Errors
    /// As [`SkyFitEvaluator::new`], and where the folder is no such fit.
    pub fn of_folder(fit: &Path, bands: usize, window: WindowKind, ground: f64) -> Result<SkyFitEvaluator> {
        let mut made = SkyFitEvaluator::without(over(SkyModel::Preetham, 0.0)?, bands, window, ground)?;
        let (record, form) = folder::read(fit)?;
        if record.options.get("model").map(String::as_str) != Some("preetham") {
            return Err(Error::field(
                &fit.join("fit.toml"),
                "model",
                "expected preetham, whose skies stand in where the fit ends",
            ));
        }
        made.form = Some(form);
        Ok(made)
    }

    fn without(model: Box<dyn SkyFamily>, bands: usize, window: WindowKind, ground: f64) -> Result<SkyFitEvaluator> {
        if !(0.0..=1.0).contains(&ground) {
            return Err(Error::Usage(format!("--ground is {ground}; expected an albedo of 0 to 1")));
        }
        // The light of the ground needs the irradiance, which takes at least two bands.
        let worked = if ground > 0.0 { bands.max(2) } else { bands };
        Ok(SkyFitEvaluator { model, form: None, window: window.window(bands)?, bands, worked, ground })
    }

    /// The sky model.
    pub fn model(&self) -> &dyn SkyFamily {
        self.model.as_ref()
    }

    /// The coefficients at a sun's zenith angle (radians, 0 to π/2) and a turbidity.
    ///
    /// # Errors
    /// [`SkyRefusal`] where there is no such sky.
    pub fn at(&self, sun: f64, turbidity: f64) -> std::result::Result<SkyEvaluation, SkyRefusal> {
        let covers = |f: &&SkyFitForm<f32>| {
            f.bands() >= self.worked && (f.turbidities()[0]..=f.turbidities()[1]).contains(&turbidity)
        };
        let (mut c, beyond_fit) = match self.form.as_ref().filter(covers) {
            Some(form) => (form.coefficients(sun, turbidity)?, false),
            None => {
                let sky = self.model.sky(sun, turbidity)?;
                (projection::direct(sky.as_ref(), self.worked), self.form.is_some())
            }
        };
        if self.ground > 0.0 {
            c = irradiance::add_ground(&c, [self.ground; 3], [0.0; 3]);
        }
        c = c.truncated(self.bands);
        if let Some(window) = &self.window {
            c = window.apply(&c);
        }
        Ok(SkyEvaluation { coefficients: c, beyond_fit, warned: self.model.warning(turbidity).is_some() })
    }
}

/// The polynomials that are asked for; `None` where everything is integrated.
fn polynomials(source: SkyFitSource, model: SkyModel, bands: usize) -> Result<Option<SkyFitForm<f32>>> {
    if source == SkyFitSource::Direct {
        return Ok(None);
    }
    if model != SkyModel::Preetham {
        return Err(Error::Usage("--model hosek-wilkie needs --method direct; the fits are of preetham".into()));
    }
    let method = match source {
        SkyFitSource::Fit if bands <= 7 => return Ok(Some(SkyFitForm::Folded(standard()?.clone()))),
        SkyFitSource::Fit | SkyFitSource::Direct => SkyFitMethod::Fine,
        SkyFitSource::Compact => SkyFitMethod::Compact,
        SkyFitSource::Chebyshev => SkyFitMethod::Chebyshev,
        SkyFitSource::MonomialsQr => SkyFitMethod::MonomialsQr,
    };
    if bands > crate::sky::MOST_BANDS {
        // A fit that is used by default is replaced; a fit asked for by name is not.
        if source == SkyFitSource::Fit {
            progress::say(format!(
                "{bands} bands are more than a fit has ({}); everything is integrated directly",
                crate::sky::MOST_BANDS
            ));
            return Ok(None);
        }
        return Err(Error::Usage(format!(
            "--bands {bands} with --method {}: expected at most {}",
            method.name(),
            crate::sky::MOST_BANDS
        )));
    }
    let fitted = fit(&Options { method, bands, ..Options::default() })?;
    let failed = || Error::Missed(format!("{} failed: {}", method.name(), fitted.remark));
    Ok(Some(fitted.form.as_ref().ok_or_else(failed)?.narrow()))
}
