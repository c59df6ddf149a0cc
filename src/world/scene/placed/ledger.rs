//! A record of what was done: every fit, file read, curve and upload, with its bytes and time. With it, the plan's
//! promises can be counted.

use std::sync::Mutex;
use std::time::Instant;

/// One action.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct LedgerEntry {
    /// Kind of the action: `fit`, `read`, `look for faults`, `curve`, `solve`, …
    pub action: &'static str,
    /// Its object, for example `elm/front.exr`.
    pub what: String,
    /// Bytes that were read or made; 0 for other actions.
    pub bytes: u64,
    /// Time that it took (ms).
    pub ms: f64,
}

/// A list of actions, which all workers share.
#[derive(Debug, Default)]
pub struct Ledger(Mutex<Vec<LedgerEntry>>);

impl Ledger {
    /// An empty list.
    pub fn new() -> Ledger {
        Ledger::default()
    }

    /// Runs `body`, measures its time, and notes it.
    pub fn note<T>(&self, action: &'static str, what: impl Into<String>, bytes: u64, body: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let out = body();
        let entry = LedgerEntry { action, what: what.into(), bytes, ms: start.elapsed().as_secs_f64() * 1e3 };
        if let Ok(mut list) = self.0.lock() {
            list.push(entry);
        }
        out
    }

    /// A copy of the list, in the order in which actions were finished.
    pub fn entries(&self) -> Vec<LedgerEntry> {
        self.0.lock().map(|l| l.clone()).unwrap_or_default()
    }

    /// How often `action` was done to an object whose name ends in `suffix`.
    pub fn count(&self, action: &str, suffix: &str) -> usize {
        self.entries().iter().filter(|e| e.action == action && e.what.ends_with(suffix)).count()
    }
}
