//! The whole user interface, drawn without a display and moved by synthetic pointer events.

#[path = "../../../tests/common/mod.rs"]
mod common;

mod bench;
mod display;
mod edits;
mod light;
mod picture;
