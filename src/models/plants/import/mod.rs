//! Finds the branches of a plant that consists of triangles only, as other programs write it. The steps are connected
//! pieces ([`soup`]), the axis of each ([`axis`]), the pieces that are blades ([`leaf`]), and which branch grows on
//! which ([`attachment`]).
//!
//! A branch is one connected tube. A branch that cannot be attached is listed with a reason. Lengths are in mm, in the
//! frame of the file that was read (y up, as in glTF).

mod arms;
pub mod attachment;
pub mod axis;
mod backs;
pub mod flat_pieces;
pub mod leaf;
mod other_pieces;
#[cfg(test)]
mod other_program_tests;
mod outline;
pub mod plant;
pub mod soup;
pub mod table;
#[cfg(test)]
mod tests;

use crate::{Error, Result};
use axis::TaperedTube;
use glam::DVec3;
use mesophyll_base::statistics::median_of;
use mesophyll_files::unit::LengthUnit;
use rayon::prelude::*;
use soup::{MeshPiece, TriangleSoup};
use std::path::Path;

/// The parts of a plant that were found.
#[derive(Debug, Clone, Default)]
pub struct PlantPieces {
    /// The branches. Parents stand before what grows on them, and branches that cannot be attached stand last.
    pub branches: Vec<BranchPiece>,
    /// The blades, and the branches that they hang on.
    pub leaves: Vec<LeafPiece>,
    /// Pieces that are neither a tube nor a blade, with a reason.
    pub others: Vec<OtherPiece>,
    /// Triangles without an area, which were left out.
    pub degenerate: usize,
    /// Triangles that repeat another one, which were left out.
    pub doubled: usize,
    /// All pieces of the soup, which the parts refer to.
    pub pieces: Vec<MeshPiece>,
}

/// A branch that was found.
#[derive(Debug, Clone)]
pub struct BranchPiece {
    /// Index of its piece.
    pub piece: usize,
    /// Its axis and radii.
    pub tube: TaperedTube,
    /// Index of the branch on which it grows.
    pub parent: Option<usize>,
    /// Share of the parent's axis at which it grows.
    pub at: f64,
    /// Level of the branch; 0 is a trunk. It is unknown for a branch that is not attached.
    pub level: Option<usize>,
    /// How certain the parent is, from 0 to 1.
    pub confidence: f64,
    /// Why it is not attached; `None` for a trunk and for a branch that is attached.
    pub unattached: Option<String>,
}

/// A blade that was found.
#[derive(Debug, Clone)]
pub struct LeafPiece {
    /// Index of its piece.
    pub piece: usize,
    /// Its middle (mm).
    pub centre: DVec3,
    /// Unit normal of its plane. A flat piece does not tell which of its two sides is the front.
    pub normal: DVec3,
    /// Length and width (mm).
    pub size: [f64; 2],
    /// Area of one side (mm²).
    pub area: f64,
    /// The two ends of its longest extent (mm). The first is the one that hangs on the branch.
    pub ends: [DVec3; 2],
    /// Whether its texture coordinates say which end is the tip, because it is about as wide as long.
    pub upright: bool,
    /// The branch that it hangs on, and the share of its axis; `None` where no branch is near.
    pub joint: Option<(usize, f64)>,
    /// The same for the nearest branch, however far it is; `None` where there is no branch.
    pub nearest: Option<(usize, f64)>,
    /// Distance from the blade's edge to the branch's surface (mm).
    pub gap: f64,
}

/// A piece that is neither a tube nor a blade.
#[derive(Debug, Clone)]
pub struct OtherPiece {
    /// Index of its piece.
    pub piece: usize,
    /// Its middle (mm).
    pub centre: DVec3,
    /// Its triangles.
    pub triangles: usize,
    /// Why it is neither.
    pub why: String,
}

/// Reads `path` and finds its branches. Lengths are in `unit`, or in the file's own unit where none is given.
///
/// # Errors
/// [`Error::Input`] in one sentence, for what [`soup::read`] refuses and for a file in which no piece is a tube.
pub fn import(path: &Path, unit: Option<LengthUnit>) -> Result<(TriangleSoup, PlantPieces)> {
    let soup = soup::read(path, unit)?;
    let found = find(&soup, &|_| None);
    if found.branches.is_empty() {
        let why = found.others.first().map_or_else(String::new, |other| format!(" (the first one: {})", other.why));
        let what = format!(
            "found no branch among {} flat pieces and {} others{why}, expected at least one tube; as it is, a scene \
             takes the file as a plant that stands still ([[plant]] file)",
            found.leaves.len(),
            found.others.len()
        );
        return Err(Error::input(path, what));
    }
    Ok((soup, found))
}

/// What a material is known to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MaterialClass {
    /// Blades, whatever their shape is.
    Leaf,
    /// Wood, also where it is flat.
    Wood,
}

