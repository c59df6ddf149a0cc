//! Slices on disk: `slices.exr`, `level.exr`, previews, `view.png`, `fit.toml`, `times.toml`.

use crate::grass::blades::{LawnMeadow, STEPS};
use crate::grass::judge::{AZIMUTHS, ELEVATIONS, LawnComparison, SUN};
use crate::grass::march::LawnSlices;
use crate::grass::sheet::SliceAtlas;
use crate::grass::weights::LawnProjection;
use crate::grass::{Error, Options, Result, optics};
use crate::record::{FitKind, FitParameter, FitRecord, RecordSection};
use mesophyll_files::hash;
use std::path::Path;

/// The sheet of all upright slices: first the slices across x, then those across y, eight to a line.
pub const UPRIGHT: &str = "slices.exr";
/// The level slice.
pub const LEVEL: &str = "level.exr";

/// Writes sheets and previews, and names them in the record.
pub(crate) fn write(out: &Path, slices: &LawnSlices, record: &mut FitRecord) -> Result<()> {
    let mut white = 0f32;
    for t in slices.upright.levels[0].texels.iter().filter(|t| t[0] > 0.0) {
        white = white.max(t[1..4].iter().fold(0.0, |a: f32, b| a.max(*b)) / t[0]);
    }
    let sheets = [(UPRIGHT, "slices.png", Some(&slices.upright)), (LEVEL, "level.png", slices.level.as_ref())];
    for (name, picture, sheet) in sheets {
        let path = out.join(name);
        match sheet {
            Some(sheet) => {
                sheet.write(&path)?;
                sheet.preview(&out.join(picture), white.max(f32::MIN_POSITIVE))?;
                record.files.insert(name.into(), hash::file(&path)?);
            }
            // The files are left from an earlier fit with other options.
            None => [path, out.join(picture)].iter().for_each(|old| drop(std::fs::remove_file(old))),
        }
    }
    Ok(())
}

/// Opens a fit of slices.
///
/// # Errors
/// [`Error::Input`] for a folder without a fit or with one of another kind, for a damaged file, and for a record that
/// lacks what a drawing needs.
pub fn open(folder: &Path) -> Result<LawnSlices> {
    let record = FitRecord::read_as(folder, FitKind::Grass)?;
    let path = folder.join("fit.toml");
    let all = record.sections.get("all").cloned().unwrap_or_default();
    let numbers = |name: &str, count: usize, least: f64| match all.params.get(name) {
        Some(p) if p.value.len() == count && p.value.iter().all(|v| v.is_finite() && *v >= least) => {
            Ok(p.value.clone())
        }
        found => {
            let found = found.map_or("nothing".into(), |p| format!("{:?}", p.value));
            let sort = if least > 0.0 { "positive numbers" } else { "numbers of 0 or more" };
            Err(Error::unexpected(&path, name, found, format!("{count} {sort}")))
        }
    };
    let counted = |name: &str, least: usize| match all.counts.get(name) {
        Some(n) if (least..=4096).contains(n) => Ok(*n),
        found => Err(Error::unexpected(&path, name, format!("{found:?}"), format!("a whole number, {least} to 4096"))),
    };
    let texels = |name: &str| match counted(name, 4)? {
        n if n.is_power_of_two() => Ok(n),
        n => Err(Error::unexpected(&path, name, n, "a power of two")),
    };
    let period = numbers("period", 2, f64::MIN_POSITIVE)?;
    let count = counted("slices", 1)?;
    let cell = [texels("texels_along")?, texels("texels_high")?];
    let table = |name: &str| {
        // Blades that stand upright show no area to a direction straight from above, so the table may hold 0.
        let mut table = [0.0; STEPS + 1];
        table.copy_from_slice(&numbers(name, STEPS + 1, 0.0)?);
        Ok::<_, Error>(table)
    };
    let own = table("projection_of_blades")?;
    let level = match record.files.contains_key(LEVEL) {
        true => Some(SliceAtlas::read(&folder.join(LEVEL), [cell[0], texels("texels_across")?], 1)?),
        false => None,
    };
    let upright = SliceAtlas::read(&folder.join(UPRIGHT), cell, 2 * count)?;
    Ok(LawnSlices {
        period: [period[0], period[1]],
        height: numbers("height", 1, f64::MIN_POSITIVE)?[0],
        count,
        projection: table("projection")?,
        shown: [own[0], own[STEPS]],
        cover: LawnSlices::covers(&upright, level.as_ref()),
        upright,
        level,
        weighted: true,
        irregular: None,
    })
}

