//! A leaf's surface as fits and both renderers use it: its two sides, the defects of its texels, the lobe of
//! its gloss, and the functions of direction for transmitted light. Each name and formula exists once, here. The
//! renderer of `viewer/`, which knows nothing about fitting, uses the same ones.

#![warn(missing_docs)]

pub mod basis;
pub mod defect;
pub mod gloss;
pub mod side;
