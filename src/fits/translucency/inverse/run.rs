//! `fit tissue`: reads photographs under beams and a leaf fit, and writes a record.

use super::comparison::{SlabReference, differences};
use super::{ThicknessErrors, TissueChannel, TissueCoefficients, TissueImage, TissueMeasurement, TissueNoise, folder};
use crate::leaf_folder::{LeafFitFile, filling};
use crate::record::maker::{self, FitMaker, FitOutcome};
use crate::record::{FitKind, FitRecord};
use crate::translucency::TexelArea;
use crate::translucency::side::{lit, surface};
use crate::translucency::source::{DirectionFrame, TranslucencyLeaf, TranslucencySideMaps};
use crate::translucency::tissue::{LightEntry, TABLE, mean};
use crate::translucency::{Error, Result};
use mesophyll_base::statistics::median_of;
use mesophyll_capture::beams::BeamsCapture;
use mesophyll_capture::dome::noise;
use mesophyll_files::image::{read_exr, read_exr_rows};
use mesophyll_files::quantity::{Quantity, RGB};
use mesophyll_optics::side::Side;
use mesophyll_optics::side::mirror;
use mesophyll_optics::translucency::horizon::Horizon;
use mesophyll_optics::translucency::irradiance::{Visibility, irradiance};
use std::path::Path;
use std::time::Instant;
use strum::{Display, EnumIter, EnumMessage, EnumString, IntoStaticStr};

/// Where the search begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Display, EnumString, EnumIter, IntoStaticStr, EnumMessage)]
#[strum(serialize_all = "kebab-case")]
pub enum TissueFitStart {
    /// The leaf fit's slab; the table's tissue where the slab is not determined.
    #[default]
    Slab,
    /// H9 Table 3.1, whatever the leaf.
    Table,
}

/// The options of `fit tissue`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// How the search is done.
    pub fit: super::Options,
    /// The g for which σs is stated.
    pub g: f64,
    /// How much light enters a texel.
    pub entry: LightEntry,
    /// Where the search begins.
    pub start: TissueFitStart,
    /// Readings within this distance (mm) of a picture border that the leaf extends beyond are left out. `None` means
    /// six mean thicknesses.
    pub margin_mm: Option<f64>,
    /// Fit again although the folder holds this very fit.
    pub force: bool,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            fit: super::Options::default(),
            g: 0.0,
            entry: LightEntry::Matched,
            start: TissueFitStart::Slab,
            margin_mm: None,
            force: false,
        }
    }
}

/// What a synthetic capture was made from.
#[derive(Debug, Clone, PartialEq)]
pub struct TissueFitTruth(pub TissueCoefficients);

/// Fits the tissue of the photographs in `beams` on the blade of the leaf fit `blade` into the folder `out`.
///
/// # Errors
/// Inputs that cannot be read or do not belong together (exit code 2); a search that does not converge or has nothing
/// to fit (1); a folder that cannot be written (2).
pub fn run(beams: &Path, blade: &Path, out: &Path, options: &Options) -> Result<FitOutcome> {
    let (capture, leaf, options) = (beams.to_path_buf(), blade.to_path_buf(), *options);
    maker::make(FitKind::Tissue, out, &[beams, blade], move |maker| fit(&capture, &leaf, &options, maker))
}

fn fit(beams: &Path, blade: &Path, options: &Options, maker: &mut FitMaker) -> Result<FitOutcome> {
    let step = Instant::now();
    let capture = BeamsCapture::open(beams)?;
    let source = TranslucencyLeaf::read(blade, DirectionFrame::Photograph)?;
    let told = format!("{:?}", Options { force: false, ..*options });
    let made_from = [("beams", capture.hash()?), ("leaf", source.hash.clone()), ("options", told)];
    let input = maker::input_hash(made_from.iter().map(|(name, hash)| (*name, hash.as_str())));
    if let Some(found) = maker.up_to_date(input, options.force)? {
        return Ok(found);
    }
    let mut measured = measured(&capture, &source, options)?;
    measured.thickness_errors = thickness_errors(blade, &capture, &source, &measured)?;
    let slab = slab(blade, &source)?;
    let start = start(&slab, options);
    maker.times.capture = Some(beams.display().to_string());
    maker.times.phase("read, horizon maps, irradiance", step);
    let fitted = maker.phase("fit", || super::fit(&measured, &start, &super::Options { told: true, ..options.fit }))?;
    let truth = truth(&capture, &source);
    let mut stderr = fitted.certainty.stderr.clone();
    if options.fit.fix_scale {
        stderr.push(0.0);
    }
    let differences = differences(&fitted.tissues, &stderr, &slab, source.thickness_mm);
    let mut record = maker.record(&capture.manifest.name);
    folder::describe(&mut record, &measured, &fitted, options, &slab, &differences, truth.as_ref());
    folder::times(&mut maker.times, &fitted, truth.as_ref());
    maker.begin()?;
    Ok(FitOutcome::Done(maker.finish(record)?))
}

