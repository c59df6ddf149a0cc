//! Tables: columns by name in any order, extra columns carried through, a bad row named in its own row.
//!
//! Every table of the command line is opened as a [`InputTable`], which recognises its form (encoding, line ends,
//! comments, separator, decimal commas), and every number in it is read by one list of marks for missing readings.
//! Every batch form uses [`run`]: rows are read in blocks, computed in parallel, and written in input order. So ten
//! million rows need no more memory than ten thousand. At the end the lines of the file are compared with the lines
//! that were answered.

mod cell;
mod dialect;
#[cfg(test)]
mod forms_tests;
mod groups;
mod json;
mod lines;
mod omissions;
pub mod percent;
mod physical_range;
mod plan;
mod record;
mod rows;
mod sink;
mod source;
mod tally;

pub use groups::{GroupRow, Groups};
pub use lines::plain_text;
pub use mesophyll_base::error::Status;
pub use omissions::Omissions;
pub use physical_range::PhysicalRange;
pub use record::TableRecord;
pub use sink::{TableOutput, TableSink, push_cell, push_number, push_quoted, push_text, stdout_error};
pub use source::{InputTable, unpacked};
pub use tally::{RowTally, counted};

use plan::{Part, Plan, Stated, push_cells, whole};
use rows::RowBlock;

use crate::progress::TaskProgress;
use crate::{Error, Result};
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
    #[arg(short = 'o', long = "out", alias = "output", value_name = "FILE", default_value = "-")]
    pub output: PathBuf,
}

impl BatchIo {
    /// Where the rows go. `json` asks for JSON; only standard output gets it, a file is always CSV.
    pub fn rows(&self, json: bool) -> TableOutput {
        TableOutput { json: json && self.output == Path::new("-"), path: self.output.clone() }
    }
}

/// One output row: values in the order of the output columns (NaN prints as an empty cell) and a status.
#[derive(Debug, Clone, PartialEq)]
pub struct OutputRow {
    /// Cells in the order of the output columns.
    pub values: Vec<f64>,
    /// How the row ended.
    pub status: Status,
}

impl OutputRow {
    /// A row that nothing speaks against.
    pub fn ok(values: Vec<f64>) -> Self {
        OutputRow { values, status: Status::Ok }
    }

    /// A refused row: every output cell empty.
    pub fn refused(why: impl Into<String>) -> Self {
        OutputRow { values: Vec::new(), status: Status::Refused(why.into()) }
    }
}

/// What a batch reads and writes.
#[derive(Debug, Clone, Default)]
pub struct BatchSpec {
    /// Numeric columns that must exist, in the order in which [`InputRow::get`] numbers them.
    pub required: Vec<String>,
    /// Numeric columns that may exist; their numbers follow those of the required ones. An empty cell is NaN.
    pub optional: Vec<String>,
    /// Further columns that are not carried through (wide traces). The required ones are carried through unless they
    /// are named here, too.
    pub dropped: Vec<String>,
    /// Output columns, before `status`.
    pub outputs: Vec<String>,
    /// Output columns with whole numbers, which are printed as such (`3`, not `3.0`).
    pub whole: Vec<String>,
    /// Columns of words that may exist, in the order in which [`InputRow::text`] numbers them.
    pub texts: Vec<String>,
    /// Those of the optional columns in which a bad cell costs only itself: it is NaN, and [`InputRow::faults`] and
    /// [`Omissions`] name it. In the other columns it refuses its row.
    pub readings: Vec<String>,
    /// What is possible in some columns. Numbers outside that programs write for a missing reading (−999, −9.99, 1e34),
    /// and one value outside that the columns repeat, are missing readings. −9999 is one in every column.
    pub physical: Vec<PhysicalRange>,
}

impl BatchSpec {
    /// The number of a column for [`InputRow::get`].
    pub fn place(&self, column: &str) -> Option<usize> {
        self.required.iter().chain(&self.optional).position(|name| name == column)
    }
}

/// One input row.
#[derive(Debug)]
pub struct InputRow<'a> {
    values: &'a [f64],
    record: &'a TableRecord,
    /// Positions of the columns of words.
    texts: &'a [Option<usize>],
    number: usize,
    /// Readings that cannot be read: the number of the column, and why.
    faults: &'a [(usize, String)],
}

/// What answers a row, with an answer for each output row.
type Answering<'a> = dyn Fn(&InputRow, &mut Vec<OutputRow>) + Sync + 'a;

