//! A fitted sky on disk: `coefficients.json` (the arrays, in f32), `fit.toml`, `times.toml`.

use super::judge::{SkyFitErrors, SkyFitReference, judge};
use super::{Options, SkyFit, SkyFitForm};
use crate::record::maker::{self, FitMaker};
use crate::record::{FitKind, FitRecord, RecordSection};
use crate::sky::{Error, Result};
use mesophyll_files::{atomic, hash};
use mesophyll_sky::SkyModel;
use mesophyll_sky::polynomials::{FoldedPolynomials, PolynomialBasis, PolynomialTensor};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The arrays of a fit, in a form that any JSON reader understands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SkyFitArrays {
    /// `folded` or `tensor`.
    pub form: String,
    /// Name of the sky's model.
    pub model: String,
    /// Bands N of the harmonics: N² coefficients a channel.
    pub bands: usize,
    /// Least and greatest turbidity of the fit.
    pub turbidities: [f64; 2],
    /// Folded: terms in v for each power of θs.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rows: Vec<usize>,
    /// Folded: for all functions of even order, u_0, then u_1, then u_2, each term by term.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub even: Vec<f32>,
    /// Folded: the same for the functions of odd order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub odd: Vec<f32>,
    /// Tensor: `monomials` or `chebyshev`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub basis: String,
    /// Tensor: how many powers of θs, and how many of τ.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub powers: Vec<usize>,
    /// Tensor: red, green and blue of all functions, term by term.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub values: Vec<f32>,
}

impl SkyFitArrays {
    /// Packs the polynomials of a fit.
    pub fn new(form: &SkyFitForm<f32>, model: &str) -> SkyFitArrays {
        let mut out = SkyFitArrays {
            form: String::new(),
            model: model.into(),
            bands: form.bands(),
            turbidities: form.turbidities(),
            rows: Vec::new(),
            even: Vec::new(),
            odd: Vec::new(),
            basis: String::new(),
            powers: Vec::new(),
            values: Vec::new(),
        };
        match form {
            SkyFitForm::Folded(f) => {
                let (even, odd) = f.arrays();
                (out.form, out.rows, out.even, out.odd) =
                    ("folded".into(), f.rows().to_vec(), even.to_vec(), odd.to_vec());
            }
            SkyFitForm::Tensor(f) => {
                out.form = "tensor".into();
                out.basis = if f.basis == PolynomialBasis::Monomials { "monomials" } else { "chebyshev" }.into();
                (out.powers, out.values) = (f.powers().to_vec(), f.values().to_vec());
            }
        }
        out
    }

    /// Unpacks the polynomials.
    ///
    /// # Errors
    /// A sentence that names the field.
    pub fn form(self) -> std::result::Result<SkyFitForm<f32>, String> {
        match self.form.as_str() {
            "folded" => FoldedPolynomials::new(self.bands, self.turbidities, self.rows, self.even, self.odd)
                .map(SkyFitForm::Folded),
            "tensor" => {
                let basis = match self.basis.as_str() {
                    "monomials" => PolynomialBasis::Monomials,
                    "chebyshev" => PolynomialBasis::Chebyshev,
                    other => return Err(format!("basis: found {other:?}, expected monomials or chebyshev")),
                };
                let [a, b] = self.powers[..] else {
                    return Err(format!("powers: found {}, expected two", self.powers.len()));
                };
                PolynomialTensor::new(basis, self.bands, self.turbidities, [a, b], self.values).map(SkyFitForm::Tensor)
            }
            other => Err(format!("form: found {other:?}, expected folded or tensor")),
        }
    }
}

/// A sky that was fitted and written.
#[derive(Debug)]
pub struct SkyFitResult {
    /// The fit in f64.
    pub fitted: SkyFit,
    /// How good the fit is in f64.
    pub wide: SkyFitErrors,
    /// How good the fit is as it is written, in f32.
    pub narrow: SkyFitErrors,
    /// Size of the written arrays.
    pub bytes: usize,
    /// Smallest c00 of the domain. Errors are relative to it.
    pub smallest_c00: f64,
}

/// Fits a sky over ground of this albedo and writes the folder `out`. The fit takes milliseconds, so it is repeated
/// even where the folder already holds it.
///
/// # Errors
/// Options that cannot be fitted, a fit that failed; a folder that cannot be written or that holds something else.
pub fn make(out: &Path, options: &Options, model: SkyModel, albedo: f64) -> Result<SkyFitResult> {
    let options = options.clone();
    maker::make(FitKind::Sky, out, &[], move |maker| {
        let sky = super::over(model, albedo)?;
        let fitted = match model {
            SkyModel::Preetham => super::fit(&options)?,
            SkyModel::HosekWilkie => super::fit_model(&options, sky.as_ref())?,
        };
        let reference =
            SkyFitReference::new(sky.as_ref(), options.bands, options.turbidities, 33, 15).map_err(Error::Missed)?;
        write(maker, fitted, &reference)
    })
}

