//! From folders to rows. A fit folder has `fit.toml`; the folder of a run may have `check.json`, `plan.json` and
//! several fits.

use crate::maps::{self, ReportSideMaps};
use crate::model::{FitReport, ParameterRow, QualityLevel, Report, ReportVerdict, SectionReport, TimesReport};
use crate::{Error, Result};
use crate::{Options, ReportSource, comparison, held_out, notes, overall, pictures, scene, translucency, verdict};
use mesophyll_fits::leaf_folder::LeafFitFile;
use mesophyll_fits::record::next::NextMeasurement;
use mesophyll_fits::record::{FitKind, FitRecord, FitTimes, RecordSection};
use std::path::{Path, PathBuf};

/// Version of the JSON rows.
const SCHEMA: u32 = 1;

/// Reads every source.
///
/// # Errors
/// [`Error::Input`] when a folder holds nothing to report, or when `fit.toml`, `check.json` or `plan.json` exists and
/// is broken. Everything else that is missing or damaged is described in the report.
pub fn read(sources: &[ReportSource], options: &Options) -> Result<Report> {
    let mut fits = Vec::new();
    let mut folders = Vec::new();
    let mut checks = Vec::new();
    let mut plans = Vec::new();
    for source in sources {
        let found = fit_folders(&source.folder)?;
        let check = scene::read_check(&source.folder, options.pictures)?;
        let plan = scene::read_plan(&source.folder)?;
        if found.is_empty() && check.is_none() && plan.is_none() {
            return Err(Error::input(
                &source.folder,
                "nothing to report here: no fit.toml, check.json or plan.json, expected at least one",
            ));
        }
        checks.extend(check);
        plans.extend(plan);
        for folder in found {
            fits.push(fit(&folder, options, true)?);
            folders.push(folder);
        }
    }
    tell_apart(&mut fits);
    let mut comparisons = Vec::new();
    if options.compare {
        for k in 1..fits.len() {
            comparisons.push(against_first(&fits[0], &fits[k], &folders[0], &folders[k], options));
        }
    }
    let title = match fits.as_slice() {
        [] => "Check".to_string(),
        [one] => one.name.clone(),
        [a, b] if options.compare => format!("{} and {}", a.name, b.name),
        many => many.iter().map(|f| f.name.as_str()).collect::<Vec<_>>().join(", "),
    };
    let verdict = overall::overall(&fits, &checks);
    let program = concat!("mesophyll ", env!("CARGO_PKG_VERSION")).to_string();
    Ok(Report {
        schema: SCHEMA,
        program,
        title: options.title.clone().unwrap_or(title),
        verdict,
        fits,
        comparisons,
        plans,
        checks,
    })
}

/// The folder itself when it is a fit; otherwise the fits below it and below its `fits/`, by name.
fn fit_folders(folder: &Path) -> Result<Vec<PathBuf>> {
    if !folder.is_dir() {
        return Err(Error::input(folder, "no such folder"));
    }
    if folder.join("fit.toml").exists() {
        return Ok(vec![folder.to_path_buf()]);
    }
    let mut out = Vec::new();
    for place in [folder.to_path_buf(), folder.join("fits")] {
        if let Ok(entries) = std::fs::read_dir(&place) {
            out.extend(entries.flatten().map(|e| e.path()).filter(|p| p.join("fit.toml").exists()));
        }
    }
    out.sort();
    Ok(out)
}

/// Fits of the same name get their folders added, so that they can be told apart.
fn tell_apart(fits: &mut [FitReport]) {
    let names: Vec<String> = fits.iter().map(|f| f.name.clone()).collect();
    for (k, fit) in fits.iter_mut().enumerate() {
        if names.iter().filter(|n| **n == names[k]).count() > 1 {
            let folder =
                Path::new(&fit.folder).file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            fit.name = if folder == names[k] || folder.is_empty() { fit.folder.clone() } else { folder };
            if let Some(rest) = fit.verdict.sentence.strip_prefix(names[k].as_str()) {
                fit.verdict.sentence = format!("{}{rest}", fit.name);
            }
        }
    }
}

