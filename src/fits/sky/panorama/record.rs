//! The files that a panorama's fit writes: `fit.toml`, `times.toml`, and `all.exr` (fate, reduced χ² and relative
//! residuals of every pixel).

use super::picture::{self, PanoramaChannels, PanoramaReadings};
use super::projection::{PanoramaProjection, PanoramaProjectionKind};
use super::{NAMES, PanoramaFit, clipped};
use crate::record::maker::{self, FitMaker};
use crate::record::{FitKind, FitParameter, RecordSection, ResidualStatistics};
use crate::sky::{Error, Result};
use mesophyll_files::hash;
use mesophyll_files::image::{ChannelMaps, Packing, write_exr};
use mesophyll_files::picture::{self as files, PictureRequest};
use mesophyll_files::table::Status;
use mesophyll_sky::preetham;
use std::collections::BTreeMap;
use std::path::Path;

/// The options of a panorama's fit.
#[derive(Debug, Clone)]
pub struct Options {
    /// Which directions the pixels look in.
    pub projection: PanoramaProjectionKind,
    /// With a fisheye: the whole angle across the circle (degrees).
    pub field_deg: f64,
    /// Which channels hold the readings and the mask.
    pub channels: PanoramaChannels,
    /// Relative standard error of a reading, above 0 and below 1, where it is known.
    pub noise: Option<f64>,
}

/// Finds sun, turbidity and scale of the picture in the file `path`, and writes the folder `out`. The fit is repeated
/// even where the folder already holds it.
///
/// # Errors
/// A picture that cannot be read or holds no sky; a noise out of range; a folder that cannot be written or that holds
/// something else.
pub fn make(path: &Path, out: &Path, options: &Options) -> Result<PanoramaFit> {
    let (path, inputs, options) = (path.to_path_buf(), [path], options.clone());
    maker::make(FitKind::Panorama, out, &inputs, move |maker| {
        let projection = PanoramaProjection::of(options.projection, options.field_deg);
        let picture = maker.phase("read", || {
            let names: Vec<&str> = options.channels.radiance.iter().map(String::as_str).collect();
            let fits = |w, h| projection.check(w, h).map_err(|why| Error::field(&path, "size", why));
            let read = files::read(&path, &PictureRequest { names: &names, all: true, outside: f32::NAN }, fits)?;
            files::tell(&path, &read.said);
            picture::read(&path, &read.maps, projection, &options.channels)
        })?;
        if let Some(n) = options.noise.filter(|n| !(*n > 0.0 && *n < 1.0)) {
            return Err(Error::Usage(format!(
                "--noise is {n}; expected more than 0 and less than 1 (relative to a reading)"
            )));
        }
        let missed = |why: String| Error::Missed(format!("{}: {why}", path.display()));
        let found = maker.phase("fit", || super::fit(&picture, options.noise).map_err(missed))?;
        let told = options.told(&picture);
        let all = format!("{told:?} {:?} {}", options.noise, env!("CARGO_PKG_VERSION"));
        maker.made_from(hash::combine([("panorama", hash::file(&path)?.as_str()), ("options", &all)]))?;
        write(maker, &picture, &found, told)?;
        Ok(found)
    })
}

impl Options {
    /// The options as `fit.toml` has them.
    fn told(&self, picture: &PanoramaReadings) -> BTreeMap<String, String> {
        let mut told = BTreeMap::new();
        told.insert("projection".to_string(), self.projection.to_string());
        if self.projection == PanoramaProjectionKind::Fisheye {
            told.insert("field_deg".into(), self.field_deg.to_string());
        }
        told.insert("channels".into(), self.channels.radiance.join(","));
        told.insert("size".into(), format!("{} x {}", picture.width, picture.height));
        told.extend(self.channels.mask.iter().map(|m| ("mask".to_string(), m.clone())));
        told.extend(self.channels.saturation.iter().map(|s| ("saturation".to_string(), s.to_string())));
        told
    }
}

/// The sun's disk in words, or why none was seen.
pub fn disk_in_words(found: &PanoramaFit) -> String {
    match &found.disk {
        Err(why) => format!("not seen: {why}"),
        Ok(disk) => format!(
            "zenith {:.3}, azimuth {:.3}, each ± {:.3} degrees across; {} times as bright as the sky{}",
            disk.zenith().to_degrees(),
            disk.azimuth().to_degrees(),
            disk.error.to_degrees(),
            disk.contrast.round(),
            if disk.clipped { " or brighter, clipped" } else { "" }
        ),
    }
}

fn write(
    maker: &mut FitMaker,
    picture: &PanoramaReadings,
    found: &PanoramaFit,
    told: BTreeMap<String, String>,
) -> Result<()> {
    let map = maker.begin()?.join("all.exr");
    write_exr(&map, &maps(picture, found), Packing::Zip)?;
    let mut record = maker.record("sky panorama");
    record.termination = Some(found.fit.termination);
    record.options = told;
    record.options.insert("noise".into(), format!("{:.3e} of a reading, {}", found.noise, found.noise_from.name()));
    record.options.insert("status".into(), found.status.to_string());
    record.options.insert("sun from".into(), found.sun_from.name().into());
    record.options.insert("disk".into(), disk_in_words(found));
    let [low, high] = preetham::TRUSTED;
    if !(low..=high).contains(&found.turbidity.value) {
        record
            .options
            .insert("remark".into(), format!("turbidity is outside the {low} to {high} for which preetham is trusted"));
    }
    record.defects = [("-1".to_string(), "clipped".to_string()), ("-2".into(), "outlier".into())].into();
    record.files.insert("all.exr".into(), hash::file(&map)?);
    record.sections.insert("all".into(), section(picture, found));
    maker.times.traces = [("search".to_string(), found.search.clone()), ("fit".into(), found.fit.trace.clone())].into();
    maker.finish(record).map(|_| ())
}

fn section(picture: &PanoramaReadings, found: &PanoramaFit) -> RecordSection {
    let u = &found.fit.uncertainty;
    let mut all = RecordSection { condition: Some(u.condition), rank: Some(u.rank), ..RecordSection::default() };
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
        let undetermined = if found.status.leaves_open(name) { vec![format!("{name}: {why}")] } else { Vec::new() };
        all.params.insert(
            (*name).into(),
            FitParameter {
                value: vec![k.value * unit],
                stderr: vec![k.error * unit],
                unit: word.into(),
                undetermined,
                ..FitParameter::default()
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
        ResidualStatistics {
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

fn maps(picture: &PanoramaReadings, found: &PanoramaFit) -> ChannelMaps {
    let mut maps = ChannelMaps::new(picture.width, picture.height);
    maps.push("mask.Y", found.fate.clone());
    maps.push("reduced_chi2.Y", found.pixel_chi2.clone());
    let names: &[&str] =
        if picture.channels == 3 { &["residual.R", "residual.G", "residual.B"] } else { &["residual.Y"] };
    for (name, plane) in names.iter().zip(&found.residuals) {
        maps.push(*name, plane.clone());
    }
    maps
}
