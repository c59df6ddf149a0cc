//! The data of a planned scene that both renderers draw.

pub mod bands;
#[cfg(all(test, feature = "render"))]
mod both_tests;
pub mod card;
pub mod detail;
#[cfg(feature = "render")]
pub mod far_wood;
pub mod flat_blade;
mod floor;
pub mod grass;
#[cfg(feature = "render")]
pub mod handover;
#[cfg(feature = "render")]
pub mod leaf_maps;
pub mod polygon;
#[cfg(feature = "render")]
pub mod poses;
pub mod reference;
#[cfg(feature = "render")]
pub mod scan;
#[cfg(feature = "render")]
pub mod scene_reference;
#[cfg(feature = "render")]
mod sections;
pub mod soil;
pub(crate) mod stands;
pub mod sunlight;
#[cfg(feature = "render")]
pub mod transfer;
#[cfg(feature = "render")]
pub mod true_leaf;
pub mod tubes;
