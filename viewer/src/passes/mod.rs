//! The render passes, a file each with its WGSL beside it: shadow (only with a sun that casts), sky (only with a dome),
//! transfer (only where the scene has one, and only when its light changes), main, grass (drawn within main, only where
//! there is some), tonemap; motion (only when a caller asks for motion vectors); and what shadow, main and motion share
//! where branches bend.

pub(crate) mod bend;
pub(crate) mod fullscreen;
pub(crate) mod grass;
pub(crate) mod main;
pub(crate) mod motion;
pub(crate) mod shadow;
pub(crate) mod sky;
pub(crate) mod tonemap;
pub(crate) mod transfer;
