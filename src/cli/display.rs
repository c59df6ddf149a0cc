//! What the program asks of the libraries of the display, before it starts any thread.

/// Keeps libwayland from printing "XDG_RUNTIME_DIR is invalid" whenever Mesa's device selection asks it for a display
/// that is not there. A session with a valid folder keeps it. Otherwise the variable names a place that nobody can
/// fill: a temporary folder could hold a stranger's socket.
#[cfg(all(unix, feature = "render"))]
pub(super) fn quiet_libraries() {
    let valid = std::env::var_os("XDG_RUNTIME_DIR").is_some_and(|d| std::path::Path::new(&d).is_absolute());
    if !valid {
        // SAFETY: this is the start of `main`; there is no other thread yet that could read the environment.
        unsafe { std::env::set_var("XDG_RUNTIME_DIR", "/dev/null/no-display") };
    }
}

#[cfg(not(all(unix, feature = "render")))]
pub(super) fn quiet_libraries() {}
