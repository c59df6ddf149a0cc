//! A fitted leaf: its record, the maps of its sides, and its blade. All code that reads or writes the folder of a leaf
//! fit uses this room.
//!
//! A folder holds `fit.toml`, for each side that was measured `front.exr` (its maps) and `front_err.exr` (their
//! standard errors), and `blade.glb`, the blade as a mesh. Lengths are in mm, σa and σs in 1/mm. Maps are row-major as
//! the side's own camera saw them, so that the columns of the back run the other way ([`mesophyll_optics::side`]).

#![warn(missing_docs)]

pub mod edit;
pub mod filling;
mod folder;
pub mod frames;
pub mod other_side;
pub mod packing;
pub mod previews;
pub mod reflecting;

pub use folder::{BLADE, LeafFit, LeafFitFile};

pub(crate) use mesophyll_base::error::{Error, Result};
