//! The errors of drawing. Each is one sentence that says what was found and what was expected.

/// Errors of the renderer and its window.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Nothing on this machine can draw: no GPU driver and no software adapter either.
    #[error(
        "no graphics adapter was found: nothing here can draw pictures; install a GPU driver or Mesa's software one \
         (on Debian: apt-get install mesa-vulkan-drivers libvulkan1)"
    )]
    NoAdapter,
    /// The adapter gave no device, ran out of memory or refused a shader.
    #[error("adapter {adapter} refused: {reason}")]
    Device {
        /// Name of the adapter.
        adapter: String,
        /// The reason that it gave.
        reason: String,
    },
    /// The scene data contradict themselves.
    #[error("scene, {place}: found {found}, expected {expected}")]
    Scene {
        /// The part of the scene.
        place: String,
        /// The value found there.
        found: String,
        /// What would be right.
        expected: String,
    },
    /// A picture or texture larger than the adapter takes, or empty.
    #[error("{what} of {width}x{height}: expected both sides from 1 to {limit} on this adapter")]
    Size {
        /// What should be made.
        what: String,
        /// Pixels or texels across.
        width: u32,
        /// Pixels or texels down.
        height: u32,
        /// The largest size that the adapter takes.
        limit: u32,
    },
    /// What was drawn cannot be read back.
    #[error("reading the picture back from the adapter failed: {0}")]
    Readback(String),
    /// The desktop gives no window.
    #[error("the window could not be opened: {0}")]
    Window(String),
    /// The disk.
    #[error("{path}: could not write the picture: {reason}")]
    Write {
        /// Path of the file.
        path: String,
        /// The reason that the system gave.
        reason: String,
    },
}

/// Result of the renderer.
pub type Result<T> = std::result::Result<T, Error>;
