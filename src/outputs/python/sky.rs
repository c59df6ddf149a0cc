//! Skies: `mesophyll.sky`.

use crate::bridge::{NumberBuffer, RowCost, RowTroubles, columns, fill, named, refuse, run};
use mesophyll_base::error::Status;
use mesophyll_fits::sky::evaluator::{SkyFitEvaluator, SkyFitSource};
use mesophyll_fits::sky::window::WindowKind;
use mesophyll_sky::HarmonicCoefficients;
use mesophyll_sky::SkyModel;
use mesophyll_sky::harmonics::{HarmonicBasis, MOST_BANDS};
use mesophyll_sky::irradiance::convolved;
use pyo3::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Coefficients (3 N² cells a row) from sun zenith (radians) and turbidity, as `eval sky`. `ways` are the names of
/// method, model and window; `albedos` those of hosek-wilkie's ground and of the ground below the horizon. Returns the
/// rows that did not end well, and what to warn of.
#[pyfunction]
pub fn sky_coefficients(
    py: Python<'_>,
    sun_zenith: NumberBuffer,
    turbidity: NumberBuffer,
    bands: usize,
    ways: (String, String, String),
    albedos: [f64; 2],
    out: NumberBuffer,
) -> PyResult<(RowTroubles, Vec<String>)> {
    check_bands(bands)?;
    let (source, model) = (named::<SkyFitSource>("method", &ways.0)?, named::<SkyModel>("model", &ways.1)?);
    let window = named::<WindowKind>("window", &ways.2)?;
    let skies = run(py, || SkyFitEvaluator::new(source, model, albedos[0], bands, window, albedos[1]))?;
    let ([sun, turbidity], rows) = columns(py, [&sun_zenith, &turbidity])?;
    let (beyond, warned) = (AtomicUsize::new(0), AtomicUsize::new(0));
    // No fit has so many bands, and then the default integrates without counting.
    let unfitted = source == SkyFitSource::Fit && bands > mesophyll_fits::sky::MOST_BANDS;
    let troubles = fill(py, rows, RowCost::Much, &out, |k, cells, _| match skies.at(sun[k], turbidity[k]) {
        Ok(found) => {
            beyond.fetch_add(usize::from(found.beyond_fit || unfitted), Ordering::Relaxed);
            warned.fetch_add(usize::from(found.warned), Ordering::Relaxed);
            cells.copy_from_slice(found.coefficients.values().as_flattened());
            Status::Ok
        }
        Err(why) => Status::Refused(why.to_string()),
    })?;
    let mut warnings = Vec::new();
    let [low, high] = skies.model().trusted();
    match warned.into_inner() {
        0 => {}
        n => warnings.push(format!(
            "skies whose turbidity is outside the {low} to {high} for which {} is trusted: {n}",
            skies.model().name()
        )),
    }
    match beyond.into_inner() {
        0 => {}
        n => warnings.push(format!("skies outside what the fit covers, which were integrated directly: {n}")),
    }
    Ok((troubles, warnings))
}

fn check_bands(bands: usize) -> PyResult<()> {
    if (1..=MOST_BANDS).contains(&bands) {
        return Ok(());
    }
    Err(refuse(format!("bands is {bands}; expected 1 to {MOST_BANDS}")))
}

/// The coefficients of one sky from 3 N² numbers.
fn read(py: Python<'_>, coefficients: &NumberBuffer, bands: usize) -> PyResult<HarmonicCoefficients> {
    check_bands(bands)?;
    let values = coefficients.to_vec(py)?;
    let mut sky = HarmonicCoefficients::zero(bands);
    if values.len() != 3 * bands * bands {
        return Err(refuse(format!("{} coefficients; expected 3 N²", values.len())));
    }
    sky.values_mut().as_flattened_mut().copy_from_slice(&values);
    Ok(sky)
}

/// A direction of length 1.
fn unit(d: &[f64]) -> Result<[f64; 3], Status> {
    let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 && length.is_finite() {
        Ok([d[0] / length, d[1] / length, d[2] / length])
    } else {
        Err(Status::Refused(format!("direction is {d:?}; expected three numbers that are not all 0")))
    }
}

/// The sum of the harmonics (3 cells a row) in directions (3 numbers a row): the radiance from there, or the
/// `irradiance` on surfaces with these normals.
#[pyfunction]
pub fn sky_evaluate(
    py: Python<'_>,
    coefficients: NumberBuffer,
    bands: usize,
    directions: NumberBuffer,
    irradiance: bool,
    out: NumberBuffer,
) -> PyResult<RowTroubles> {
    let sky = read(py, &coefficients, bands)?;
    let sky = if irradiance { convolved(&sky) } else { sky };
    let (basis, directions) = (HarmonicBasis::new(bands), directions.to_vec(py)?);
    fill(py, directions.len() / 3, RowCost::Little, &out, |k, cells, _| match unit(&directions[3 * k..3 * k + 3]) {
        Ok(d) => {
            cells.copy_from_slice(&basis.sum(&sky, d));
            Status::Ok
        }
        Err(status) => status,
    })
}
