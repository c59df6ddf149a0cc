//! Libraries that read files may panic at damaged ones. Here such a panic becomes a value, and nothing is printed.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    /// Whether this thread reads a file that others wrote.
    static READING: Cell<bool> = const { Cell::new(false) };
}

/// Does `work`, which reads a file by the means of a library. `None` where it panics. Nothing is printed if the
/// library panicked. A panic in this project's own code is a defect: its message is still printed.
pub(crate) fn guarded<T>(work: impl FnOnce() -> T) -> Option<T> {
    static QUIETER: Once = Once::new();
    QUIETER.call_once(|| {
        let before = take_hook();
        set_hook(Box::new(move |panic| {
            if !(READING.get() && by_library(panic)) {
                before(panic);
            }
        }));
    });
    let outer = READING.replace(true);
    let made = catch_unwind(AssertUnwindSafe(work)).ok();
    READING.set(outer);
    made
}

/// Whether a panic arose outside this project. Cargo names the files of a workspace by relative paths, and those of
/// libraries by absolute ones.
fn by_library(panic: &PanicHookInfo) -> bool {
    panic.location().is_some_and(|at| std::path::Path::new(at.file()).is_absolute())
}