/// Compares a fit with the meadow and the leaves that a scene asks for, and says in words how they differ. Two figures
/// count as equal where their relative difference is at most `same`.
///
/// # Errors
/// As [`open`], and for a table of leaves that cannot be read.
pub fn differs(folder: &Path, meadow: &LawnMeadow, leaves: Option<&Path>, same: f64) -> Result<Option<String>> {
    let record = FitRecord::read_as(folder, FitKind::Grass)?;
    let all = record.sections.get("all").cloned().unwrap_or_default();
    let own = [
        ("period", meadow.period.to_vec(), "mm"),
        ("height", vec![meadow.height], "mm"),
        ("leaf_area_index", vec![meadow.leaf_area_index], ""),
    ];
    for (name, here, unit) in own {
        let there = all.params.get(name).map_or_else(Vec::new, |p| p.value.clone());
        let close = |(a, b): (&f64, &f64)| (a - b).abs() <= same * b.abs();
        if there.len() != here.len() || !there.iter().zip(&here).all(close) {
            return Ok(Some(format!(
                "is of another meadow: its {name} is {there:?} {unit}, the meadow's {here:?} {unit}"
            )));
        }
    }
    let (there, here) = (record.options.get("leaves").cloned().unwrap_or_default(), optics::told(leaves)?);
    Ok((there != here).then(|| format!("was made with other leaves: {there}; the scene has {here}")))
}

/// Writes what the record says of the fit: one section for the whole, and one for each elevation.
pub(crate) fn describe(
    record: &mut FitRecord,
    meadow: &LawnMeadow,
    slices: &LawnSlices,
    options: &Options,
    leaves: String,
    known: &[LawnProjection],
    judged: &[LawnComparison],
) {
    let mut say = |name: &str, text: String| record.options.insert(name.into(), text);
    let [w, h] = options.texels;
    say("slices", format!("{n} across x and {n} across y, {w}x{h} texels each", n = options.slices));
    say("level slice", if options.level { "at half the height" } else { "none" }.into());
    say("rays", format!("{n}x{n} a texel", n = options.rays));
    say("leaves", leaves);
    say("opacity", "weighted by direction, so that the optical depth is the blades'".into());
    say("judged by", format!("{} azimuths an elevation; sun at zenith {}, azimuth {}", AZIMUTHS.len(), SUN[0], SUN[1]));
    let mut all = RecordSection::default();
    let mut add = |name: &str, value: Vec<f64>, unit: &str| {
        // These figures are counted over the blades, not measured. So they have no standard error.
        let stderr = vec![f64::NAN; value.len()];
        all.params.insert(name.into(), FitParameter { value, stderr, unit: unit.into(), ..FitParameter::default() });
    };
    add("period", meadow.period.to_vec(), "mm");
    add("height", vec![meadow.height], "mm");
    add("leaf_area_index", vec![meadow.leaf_area_index], "");
    add("projection_of_blades", meadow.projection.to_vec(), "");
    let undetermined = |(k, found): (usize, &LawnProjection)| found.why.as_ref().map(|why| format!("{k}: {why}"));
    let fitted = FitParameter {
        value: known.iter().map(|k| k.value).collect(),
        stderr: known.iter().map(|k| k.error).collect(),
        undetermined: known.iter().enumerate().filter_map(undetermined).collect(),
        ..FitParameter::default()
    };
    all.params.insert("projection".into(), fitted);
    let counts = [("blades", meadow.blades), ("slices", slices.count), ("texels_along", w), ("texels_high", h)];
    all.counts.extend(counts.map(|(name, n)| (name.to_string(), n)));
    if let Some(level) = &slices.level {
        all.counts.insert("texels_across".into(), level.cell[1]);
    }
    errors(&mut all, judged);
    all.figures.insert("bytes_on_gpu".into(), slices.bytes() as f64);
    record.sections.insert("all".into(), all);
    for (k, elevation) in ELEVATIONS.into_iter().enumerate() {
        let here: Vec<LawnComparison> = judged.iter().filter(|j| j.elevation == k).copied().collect();
        let mut section = RecordSection::default();
        let mean = |of: &dyn Fn(&LawnComparison) -> f64| here.iter().map(of).sum::<f64>() / here.len().max(1) as f64;
        section.figures.insert("coverage_of_blades".into(), mean(&|j| j.blades.coverage));
        section.figures.insert("coverage_of_slices".into(), mean(&|j| j.slices.coverage));
        section.figures.insert("sunlit_of_blades".into(), mean(&|j| j.blades.sunlit.iter().sum::<f64>() / 3.0));
        section.figures.insert("sunlit_of_slices".into(), mean(&|j| j.slices.sunlit.iter().sum::<f64>() / 3.0));
        section.figures.insert("share_of_4_steps".into(), mean(&|j| j.first[0]));
        section.figures.insert("share_of_16_steps".into(), mean(&|j| j.first[1]));
        errors(&mut section, &here);
        record.sections.insert(format!("elevation {elevation:02}"), section);
    }
}

