//! A fitted sky as text that other programs compile or read: WGSL, GLSL, HLSL, a C header, JSON. It is either the
//! polynomials with their evaluator, or the N²×3 numbers for one sun and turbidity. One writer ([`language`]) writes
//! all four languages, so that a function is in all of them or in none.

mod fitted;
mod functions;
mod json;
mod language;
mod state;

use super::ExportFormat;
use crate::{Error, Result};
use language::{SourceLanguage, SourceText};
use mesophyll_fits::record::FitRecord;
use mesophyll_fits::sky::{SkyFitForm, folder};
use mesophyll_sky::harmonics::rotate_z;
use mesophyll_sky::irradiance::{add_ground, below_horizon};
use mesophyll_sky::polynomials::mix::{TURBIDITY_ZERO, rgb_from_separable};
use mesophyll_sky::polynomials::{FoldedPolynomials, PolynomialBasis};
use mesophyll_sky::truncation::{RadianceError, radiance_error};
use mesophyll_sky::{HORIZON_ROUNDING, HarmonicCoefficients, Preetham, SkyModel, SkyRefusal, preetham};
use state::{SkyAccess, SkyConstants};
use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;

/// The options of a sky's export, besides its format.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SkyExportOptions {
    /// Sun zenith angle (rad) and turbidity. If given, only the numbers for these are written, without polynomials.
    pub fixed: Option<(f64, f64)>,
    /// Azimuth of the sun (rad), where the sky is fixed.
    pub azimuth: f64,
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

    /// l(l+1)+m of every function, through all groups.
    fn places(&self) -> impl Iterator<Item = usize> + '_ {
        self.groups.iter().flat_map(|g| g.places.iter().copied())
    }

    /// Number of functions of the first group.
    fn first(&self) -> usize {
        self.groups[0].places.len()
    }

    /// Function by function, term by term, three values.
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
    if !options.azimuth.is_finite() {
        let what = format!("--sun-azimuth-deg is {}; expected a finite angle", options.azimuth);
        return Err(Error::Usage(what));
    }
    if options.ground > 0.0 && form.bands() < 2 {
        return Err(Error::Usage(
            "--ground needs a fit of two bands or more: the ground's light is the irradiance of two".into(),
        ));
    }
    let refused = |e: SkyRefusal| Error::Usage(e.to_string());
    let closed = record.options.get("model").is_some_and(|name| *name == SkyModel::Preetham.to_string());
    let source = SourceLanguage::of(format);
    let Some((sun_zenith, turbidity)) = options.fixed else {
        let evaluator = Evaluator::new(&form);
        let Some(language) = source else {
            return json::polynomials(&evaluator, &record, folder, options.ground);
        };
        let mut text = SourceText::new(language, &about(&record, &form, options, closed)?);
        state::describe(&mut text, form.bands(), closed);
        fitted::write(&mut text, &evaluator, options.ground, closed);
        let access = SkyAccess { fixed: false, closed, arrow: !language.is_shader() };
        functions::write(&mut text, access, form.bands());
        return Ok(text.finish());
    };
    let degrees = sun_zenith.to_degrees();
    if !(0.0..=90.0 + HORIZON_ROUNDING.to_degrees()).contains(&degrees) {
        let what = format!("--sun-zenith-deg is {degrees}; expected 0 (zenith) to 90 (horizon)");
        return Err(Error::Usage(what));
    }
    let [low, high] = form.turbidities();
    if !(low..=high).contains(&turbidity) {
        let what = format!("the fit {} covers {low} to {high}", folder.display());
        let cure = "`fit sky --turbidity LOW,HIGH` makes one that covers more";
        return Err(Error::Usage(format!("--turbidity is {turbidity}; {what}, and {cure}")));
    }
    let upper = coefficients(&form, sun_zenith, turbidity).map_err(refused)?;
    let ground = state::of_ground(&upper, options.ground);
    let harmonics = if options.ground > 0.0 { add_ground(&upper, [options.ground; 3], [0.0; 3]) } else { upper };
    let Some(language) = source else {
        return json::fixed(&rotate_z(&harmonics, options.azimuth), &record, options, sun_zenith, turbidity);
    };
    let mut text = SourceText::new(language, &about(&record, &form, options, closed)?);
    let sun_zenith = sun_zenith.min(FRAC_PI_2);
    let sky = SkyConstants { sun_zenith, azimuth: options.azimuth, turbidity, harmonics, ground };
    state::constants(&mut text, &sky, closed).map_err(refused)?;
    functions::write(&mut text, SkyAccess { fixed: true, closed, arrow: false }, form.bands());
    Ok(text.finish())
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
fn about(record: &FitRecord, form: &SkyFitForm<f32>, options: &SkyExportOptions, closed: bool) -> Result<Vec<String>> {
    let figure = |name: &str| record.sections.get("all").and_then(|s| s.figures.get(name)).copied().unwrap_or(f64::NAN);
    let mut lines: Vec<String> = [
        &format!("A clear sky: {} ({}), {} bands.", record.name, record.program, form.bands()),
        "",
        "z is up, azimuth grows from +x to +y, angles are radians; directions and normals have length 1 and point",
        "away from the surface. Radiance is in kcd/m2, irradiance in klx, both as linear sRGB, not clamped. The sun's",
        "disk is not part of the sky: a surface gets sky_irradiance, and sky_sun_light times the cosine to the sun.",
        "Harmonics are real and orthonormal without the Condon-Shortley phase, at index l(l+1)+m: cos(m phi) for",
        "m > 0, sin(|m| phi) for m < 0; of the upper hemisphere, and zero below the horizon but for ground light.",
        "",
    ]
    .map(String::from)
    .to_vec();
    let mut skies = Vec::new();
    if let Some((sun, turbidity)) = options.fixed {
        lines.push(format!("Sun {:.6} degrees from the zenith, turbidity {turbidity}.", sun.to_degrees()));
        lines.push("Any other azimuth of the sun: change SKY_AZIMUTH_COS and SKY_AZIMUTH_SIN.".into());
        skies.push((sun, turbidity));
    } else {
        let [low, high] = form.turbidities();
        lines.push(format!("Domain: sun zenith angle 0 to pi/2, turbidity {low} to {high}. Make a state by sky_at."));
        let turbidities = [low, 0.5 * (low + high), high];
        skies.extend((0..=6).flat_map(|k| turbidities.map(|t| (FRAC_PI_2 * f64::from(k) / 6.0, t))));
    }
    let albedo = options.ground;
    if albedo > 0.0 {
        lines.push(format!(
            "Below the horizon: level matte ground of albedo {albedo}, lit by this sky (not by the sun)."
        ));
    }
    lines.extend([
        format!(
            "Error of the coefficients against direct integration: at most {:.1e}, median {:.1e} (root of the sum of",
            figure("error_worst"),
            figure("error_median")
        ),
        format!(
            "squares over the smallest c00 of the domain, {:.4} kcd/m2; worst channel, worst sky).",
            figure("smallest_c00")
        ),
    ]);
    if closed {
        let refused = |e: SkyRefusal| Error::Usage(e.to_string());
        let mut worst = RadianceError { dome: 0.0, horizon: 0.0 };
        for (sun, turbidity) in skies {
            let sky = Preetham.at(sun, turbidity).map_err(refused)?;
            let c = coefficients(form, sun, turbidity).map_err(refused)?;
            worst = worst.or_worse(radiance_error(&c, &sky));
        }
        let which = if options.fixed.is_some() { "of this sky" } else { "of the worst sky" };
        lines.push(format!(
            "Error of sky_radiance {which}: {:.0} % over the dome and {:.0} % at the horizon (root mean square), for",
            100.0 * worst.dome,
            100.0 * worst.horizon
        ));
        lines.push(
            "bands are few: it is for lighting. sky_drawn is the model itself, right to the rounding of float.".into(),
        );
    } else {
        lines.push("sky_radiance is for lighting. This model has no closed form here to draw the sky by.".into());
    }
    Ok(lines)
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
