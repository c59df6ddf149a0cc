//! CSV batches: columns by name in any order, extra columns carried through, a bad row named in its own row.
//!
//! Every batch form of the command line goes through [`run`]: rows are read in blocks, computed in parallel, and written
//! in input order, so ten million rows need no more memory than ten thousand.

use crate::files::atomic::{self, Pending};
use crate::{Error, Result};
use rayon::prelude::*;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// Rows handed to the workers at a time.
const BLOCK: usize = 16_384;

/// Where a batch comes from and goes to; `-` or nothing is a standard stream.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct BatchIo {
    /// CSV to read (`-`: standard input)
    #[arg(long = "in", value_name = "FILE", default_value = "-")]
    pub input: PathBuf,
    /// CSV to write (`-`: standard output); written whole or not at all
    #[arg(long = "out", value_name = "FILE", default_value = "-")]
    pub output: PathBuf,
}

/// A row's verdict, as printed in the last column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Status {
    /// Right within the printed errors, each relative 1σ ≤ 10 %.
    Ok,
    /// The best estimate is printed; the named parameters are not determined.
    Undetermined(String),
    /// No numbers; the reason names the field.
    Refused(String),
}

impl std::fmt::Display for Status {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Status::Ok => f.write_str("ok"),
            Status::Undetermined(what) => write!(f, "undetermined: {what}"),
            Status::Refused(why) => write!(f, "refused: {why}"),
        }
    }
}

/// One output row: values in the order of the output columns (NaN prints as an empty cell) and a status.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    pub values: Vec<f64>,
    pub status: Status,
}

impl Answer {
    pub fn ok(values: Vec<f64>) -> Self {
        Answer { values, status: Status::Ok }
    }

    /// A refused row: every output cell empty.
    pub fn refused(why: impl Into<String>) -> Self {
        Answer { values: Vec::new(), status: Status::Refused(why.into()) }
    }
}

/// What a batch reads and writes.
#[derive(Debug, Clone, Default)]
pub struct Spec {
    /// Numeric columns that must be there, in the order [`Row::get`] counts them.
    pub required: Vec<String>,
    /// Numeric columns that may be there; they count on after the required ones. An empty cell is NaN.
    pub optional: Vec<String>,
    /// Further columns that are not carried through (wide traces); the required ones are carried unless named here too.
    pub dropped: Vec<String>,
    /// Output columns, before `status`.
    pub outputs: Vec<String>,
}

/// The numbers of one input row.
#[derive(Debug)]
pub struct Row<'a> {
    values: &'a [f64],
}

impl Row<'_> {
    /// Value of input column `k` (required ones first, then optional ones); NaN where an optional column or cell is absent.
    pub fn get(&self, k: usize) -> f64 {
        self.values[k]
    }
    pub fn all(&self) -> &[f64] {
        self.values
    }
}

/// How many rows ended how.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    pub rows: usize,
    pub ok: usize,
    pub undetermined: usize,
    pub refused: usize,
}

/// An opened CSV: its header is read, its rows are not.
pub struct Table {
    reader: csv::Reader<Box<dyn Read + Send>>,
    name: PathBuf,
    pub header: Vec<String>,
}

impl Table {
    /// Opens `path` (`-`: standard input) and reads the header line.
    ///
    /// # Errors
    /// [`Error::Input`] for a missing file, no header, or a column named twice.
    pub fn open(path: &Path) -> Result<Table> {
        let (source, name): (Box<dyn Read + Send>, PathBuf) = if path == Path::new("-") {
            (Box::new(io::stdin()), "standard input".into())
        } else {
            let file = File::open(path).map_err(|e| Error::input(path, atomic::explain(&e)))?;
            (Box::new(file), path.to_path_buf())
        };
        Table::from_reader(source, name)
    }

