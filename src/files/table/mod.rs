//! CSV batches: columns by name in any order, extra columns carried through, a bad row named in its own row.
//!
//! Every batch form of the command line goes through [`run`]: rows are read in blocks, computed in parallel, and
//! written in input order, so ten million rows need no more memory than ten thousand.

mod groups;
mod json;
mod rows;
mod sink;
mod source;
mod tally;

pub use groups::{GroupRow, Groups};
pub use mesophyll_error::Status;
pub use sink::{Output, Sink, push_cell, push_number, push_text, stdout_error};
pub use source::{Record, Table};
pub use tally::{Tally, counted};

use rows::{At, Block};
use source::Splitter;

use crate::progress::Bar;
use crate::{Error, Result};
use rayon::prelude::*;
use std::collections::HashSet;
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
    pub fn rows(&self, json: bool) -> Output {
        Output { json: json && self.output == Path::new("-"), path: self.output.clone() }
    }
}

/// One output row: values in the order of the output columns (NaN prints as an empty cell) and a status.
#[derive(Debug, Clone, PartialEq)]
pub struct Answer {
    /// Cells in the order of the output columns.
    pub values: Vec<f64>,
    /// How the row ended.
    pub status: Status,
}

impl Answer {
    /// A row that is right within its errors.
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
    /// Output columns that are whole numbers and print as such (`3`, not `3.0`).
    pub whole: Vec<String>,
    /// Columns of words that may be there, in the order [`Row::text`] counts them.
    pub texts: Vec<String>,
}

/// One input row.
#[derive(Debug)]
pub struct Row<'a> {
    values: &'a [f64],
    texts: &'a [Option<&'a str>],
    number: usize,
}

impl Row<'_> {
    /// Value of input column `k` (required ones first, then optional ones); NaN where an optional column or cell is
    /// absent.
    pub fn get(&self, k: usize) -> f64 {
        self.values[k]
    }
    /// All of them, in the order [`Row::get`] counts.
    pub fn all(&self) -> &[f64] {
        self.values
    }
    /// The word in column `k` of words; `None` where there is no such column.
    pub fn text(&self, k: usize) -> Option<&str> {
        self.texts[k]
    }
    /// Which row it is, counted from 1.
    pub fn number(&self) -> usize {
        self.number
    }
}

