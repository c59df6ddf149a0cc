//! The rows of a CSV as they are in the file, and the treatment of quotes that are opened and never closed.
//!
//! A CSV reader takes everything from such a quote up to the next one for one cell, so one stray quote swallows the
//! rows after it. [`Rows`] finds where rows end. It passes well-formed text through unchanged and mends a row whose
//! quote is not closed, so that this row stays one row and the rows after it are rows again. It does not look at cells,
//! so one thread can find the rows that all other threads split.

use super::source::{Record, Splitter};
use memchr::{memchr, memchr_iter, memrchr};
use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader, Read};

/// A quoted cell may hold line breaks, but not more lines or bytes than these.
const MOST_LINES: usize = 100;
const MOST_BYTES: usize = 1 << 20;
/// A line may not be longer than this (bytes); a longer one is not part of a table.
const LONGEST_LINE: usize = 1 << 26;

/// Whole rows, each ending in a line feed.
#[derive(Debug, Default)]
pub struct Block {
    /// The rows as they are in the file, without blank lines.
    pub bytes: Vec<u8>,
    /// Where each row begins.
    pub rows: Vec<At>,
    /// Rows whose quotes make no sense: their place in `rows`, and why.
    faults: Vec<(usize, String)>,
}

/// The beginning of a row.
#[derive(Debug, Clone, Copy)]
pub struct At {
    /// Its first byte.
    pub start: usize,
    /// Which row of the file it is, counted from 0; the header is row 0.
    pub number: usize,
    /// Whether it is one line without quotes and carriage returns, whose cells are what stands between the commas.
    pub plain: bool,
}

impl Block {
    /// Forgets all rows.
    pub fn clear(&mut self) {
        self.bytes.clear();
        self.rows.clear();
        self.faults.clear();
    }

    /// Why the quotes of the row at this place make no sense, if so.
    pub fn fault(&self, place: usize) -> Option<&String> {
        self.faults.iter().find(|(row, _)| *row == place).map(|(_, why)| why)
    }
}

/// A CSV as whole rows with its unclosed quotes mended; see the module.
pub struct Rows<R> {
    source: BufReader<R>,
    /// Lines that were read ahead in search of a closing quote and are still to be looked at.
    ahead: VecDeque<Vec<u8>>,
    /// Number of the next line, from 1.
    line: u64,
    /// Number of the next row.
    number: usize,
}

/// Where a line's text ends.
enum End {
    /// Outside quotes.
    Whole,
    /// Inside the quotes that opened at this byte.
    Open(usize),
    /// The quotes that opened at this byte close in the middle of a cell.
    Wrong(usize),
}

impl<R: Read> Rows<R> {
    pub fn new(source: R) -> Self {
        Rows { source: BufReader::with_capacity(1 << 18, source), ahead: VecDeque::new(), line: 1, number: 0 }
    }

    /// Number of the next line, from 1.
    pub fn line(&self) -> u64 {
        self.line
    }

    /// Adds the next line with its end to `bytes`; nothing at the end of the file.
    fn next_line(&mut self, bytes: &mut Vec<u8>) -> io::Result<()> {
        if let Some(line) = self.ahead.pop_front() {
            bytes.extend_from_slice(&line);
            return Ok(());
        }
        if (&mut self.source).take(LONGEST_LINE as u64).read_until(b'\n', bytes)? == LONGEST_LINE {
            let what = format!("line {} is longer than {} MiB, expected a table", self.line, LONGEST_LINE >> 20);
            return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
        }
        Ok(())
    }

    /// Adds the lines without quotes that are in memory already, until `block` has `most` rows: the same rows as by
    /// [`Rows::next`], in a fifth of the time.
    pub fn in_memory(&mut self, block: &mut Block, most: usize) -> io::Result<()> {
        if !self.ahead.is_empty() {
            return Ok(());
        }
        let seen = self.source.fill_buf()?;
        let seen = &seen[..memchr(b'"', seen).unwrap_or(seen.len())];
        let seen = &seen[..memrchr(b'\n', seen).map_or(0, |last| last + 1)];
        let returns = memchr(b'\r', seen).is_some();
        let mut taken = 0;
        for end in memchr_iter(b'\n', seen) {
            let line = &seen[taken..=end];
            let text = &line[..line.len() - if line.ends_with(b"\r\n") { 2 } else { 1 }];
            if block.rows.len() >= most || returns && text.contains(&b'\r') {
                break;
            }
            if !text.is_empty() {
                block.rows.push(At { start: block.bytes.len(), number: self.number, plain: true });
                block.bytes.extend_from_slice(line);
                self.number += 1;
            }
            self.line += 1;
            taken = end + 1;
        }
        self.source.consume(taken);
        Ok(())
    }

    /// Adds the next row to `block`; false at the end of the file.
    pub fn next(&mut self, block: &mut Block) -> io::Result<bool> {
        loop {
            let start = block.bytes.len();
            self.next_line(&mut block.bytes)?;
            let line = &block.bytes[start..];
            if line.is_empty() {
                return Ok(false);
            }
            if line.contains(&b'"') {
                let first = block.bytes.split_off(start);
                self.quoted(first, block)?;
                return Ok(true);
            }
            self.line += 1;
            if !line.ends_with(b"\n") {
                block.bytes.push(b'\n');
            }
            if self.add(block, start) {
                return Ok(true);
            }
        }
    }

