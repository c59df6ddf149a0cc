//! Sharp sunlight among leaves: the share of a small light's disk that each vertex of a scene sees, computed beforehand
//! for many directions of the light (light-visibility convolution: Wang et al. 2005, §4, Eq. 10–11, Fig. 5).
//!
//! [`ShadowReceivers`] are the points: the vertices of every instance's blade, which may be finer than the drawn mesh.
//! [`AreaLight`] is the light: the sun's true disk, or any other small shape. [`ShadowScene`] computes the map of a
//! direction: a byte for each receiver, 255 where all of the light is visible. Light from below counts like light from
//! above (the source keeps the upper hemisphere only). Leaves transmit light, and a blade does not hide light from its
//! own points, whichever side is lit.
//!
//! [`CodedMaps`] stores the maps of all [`ShadowDirections`] in few bytes. These are the directions of a cube map, of a
//! day's path, or a single one. Each map can be decoded by itself. A light between directions gets a mixture of the
//! maps around it.
//!
//! A map does not contain the cosine, because only the renderer knows the shading normal.

mod casters;
mod compression;
pub(crate) mod directions;
mod entropy;
mod grid;
pub(crate) mod light;
mod maps;
mod receivers;
mod refinement;
pub mod runs;
#[cfg(test)]
mod tests;

pub use compression::{CodedMaps, MapCollector};
pub use directions::{MapBlend, ShadowDirections};
pub use light::{AreaLight, MOST_POINTS};
pub use maps::ShadowScene;
pub use receivers::{MOST_RECEIVERS, ShadowReceiver, ShadowReceivers, VertexPlace};
pub use refinement::VisibilityMesh;
