//! Finds the branches of a plant that consists of triangles only, as other programs write it. The steps are connected
//! pieces ([`soup`]), the axis of each ([`axis`]), the pieces that are blades ([`leaf`]), and which branch grows on
//! which ([`attach`]).
//!
//! A branch is one connected tube. A branch that cannot be attached is listed with a reason. Lengths are in mm, in the
//! frame of the file that was read (y up, as in glTF).

mod arms;
pub mod attach;
pub mod axis;
pub mod flat;
pub mod leaf;
mod refused;
pub mod soup;
pub mod table;
#[cfg(test)]
mod tests;

use crate::{Error, Result};
use axis::Tube;
use glam::DVec3;
use mesophyll_files::unit::Unit;
use rayon::prelude::*;
use soup::Soup;
use std::path::Path;

/// The parts of a plant that were found.
#[derive(Debug, Clone, Default)]
pub struct Found {
    /// The branches. Parents stand before what grows on them, and branches that cannot be attached stand last.
    pub branches: Vec<Branch>,
    /// The blades, and the branches that they hang on.
    pub leaves: Vec<Leaf>,
    /// Pieces that are neither a tube nor a blade, with a reason.
    pub others: Vec<Other>,
    /// Triangles without an area, which were left out.
    pub degenerate: usize,
}

/// A branch that was found.
#[derive(Debug, Clone)]
pub struct Branch {
    /// Its axis and radii.
    pub tube: Tube,
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
pub struct Leaf {
    /// Its middle (mm).
    pub centre: DVec3,
    /// Unit normal of its plane. A flat piece does not tell which of its two sides is the front.
    pub normal: DVec3,
    /// Length and width (mm).
    pub size: [f64; 2],
    /// Area of one side (mm²).
    pub area: f64,
    /// The two ends of its longest extent (mm).
    pub ends: [DVec3; 2],
    /// The branch that it hangs on, and the share of its axis; `None` where no branch is near.
    pub joint: Option<(usize, f64)>,
    /// Distance from the blade's edge to the branch's surface (mm).
    pub gap: f64,
}

/// A piece that is neither a tube nor a blade.
#[derive(Debug, Clone)]
pub struct Other {
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
pub fn import(path: &Path, unit: Option<Unit>) -> Result<Found> {
    let soup = soup::read(path, unit)?;
    let found = find(&soup);
    if found.branches.is_empty() {
        let what = format!(
            "found no branch among {} flat pieces and {} others, expected at least one tube",
            found.leaves.len(),
            found.others.len()
        );
        return Err(Error::input(path, what));
    }
    Ok(found)
}

enum Piece {
    Tube(Box<Tube>),
    Leaf(Leaf),
    Other(Other),
}

/// Finds the branches of a soup.
pub fn find(soup: &Soup) -> Found {
    let all = soup.pieces();
    let pieces: Vec<Piece> = all
        .par_iter()
        .map(|piece| {
            if let Some(leaf) = leaf::of(soup, piece) {
                return Piece::Leaf(leaf);
            }
            match axis::of(soup, piece) {
                Ok(tube) => Piece::Tube(Box::new(tube)),
                Err(why) => Piece::Other(Other { centre: soup.centre(piece), triangles: piece.triangles.len(), why }),
            }
        })
        .collect();
    let mut found = Found { degenerate: soup.degenerate, ..Found::default() };
    let (mut tubes, mut refused) = (Vec::new(), Vec::new());
    for (piece, own) in pieces.into_iter().zip(&all) {
        match piece {
            Piece::Tube(tube) => tubes.push(*tube),
            Piece::Leaf(leaf) => found.leaves.push(leaf),
            Piece::Other(other) => {
                found.others.push(other);
                refused.push(own.triangles.iter().map(|t| soup.corners(*t)).collect());
            }
        }
    }
    found.branches = attach::attach(tubes, refused);
    leaf::hang(&mut found.leaves, &found.branches);
    found
}