    /// A table from any source; `name` stands for the file in messages.
    pub fn from_reader(source: Box<dyn Read + Send>, name: PathBuf) -> Result<Table> {
        let mut reader = csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).buffer_capacity(1 << 18).from_reader(source);
        let header: Vec<String> = reader
            .headers()
            .map_err(|e| Error::input(&name, format!("line 1: {}", plain_csv_error(&e))))?
            .iter()
            .map(|h| h.trim_start_matches('\u{feff}').to_string())
            .collect();
        if header.iter().all(|h| h.is_empty()) {
            return Err(Error::input(&name, "no header line; the first line must name the columns"));
        }
        for (k, h) in header.iter().enumerate() {
            if header[..k].contains(h) {
                return Err(Error::field(&name, h, "the header names this column twice"));
            }
        }
        Ok(Table { reader, name, header })
    }

    pub fn name(&self) -> &Path {
        &self.name
    }

    /// Position of a column.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.header.iter().position(|h| h == name)
    }

    /// Position of a column that must be there.
    pub fn require(&self, name: &str) -> Result<usize> {
        self.column(name)
            .ok_or_else(|| Error::field(&self.name, name, format!("no such column; the header has {}", self.header.join(", "))))
    }

    /// The next record; false at the end. Records may be ragged (compare with the header's length) and may hold any bytes: one row in
    /// another encoding stops no batch.
    pub fn next_record(&mut self, record: &mut csv::ByteRecord) -> Result<bool> {
        self.reader.read_byte_record(record).map_err(|e| {
            let line = e.position().map_or(0, |p| p.line());
            Error::input(&self.name, format!("line {line}: {}", plain_csv_error(&e)))
        })
    }
}

fn plain_csv_error(e: &csv::Error) -> String {
    match e.kind() {
        csv::ErrorKind::Io(io) => atomic::explain(io),
        csv::ErrorKind::Utf8 { .. } => "not valid UTF-8 text".into(),
        _ => e.to_string(),
    }
}

/// Where rows go: a file that appears whole, or standard output.
pub enum Sink {
    File(Pending),
    Stdout(io::BufWriter<io::Stdout>),
    Memory(Vec<u8>),
}

