//! A side's maps in numbers and pictures: the fit, the truth where it is known, the difference, the standard errors.

mod pictures;

use crate::chart;
use crate::colour::MapFrame;
use crate::model::{MapRow, MapTruth};
use crate::quantity::{self, known};
use crate::size::{DETAILS, ReportDetail};
use crate::stats::{MapSummary, quantile, sorted};
use mesophyll_files::image::{self, ChannelMaps};
use mesophyll_files::quantity::{Quantity, split};
use mesophyll_fits::leaf_folder::LeafFitFile;
pub use pictures::difference_picture;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Largest width of a picture of a side.
pub(super) const WIDE: usize = 720;
/// Bins of the charts.
pub(super) const BINS: usize = 60;

/// The contents of a side's files.
#[derive(Debug)]
pub struct ReportSideMaps {
    pub section: String,
    pub fit: ChannelMaps,
    pub errors: Option<ChannelMaps>,
    pub truth: Option<ChannelMaps>,
    pub good: Vec<bool>,
    /// Remarks on the maps of a quantity, by the quantity's name.
    pub notes: BTreeMap<&'static str, String>,
    /// Edge of a texel in mm, where the fit states it.
    pub texel_mm: Option<f64>,
    /// How finely the maps are drawn.
    pub detail: ReportDetail,
    /// Why the intervals of the quantities in [`SHARED`] are not judged by the truth, where that is so.
    pub unjudged: Option<String>,
}

/// Quantities that depend on the gauge: the caliper's mean thickness and a mean γ of 1.
const SHARED: [&str; 4] = ["sigma_a", "sigma_s", "thickness", "gamma"];
/// Quantities of which the maps explain a texel by pigment alone.
const PIGMENT: [&str; 2] = ["sigma_a", "sigma_s"];

/// Reads the maps of a side. What is missing or unreadable is described in `missing`.
pub(crate) fn read_side(
    folder: &Path,
    section: &str,
    capture: Option<&Path>,
    missing: &mut Vec<String>,
) -> Option<ReportSideMaps> {
    let main = folder.join(LeafFitFile::Maps.of(section));
    let fit = read_or_say(&main, "no maps of this side", missing)?;
    let errors_path = folder.join(LeafFitFile::Errors.of(section));
    let same_size = |maps: &ChannelMaps, path: &Path, missing: &mut Vec<String>| {
        let same = (maps.width, maps.height) == (fit.width, fit.height);
        if !same {
            let sizes = format!("{} × {} where the fit has {} × {}", maps.width, maps.height, fit.width, fit.height);
            missing.push(format!("{}: {sizes}; it is left out", file_name(path)));
        }
        same
    };
    let errors = read_or_say(&errors_path, "no standard errors of the maps", missing)
        .filter(|m| same_size(m, &errors_path, missing));
    let mut truth = truth_path(folder, section, capture)
        .and_then(|path| read_or_say(&path, "no truth", missing).filter(|m| same_size(m, &path, missing)));
    let pigment_path = folder.join(LeafFitFile::Truth.of(section));
    let pigment =
        pigment_path.exists().then(|| read_or_say(&pigment_path, "no truth of the σ maps", missing)).flatten();
    let pigment = pigment.filter(|m| same_size(m, &pigment_path, missing));
    if let Some(truth) = &mut truth {
        describe_by_pigment(truth, pigment, section, missing);
    }
    let good = match fit.scalar(Quantity::Mask) {
        Some(mask) => mask.iter().map(|m| *m > 0.5).collect(),
        None => {
            missing.push(format!("{section}.exr: no channel mask.Y; every texel with a value counts as good"));
            vec![true; fit.width * fit.height]
        }
    };
    Some(ReportSideMaps {
        section: section.into(),
        fit,
        errors,
        truth,
        good,
        notes: BTreeMap::new(),
        texel_mm: None,
        detail: DETAILS[0],
        unjudged: None,
    })
}

