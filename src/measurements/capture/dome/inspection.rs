//! A first look at a capture under a dome. It lists everything that is wrong with the files, and then the results of
//! the reduction: coverage, exposure, noise, how the two scans lie relative to each other, and whether the texels are
//! fine enough.

use super::manifest::{DomeManifest, DomePicture};
use super::reader::{DomeCapture, check_files};
use super::reduction::{DomeMaps, Options, reduce};
use crate::kind::CaptureKind;
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::{median_of, quantile};
use mesophyll_optics::side::Side;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// The result of a first look at a capture.
#[derive(Debug, Clone, Default, Serialize)]
pub struct DomeInspection {
    /// The capture's folder.
    pub folder: String,
    /// What its field `kind` says: `dome`.
    pub kind: &'static str,
    /// The contents of `capture.toml`; absent when it cannot be read.
    pub manifest: Option<DomeManifest>,
    /// Why the capture cannot be used; empty when it can.
    pub problems: Vec<String>,
    /// What can be used but deserves a look.
    pub warnings: Vec<String>,
    /// Consequences of what the capture holds and of what it lacks.
    pub notes: Vec<String>,
    /// The photographs' readings on the leaf.
    pub photographs: Vec<DomePhotographSummary>,
    /// Texels on the leaf.
    pub leaf_texels: Option<usize>,
    /// What the two height scans say; `None` where they cannot be read.
    pub shape: Option<ShapeSummary>,
    /// What each side's photographs say.
    pub sides: Vec<SideSummary>,
}

/// Readings of one photograph on the leaf, after the dark level was subtracted, relative to the median of its reference
/// (white sheet or back light).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DomePhotographSummary {
    /// Which photograph of which side.
    pub name: String,
    /// Quantile .001 of the readings.
    pub low: f64,
    /// Median of the readings.
    pub median: f64,
    /// Quantile .999 of the readings.
    pub high: f64,
    /// Share of the leaf's texels without a number in some channel, or saturated.
    pub no_reading_share: f64,
}

/// The results of the two scans.
#[derive(Debug, Clone, Serialize)]
pub struct ShapeSummary {
    /// How the scans lie to each other, and what was done about noise.
    pub alignment: super::alignment::ScanAlignment,
    /// Quantiles .01, .5, .99 of the thickness (mm).
    pub thickness_mm: [f64; 3],
    /// Share of the leaf's texels where either scan has a hole.
    pub hole_share: f64,
}

/// The results of one side's photographs.
#[derive(Debug, Clone, Serialize)]
pub struct SideSummary {
    /// `front` or `back`.
    pub side: &'static str,
    /// The mirrored light of the dome that is subtracted from the albedo.
    pub highlight: super::highlight::Highlight,
    /// Medians of the albedo, a channel each.
    pub albedo: Rgb,
    /// Medians of the transmittance, a channel each.
    pub transmittance: Rgb,
    /// Number of texels with each defect, by name.
    pub defects: BTreeMap<&'static str, usize>,
}

impl DomeInspection {
    /// Whether it can be used.
    pub fn fits(&self) -> bool {
        self.problems.is_empty()
    }
}

/// Looks at `CAPTURE`; whatever is wrong with it is in [`DomeInspection::problems`].
pub fn inspect(folder: &Path) -> DomeInspection {
    let mut found = DomeInspection {
        folder: folder.display().to_string(),
        kind: CaptureKind::Dome.field().unwrap_or_default(),
        ..DomeInspection::default()
    };
    let manifest = match DomeManifest::read(folder) {
        Ok(m) => m,
        Err(e) => {
            found.problems.push(e.to_string());
            return found;
        }
    };
    found.problems = check_files(folder, &manifest).iter().map(ToString::to_string).collect();
    if found.problems.is_empty() {
        match DomeCapture::open(folder).and_then(|c| reduce(&c, &Options::default()).map(|r| (c, r))) {
            Ok((capture, reduced)) => look(&capture, &reduced, &mut found),
            Err(e) => found.problems.push(e.to_string()),
        }
    }
    consequences(folder, &manifest, &mut found);
    found.manifest = Some(manifest);
    found
}