/// The verdict on the fit in `folder`. It does not rest on the statistics of the maps, which take most of the time.
///
/// # Errors
/// As [`read`].
pub fn verdict_of(folder: &Path) -> Result<ReportVerdict> {
    Ok(fit(folder, &Options::default(), false)?.verdict)
}

fn fit(folder: &Path, options: &Options, with_maps: bool) -> Result<FitReport> {
    let record = FitRecord::read(folder)?;
    let mut missing = Vec::new();
    let mut capture = record.options.get("capture").cloned();
    let times = match FitTimes::read(folder) {
        Ok(t) => {
            capture = t.capture.or(capture);
            Some(TimesReport {
                phases: t.phases,
                total_s: t.total_s,
                threads: t.threads,
                peak_memory_mib: t.peak_memory_mib,
                traces: t.traces,
            })
        }
        Err(_) if !folder.join("times.toml").exists() => {
            missing.push("times.toml: not there, so no run times and no traces".into());
            None
        }
        Err(e) => {
            missing.push(format!("{e}; so no run times and no traces"));
            None
        }
    };
    missing.extend(
        record
            .files
            .keys()
            .filter(|n| !folder.join(n).exists())
            .map(|n| format!("{n}: named in fit.toml and not there")),
    );
    let mut report = FitReport {
        name: if record.name.is_empty() { folder.display().to_string() } else { record.name.clone() },
        kind: record.kind,
        folder: folder.display().to_string(),
        program: record.program.clone(),
        input_hash: record.input_hash.clone(),
        termination: record.termination.map(|t| t.name().to_string()),
        verdict: ReportVerdict {
            level: QualityLevel::Doubtful,
            sentence: String::new(),
            missed: false,
            reasons: Vec::new(),
        },
        next_measurement: record.pass_first(record.next_measurement.clone().or_else(|| NextMeasurement::of(&record))),
        options: record.options.clone(),
        parameters: ordered(&record).flat_map(|(n, s)| parameters(n, s)).collect(),
        sections: ordered(&record).map(|(n, s)| section(n, s)).collect(),
        maps: Vec::new(),
        held_out: held_out::read(folder, &record, options.pictures),
        times,
        steps: pictures::steps(folder, &record),
        missing,
        pictures: Vec::new(),
    };
    if let Some(detail) = options.pictures {
        report.pictures = pictures::residuals(folder, &record, detail, &mut report.missing);
    }
    for (name, of) in ordered(&record).filter(|_| with_maps) {
        let Some(mut side) = side(folder, name, &record, capture.as_deref().map(Path::new), &mut report.missing) else {
            continue;
        };
        side.detail = options.pictures.unwrap_or(side.detail);
        side.texel_mm = record.options.get("texel_mm").and_then(|mm| mm.parse().ok()).filter(|mm: &f64| *mm > 0.0);
        notes::add(&mut side, &record, of);
        let mut lacking = Vec::new();
        report.maps.extend(side.rows(&mut lacking));
        if record.kind == FitKind::Leaf {
            report.missing.extend(lacking);
        }
        if options.pictures.is_some() {
            report.pictures.push(match record.kind {
                FitKind::Translucency => translucency::pictures(&side, &record.options),
                _ => side.pictures(&record.defects),
            });
        }
    }
    report.verdict = verdict::of_fit(&record, folder, &report);
    Ok(report)
}

/// A fit's name and the maps of its sides, with their truth where there is one; what is missing is left out.
pub fn sides(folder: &Path) -> Result<(String, Vec<ReportSideMaps>)> {
    let record = FitRecord::read(folder)?;
    let capture = FitTimes::read(folder).ok().and_then(|t| t.capture).or(record.options.get("capture").cloned());
    let maps = |(name, _): (&str, &RecordSection)| {
        side(folder, name, &record, capture.as_deref().map(Path::new), &mut Vec::new())
    };
    let found = ordered(&record).filter_map(maps).collect();
    Ok((record.name, found))
}

