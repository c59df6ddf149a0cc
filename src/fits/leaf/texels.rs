//! The texel phase: bands of rows are read from all frames, every texel is fitted, and each band is saved as a part
//! file.
//!
//! A part is the unit of resuming and of sharding. It is written under `parts/`, completely or not at all, and is named
//! by its side and first row. It does not depend on which process made it or with how many threads.

use crate::gloss::{GlossTexelFit, GlossTexelFitter};
use crate::leaf::defect;
use crate::leaf::earlier::EarlierFit;
use crate::leaf::held_out::FrameSplits;
use crate::leaf::noise::CameraNoise;
use crate::{Error, Result};
use mesophyll_capture::reader::TubeCapture;
use mesophyll_files::image::{ChannelMaps, Packing, read_exr, write_exr};
use mesophyll_files::progress::{TaskProgress, go_on};
use mesophyll_files::quantity::{self, Quantity};
use mesophyll_optics::defect::{Defect, GOOD};
use mesophyll_optics::side::Side;
use mesophyll_optics::tube::Travel;
use rayon::prelude::*;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Rows a part.
const ROWS: usize = 32;

/// Channels of a part file, in the order of [`to_maps`]: what was fitted, the standard errors of it (`err.rho_d.R`),
/// what one standard deviation of the dark frame does to ρd (`dark.rho_d.R`), and how the fit went.
fn channels() -> Vec<String> {
    use Quantity::{Chi2, Freedom, M, Mask, Normal, RhoD, RhoS, Termination, Undetermined};
    let named = |prefix: &str, list: &[Quantity]| {
        quantity::channels(list).into_iter().map(|name| format!("{prefix}{name}")).collect::<Vec<_>>()
    };
    [
        named("", &[RhoD, RhoS, M, Normal]),
        named(ERROR, &[RhoD]),
        named(DARK, &[RhoD]),
        named(ERROR, &[RhoS, M, Normal]),
        named("", &[Chi2, Freedom, Termination, Undetermined, Mask]),
        vec![DISCARDED.to_string()],
    ]
    .concat()
}

const ERROR: &str = "err.";
const DARK: &str = "dark.";
const DISCARDED: &str = "discarded";

/// Standard errors of channel `c` of a quantity, of the merged parts.
pub fn error(parts: &ChannelMaps, quantity: Quantity, c: usize) -> &[f32] {
    parts.get(&format!("{ERROR}{}", quantity.channel(c))).unwrap_or_default()
}

/// The same to change.
pub fn error_mut(parts: &mut ChannelMaps, quantity: Quantity, c: usize) -> Option<&mut Vec<f32>> {
    let name = format!("{ERROR}{}", quantity.channel(c));
    parts.channels.iter_mut().find(|(n, _)| *n == name).map(|(_, plane)| plane)
}

/// What one standard deviation of the dark frame does to channel `c` of ρd, of the merged parts.
pub fn by_dark(parts: &ChannelMaps, c: usize) -> &[f32] {
    parts.get(&format!("{DARK}{}", Quantity::RhoD.channel(c))).unwrap_or_default()
}

/// χ² and degrees of freedom of every texel, of the merged parts.
pub fn chi2(parts: &ChannelMaps) -> (&[f32], &[f32]) {
    let plane = |q| parts.scalar(q).unwrap_or_default();
    (plane(Quantity::Chi2), plane(Quantity::Freedom))
}

/// Readings of every texel that its fit left out as outliers, of the merged parts.
pub fn discarded(parts: &ChannelMaps) -> &[f32] {
    parts.get(DISCARDED).unwrap_or_default()
}

/// Describes what a part holds. The parts of a stopped run are reused only where this description is the same.
pub fn format() -> String {
    format!("{ROWS} rows of {}", channels().join(" "))
}

/// Which parts this process makes: every N-th from the I-th (0-based).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FitShard {
    /// Which of the shards this process is, from 0.
    pub index: usize,
    /// How many shards there are.
    pub count: usize,
}

/// The parts of one side.
pub(crate) struct Job<'a> {
    pub capture: &'a TubeCapture,
    pub side: Side,
    pub mask: &'a [bool],
    pub fitter: &'a GlossTexelFitter,
    pub level: &'a CameraNoise,
    /// Which frames the fitter sees.
    pub splits: &'a FrameSplits,
    /// The fit of fewer frames that this one starts from.
    pub earlier: Option<&'a EarlierFit>,
    /// Folder of the part files.
    pub parts: &'a Path,
}

