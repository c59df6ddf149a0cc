//! Progress with time left on stderr, for anything over a second; silent with `--quiet` and where stderr is no terminal.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

static QUIET: AtomicBool = AtomicBool::new(false);
static STOP: AtomicBool = AtomicBool::new(false);

/// `--quiet`: no bars and no messages from here on.
pub fn set_quiet(quiet: bool) {
    QUIET.store(quiet, Ordering::Relaxed);
}

pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Says something on stderr, unless `--quiet`.
pub fn say(text: impl std::fmt::Display) {
    if !is_quiet() {
        eprintln!("{text}");
    }
}

/// Asks running work to stop at the next safe point (Ctrl-C).
pub fn request_stop() {
    STOP.store(true, Ordering::SeqCst);
}

/// Whether a stop was asked for: long loops look here between pieces of work and return [`crate::Error::Interrupted`].
pub fn stop_requested() -> bool {
    STOP.load(Ordering::SeqCst)
}

/// Whether to go on, between two pieces of work that write nothing.
///
/// # Errors
/// [`crate::Error::Interrupted`] once a stop was asked for.
pub fn go_on() -> crate::Result<()> {
    if stop_requested() { Err(crate::Error::Interrupted("stopped; nothing was printed or written".into())) } else { Ok(()) }
}

/// A bar of `total` steps. Where stderr is no terminal a line is printed at the end only.
#[derive(Debug)]
pub struct Bar(indicatif::ProgressBar);

impl Bar {
    pub fn new(what: &'static str, total: u64) -> Self {
        if is_quiet() || !std::io::stderr().is_terminal() {
            return Bar(indicatif::ProgressBar::hidden());
        }
        let bar = indicatif::ProgressBar::new(total).with_prefix(what);
        if let Ok(style) = indicatif::ProgressStyle::with_template("{prefix:>22} {wide_bar} {percent:>3} %  {eta} left") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(200));
        Bar(bar)
    }

    pub fn advance(&self, steps: u64) {
        self.0.inc(steps);
    }

    /// One step further, unless a stop was asked for.
    ///
    /// # Errors
    /// As [`go_on`].
    pub fn step(&self) -> crate::Result<()> {
        self.advance(1);
        go_on()
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
