//! The data of a planned scene that both renderers draw.

#[cfg(feature = "render")]
pub mod between;
pub mod card;
pub mod detail;
pub mod flat;
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
pub mod scanned;
#[cfg(feature = "render")]
pub mod sections;
pub mod soil;
pub mod sunlit;
#[cfg(feature = "render")]
pub mod true_leaf;
#[cfg(feature = "render")]
pub mod truth;
pub mod tubes;