/// Writes the root mean squares over the directions, and the largest error.
fn errors(section: &mut RecordSection, judged: &[LawnComparison]) {
    let errors = LawnErrors::of(judged);
    let figures = [
        ("coverage_rms_error", errors.coverage),
        ("coverage_worst_error", errors.coverage_worst),
        ("colour_rms_relative_error", errors.colour),
        ("sunlit_rms_relative_error", errors.sunlit),
    ];
    section.figures.extend(figures.map(|(name, v)| (name.to_string(), v)));
}

/// Errors over a number of directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawnErrors {
    /// Root mean square error of the coverage, as a share of all rays.
    pub coverage: f64,
    /// The largest error of the coverage in either direction.
    pub coverage_worst: f64,
    /// Root mean square error of the colour that is seen, relative to the root mean square of the blades' colour.
    pub colour: f64,
    /// The same for the colour under the sun.
    pub sunlit: f64,
}

impl LawnErrors {
    /// The errors over all given directions.
    pub fn of(judged: &[LawnComparison]) -> LawnErrors {
        let root = |sum: f64| (sum / judged.len().max(1) as f64).sqrt();
        let off = |j: &LawnComparison| j.slices.coverage - j.blades.coverage;
        let relative = |of: &dyn Fn(&LawnComparison) -> [[f64; 3]; 2]| {
            let [mut error, mut whole] = [0.0; 2];
            for [slices, blades] in judged.iter().map(of) {
                (0..3).for_each(|c| {
                    error += (slices[c] - blades[c]).powi(2);
                    whole += blades[c].powi(2);
                });
            }
            if whole > 0.0 { (error / whole).sqrt() } else { 0.0 }
        };
        LawnErrors {
            coverage: root(judged.iter().map(|j| off(j).powi(2)).sum()),
            coverage_worst: judged.iter().map(|j| off(j).abs()).fold(0.0, f64::max),
            colour: relative(&|j| [j.slices.colour, j.blades.colour]),
            sunlit: relative(&|j| [j.slices.sunlit, j.blades.sunlit]),
        }
    }
}
