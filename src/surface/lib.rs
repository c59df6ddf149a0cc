//! A leaf's surface as fits and both renderers speak of it: its two sides, the lobe of its gloss, and the functions of
//! direction that light comes through by. Each name and formula stands here once; the renderer of `viewer/`, which
//! knows nothing of fitting, uses the same ones.

#![warn(missing_docs)]

pub mod basis;
pub mod gloss;
pub mod side;