/// Puts the truth of the σ maps, as the fit stored it, in place of the truth's own σa and σs. Without it they are
/// removed where the true leaf has an albedo factor γ, because the same σ would then mean two things.
fn describe_by_pigment(
    truth: &mut ChannelMaps,
    pigment: Option<ChannelMaps>,
    section: &str,
    missing: &mut Vec<String>,
) {
    let plain = |(name, values): &(String, Vec<f32>)| {
        split(name).0 != "gamma" || values.iter().all(|v| !(*v > 0.0) || (v - 1.0).abs() < 1e-3)
    };
    let is_sigma = |name: &str| PIGMENT.contains(&split(name).0);
    match pigment {
        Some(own) => {
            truth.channels.retain(|(name, _)| !is_sigma(name));
            truth.channels.extend(own.channels);
        }
        None if !truth.channels.iter().all(plain) => {
            truth.channels.retain(|(name, _)| !is_sigma(name));
            missing.push(format!(
                "{section}_truth.exr: not there, so the maps of σa and σs are not compared: they explain a texel by \
                 pigment alone, the known truth has \
                 an albedo factor γ beside it; fit again to compare them"
            ));
        }
        None => {}
    }
}

/// `truth_front.exr` in the fit, otherwise `truth/front.exr` of the capture.
fn truth_path(folder: &Path, section: &str, capture: Option<&Path>) -> Option<PathBuf> {
    let own = folder.join(format!("truth_{section}.exr"));
    if own.exists() {
        return Some(own);
    }
    let side = section.parse().ok()?;
    let places = capture.map(|c| [c.to_path_buf(), folder.join(c)]);
    places.into_iter().flatten().map(|c| mesophyll_capture::truth_path(&c, side)).find(|p| p.exists())
}

fn read_or_say(path: &Path, without: &str, missing: &mut Vec<String>) -> Option<ChannelMaps> {
    if !path.exists() {
        missing.push(format!("{}: not there, so {without}", file_name(path)));
        return None;
    }
    image::read_exr(path).map_err(|e| missing.push(format!("{e}; so {without}"))).ok()
}

fn file_name(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

/// A channel with its error and its truth.
struct Channel<'a> {
    name: &'a str,
    fit: &'a [f32],
    error: Option<&'a [f32]>,
    truth: Option<&'a [f32]>,
}

