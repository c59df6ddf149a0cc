//! The sky's stress table: suns on the horizon and overhead, turbidity at both ends and near the pole, single
//! precision, and the fits that must fail.

use crate::stress::StressRow;
use mesophyll_fits::sky::judge::{SkyFitReference, judge};
use mesophyll_fits::sky::{Options, SkyFit, SkyFitMethod, fit, standard};
use mesophyll_sky::projection::{ProjectionQuality, ProjectionRule, direct};
use mesophyll_sky::{HarmonicCoefficients, HosekWilkie, Preetham, Sky, SkyFamily, preetham};
use std::f64::consts::FRAC_PI_2;
use std::time::Instant;

/// Direct integration: case, sun, turbidity, bands. `ok` means that half as many nodes more change it by less than 1e-9
/// of c00.
const DIRECT: [(&str, f64, f64, usize); 14] = [
    ("sun overhead", 0.0, 3.0, 7),
    ("sun 1e-8 from the zenith", 1e-8, 3.0, 7),
    ("sun on the horizon", FRAC_PI_2, 3.0, 7),
    ("sun 1e-12 above the horizon", FRAC_PI_2 - 1e-12, 3.0, 7),
    ("sun 1e-4 above the horizon", FRAC_PI_2 - 1e-4, 3.0, 7),
    ("pi/2 rounded up to five digits", FRAC_PI_2 + 3.7e-6, 3.0, 7),
    ("sun .02 above the horizon", FRAC_PI_2 - 0.02, 3.0, 7),
    ("turbidity 1.7, sun overhead", 0.0, 1.7, 7),
    ("turbidity 1.7, sun on the horizon", FRAC_PI_2, 1.7, 7),
    ("turbidity 10, sun overhead", 0.0, 10.0, 7),
    ("turbidity 10, sun on the horizon", FRAC_PI_2, 10.0, 7),
    ("one band", 0.8, 3.0, 1),
    ("32 bands", 0.8, 3.0, 32),
    ("32 bands, sun .02 above the horizon", FRAC_PI_2 - 0.02, 3.0, 32),
];

/// Parameters outside the domain: case, sun, turbidity, and how the verdict must begin.
const OUTSIDE: [(&str, f64, f64, &str); 8] = [
    ("turbidity 1.69, beside the limit", 0.5, 1.69, "refused: turbidity"),
    ("turbidity 1.643, on the pole", 0.5, 1.643, "refused: turbidity"),
    ("turbidity 1.2, below the pole", 0.5, 1.2, "refused: turbidity"),
    ("turbidity 10.01", 0.5, 10.01, "refused: turbidity"),
    ("turbidity not a number", 0.5, f64::NAN, "refused: turbidity"),
    ("sun 2e-5 below the horizon", FRAC_PI_2 + 2e-5, 3.0, "refused: sun_zenith"),
    ("sun zenith negative", -0.1, 3.0, "refused: sun_zenith"),
    ("sun zenith infinite", f64::INFINITY, 3.0, "refused: sun_zenith"),
];

