//! White sheet, dark frame, light box, mask and truth: which of them exist, whether they are usable, and what follows.

use super::{TubeInspection, list_numbers};
use crate::Error;
use crate::manifest::{TubeManifest, white_path};
use mesophyll_base::statistics::median;
use mesophyll_files::image::{self, ChannelMaps};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// A reference: one file, or the frames of a white pass.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct ReferenceSummary {
    /// Its file or folder, relative to the capture's folder.
    pub name: String,
    /// Files found; 0 when it is absent.
    pub files: usize,
    /// Size of the files together, in bytes.
    pub bytes: u64,
    /// Smallest reading; `None` where nothing was read.
    pub min: Option<f64>,
    /// Median of the readings.
    pub median: Option<f64>,
    /// Largest reading.
    pub max: Option<f64>,
    /// Share of the samples without a value.
    pub no_reading_share: Option<f64>,
}

pub fn look(folder: &Path, m: &TubeManifest, found: &mut TubeInspection) {
    let white = white(folder, m, found);
    if !white {
        found.notes.push(
            "white/ is absent: the frames are taken as normalised already (1 = a white texel under an infinite tube)"
                .into(),
        );
        let brightest = found.passes.iter().filter_map(|p| p.brightest).map(|b| b.1).fold(0.0, f64::max);
        if brightest > 1.5 {
            found
                .warnings
                .push(format!("a frame's mean is {brightest:.2} without a white sheet: are the frames normalised?"));
        }
    }
    let dark = picture(folder, "dark.exr", m, found);
    if dark.is_none() && !folder.join("dark.exr").exists() {
        found.notes.push("dark.exr is absent: no dark level is taken off".into());
    }
    let empty = picture(folder, "lightbox_empty.exr", m, found);
    if !folder.join("lightbox_empty.exr").exists() {
        found.problems.push(format!(
            "{}: missing; without the empty light box ρt is unknown, and with it σa, σs and the thickness",
            folder.join("lightbox_empty.exr").display()
        ));
    }
    let mut leaf_share = None;
    for side in &m.sides {
        let name = format!("{}/lightbox.exr", side.name());
        let leaf = picture(folder, &name, m, found);
        if !folder.join(&name).exists() {
            found.problems.push(format!(
                "{}: missing; without it ρt of the {} is unknown",
                folder.join(&name).display(),
                side.name()
            ));
        }
        if let (Some(leaf), Some(empty)) = (&leaf, &empty) {
            let share = ratio(&name, leaf, empty, dark.as_ref(), found);
            leaf_share = leaf_share.or(share);
        }
    }
    mask(folder, m, leaf_share, found);
    let truth = m.sides.iter().filter(|s| crate::truth_path(folder, **s).exists()).count();
    if truth > 0 {
        found.notes.push("truth/ is there: a synthetic capture; the fit reports its error to the truth".into());
    }
}

/// Whether there is a white sheet. Its faults are added to the problems.
fn white(folder: &Path, m: &TubeManifest, found: &mut TubeInspection) -> bool {
    if !folder.join("white").exists() {
        return false;
    }
    for pass in &m.passes {
        let expected = pass.positions().len();
        let paths: Vec<PathBuf> = (0..expected).map(|k| white_path(folder, pass.name, k)).collect();
        let missing: Vec<usize> = (0..expected).filter(|&k| !paths[k].exists()).collect();
        let place = format!("white/{}", pass.name.name());
        if !missing.is_empty() {
            let list = list_numbers(&missing);
            found.problems.push(format!(
                "{place}: {} of {expected} frames are missing: {list}; white frames stand at the tube positions of the \
                 leaf's",
                missing.len()
            ));
        }
        let mut summary =
            ReferenceSummary { name: place.clone(), files: expected - missing.len(), ..ReferenceSummary::default() };
        for (k, path) in paths.iter().enumerate().filter(|(k, _)| !missing.contains(k)) {
            summary.bytes += std::fs::metadata(path).map_or(0, |d| d.len());
            // All headers are read; the samples of a few frames say whether there is light.
            let look = if k % (expected / 4).max(1) == 0 {
                image::read_exr_rows(path, Some(&["R", "G", "B"]), None).map(Some)
            } else {
                shape(path, m).map(|()| None)
            };
            match look {
                Ok(Some(maps)) => {
                    widen(&mut summary, &maps);
                    if maps.width > m.width || maps.height > m.height {
                        found.problems.push(size_sentence(path, maps.width, maps.height, m, "at most "));
                    }
                }
                Ok(None) => {}
                Err(e) => found.problems.push(e.to_string()),
            }
        }
        if summary.max.is_some_and(|v| v <= 0.0) {
            found.problems.push(format!(
                "{place}: the white sheet shows no light; its largest value is {}",
                summary.max.unwrap_or(0.0)
            ));
        }
        found.references.push(summary);
    }
    true
}

/// Checks the header of a white frame: any size up to the leaf's is allowed.
fn shape(path: &Path, m: &TubeManifest) -> Result<(), Error> {
    let info = image::exr_info(path)?;
    if info.width > m.width || info.height > m.height {
        let what = format!("found {} × {}, expected at most {} × {}", info.width, info.height, m.width, m.height);
        return Err(Error::field(path, "size", what));
    }
    Ok(())
}

