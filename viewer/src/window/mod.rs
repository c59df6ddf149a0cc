//! The window: `Stage` draws the user interface into a texture, with or without a display; `app` shows that texture on
//! screen.

mod app;
mod stage;

pub use app::{WindowOptions, open_window};
pub use stage::{Shown, Stage};
