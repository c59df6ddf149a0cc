//! The render passes, a file each with its WGSL beside it: shadow (only with a sun that casts), sky (only with a dome), main, tonemap.

pub(crate) mod main;
pub(crate) mod shadow;
pub(crate) mod sky;
pub(crate) mod tonemap;
