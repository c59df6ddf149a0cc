//! The library's part of the window: edits of leaves and of branches, and saving what was edited as new fits and
//! plants.

pub mod backdrop;
pub mod edit;
mod plants;
