//! Standard output. Inside another program, which has an output of its own, what is printed is kept instead.

use std::io::{self, Write};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What was printed since [`keep`].
static KEPT: Mutex<Option<Vec<u8>>> = Mutex::new(None);

fn kept() -> MutexGuard<'static, Option<Vec<u8>>> {
    KEPT.lock().unwrap_or_else(PoisonError::into_inner)
}

/// From now on what is printed is kept, until [`take`].
pub fn keep() {
    *kept() = Some(Vec::new());
}

/// What was printed since [`keep`]. From now on the process's own output is printed to again.
pub fn take() -> Vec<u8> {
    kept().take().unwrap_or_default()
}

/// The place to print to.
#[derive(Debug, Clone, Copy, Default)]
pub struct StandardOutput;

impl Write for StandardOutput {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match kept().as_mut() {
            Some(kept) => kept.write(bytes),
            None => io::stdout().write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        if kept().is_some() { Ok(()) } else { io::stdout().flush() }
    }
}
