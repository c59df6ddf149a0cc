//! The search for readings, with its progress. Thousands of places take minutes.

use crate::Result;
use mesophyll_base::selection::{DesignChoice, DesignProblem};
use mesophyll_files::progress::{TaskProgress, go_on, stop_requested};

/// The best `count` readings, those that are taken already among them; `None` as [`DesignProblem::choose`].
///
/// # Errors
/// A stop that was asked for.
pub fn choose(problem: &DesignProblem, count: usize) -> Result<Option<DesignChoice>> {
    let bar = TaskProgress::of(format!("choosing among {} readings", problem.candidates()));
    watched(&bar, |watch| problem.choose_watched(count, watch))
}

/// The ratio of errors that no set of `count` readings can fall below.
///
/// # Errors
/// A stop that was asked for.
pub fn best_possible(problem: &DesignProblem, count: usize) -> Result<Option<f64>> {
    let bar = TaskProgress::of("what no choice can beat");
    watched(&bar, |watch| problem.best_possible_watched(count, watch))
}

fn watched<T>(bar: &TaskProgress, work: impl FnOnce(&dyn Fn(usize, usize) -> bool) -> T) -> Result<T> {
    let found = work(&|done, of| {
        bar.set_total(of as u64);
        bar.advance(u64::from(done > 0));
        !stop_requested()
    });
    go_on()?;
    Ok(found)
}
