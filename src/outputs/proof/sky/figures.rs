//! The numbers behind the documentation's pictures of the sky fits: the frontier of error against size and time, errors
//! by band, the worst case, and the ringing.

use crate::bench::median_us;
use crate::{Error, Result};
use mesophyll_base::statistics::median_of;
use mesophyll_fits::sky::judge::{SkyFitErrors, SkyFitReference, judge};
use mesophyll_fits::sky::{Options, SkyFit, SkyFitForm, SkyFitMethod, folded, window};
use mesophyll_sky::harmonics::HarmonicBasis;
use mesophyll_sky::window::HarmonicWindow;
use mesophyll_sky::{HarmonicCoefficients, Preetham, Sky, colour, preetham, projection};
use std::f64::consts::PI;

/// Size of the dissertation's coefficients in bytes (Habel 2009, §5.3.1 and 5.4). This and the next three are what the
/// dissertation states for its own fit. Its error is also computed here, by the same fit in f64.
pub const DISSERTATION_BYTES: f64 = 131_712.0;
/// Coefficients of each polynomial.
pub const DISSERTATION_TERMS: f64 = 112.0;
/// Time of one evaluation (µs).
pub const DISSERTATION_US: f64 = 80.0;
/// Time of the fit (s).
pub const DISSERTATION_FIT_S: f64 = 2.3 * 3600.0;
/// Largest error, relative to the smallest c00 of the domain.
pub const DISSERTATION_ERROR: f64 = 0.0075;

/// One fit on the frontier, judged in f32. (The dissertation's monomials are judged in f64, because f32 cannot evaluate
/// them.)
#[derive(Debug, Clone)]
pub struct FrontierPoint {
    /// The kind of polynomials, for the picture's legend.
    pub family: &'static str,
    /// Their degrees or number of terms.
    pub setting: String,
    /// Coefficients of each polynomial.
    pub terms: usize,
    /// Size of all coefficients, in bytes.
    pub bytes: usize,
    /// Time of the fit (µs).
    pub fit_us: f64,
    /// Time of one evaluation (µs).
    pub evaluate_us: f64,
    /// Its errors, in f32 where f32 can evaluate it.
    pub judged: SkyFitErrors,
    /// Worst error in f64.
    pub wide: f64,
}

/// Staircases of growing size; [`folded::COMPACT`] and [`folded::FINE`] are among them.
fn staircases() -> Vec<Vec<usize>> {
    let round = |tall: usize, wide: usize| -> Vec<usize> {
        let rows = (0..tall)
            .map(|i| (wide as f64 * (1.0 - (i as f64 / tall as f64).powf(1.2)).powf(1.0 / 1.2)).round() as usize);
        rows.filter(|r| *r > 0).collect()
    };
    let mut all: Vec<Vec<usize>> =
        [(5, 4), (7, 5), (9, 6), (11, 8), (13, 9), (21, 12), (24, 14)].map(|(a, b)| round(a, b)).to_vec();
    all.insert(5, folded::COMPACT.to_vec());
    all.insert(6, folded::FINE.to_vec());
    all
}

fn point(
    family: &'static str,
    setting: String,
    fitted: &SkyFit,
    fit_us: f64,
    reference: &SkyFitReference,
) -> Option<FrontierPoint> {
    let form = fitted.form.as_ref()?;
    let monomials = matches!(fitted.options.method, SkyFitMethod::MonomialsQr | SkyFitMethod::MonomialsNormal);
    let narrow = form.narrow();
    let wide = judge(form, reference);
    let (judged, bytes, evaluate_us) = match (monomials, &narrow) {
        (true, _) => (wide.clone(), form.bytes(), median_us(30.0, || form.coefficients(1.1, 3.3))),
        (false, SkyFitForm::Folded(f)) => {
            let mut out = vec![[0.0f32; 3]; f.bands() * f.bands()];
            (
                judge(&narrow, reference),
                narrow.bytes(),
                thousand_us(|k| f.fill(1.1 + 1e-4 * k, 3.3 + 1e-4 * k, &mut out)),
            )
        }
        (false, SkyFitForm::Tensor(_)) => {
            (judge(&narrow, reference), narrow.bytes(), median_us(30.0, || narrow.coefficients(1.1, 3.3)))
        }
    };
    Some(FrontierPoint { family, setting, terms: form.terms(), bytes, fit_us, evaluate_us, judged, wide: wide.worst })
}

