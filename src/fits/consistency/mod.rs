//! Whether a fit folder is what a fit wrote, and whether it agrees with itself. Everything that reads a fit asks here.
//!
//! A folder has two safeguards. Content hashes tell whether a file was changed since. Whoever changes a map and writes
//! its hash anew is found by the second: a fit says most of its numbers more than once, and [`of`] holds each against
//! the others that say it.
//!
//! - The mask's codes are the counts of `fit.toml`; what the mask calls good holds numbers that a leaf can have; texels
//!   beyond the good ones hold the values of their nearest good one.
//! - The mean thickness is h, the mean γ is 1 (the gauges).
//! - ρd is γ times the reflectance of the slab of the leaf's σa and σs at the texel's thickness. The maps of σa and σs
//!   are another description of the same texel: their slab gives ρd and ρt.
//! - What that slab leaves of ρt, in units of the errors of ρt, is the χ² of `fit.toml`, and its root mean square the
//!   rms there.
//! - The errors of thickness, γ, σa and σs follow from those of ρd and ρt. Those of ρd, ρs, m and the normal follow
//!   from the device's geometry and noise. The errors of the leaf's σa and σs follow from those of all texels.
//! - The reduced χ² of the texels have the mean and the largest value of `fit.toml`.
//!
//! **How much may differ.** Maps hold single precision, so numbers that one formula joins agree to a few units of
//! 6e-8, times at most the optical thickness of the slab (below 100 where anything comes through); the slab's curve and
//! inverse add 1e-7. [`CLOSE`] is larger than all of this together. The gauges are means over noise that is not linear
//! in the readings and over stand-ins for texels that were lost; both have bounds that the maps themselves give
//! (see `interior`). Errors that rest on what the folder does not keep (gain and dark frame of each texel) may differ
//! by [`FACTOR`] in the median.

mod bounds;
mod device;
mod errors;
mod interior;
mod shared;
mod slab;

use crate::leaf_folder::{LeafFit, LeafFitFile};
use crate::record::{FitKind, FitParameter, FitRecord, RECORD, RecordSection};
use crate::{Error, Result};
use mesophyll_base::rgb::Rgb;
use mesophyll_files::image::{ChannelMaps, read_exr};
use mesophyll_files::progress;
use mesophyll_files::quantity::Quantity;
use mesophyll_optics::side::Side;
use std::path::{Path, PathBuf};

/// Relative difference of two numbers of maps that one formula joins.
const CLOSE: f64 = 1e-4;
/// Factor by which a median standard error may differ from the one that geometry and noise give: the gain of a white
/// sheet, a dark frame and lost readings change the noise of a texel by less.
const FACTOR: f64 = 2.0;

/// A file that is not what the fit wrote.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileChange {
    /// Its path.
    pub path: PathBuf,
    /// The sentence for the user.
    pub said: String,
}

/// What a fit folder says against itself: sentences that name the file, the field, both numbers and the likely cause.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ConsistencyFaults {
    /// Files that are not what the fit wrote, by their hashes.
    pub changed: Vec<FileChange>,
    /// Numbers that contradict each other.
    pub contradictions: Vec<String>,
    /// What is unusual and no fault: another program or version made the fit.
    pub notes: Vec<String>,
    /// What could not be looked at, and why.
    pub unseen: Vec<String>,
}

impl ConsistencyFaults {
    /// What must not be in a fit: changed files and contradictions.
    pub fn all(&self) -> impl Iterator<Item = &String> {
        self.changed.iter().map(|changed| &changed.said).chain(&self.contradictions)
    }

    /// For those that use a fit without judging it: a changed file is refused, everything else is said.
    ///
    /// # Errors
    /// [`Error::Missed`] with the first changed file.
    pub fn require(&self) -> Result<()> {
        if let Some(changed) = self.changed.first() {
            return Err(Error::Missed(changed.said.clone()));
        }
        self.warn();
        Ok(())
    }

    /// Says contradictions and notes as warnings.
    pub fn warn(&self) {
        self.contradictions.iter().chain(&self.notes).for_each(|what| progress::say(format_args!("warning: {what}")));
    }
}

/// Reads the fit in `folder`, of whatever kind, and looks for faults. Numbers in a file that is not what the fit wrote
/// are not looked at.
///
/// # Errors
/// [`Error::Input`] for a folder without a record that can be read, and for a map that is damaged.
pub fn of(folder: &Path) -> Result<ConsistencyFaults> {
    let record = FitRecord::read(folder)?;
    let mut out = ConsistencyFaults {
        changed: (record.changes(folder).into_iter())
            .map(|(name, error)| FileChange { path: folder.join(name), said: error.to_string() })
            .collect(),
        notes: record.made_elsewhere().map(|said| format!("{}: {said}", folder.display())).into_iter().collect(),
        ..ConsistencyFaults::default()
    };
    let place = folder.join(RECORD);
    let whole = |path: &Path| out.changed.iter().all(|changed| changed.path != path);
    if !whole(&place) {
        return Ok(out);
    }
    let mut found = ConsistencyFaults::default();
    found.contradictions.extend(record.contradictions().iter().map(|what| format!("{}: {what}", place.display())));
    if record.kind == FitKind::Leaf {
        let leaf = LeafFit::open(folder)?;
        for side in leaf.sides() {
            // A folder that lacks a map is not contradictory; who needs the map says that it is missing.
            if let Some(seen) = Seen::read(&leaf, side, whole)? {
                seen.judge(&mut found);
            }
        }
        shared::sides(&leaf.record, &place, &mut found.contradictions);
    }
    (out.contradictions, out.unseen) = (found.contradictions, found.unseen);
    Ok(out)
}

