//! The window: the renderer's live picture, and beside it what a user can change. [`Stage`] draws both into a texture,
//! with or without a display; [`open_window`] shows that texture on screen. What a change means for the leaf is asked
//! of an [`editor::Editor`].

#![warn(missing_docs)]

mod app;
pub mod editor;
mod stage;
mod ui;

pub use app::{WindowOptions, open_window};
pub use stage::{Shown, Stage};
pub use ui::{CheckLayout, ViewerUi, WindowScene, WindowView};
