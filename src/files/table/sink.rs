//! Where a table's rows go, and how cells are written.

use crate::files::atomic::{self, Pending};
use crate::files::claim;
use crate::{Error, Result};
use std::io::{self, Write};
use std::path::Path;

/// Where rows go: a file that appears whole, or standard output.
pub enum Sink {
    File(Pending),
    Stdout(io::BufWriter<io::Stdout>),
    Memory(Vec<u8>),
}

impl Sink {
    /// Opens the output `path` of a batch that reads `input` (`-`: a standard stream).
    ///
    /// # Errors
    /// As [`claim::file`] and [`Pending::create`].
    pub fn open(path: &Path, input: &Path) -> Result<Sink> {
        claim::file(path, &["csv"], &[input])?;
        if path == Path::new("-") {
            Ok(Sink::Stdout(io::BufWriter::with_capacity(1 << 16, io::stdout())))
        } else {
            Ok(Sink::File(Pending::create(path)?))
        }
    }

    pub fn write_all(&mut self, path: &Path, bytes: &[u8]) -> Result<()> {
        match self {
            Sink::File(f) => f.write_all(bytes).map_err(|e| Error::write(path, atomic::explain(&e))),
            Sink::Stdout(s) => s.write_all(bytes).map_err(stdout_error),
            Sink::Memory(m) => {
                m.extend_from_slice(bytes);
                Ok(())
            }
        }
    }

    /// Flushes; a file gets its name.
    pub fn finish(self) -> Result<()> {
        match self {
            Sink::File(f) => f.finish(),
            Sink::Stdout(mut s) => s.flush().map_err(stdout_error),
            Sink::Memory(_) => Ok(()),
        }
    }
}

/// A closed pipe is the reader's choice, anything else a failed write.
pub fn stdout_error(e: io::Error) -> Error {
    if e.kind() == io::ErrorKind::BrokenPipe { Error::BrokenPipe } else { Error::write(Path::new("standard output"), atomic::explain(&e)) }
}

/// A number with as many digits as reading it back exactly needs; NaN is an empty cell.
pub fn push_number(bytes: &mut Vec<u8>, v: f64) {
    if !v.is_nan() {
        // Writing to a Vec cannot fail.
        let _ = write!(bytes, "{v:?}");
    }
}

/// A cell, quoted where CSV needs it.
pub fn push_text(bytes: &mut Vec<u8>, text: &str) {
    push_cell(bytes, text.as_bytes());
}

/// [`push_text`] for whatever bytes a carried cell holds.
pub fn push_cell(bytes: &mut Vec<u8>, cell: &[u8]) {
    if !cell.iter().any(|b| matches!(b, b',' | b'"' | b'\n' | b'\r')) {
        bytes.extend_from_slice(cell);
        return;
    }
    bytes.push(b'"');
    for &b in cell {
        if b == b'"' {
            bytes.push(b'"');
        }
        bytes.push(b);
    }
    bytes.push(b'"');
}