impl Sink {
    pub fn open(path: &Path) -> Result<Sink> {
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

/// Streams `table` through `f` into `io.output`; `f` sees the numbers of one row and pushes one answer for each output row.
///
/// # Errors
/// A missing required column, an output name that the input already has, an unreadable input or an unwritable output.
/// Bad rows are not errors: they are answered in place with `refused: …`.
pub fn run<F>(mut table: Table, output: &Path, spec: &Spec, f: F) -> Result<Tally>
where
    F: Fn(&Row, &mut Vec<Answer>) + Sync,
{
    let plan = Plan::new(&table, spec)?;
    let mut sink = Sink::open(output)?;
    sink.write_all(output, &plan.header_line(&table, spec))?;
    let mut tally = Tally::default();
    let mut block: Vec<csv::ByteRecord> = Vec::with_capacity(BLOCK);
    loop {
        block.clear();
        while block.len() < BLOCK {
            let mut record = csv::ByteRecord::new();
            if !table.next_record(&mut record)? {
                break;
            }
            block.push(record);
        }
        if block.is_empty() {
            break;
        }
        let chunk = block.len().div_ceil(rayon::current_num_threads() * 4).max(16);
        let done: Vec<(Vec<u8>, Tally)> = block
            .par_chunks(chunk)
            .map(|records| {
                let (mut bytes, mut tally) = (Vec::with_capacity(records.len() * 64), Tally::default());
                let mut answers = Vec::new();
                for record in records {
                    answers.clear();
                    plan.answer(record, spec, &f, &mut answers);
                    for answer in &answers {
                        tally.rows += 1;
                        match answer.status {
                            Status::Ok => tally.ok += 1,
                            Status::Undetermined(_) => tally.undetermined += 1,
                            Status::Refused(_) => tally.refused += 1,
                        }
                        plan.write_row(&mut bytes, record, answer, spec);
                    }
                }
                (bytes, tally)
            })
            .collect();
        for (bytes, part) in done {
            sink.write_all(output, &bytes)?;
            tally.rows += part.rows;
            tally.ok += part.ok;
            tally.undetermined += part.undetermined;
            tally.refused += part.refused;
        }
        if crate::files::progress::stop_requested() {
            return Err(Error::Interrupted(format!("interrupted after {} rows; no output file was written", tally.rows)));
        }
    }
    sink.finish()?;
    Ok(tally)
}

/// Column positions, settled once.
struct Plan {
    width: usize,
    numbers: Vec<(Option<usize>, String, bool)>,
    carried: Vec<usize>,
}

impl Plan {
    fn new(table: &Table, spec: &Spec) -> Result<Plan> {
        let mut numbers = Vec::new();
        for name in &spec.required {
            numbers.push((Some(table.require(name)?), name.clone(), true));
        }
        for name in &spec.optional {
            numbers.push((table.column(name), name.clone(), false));
        }
        let carried: Vec<usize> = (0..table.header.len()).filter(|&k| !spec.dropped.contains(&table.header[k])).collect();
        for name in spec.outputs.iter().map(String::as_str).chain(["status"]) {
            if carried.iter().any(|&k| table.header[k] == name) {
                return Err(Error::field(table.name(), name, "the input already has this output column; rename or remove it"));
            }
        }
        Ok(Plan { width: table.header.len(), numbers, carried })
    }

    fn header_line(&self, table: &Table, spec: &Spec) -> Vec<u8> {
        let names = self.carried.iter().map(|&k| table.header[k].as_str());
        let names = names.chain(spec.outputs.iter().map(String::as_str)).chain(["status"]);
        let mut line = Vec::new();
        for (k, name) in names.enumerate() {
            if k > 0 {
                line.push(b',');
            }
            push_text(&mut line, name);
        }
        line.push(b'\n');
        line
    }

    fn answer<F: Fn(&Row, &mut Vec<Answer>)>(&self, record: &csv::ByteRecord, spec: &Spec, f: &F, out: &mut Vec<Answer>) {
        if record.len() != self.width {
            out.push(Answer::refused(format!("{} fields where the header has {}", record.len(), self.width)));
            return;
        }
        let mut values = Vec::with_capacity(self.numbers.len());
        for (at, name, needed) in &self.numbers {
            let Ok(text) = std::str::from_utf8(at.map_or(&[], |k| &record[k])) else {
                out.push(Answer::refused(format!("{name} is not valid UTF-8 text; expected a number")));
                return;
            };
            if text.is_empty() && !needed {
                values.push(f64::NAN);
                continue;
            }
            match text.parse::<f64>() {
                // `nan` in an optional cell is what an empty one is: no reading.
                Ok(v) if !v.is_nan() || !needed => values.push(v),
                _ if text.is_empty() => {
                    out.push(Answer::refused(format!("{name} is empty")));
                    return;
                }
                _ => {
                    out.push(Answer::refused(format!("{name} is {text:?}; expected a number")));
                    return;
                }
            }
        }
        f(&Row { values: &values }, out);
        debug_assert!(out.iter().all(|a| a.values.is_empty() || a.values.len() == spec.outputs.len()));
    }

    fn write_row(&self, bytes: &mut Vec<u8>, record: &csv::ByteRecord, answer: &Answer, spec: &Spec) {
        for &k in &self.carried {
            push_cell(bytes, record.get(k).unwrap_or(b""));
            bytes.push(b',');
        }
        for k in 0..spec.outputs.len() {
            if let Some(v) = answer.values.get(k) {
                push_number(bytes, *v);
            }
            bytes.push(b',');
        }
        push_text(bytes, &answer.status.to_string());
        bytes.push(b'\n');
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn through(text: &'static str) -> Result<String> {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out.csv");
        let spec = Spec { required: vec!["x".into()], optional: vec!["k".into()], outputs: vec!["y".into()], ..Spec::default() };
        let table = Table::from_reader(Box::new(text.as_bytes()), "in.csv".into())?;
        run(table, &out, &spec, |row, out| {
            let k = if row.get(1).is_nan() { 1.0 } else { row.get(1) };
            out.push(Answer::ok(vec![row.get(0) * k]));
        })?;
        Ok(std::fs::read_to_string(out).unwrap())
    }

    #[test]
    fn columns_by_name_extras_carried_bad_rows_named() {
        let got = through("note,x\n\"a,b\",0.1\nc,oops\nd\n,1e-300\n").unwrap();
        let want = "note,x,y,status\n\"a,b\",0.1,0.1,ok\nc,oops,,\"refused: x is \"\"oops\"\"; expected a number\"\n\
                    d,,,refused: 1 fields where the header has 2\n,1e-300,1e-300,ok\n";
        assert_eq!(got, want);
    }

    #[test]
    fn headers_are_checked() {
        assert!(through("x,x\n1,2\n").unwrap_err().to_string().contains("twice"));
        assert!(through("z\n1\n").unwrap_err().to_string().contains("no such column"));
        assert!(through("x,y\n1,2\n").unwrap_err().to_string().contains("already has"));
        assert!(through("").unwrap_err().to_string().contains("no header"));
    }
}
