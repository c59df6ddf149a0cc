//! Sharp sunlight among leaves: which share of a small light's disk every vertex of a scene sees, for many directions
//! of the light, computed beforehand (light-visibility convolution: Wang et al. 2005, §4, Eq. 10–11, Fig. 5).
//!
//! [`Receivers`] are the points: vertices of every instance's blade, which may be finer than the drawn mesh.
//! [`AreaLight`] is the light: the sun's true disk, or any other small shape. [`Shadows`] computes the map of a
//! direction: a byte a receiver, 255 where all of the light is seen. Light from below counts as light from above does
//! (the source keeps the upper hemisphere only): a leaf lets light through, and whichever side is lit, the blade does
//! not hide itself at the point itself.
//!
//! [`CodedMaps`] keeps the maps of all [`Directions`] in few bytes: those of a cube map, of a day's path, or of one
//! direction. Any one is decoded by itself, and a light between directions gets the maps around it, mixed.
//!
//! The cosine is not in a map: it is the renderer's, where the shading normal is known.

mod cast;
mod coded;
pub(crate) mod directions;
mod entropy;
mod grid;
pub(crate) mod light;
mod maps;
mod receivers;
mod refine;
pub mod runs;
#[cfg(test)]
mod tests;

pub use coded::{CodedMaps, Collector};
pub use directions::{Blend, Directions};
pub use light::{AreaLight, MOST_POINTS};
pub use maps::Shadows;
pub use receivers::{MOST_RECEIVERS, Place, Receiver, Receivers};
pub use refine::Blade;