fn size_sentence(path: &Path, width: usize, height: usize, m: &TubeManifest, word: &str) -> String {
    let what = format!("found {width} × {height}, expected {word}{} × {}", m.width, m.height);
    Error::field(path, "size", what).to_string()
}

/// Reads one reference picture. A missing one gives `None` silently; a broken one is a problem.
fn picture(folder: &Path, name: &str, m: &TubeManifest, found: &mut TubeInspection) -> Option<ChannelMaps> {
    let path = folder.join(name);
    let mut summary = ReferenceSummary { name: name.into(), ..ReferenceSummary::default() };
    if !path.exists() {
        found.references.push(summary);
        return None;
    }
    (summary.files, summary.bytes) = (1, std::fs::metadata(&path).map_or(0, |d| d.len()));
    let maps = match image::read_exr_rows(&path, Some(&["R", "G", "B"]), None) {
        Ok(maps) => maps,
        Err(e) => {
            found.problems.push(e.to_string());
            found.references.push(summary);
            return None;
        }
    };
    widen(&mut summary, &maps);
    if summary.max.is_none() {
        found.problems.push(format!("{}: no reading anywhere (all NaN)", path.display()));
    }
    found.references.push(summary);
    if (maps.width, maps.height) != (m.width, m.height) {
        found.problems.push(size_sentence(&path, maps.width, maps.height, m, ""));
        return None;
    }
    Some(maps)
}

fn widen(s: &mut ReferenceSummary, maps: &ChannelMaps) {
    let mut values: Vec<f32> =
        maps.channels.iter().flat_map(|c| c.1.iter().copied()).filter(|v| v.is_finite()).collect();
    let all = maps.channels.len() * maps.width * maps.height;
    let absent = 1.0 - values.len() as f64 / all.max(1) as f64;
    s.no_reading_share = Some(s.no_reading_share.map_or(absent, |a| a.max(absent)));
    let Some(median) = median(&mut values) else { return };
    let low = values.iter().copied().fold(median, f32::min);
    let high = values.iter().copied().fold(median, f32::max);
    s.min = Some(s.min.map_or(f64::from(low), |v| v.min(f64::from(low))));
    s.max = Some(s.max.map_or(f64::from(high), |v| v.max(f64::from(high))));
    s.median = Some(f64::from(median));
}

/// Checks that (leaf − dark) / (box − dark) lies in 0 … 1. Returns the share of texels that block light, which is a
/// rough mask.
fn ratio(
    name: &str,
    leaf: &ChannelMaps,
    empty: &ChannelMaps,
    dark: Option<&ChannelMaps>,
    found: &mut TubeInspection,
) -> Option<f64> {
    let (mut unlit, mut above, mut blocked, mut all) = (0usize, 0usize, 0usize, 0usize);
    for i in 0..leaf.width * leaf.height {
        let value = |maps: &ChannelMaps| maps.channels[1].1[i];
        let base = dark.map_or(0.0, value);
        let (numerator, light) = (value(leaf) - base, value(empty) - base);
        if !(numerator.is_finite() && light.is_finite()) {
            continue;
        }
        all += 1;
        if light <= 0.0 {
            unlit += 1;
            continue;
        }
        let r = numerator / light;
        above += usize::from(r > 1.1);
        blocked += usize::from(r < 0.8);
    }
    if all == 0 {
        return None;
    }
    let share = |n: usize| n as f64 / all as f64;
    if share(unlit) > 0.5 {
        found.problems.push(format!(
            "lightbox_empty.exr: {:.1} % of the texels are no brighter than the dark frame; the box must light the \
             whole blade",
            100.0 * share(unlit)
        ));
        return None;
    }
    if share(above) > 0.01 {
        found.warnings.push(format!(
            "{name}: {:.1} % of the texels are brighter with the leaf than without it; was the box's exposure changed?",
            100.0 * share(above)
        ));
    }
    Some(share(blocked))
}

/// Checks the mask's size and content, or what is used instead of a mask.
fn mask(folder: &Path, m: &TubeManifest, leaf_share: Option<f64>, found: &mut TubeInspection) {
    let path = folder.join("mask.exr");
    let texels = m.width * m.height;
    let mut summary = ReferenceSummary { name: "mask.exr".into(), ..ReferenceSummary::default() };
    if !path.exists() {
        found.references.push(summary);
        found.leaf_texels = leaf_share.map(|s| (s * texels as f64).round() as usize);
        found.notes.push("mask.exr is absent: the outline is taken from the light box".into());
        if found.leaf_texels == Some(0) {
            found.problems.push("front/lightbox.exr: no texel blocks light, so no leaf is seen".into());
        }
        return;
    }
    (summary.files, summary.bytes) = (1, std::fs::metadata(&path).map_or(0, |d| d.len()));
    match image::read_exr_rows(&path, Some(&["Y"]), None) {
        Err(e) => found.problems.push(e.to_string()),
        Ok(maps) if (maps.width, maps.height) != (m.width, m.height) => {
            found.problems.push(size_sentence(&path, maps.width, maps.height, m, ""));
        }
        Ok(maps) => {
            let on = maps.channels[0].1.iter().filter(|v| **v > 0.5).count();
            widen(&mut summary, &maps);
            found.leaf_texels = Some(on);
            if on == 0 {
                found.problems.push(Error::field(&path, "Y", "no texel is 1, so no leaf is left to fit").to_string());
            }
        }
    }
    found.references.push(summary);
}
