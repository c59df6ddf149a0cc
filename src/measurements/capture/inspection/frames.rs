//! The frames of the passes: whether all of them exist, have the right size, are complete, and hold light.

use super::noise::{NoiseMeter, WINDOW};
use super::{TubeInspection, list_numbers};
use crate::manifest::{TubeManifest, TubePass, frame_path};
use crate::{Error, Result};
use mesophyll_files::image::{self, ChannelMaps};
use mesophyll_files::progress::{self, TaskProgress};
use mesophyll_optics::side::Side;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// At most this many sentences on single files are listed; the rest are counted.
const LISTED: usize = 5;

/// One side's pass.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct PassSummary {
    /// `front` or `back`.
    pub side: String,
    /// `x` or `y`.
    pub pass: String,
    /// Frames that `capture.toml` promises.
    pub expected: usize,
    /// Frames that are there.
    pub found: usize,
    /// Their size together, in bytes.
    pub bytes: u64,
    /// Frames whose samples were read.
    pub sampled: usize,
    /// Of the samples that were read: the share without a value (NaN: dead or saturated in every exposure).
    pub no_reading_share: f64,
    /// Texels without a value in any frame that was read.
    pub never_read_texels: usize,
    /// Share of the samples below 0.
    pub negative_share: f64,
    /// Smallest sample (1 is a white texel under an infinite tube, where frames are normalised).
    pub min: f64,
    /// Largest sample, in the same unit.
    pub max: f64,
    /// Largest share of a frame's samples that have exactly the frame's largest value. A large share means clipping.
    pub at_the_top_share: f64,
    /// Frame of the largest mean, and that mean.
    pub brightest: Option<(usize, f64)>,
}

/// The result of reading a header and the last row.
enum Header {
    Fine { bytes: u64, half: bool },
    Missing,
    Wrong(String),
}

pub fn look(folder: &Path, m: &TubeManifest, deep: bool, found: &mut TubeInspection) -> Result<()> {
    let total: usize = m.passes.iter().map(|p| p.positions().len()).sum::<usize>() * m.sides.len();
    let task = Task { folder, m, deep, bar: TaskProgress::new("looking at frames", total as u64) };
    let mut meter = NoiseMeter::default();
    for &side in &m.sides {
        for pass in &m.passes {
            let summary = one_pass(&task, side, pass, found, &mut meter)?;
            found.passes.push(summary);
        }
    }
    found.noise = meter.estimate();
    Ok(())
}

/// What all passes have in common.
struct Task<'a> {
    folder: &'a Path,
    m: &'a TubeManifest,
    deep: bool,
    bar: TaskProgress,
}

