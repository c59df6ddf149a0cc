//! A fitted sky as text that other programs compile or read: WGSL, a C header, JSON. It is either the polynomials with
//! their evaluator, or the N²×3 numbers for one sun and turbidity.

mod c;
mod json;
mod wgsl;

use super::ExportFormat;
use crate::{Error, Result};
use mesophyll_fits::record::FitRecord;
use mesophyll_fits::sky::{SkyFitForm, folder};
use mesophyll_sky::irradiance::{add_ground, below_horizon};
use mesophyll_sky::polynomials::mix::{TURBIDITY_ZERO, rgb_from_separable};
use mesophyll_sky::polynomials::{FoldedPolynomials, PolynomialBasis};
use mesophyll_sky::{HarmonicCoefficients, preetham};
use std::f64::consts::PI;
use std::path::Path;

/// The options of a sky's export, besides its format.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SkyExportOptions {
    /// Sun zenith angle (rad) and turbidity. If given, only the numbers for these are written, without polynomials.
    pub fixed: Option<(f64, f64)>,
    /// Albedo of level ground that lights the lower hemisphere, 0 to 1; 0 leaves it dark.
    pub ground: f64,
}

impl SkyExportOptions {
    /// Whether no option was given.
    pub fn is_plain(&self) -> bool {
        *self == SkyExportOptions::default()
    }
}

/// One family of functions that share their factors: which they are, and their values.
struct Group {
    /// l(l+1)+m.
    places: Vec<usize>,
    /// For each function, for each term, the three values.
    values: Vec<[f32; 3]>,
}

/// The polynomials as every format writes them.
struct Evaluator {
    bands: usize,
    turbidities: [f64; 2],
    /// Number of terms of a function.
    terms: usize,
    kind: Kind,
    /// Functions of even m, then those of odd m; one group of all for tensor products.
    groups: Vec<Group>,
}

/// How the factors of the terms are made.
enum Kind {
    /// Terms in v for each power of θs; u → linear sRGB by K diag(p) B.
    Folded { rows: Vec<usize>, back: [[f64; 3]; 3] },
    /// Powers of θs and τ.
    Tensor { basis: PolynomialBasis, powers: [usize; 2] },
}

impl Evaluator {
    fn new(form: &SkyFitForm<f32>) -> Evaluator {
        let (bands, turbidities, terms) = (form.bands(), form.turbidities(), form.terms());
        let group = |places: &[usize], from: &[f32]| {
            let each = places.len();
            let value = |e: usize, t: usize| std::array::from_fn(|u| from[t * 3 * each + u * each + e]);
            Group {
                places: places.to_vec(),
                values: (0..each).flat_map(|e| (0..terms).map(move |t| value(e, t))).collect(),
            }
        };
        match form {
            SkyFitForm::Folded(f) => {
                let (even, odd) = f.arrays();
                let groups = vec![group(&f.orders().even, even), group(&f.orders().odd, odd)];
                Evaluator {
                    bands,
                    turbidities,
                    terms,
                    kind: Kind::Folded { rows: f.rows().to_vec(), back: f.mix().back },
                    groups,
                }
            }
            SkyFitForm::Tensor(f) => {
                let places: Vec<usize> = (0..bands).flat_map(|l| (0..=l).map(move |m| l * (l + 1) + m)).collect();
                let groups = vec![group(&places, f.values())];
                Evaluator {
                    bands,
                    turbidities,
                    terms,
                    kind: Kind::Tensor { basis: f.basis, powers: f.powers() },
                    groups,
                }
            }
        }
    }

    /// For each of the N² coefficients, the function that gives it, numbered through all groups; −1 where m < 0.
    fn functions(&self) -> Vec<i32> {
        let mut out = vec![-1; self.bands * self.bands];
        for (k, place) in self.groups.iter().flat_map(|g| &g.places).enumerate() {
            out[*place] = k as i32;
        }
        out
    }

    /// Number of functions of the first group.
    fn first(&self) -> usize {
        self.groups[0].places.len()
    }

    fn values(&self) -> impl Iterator<Item = f32> + '_ {
        self.groups.iter().flat_map(|g| g.values.iter().flatten().copied())
    }

    /// ½ (b − a) and the geometric mean of τ − τ₀: v = ln((τ − τ₀)/mean)/half.
    fn logarithm(&self) -> (f64, f64) {
        let [a, b] = self.turbidities.map(|t| t - TURBIDITY_ZERO);
        (0.5 * (b / a).ln(), (a * b).sqrt())
    }

    /// Shares of the ground's radiance in the zonal coefficients, for an irradiance coefficient c_10 of 1.
    fn ground_shares(&self) -> Vec<f64> {
        (0..self.bands).map(|l| below_horizon(l) * (4.0 * PI / 3.0).sqrt() / PI).collect()
    }
}

