//! The render passes, a file each with its WGSL beside it: shadow (only with a sun that casts), main, tonemap; and
//! what the first two share where branches bend.

pub(crate) mod bend;
pub(crate) mod main;
pub(crate) mod shadow;
pub(crate) mod tonemap;
