//! Slices of a meadow (H9 ch. 2: R. Habel, dissertation 2009): pictures of upright slabs of blades, which a fragment of
//! a carrier's surface can trace in real time, fitted to the blades that they stand for.
//!
//! [`blades`] is the meadow itself, met by rays. [`bake`] takes the pictures, [`sheet`] keeps them. [`march`] follows a
//! ray through the slices, [`judge`] compares it with the blades. Pictures hold opacity, reflectance, transmittance and
//! normals, and no light. Lengths are in mm, z is up.
//!
//! Limits: slices stand for blades over level ground; blades are Lambertian sheets without gloss; blades that hang below
//! the ground are hidden by it.

#![warn(missing_docs)]

pub mod bake;
pub mod blades;
pub mod judge;
pub mod march;
pub mod optics;
mod picture;
pub mod sheet;
#[cfg(test)]
mod tests;
pub mod through;
pub mod weights;

pub(crate) use mesophyll_error::{Error, Result};

pub mod folder;
pub use folder::{LEVEL, UPRIGHT, open};

use bake::Slab;
use blades::{Meadow, STEPS};
use judge::Rays;
use march::Slices;
use mesophyll_files::image::{Packing, write_exr};
use mesophyll_files::{atomic, hash, memory, progress};
use mesophyll_flora::{file, form::Plant, grow};
use mesophyll_record::FitKind;
use mesophyll_record::maker::{self, Maker, Outcome};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sheet::{CHANNELS, Edges, Sheet, Texel};
use std::path::{Path, PathBuf};

/// What the user may choose.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Slices across x, and as many across y.
    pub slices: usize,
    /// Texels along a slice and along its height: powers of two.
    pub texels: [usize; 2],
    /// Whether there is a level slice at half the height.
    pub level: bool,
    /// Rays along each side of a texel.
    pub rays: usize,
    /// Points of entry along each side of the rectangle: rays that weights are fitted to, and errors judged by.
    pub entries: usize,
    /// The table of what leaves reflect and let through; the program's own where there is none.
    pub leaves: Option<PathBuf>,
    /// Fit again although the folder already holds this very fit.
    pub force: bool,
}

impl Default for Options {
    fn default() -> Options {
        Options { slices: 16, texels: [256, 64], level: true, rays: 4, entries: 48, leaves: None, force: false }
    }
}

/// How slices are made: changes where the same meadow gets others.
const METHOD: &str = "pictures along normals; weights fitted in 17 steps; shadows within the level slice";
/// The blades (above) and the slices (below), as they look.
const VIEW: &str = "view.png";
/// Slices a part.
const SLICES_A_PART: usize = 8;
/// What the parts hold: changes where their format does.
const PART: &str = "pictures of up to 8 slabs under one another, without borders, as EXR; weights; what was judged";
/// No fit has more texels, with borders and coarser levels. An adapter takes 32 bytes a texel: 1 GiB.
const MOST_TEXELS: usize = 1 << 25;
/// Bytes a texel while a fit is made: the pictures, the sheet with its coarser levels, and the numbers of a file that is
/// written.
const BYTES_A_TEXEL: usize = 4 * size_of::<Texel>();

/// Reads a meadow: its description, or the file that `grow` makes of it.
///
/// # Errors
/// [`Error::Input`] for a file that cannot be read or that describes no plant.
pub fn plant(path: &Path) -> Result<Plant> {
    let described = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    if described { grow::described(path, None) } else { file::read(path) }
}

/// Fits slices to the meadow in the file `input` (.toml or .glb) and writes them into the folder `out`.
///
/// # Errors
/// What [`plant`], [`optics::read`], [`Meadow::new`] and [`maker::make`] give; [`Error::Interrupted`] after a stop, which
/// keeps finished parts.
pub fn run(input: &Path, out: &Path, options: &Options) -> Result<Outcome> {
    let (path, options) = (input.to_path_buf(), options.clone());
    maker::make(FitKind::Grass, out, &[input], move |maker| fit(&path, &options, maker))
}

fn fit(path: &Path, options: &Options, maker: &mut Maker) -> Result<Outcome> {
    let leaves = optics::read(options.leaves.as_deref())?;
    let told_leaves = optics::told(options.leaves.as_deref())?;
    let bytes = std::fs::read(path).map_err(|e| Error::input(path, atomic::explain(&e)))?;
    let plant = maker.phase("grow", || plant(path))?;
    let Options { slices: n, texels, level, rays, entries, .. } = options;
    let told = format!("{n} {texels:?} {level} {rays} {entries}");
    let (meadow_hash, optics) = (hash::bytes(&bytes), format!("{leaves:?}"));
    let input =
        [("method", METHOD), ("meadow", meadow_hash.as_str()), ("leaves", optics.as_str()), ("options", told.as_str())];
    let input_hash = maker::input_hash(input);
    let meadow = maker.phase("box tree", || Meadow::new(path, &plant, &leaves))?;
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
    let rays = Rays { side: options.entries, level: 0.0, sunlit: true };
    let make = |_: &Path| Ok(Table { judged: judge::judged(&slices, &judge::blades(&meadow, rays), rays) });
    let (Table { judged }, ..) = part(maker, "judged", make, |_, _| Ok(()))?;
    maker.times.phase("judge", start);
    let mut record = maker.record(&meadow.name);
    folder::describe(&mut record, &meadow, &slices, options, told_leaves, &known, &judged);
    let out = maker.begin()?;
    folder::write(out, &slices, &mut record)?;
    picture::write(&out.join(VIEW), &meadow, &slices)?;
    maker.finish(&record)?;
    Ok(Outcome::Done(Box::new(record)))
}