/// Whether the record of a leaf fit says how the leaf was measured, so that [`of`] knows how its maps hang together.
pub fn says_how_it_was_measured(record: &FitRecord) -> bool {
    Setup::of(record) != Setup::Unknown
}

/// How a leaf was measured, as far as it decides how the numbers of its fit hang together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Setup {
    /// A scan under a tube, reduced exactly. Whether the light box was seen along the normal.
    Tube { straight: bool },
    /// A scan under a tube by the reduction that Wang et al. 2005 print, which freezes the slab's coefficients.
    Paper,
    /// A capture under a dome.
    Dome,
    /// Photographs.
    Photo,
    /// A fit whose values were changed in the window. ρd and ρt are then the slab's, and nothing was measured.
    Edited,
    /// The record does not say.
    Unknown,
}

impl Setup {
    fn of(record: &FitRecord) -> Setup {
        let told = |name: &str| record.options.get(name).map(String::as_str);
        match (told("edited_from"), told("capture_kind"), told("method")) {
            (Some(_), ..) => Setup::Edited,
            (None, Some("dome"), _) => Setup::Dome,
            (None, Some("photo"), _) => Setup::Photo,
            (None, None, Some("paper")) => Setup::Paper,
            (None, None, Some(_)) => {
                Setup::Tube { straight: record.scan.as_ref().is_none_or(|scan| scan.lightbox_camera_deg == 0.0) }
            }
            _ => Setup::Unknown,
        }
    }
}

/// One side of a leaf fit.
struct Seen<'a> {
    record: &'a FitRecord,
    section: &'a RecordSection,
    setup: Setup,
    path: PathBuf,
    errors_path: PathBuf,
    maps: &'a ChannelMaps,
    errors: Option<ChannelMaps>,
    mask: &'a [f32],
    /// Texels that the mask calls good.
    good: Vec<usize>,
}