/// The photographs on the blade: light, geometry, and the readings that count.
///
/// # Errors
/// [`Error::Input`] for a blade of another size, a lit side that the leaf fit does not hold, or photographs without a
/// reading that counts.
pub fn measured(capture: &BeamsCapture, source: &TranslucencyLeaf, options: &Options) -> Result<TissueMeasurement> {
    let m = &capture.manifest;
    let file = capture.folder.join("capture.toml");
    if (m.width, m.height) != (source.width, source.height) {
        let (w, h) = (source.width, source.height);
        return Err(Error::field(
            &file,
            "width, height",
            format!("found {}x{}, expected {w}x{h} as the leaf fit's maps", m.width, m.height),
        ));
    }
    if (m.texel_mm / source.texel_mm - 1.0).abs() > 1e-3 {
        return Err(Error::field(
            &file,
            "texel_mm",
            format!("found {}, expected {} as the leaf fit's", m.texel_mm, source.texel_mm),
        ));
    }
    let side = |k: usize, name: Side| -> Result<&TranslucencySideMaps> {
        let missing =
            || Error::field(&file, &format!("beam {}: lit", k + 1), format!("the leaf fit holds no {}", name.name()));
        source.side(name).ok_or_else(missing)
    };
    let mut lit_sides: Vec<&TranslucencySideMaps> = Vec::new();
    for (k, beam) in m.beams.iter().enumerate() {
        let side = side(k, beam.lit)?;
        if !lit_sides.iter().any(|s| s.name == side.name) {
            lit_sides.push(side);
        }
    }
    // Shadows do not depend on the wavelength.
    let horizons: Vec<Horizon> = lit_sides
        .iter()
        .map(|s| Horizon::new(&lit(source, s, &surface(s, 0, LightEntry::Matched, TexelArea::Facet))))
        .collect();
    let counted: Vec<Vec<bool>> = lit_sides.iter().map(|s| counted(s, source, options)).collect();
    let mut channels = Vec::new();
    for (c, name) in RGB.iter().enumerate() {
        let mut images = Vec::new();
        for (k, beam) in m.beams.iter().enumerate() {
            let map = lit_sides.iter().position(|s| s.name == beam.lit).unwrap_or(0);
            let entering = surface(lit_sides[map], c, options.entry, TexelArea::Facet);
            let light =
                irradiance(&lit(source, lit_sides[map], &entering), &horizons[map], beam.direction(), Visibility::Hard);
            let exit = match options.entry {
                LightEntry::Matched => vec![1.0; source.width * source.height],
                LightEntry::Albedo => {
                    let other = if beam.lit == Side::Front { Side::Back } else { Side::Front };
                    let seen = source.side(other).ok_or_else(|| {
                        let need =
                            format!("--entry albedo needs the {}'s reflectance; the leaf fit holds none", other.name());
                        Error::field(&file, &format!("beam {}: lit", k + 1), need)
                    })?;
                    mirror(&surface(seen, c, LightEntry::Albedo, TexelArea::Texel).entry, source.width)
                }
            };
            let seen = capture.photographs[k][c].clone();
            let used = seen.iter().zip(&counted[map]).map(|(v, u)| *u && v.is_finite()).collect();
            images.push(TissueImage { map, light, cosine: beam.direction()[2].clamp(1e-3, 1.0), exit, seen, used });
        }
        let a = match options.entry {
            LightEntry::Matched => 1.0,
            LightEntry::Albedo => {
                let rho = mean(&lit_sides[0].rho_d[c], &lit_sides[0].mask).clamp(0.0, 0.99);
                (1.0 + rho) / (1.0 - rho)
            }
        };
        channels.push(TissueChannel { name: (*name).into(), a, images });
    }
    let noise = noise_of(m.noise_relative, m.noise_floor, &channels, source.width);
    let thickness = lit_sides.iter().map(|s| s.thickness.clone()).collect();
    Ok(TissueMeasurement {
        width: source.width,
        texel_mm: source.texel_mm,
        thickness,
        thickness_errors: ThicknessErrors::default(),
        channels,
        noise,
    })
}

