//! What a panorama's fit leaves on disk: `fit.toml`, `times.toml`, and `all.exr` (fate, reduced χ² and relative
//! residuals of every pixel).

use super::picture::Picture;
use super::{Found, NAMES, clipped};
use crate::Result;
use mesophyll_files::hash;
use mesophyll_files::image::{Maps, Packing, write_exr};
use mesophyll_files::table::Status;
use mesophyll_record::{FitRecord, Param, Phase, Residuals, SCHEMA, Section, Times};
use mesophyll_sky::preetham;
use std::collections::BTreeMap;
use std::path::Path;

/// Writes the folder. `options` is what the fit was told; `seconds` are those of reading and fitting.
///
/// # Errors
/// [`Error::Write`].
pub fn write(
    folder: &Path,
    picture: &Picture,
    found: &Found,
    options: &BTreeMap<String, String>,
    input_hash: String,
    seconds: [f64; 2],
) -> Result<()> {
    mesophyll_record::begin(folder, "panorama")?;
    let map = folder.join("all.exr");
    write_exr(&map, &maps(picture, found), Packing::Zip)?;
    let mut record = FitRecord {
        schema: SCHEMA,
        kind: "panorama".into(),
        name: "sky panorama".into(),
        program: concat!("mesophyll ", env!("CARGO_PKG_VERSION")).into(),
        input_hash,
        termination: Some(found.fit.termination),
        options: options.clone(),
        ..FitRecord::default()
    };
    record.options.insert("noise".into(), format!("{:.3e} of a reading, {}", found.noise, found.noise_from.name()));
    record.options.insert("status".into(), found.status.to_string());
    let [low, high] = preetham::TRUSTED;
    if !(low..=high).contains(&found.turbidity.value) {
        record
            .options
            .insert("remark".into(), format!("turbidity is outside the {low} to {high} for which preetham is trusted"));
    }
    record.defects = [("-1".to_string(), "clipped".to_string()), ("-2".into(), "outlier".into())].into();
    record.files.insert("all.exr".into(), hash::file(&map)?);
    record.sections.insert("all".into(), section(picture, found));
    let times = Times {
        phases: ["read", "fit"].iter().zip(seconds).map(|(n, s)| Phase { name: (*n).into(), seconds: s }).collect(),
        total_s: seconds.iter().sum(),
        threads: rayon::current_num_threads(),
        traces: [("search".to_string(), found.search.clone()), ("fit".into(), found.fit.trace.clone())].into(),
        ..Times::default()
    };
    times.write(folder)?;
    record.write(folder)
}

fn section(picture: &Picture, found: &Found) -> Section {
    let u = &found.fit.uncertainty;
    let mut all = Section { condition: Some(u.condition), rank: Some(u.rank), ..Section::default() };
    let why = match &found.status {
        Status::Undetermined(text) => text.clone(),
        _ => String::new(),
    };
    let degrees = 180.0 / std::f64::consts::PI;
    let values = [
        (found.sun_zenith, degrees, "deg"),
        (found.sun_azimuth, degrees, "deg"),
        (found.turbidity, 1.0, ""),
        (found.scale, 1.0, "m2/kcd"),
    ];
    for (name, (k, unit, word)) in NAMES.iter().zip(values) {
        let undetermined =
            if why.split([' ', '(']).any(|w| w == *name) { vec![format!("{name}: {why}")] } else { Vec::new() };
        all.params.insert(
            (*name).into(),
            Param {
                value: vec![k.value * unit],
                stderr: vec![k.error * unit],
                unit: word.into(),
                undetermined,
                ..Param::default()
            },
        );
    }
    all.correlation_names = NAMES.map(String::from).to_vec();
    all.correlation = found.correlation.clone();
    all.terminations.insert(found.fit.termination.name().into(), 1);
    let counts = [
        ("pixels above the horizon", picture.above),
        ("hidden", picture.hidden),
        ("clipped", clipped(found)),
        ("beside clipped", picture.clipped.saturating_sub(clipped(found))),
        ("outliers", found.outliers),
        ("fitted", found.samples / picture.channels),
    ];
    all.counts = counts.into_iter().map(|(n, c)| (n.to_string(), c)).collect();
    let (worst, at) = found
        .pixel_chi2
        .iter()
        .zip(&found.fate)
        .enumerate()
        .filter(|(_, (_, f))| **f == super::picture::USED)
        .map(|(k, (v, _))| (f64::from(*v), k))
        .fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a });
    all.residuals.insert(
        "radiance".into(),
        Residuals {
            samples: found.samples,
            chi2: u.chi2,
            reduced_chi2: u.reduced_chi2,
            rms: found.relative_rms,
            worst,
            worst_at: [at % picture.width, at / picture.width],
        },
    );
    all.figures.insert("relative_rms".into(), found.relative_rms);
    all.figures.insert("noise".into(), found.noise);
    all.figures.insert("minima".into(), found.minima as f64);
    all.figures.insert("descents_without_result".into(), found.failed as f64);
    all
}

fn maps(picture: &Picture, found: &Found) -> Maps {
    let mut maps = Maps::new(picture.width, picture.height);
    maps.push("mask.Y", found.fate.clone());
    maps.push("reduced_chi2.Y", found.pixel_chi2.clone());
    let names: &[&str] =
        if picture.channels == 3 { &["residual.R", "residual.G", "residual.B"] } else { &["residual.Y"] };
    for (name, plane) in names.iter().zip(&found.residuals) {
        maps.push(*name, plane.clone());
    }
    maps
}
