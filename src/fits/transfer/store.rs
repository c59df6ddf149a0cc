//! A transfer on disk: its entries as four channels of half floats, and a picture of its light.

use crate::record::{FitKind, FitRecord};
use crate::transfer::{Options, SUN, SunShadowMaps, TransferLayout, TransferScene, input_hash};
use mesophyll_base::error::{Error, Result};
use mesophyll_files::image::{ChannelMaps, read_exr, to_srgb8, write_png};
use mesophyll_transport::transfer::TransferColumns;
use mesophyll_transport::world::ReferenceWorld;
use std::path::Path;
use std::sync::Arc;

/// The file of all entries, as lines of [`LINE`] pixels. They are in the order of the [`TransferLayout`]'s rows, and
/// columns follow each other within a row.
pub const OPERATORS: &str = "operators.exr";

/// Number of pixels in a line. The last line is filled up with zeros.
const LINE: usize = 256;

const CHANNELS: [&str; 4] = ["between.R", "between.G", "between.B", "straight.Y"];

/// A transfer that was read.
#[derive(Debug, Clone)]
pub struct TransferFit {
    /// Where the rows of each instance are.
    pub layout: TransferLayout,
    /// The functions that the light is a sum of.
    pub columns: TransferColumns,
    /// Number of bands of the harmonics among the rows of a glossy leaf.
    pub gloss_bands: usize,
    /// The factor that the entries are to be multiplied by.
    pub scale: f32,
    /// The entries, row by row and column by column: light by way of other surfaces (red, green, blue), and light
    /// straight from the sky.
    pub entries: Vec<[f32; 4]>,
    /// The sun's shadows, where the fit has them.
    pub sun: Option<SunShadowMaps>,
    /// The world, with the meshes that the anchors and the sun's shares belong to.
    pub world: Arc<ReferenceWorld>,
    /// The record of the fit.
    pub record: FitRecord,
}

impl TransferFit {
    /// Reads the transfer in `folder`; `None` where it was made for another scene, other light or other options. One
    /// that also holds instances that `scene` does not show will do.
    ///
    /// # Errors
    /// [`Error::Input`] for a folder without a fit or with one of another kind, and for a damaged file;
    /// [`Error::Missed`] for a file that is not what the fit wrote.
    pub fn open(folder: &Path, scene: &TransferScene, options: &Options) -> Result<Option<TransferFit>> {
        let record = FitRecord::read_as(folder, FitKind::Transfer)?;
        let held = TransferScene { seen: held(&record, scene.world.instances.len()), ..scene.clone() };
        let has = |seen: &[bool], k: usize| seen.get(k).is_none_or(|s| *s);
        let all_there = (0..scene.world.instances.len()).all(|k| has(&held.seen, k) || !has(&scene.seen, k));
        if !all_there || record.input_hash != input_hash(&held, options) {
            return Ok(None);
        }
        record.verify(folder)?;
        let layout = TransferLayout::new(&held, options);
        let scale = crate::transfer::matter::scale(&scene.world, options.columns);
        let entries = entries(&folder.join(OPERATORS), layout.rows * options.columns.count())?;
        Ok(Some(TransferFit {
            layout,
            columns: options.columns,
            gloss_bands: options.gloss_bands,
            scale,
            entries,
            sun: scene.sun.as_ref().map(|sun| sun.read(&folder.join(SUN))).transpose()?,
            world: scene.world.clone(),
            record,
        }))
    }
}

/// What the record calls the instances without entries of their own.
const LEFT_OUT: &str = "left_out";

/// Writes into the record which instances have no entries of their own: the first one and how many, `3+2 9+1`.
pub(crate) fn note(record: &mut FitRecord, seen: &[bool]) {
    let mut runs: Vec<[usize; 2]> = Vec::new();
    for (k, _) in seen.iter().enumerate().filter(|(_, seen)| !**seen) {
        match runs.last_mut().filter(|[first, count]| first + count == k) {
            Some([_, count]) => *count += 1,
            None => runs.push([k, 1]),
        }
    }
    if !runs.is_empty() {
        let text: Vec<String> = runs.iter().map(|[first, count]| format!("{first}+{count}")).collect();
        record.options.insert(LEFT_OUT.into(), text.join(" "));
    }
}