/// Time of one call (µs), for work that is faster than the clock can measure.
pub fn thousand_us(mut work: impl FnMut(f64)) -> f64 {
    median_us(30.0, || (0..1000).for_each(|k| work(f64::from(k)))) / 1000.0
}

/// The frontier of every family, with seven bands. `grid` is the dissertation's (500).
///
/// # Errors
/// As [`mesophyll_fits::sky::fit`].
pub fn frontier(reference: &SkyFitReference, grid: usize) -> Result<Vec<FrontierPoint>> {
    let mut out = Vec::new();
    let options = Options { grid, ..Options::default() };
    for rows in staircases() {
        let (mut last, mut times) = (folded::fit(&options, &rows), Vec::new());
        for _ in 0..3 {
            last = folded::fit(&options, &rows);
            times.push(last.seconds() * 1e6);
        }
        let name = match &rows[..] {
            r if *r == folded::COMPACT => "80 terms (compact)".to_string(),
            r if *r == folded::FINE => "124 terms (fine)".to_string(),
            r => format!("{} terms", r.iter().sum::<usize>()),
        };
        out.extend(point("folded", name, &last, median_of(times).unwrap_or(f64::NAN), reference));
    }
    for degrees in [[5, 3], [7, 4], [9, 5], [11, 6], [13, 7], [17, 9], [21, 11]] {
        let fitted =
            mesophyll_fits::sky::fit(&Options { method: SkyFitMethod::Chebyshev, degrees, ..options.clone() })?;
        out.extend(point(
            "chebyshev",
            format!("({}, {})", degrees[0], degrees[1]),
            &fitted,
            fitted.seconds() * 1e6,
            reference,
        ));
    }
    let fitted = mesophyll_fits::sky::fit(&Options { method: SkyFitMethod::MonomialsQr, ..options })?;
    out.extend(point("monomials f64", "(13, 7)".into(), &fitted, fitted.seconds() * 1e6, reference));
    Ok(out)
}

/// A curve of a chart.
#[derive(Debug, Clone)]
pub struct SkyProofCurve {
    /// Name of the curve, for the picture's legend.
    pub name: String,
    /// Abscissa and ordinate of every point.
    pub points: Vec<(f64, f64)>,
}

/// Errors by the number of bands used (Habel 2009, Fig. 5.4): largest sum of errors (E_max) and largest root of squares
/// (E_mean) of any sky.
pub fn by_band(points: &[FrontierPoint]) -> Vec<SkyProofCurve> {
    let mut out = Vec::new();
    let shown = points
        .iter()
        .filter(|p| p.family == "monomials f64" || p.setting.contains("compact") || p.setting.contains("fine"));
    for p in shown {
        for (k, what) in [(1, "E_max"), (0, "E_mean")] {
            let points = p.judged.by_bands.iter().enumerate().map(|(n, e)| ((n + 1) as f64, e[k])).collect();
            let name = if p.family == "folded" { p.setting.clone() } else { format!("{} {}", p.family, p.setting) };
            out.push(SkyProofCurve { name: format!("{name}, {what}"), points });
        }
    }
    out
}

/// Angles along the great circle through sun, zenith and antisun, counted from the zenith, positive towards the sun:
/// −180° … 180°.
fn meridian() -> impl Iterator<Item = (f64, [f64; 3])> {
    (-180..=180).map(|k| {
        let a = PI * f64::from(k) / 180.0;
        (f64::from(k), [a.sin(), 0.0, a.cos()])
    })
}

fn luminance(c: &HarmonicCoefficients, basis: &HarmonicBasis) -> Vec<(f64, f64)> {
    meridian().map(|(a, d)| (a, colour::xyz_from_rgb(basis.sum(c, d))[1])).collect()
}

/// The worst sky of the dissertation's fit, along the meridian: seven bands integrated, seven bands from the
/// dissertation's polynomials, and the differences of these and of the fine fit to the integrated bands (luminance,
/// kcd/m²).
#[derive(Debug, Clone)]
pub struct WorstSky {
    /// Sun zenith angle of the worst sky (rad).
    pub sun_zenith: f64,
    /// Turbidity of the worst sky.
    pub turbidity: f64,
    /// Seven bands, integrated directly.
    pub correct: SkyProofCurve,
    /// Seven bands from the dissertation's polynomials.
    pub reconstructed: SkyProofCurve,
    /// `reconstructed` less `correct`.
    pub difference: SkyProofCurve,
    /// The program's own fit less `correct`.
    pub fine: SkyProofCurve,
}

