//! Tests of the whole user interface. It is drawn without a display, and synthetic pointer events operate it.

#[path = "../../../tests/drawing/common/mod.rs"]
mod common;

mod bench;
mod display;
mod edits;
mod hands;
mod light;
mod numbers;
mod picture;
