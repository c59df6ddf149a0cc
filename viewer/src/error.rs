//! What can go wrong while drawing, each with one sentence that says what was found and what was expected.

/// Errors of the renderer and its window.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Nothing on this machine can draw: no GPU driver and no software adapter either.
    #[error(
        "no graphics adapter was found: nothing here can draw pictures; install a GPU driver or Mesa's software one \
         (on Debian: apt-get install mesa-vulkan-drivers libvulkan1)"
    )]
    NoAdapter,
    #[error("adapter {adapter} gave no device: {reason}")]
    Device { adapter: String, reason: String },
    /// The scene data contradict themselves.
    #[error("scene, {place}: found {found}, expected {expected}")]
    Scene { place: String, found: String, expected: String },
    /// A picture or texture larger than the adapter takes, or empty.
    #[error("{what} of {width}x{height}: expected both sides from 1 to {limit} on this adapter")]
    Size { what: String, width: u32, height: u32, limit: u32 },
    #[error("reading the picture back from the adapter failed: {0}")]
    Readback(String),
    #[error("the window could not be opened: {0}")]
    Window(String),
    #[error("{path}: could not write the picture: {reason}")]
    Write { path: String, reason: String },
}

/// Result of the renderer.
pub type Result<T> = std::result::Result<T, Error>;