/// Sizes that no plant has, a sentence each: the file's unit is probably another.
pub fn strange(soup: &TriangleSoup, found: &PlantPieces) -> Vec<String> {
    let mut out = Vec::new();
    let unit = "are the file's lengths in another unit than was taken (--unit)?";
    if let Some(median) = median_of(found.leaves.iter().map(|leaf| leaf.size[0])).filter(|mm| !BLADES.contains(mm)) {
        let than = if median < 1.0 { "shorter" } else { "longer" };
        out.push(format!("half of the blades are {than} than {}, which no leaf is: {unit}", metres(median)));
    }
    let (low, high) = soup
        .places
        .iter()
        .fold((DVec3::splat(f64::INFINITY), DVec3::splat(f64::NEG_INFINITY)), |(a, b), p| (a.min(*p), b.max(*p)));
    let size = (high - low).max_element();
    if !PLANTS.contains(&size) {
        out.push(format!("the plant is {} across, which no plant with branches is: {unit}", metres(size)));
    }
    out
}

/// The lengths of blades (mm) that are taken as they are: from those of duckweed to twice those of a banana.
const BLADES: std::ops::RangeInclusive<f64> = 0.3..=6000.0;
/// The same for plants with branches; the tallest tree has 116 m.
const PLANTS: std::ops::RangeInclusive<f64> = 30.0..=150_000.0;

/// A length in mm as text in metres, with three digits.
fn metres(mm: f64) -> String {
    let digits = (2 - (mm / 1000.0).log10().floor() as i32).clamp(0, 9) as usize;
    format!("{:.digits$} m", mm / 1000.0)
}

enum Kind {
    Tube(Box<TaperedTube>),
    Leaf(LeafPiece),
    Other(OtherPiece),
}

/// Finds the branches of a soup. `known` says what a material is, by its name, where that is known.
pub fn find(soup: &TriangleSoup, known: &(impl Fn(&str) -> Option<MaterialClass> + Sync)) -> PlantPieces {
    let all = unjoined(soup, soup.pieces(), known);
    let kind = |(k, piece): (usize, &MeshPiece)| {
        let matter = known(soup.material(piece));
        if matter != Some(MaterialClass::Wood)
            && let Some(leaf) = leaf::of(soup, piece)
        {
            return Kind::Leaf(LeafPiece { piece: k, ..leaf });
        }
        let other = |why| OtherPiece { piece: k, centre: soup.centre(piece), triangles: piece.triangles.len(), why };
        if matter == Some(MaterialClass::Leaf) {
            return Kind::Other(other("it is not flat, expected a blade".into()));
        }
        axis::of(soup, piece).map_or_else(|why| Kind::Other(other(why)), |tube| Kind::Tube(Box::new(tube)))
    };
    let kinds: Vec<Kind> = all.par_iter().enumerate().map(kind).collect();
    let mut found = PlantPieces { degenerate: soup.degenerate, doubled: soup.doubled, ..PlantPieces::default() };
    let (mut tubes, mut of_tubes, mut refused) = (Vec::new(), Vec::new(), Vec::new());
    for (k, kind) in kinds.into_iter().enumerate() {
        match kind {
            Kind::Tube(tube) => {
                tubes.push(*tube);
                of_tubes.push(k);
            }
            Kind::Leaf(leaf) => found.leaves.push(leaf),
            Kind::Other(other) => {
                found.others.push(other);
                // What is known to be a leaf carries nothing.
                if known(soup.material(&all[k])) != Some(MaterialClass::Leaf) {
                    refused.push(all[k].triangles.iter().map(|t| soup.corners(*t)).collect());
                }
            }
        }
    }
    found.doubled += backs::take(soup, &all, &mut found.leaves);
    found.branches = attachment::attach(tubes, refused);
    found.branches.iter_mut().for_each(|branch| branch.piece = of_tubes[branch.piece]);
    leaf::hang(&mut found.leaves, &found.branches);
    found.pieces = all;
    found
}

/// The pieces, where blades that touch each other only in a point, as leaflets at one stalk do, are pieces of their
/// own.
fn unjoined(
    soup: &TriangleSoup,
    pieces: Vec<MeshPiece>,
    known: &(impl Fn(&str) -> Option<MaterialClass> + Sync),
) -> Vec<MeshPiece> {
    let cut = |piece: MeshPiece| {
        if known(soup.material(&piece)) != Some(MaterialClass::Wood) {
            let parts = soup.apart(&piece);
            if parts.len() > 1 && parts.iter().all(|part| leaf::of(soup, part).is_some()) {
                return parts;
            }
        }
        vec![piece]
    };
    pieces.into_par_iter().flat_map_iter(cut).collect()
}
