//! Slices of a meadow (H9 ch. 2: R. Habel, dissertation 2009). A slice is a picture of an upright slab of blades. A
//! fragment of a carrier's surface can trace a ray through the slices in real time. They are fitted to the blades that
//! they represent.
//!
//! [`blades`] is the meadow itself, which rays can hit. [`baking`] takes the pictures, and [`sheet`] stores them.
//! [`march`] follows a ray through the slices, and [`judge`] compares the result with the blades. Pictures hold
//! opacity, reflectance, transmittance and normals, but no light. Lengths are in mm, and z is up.
//!
//! Limits: slices represent blades over level ground; [`hill`] lifts them onto a hill. Blades are Lambertian sheets
//! without gloss. The ground hides the parts of blades that hang below it.

#![warn(missing_docs)]

pub mod baking;
pub mod blades;
pub mod hill;
pub mod irregularity;
pub mod judge;
pub mod march;
pub mod optics;
mod picture;
pub mod sheet;
#[cfg(test)]
mod tests;
pub mod transmittance;
pub mod weights;

pub(crate) use mesophyll_base::error::{Error, Result};

pub mod folder;
pub use folder::{LEVEL, UPRIGHT, open};

use crate::record::FitKind;
use crate::record::maker::{self, FitMaker, FitOutcome};
use baking::SliceSlab;
use blades::{LawnMeadow, STEPS};
use judge::LawnRays;
use march::LawnSlices;
use mesophyll_files::image::{Packing, write_exr};
use mesophyll_files::{atomic, hash, memory, progress, whole_file};
use mesophyll_plants::{file, form::Plant, growth};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sheet::{CHANNELS, CellEdges, SliceAtlas, SliceTexel};
use std::path::{Path, PathBuf};

/// The options of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Number of slices across x, and the same number across y.
    pub slices: usize,
    /// Texels along a slice and along its height; both are powers of two.
    pub texels: [usize; 2],
    /// Whether there is a level slice at half the height.
    pub level: bool,
    /// Number of rays along each side of a texel.
    pub rays: usize,
    /// Number of points of entry along each side of the rectangle, for the rays that weights are fitted to and that
    /// errors are measured with.
    pub entries: usize,
    /// The table of the leaves' reflectance and transmittance; the program's own table where none is given.
    pub leaves: Option<PathBuf>,
    /// Fits again although the folder already holds this very fit.
    pub force: bool,
    /// Whether `view.png` is drawn, a picture of the meadow and of its slices for people. It takes about three million
    /// rays, whatever the other options say.
    pub view: bool,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            slices: 16,
            texels: [256, 64],
            level: true,
            rays: 4,
            entries: 48,
            leaves: None,
            force: false,
            view: true,
        }
    }
}

/// How slices are made. It changes when the same meadow gets other slices.
const METHOD: &str = "pictures along normals; weights fitted in 17 steps; shadows within the level slice";
/// The picture that shows the blades (above) and the slices (below).
const VIEW: &str = "view.png";
/// Number of slices in a part.
const SLICES_A_PART: usize = 8;
/// What the parts hold. It changes when their format changes.
const PART: &str = "pictures of up to 8 slabs under one another, without borders, as EXR; weights; what was judged";
/// The largest number of texels of a fit, with borders and coarser levels. An adapter takes 32 bytes for each texel,
/// which makes 1 GiB.
const MOST_TEXELS: usize = 1 << 25;
/// Bytes for each texel while a fit is made: the pictures, the sheet with its coarser levels, and the numbers of a file
/// that is being written.
const BYTES_A_TEXEL: usize = 4 * size_of::<SliceTexel>();

/// Reads a meadow from its description, or from the file that `grow` makes of the description.
///
/// # Errors
/// [`Error::Input`] for a file that cannot be read or that describes no plant.
pub fn plant(path: &Path) -> Result<Plant> {
    let described = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    if described { growth::described(path, None) } else { file::read(path) }
}

/// Fits slices to the meadow in the file `input` (.toml or .glb) and writes them into the folder `out`.
///
/// # Errors
/// Those of [`plant`], [`optics::read`], [`LawnMeadow::new`] and [`maker::make`]; [`Error::Interrupted`] after a stop,
/// when finished parts are kept.
pub fn run(input: &Path, out: &Path, options: &Options) -> Result<FitOutcome> {
    let (path, options) = (input.to_path_buf(), options.clone());
    maker::make(FitKind::Grass, out, &[input], move |maker| fit(&path, &options, maker))
}

