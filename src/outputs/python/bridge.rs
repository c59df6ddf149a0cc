//! Between Python and the rooms: arrays, errors, interruptions and panics.

use mesophyll_base::error::{Error, Result, Status};
use pyo3::buffer::PyBuffer;
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError};
use pyo3::prelude::*;
use rayon::prelude::*;
use std::any::Any;
use std::fs::File;
use std::io::ErrorKind;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Duration;

/// An array of double-precision numbers.
pub type NumberBuffer = PyBuffer<f64>;

/// Rows that did not end well: which one, counted from 0, and its status.
pub type RowTroubles = Vec<(usize, String)>;

/// What a row takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RowCost {
    /// Microseconds: a few rows are done before a thread could be made for them.
    Little,
    /// So long that even one row is worth a thread, and Ctrl-C.
    Much,
}

/// Rows of [`Cost::Little`] that are computed at once, without another thread.
const FEW: usize = 256;
/// Most rows that a thread takes at a time.
const CHUNK: usize = 512;
/// How often Python is asked whether Ctrl-C was pressed.
const ASK: Duration = Duration::from_millis(50);

/// Whether Ctrl-C was pressed during one call. Every call has its own, so that it stops no other one.
#[derive(Debug, Default)]
pub struct CallInterrupt(AtomicBool);

impl CallInterrupt {
    fn ask(&self) {
        self.0.store(true, Ordering::SeqCst);
    }

    /// Whether to stop.
    pub fn asked(&self) -> bool {
        self.0.load(Ordering::SeqCst)
    }
}

/// An exception of the class of this name in `mesophyll/_errors.py`, which all are of one type.
fn exception(class: &str, sentence: String, parts: &[(&str, Option<String>)]) -> PyErr {
    let made = Python::attach(|py| {
        let made = py.import("mesophyll._errors")?.getattr(class)?.call1((sentence,))?;
        for (name, value) in parts {
            made.setattr(*name, value.as_deref())?;
        }
        PyResult::Ok(PyErr::from_value(made))
    });
    made.unwrap_or_else(|e| e)
}

/// The exception for an argument that cannot be used.
pub fn refuse(sentence: impl Into<String>) -> PyErr {
    exception("InputError", sentence.into(), &[])
}

/// The exception for one of our errors.
pub fn raise(error: Error) -> PyErr {
    let sentence = error.to_string();
    match error {
        Error::Write { .. } | Error::BrokenPipe => exception("FileError", sentence, &[]),
        Error::Interrupted(_) => PyKeyboardInterrupt::new_err(sentence),
        Error::Missed(_) => exception("FitError", sentence, &[]),
        Error::Input { file, line, field, .. } => {
            // What stands for a file that there is not, such as a device given as a dictionary, is in angle brackets.
            let class = match File::open(&file).map_err(|e| e.kind()) {
                _ if file.starts_with('<') => "InputError",
                Ok(_) => "InputError",
                Err(ErrorKind::NotFound) => "MissingFileError",
                Err(ErrorKind::PermissionDenied) => "ForbiddenFileError",
                Err(_) => "FileError",
            };
            let line = line.map(|line| line.to_string());
            exception(class, sentence, &[("file", Some(file)), ("line", line), ("field", field)])
        }
        Error::Argument { ref name, .. } => {
            let field = as_arguments(name);
            exception("InputError", as_arguments(&sentence), &[("field", Some(field))])
        }
        Error::Usage(_) => refuse(as_arguments(&sentence)),
        _ => refuse(sentence),
    }
}

/// A sentence that names options of the command line (`--ground is 2`), with the names that they have as arguments of a
/// Python function (`ground is 2`).
pub fn as_arguments(sentence: &str) -> String {
    let word = |word: &str| {
        let (before, rest) = word.split_at(word.find(|c: char| !matches!(c, '\'' | '`' | '(')).unwrap_or(0));
        rest.strip_prefix("--").map_or(word.to_string(), |name| format!("{before}{}", name.replace('-', "_")))
    };
    sentence.split(' ').map(word).collect::<Vec<_>>().join(" ")
}

/// What a name of `T` stands for.
pub fn named<T>(argument: &str, name: &str) -> PyResult<T>
where
    T: strum::IntoEnumIterator + Into<&'static str> + std::str::FromStr,
{
    name.parse().map_err(|_| {
        let names: Vec<&'static str> = T::iter().map(Into::into).collect();
        refuse(format!("{argument}: found {name:?}, expected one of {}", names.join(", ")))
    })
}

