//! What happens where memory ends: one sentence instead of an abort.

use mesophyll_files::{atomic, memory};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::io::Write;
use std::ptr::null_mut;
use std::sync::atomic::{AtomicBool, AtomicPtr, Ordering};

/// The system's memory. Where there is none left, the program says so and ends with exit code 1; files that were being
/// written are removed.
#[derive(Debug)]
pub struct ReportingAllocator;

// SAFETY: every call goes to the system's allocator with the same arguments, and its answer comes back unchanged.
unsafe impl GlobalAlloc for ReportingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the contract of `GlobalAlloc::alloc`.
        or_end(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        or_end(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as above.
        or_end(unsafe { System.realloc(old, layout, size) }, size)
    }

    unsafe fn dealloc(&self, old: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(old, layout) }
    }
}

fn or_end(place: *mut u8, bytes: usize) -> *mut u8 {
    if place.is_null() {
        end(bytes);
    }
    place
}

/// What is kept for the sentence, so that it finds some memory itself (bytes).
const KEPT: Layout = Layout::new::<[u8; 1 << 20]>();

static KEPT_AT: AtomicPtr<u8> = AtomicPtr::new(null_mut());

/// Keeps some memory for the time when there is none left. Call it before any thread is started.
pub(super) fn prepare() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    if !memory::hint().is_empty() {
        // Each thread would reserve 128 MiB for its own small pieces. Where the limit forbids that, the C library tries
        // it again for each piece, and the program hardly moves.
        // SAFETY: it sets a number of the allocator, before there is any other thread.
        unsafe { libc::mallopt(libc::M_ARENA_MAX, 1) };
    }
    // SAFETY: the layout is not empty.
    KEPT_AT.store(unsafe { System.alloc(KEPT) }, Ordering::SeqCst);
}

/// Says that memory has ended, and ends the program. What it does itself needs next to none.
#[cold]
fn end(bytes: usize) {
    thread_local! {
        static ENDS: Cell<bool> = const { Cell::new(false) };
    }
    static SAID: AtomicBool = AtomicBool::new(false);
    // Where even the sentence finds no memory, the runtime says something shorter.
    if ENDS.replace(true) {
        return;
    }
    // Another thread ends the program just now.
    if SAID.swap(true, Ordering::SeqCst) {
        loop {
            std::thread::park();
        }
    }
    let kept = KEPT_AT.swap(null_mut(), Ordering::SeqCst);
    if !kept.is_null() {
        // SAFETY: it was allocated with this layout, and whoever swaps it out is the only one who has it.
        unsafe { System.dealloc(kept, KEPT) };
    }
    let mut said = std::io::stderr();
    let _ = write!(said, "mesophyll: there is too little memory ({} KiB more were needed)", bytes.div_ceil(1024));
    let _ = writeln!(said, "{}; give the program more, or a smaller input or output", memory::hint());
    atomic::remove_unfinished();
    std::process::exit(1);
}