/// Writes the sky in `folder`.
///
/// # Errors
/// As [`folder::read`]; [`Error::Usage`] for formats that a sky has none of, a sun or turbidity outside the fit, an
/// albedo outside 0 to 1.
pub fn text(folder: &Path, format: ExportFormat, options: &SkyExportOptions) -> Result<String> {
    let (record, form) = folder::read(folder)?;
    if !(0.0..=1.0).contains(&options.ground) {
        return Err(Error::Usage(format!("--ground is {}; expected an albedo of 0 to 1", options.ground)));
    }
    if options.ground > 0.0 && form.bands() < 2 {
        return Err(Error::Usage(
            "--ground needs a fit of two bands or more: the ground's light is the irradiance of two".into(),
        ));
    }
    if let Some((sun, turbidity)) = options.fixed {
        let c = coefficients(&form, sun, turbidity).map_err(|e| Error::Usage(e.to_string()))?;
        let c = if options.ground > 0.0 { add_ground(&c, [options.ground; 3], [0.0; 3]) } else { c };
        let about = about(&record, &form, options);
        return match format {
            ExportFormat::Wgsl => Ok(wgsl::fixed(&c, &about)),
            ExportFormat::C => Ok(c::fixed(&c, &about)),
            _ => json::fixed(&c, &record, options, sun, turbidity),
        };
    }
    let evaluator = Evaluator::new(&form);
    match format {
        ExportFormat::Wgsl => Ok(wgsl::polynomials(&evaluator, &about(&record, &form, options), options.ground)),
        ExportFormat::C => Ok(c::polynomials(&evaluator, &about(&record, &form, options), options.ground)),
        _ => json::polynomials(&evaluator, &record, folder, options.ground),
    }
}

/// The coefficients in f64, from the arrays as stored.
fn coefficients(
    form: &SkyFitForm<f32>,
    sun: f64,
    turbidity: f64,
) -> std::result::Result<HarmonicCoefficients, mesophyll_sky::SkyRefusal> {
    match form {
        SkyFitForm::Folded(f) => FoldedPolynomials::to::<f64>(f).coefficients(sun, turbidity),
        SkyFitForm::Tensor(f) => f.to::<f64>().coefficients(sun, turbidity),
    }
}

/// Lines for the head of a text: what the numbers are, where they are valid, and their largest error.
fn about(record: &FitRecord, form: &SkyFitForm<f32>, options: &SkyExportOptions) -> Vec<String> {
    let figure = |name: &str| record.sections.get("all").and_then(|s| s.figures.get(name)).copied().unwrap_or(f64::NAN);
    let mut lines = vec![
        format!("Spherical harmonics of the sky: {} ({}), {} bands.", record.name, record.program, form.bands()),
        String::new(),
        "Coefficients of the upper hemisphere (below the horizon zero, but for ground light), linear sRGB, not \
         clamped, kcd/m2; the".into(),
        "sun's disk is not part of the sky. Real orthonormal harmonics without the Condon-Shortley phase at index \
         l(l+1)+m: cos(m phi)"
            .into(),
        "for m > 0, sin(|m| phi) for m < 0. z is up, the sun stands at azimuth 0 = +x, so that m < 0 are zero; turn by \
         rotating about z."
            .into(),
    ];
    match options.fixed {
        Some((sun, turbidity)) => {
            lines.push(format!("Sun {:.6} degrees from the zenith, turbidity {turbidity}.", sun.to_degrees()))
        }
        None => {
            let [low, high] = form.turbidities();
            lines.push(format!(
                "Domain: sun zenith angle 0 to pi/2 (rad), turbidity {low} to {high}. Outside, the \
             result means nothing."
            ));
        }
    }
    lines.push(format!(
        "Error of the fit against direct integration: at most {:.1e}, median {:.1e} (root of the sum of squared \
         coefficient errors over",
        figure("error_worst"),
        figure("error_median")
    ));
    lines.push(format!(
        "the smallest c00 of the domain, {:.4} kcd/m2; worst channel, worst sky).",
        figure("smallest_c00")
    ));
    if options.ground > 0.0 {
        lines.push(format!(
            "Below the horizon: level matte ground of albedo {}, lit by this sky (not by the sun).",
            options.ground
        ));
    }
    lines
}

/// Numbers in lines of `each`, each followed by `suffix`. Reading them gives exactly the same numbers.
fn listed(values: impl Iterator<Item = f32>, each: usize, suffix: &str) -> String {
    let all: Vec<String> = values.map(|v| format!("{v:e}{suffix}")).collect();
    all.chunks(each).map(|row| format!("    {},\n", row.join(", "))).collect()
}

/// Preetham's constants by name, for formats that spell the formulas out.
struct Constants {
    perez: [[[f64; 2]; 5]; 3],
    zenith: [[[f64; 4]; 3]; 2],
    colours: [[f64; 3]; 3],
}

fn constants() -> Constants {
    Constants {
        perez: preetham::PEREZ,
        zenith: [preetham::ZENITH_X, preetham::ZENITH_Y],
        colours: rgb_from_separable(),
    }
}
