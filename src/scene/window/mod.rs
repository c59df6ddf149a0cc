//! The library's part of the window: edits of a leaf, and saving edited leaves as new fits.

pub mod edit;