fn look(capture: &DomeCapture, r: &DomeMaps, found: &mut DomeInspection) {
    let m = &capture.manifest;
    let leaf = r.mask.iter().filter(|m| **m).count();
    found.leaf_texels = Some(leaf);
    for name in Side::ALL {
        let (side, pictures) = (&r.sides[name], &capture.sides[name]);
        let mask: Vec<bool> = side.status.iter().map(|s| *s != mesophyll_optics::defect::OUTSIDE).collect();
        for (picture, image, reference) in [
            (DomePicture::Albedo, &pictures.albedo, &capture.white),
            (DomePicture::Translucency, &pictures.translucency, &capture.empty),
        ] {
            let level = reference.iter().flatten().map(|v| f64::from(*v)).filter(|v| v.is_finite());
            let level = median_of(level).unwrap_or(0.0);
            let on = || image.iter().zip(&mask).zip(&pictures.saturated).filter(|((_, m), _)| **m);
            let blind =
                on().filter(|((v, _), s)| **s || v.iter().any(|c| !c.is_finite())).count() as f64 / leaf.max(1) as f64;
            let mut values: Vec<f64> =
                on().flat_map(|((v, _), _)| v.map(f64::from)).filter(|v| v.is_finite()).collect();
            let [low, median, high] = [0.001, 0.5, 0.999].map(|q| quantile(&mut values, q).unwrap_or(0.0) / level);
            let name = format!("{}/{}.exr", name.name(), picture.name());
            if blind > 0.01 {
                found.warnings.push(format!("{name}: {:.1} % of the leaf has no reading", 100.0 * blind));
            }
            let same = pictures.clipped;
            if picture == DomePicture::Albedo && same > 8 && same * 1000 > values.len() {
                found.warnings.push(format!(
                    "{name}: {same} readings share the highest value: clipped? Write NaN where saturated, or state \
                     full_scale"
                ));
            }
            if picture == DomePicture::Albedo && high < 0.02 {
                found.warnings.push(format!(
                    "{name}: the brightest of the leaf is {:.2} % of the white sheet: under-exposed?",
                    100.0 * high
                ));
            }
            found.photographs.push(DomePhotographSummary { name, low, median, high, no_reading_share: blind });
        }
        let medians =
            |map: &[Rgb]| Rgb::of(|c| median_of(map.iter().map(|v| v[c]).filter(|v| v.is_finite())).unwrap_or(0.0));
        let h = side.highlight;
        if h.stated && h.share > h.at_most {
            found.warnings.push(format!(
                "{}: the stated index mirrors {:.3} of the dome, the darkest texels show {:.3}: a lower index, or a \
                 dark level that is too high",
                name.name(),
                h.share,
                h.at_most
            ));
        }
        let defects = r.defects(name);
        for (defect, n) in defects.iter().filter(|(_, n)| **n * 100 > leaf) {
            found.warnings.push(format!(
                "{}: {:.1} % of the texels are defect: {defect}",
                name.name(),
                100.0 * *n as f64 / leaf as f64
            ));
        }
        found.sides.push(SideSummary {
            side: name.name(),
            highlight: h,
            albedo: medians(&side.albedo),
            transmittance: medians(&side.transmittance),
            defects,
        });
    }
    let mut d: Vec<f64> = r.thickness.iter().copied().filter(|v| v.is_finite()).collect();
    let thickness_mm = [0.01, 0.5, 0.99].map(|q| quantile(&mut d, q).unwrap_or(0.0));
    let front = &capture.sides.front.height;
    let back = mesophyll_optics::side::mirror(&capture.sides.back.height, m.width);
    let holes = (0..m.texels()).filter(|&k| r.mask[k] && !(front[k].is_finite() && back[k].is_finite())).count();
    let shape = ShapeSummary { alignment: r.alignment, thickness_mm, hole_share: holes as f64 / leaf.max(1) as f64 };
    shape_warnings(m, &shape, found);
    found.shape = Some(shape);
}

