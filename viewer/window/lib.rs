//! The window: the renderer's live picture and, beside it, the controls for the user. [`WindowStage`] draws both into a
//! texture, with or without a display, and [`open_window`] shows that texture on screen. An [`editor::Editor`] computes
//! what a change means for the leaf.

#![warn(missing_docs)]

mod app;
pub mod edit;
pub mod editor;
mod stage;
mod ui;

pub use app::{WindowOptions, open_window};
pub use stage::{FrameTasks, WindowStage};
pub use ui::{CheckLayout, ViewerUi, WindowScene, WindowView};
