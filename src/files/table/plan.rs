//! How a table's rows become lines of answers: which columns are read, which are carried through, and how cells are
//! written.

use super::cell::{self, Cell, Possible};
use super::physical_range::repeated;
use super::record::Splitter;
use super::rows::{RowBlock, RowStart};
use super::sink::is_formula;
use super::{
    Answering, BatchSpec, InputRow, InputTable, OutputRow, RowTally, TableRecord, push_cell, push_number, push_text,
};
use crate::{Error, Result, progress};
use mesophyll_base::error::Status;
use rayon::prelude::*;
use std::collections::HashSet;

/// Positions of columns, found once.
pub(super) struct Plan {
    width: usize,
    separator: u8,
    decimal_comma: bool,
    numbers: Vec<Column>,
    texts: Vec<Option<usize>>,
    carried: Vec<usize>,
    /// Which output columns are whole numbers.
    whole: Vec<bool>,
}

/// A column of numbers.
struct Column {
    /// Its position, where the table has it.
    at: Option<usize>,
    name: String,
    /// Whether a row without this number is refused.
    needed: bool,
    /// Whether a bad cell costs only itself.
    reading: bool,
    possible: Possible,
}

/// What was answered of a block, in order.
pub(super) struct Part {
    pub bytes: Vec<u8>,
    pub tally: RowTally,
    /// How many lines of the file have an answer.
    pub lines: u64,
    pub stated: Stated,
}

/// Cells with a number that means that there is no reading.
#[derive(Debug, Clone, Default)]
pub(super) struct Stated {
    pub count: usize,
    /// One of them, as it is written.
    pub example: String,
}

impl Stated {
    fn see(&mut self, text: &str) {
        if self.count == 0 {
            self.example = text.to_string();
        }
        self.count += 1;
    }

    pub fn add(&mut self, part: &Stated) {
        if self.count == 0 {
            self.example.clone_from(&part.example);
        }
        self.count += part.count;
    }

    /// Says on standard error how many cells were taken for missing readings.
    pub fn say(&self, table: &InputTable) {
        if self.count > 0 {
            let cells = super::counted(self.count, "cell");
            let name = table.name().display();
            progress::say(format!("{name}: {cells} with a number such as {} read as missing", self.example));
        }
    }
}

