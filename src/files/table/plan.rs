//! How a table's rows become lines of answers: which columns are read, which are carried through, and how cells are
//! written.

use super::rows::{At, Block};
use super::source::Splitter;
use super::{Answer, Answering, Record, Row, Spec, Table, Tally, push_cell, push_number, push_text};
use crate::{Error, Result};
use mesophyll_error::Status;
use rayon::prelude::*;
use std::collections::HashSet;

/// Positions of columns, found once.
pub(super) struct Plan {
    width: usize,
    numbers: Vec<(Option<usize>, String, bool)>,
    texts: Vec<Option<usize>>,
    carried: Vec<usize>,
    /// Which output columns are whole numbers.
    whole: Vec<bool>,
}

impl Plan {
    pub(super) fn new(table: &Table, spec: &Spec) -> Result<Plan> {
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

    pub(super) fn header_line(&self, table: &Table, spec: &Spec) -> Vec<u8> {
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

    /// Answers all rows of a block, as lines in consecutive parts.
    pub(super) fn compute(&self, block: &Block, spec: &Spec, f: &Answering) -> Vec<(Vec<u8>, Tally)> {
        let chunk = block.rows.len().div_ceil(rayon::current_num_threads() * 4).max(16);
        let parts = block.rows.par_chunks(chunk).enumerate();
        let answer = |(part, rows): (usize, &[At])| {
            let (mut bytes, mut tally) = (Vec::with_capacity(rows.len() * 128), Tally::new(&spec.outputs));
            let (mut splitter, mut record) = (Splitter::default(), Record::default());
            let (mut values, mut answers) = (Vec::new(), Vec::new());
            for (k, row) in rows.iter().enumerate() {
                let place = part * chunk + k;
                let end = block.rows.get(place + 1).map_or(block.bytes.len(), |next| next.start);
                let mut text = &block.bytes[row.start..end];
                let mut number = row.number;
                while splitter.split(&mut text, row.plain, &mut record) {
                    record.unclosed = block.fault(place).cloned();
                    answers.clear();
                    match self.numbers(&record, spec, &mut values) {
                        Ok(()) => {
                            f(&Row { values: &values, record: &record, texts: &self.texts, number }, &mut answers)
                        }
                        Err(why) => answers.push(Answer::refused(why)),
                    }
                    debug_assert!(answers.iter().all(|a| a.values.is_empty() || a.values.len() == spec.outputs.len()));
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

    /// Numbers and words of a row, or what is wrong with the row.
    pub(super) fn parsed<'a>(
        &self,
        record: &'a Record,
        spec: &Spec,
    ) -> std::result::Result<(Vec<f64>, Vec<Option<&'a str>>), String> {
        let mut values = Vec::with_capacity(self.numbers.len());
        self.numbers(record, spec, &mut values)?;
        Ok((values, self.texts.iter().map(|at| record.text(*at).and_then(|text| text.ok())).collect()))
    }

    /// The numbers of a row, or what is wrong with the row: with its numbers, or with its words.
    fn numbers(&self, record: &Record, spec: &Spec, values: &mut Vec<f64>) -> std::result::Result<(), String> {
        if let Some(fault) = record.fault(self.width) {
            return Err(fault);
        }
        values.clear();
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
                // `nan` in an optional cell means the same as an empty cell: no reading.
                Ok(v) if !v.is_nan() || !needed => values.push(v),
                _ if text.is_empty() => return Err(format!("{name} is empty")),
                _ => return Err(format!("{name} is {text:?}; expected a number")),
            }
        }
        match self.texts.iter().zip(&spec.texts).find(|(at, _)| record.text(**at).is_some_and(|text| text.is_err())) {
            Some((_, name)) => Err(format!("{name} is not valid UTF-8 text; expected a word")),
            None => Ok(()),
        }
    }

    pub(super) fn write_row(&self, bytes: &mut Vec<u8>, record: &Record, answer: &Answer) {
        for &k in &self.carried {
            let cell = record.bytes(k);
            if record.is_plain() {
                bytes.extend_from_slice(cell)
            } else {
                push_cell(bytes, cell)
            }
            bytes.push(b',');
        }
        push_cells(bytes, answer, &self.whole);
    }
}

/// Which output columns are whole numbers.
pub(super) fn whole(spec: &Spec) -> Vec<bool> {
    spec.outputs.iter().map(|name| spec.whole.contains(name)).collect()
}

/// Output cells and status of a row, and the end of its line.
pub(super) fn push_cells(bytes: &mut Vec<u8>, answer: &Answer, whole: &[bool]) {
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
