//! What a window shows when it opens.

use mesophyll_viewer::scene::{Camera, Scene};
use std::path::PathBuf;

/// The content with which a window opens.
#[derive(Debug, Clone)]
pub struct WindowScene {
    /// Title of the window.
    pub title: String,
    /// The scene that is drawn.
    pub scene: Scene,
    /// The camera with which the window starts.
    pub camera: Camera,
    /// Views, each of which has a button.
    pub views: Vec<WindowView>,
    /// Size of the pictures that are checked. The live picture shows at least everything that such a picture shows.
    pub check_size: [u32; 2],
    /// Folder of the screenshots.
    pub screenshots: PathBuf,
}

/// One of the scene's views, as a button.
#[derive(Debug, Clone)]
pub struct WindowView {
    /// Text of its button.
    pub name: String,
    /// The camera of the view.
    pub camera: Camera,
    /// Time at which the scene is seen (s). With `None` the wind's time stays unchanged.
    pub time_s: Option<f64>,
}