/// The inverse of [`note`]: for each of `instances` whether it has entries. Empty where all have.
fn held(record: &FitRecord, instances: usize) -> Vec<bool> {
    let Some(text) = record.options.get(LEFT_OUT) else { return Vec::new() };
    let mut seen = vec![true; instances];
    for run in text.split(' ') {
        let numbers = run.split_once('+').and_then(|(first, count)| Some((first.parse().ok()?, count.parse().ok()?)));
        let (first, count): (usize, usize) = numbers.unwrap_or_default();
        seen.iter_mut().skip(first).take(count).for_each(|s| *s = false);
    }
    seen
}

/// The entries as an image.
pub(crate) fn maps(entries: &[[f32; 4]]) -> ChannelMaps {
    let height = entries.len().div_ceil(LINE).max(1);
    let mut maps = ChannelMaps::new(LINE, height);
    for (c, name) in CHANNELS.into_iter().enumerate() {
        let mut plane: Vec<f32> = entries.iter().map(|e| e[c]).collect();
        plane.resize(LINE * height, 0.0);
        maps.push(name, plane);
    }
    maps
}

/// The first `count` entries of an image.
///
/// # Errors
/// [`Error::Input`] for a file that cannot be read, that holds fewer entries, or that holds numbers that are not
/// finite.
pub(crate) fn entries(path: &Path, count: usize) -> Result<Vec<[f32; 4]>> {
    let maps = read_exr(path)?;
    let planes: Vec<&[f32]> = CHANNELS.iter().map(|name| maps.require(path, name)).collect::<Result<_>>()?;
    if planes[0].len() < count {
        return Err(Error::input(path, format!("holds {} entries, expected {count}", planes[0].len())));
    }
    let entries: Vec<[f32; 4]> = (0..count).map(|k| [0, 1, 2, 3].map(|c: usize| planes[c][k])).collect();
    match entries.iter().position(|e| e.iter().any(|v| !v.is_finite())) {
        Some(k) => Err(Error::input(path, format!("entry {k} is {:?}, expected finite numbers", entries[k]))),
        None => Ok(entries),
    }
}

/// Writes a picture of the mean irradiance on each anchor under an even light. Each instance has a line and each anchor
/// a pixel; the front is above and the back below.
pub(crate) fn preview(
    out: &Path,
    layout: &TransferLayout,
    world: &ReferenceWorld,
    entries: &[[f32; 4]],
    columns: usize,
) -> Result<()> {
    let shown = world.instances.len().clamp(1, 256);
    let width = (0..world.instances.len().min(shown))
        .map(|k| layout.leaves[world.instances[k].leaf].anchors.points.len())
        .max()
        .unwrap_or(1);
    let width = width.clamp(1, 512);
    let mut light = vec![[0f32; 3]; width * shown * 2];
    for (k, placed) in world.instances.iter().enumerate().take(shown) {
        let leaf = &layout.leaves[placed.leaf];
        let rows = leaf.rows.count();
        // A row holds a number; three rows of a side are a vector, whose length counts.
        let (sides, parts) = if rows == 1 { (1, 1) } else { (2, 3) };
        for a in 0..leaf.anchors.points.len().min(width) {
            for side in 0..sides {
                let row = layout.first[k] + a * rows + parts * side;
                let of = |q: usize, c: usize| entries[(row + q) * columns][c] + entries[(row + q) * columns][3];
                let length = |c: usize| (0..parts).map(|q| of(q, c).powi(2)).sum::<f32>().sqrt();
                light[(2 * k + side) * width + a] = [0, 1, 2].map(length);
            }
        }
    }
    let most = light.iter().flatten().fold(1e-12f32, |a, b| a.max(*b));
    let bytes: Vec<u8> = light.iter().flatten().map(|v| to_srgb8(v / most)).collect();
    write_png(&out.join("transfer.png"), width, 2 * shown, &bytes)
}
