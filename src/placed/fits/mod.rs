//! The fit folders that a scene's leaves come from: found, opened, and made where they are missing.

pub mod missing;
pub mod reads;
pub mod source;
pub mod translucency;
