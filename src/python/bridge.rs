//! Between Python and the rooms: arrays, errors, interruptions and panics.

use mesophyll_error::{Error, Result, Status};
use mesophyll_files::progress;
use pyo3::buffer::PyBuffer;
use pyo3::exceptions::{PyFileNotFoundError, PyKeyboardInterrupt, PyOSError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use rayon::prelude::*;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::mpsc;
use std::time::Duration;

/// An array of double-precision numbers.
pub type Numbers = PyBuffer<f64>;

/// Rows that did not end well: which one, counted from 0, and its status.
pub type Troubles = Vec<(usize, String)>;

/// Fewer rows than this are computed before a thread could be made for them.
const FEW: usize = 256;
/// Rows that a thread takes at a time.
const CHUNK: usize = 512;
/// How often Python is asked whether Ctrl-C was pressed.
const ASK: Duration = Duration::from_millis(50);

/// The Python exception for one of our errors.
pub fn raise(error: Error) -> PyErr {
    let sentence = error.to_string();
    match error {
        Error::Write { .. } | Error::BrokenPipe => PyOSError::new_err(sentence),
        Error::Interrupted(_) => PyKeyboardInterrupt::new_err(sentence),
        Error::Missed(_) => PyRuntimeError::new_err(sentence),
        // What stands for a file that there is not, such as a device given as a dictionary, is in angle brackets.
        Error::Input { ref file, .. } if !file.starts_with('<') && !Path::new(file).exists() => {
            PyFileNotFoundError::new_err(sentence)
        }
        _ => PyValueError::new_err(sentence),
    }
}

/// What a name of `T` stands for.
pub fn named<T>(argument: &str, name: &str) -> PyResult<T>
where
    T: strum::IntoEnumIterator + Into<&'static str> + std::str::FromStr,
{
    name.parse().map_err(|_| {
        let names: Vec<&'static str> = T::iter().map(Into::into).collect();
        PyValueError::new_err(format!("{argument}: found {name:?}, expected one of {}", names.join(", ")))
    })
}

fn panicked(panic: Box<dyn Any + Send>) -> PyErr {
    let words = panic.downcast_ref::<&str>().map(|s| s.to_string()).or_else(|| panic.downcast_ref::<String>().cloned());
    let words = words.unwrap_or_else(|| "no message".into());
    PyRuntimeError::new_err(format!("an internal error of mesophyll, which is worth a report: {words}"))
}

/// Does `work` without Python's lock. A panic becomes a `RuntimeError`. `long` work is done on a thread of its own, so
/// that Ctrl-C stops it.
pub fn run<T: Send>(py: Python<'_>, long: bool, work: impl FnOnce() -> Result<T> + Send) -> PyResult<T> {
    let ended = |made: std::thread::Result<Result<T>>| made.map_err(panicked)?.map_err(raise);
    let work = move || catch_unwind(AssertUnwindSafe(work));
    if !long {
        return ended(py.detach(work));
    }
    progress::go_on_again();
    py.detach(|| {
        std::thread::scope(|scope| {
            let (done, wait) = mpsc::channel();
            scope.spawn(move || {
                // The other end waits until this thread ends.
                let _ = done.send(work());
            });
            let mut stopped = None;
            loop {
                match wait.recv_timeout(ASK) {
                    Ok(made) => return stopped.map_or_else(|| ended(made), Err),
                    Err(mpsc::RecvTimeoutError::Timeout) => {
                        if let Err(signal) = Python::attach(|py| py.check_signals()) {
                            progress::request_stop();
                            stopped = Some(signal);
                        }
                    }
                    Err(mpsc::RecvTimeoutError::Disconnected) => return Err(panicked(Box::new("a thread ended"))),
                }
            }
        })
    })
}

/// Computes `rows` rows on all cores. `f` fills the cells of a row; `out` gets them in row order, its shape is
/// (rows, cells of a row).
///
/// # Errors
/// `ValueError` where `out` has another size.
pub fn fill<F>(py: Python<'_>, rows: usize, out: &Numbers, f: F) -> PyResult<Troubles>
where
    F: Fn(usize, &mut [f64]) -> Status + Sync + Send,
{
    let cells = out.item_count().checked_div(rows).unwrap_or(0);
    if out.item_count() != rows * cells {
        return Err(PyValueError::new_err(format!(
            "the output has {} numbers; expected {cells} for each of {rows} rows",
            out.item_count()
        )));
    }
    if rows == 0 || cells == 0 {
        return Ok(Vec::new());
    }
    let part = |first: usize, values: &mut [f64]| -> Troubles {
        let mut troubles = Vec::new();
        for (k, row) in values.chunks_exact_mut(cells).enumerate() {
            if progress::stop_requested() {
                break;
            }
            let status = f(first + k, row);
            if matches!(status, Status::Refused(_)) {
                row.fill(f64::NAN);
            }
            if !status.is_ok() {
                troubles.push((first + k, status.to_string()));
            }
        }
        troubles
    };
    let (values, troubles) = run(py, rows >= FEW, || {
        let mut values = vec![f64::NAN; rows * cells];
        let troubles: Vec<Troubles> = if rows < FEW {
            vec![part(0, &mut values)]
        } else {
            let chunks = values.par_chunks_mut(CHUNK * cells).enumerate();
            chunks.map(|(k, chunk)| part(k * CHUNK, chunk)).collect()
        };
        Ok((values, troubles.concat()))
    })?;
    out.copy_from_slice(py, &values)?;
    Ok(troubles)
}

/// The numbers of arrays that must be of one length.
///
/// # Errors
/// `ValueError` where they are not.
pub fn columns<const N: usize>(py: Python<'_>, arrays: [&Numbers; N]) -> PyResult<([Vec<f64>; N], usize)> {
    let rows = arrays.first().map_or(0, |a| a.item_count());
    let mut read: [Vec<f64>; N] = [const { Vec::new() }; N];
    for (to, from) in read.iter_mut().zip(arrays) {
        if from.item_count() != rows {
            return Err(PyValueError::new_err(format!("arrays of {rows} and of {} numbers", from.item_count())));
        }
        *to = from.to_vec(py)?;
    }
    Ok((read, rows))
}

/// Copies the values of an answer into a row.
pub fn answered(answer: mesophyll_files::table::Answer, row: &mut [f64]) -> Status {
    for (to, from) in row.iter_mut().zip(&answer.values) {
        *to = *from;
    }
    answer.status
}