    /// Makes a row of what was added to `block` from `start` on; returns false where it is blank. Like a CSV reader, it
    /// also takes a bare carriage return outside quotes for the end of a row.
    fn add(&mut self, block: &mut Block, start: usize) -> bool {
        let row = &block.bytes[start..];
        let end = row.len() - if row.ends_with(b"\r\n") { 2 } else { 1 };
        let text = &row[..end];
        let plain = !text.contains(&b'\r') && !text.contains(&b'"');
        let count = if text.contains(&b'\r') {
            let (mut rest, mut splitter, mut record) = (row, Splitter::default(), Record::default());
            std::iter::from_fn(|| splitter.split(&mut rest, false, &mut record).then_some(())).count()
        } else {
            usize::from(!text.is_empty())
        };
        if count == 0 {
            block.bytes.truncate(start);
            return false;
        }
        block.rows.push(At { start, number: self.number, plain });
        self.number += count;
        true
    }

    /// A row that begins with `first`, which holds a quote.
    fn quoted(&mut self, first: Vec<u8>, block: &mut Block) -> io::Result<()> {
        let start = block.bytes.len();
        let (mut row, mut lines, mut taken) = (first.clone(), 1, Vec::new());
        let why = loop {
            match scan(&row) {
                End::Whole => {
                    if !row.ends_with(b"\n") {
                        row.push(b'\n');
                    }
                    block.bytes.extend_from_slice(&row);
                    self.add(block, start);
                    self.line += lines as u64;
                    return Ok(());
                }
                End::Wrong(_) => break "is closed in the middle of a cell",
                End::Open(_) if lines == MOST_LINES || row.len() > MOST_BYTES => {
                    break "is not closed on the lines that follow";
                }
                End::Open(_) => {
                    let mut next = Vec::new();
                    self.next_line(&mut next)?;
                    if next.is_empty() {
                        break "is never closed";
                    }
                    row.extend_from_slice(&next);
                    taken.push(next);
                    lines += 1;
                }
            }
        };
        taken.into_iter().rev().for_each(|line| self.ahead.push_front(line));
        block.faults.push((block.rows.len(), format!("the quote that opens on line {} {why}", self.line)));
        // The quote at fault is the one that leaves the first line open.
        let opened = match scan(&first) {
            End::Open(at) | End::Wrong(at) => at,
            End::Whole => first.len(),
        };
        block.bytes.extend_from_slice(&first[..opened]);
        // The rest of the line becomes one cell, as it is.
        let rest = &first[opened..];
        let text = rest.trim_ascii_end();
        block.bytes.push(b'"');
        for &b in text {
            if b == b'"' {
                block.bytes.push(b'"');
            }
            block.bytes.push(b);
        }
        block.bytes.extend_from_slice(b"\"\n");
        self.add(block, start);
        self.line += 1;
        Ok(())
    }
}

/// Reads the cells of `row` up to its end or to the first quote that is wrong.
fn scan(row: &[u8]) -> End {
    let mut k = 0;
    loop {
        // At the start of a cell.
        if row.get(k) != Some(&b'"') {
            match row[k..].iter().position(|b| matches!(b, b',' | b'\r' | b'\n')) {
                Some(n) if row[k + n] != b'\n' => {
                    k += n + 1;
                    continue;
                }
                _ => return End::Whole,
            }
        }
        let opened = k;
        k += 1;
        loop {
            match row[k..].iter().position(|b| *b == b'"') {
                None => return End::Open(opened),
                Some(n) if row.get(k + n + 1) == Some(&b'"') => k += n + 2,
                Some(n) => {
                    k += n + 1;
                    break;
                }
            }
        }
        // After the closing quote: blanks, then the next cell or the end of the row.
        while matches!(row.get(k), Some(b' ' | b'\t')) {
            k += 1;
        }
        match row.get(k) {
            Some(b',' | b'\r') => k += 1,
            None | Some(b'\n') => return End::Whole,
            Some(_) => return End::Wrong(opened),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::table::{Record, Table};
    use proptest::prelude::*;
    use std::path::PathBuf;

    /// The rows of a text, and whether one of its quotes made no sense.
    fn ours(text: &str) -> (Vec<Vec<String>>, bool) {
        let mut table =
            Table::from_reader(Box::new(std::io::Cursor::new(text.to_string())), PathBuf::from("-")).unwrap();
        let (mut rows, mut record, mut faulty) = (Vec::new(), Record::default(), false);
        while table.next_record(&mut record).unwrap() {
            faulty |= record.fault(record.len()).is_some();
            rows.push((0..record.len()).map(|k| record.shown(k).into_owned()).collect());
        }
        (rows, faulty)
    }

    fn by_the_crate(text: &str) -> Vec<Vec<String>> {
        let mut reader = csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).from_reader(text.as_bytes());
        reader.records().map(|r| r.unwrap().iter().map(String::from).collect()).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

        /// Text without a broken quote is read as the `csv` crate reads it.
        #[test]
        fn rows_are_those_of_the_csv_crate(body in "[a1, \"\r\n]{0,60}") {
            let text = format!("x,y\n{body}");
            let (rows, faulty) = ours(&text);
            if !faulty {
                prop_assert_eq!(rows, by_the_crate(&text));
            }
        }

        /// Well-formed cells are read back as they were written, even with quotes and line breaks.
        #[test]
        fn quoted_cells_come_back(cells in prop::collection::vec("[a1,\"\n]{1,9}", 1..12)) {
            let quoted = |c: &String| format!("\"{}\"", c.replace('"', "\"\""));
            let text = format!("x\n{}", cells.iter().map(|c| quoted(c) + "\n").collect::<String>());
            let (rows, faulty) = ours(&text);
            prop_assert!(!faulty);
            let trimmed: Vec<Vec<String>> = cells.iter().map(|c| vec![c.trim().to_string()]).collect();
            prop_assert_eq!(rows, trimmed);
        }
    }
}