/// What the leaf fit in `blade` states about the errors of the thickness maps that the beams of `capture` enter.
///
/// # Errors
/// [`Error::Input`] for a map of errors that is missing, damaged or of another size.
fn thickness_errors(
    blade: &Path,
    capture: &BeamsCapture,
    source: &TranslucencyLeaf,
    measured: &TissueMeasurement,
) -> Result<ThicknessErrors> {
    let mut out = ThicknessErrors::default();
    let mut first: Option<Side> = None;
    for beam in &capture.manifest.beams {
        if out.each.len() == measured.thickness.len() || first == Some(beam.lit) {
            continue;
        }
        first.get_or_insert(beam.lit);
        let path = LeafFitFile::Errors.path(blade, beam.lit);
        let (w, h) = (source.width, source.height);
        let maps = read_exr_rows(&path, Some(&[&Quantity::Thickness.channel(0)]), None)?;
        maps.require_size(&path, w, h)?;
        let each = maps.require_scalar(&path, Quantity::Thickness)?;
        let known: Vec<bool> = each.iter().map(|e| e.is_finite() && *e >= 0.0).collect();
        let each = each.iter().zip(&known).map(|(e, known)| if *known { f64::from(*e) } else { 0.0 });
        // A texel that took its neighbour's thickness takes the neighbour's error as well.
        let mut planes = [each.collect()];
        filling::nearest(&mut planes, &known, w, h);
        out.each.extend(planes);
    }
    let record = FitRecord::read(blade)?;
    let section = record.sections.get(source.sides[0].name.name());
    let figure = |name: &str| section.and_then(|s| s.figures.get(name)).copied().filter(|v| *v > 0.0);
    // Scanned heights are smoothed before their difference is taken. A Gaussian of s texels leaves 1/(2√π s) of white
    // noise, and the difference of two heights has √2 times the noise of one.
    if let (Some(height), Some(left)) = (figure("height_noise_mm"), figure("thickness_noise_mm")) {
        let smoothed = std::f64::consts::SQRT_2 * height / (2.0 * std::f64::consts::PI.sqrt() * left);
        out.smoothed = if smoothed > 0.5 { smoothed } else { 0.0 };
    }
    let shared = section.and_then(|s| s.params.get("thickness")).and_then(|p| p.stderr.first()).copied();
    out.shared = shared.filter(|e| e.is_finite()).unwrap_or(0.0) / source.thickness_mm;
    out.one_map =
        measured.thickness.len() == 2 && mirror(&measured.thickness[1], source.width) == measured.thickness[0];
    Ok(out)
}

/// The stated noise; only weights for exact values; an estimate where nothing is stated.
fn noise_of(relative: Option<f64>, floor: Option<f64>, channels: &[TissueChannel], width: usize) -> TissueNoise {
    match (relative, floor) {
        (None, None) => {
            let each = channels
                .iter()
                .flat_map(|c| &c.images)
                .filter_map(|i| noise::deviation(&i.seen, &i.used, width))
                .filter(|(_, level)| *level > 0.0)
                .map(|(sd, level)| sd / level);
            let relative = median_of(each).unwrap_or(0.0);
            if relative > 0.0 { TissueNoise { relative, floor: 0.0, known: false } } else { TissueNoise::EXACT }
        }
        (r, f) if r.unwrap_or(0.0) == 0.0 && f.unwrap_or(0.0) == 0.0 => TissueNoise::EXACT,
        (r, f) => TissueNoise { relative: r.unwrap_or(0.0), floor: f.unwrap_or(0.0), known: true },
    }
}