impl Job<'_> {
    fn rows(&self, part: usize) -> Range<usize> {
        part * ROWS..((part + 1) * ROWS).min(self.capture.manifest.height)
    }

    pub fn count(&self) -> usize {
        self.capture.manifest.height.div_ceil(ROWS)
    }

    pub fn path(&self, part: usize) -> PathBuf {
        self.parts.join(format!("{}-{:05}.exr", self.side.name(), part * ROWS))
    }

    /// Fits every part of the shard that does not exist yet. `first` is the number of parts of the sides before this
    /// one, so that the shards share the work of both sides evenly.
    ///
    /// # Errors
    /// Frames that cannot be read, parts that cannot be written.
    pub fn run(&self, shard: FitShard, first: usize, bar: &TaskProgress) -> Result<Seconds> {
        let mut spent = Seconds::default();
        for part in (0..self.count()).filter(|p| (first + p) % shard.count == shard.index) {
            let texels = self.texels(part);
            if self.path(part).exists() {
                bar.advance(texels.len() as u64);
                continue;
            }
            self.fit_part(part, &texels, &mut spent)?;
            bar.advance(texels.len() as u64);
        }
        Ok(spent)
    }

    /// Texels on the leaf in one part.
    fn texels(&self, part: usize) -> Vec<[u32; 2]> {
        let width = self.capture.manifest.width;
        self.rows(part)
            .flat_map(|j| (0..width).filter(move |i| self.mask[j * width + i]).map(move |i| [i as u32, j as u32]))
            .collect()
    }

    fn fit_part(&self, part: usize, texels: &[[u32; 2]], spent: &mut Seconds) -> Result<()> {
        let manifest = &self.capture.manifest;
        let rows = self.rows(part);
        let clock = std::time::Instant::now();
        let (x, y) = if texels.is_empty() {
            (Vec::new(), Vec::new())
        } else {
            let read =
                |travel| self.capture.band(self.side, travel, rows.clone(), texels, &self.splits.of(travel).kept);
            (read(Travel::X)?, read(Travel::Y)?)
        };
        spent.reading += clock.elapsed().as_secs_f64();
        let clock = std::time::Instant::now();
        let noise = self.level.readings(self.capture, texels);
        let fits = texels
            .par_iter()
            .enumerate()
            .map_init(
                || (self.fitter.workspace(), vec![[0f32; 3]; x.len()], vec![[0f32; 3]; y.len()]),
                |(workspace, trace_x, trace_y), (n, t)| {
                    go_on()?;
                    for (to, frame) in trace_x.iter_mut().zip(&x) {
                        *to = frame[n].0;
                    }
                    for (to, frame) in trace_y.iter_mut().zip(&y) {
                        *to = frame[n].0;
                    }
                    let at = manifest.texel_position(*t);
                    let second = (!trace_y.is_empty()).then_some(trace_y.as_slice());
                    let start =
                        self.earlier.and_then(|e| e.start(self.side, (t[1] as usize) * manifest.width + t[0] as usize));
                    Ok(self.fitter.fit_from(start, &noise[n], workspace, at, [Some(trace_x), second]))
                },
            )
            .collect::<Result<Vec<GlossTexelFit>>>()?;
        spent.fitting += clock.elapsed().as_secs_f64();
        let maps = to_maps(manifest.width, rows, texels, &fits);
        write_exr(&self.path(part), &maps, Packing::Zip)
    }

    /// How many parts are not there yet.
    pub fn missing(&self) -> usize {
        (0..self.count()).filter(|part| !self.path(*part).exists()).count()
    }

    /// Reads every part into maps of the whole side.
    ///
    /// # Errors
    /// A part that is missing, or that is none of this fit.
    pub fn merge(&self) -> Result<ChannelMaps> {
        let manifest = &self.capture.manifest;
        let names = channels();
        let mut planes: Vec<Vec<f32>> = vec![Vec::with_capacity(manifest.width * manifest.height); names.len()];
        for part in 0..self.count() {
            let path = self.path(part);
            let maps = read_exr(&path)?;
            if (maps.width, maps.height) != (manifest.width, self.rows(part).len()) {
                return Err(Error::input(
                    &path,
                    "not a part of this fit (wrong size); remove the folder and fit again",
                ));
            }
            for (name, plane) in names.iter().zip(&mut planes) {
                plane.extend_from_slice(maps.require(&path, name)?);
            }
        }
        let channels = names.into_iter().zip(planes).collect();
        Ok(ChannelMaps { width: manifest.width, height: manifest.height, channels })
    }
}

/// Wall time of the two halves of the texel phase (s).
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Seconds {
    pub reading: f64,
    pub fitting: f64,
}

fn to_maps(width: usize, rows: Range<usize>, texels: &[[u32; 2]], fits: &[GlossTexelFit]) -> ChannelMaps {
    let names = channels();
    let mut planes = vec![vec![0f32; width * rows.len()]; names.len()];
    for (t, fit) in texels.iter().zip(fits) {
        let at = (t[1] as usize - rows.start) * width + t[0] as usize;
        let mut values = Vec::with_capacity(names.len());
        values.extend(fit.rho_d);
        values.extend(fit.rho_s);
        values.push(fit.m);
        values.extend(fit.normal);
        values.extend(fit.rho_d_err);
        values.extend(fit.rho_d_by_dark);
        values.extend(fit.rho_s_err);
        values.push(fit.m_err);
        values.extend(fit.normal_err);
        values.push(fit.chi2);
        values.push(fit.samples as f64 - fit.parameters as f64);
        values.push(termination_code(fit.termination));
        values.push(f64::from(!fit.undetermined.is_empty()));
        values.push(f64::from(defect::of_texel(fit).map_or(GOOD, Defect::code)));
        values.push(fit.outliers as f64);
        for (plane, v) in planes.iter_mut().zip(values) {
            plane[at] = v as f32;
        }
    }
    ChannelMaps { width, height: rows.len(), channels: names.into_iter().zip(planes).collect() }
}

/// Terminations as numbers in part files.
const TERMINATIONS: [mesophyll_base::solvers::Termination; 9] = {
    use mesophyll_base::solvers::Termination as T;
    [
        T::GradientSmall,
        T::CostConverged,
        T::StepSmall,
        T::Direct,
        T::IterationLimit,
        T::NoProgress,
        T::NotFinite,
        T::Refused,
        T::Flat,
    ]
};

fn termination_code(t: mesophyll_base::solvers::Termination) -> f64 {
    TERMINATIONS.iter().position(|&x| x == t).map_or(-1.0, |k| k as f64)
}

/// Name of a termination code read back from a part.
pub fn termination_name(code: f32) -> &'static str {
    TERMINATIONS.get(code as usize).map_or("unknown", |t| t.name())
}