fn fit(path: &Path, options: &Options, maker: &mut FitMaker) -> Result<FitOutcome> {
    let leaves = optics::read(options.leaves.as_deref())?;
    let told_leaves = optics::told(options.leaves.as_deref())?;
    let bytes = whole_file::bytes(path, whole_file::MOST_DATA)?;
    let plant = maker.phase("grow", || plant(path))?;
    let Options { slices: n, texels, level, rays, entries, .. } = options;
    let told = format!("{n} {texels:?} {level} {rays} {entries}");
    let (meadow_hash, optics) = (hash::bytes(&bytes), format!("{leaves:?}"));
    let input =
        [("method", METHOD), ("meadow", meadow_hash.as_str()), ("leaves", optics.as_str()), ("options", told.as_str())];
    let input_hash = maker::input_hash(input);
    let meadow = maker.phase("box tree", || LawnMeadow::new(path, &plant, &leaves))?;
    let [w, h] = *texels;
    let count = counted(options, meadow.period)
        .map_err(|told| Error::Usage(format!("--slices {n} with --texels {w}x{h} makes {told}")))?;
    fits_memory(count, "a fit")?;
    if let Some(found) = maker.up_to_date(input_hash, options.force)? {
        return Ok(found);
    }
    let mut slices = slices(&meadow, options, maker)?;
    let start = std::time::Instant::now();
    let make = |_: &Path| Ok(Weights { known: weights::fit(&meadow, &mut slices, options.entries)? });
    let (Weights { known }, ..) = part(maker, "weights", make, |_, _| Ok(()))?;
    slices.projection = std::array::from_fn(|k| known.get(k).map_or(meadow.projection[k], |known| known.value));
    maker.times.phase("weights", start);
    let start = std::time::Instant::now();
    let rays = LawnRays { side: options.entries, level: 0.0, sunlit: true };
    let make = |_: &Path| Ok(Table { judged: judge::judged(&slices, &judge::blades(&meadow, rays), rays) });
    let (Table { judged }, ..) = part(maker, "judged", make, |_, _| Ok(()))?;
    maker.times.phase("judge", start);
    let mut record = maker.record(&meadow.name);
    folder::describe(&mut record, &meadow, &slices, options, told_leaves, &known, &judged);
    let out = maker.begin()?;
    folder::write(out, &slices, &mut record)?;
    if options.view {
        picture::write(&out.join(VIEW), &meadow, &slices)?;
    }
    Ok(FitOutcome::Done(maker.finish(record)?))
}

/// What a finished part records beside its pictures.
#[derive(Debug, Serialize, Deserialize)]
struct Part {
    slabs: usize,
}

/// The part with the result of [`weights::fit`], one entry for each step of |Ω_z|.
#[derive(Debug, Serialize, Deserialize)]
struct Weights {
    known: Vec<weights::LawnProjection>,
}

/// The part with the result of [`judge::judged`].
#[derive(Debug, Serialize, Deserialize)]
struct Table {
    judged: Vec<judge::LawnComparison>,
}

/// As [`FitMaker::part`], and also tells whether the part was kept from a run that was stopped. A kept part that
/// `whole` finds incomplete is removed and made again; the other parts stay.
fn part<T: Serialize + DeserializeOwned, W>(
    maker: &mut FitMaker,
    name: &str,
    mut make: impl FnMut(&Path) -> Result<T>,
    whole: impl Fn(&Path, &T) -> Result<W>,
) -> Result<(T, W, bool)> {
    loop {
        let mut kept = true;
        let found = maker.part(PART, name, |folder, _| {
            kept = false;
            make(folder)
        });
        let folder = maker.parts(PART);
        match found.and_then(|part| whole(folder, &part).map(|whole| (part, whole, kept))) {
            Err(_) if kept => remove(folder, name)?,
            done => return done,
        }
    }
}

/// Removes the files of one part.
fn remove(folder: &Path, name: &str) -> Result<()> {
    let unread = |e: std::io::Error| Error::input(folder, atomic::explain(&e));
    for entry in std::fs::read_dir(folder).map_err(unread)?.flatten() {
        if entry.file_name().to_string_lossy().starts_with(&format!("{name}.")) {
            std::fs::remove_file(entry.path()).map_err(|e| Error::write(&entry.path(), atomic::explain(&e)))?;
        }
    }
    Ok(())
}

/// Number of texels, with borders and coarser levels, of the slices that the options make of a meadow with this
/// rectangle (mm).
///
/// # Errors
/// A text with the found and the expected number, where the slices would have too many texels.
pub fn counted(options: &Options, period: [f64; 2]) -> std::result::Result<usize, String> {
    let texels = texels(options, period);
    if texels > MOST_TEXELS {
        let [found, most] = [texels, MOST_TEXELS].map(|n| n as f64 / 1e6);
        return Err(format!("{found:.1} million texels; expected at most {most:.1} million"));
    }
    Ok(texels)
}

