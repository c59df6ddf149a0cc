//! Readings that were left out, so that a bad one costs itself and no other.

use super::counted;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// What was left out: each with its line in the file and the reason.
#[derive(Debug, Default)]
pub struct Omissions(Mutex<Vec<(usize, String)>>);

/// This many are named in a message; the others are counted.
const NAMED: usize = 5;

impl Omissions {
    /// Leaves out a reading of this line.
    pub fn add(&self, line: usize, why: impl Into<String>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push((line, why.into()));
    }

    /// How many were left out.
    pub fn count(&self) -> usize {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).len()
    }

    /// The first ones by their lines, and how many more there are: `line 5: R is "x"; expected a number; and 2 more`.
    pub fn words(&self) -> String {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        all.sort();
        // Several readings of a line may have one reason.
        all.dedup();
        listed(all.iter().map(|(line, why)| format!("line {line}: {why}")))
    }

    /// Says on standard error what was left out of the table `name`, if anything.
    pub fn say(&self, name: &Path) {
        if self.count() > 0 {
            let readings = counted(self.count(), "reading");
            crate::progress::say(format!("{}: {readings} left out: {}", name.display(), self.words()));
        }
    }
}

/// The first of several sentences, and how many more there are.
pub(super) fn listed(all: impl ExactSizeIterator<Item = String>) -> String {
    let more = all.len().saturating_sub(NAMED);
    let mut list: Vec<String> = all.take(NAMED).collect();
    if more > 0 {
        list.push(format!("and {more} more"));
    }
    list.join("; ")
}