/// Writes the folder and says how good the fit is.
fn write(maker: &mut FitMaker, fit: SkyFit, reference: &SkyFitReference) -> Result<SkyFitResult> {
    let Some(form) = &fit.form else {
        return Err(Error::Missed(format!(
            "fit sky: {} ended as {}: {}",
            fit.options.method.name(),
            fit.termination.name(),
            fit.remark
        )));
    };
    let narrow = form.narrow();
    let (wide_error, error) = (judge(form, reference), judge(&narrow, reference));
    let arrays = serde_json::to_string(&SkyFitArrays::new(&narrow, &fit.model))
        .map_err(|e| Error::Missed(format!("cannot write JSON: {e}")))?;
    let options = &fit.options;
    maker.made_from(hash::bytes(format!("{} {options:?}", fit.model).as_bytes()))?;
    let path = maker.begin()?.join("coefficients.json");
    atomic::write_bytes(&path, format!("{arrays}\n").as_bytes())?;
    let mut record = maker.record(&format!("{} {}", fit.model, options.method.name()));
    record.termination = Some(fit.termination);
    let mut say = |name: &str, text: String| record.options.insert(name.into(), text);
    say("model", fit.model.clone());
    say("method", options.method.name().into());
    say("bands", options.bands.to_string());
    say("turbidities", format!("{} to {}", options.turbidities[0], options.turbidities[1]));
    say("sun_zenith", "0 to pi/2".into());
    say(
        "unit",
        "kcd/m2, linear sRGB; real orthonormal harmonics, no Condon-Shortley phase, index l(l+1)+m, sun at azimuth 0"
            .into(),
    );
    say(
        "error",
        "root of the sum of squared coefficient errors over the smallest c00 of the domain: worst channel, worst sky, \
         against direct integration"
            .into(),
    );
    if !fit.remark.is_empty() {
        say("remark", fit.remark.clone());
    }
    record.files.insert("coefficients.json".into(), hash::file(&path)?);
    let mut all = RecordSection { condition: Some(fit.condition), rank: Some(fit.rank), ..RecordSection::default() };
    let functions = 3 * options.bands * (options.bands + 1) / 2;
    all.terminations.insert(fit.termination.name().into(), functions);
    // Integrals have no noise, so there is no χ²: the residual of a polynomial is its own misfit.
    let mut figure = |name: &str, value: f64| all.figures.insert(name.into(), value);
    figure("error_worst", error.worst);
    figure("error_worst_f64", wide_error.worst);
    figure("error_median", error.median);
    figure("error_worst_sum", error.worst_sum);
    figure("error_worst_sun_zenith", error.worst_at.0);
    figure("error_worst_turbidity", error.worst_at.1);
    figure("residual_rms", fit.rms);
    figure("residual_worst", fit.worst);
    figure("residual_samples", fit.samples as f64);
    figure("smallest_c00", reference.smallest);
    figure("skies_judged", reference.skies.len() as f64);
    figure("terms", form.terms() as f64);
    figure("columns", fit.columns as f64);
    figure("bytes", narrow.bytes() as f64);
    record.sections.insert("all".into(), all);
    maker.times.phases.clone_from(&fit.phases);
    maker.times.traces.insert("fit".into(), fit.trace.clone());
    maker.finish(record)?;
    let bytes = narrow.bytes();
    Ok(SkyFitResult { fitted: fit, wide: wide_error, narrow: error, bytes, smallest_c00: reference.smallest })
}

/// Reads a folder: its record and its polynomials, both checked.
///
/// # Errors
/// A missing or changed file, arrays that make no sense, another kind of fit.
pub fn read(folder: &Path) -> Result<(FitRecord, SkyFitForm<f32>)> {
    let record = FitRecord::read_as(folder, FitKind::Sky)?;
    record.verify(folder)?;
    let path = folder.join("coefficients.json");
    let text = std::fs::read_to_string(&path).map_err(|e| Error::input(&path, atomic::explain(&e)))?;
    let arrays: SkyFitArrays = serde_json::from_str(&text).map_err(|e| Error::input(&path, e))?;
    let form = arrays.form().map_err(|why| Error::input(&path, why))?;
    Ok((record, form))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sky::SkyFitMethod;

    #[test]
    fn what_is_written_reads_back_and_a_changed_file_is_noticed() {
        for method in [SkyFitMethod::Compact, SkyFitMethod::Chebyshev] {
            let folder = tempfile::tempdir().unwrap();
            let options = Options { method, bands: 3, ..Options::default() };
            let made = || make(folder.path(), &options, SkyModel::Preetham, 0.2).unwrap();
            let fitted = made().fitted;
            let (record, form) = read(folder.path()).unwrap();
            assert_eq!(form, fitted.form.as_ref().unwrap().narrow());
            assert_eq!(record.sections["all"].figures["bytes"], form.bytes() as f64);
            let first = std::fs::read(folder.path().join("fit.toml")).unwrap();
            made();
            assert_eq!(std::fs::read(folder.path().join("fit.toml")).unwrap(), first);
            let path = folder.path().join("coefficients.json");
            let text = std::fs::read_to_string(&path).unwrap().replacen("0.", "1.", 1);
            std::fs::write(&path, text).unwrap();
            assert!(read(folder.path()).unwrap_err().to_string().contains("changed since"));
        }
    }

    #[test]
    fn a_failed_fit_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let options = Options { method: SkyFitMethod::MonomialsNormal, bands: 2, grid: 40, ..Options::default() };
        let failed = make(&folder.path().join("deeper/sky"), &options, SkyModel::Preetham, 0.2).unwrap_err();
        assert!(failed.to_string().contains("not positive definite"), "{failed}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