/// What is told of a finished part beside its pictures.
#[derive(Debug, Serialize, Deserialize)]
struct Part {
    slabs: usize,
}

/// The part that holds what [`weights::fit`] found, a step of |Ω_z| each.
#[derive(Debug, Serialize, Deserialize)]
struct Weights {
    known: Vec<weights::Known>,
}

/// The part that holds what [`judge::judged`] found.
#[derive(Debug, Serialize, Deserialize)]
struct Table {
    judged: Vec<judge::Judged>,
}

/// As [`Maker::part`], and whether the part was kept from a run that was stopped. A kept part that `whole` does not find
/// whole is removed and made again; the others stay.
fn part<T: Serialize + DeserializeOwned, W>(
    maker: &mut Maker,
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

/// Texels of the slices that options make of a meadow with this rectangle (mm), with borders and coarser levels.
///
/// # Errors
/// The found and the expected number in words, where there are more than slices may have.
pub fn counted(options: &Options, period: [f64; 2]) -> std::result::Result<usize, String> {
    let texels = texels(options, period);
    if texels > MOST_TEXELS {
        let [found, most] = [texels, MOST_TEXELS].map(|n| n as f64 / 1e6);
        return Err(format!("{found:.1} million texels; expected at most {most:.1} million"));
    }
    Ok(texels)
}

/// Refuses so many texels where there is not the memory to make them; `what` is made.
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

/// Bytes on a graphics adapter of the slices that options make of a meadow with this rectangle (mm).
pub fn bytes(options: &Options, period: [f64; 2]) -> usize {
    sheet::BYTES * texels(options, period)
}

/// Takes all pictures, part by part.
fn slices(meadow: &Meadow, options: &Options, maker: &mut Maker) -> Result<Slices> {
    let n = options.slices;
    let cell = options.texels;
    let square = level_cell(meadow.period, options);
    let slabs: Vec<Slab> = (0..n).map(|k| Slab::X(k, n)).chain((0..n).map(|k| Slab::Y(k, n))).collect();
    let bar = progress::Bar::new("slices", slabs.len() as u64 + u64::from(options.level));
    let start = std::time::Instant::now();
    let mut pictures = Vec::new();
    let mut parts: Vec<Vec<Slab>> = slabs.chunks(SLICES_A_PART).map(<[Slab]>::to_vec).collect();
    if options.level {
        parts.push(vec![Slab::Z]);
    }
    for (k, slabs) in parts.iter().enumerate() {
        let name = format!("part-{k}");
        let size = if slabs[0] == Slab::Z { square } else { cell };
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
        pictures.extend(texels.chunks(size[0] * size[1]).map(<[Texel]>::to_vec));
        if kept {
            bar.advance(slabs.len() as u64);
        }
    }
    maker.times.phase("pictures", start);
    Ok(assembled(meadow, options, &pictures))
}

/// Slices of pictures in the order of their slabs: across x, across y, and the level one.
fn assembled(meadow: &Meadow, options: &Options, pictures: &[Vec<Texel>]) -> Slices {
    let n = options.slices;
    let at = |size: [usize; 2]| {
        move |k: usize, x: usize, y: usize| pictures.get(k).map_or([0.0; CHANNELS], |p| p[y * size[0] + x])
    };
    let square = level_cell(meadow.period, options);
    let level = options.level.then(|| Sheet::new(square, 1, Edges::Level, |_, x, y| at(square)(2 * n, x, y)));
    let upright = Sheet::new(options.texels, 2 * n, Edges::Upright, at(options.texels));
    Slices {
        period: meadow.period,
        height: meadow.height,
        count: n,
        projection: meadow.projection,
        shown: [meadow.projection[0], meadow.projection[STEPS]],
        cover: Slices::covers(&upright, level.as_ref()),
        upright,
        level,
        weighted: true,
    }
}

/// Takes all pictures of a meadow at once, without a folder.
pub fn baked(meadow: &Meadow, options: &Options) -> Slices {
    let n = options.slices;
    let upright = (0..n).map(|k| Slab::X(k, n)).chain((0..n).map(|k| Slab::Y(k, n)));
    let mut pictures: Vec<Vec<Texel>> = upright.map(|s| s.picture(meadow, options.texels, options.rays)).collect();
    if options.level {
        pictures.push(Slab::Z.picture(meadow, level_cell(meadow.period, options), options.rays));
    }
    assembled(meadow, options, &pictures)
}

/// Texels of the level slice: as many along x as a slice has, and along y as fit, a power of two.
fn level_cell(period: [f64; 2], options: &Options) -> [usize; 2] {
    let w = options.texels[0];
    let along_y = (w as f64 * period[1] / period[0]).log2().round().clamp(2.0, 12.0);
    [w, 1 << along_y as u32]
}