fn panicked(panic: Box<dyn Any + Send>) -> PyErr {
    let words = panic.downcast_ref::<&str>().map(|s| s.to_string()).or_else(|| panic.downcast_ref::<String>().cloned());
    let words = words.unwrap_or_else(|| "no message".into());
    PyRuntimeError::new_err(format!("an internal error of mesophyll, which is worth a report: {words}"))
}

/// Does `work` without Python's lock. A panic becomes a `RuntimeError`. `long` work is done on a thread of its own, so
/// that Ctrl-C stops it; then `on_stop` is called, and the work is waited for.
pub fn run_until<T: Send>(
    py: Python<'_>,
    long: bool,
    on_stop: impl Fn() + Sync,
    work: impl FnOnce() -> Result<T> + Send,
) -> PyResult<T> {
    let ended = |made: std::thread::Result<Result<T>>| made.map_err(panicked)?.map_err(raise);
    let work = move || catch_unwind(AssertUnwindSafe(work));
    if !long {
        return ended(py.detach(work));
    }
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
                            on_stop();
                            stopped = Some(signal);
                        }
                    }
                    Err(mpsc::RecvTimeoutError::Disconnected) => return Err(panicked(Box::new("a thread ended"))),
                }
            }
        })
    })
}

/// Long work that never looks whether to stop: Ctrl-C is raised once it has ended.
pub fn run<T: Send>(py: Python<'_>, work: impl FnOnce() -> Result<T> + Send) -> PyResult<T> {
    run_until(py, true, || (), work)
}

/// Computes `rows` rows on all cores. `f` fills the cells of a row; `out` gets them in row order, its shape is
/// (rows, cells of a row).
///
/// # Errors
/// `InputError` where `out` has another size; what Ctrl-C raises, and then `out` is left as it was.
pub fn fill<F>(py: Python<'_>, rows: usize, cost: RowCost, out: &NumberBuffer, f: F) -> PyResult<RowTroubles>
where
    F: Fn(usize, &mut [f64], &CallInterrupt) -> Status + Sync + Send,
{
    let cells = out.item_count().checked_div(rows).unwrap_or(0);
    if out.item_count() != rows * cells {
        return Err(refuse(format!(
            "the output has {} numbers; expected {cells} for each of {rows} rows",
            out.item_count()
        )));
    }
    if rows == 0 || cells == 0 {
        return Ok(Vec::new());
    }
    let stop = CallInterrupt::default();
    let part = |first: usize, values: &mut [f64]| -> RowTroubles {
        let mut troubles = Vec::new();
        for (k, row) in values.chunks_exact_mut(cells).enumerate() {
            if stop.asked() {
                break;
            }
            let status = f(first + k, row, &stop);
            if matches!(status, Status::Refused(_)) {
                row.fill(f64::NAN);
            }
            if !status.is_ok() {
                troubles.push((first + k, status.to_string()));
            }
        }
        troubles
    };
    let long = cost == RowCost::Much || rows >= FEW;
    let (values, troubles) = run_until(
        py,
        long,
        || stop.ask(),
        || {
            let mut values = vec![f64::NAN; rows * cells];
            let troubles: Vec<RowTroubles> = if long {
                let each = (rows / (8 * rayon::current_num_threads())).clamp(1, CHUNK);
                let chunks = values.par_chunks_mut(each * cells).enumerate();
                chunks.map(|(k, chunk)| part(k * each, chunk)).collect()
            } else {
                vec![part(0, &mut values)]
            };
            // Rows may be missing, or made of fewer rays than were asked for.
            if stop.asked() { Err(Error::Interrupted("stopped".into())) } else { Ok((values, troubles.concat())) }
        },
    )?;
    out.copy_from_slice(py, &values)?;
    Ok(troubles)
}

/// The numbers of arrays that must be of one length.
///
/// # Errors
/// `InputError` where they are not.
pub fn columns<const N: usize>(py: Python<'_>, arrays: [&NumberBuffer; N]) -> PyResult<([Vec<f64>; N], usize)> {
    let rows = arrays.first().map_or(0, |a| a.item_count());
    let mut read: [Vec<f64>; N] = [const { Vec::new() }; N];
    for (to, from) in read.iter_mut().zip(arrays) {
        if from.item_count() != rows {
            return Err(refuse(format!("arrays of {rows} and of {} numbers", from.item_count())));
        }
        *to = from.to_vec(py)?;
    }
    Ok((read, rows))
}

/// Copies the values of an answer into a row.
pub fn answered(answer: mesophyll_files::table::OutputRow, row: &mut [f64]) -> Status {
    for (to, from) in row.iter_mut().zip(&answer.values) {
        *to = *from;
    }
    answer.status
}
