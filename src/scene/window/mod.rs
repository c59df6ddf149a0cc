//! What the window asks of the library: edits of a leaf, and edited leaves as new fits.

pub mod edit;
