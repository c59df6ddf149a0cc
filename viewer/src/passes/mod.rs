//! The render passes. Each has a file, with its WGSL in a file beside it: shadow (only with a sun that casts shadows),
//! sky (only with a dome), backdrop (only with an environment map behind the scene), transfer (only where the scene has
//! one, and only when its light changes), main, grass (drawn within main, only in scenes with grass), bloom (only in
//! scenes that have it), tonemap, and motion (only when a caller asks for motion vectors). `bend` is shared by shadow,
//! main and motion where branches bend; `pose` bends them on the adapter, and `fit` fits shadow maps to what moves.
//! `reach` knows how far that may move.

pub(crate) mod backdrop;
pub(crate) mod bend;
pub(crate) mod bloom;
pub(crate) mod bounds;
pub(crate) mod choose;
pub(crate) mod disk;
pub(crate) mod fit;
pub(crate) mod fullscreen;
pub(crate) mod grass;
pub(crate) mod harmonics;
pub(crate) mod main;
pub(crate) mod motion;
pub(crate) mod outline;
pub(crate) mod place;
pub(crate) mod pose;
pub(crate) mod shadow;
pub(crate) mod sky;
pub(crate) mod tonemap;
pub(crate) mod transfer;