/// The maps of a section. Sections that are not sides (`all`) have none and lack none.
fn side(
    folder: &Path,
    name: &str,
    record: &FitRecord,
    capture: Option<&Path>,
    missing: &mut Vec<String>,
) -> Option<ReportSideMaps> {
    if record.kind != FitKind::Leaf && !folder.join(LeafFitFile::Maps.of(name)).exists() {
        return None;
    }
    // Only sides have maps; `all`, `blade` and the like contain figures.
    if !matches!(name, "front" | "back") && !folder.join(LeafFitFile::Maps.of(name)).exists() {
        return None;
    }
    if record.kind != FitKind::Leaf {
        // Only a leaf fit has the maps of a leaf; other fits do not lack them.
        return maps::read_side(folder, name, capture, &mut Vec::new());
    }
    maps::read_side(folder, name, capture, missing)
}

/// Front before back, the rest by name.
fn ordered(record: &FitRecord) -> impl Iterator<Item = (&str, &RecordSection)> {
    let mut list: Vec<(&str, &RecordSection)> = record.sections.iter().map(|(n, s)| (n.as_str(), s)).collect();
    list.sort_by_key(|(n, _)| (*n != "all", *n != "front", *n != "back", n.to_string()));
    list.into_iter()
}

fn section(name: &str, s: &RecordSection) -> SectionReport {
    SectionReport {
        name: name.into(),
        counts: s.counts.clone(),
        terminations: s.terminations.clone(),
        residuals: s.residuals.clone(),
        truth: s.truth.clone(),
        figures: s.figures.clone(),
        correlation_names: s.correlation_names.clone(),
        correlation: s.correlation.clone(),
        condition: s.condition,
        rank: s.rank,
    }
}

/// One row for each channel. A channel is undetermined where an entry such as `sigma_a.B: at most 0.02` (or the whole
/// name) says so, and where its error is infinite.
fn parameters(section: &str, s: &RecordSection) -> Vec<ParameterRow> {
    let mut rows = Vec::new();
    for (name, p) in &s.params {
        for (k, value) in p.value.iter().enumerate() {
            let channel = match (p.value.len(), k) {
                (1, _) => String::new(),
                (3, k) => ["R", "G", "B"][k].to_string(),
                (_, k) => k.to_string(),
            };
            let own = if channel.is_empty() { name.clone() } else { format!("{name}.{channel}") };
            let named = p.undetermined.iter().find_map(|text| {
                let (who, why) = text.split_once(':').unwrap_or((text, ""));
                [own.as_str(), name.as_str(), channel.as_str()].contains(&who.trim()).then(|| why.trim().to_string())
            });
            let stderr = p.stderr.get(k).copied().filter(|e| e.is_finite());
            // NaN means that no error was stated (a measured gauge, or a coefficient of a function that was not
            // measured). The value is not unknown.
            let unbounded = p.stderr.get(k).is_some_and(|e| e.is_infinite()).then(String::new);
            let undetermined = named.or(unbounded);
            rows.push(ParameterRow {
                section: section.into(),
                name: name.clone(),
                channel,
                value: Some(*value).filter(|v| v.is_finite()),
                stderr,
                stderr_caliper: p.stderr_caliper.get(k).copied().filter(|e| e.is_finite()),
                unit: p.unit.clone(),
                undetermined,
            });
        }
    }
    rows
}

fn against_first(
    a: &FitReport,
    b: &FitReport,
    folder_a: &Path,
    folder_b: &Path,
    options: &Options,
) -> crate::model::FitComparison {
    let mut out = comparison::parameters(a, b);
    let mut said = Vec::new();
    for section in a.sections.iter().map(|s| s.name.as_str()).filter(|n| b.sections.iter().any(|s| s.name == *n)) {
        let exists = |f: &Path| f.join(LeafFitFile::Maps.of(section)).exists();
        if !exists(folder_a) || !exists(folder_b) {
            continue;
        }
        let read = |f: &Path, said: &mut Vec<String>| maps::read_side(f, section, None, said);
        if let (Some(x), Some(y)) = (read(folder_a, &mut said), read(folder_b, &mut said)) {
            comparison::side(&mut out, &x, &y, options.pictures);
        }
    }
    out
}