/// Streams `table` through `f` into `output`; `f` sees the numbers of one row and pushes one answer for each output
/// row.
///
/// # Errors
/// A missing required column, an output name that the input already has, an unreadable input or an unwritable output.
/// Bad rows are not errors: they are answered in place with `refused: …`.
pub fn run<F>(mut table: Table, output: &Output, spec: &Spec, f: F) -> Result<Tally>
where
    F: Fn(&Row, &mut Vec<Answer>) + Sync,
{
    let plan = Plan::new(&table, spec)?;
    let mut sink = Sink::open(output, table.source())?;
    sink.write_all(&plan.header_line(&table, spec))?;
    let mut tally = Tally::new(&spec.outputs);
    let bar = Bar::of("rows");
    let (mut block, mut next) = (Block::default(), Block::default());
    let mut done: Vec<(Vec<u8>, Tally)> = Vec::new();
    table.next_block(BLOCK, &mut block)?;
    while !(block.rows.is_empty() && done.is_empty()) {
        // The rows before are written and those after are read while these are computed.
        let (computed, moved) = rayon::join(
            || plan.compute(&block, spec, &f),
            || {
                for (bytes, part) in done.drain(..) {
                    sink.write_all(&bytes)?;
                    tally.add(&part);
                    bar.advance(part.rows as u64);
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
    sink.finish()?;
    Ok(tally)
}

/// Column positions, settled once.
struct Plan {
    width: usize,
    numbers: Vec<(Option<usize>, String, bool)>,
    texts: Vec<Option<usize>>,
    carried: Vec<usize>,
    /// Which output columns are whole numbers.
    whole: Vec<bool>,
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
        let dropped: HashSet<&String> = spec.dropped.iter().collect();
        let carried: Vec<usize> = (0..table.header.len()).filter(|&k| !dropped.contains(&table.header[k])).collect();
        for name in spec.outputs.iter().map(String::as_str).chain(["status"]) {
            if carried.iter().any(|&k| table.header[k] == name) {
                return Err(Error::field(
                    table.name(),
                    name,
                    "the input already has this output column; rename or remove it",
                ));
            }
        }
        let texts = spec.texts.iter().map(|name| table.column(name)).collect();
        Ok(Plan { width: table.header.len(), numbers, texts, carried, whole: whole(spec) })
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

    /// Answers all rows of a block, as lines in parts that follow one another.
    fn compute<F: Fn(&Row, &mut Vec<Answer>) + Sync>(
        &self,
        block: &Block,
        spec: &Spec,
        f: &F,
    ) -> Vec<(Vec<u8>, Tally)> {
        let chunk = block.rows.len().div_ceil(rayon::current_num_threads() * 4).max(16);
        let parts = block.rows.par_chunks(chunk).enumerate();
        let answer = |(part, rows): (usize, &[At])| {
            let (mut bytes, mut tally) = (Vec::with_capacity(rows.len() * 128), Tally::new(&spec.outputs));
            let (mut splitter, mut record, mut answers) = (Splitter::default(), Record::default(), Vec::new());
            for (k, row) in rows.iter().enumerate() {
                let place = part * chunk + k;
                let end = block.rows.get(place + 1).map_or(block.bytes.len(), |next| next.start);
                let mut text = &block.bytes[row.start..end];
                let mut number = row.number;
                while splitter.split(&mut text, &mut record) {
                    record.unclosed = block.fault(place).cloned();
                    answers.clear();
                    self.answer(&record, number, spec, f, &mut answers);
                    for answer in &answers {
                        tally.count(&answer.status, &answer.values);
                        self.write_row(&mut bytes, &record, answer);
                    }
                    number += 1;
                }
            }
            (bytes, tally)
        };
        parts.map(answer).collect()
    }

    fn answer<F: Fn(&Row, &mut Vec<Answer>)>(
        &self,
        record: &Record,
        number: usize,
        spec: &Spec,
        f: &F,
        out: &mut Vec<Answer>,
    ) {
        match self.parsed(record, spec) {
            Ok((values, texts)) => f(&Row { values: &values, texts: &texts, number }, out),
            Err(why) => out.push(Answer::refused(why)),
        }
        debug_assert!(out.iter().all(|a| a.values.is_empty() || a.values.len() == spec.outputs.len()));
    }

    /// Numbers and words of a row, or what is wrong with it.
    #[allow(clippy::type_complexity)]
    fn parsed<'a>(
        &self,
        record: &'a Record,
        spec: &Spec,
    ) -> std::result::Result<(Vec<f64>, Vec<Option<&'a str>>), String> {
        if let Some(fault) = record.fault(self.width) {
            return Err(fault);
        }
        let mut values = Vec::with_capacity(self.numbers.len());
        for (at, name, needed) in &self.numbers {
            let text = match record.text(*at) {
                Some(Err(_)) => return Err(format!("{name} is not valid UTF-8 text; expected a number")),
                Some(Ok(text)) => text,
                None => "",
            };
            if text.is_empty() && !needed {
                values.push(f64::NAN);
                continue;
            }
            match text.parse::<f64>() {
                // `nan` in an optional cell is what an empty one is: no reading.
                Ok(v) if !v.is_nan() || !needed => values.push(v),
                _ if text.is_empty() => return Err(format!("{name} is empty")),
                _ => return Err(format!("{name} is {text:?}; expected a number")),
            }
        }
        let word = |(at, name): (&Option<usize>, &String)| {
            record.text(*at).transpose().map_err(|_| format!("{name} is not valid UTF-8 text; expected a word"))
        };
        let texts = self.texts.iter().zip(&spec.texts).map(word).collect::<std::result::Result<_, String>>()?;
        Ok((values, texts))
    }

    fn write_row(&self, bytes: &mut Vec<u8>, record: &Record, answer: &Answer) {
        for &k in &self.carried {
            push_cell(bytes, record.bytes(k));
            bytes.push(b',');
        }
        push_cells(bytes, answer, &self.whole);
    }
}

/// Which output columns are whole numbers.
fn whole(spec: &Spec) -> Vec<bool> {
    spec.outputs.iter().map(|name| spec.whole.contains(name)).collect()
}

/// Output cells and status of a row, and its end.
fn push_cells(bytes: &mut Vec<u8>, answer: &Answer, whole: &[bool]) {
    for (k, whole) in whole.iter().enumerate() {
        match answer.values.get(k) {
            Some(v) if *whole && v.fract() == 0.0 => push_text(bytes, &format!("{v:.0}")),
            Some(v) => push_number(bytes, *v),
            None => {}
        }
        bytes.push(b',');
    }
    match &answer.status {
        Status::Ok => bytes.extend_from_slice(b"ok"),
        status => push_text(bytes, &status.to_string()),
    }
    bytes.push(b'\n');
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_the_number_of_a_row_are_known() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out.csv");
        let spec = Spec {
            texts: vec!["side".into(), "path".into()],
            outputs: vec!["y".into()],
            whole: vec!["y".into()],
            ..Spec::default()
        };
        let table = Table::from_reader(Box::new(&b"side\nup\n\xff\n\"\"\n"[..]), "in.csv".into()).unwrap();
        run(table, &Output::csv(&out), &spec, |row, out| {
            assert_eq!(row.text(1), None);
            let y = row.number() as f64 + if row.text(0) == Some("up") { 10.0 } else { 0.0 };
            out.push(Answer::ok(vec![y]));
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
        let spec = Spec {
            required: vec!["x".into()],
            optional: vec!["k".into()],
            outputs: vec!["y".into()],
            ..Spec::default()
        };
        let table = Table::from_reader(Box::new(text), "in.csv".into())?;
        run(table, &Output::csv(&out), &spec, |row, out| {
            let k = if row.get(1).is_nan() { 1.0 } else { row.get(1) };
            out.push(Answer::ok(vec![row.get(0) * k]));
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

    /// What RFC 4180 says of quotes is kept; a quote that it does not allow spoils its own row.
    #[test]
    fn a_quote_that_is_not_closed_costs_its_own_row_and_no_other() {
        let rows =
            |text: &'static str| -> Vec<String> { through(text).unwrap().lines().skip(1).map(String::from).collect() };
        let never = "refused: the quote that opens on line 3 is never closed";
        assert_eq!(
            rows("note,x\na,1\n\"b,2\nc,3\nd,4\n"),
            ["a,1,1.0,ok", &format!("\"\"\"b,2\",,,{never}"), "c,3,3.0,ok", "d,4,4.0,ok"]
        );
        // The quotes of a later row do not close it.
        let wrong = "refused: the quote that opens on line 2 is closed in the middle of a cell";
        assert_eq!(
            rows("note,x\r\n\"b,2\r\n\"c\",3\r\n\r\nd,4"),
            [&format!("\"\"\"b,2\",,,{wrong}"), "c,3,3.0,ok", "d,4,4.0,ok"]
        );
        // Neither do a thousand rows without one.
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