impl<'a> Seen<'a> {
    /// `None` where the folder has no maps of the side, or maps without a mask, or other maps than the fit wrote.
    fn read(leaf: &'a LeafFit, side: Side, whole: impl Fn(&Path) -> bool) -> Result<Option<Seen<'a>>> {
        let path = leaf.path(LeafFitFile::Maps, side);
        let there = |path: &Path| path.is_file() && whole(path);
        if !there(&path) {
            return Ok(None);
        }
        let maps = leaf.maps(side)?;
        let Some(mask) = maps.scalar(Quantity::Mask) else { return Ok(None) };
        let errors_path = leaf.path(LeafFitFile::Errors, side);
        let errors = there(&errors_path).then(|| read_exr(&errors_path)).transpose()?;
        if let Some(errors) = &errors {
            errors.require_size(&errors_path, maps.width, maps.height)?;
        }
        Ok(Some(Seen {
            record: &leaf.record,
            section: leaf.section(side)?,
            setup: Setup::of(&leaf.record),
            good: (0..mask.len()).filter(|&k| mask[k] == 1.0).collect(),
            path,
            errors_path,
            maps,
            errors,
            mask,
        }))
    }

    fn judge(&self, out: &mut ConsistencyFaults) {
        let before = out.contradictions.len();
        let known = |q: Quantity| self.param(q).is_some_and(|p| p.stderr.iter().any(|e| e.is_finite()));
        if self.setup == Setup::Edited && (known(Quantity::SigmaA) || known(Quantity::SigmaS)) {
            out.contradictions.push(format!(
                "{}: options.edited_from says that the leaf was changed by hand, which leaves no standard error, but \
                 sigma_a or sigma_s has one; fit.toml was changed after the fit",
                self.path.with_file_name(RECORD).display()
            ));
        }
        bounds::look(self, &mut out.contradictions);
        // Values that are no numbers would contradict everything else.
        if out.contradictions.len() > before {
            return;
        }
        if self.setup == Setup::Unknown {
            let what = "fit.toml does not say how the leaf was measured (options.method or options.capture_kind), so \
                        its maps cannot be held against each other";
            let said = format!("{}: {what}", self.path.display());
            out.unseen.push(said);
            return;
        }
        bounds::light(self, &mut out.contradictions);
        interior::look(self, &mut out.contradictions);
        errors::look(self, &mut out.contradictions);
        device::look(self, &mut out.contradictions);
        shared::look(self, &mut out.contradictions);
    }

    /// Three numbers of the record, where it has them.
    fn three(&self, quantity: Quantity) -> Option<Rgb> {
        let channels = <[f64; 3]>::try_from(self.param(quantity)?.value.as_slice()).ok()?;
        channels.iter().all(|x| x.is_finite()).then_some(Rgb(channels))
    }

    fn param(&self, quantity: Quantity) -> Option<&FitParameter> {
        self.section.params.get(quantity.name())
    }

    /// The leaf's mean thickness (mm).
    fn thickness(&self) -> Option<f64> {
        self.param(Quantity::Thickness)?.value.first().copied().filter(|h| *h > 0.0)
    }

    /// The noise of a transmittance of a scan, relative to it: that of a photograph of the leaf and one of the empty
    /// box.
    fn relative_noise(&self) -> Option<f64> {
        let of_a_frame = self.record.options.get("noise_lightbox")?.split_whitespace().next()?.parse::<f64>().ok()?;
        Some(self.record.scan.as_ref()?.noise_relative * of_a_frame * std::f64::consts::SQRT_2)
    }

    /// Whether the maps of this channel were computed with the σ of `fit.toml`. An undetermined channel's σ is that of
    /// the mean texel, and its maps are not.
    fn as_told(&self, c: usize) -> bool {
        self.setup == Setup::Edited
            || [Quantity::SigmaA, Quantity::SigmaS]
                .iter()
                .all(|q| self.param(*q).and_then(|p| p.stderr.get(c)).is_some_and(|e| e.is_finite()))
    }

    /// Whether the leaf-wide problem reached its goal. Where it did not, its gauges may be open; the verdict says so.
    fn settled(&self) -> bool {
        let ended = self.section.terminations.keys().filter_map(|name| name.strip_prefix("leaf_wide:"));
        ended.into_iter().all(|end| ["gradient_small", "cost_converged", "step_small", "direct"].contains(&end))
    }

    fn figure(&self, name: &str) -> Option<f64> {
        self.section.figures.get(name).copied()
    }

    /// Column and row of a texel.
    fn at(&self, k: usize) -> String {
        format!("({}, {})", k % self.maps.width, k / self.maps.width)
    }

    /// A sentence about texels at which a map is not what other numbers say. `of` names the map, `by` says what it
    /// should be.
    fn told(&self, off: &Off, path: &Path, of: &str, by: &str) -> Option<String> {
        let (k, found, expected) = off.worst?;
        Some(format!(
            "{}: {of} is not {by} at {} of {} texels, such as {} at texel {}, where that is {}; {CAUSE}",
            path.display(),
            off.count,
            self.good.len(),
            figure(found),
            self.at(k),
            figure(expected)
        ))
    }
}

/// What is most likely where two numbers of a sealed folder contradict each other.
const CAUSE: &str = "one of them was changed after the fit";

/// A number in a sentence, with as many digits as tell two of them apart.
fn figure(value: f64) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) || !value.is_finite() {
        let digits =
            if value == 0.0 || !value.is_finite() { 0 } else { (4 - value.abs().log10().floor() as i32).max(0) };
        format!("{value:.*}", digits as usize)
    } else {
        format!("{value:.4e}")
    }
}

/// Texels at which a number is not what it should be.
#[derive(Debug, Clone, Default, PartialEq)]
struct Off {
    count: usize,
    /// The one that is farthest off, relative to what it should be: texel, found, expected.
    worst: Option<(usize, f64, f64)>,
    by: f64,
}

impl Off {
    /// Notes that texel `k` holds `found` instead of `expected`, if they differ by more than `tolerance`.
    fn add(&mut self, k: usize, found: f64, expected: f64, tolerance: f64) {
        let by = (found - expected).abs();
        if by <= tolerance {
            return;
        }
        self.count += 1;
        let by = if by.is_nan() { f64::INFINITY } else { by / expected.abs().max(1e-12) };
        if self.worst.is_none() || by > self.by {
            (self.worst, self.by) = (Some((k, found, expected)), by);
        }
    }

    /// As [`Off::add`], for a number that should lie between two.
    fn within(&mut self, k: usize, found: f64, least: f64, most: f64) {
        let nearest = if found < least { least } else { most };
        if !(found >= least && found <= most) {
            self.add(k, found, nearest, 0.0);
        }
    }

    /// Both lists together.
    fn and(mut self, other: Off) -> Off {
        self.count += other.count;
        if self.worst.is_none() || other.by > self.by {
            (self.worst, self.by) = (other.worst.or(self.worst), self.by.max(other.by));
        }
        self
    }
}

/// The slab of each texel is solved for at most this many of them; of larger leaves every second (third, …) texel.
const TEXELS: usize = 60_000;

/// The texels of a list that are looked at: all, or evenly spread ones where there are more than `most`.
fn sample(of: &[usize], most: usize) -> impl Iterator<Item = usize> + '_ {
    of.iter().copied().step_by(of.len().div_ceil(most).max(1))
}

#[cfg(test)]
mod tests;
