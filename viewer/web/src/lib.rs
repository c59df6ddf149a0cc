//! The viewer in a browser: a scene as one file ([`bundle`]), and the canvas that draws it.

pub mod bundle;
#[cfg(target_arch = "wasm32")]
mod canvas;
