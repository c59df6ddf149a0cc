//! Reads files of fits. Every read is noted in the ledger with its bytes and its time.

use crate::placed::ledger::Ledger;
use crate::placed::{Error, Result};
use mesophyll_files::image::ChannelMaps;
use mesophyll_fits::leaf_folder::{LeafFit, LeafFitFile, packing};
use mesophyll_optics::side::Side;

/// The name of a fit's file, or of a texture made from it, in the ledger and in the plan.
pub fn entry(fit: &LeafFit, what: &str) -> String {
    format!("{}/{what}", fit.name)
}

/// Size of one of the folder's files; 0 where it does not exist.
pub fn bytes(fit: &LeafFit, file: &str) -> u64 {
    std::fs::metadata(fit.folder.join(file)).map_or(0, |m| m.len())
}

/// The maps of a side, which are read from disk when they are needed for the first time.
///
/// # Errors
/// [`Error::Input`] for a file that is missing or damaged.
pub fn maps<'a>(fit: &'a LeafFit, side: Side, ledger: &Ledger) -> Result<&'a ChannelMaps> {
    if fit.is_read(side) {
        return fit.maps(side);
    }
    let file = LeafFitFile::Maps.name(side);
    ledger.note("read", entry(fit, &file), bytes(fit, &file), || fit.maps(side))
}

/// The normals of a side in the tangent frame of the scanned blade, whatever blade is drawn.
///
/// # Errors
/// As [`maps`], and for a blade that cannot be read.
pub fn normals(fit: &LeafFit, side: Side, ledger: &Ledger) -> Result<Vec<[f32; 3]>> {
    let maps = maps(fit, side, ledger)?;
    ledger.note("pack", entry(fit, &texture(side, NORMAL)), 0, || packing::blade_normals(fit, side, maps))
}

/// The name of the texture of γ and δ. These names are those of the plan.
pub const GAMMA_DELTA: &str = "gamma_delta";
/// The texture of ρs and m.
pub const GLOSS: &str = "rho_s_m";
/// The texture of mapped normals.
pub const NORMAL: &str = "normal";

/// `front_gamma_delta`: a texture of a side.
pub fn texture(side: Side, what: &str) -> String {
    format!("{}_{what}", side.name())
}

/// The size of a leaf's maps. `size` is that of one side's maps, and `known` is the size that is known so far (zeros if
/// none is).
///
/// # Errors
/// [`Error::Input`] naming the file where they differ.
pub fn same_size(fit: &LeafFit, side: Side, known: [usize; 2], size: [usize; 2]) -> Result<[usize; 2]> {
    if known == [0, 0] || known == size {
        return Ok(size);
    }
    let found = format!("found {}x{} texels", size[0], size[1]);
    let what = format!("{found}, expected {}x{} as of the leaf's other maps", known[0], known[1]);
    Err(Error::input(&fit.path(LeafFitFile::Maps, side), what))
}