/// Runs every case.
///
/// # Errors
/// The standard fit failed.
pub fn rows() -> crate::Result<Vec<StressRow>> {
    let mut rows: Vec<StressRow> = Vec::new();
    for (case, sun, turbidity, bands) in DIRECT {
        let clock = Instant::now();
        let (verdict, digits, ms) = match Preetham.at(sun, turbidity) {
            Err(e) => (format!("refused: {e}"), None, 0.0),
            Ok(sky) => {
                let got = direct(&sky, bands);
                let ms = clock.elapsed().as_secs_f64() * 1e3;
                let error =
                    off(&got, &ProjectionRule::new(sky.sun_zenith(), bands, ProjectionQuality::Checked).project(&sky));
                (within(error, 1e-9), Some(-error.clamp(1e-16, 1.0).log10()), ms)
            }
        };
        rows.push(row(&format!("direct: {case}"), "ok", verdict, digits, None, ms));
    }
    for (case, sun, turbidity, expected) in OUTSIDE {
        let verdict = Preetham.sky(sun, turbidity).map_or_else(|e| format!("refused: {e}"), |_| "ok".into());
        rows.push(row(case, expected, verdict, None, None, 0.0));
    }
    let dark =
        HosekWilkie { albedo: [1.2, 0.0, 0.0] }.sky(0.5, 3.0).map_or_else(|e| format!("refused: {e}"), |_| "ok".into());
    rows.push(row("hosek-wilkie: albedo 1.2", "refused: albedo", dark, None, None, 0.0));

    // The fit in single precision, at the corners of its domain and just outside.
    let standard = standard()?;
    let domain = SkyFitReference::new(&Preetham, 7, preetham::TRUSTED, 3, 2).map_err(crate::Error::Missed)?;
    for (sun, turbidity) in [(0.0, 2.5), (0.0, 6.0), (FRAC_PI_2, 2.5), (FRAC_PI_2, 6.0), (FRAC_PI_2 - 1e-3, 2.5)] {
        let clock = Instant::now();
        let got = standard.coefficients(sun, turbidity);
        let ms = clock.elapsed().as_secs_f64() * 1e3;
        let (verdict, digits) = match (got, Preetham.at(sun, turbidity)) {
            (Ok(got), Ok(sky)) => {
                let error = got.distance(&direct(&sky, 7)).into_iter().fold(0.0, f64::max) / domain.smallest;
                (within(error, 1e-5), Some(-error.clamp(1e-16, 1.0).log10()))
            }
            (Err(e), _) | (_, Err(e)) => (format!("refused: {e}"), None),
        };
        rows.push(row(&format!("fit f32: sun {sun:.3}, turbidity {turbidity}"), "ok", verdict, digits, None, ms));
    }
    for (sun, turbidity, expected) in
        [(0.5, 2.49, "refused: turbidity"), (0.5, 6.01, "refused: turbidity"), (1.58, 3.0, "refused: sun_zenith")]
    {
        let verdict = standard.coefficients(sun, turbidity).map_or_else(|e| format!("refused: {e}"), |_| "ok".into());
        rows.push(row(
            &format!("fit f32: outside, sun {sun}, turbidity {turbidity}"),
            expected,
            verdict,
            None,
            None,
            0.0,
        ));
    }

    // The dissertation's basis, and the same function space in a basis that f64 can represent.
    let small = |method| Options { method, bands: 3, grid: 200, ..Options::default() };
    let judged = SkyFitReference::new(&Preetham, 3, preetham::TRUSTED, 12, 5).map_err(crate::Error::Missed)?;
    for (case, method, single, expected) in [
        ("monomials (13, 7) by normal equations", SkyFitMethod::MonomialsNormal, false, "refused: the Gram matrix"),
        ("monomials (13, 7) by QR", SkyFitMethod::MonomialsQr, false, "undetermined: rank"),
        ("monomials (13, 7) by QR, evaluated in f32", SkyFitMethod::MonomialsQr, true, "undetermined: rank"),
        ("Chebyshev (13, 7)", SkyFitMethod::Chebyshev, false, "ok"),
        ("Chebyshev (13, 7), evaluated in f32", SkyFitMethod::Chebyshev, true, "ok"),
    ] {
        let clock = Instant::now();
        let fitted = fit(&small(method))?;
        let ms = clock.elapsed().as_secs_f64() * 1e3;
        rows.push(of_fit(case, expected, &fitted, single, &judged, 1e-2, ms));
    }
    // All turbidities that the model accepts; they end a little before the pole.
    let wide =
        Options { method: SkyFitMethod::Fine, bands: 3, turbidities: preetham::TURBIDITIES, ..Options::default() };
    let everywhere = SkyFitReference::new(&Preetham, 3, preetham::TURBIDITIES, 12, 9).map_err(crate::Error::Missed)?;
    let clock = Instant::now();
    let fitted = fit(&wide)?;
    let ms = clock.elapsed().as_secs_f64() * 1e3;
    rows.push(of_fit("fine, f32, fitted over turbidity 1.7 to 10", "ok", &fitted, true, &everywhere, 1e-2, ms));
    rows.extend(super::faults::rows());
    Ok(rows)
}

/// A fit's verdict: `ok` where its error is within `limit` of the smallest c00.
fn of_fit(
    case: &str,
    expected: &str,
    fitted: &SkyFit,
    single: bool,
    reference: &SkyFitReference,
    limit: f64,
    ms: f64,
) -> StressRow {
    let (mut verdict, mut digits) = (format!("refused: {}", fitted.remark), None);
    if let Some(form) = &fitted.form {
        let error = if single { judge(&form.narrow(), reference) } else { judge(form, reference) }.worst;
        digits = Some(-error.clamp(1e-16, 1.0).log10());
        verdict = match fitted.rank < fitted.columns {
            true => format!("undetermined: {}; error {error:.1e}", fitted.remark),
            false => within(error, limit),
        };
    }
    row(case, expected, verdict, digits, fitted.condition.is_finite().then_some(fitted.condition), ms)
}

fn off(a: &HarmonicCoefficients, b: &HarmonicCoefficients) -> f64 {
    let c00 = b.get(0, 0).into_iter().fold(f64::INFINITY, f64::min);
    a.values()
        .iter()
        .zip(b.values())
        .flat_map(|(a, b)| (0..3).map(move |c| (a[c] - b[c]).abs()))
        .fold(0.0, mesophyll_base::solvers::qr::nan_max)
        / c00
}

fn within(error: f64, limit: f64) -> String {
    if error <= limit { "ok".into() } else { format!("wrong: error {error:.1e}, expected {limit:.0e}") }
}

fn row(case: &str, expected: &str, verdict: String, digits: Option<f64>, condition: Option<f64>, ms: f64) -> StressRow {
    StressRow { model: "sky".into(), case: case.into(), expected: expected.into(), verdict, digits, condition, ms }
}