/// # Errors
/// As [`mesophyll_fits::sky::fit`].
pub fn worst(reference: &SkyFitReference, grid: usize) -> Result<WorstSky> {
    let refused = |e: mesophyll_sky::SkyRefusal| Error::Missed(e.to_string());
    let fitted =
        mesophyll_fits::sky::fit(&Options { method: SkyFitMethod::ChebyshevGrid, grid, ..Options::default() })?;
    let form = fitted.form.ok_or_else(|| Error::Missed(fitted.remark.clone()))?;
    let (sun_zenith, turbidity, _) = judge(&form, reference).worst_at;
    let want = projection::direct(&Preetham.at(sun_zenith, turbidity).map_err(refused)?, 7);
    let basis = HarmonicBasis::new(7);
    let correct = luminance(&want, &basis);
    let got = luminance(&form.coefficients(sun_zenith, turbidity).map_err(refused)?, &basis);
    let fine =
        luminance(&mesophyll_fits::sky::standard()?.coefficients(sun_zenith, turbidity).map_err(refused)?, &basis);
    let less = |a: &[(f64, f64)]| a.iter().zip(&correct).map(|(a, b)| (a.0, a.1 - b.1)).collect();
    Ok(WorstSky {
        sun_zenith,
        turbidity,
        difference: SkyProofCurve { name: "degree (13, 7) − correct".into(), points: less(&got) },
        fine: SkyProofCurve { name: "fine (f32) − correct".into(), points: less(&fine) },
        reconstructed: SkyProofCurve { name: "degree (13, 7) in θs and τ".into(), points: got },
        correct: SkyProofCurve { name: "correct".into(), points: correct },
    })
}

/// The ringing of seven bands along the meridian, and what remains of it with windows (Habel 2009, Fig. 5.5). The sun
/// is at a zenith angle of 1.3, the turbidity is 3, and luminance is relative to the mean of the upper hemisphere.
///
/// # Errors
/// As [`window::matched`].
pub fn ringing() -> Result<Vec<SkyProofCurve>> {
    let sky = Preetham.at(1.3, 3.0).map_err(|e| Error::Missed(e.to_string()))?;
    let c = projection::direct(&sky, 7);
    let basis = HarmonicBasis::new(7);
    let mean = colour::xyz_from_rgb(c.get(0, 0))[1] * (4.0 * PI).sqrt() / (2.0 * PI);
    let over = |points: Vec<(f64, f64)>| points.into_iter().map(|(a, v)| (a, v / mean)).collect();
    let itself = meridian().map(|(a, d)| (a, if d[2] > 0.0 { sky.xyz(d)[1] } else { 0.0 })).collect();
    let mut out = vec![SkyProofCurve { name: "the sky itself".into(), points: over(itself) }];
    for w in [HarmonicWindow::none(7), HarmonicWindow::zonal(7), HarmonicWindow::lanczos(7), window::matched(7)?] {
        let name = match w.name.as_str() {
            "none" => "seven bands",
            "zonal" => "zonal filter",
            "lanczos" => "sin x/x on every order",
            _ => "fitted window",
        };
        out.push(SkyProofCurve { name: name.into(), points: over(luminance(&w.apply(&c), &basis)) });
    }
    Ok(out)
}

/// Seven bands over the dissertation's turbidities: the reference of the pictures and of the bench.
///
/// # Errors
/// Only the model's.
pub fn reference() -> Result<SkyFitReference> {
    SkyFitReference::new(&Preetham, 7, preetham::TRUSTED, 33, 15).map_err(Error::Missed)
}
/// Everything that the pictures of the sky's fits show.
#[derive(Debug, Clone)]
pub struct SkyProofFigures {
    /// Error against size and time, one point for each fit.
    pub points: Vec<FrontierPoint>,
    /// Error against the number of bands that are used.
    pub bands: Vec<SkyProofCurve>,
    /// The sky at which the dissertation's fit is worst.
    pub worst: WorstSky,
    /// Luminance below the horizon, one curve for each window.
    pub ringing: Vec<SkyProofCurve>,
}

/// Fits and judges what the pictures show. `grid` is the dissertation's (500).
///
/// # Errors
/// As [`mesophyll_fits::sky::fit`].
pub fn all(grid: usize) -> Result<SkyProofFigures> {
    let reference = reference()?;
    let points = frontier(&reference, grid)?;
    Ok(SkyProofFigures { bands: by_band(&points), worst: worst(&reference, grid)?, ringing: ringing()?, points })
}
