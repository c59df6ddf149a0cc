//! The verbs of the command line, inside Python.

use crate::bridge::run_until;
use mesophyll::cli::{VerbAnswer, answer};
use mesophyll::report;
use mesophyll_base::error::Error;
use mesophyll_files::progress;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// How many verbs are under way or wait. They share one request to stop, so Ctrl-C stops those of other threads too.
static UNDER_WAY: Mutex<usize> = Mutex::new(0);

/// A verb under way. The last one that ends takes back the request to stop, which by then all of them have seen.
struct UnderWay;

impl UnderWay {
    fn begin() -> UnderWay {
        *UNDER_WAY.lock().unwrap_or_else(PoisonError::into_inner) += 1;
        UnderWay
    }
}

impl Drop for UnderWay {
    fn drop(&mut self) {
        let mut count = UNDER_WAY.lock().unwrap_or_else(PoisonError::into_inner);
        *count -= 1;
        if *count == 0 {
            progress::go_on_again();
        }
    }
}

/// Whether an error says that the fit in `folder` was written and is not good. Then its quality says so.
fn only_missed(error: &Error, folder: &Path) -> bool {
    let verdict = |folder| report::verdict(folder).ok().filter(|v| v.missed);
    let said = verdict(folder).map(|v| Error::Missed(format!("{}: {}", folder.display(), v.sentence)));
    said.is_some_and(|said| said == *error)
}

/// What a verb answered: its exit code (0 or 1), what it printed, what it said, and why it missed its mark, if so.
type Answered<'py> = (u8, Bound<'py, PyBytes>, Vec<String>, Option<String>);

/// What the command line does with these words. `folder` is that of the fit that the verb writes, if any: a fit that
/// was written and is not good is no miss, because its quality says so. With `loud`, lines of progress go to standard
/// error.
#[pyfunction]
pub fn command(py: Python<'_>, words: Vec<String>, folder: Option<PathBuf>, loud: bool) -> PyResult<Answered<'_>> {
    let _under_way = UnderWay::begin();
    let (code, printed, said, missed) = run_until(py, true, progress::request_stop, || {
        progress::set_quiet(!loud);
        let VerbAnswer { outcome, printed, said } = answer(&words);
        progress::set_quiet(true);
        match outcome {
            Ok(code) => Ok((code, printed, said, None)),
            Err(error) if folder.is_some_and(|folder| only_missed(&error, &folder)) => Ok((1, printed, said, None)),
            Err(Error::Missed(why)) => Ok((1, printed, said, Some(Error::Missed(why).to_string()))),
            Err(error) => Err(error),
        }
    })?;
    Ok((code, PyBytes::new(py, &printed), said, missed))
}