impl Plan {
    pub(super) fn new(table: &InputTable, spec: &BatchSpec) -> Result<Plan> {
        let readings: HashSet<&String> = spec.readings.iter().collect();
        let column = |name: &String, at: Option<usize>, needed: bool| Column {
            at,
            name: name.clone(),
            needed,
            reading: readings.contains(name),
            possible: Possible::ANY,
        };
        let mut numbers = Vec::new();
        for name in &spec.required {
            numbers.push(column(name, Some(table.require(name)?), true));
        }
        for name in &spec.optional {
            numbers.push(column(name, table.column(name), false));
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
        let mut plan = Plan {
            width: table.header.len(),
            separator: table.dialect.separator,
            decimal_comma: table.dialect.decimal_comma,
            numbers,
            texts,
            carried,
            whole: whole(spec),
        };
        for physical in &spec.physical {
            let repeated = repeated(physical.range, table.head(&physical.columns).into_iter());
            say_repeated(table, repeated, &physical.columns);
            plan.bound(&physical.columns, Possible { range: physical.range, repeated });
        }
        Ok(plan)
    }

    /// Sets what is possible in some columns.
    pub(super) fn bound(&mut self, columns: &[String], possible: Possible) {
        let columns: HashSet<&String> = columns.iter().collect();
        self.numbers.iter_mut().filter(|c| columns.contains(&c.name)).for_each(|c| c.possible = possible);
    }

    pub(super) fn header_line(&self, table: &InputTable, spec: &BatchSpec) -> Vec<u8> {
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

    /// Answers all rows of a block, in consecutive parts.
    pub(super) fn compute(&self, block: &RowBlock, spec: &BatchSpec, f: &Answering) -> Vec<Part> {
        let chunk = block.rows.len().div_ceil(rayon::current_num_threads() * 4).max(16);
        let parts = block.rows.par_chunks(chunk).enumerate();
        let answer = |(part, rows): (usize, &[RowStart])| {
            let (bytes, tally) = (Vec::with_capacity(rows.len() * 128), RowTally::new(&spec.outputs));
            let mut done = Part { bytes, tally, lines: 0, stated: Stated::default() };
            let (mut splitter, mut record) = (Splitter::new(self.separator), TableRecord::default());
            let (mut values, mut faults, mut answers) = (Vec::new(), Vec::new(), Vec::new());
            for (k, row) in rows.iter().enumerate() {
                let place = part * chunk + k;
                let end = block.rows.get(place + 1).map_or(block.bytes.len(), |next| next.start);
                let sound = splitter.split(&block.bytes[row.start..end], row.plain, &mut record);
                record.line = row.line;
                record.unclosed = block.fault(place).cloned();
                answers.clear();
                match self.numbers(&record, spec, &mut values, &mut faults, &mut done.stated) {
                    Ok(()) => {
                        let (values, record, texts, number) = (&values[..], &record, &self.texts[..], row.number);
                        f(&InputRow { values, record, texts, number, faults: &faults }, &mut answers)
                    }
                    Err(why) => answers.push(OutputRow::refused(why)),
                }
                debug_assert!(answers.iter().all(|a| a.values.is_empty() || a.values.len() == spec.outputs.len()));
                for answer in &answers {
                    done.tally.count(&answer.status, &answer.values);
                    self.write_row(&mut done.bytes, &record, answer);
                }
                done.lines += if sound && !answers.is_empty() { row.lines } else { 0 };
            }
            done
        };
        parts.map(answer).collect()
    }

    /// The word in each column of words; `None` where there is no such column.
    pub(super) fn words<'a>(&'a self, record: &'a TableRecord) -> impl Iterator<Item = Option<&'a str>> {
        self.texts.iter().map(|at| record.text(*at).and_then(|text| text.ok()))
    }

    /// The numbers of a row, or what is wrong with the row: with its numbers, or with its words. `faults` are the
    /// readings that cannot be read, each with the place of its column.
    pub(super) fn numbers(
        &self,
        record: &TableRecord,
        spec: &BatchSpec,
        values: &mut Vec<f64>,
        faults: &mut Vec<(usize, String)>,
        stated: &mut Stated,
    ) -> std::result::Result<(), String> {
        values.clear();
        faults.clear();
        if let Some(fault) = record.fault(self.width) {
            return Err(fault);
        }
        for (k, column) in self.numbers.iter().enumerate() {
            let Some(at) = column.at else {
                values.push(f64::NAN);
                continue;
            };
            let why = match std::str::from_utf8(record.bytes(at)) {
                Err(_) => format!("{} is not valid UTF-8 text; expected a number", column.name),
                Ok(text) => match cell::read(text, self.decimal_comma, &column.possible) {
                    Cell::Number(v) => {
                        values.push(v);
                        continue;
                    }
                    // A missing reading in an optional column is no fault.
                    found @ (Cell::Missing | Cell::Stated) if !column.needed => {
                        if found == Cell::Stated {
                            stated.see(text);
                        }
                        values.push(f64::NAN);
                        continue;
                    }
                    found => cell::complaint(&column.name, text, found, self.decimal_comma),
                },
            };
            if !column.reading {
                return Err(why);
            }
            faults.push((k, why));
            values.push(f64::NAN);
        }
        match self.texts.iter().zip(&spec.texts).find(|(at, _)| record.text(**at).is_some_and(|text| text.is_err())) {
            Some((_, name)) => Err(format!("{name} is not valid UTF-8 text; expected a word")),
            None => Ok(()),
        }
    }

    pub(super) fn write_row(&self, bytes: &mut Vec<u8>, record: &TableRecord, answer: &OutputRow) {
        for &k in &self.carried {
            let cell = record.bytes(k);
            if record.is_exact() && !is_formula(cell) {
                bytes.extend_from_slice(cell)
            } else {
                push_cell(bytes, cell)
            }
            bytes.push(b',');
        }
        push_cells(bytes, answer, &self.whole);
    }
}

/// Says which value is taken for a missing reading because it is repeated and impossible.
pub(super) fn say_repeated(table: &InputTable, value: Option<f64>, columns: &[String]) {
    let Some(value) = value else { return };
    let there: Vec<&str> = columns.iter().map(String::as_str).filter(|c| table.column(c).is_some()).collect();
    let more = if there.len() > 4 { format!(" and {} more columns", there.len() - 4) } else { String::new() };
    let shown = there[..there.len().min(4)].join(", ");
    let name = table.name().display();
    progress::say(format!("{name}: {value} is repeated and no possible value of {shown}{more}; it is read as missing"));
}

/// Which output columns are whole numbers.
pub(super) fn whole(spec: &BatchSpec) -> Vec<bool> {
    spec.outputs.iter().map(|name| spec.whole.contains(name)).collect()
}

/// Output cells and status of a row, and the end of its line.
pub(super) fn push_cells(bytes: &mut Vec<u8>, answer: &OutputRow, whole: &[bool]) {
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