impl InputRow<'_> {
    /// Value of input column `k` (required ones first, then optional ones); NaN where an optional column or cell is
    /// absent.
    pub fn get(&self, k: usize) -> f64 {
        self.values[k]
    }
    /// All values, in the order of [`InputRow::get`].
    pub fn all(&self) -> &[f64] {
        self.values
    }
    /// The word in column `k` of words; `None` where there is no such column.
    pub fn text(&self, k: usize) -> Option<&str> {
        // A row with a word that is no text was refused before.
        self.record.text(self.texts[k]).and_then(|text| text.ok())
    }
    /// Number of the row, counted from 1.
    pub fn number(&self) -> usize {
        self.number
    }
    /// Line of the file where the row begins; the first line is 1.
    pub fn line(&self) -> usize {
        self.record.line()
    }
    /// Readings that cannot be read, and why: see [`BatchSpec::readings`].
    pub fn faults(&self) -> impl Iterator<Item = (usize, &str)> {
        self.faults.iter().map(|(k, why)| (*k, why.as_str()))
    }
}

/// A batch whose columns and output are checked and whose rows are not yet read. What is expensive is done between
/// [`Batch::open`] and [`Batch::run`], so that a wrong name or path is refused before it.
pub struct Batch {
    table: InputTable,
    spec: BatchSpec,
    plan: Plan,
    sink: TableSink,
}

impl Batch {
    /// Checks the columns of `table` and opens `output`.
    ///
    /// # Errors
    /// A missing required column, an output name that the input already has, an unwritable output.
    pub fn open(table: InputTable, output: &TableOutput, spec: &BatchSpec) -> Result<Batch> {
        let plan = Plan::new(&table, spec)?;
        let sink = TableSink::open(output, table.source())?;
        Ok(Batch { table, spec: spec.clone(), plan, sink })
    }

    /// Streams the table through `f`, which gets the numbers of one row and pushes one answer for each output row, at
    /// least one.
    ///
    /// # Errors
    /// An unreadable input, an output that can no longer be written, a stop, and a row without an answer. Bad rows are
    /// not errors: they are answered in place with `refused: …`.
    pub fn run(self, f: impl Fn(&InputRow, &mut Vec<OutputRow>) + Sync) -> Result<RowTally> {
        let Batch { mut table, spec, plan, mut sink } = self;
        sink.write_all(&plan.header_line(&table, &spec))?;
        let (mut tally, mut lines, mut stated) = (RowTally::new(&spec.outputs), 0, Stated::default());
        let bar = TaskProgress::of("rows");
        let (mut block, mut next) = (RowBlock::default(), RowBlock::default());
        let mut done: Vec<Part> = Vec::new();
        table.next_block(BLOCK, &mut block)?;
        while !(block.rows.is_empty() && done.is_empty()) {
            // While these rows are computed, the rows before are written and those after are read.
            let (computed, moved) = rayon::join(
                || plan.compute(&block, &spec, &f as &Answering),
                || {
                    for part in done.drain(..) {
                        sink.write_all(&part.bytes)?;
                        tally.add(&part.tally);
                        stated.add(&part.stated);
                        lines += part.lines;
                        bar.advance(part.tally.rows as u64);
                    }
                    if block.rows.is_empty() { Ok(()) } else { table.next_block(BLOCK, &mut next) }
                },
            );
            // A stop may have cut these rows short.
            if crate::progress::stop_requested() {
                return Err(Error::Interrupted(format!(
                    "interrupted after {} rows; no output file was written",
                    tally.rows
                )));
            }
            moved?;
            done = computed;
            std::mem::swap(&mut block, &mut next);
            next.clear();
        }
        table.balance(lines)?;
        sink.finish()?;
        stated.say(&table);
        Ok(tally)
    }
}