fn shape_warnings(m: &DomeManifest, s: &ShapeSummary, found: &mut DomeInspection) {
    let a = &s.alignment;
    let mut warn = |text: String| found.warnings.push(text);
    if s.thickness_mm[0] <= 0.0 {
        warn(format!(
            "a hundredth of the leaf is thinner than {:.3} mm: is thickness_max_mm = {} too small?",
            s.thickness_mm[0], m.thickness_max_mm
        ));
    }
    if m.texel_mm > s.thickness_mm[1] {
        warn(format!(
            "texel_mm is {}, the leaf is {:.3} mm thick: light spreads sideways by about its thickness, which such \
             texels do not resolve",
            m.texel_mm, s.thickness_mm[1]
        ));
    }
    if a.thickness_error_mm > 0.05 * s.thickness_mm[1] {
        warn(format!(
            "noise and smoothing leave {:.4} mm of the thickness unknown a texel, {:.0} % of its median",
            a.thickness_error_mm,
            100.0 * a.thickness_error_mm / s.thickness_mm[1]
        ));
    }
    if a.offset_err_mm > 0.1 * s.thickness_mm[1].max(1e-9) {
        warn(format!(
            "the zero of the thickness is known to {:.4} mm only, {:.0} % of its median",
            a.offset_err_mm,
            100.0 * a.offset_err_mm / s.thickness_mm[1]
        ));
    }
    if a.tilt[0].hypot(a.tilt[1]) > 0.05 {
        warn(format!(
            "the scans lean by {:.1}° to each other: were they rectified to the blade?",
            a.tilt[0].hypot(a.tilt[1]).atan().to_degrees()
        ));
    }
    let shift = a.shift_mm[0].hypot(a.shift_mm[1]);
    let doubt = a.shift_err_mm[0].hypot(a.shift_err_mm[1]);
    if shift > 0.75 * m.texel_mm && shift > 4.0 * doubt {
        warn(format!(
            "the back's scan lies about {shift:.3} mm beside the front's ({:.3}, {:.3}; ± {doubt:.3}), {:.1} texels: \
             slopes become thickness",
            a.shift_mm[0],
            a.shift_mm[1],
            shift / m.texel_mm
        ));
    }
    if s.hole_share > 0.02 {
        warn(format!(
            "{:.1} % of the leaf has no height on one side or both; filled from beside",
            100.0 * s.hole_share
        ));
    }
}

/// Consequences of the manifest and of missing files.
fn consequences(folder: &Path, m: &DomeManifest, found: &mut DomeInspection) {
    let mut note = |text: String| found.notes.push(text);
    if !folder.join("dark.exr").exists() {
        note("dark.exr is absent: no dark level is taken off".into());
    }
    if !folder.join("mask.exr").exists() {
        note("mask.exr is absent: the outline is taken from the back light".into());
    }
    if m.highlight_index.is_none() {
        note(
            "highlight_index is absent: one photograph does not tell highlight from colour; half the possible range \
         is taken off the albedo, the rest stands in its error"
                .into(),
        );
    }
    if m.thickness_max_err_mm.is_none() {
        note("thickness_max_err_mm is absent: the thickness's zero is as sure as the scans' noise alone allows".into());
    }
    if m.noise_relative.is_none() && m.noise_floor.is_none() {
        note("the photographs' noise is not stated: it is estimated, with fine texture counted as noise".into());
    }
    if m.height_noise_mm.is_none() {
        note(
            "height_noise_mm is absent: the scans' noise is estimated from the sum of both, with fine relief counted \
         as noise"
                .into(),
        );
    }
    note(
        "a thickness that grows evenly across the whole leaf cannot be told from the scans' lean and is taken off \
     with it"
            .into(),
    );
    if crate::truth_path(folder, Side::Front).exists() {
        note("truth/ is there: a synthetic capture".into());
    }
}
