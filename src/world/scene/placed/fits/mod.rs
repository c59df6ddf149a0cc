//! The fit folders that a scene's leaves come from: they are found and opened, and made where they are missing.

pub mod maker;
pub mod reader;
pub mod source;
pub mod translucency;