/// Streams `table` through `f` into `output`: [`Batch::open`] and [`Batch::run`].
///
/// # Errors
/// As these two.
pub fn run(
    table: InputTable,
    output: &TableOutput,
    spec: &BatchSpec,
    f: impl Fn(&InputRow, &mut Vec<OutputRow>) + Sync,
) -> Result<RowTally> {
    Batch::open(table, output, spec)?.run(f)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_the_number_of_a_row_are_known() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out.csv");
        let spec = BatchSpec {
            texts: vec!["side".into(), "path".into()],
            outputs: vec!["y".into()],
            whole: vec!["y".into()],
            ..BatchSpec::default()
        };
        let table = InputTable::from_reader(Box::new(&b"side\nup\n\xff\n\"\"\n"[..]), "in.csv".into()).unwrap();
        run(table, &TableOutput::csv(&out), &spec, |row, out| {
            assert_eq!(row.text(1), None);
            let y = row.number() as f64 + if row.text(0) == Some("up") { 10.0 } else { 0.0 };
            out.push(OutputRow::ok(vec![y]));
        })
        .unwrap();
        let want = "side,y,status\nup,11,ok\n\u{fffd},,refused: side is not valid UTF-8 text; expected a word\n,3,ok\n";
        assert_eq!(String::from_utf8_lossy(&std::fs::read(out).unwrap()), want);
    }

    fn through(text: &'static str) -> Result<String> {
        through_bytes(text.as_bytes())
    }

    fn through_bytes(text: &'static [u8]) -> Result<String> {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out.csv");
        let spec = BatchSpec {
            required: vec!["x".into()],
            optional: vec!["k".into()],
            outputs: vec!["y".into()],
            ..BatchSpec::default()
        };
        let table = InputTable::from_reader(Box::new(text), "in.csv".into())?;
        run(table, &TableOutput::csv(&out), &spec, |row, out| {
            let k = if row.get(1).is_nan() { 1.0 } else { row.get(1) };
            out.push(OutputRow::ok(vec![row.get(0) * k]));
        })?;
        Ok(String::from_utf8_lossy(&std::fs::read(out).unwrap()).into_owned())
    }

    #[test]
    fn columns_by_name_extras_carried_bad_rows_named() {
        let got = through("note,x\n\"a,b\",0.1\nc,oops\nd\n,1e-300\n").unwrap();
        let want = "note,x,y,status\n\"a,b\",0.1,0.1,ok\nc,oops,,\"refused: x is \"\"oops\"\"; expected a number\"\n\
                    d,,,refused: 1 fields where the header has 2\n,1e-300,1e-300,ok\n";
        assert_eq!(got, want);
    }

    #[test]
    fn bytes_that_are_no_number_refuse_their_row_only() {
        let got = through_bytes(b"\xef\xbb\xbfnote,x\r\na,1\r\n\xe4,2\r\nb,\xff\r\n").unwrap();
        assert_eq!(
            got,
            "note,x,y,status\na,1,1.0,ok\n\u{fffd},2,2.0,ok\nb,\u{fffd},,refused: x is not valid UTF-8 text; expected \
             a number\n"
        );
        assert_eq!(
            through_bytes(b"\xff\xfe,x\n1,2\n").unwrap_err().to_string(),
            "in.csv: line 1: not valid UTF-8 text"
        );
    }

    /// Quotes are read by RFC 4180; a quote that it does not allow spoils only its own row.
    #[test]
    fn a_quote_that_is_not_closed_costs_its_own_row_and_no_other() {
        let rows =
            |text: &'static str| -> Vec<String> { through(text).unwrap().lines().skip(1).map(String::from).collect() };
        let never = "refused: the quote that opens on line 3 is never closed";
        assert_eq!(
            rows("note,x\na,1\n\"b,2\nc,3\nd,4\n"),
            ["a,1,1.0,ok", &format!("\"\"\"b,2\",,,{never}"), "c,3,3.0,ok", "d,4,4.0,ok"]
        );
        // Quotes of a later row do not close it.
        let wrong = "refused: the quote that opens on line 2 is closed in the middle of a cell";
        assert_eq!(
            rows("note,x\r\n\"b,2\r\n\"c\",3\r\n\r\nd,4"),
            [&format!("\"\"\"b,2\",,,{wrong}"), "c,3,3.0,ok", "d,4,4.0,ok"]
        );
        // Neither do a thousand rows without a quote.
        let long: &'static str = format!("note,x\n\"b,2\n{}", "c,3\n".repeat(1000)).leak();
        assert_eq!(rows(long).iter().filter(|r| *r == "c,3,3.0,ok").count(), 1000);
        // The last row, without an end.
        assert_eq!(rows("note,x\na,1\n\"b,2").len(), 2);
        // Line breaks, doubled quotes and commas in a quoted cell are its text.
        assert_eq!(
            through("note,x\n\"a\n\"\"b,\",1\nc,2\n").unwrap(),
            "note,x,y,status\n\"a\n\"\"b,\",1,1.0,ok\nc,2,2.0,ok\n"
        );
        assert!(
            through("note,\"x\n1,2\n")
                .unwrap_err()
                .to_string()
                .contains("the header cannot be read: the quote that opens on line 1")
        );
    }

    #[test]
    fn columns_without_end_are_refused_at_once() {
        let header: Vec<String> = (0..200_000).map(|k| format!("c{k}")).collect();
        let text: &'static str = format!("{}\n", header.join(",")).leak();
        assert!(through(text).unwrap_err().to_string().contains("found 200000 columns, expected at most 65536"));
    }

    #[test]
    fn headers_are_checked() {
        assert!(through("x,x\n1,2\n").unwrap_err().to_string().contains("twice"));
        assert!(through("z\n1\n").unwrap_err().to_string().contains("no such column"));
        assert!(through("x,y\n1,2\n").unwrap_err().to_string().contains("already has"));
        assert!(through("").unwrap_err().to_string().contains("no header"));
    }
}