fn one_pass(
    task: &Task,
    side: Side,
    pass: &TubePass,
    found: &mut TubeInspection,
    meter: &mut NoiseMeter,
) -> Result<PassSummary> {
    let Task { folder, m, deep, bar } = task;
    let expected = pass.positions().len();
    let place = format!("{}/{}", side.name(), pass.name.name());
    let headers: Vec<Header> = (0..expected)
        .into_par_iter()
        .map(|k| {
            bar.advance(1);
            if progress::stop_requested() {
                Header::Missing
            } else {
                header(&frame_path(folder, side, pass.name, k), m)
            }
        })
        .collect();
    interrupted()?;
    let mut summary =
        PassSummary { side: side.name().into(), pass: pass.name.name().into(), expected, ..PassSummary::default() };
    let (mut missing, mut wrong, mut fine, mut half) = (Vec::new(), Vec::new(), Vec::new(), 0);
    for (k, h) in headers.into_iter().enumerate() {
        match h {
            Header::Fine { bytes, half: is_half } => {
                summary.bytes += bytes;
                half += usize::from(is_half);
                fine.push(k);
            }
            Header::Missing => missing.push(k),
            Header::Wrong(sentence) => wrong.push(sentence),
        }
    }
    summary.found = expected - missing.len();
    if !missing.is_empty() {
        let list = list_numbers(&missing);
        found.problems.push(format!("{place}: {} of {expected} frames are missing: {list}", missing.len()));
    }
    found.problems.extend(wrong.iter().take(LISTED).cloned());
    if wrong.len() > LISTED {
        found
            .problems
            .push(format!("{place}: {} more frames are unreadable or of the wrong shape", wrong.len() - LISTED));
    }
    if half > 0 {
        found.warnings.push(format!(
            "{place}: {half} frames are stored as half, which keeps only about 5e-4 of a value; float is expected"
        ));
    }
    let extra = surplus(folder, side, pass, expected);
    if extra > 0 {
        found.warnings.push(format!(
            "{place}: {extra} more EXR files than the {expected} frames of the manifest; they are not read"
        ));
    }
    let chosen = chosen(expected, *deep);
    let mut samples = Samples::new(m.width * m.height);
    for window in chosen {
        interrupted()?;
        let mut read: Vec<ChannelMaps> = Vec::new();
        for k in window.into_iter().filter(|k| fine.contains(k)) {
            match image::read_exr_rows(&frame_path(folder, side, pass.name, k), Some(&["R", "G", "B"]), None) {
                Ok(frame) => {
                    samples.add(k, &frame);
                    read.push(frame);
                }
                Err(e) => found.problems.push(e.to_string()),
            }
        }
        if let [a, b, c, d, e] = read.as_slice() {
            let frames: [&[f32]; WINDOW] = [a, b, c, d, e].map(|f| f.channels[1].1.as_slice());
            meter.add(frames);
        }
    }
    samples.finish(&mut summary);
    judge(&place, m, &summary, &samples, found);
    Ok(summary)
}

fn interrupted() -> Result<()> {
    if progress::stop_requested() { Err(Error::Interrupted("stopped; nothing was written".into())) } else { Ok(()) }
}

/// Reads the header and the last row: files are written top to bottom, so a truncated file lacks its end.
fn header(path: &Path, m: &TubeManifest) -> Header {
    let Ok(meta) = std::fs::metadata(path) else { return Header::Missing };
    let wrong = |field: &str, what: String| Header::Wrong(Error::field(path, field, what).to_string());
    let info = match image::exr_info(path) {
        Ok(info) => info,
        Err(e) => return Header::Wrong(e.to_string()),
    };
    if (info.width, info.height) != (m.width, m.height) {
        return wrong("size", format!("found {} × {}, expected {} × {}", info.width, info.height, m.width, m.height));
    }
    if let Some(lacking) = ["R", "G", "B"].iter().find(|c| !info.channels.iter().any(|n| n == *c)) {
        return wrong(lacking, format!("no such channel; the file holds {}", info.channels.join(", ")));
    }
    match image::read_exr_rows(path, Some(&["R"]), Some(m.height - 1..m.height)) {
        Ok(_) => Header::Fine { bytes: meta.len(), half: info.half },
        Err(e) => Header::Wrong(e.to_string()),
    }
}

/// Number of EXR files in the pass's folder that are not among the manifest's frames.
fn surplus(folder: &Path, side: Side, pass: &TubePass, expected: usize) -> usize {
    let names: Vec<std::path::PathBuf> = (0..expected).map(|k| frame_path(folder, side, pass.name, k)).collect();
    let place = folder.join(side.name()).join(pass.name.name());
    let Ok(entries) = std::fs::read_dir(place) else { return 0 };
    entries
        .flatten()
        .map(|e| e.path())
        .filter(|p| p.extension().is_some_and(|e| e == "exr") && !names.contains(p))
        .count()
}

/// Which frames are read: the ends, and windows of five for the noise. With `deep`, all frames in windows of five.
fn chosen(frames: usize, deep: bool) -> Vec<Vec<usize>> {
    if deep {
        return (0..frames).collect::<Vec<_>>().chunks(WINDOW).map(<[usize]>::to_vec).collect();
    }
    let at = |share: f64| ((frames - WINDOW) as f64 * share) as usize;
    let mut out: Vec<Vec<usize>> = [0.25, 0.6].iter().map(|s| (at(*s)..at(*s) + WINDOW).collect()).collect();
    let ends = [0, frames - 1];
    out.push(ends.into_iter().filter(|k| !out.iter().flatten().any(|c| c == k)).collect());
    out
}