impl ReportSideMaps {
    fn channels(&self) -> Vec<Channel<'_>> {
        let mut list: Vec<Channel> = self
            .fit
            .channels
            .iter()
            .filter(|(n, _)| !quantity::SET_APART.contains(&n.as_str()))
            .map(|(n, s)| Channel {
                name: n,
                fit: s,
                error: self.errors.as_ref().and_then(|m| m.get(n)),
                truth: self.truth.as_ref().and_then(|m| m.get(n)),
            })
            .collect();
        list.sort_by_key(|c| quantity::rank(c.name));
        list
    }

    pub(super) fn good_values<'a>(&'a self, samples: &'a [f32]) -> impl Iterator<Item = f32> + 'a {
        samples.iter().zip(&self.good).filter(|(_, g)| **g).map(|(v, _)| *v)
    }

    /// The rows of every map. Channels without any finite value are named in `missing`.
    pub fn rows(&self, missing: &mut Vec<String>) -> Vec<MapRow> {
        let channels = self.channels();
        let read: Vec<Option<MapRow>> = channels.par_iter().map(|c| self.row(c)).collect();
        let mut rows = Vec::new();
        for (c, row) in channels.iter().zip(read) {
            match row {
                Some(row) => rows.push(row),
                None => missing.push(format!("{}.exr: {} has no value on any good texel", self.section, c.name)),
            }
        }
        let lacking: Vec<&str> = quantity::QUANTITIES
            .iter()
            .map(|q| q.name)
            .filter(|q| !self.fit.channels.iter().any(|(n, _)| split(n).0 == *q))
            .collect();
        if !lacking.is_empty() {
            missing.push(format!("{}.exr: no channels of {}", self.section, lacking.join(", ")));
        }
        rows
    }

    fn row(&self, c: &Channel) -> Option<MapRow> {
        let (name, letter) = split(c.name);
        let values = sorted(self.good_values(c.fit));
        let summary = MapSummary::of(&values)?;
        let stderr = c.error.map(|e| sorted(self.good_values(e))).filter(|e| !e.is_empty()).map(|e| quantile(&e, 0.5));
        Some(MapRow {
            section: self.section.clone(),
            quantity: name.into(),
            channel: letter.into(),
            unit: known(name).map_or("", |q| q.unit).into(),
            summary,
            undetermined: self.undetermined(c),
            stderr_median: stderr,
            truth: self.against_truth(c),
        })
    }

    /// Good texels that have no value, or one whose standard error is infinite: it fills the map and says nothing.
    fn undetermined(&self, c: &Channel) -> usize {
        let unbounded = |k: usize| c.error.and_then(|e| e.get(k)).is_some_and(|e| e.is_infinite());
        (0..c.fit.len()).filter(|&k| self.good[k] && (!c.fit[k].is_finite() || unbounded(k))).count()
    }

    fn against_truth(&self, c: &Channel) -> Option<MapTruth> {
        let truth = c.truth?;
        let signed = known(split(c.name).0).is_some_and(|q| q.signed);
        let each = || (0..c.fit.len()).filter(|&i| self.good[i] && c.fit[i].is_finite() && truth[i].is_finite());
        let absolute = sorted(each().map(|i| (c.fit[i] - truth[i]).abs()));
        if absolute.is_empty() {
            return None;
        }
        let relative = sorted(each().filter(|&i| truth[i] != 0.0).map(|i| ((c.fit[i] - truth[i]) / truth[i]).abs()));
        let z: Vec<f32> = self.scores(c).collect();
        let inside = z.iter().filter(|z| z.abs() <= 1.96).count();
        Some(MapTruth {
            median_absolute: quantile(&absolute, 0.5),
            p99_absolute: quantile(&absolute, 0.99),
            median_relative: (!signed && !relative.is_empty()).then(|| quantile(&relative, 0.5)),
            bias: quantile(&sorted(each().map(|i| c.fit[i] - truth[i])), 0.5),
            coverage95: (!z.is_empty() && !self.is_unjudged(c)).then(|| inside as f64 / z.len() as f64),
        })
    }

    fn is_unjudged(&self, c: &Channel) -> bool {
        self.unjudged.is_some() && SHARED.contains(&split(c.name).0)
    }

    /// (fit − truth) / standard error on the good texels where all three are known.
    fn scores<'a>(&'a self, c: &'a Channel) -> impl Iterator<Item = f32> + 'a {
        let pair = c.truth.zip(c.error);
        (0..c.fit.len()).filter(|&i| self.good[i]).filter_map(move |i| {
            let (truth, error) = pair?;
            let z = (c.fit[i] - truth[i]) / error[i];
            (error[i] > 0.0 && z.is_finite()).then_some(z)
        })
    }

    /// A picture, with a pixel for at least `least_step` × `least_step` texels.
    pub(super) fn frame(&self, least_step: usize) -> MapFrame {
        let (width, height) = (self.fit.width, self.fit.height);
        MapFrame { width, height, max_width: WIDE, least_step, texel_mm: self.texel_mm, kept: (1, self.detail.digits) }
    }

    /// A map with every `stride`-th value.
    pub(super) fn map(&self, stride: usize) -> MapFrame {
        MapFrame { max_width: self.detail.thumb, kept: (stride, self.detail.digits), ..self.frame(1) }
    }
}

pub(super) fn colour_bar_of(signed: bool, range: (f64, f64), unit: &str) -> String {
    chart::colour_bar(if signed { "ramp-signed" } else { "ramp" }, range, unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_without_a_bound_on_their_error_count_as_undetermined() {
        let mut fit = ChannelMaps::new(4, 1);
        let mut errors = ChannelMaps::new(4, 1);
        // The last texel is not good. No error is stated of the second one.
        fit.push("normal.Y", vec![0.0, 0.1, f32::NAN, 0.0]);
        errors.push("normal.Y", vec![f32::INFINITY, f32::NAN, 0.1, f32::INFINITY]);
        let side = ReportSideMaps {
            section: "front".into(),
            fit,
            errors: Some(errors),
            truth: None,
            good: vec![true, true, true, false],
            notes: BTreeMap::new(),
            texel_mm: None,
            detail: DETAILS[0],
            unjudged: None,
        };
        let rows = side.rows(&mut Vec::new());
        assert_eq!((rows.len(), rows[0].summary.samples, rows[0].undetermined), (1, 2, 2));
    }
}
