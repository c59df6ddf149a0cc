//! Sweeps that draw. They have rows only in a build with a renderer.

use crate::cli::Result;
use mesophyll_files::progress::TaskProgress;
use mesophyll_proof::bench::BenchRow;
use mesophyll_proof::{grass, render};

#[cfg(feature = "render")]
use mesophyll_proof::pictures::{far as drawn_far, lawns as drawn_lawns, trees as drawn_trees};

/// Nothing that draws: no steps and no rows.
#[cfg(not(feature = "render"))]
mod nothing {
    pub const PIECES: u64 = 0;
}
#[cfg(not(feature = "render"))]
use nothing as drawn_far;
#[cfg(not(feature = "render"))]
use nothing as drawn_lawns;
#[cfg(not(feature = "render"))]
use nothing as drawn_trees;

/// Steps of the progress bar for light among leaves, lawns and trees.
pub const FOLIAGE: u64 = 1 + drawn_far::PIECES;
pub const LAWNS: u64 = grass::bench::PIECES + drawn_lawns::PIECES;
pub const TREES: u64 = drawn_trees::PIECES;

/// Rays among leaves, and a drawn plant from near to far.
pub fn foliage(bar: &TaskProgress) -> Result<Vec<BenchRow>> {
    #[allow(unused_mut)]
    let mut rows = render::bench::bench_rows()?;
    bar.step()?;
    #[cfg(feature = "render")]
    rows.extend(drawn_far::rows(bar)?);
    Ok(rows)
}

/// Slices beside the blades that they stand for, and drawn lawns.
pub fn lawns(bar: &TaskProgress) -> Result<Vec<BenchRow>> {
    #[allow(unused_mut)]
    let mut rows = grass::bench::rows(bar)?;
    #[cfg(feature = "render")]
    rows.extend(drawn_lawns::rows(bar)?);
    Ok(rows)
}

/// What a tree's motion costs beside drawing it.
#[cfg(feature = "render")]
pub fn trees(bar: &TaskProgress) -> Result<Vec<BenchRow>> {
    drawn_trees::rows(bar)
}

/// No rows, and a message that says why.
#[cfg(not(feature = "render"))]
pub fn trees(_: &TaskProgress) -> Result<Vec<BenchRow>> {
    mesophyll_files::progress::say("this build has no renderer: the rows of moving trees are left out");
    Ok(Vec::new())
}
