//! Finds the branches of a plant that is nothing but triangles, such as other programs write: connected pieces
//! ([`soup`]), the axis of each ([`axis`]), which piece is a blade ([`leaf`]) and what grows on what ([`attach`]).
//!
//! A branch is one connected tube. What cannot be attached is listed with a reason. Lengths are in mm, in the frame of
//! the file that was read (y up, as glTF has it).

pub mod attach;
pub mod axis;
pub mod leaf;
pub mod soup;
pub mod table;
#[cfg(test)]
mod tests;

use crate::{Error, Result};
use axis::Tube;
use glam::DVec3;
use mesophyll_files::mesh::Unit;
use rayon::prelude::*;
use soup::Soup;
use std::path::Path;

/// What a plant consists of.
#[derive(Debug, Clone, Default)]
pub struct Found {
    /// Parents stand before what grows on them; what cannot be attached stands last.
    pub branches: Vec<Branch>,
    /// Blades, and what they hang on.
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
    /// 0 is a trunk; of a branch that is not attached, nothing is known.
    pub level: Option<usize>,
    /// How sure its parent is, from 0 to 1.
    pub confidence: f64,
    /// Why it is not attached; nothing where it is, and for a trunk.
    pub unattached: Option<String>,
}

/// A blade that was found.
#[derive(Debug, Clone)]
pub struct Leaf {
    /// Its middle (mm).
    pub centre: DVec3,
    /// Across its plane; which of the two sides is the front, a flat piece does not say.
    pub normal: DVec3,
    /// Length and width (mm).
    pub size: [f64; 2],
    /// Area of one side (mm²).
    pub area: f64,
    /// The two ends of its longest extent (mm).
    pub ends: [DVec3; 2],
    /// The branch it hangs on, and the share of its axis; nothing where none is near.
    pub joint: Option<(usize, f64)>,
    /// From the blade's edge to the branch's surface (mm).
    pub gap: f64,
}

/// A piece that is neither a tube nor a blade.
#[derive(Debug, Clone)]
pub struct Other {
    /// Its middle (mm).
    pub centre: DVec3,
    /// Its triangles.
    pub triangles: usize,
    /// What is wrong with it.
    pub why: String,
}

/// Reads `path`, whose lengths are in `unit` (where none is given, in the file's own), and finds its branches.
///
/// # Errors
/// [`Error::Input`] in one sentence, as [`soup::read`]; a file in which no piece is a tube.
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
    let pieces: Vec<Piece> = soup
        .pieces()
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
    let mut tubes = Vec::new();
    for piece in pieces {
        match piece {
            Piece::Tube(tube) => tubes.push(*tube),
            Piece::Leaf(leaf) => found.leaves.push(leaf),
            Piece::Other(other) => found.others.push(other),
        }
    }
    found.branches = attach::attach(tubes);
    leaf::hang(&mut found.leaves, &found.branches);
    found
}