/// Running counts over the frames that are read.
struct Samples {
    seen: Vec<bool>,
    frames: usize,
    count: usize,
    nan: usize,
    negative: usize,
    min: f64,
    max: f64,
    top: f64,
    means: BTreeMap<usize, f64>,
}

impl Samples {
    fn new(texels: usize) -> Samples {
        let (min, max) = (f64::INFINITY, f64::NEG_INFINITY);
        Samples {
            seen: vec![false; texels],
            frames: 0,
            count: 0,
            nan: 0,
            negative: 0,
            min,
            max,
            top: 0.0,
            means: BTreeMap::new(),
        }
    }

    fn add(&mut self, frame: usize, maps: &ChannelMaps) {
        self.frames += 1;
        let (mut sum, mut finite) = (0.0, 0usize);
        let peak = maps
            .channels
            .iter()
            .flat_map(|c| c.1.iter().copied())
            .filter(|v| v.is_finite())
            .fold(f32::NEG_INFINITY, f32::max);
        let mut at_peak = 0usize;
        for (_, plane) in &maps.channels {
            for (v, seen) in plane.iter().zip(&mut self.seen) {
                self.count += 1;
                if !v.is_finite() {
                    self.nan += 1;
                    continue;
                }
                *seen = true;
                finite += 1;
                sum += f64::from(*v);
                self.negative += usize::from(*v < 0.0);
                at_peak += usize::from(*v == peak);
                self.min = self.min.min(f64::from(*v));
            }
        }
        if finite > 0 {
            self.max = self.max.max(f64::from(peak));
            self.top = self.top.max(at_peak as f64 / finite as f64);
            self.means.insert(frame, sum / finite as f64);
        }
    }

    fn finish(&self, s: &mut PassSummary) {
        s.sampled = self.frames;
        let all = self.count.max(1) as f64;
        s.no_reading_share = self.nan as f64 / all;
        s.negative_share = self.negative as f64 / all;
        s.never_read_texels = if self.frames > 0 { self.seen.iter().filter(|s| !**s).count() } else { 0 };
        (s.min, s.max) = if self.means.is_empty() { (0.0, 0.0) } else { (self.min, self.max) };
        s.at_the_top_share = self.top;
        s.brightest = self.means.iter().max_by(|a, b| a.1.total_cmp(b.1)).map(|(k, v)| (*k, *v));
    }
}

/// Whether the samples that were read can be fitted.
fn judge(place: &str, m: &TubeManifest, s: &PassSummary, samples: &Samples, found: &mut TubeInspection) {
    if s.sampled == 0 {
        return;
    }
    if samples.means.is_empty() {
        found.problems.push(format!(
            "{place}: no reading anywhere in the {} frames looked at (saturated in every exposure?)",
            s.sampled
        ));
        return;
    }
    if s.max <= 0.0 {
        found.problems.push(format!(
            "{place}: no light in any of the {} frames looked at; the largest value is {}",
            s.sampled, s.max
        ));
        return;
    }
    if s.min == s.max {
        found.problems.push(format!("{place}: every sample looked at is {} (saturated everywhere?)", s.max));
        return;
    }
    let percent = |share: f64| format!("{:.2} %", 100.0 * share);
    if s.at_the_top_share > 0.005 {
        let share = percent(s.at_the_top_share);
        found.warnings.push(format!(
            "{place}: {share} of a frame has exactly its largest value: clipped? Samples without a reading are \
             expected to be NaN"
        ));
    }
    if s.no_reading_share > 0.01 {
        found.warnings.push(format!("{place}: {} of the samples have no reading (NaN)", percent(s.no_reading_share)));
    }
    if s.never_read_texels > 0 {
        let texels = m.width * m.height;
        let share = percent(s.never_read_texels as f64 / texels as f64);
        found
            .warnings
            .push(format!("{place}: {} texels ({share}) have no reading in any frame looked at", s.never_read_texels));
    }
}
