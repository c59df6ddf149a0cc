//! Scene manifests, the plan of what a scene needs, and the hand-over to the renderer.

pub mod accuracy;
pub mod branch;
pub mod card;
#[cfg(feature = "render")]
pub mod check;
pub mod consistency;
#[cfg(feature = "render")]
pub mod day;
pub mod daylight;
pub mod detail;
pub mod display;
#[cfg(feature = "render")]
pub mod edit;
pub mod facing;
pub mod fitted;
pub mod gloss_bound;
#[cfg(feature = "render")]
pub mod golden;
#[cfg(feature = "render")]
pub mod handover;
#[cfg(feature = "render")]
pub mod interiors;
pub mod ledger;
pub mod manifest;
pub mod missing_fits;
pub mod placement;
pub mod plan;
mod plan_branch;
mod plan_gloss;
mod plan_leaf;
mod plan_light;
mod plan_mesh;
pub mod reference;
#[cfg(feature = "render")]
pub mod save;
#[cfg(feature = "render")]
mod scanned;
pub mod source;
pub mod sunlit;
mod texel_frame;
pub mod translucency;
pub mod tree;
#[cfg(feature = "render")]
mod true_leaf;
mod validate;

pub(crate) use mesophyll_error::{Error, Result};