/// Refuses a number of texels for which there is not enough memory. `what` names the thing that is made.
///
/// # Errors
/// [`Error::Usage`] with the memory that is needed and that is available.
pub fn fits_memory(texels: usize, what: &str) -> Result<()> {
    let told = format!("{what} of {:.1} million texels", texels as f64 / 1e6);
    memory::require((BYTES_A_TEXEL * texels) as u64, &told)
}

fn texels(options: &Options, period: [f64; 2]) -> usize {
    let level = if options.level { sheet::area(level_cell(period, options), 1) } else { 0 };
    sheet::area(options.texels, 2 * options.slices) + level
}

/// Bytes on a graphics adapter of the slices that the options make of a meadow with this rectangle (mm).
pub fn bytes(options: &Options, period: [f64; 2]) -> usize {
    sheet::BYTES * texels(options, period)
}

/// Takes all pictures, part by part.
fn slices(meadow: &LawnMeadow, options: &Options, maker: &mut FitMaker) -> Result<LawnSlices> {
    let n = options.slices;
    let cell = options.texels;
    let square = level_cell(meadow.period, options);
    let slabs: Vec<SliceSlab> = (0..n).map(|k| SliceSlab::X(k, n)).chain((0..n).map(|k| SliceSlab::Y(k, n))).collect();
    let bar = progress::TaskProgress::new("slices", slabs.len() as u64 + u64::from(options.level));
    let start = std::time::Instant::now();
    let mut pictures = Vec::new();
    let mut parts: Vec<Vec<SliceSlab>> = slabs.chunks(SLICES_A_PART).map(<[SliceSlab]>::to_vec).collect();
    if options.level {
        parts.push(vec![SliceSlab::Z]);
    }
    for (k, slabs) in parts.iter().enumerate() {
        let name = format!("part-{k}");
        let size = if slabs[0] == SliceSlab::Z { square } else { cell };
        let make = |folder: &Path| {
            let mut texels = Vec::new();
            for slab in slabs {
                texels.extend(slab.picture(meadow, size, options.rays));
                bar.step()?;
            }
            let maps = sheet::maps(size[0], &texels);
            write_exr(&folder.join(format!("{name}.exr")), &maps, Packing::Half)?;
            Ok(Part { slabs: slabs.len() })
        };
        let whole = |folder: &Path, part: &Part| {
            sheet::texels(&folder.join(format!("{name}.exr")), size[0], size[1] * part.slabs)
        };
        let (_, texels, kept) = part(maker, &name, make, whole)?;
        pictures.extend(texels.chunks(size[0] * size[1]).map(<[SliceTexel]>::to_vec));
        if kept {
            bar.advance(slabs.len() as u64);
        }
    }
    maker.times.phase("pictures", start);
    Ok(assembled(meadow, options, &pictures))
}

/// Puts pictures together into slices. They are in the order of their slabs: across x, across y, then the level one.
fn assembled(meadow: &LawnMeadow, options: &Options, pictures: &[Vec<SliceTexel>]) -> LawnSlices {
    let n = options.slices;
    let at = |size: [usize; 2]| {
        move |k: usize, x: usize, y: usize| pictures.get(k).map_or([0.0; CHANNELS], |p| p[y * size[0] + x])
    };
    let square = level_cell(meadow.period, options);
    let level = options.level.then(|| SliceAtlas::new(square, 1, CellEdges::Level, |_, x, y| at(square)(2 * n, x, y)));
    let upright = SliceAtlas::new(options.texels, 2 * n, CellEdges::Upright, at(options.texels));
    LawnSlices {
        period: meadow.period,
        height: meadow.height,
        count: n,
        projection: meadow.projection,
        shown: [meadow.projection[0], meadow.projection[STEPS]],
        cover: LawnSlices::covers(&upright, level.as_ref()),
        upright,
        level,
        weighted: true,
        irregular: None,
    }
}

/// Takes all pictures of a meadow at once, without a folder.
pub fn baked(meadow: &LawnMeadow, options: &Options) -> LawnSlices {
    let n = options.slices;
    let upright = (0..n).map(|k| SliceSlab::X(k, n)).chain((0..n).map(|k| SliceSlab::Y(k, n)));
    let mut pictures: Vec<Vec<SliceTexel>> = upright.map(|s| s.picture(meadow, options.texels, options.rays)).collect();
    if options.level {
        pictures.push(SliceSlab::Z.picture(meadow, level_cell(meadow.period, options), options.rays));
    }
    assembled(meadow, options, &pictures)
}

/// Texels of the level slice: along x as many as any slice has, and along y the power of two that suits the rectangle.
fn level_cell(period: [f64; 2], options: &Options) -> [usize; 2] {
    let w = options.texels[0];
    let along_y = (w as f64 * period[1] / period[0]).log2().round().clamp(2.0, 12.0);
    [w, 1 << along_y as u32]
}