/// Texels of a lit side that count: on the leaf with all their neighbours, and away from borders of the picture that
/// the leaf extends beyond.
fn counted(side: &TranslucencySideMaps, source: &TranslucencyLeaf, options: &Options) -> Vec<bool> {
    let (w, h) = (source.width, source.height);
    let margin = options.margin_mm.unwrap_or(6.0 * source.thickness_mm) / source.texel_mm;
    let margin = margin.ceil() as usize;
    let on = |i: usize, j: usize| side.mask[j * w + i];
    let cut = |touches: bool, size: usize| if touches { margin.min(size / 3) } else { 0 };
    let left = cut((0..h).any(|j| on(0, j)), w);
    let right = cut((0..h).any(|j| on(w - 1, j)), w);
    let top = cut((0..w).any(|i| on(i, 0)), h);
    let bottom = cut((0..w).any(|i| on(i, h - 1)), h);
    let whole = |i: usize, j: usize| {
        (j.saturating_sub(1)..(j + 2).min(h)).all(|b| (i.saturating_sub(1)..(i + 2).min(w)).all(|a| on(a, b)))
    };
    (0..w * h)
        .map(|k| {
            let (i, j) = (k % w, k / w);
            i >= left && i + right < w && j >= top && j + bottom < h && whole(i, j)
        })
        .collect()
}

/// The leaf fit's coefficients of the first side, with their errors.
fn slab(blade: &Path, source: &TranslucencyLeaf) -> Result<SlabReference> {
    let side = &source.sides[0];
    let record = FitRecord::read(blade)?;
    let errors = |name: &str| {
        let found = record
            .sections
            .get(side.name.name())
            .and_then(|s| s.params.get(name))
            .map(|p| p.stderr.clone())
            .unwrap_or_default();
        if found.len() == 3 { found } else { vec![f64::NAN; 3] }
    };
    Ok(SlabReference {
        sigma_a: side.sigma_a.to_vec(),
        sigma_s: side.sigma_s.to_vec(),
        sigma_a_err: errors("sigma_a"),
        sigma_s_err: errors("sigma_s"),
    })
}

fn start(slab: &SlabReference, options: &Options) -> TissueCoefficients {
    let table = [TABLE[0], (1.0 - TABLE[2]) * TABLE[1]];
    let usable = |v: f64| v.is_finite() && v > 1e-4 && v < 500.0;
    let pick = |v: f64, other: f64| if options.start == TissueFitStart::Slab && usable(v) { v } else { other };
    TissueCoefficients {
        sigma_a: slab.sigma_a.iter().map(|v| pick(*v, table[0])).collect(),
        reduced: slab.sigma_s.iter().map(|v| pick(*v, table[1])).collect(),
        scale: 1.0,
    }
}

/// σ and thickness that a synthetic capture was made from, where σ does not vary over the leaf.
fn truth(capture: &BeamsCapture, source: &TranslucencyLeaf) -> Option<TissueFitTruth> {
    let side = source.sides.first()?;
    let maps = read_exr(&mesophyll_capture::truth_path(&capture.folder, side.name)).ok()?;
    let mask: Vec<bool> = maps.scalar(Quantity::Mask)?.iter().zip(&side.mask).map(|(v, m)| *v > 0.0 && *m).collect();
    let uniform = |quantity, c| {
        let values: Vec<f64> =
            maps.plane(quantity, c)?.iter().zip(&mask).filter(|(_, m)| **m).map(|(v, _)| f64::from(*v)).collect();
        let first = *values.first()?;
        values.iter().all(|v| (v / first - 1.0).abs() < 1e-5).then_some(first)
    };
    let all = |quantity| (0..3).map(|c| uniform(quantity, c)).collect::<Option<Vec<f64>>>();
    let thickness = mean(maps.scalar(Quantity::Thickness)?, &mask);
    let map = mean(&side.thickness.iter().map(|d| *d as f32).collect::<Vec<_>>(), &mask);
    Some(TissueFitTruth(TissueCoefficients {
        sigma_a: all(Quantity::SigmaA)?,
        reduced: all(Quantity::SigmaS)?,
        scale: thickness / map,
    }))
}
