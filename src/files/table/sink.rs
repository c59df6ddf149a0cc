//! Where a table's rows go, and how cells are written.

use super::json::JsonRows;
use crate::atomic::{self, PendingFile};
use crate::claim;
use crate::standard_output::StandardOutput;
use crate::{Error, Result};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Where rows go and in which form.
#[derive(Debug, Clone)]
pub struct TableOutput {
    /// A file, or `-` for standard output.
    pub path: PathBuf,
    /// Whether rows are written as JSON instead of CSV.
    pub json: bool,
}

impl TableOutput {
    /// Rows as CSV.
    pub fn csv(path: &Path) -> TableOutput {
        TableOutput { path: path.to_path_buf(), json: false }
    }
}

/// An opened [`TableOutput`]: a file that appears only when it is complete, or standard output.
pub struct TableSink {
    place: Place,
    path: PathBuf,
    json: Option<JsonRows>,
}

enum Place {
    File(PendingFile),
    Stdout(io::BufWriter<StandardOutput>),
}

impl Write for Place {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Place::File(f) => f.write(bytes),
            Place::Stdout(s) => s.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Place::File(f) => f.flush(),
            Place::Stdout(s) => s.flush(),
        }
    }
}

impl TableSink {
    /// Opens the output of a batch that reads `input` (`-`: a standard stream).
    ///
    /// # Errors
    /// As [`claim::file`] and [`PendingFile::create`].
    pub fn open(output: &TableOutput, input: &Path) -> Result<TableSink> {
        claim::file(&output.path, &["csv", "json"], &[input])?;
        let place = if output.path == Path::new("-") {
            Place::Stdout(io::BufWriter::with_capacity(1 << 16, StandardOutput))
        } else {
            Place::File(PendingFile::create(&output.path)?)
        };
        Ok(TableSink { place, path: output.path.clone(), json: output.json.then(JsonRows::default) })
    }

    /// Writes whole lines of CSV; the first one is the header.
    pub fn write_all(&mut self, lines: &[u8]) -> Result<()> {
        let done = match &mut self.json {
            Some(rows) => rows.write(lines, &mut self.place),
            None => self.place.write_all(lines),
        };
        done.map_err(|e| self.failed(e))
    }

    /// Flushes the rows; a file gets its name.
    pub fn finish(mut self) -> Result<()> {
        let done = match &self.json {
            Some(rows) => rows.finish(&mut self.place),
            None => Ok(()),
        };
        done.and_then(|()| self.place.flush()).map_err(|e| self.failed(e))?;
        match self.place {
            Place::File(f) => f.finish(),
            Place::Stdout(_) => Ok(()),
        }
    }

    fn failed(&self, e: io::Error) -> Error {
        match self.place {
            Place::File(_) => Error::write(&self.path, atomic::explain(&e)),
            Place::Stdout(_) => stdout_error(e),
        }
    }
}

/// A closed pipe is the reader's choice; any other error is a failed write.
pub fn stdout_error(e: io::Error) -> Error {
    if e.kind() == io::ErrorKind::BrokenPipe {
        Error::BrokenPipe
    } else {
        Error::write(Path::new("standard output"), atomic::explain(&e))
    }
}

/// A number with as many digits as are needed to read it back exactly; NaN is an empty cell.
pub fn push_number(bytes: &mut Vec<u8>, v: f64) {
    if v.is_nan() {
    } else if v == 0.0 || (1e-4..1e15).contains(&v.abs()) {
        // The same text as below, in a quarter of the time.
        bytes.extend_from_slice(zmij::Buffer::new().format_finite(v).as_bytes());
    } else {
        // Writing to a Vec cannot fail.
        let _ = write!(bytes, "{v:?}");
    }
}

/// A cell of an output, quoted where CSV needs it. A spreadsheet takes what begins with =, +, − or @ for a formula and
/// runs it; an apostrophe before it makes it text. Numbers and dashes that stand for nothing stay as they are.
pub fn push_text(bytes: &mut Vec<u8>, text: &str) {
    push_cell(bytes, text.as_bytes());
}

/// [`push_text`] for a carried cell, which may hold any bytes.
pub fn push_cell(bytes: &mut Vec<u8>, cell: &[u8]) {
    if is_formula(cell) {
        quote(bytes, &[b"'", cell].concat());
    } else {
        quote(bytes, cell);
    }
}

/// A cell of a table that only this program reads: as [`push_text`], but formulas stay.
pub fn push_quoted(bytes: &mut Vec<u8>, text: &str) {
    quote(bytes, text.as_bytes());
}

/// Whether a spreadsheet would run a cell.
pub(super) fn is_formula(cell: &[u8]) -> bool {
    let begins = |cell: &[u8]| matches!(cell.first(), Some(b'=' | b'+' | b'-' | b'@' | b'\t' | b'\r'));
    if !begins(cell) || cell.iter().all(|b| *b == b'-') {
        return false;
    }
    let number = |text: &str| {
        let text = text.trim_ascii().trim_end_matches('%').trim_ascii_end();
        text.parse::<f64>().is_ok() || text.replacen(',', ".", 1).parse::<f64>().is_ok()
    };
    !std::str::from_utf8(cell).is_ok_and(number)
}

fn quote(bytes: &mut Vec<u8>, cell: &[u8]) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spreadsheet_runs_no_cell() {
        let pushed = |cell: &str| {
            let mut bytes = Vec::new();
            push_text(&mut bytes, cell);
            String::from_utf8(bytes).unwrap()
        };
        for text in ["=1+1", "+oak", "-leaf", "@SUM(A1)", "-2+cmd", "--1", "\tx"] {
            assert_eq!(pushed(text), format!("'{text}"));
        }
        assert_eq!(pushed("=HYPERLINK(\"a\",1)"), "\"'=HYPERLINK(\"\"a\"\",1)\"");
        for plain in ["-1.5", "+3e-4", "-2,5", "-5 %", "-", "---", "-inf", "elm", "'=1+1", ""] {
            assert_eq!(pushed(plain).trim_matches('"'), plain);
        }
    }

    /// Numbers are read back exactly, and have the form in which Rust prints them: the same number of digits, and a
    /// power of ten for the same sizes. (Of two decimals that are equally near, the last digit may be the other one.)
    #[test]
    fn numbers_print_in_one_form() {
        let printed = |v: f64| {
            let mut bytes = Vec::new();
            push_number(&mut bytes, v);
            String::from_utf8(bytes).unwrap()
        };
        assert_eq!(printed(f64::NAN), "");
        for v in [0.0, -0.0, 1.0, 1e-4, 9.9999999999999e-5, 1e15, 1e16, 1e300, 5e-324, f64::INFINITY, 0.1 + 0.2] {
            assert_eq!([printed(v), printed(-v)], [format!("{v:?}"), format!("{:?}", -v)]);
        }
        // Multiples of an odd number visit all exponents and mantissas.
        let bits = (1..50_000u64).map(|k| f64::from_bits(k.wrapping_mul(0x9e37_79b9_7f4a_7c15)));
        let tame = (1..50_000).map(|k| f64::from(k) / 7919.0);
        for v in bits.chain(tame).filter(|v| !v.is_nan()) {
            let (ours, plain) = (printed(v), format!("{v:?}"));
            assert_eq!((ours.parse(), ours.len()), (Ok(v), plain.len()), "{ours} and {plain}");
        }
    }
}
