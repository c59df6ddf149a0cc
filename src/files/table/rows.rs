//! The rows of a CSV as they are in the file, and the treatment of quotes that are opened and never closed.
//!
//! A CSV reader takes everything from such a quote up to the next one for one cell, so one stray quote swallows the
//! rows after it. [`TableRows`] finds where rows end. It passes well-formed text through unchanged and mends a row
//! whose quote is not closed, so that this row stays one row and the rows after it are rows again. It does not look at
//! cells, so one thread can find the rows that all other threads split.

use super::dialect::Dialect;
use super::lines::{Lines, filled};
use memchr::{memchr, memchr_iter, memchr2, memchr2_iter};
use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader, Read};

/// A quoted cell may hold line breaks, but not more lines or bytes than these.
const MOST_LINES: usize = 100;
const MOST_BYTES: usize = 1 << 20;
/// A line may not be longer than this (bytes); a longer one is not part of a table.
const LONGEST_LINE: usize = 1 << 26;

/// Bytes of a block of rows: wide traces are read in smaller blocks.
pub const LARGEST_BLOCK: usize = 1 << 24;

/// Whole rows, each ending in a line end.
#[derive(Debug, Default)]
pub struct RowBlock {
    /// The rows as they are in the file, without blank lines.
    pub bytes: Vec<u8>,
    /// Where each row begins.
    pub rows: Vec<RowStart>,
    /// Rows whose quotes make no sense: their place in `rows`, and why.
    faults: Vec<(usize, String)>,
}

/// The beginning of a row.
#[derive(Debug, Clone, Copy)]
pub struct RowStart {
    /// Its first byte.
    pub start: usize,
    /// Which row of the file it is, counted from 0; the header is row 0.
    pub number: usize,
    /// The line of the file in which it begins, counted from 1.
    pub line: usize,
    /// How many lines of the file it takes, without blank ones.
    pub lines: u64,
    /// Whether it is one line without quotes, whose cells are what stands between the separators.
    pub plain: bool,
}

impl RowBlock {
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

/// A table as whole rows with its unclosed quotes mended; see the module. A line feed, a carriage return, and both
/// together end a line alike.
pub struct TableRows<R> {
    source: BufReader<Lines<R>>,
    separator: u8,
    /// Whether runs of blanks separate the cells.
    blanks: bool,
    /// Lines that were read ahead in search of a closing quote and are still to be looked at.
    ahead: VecDeque<Vec<u8>>,
    /// Number of the next line, from 1.
    line: usize,
    /// Number of the next row.
    number: usize,
    /// The lines of another file that the rows stand for, without the header's.
    stands_for: Vec<usize>,
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

impl<R: Read> TableRows<R> {
    pub fn new(source: R, dialect: &Dialect) -> Self {
        let source = BufReader::with_capacity(1 << 18, Lines::new(source));
        let (separator, blanks) = (dialect.separator, dialect.blanks);
        TableRows { source, separator, blanks, ahead: VecDeque::new(), line: 1, number: 0, stands_for: Vec::new() }
    }

    /// Makes the rows below the header name the lines of another file.
    pub fn stand_for(&mut self, lines: Vec<usize>) {
        self.stands_for = lines;
    }

    fn named(&self, line: usize) -> usize {
        self.number.checked_sub(1).and_then(|row| self.stands_for.get(row)).copied().unwrap_or(line)
    }

    /// Number of the next line, from 1.
    pub fn line(&self) -> usize {
        self.line
    }

    /// How many lines that are not empty were read from the source. They include those that are still to be cut, so
    /// this is the number in the file only at its end.
    pub fn lines_read(&self) -> u64 {
        self.source.get_ref().count()
    }

    /// Passes over `count` lines; the answer is how many of them hold anything.
    pub fn skip(&mut self, count: usize) -> io::Result<u64> {
        let (mut line, mut held) = (Vec::new(), 0);
        for _ in 0..count {
            line.clear();
            self.next_line(&mut line)?;
            self.line += 1;
            held += filled(&line);
        }
        Ok(held)
    }

    /// Adds the next line with its end to `bytes`; nothing at the end of the file.
    fn next_line(&mut self, bytes: &mut Vec<u8>) -> io::Result<()> {
        if let Some(line) = self.ahead.pop_front() {
            bytes.extend_from_slice(&line);
            return Ok(());
        }
        let start = bytes.len();
        loop {
            let seen = self.source.fill_buf()?;
            let found = memchr2(b'\n', b'\r', seen);
            let end = found.map_or(seen.len(), |at| at + 1);
            bytes.extend_from_slice(&seen[..end]);
            self.source.consume(end);
            if bytes.len() - start > LONGEST_LINE {
                let what = format!("line {} is longer than {} MiB, expected a table", self.line, LONGEST_LINE >> 20);
                return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
            }
            if found.is_some() || end == 0 {
                break;
            }
        }
        // The line feed that follows a carriage return ends the same line.
        if bytes.ends_with(b"\r") && bytes.len() > start && self.source.fill_buf()?.first() == Some(&b'\n') {
            self.source.consume(1);
            bytes.push(b'\n');
        }
        Ok(())
    }

    /// Adds the lines without quotes that are in memory already, until `block` has `most` rows: the same rows as by
    /// [`TableRows::next`], in a fifth of the time.
    pub fn in_memory(&mut self, block: &mut RowBlock, most: usize) -> io::Result<()> {
        if !self.ahead.is_empty() || self.blanks || !self.stands_for.is_empty() {
            return Ok(());
        }
        let seen = self.source.fill_buf()?;
        let seen = &seen[..memchr(b'"', seen).unwrap_or(seen.len())];
        let (mut taken, line, number) = (0, &mut self.line, &mut self.number);
        // Takes the line that ends at a place; false where no more can be taken.
        let mut take = |at: usize| {
            if at < taken {
                // The line feed after a carriage return.
                return true;
            }
            let end = match (seen[at], seen.get(at + 1)) {
                (b'\n', _) => at + 1,
                (_, Some(b'\n')) => at + 2,
                (_, Some(_)) => at + 1,
                (_, None) => return false,
            };
            if block.rows.len() >= most || block.bytes.len() >= LARGEST_BLOCK {
                return false;
            }
            if at > taken {
                let start = block.bytes.len();
                block.rows.push(RowStart { start, number: *number, line: *line, lines: 1, plain: true });
                block.bytes.extend_from_slice(&seen[taken..end]);
                *number += 1;
            }
            *line += 1;
            taken = end;
            true
        };
        if memchr(b'\r', seen).is_some() {
            let _ = memchr2_iter(b'\n', b'\r', seen).all(&mut take);
        } else {
            let _ = memchr_iter(b'\n', seen).all(&mut take);
        }
        self.source.consume(taken);
        Ok(())
    }

    /// Adds the next row to `block`; false at the end of the file.
    pub fn next(&mut self, block: &mut RowBlock) -> io::Result<bool> {
        loop {
            let start = block.bytes.len();
            self.next_line(&mut block.bytes)?;
            let line = &block.bytes[start..];
            if line.is_empty() {
                return Ok(false);
            }
            if line.contains(&b'"') && !self.blanks {
                let first = block.bytes.split_off(start);
                self.quoted(first, block)?;
                return Ok(true);
            }
            let filled = self.add(block, start, 1);
            self.line += 1;
            if filled {
                return Ok(true);
            }
        }
    }

    /// Makes a row of what was added to `block` from `start` on, which took `lines` lines of the file; returns false
    /// where it is blank.
    fn add(&mut self, block: &mut RowBlock, start: usize, lines: u64) -> bool {
        let text = text_of(&block.bytes[start..]);
        if text.is_empty() {
            block.bytes.truncate(start);
            return false;
        }
        let plain = self.blanks || !text.contains(&b'"');
        if self.blanks {
            let words: Vec<&[u8]> = text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).collect();
            let joined = words.join(&self.separator);
            block.bytes.truncate(start);
            block.bytes.extend_from_slice(&joined);
        } else {
            let end = start + text.len();
            block.bytes.truncate(end);
        }
        block.bytes.push(b'\n');
        block.rows.push(RowStart { start, number: self.number, line: self.named(self.line), lines, plain });
        self.number += 1;
        true
    }

    /// A row that begins with `first`, which holds a quote.
    fn quoted(&mut self, first: Vec<u8>, block: &mut RowBlock) -> io::Result<()> {
        let start = block.bytes.len();
        let (mut row, mut lines, mut taken) = (first.clone(), 1, Vec::new());
        let why = loop {
            match scan(&row, self.separator) {
                End::Whole => {
                    block.bytes.extend_from_slice(&row);
                    self.add(block, start, filled(&row));
                    self.line += lines;
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
        let opened = match scan(&first, self.separator) {
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
        self.add(block, start, 1);
        self.line += 1;
        Ok(())
    }
}

/// A line or row without its end.
fn text_of(row: &[u8]) -> &[u8] {
    let row = row.strip_suffix(b"\n").unwrap_or(row);
    row.strip_suffix(b"\r").unwrap_or(row)
}

/// Reads the cells of `row` up to its end or to the first quote that is wrong.
fn scan(row: &[u8], separator: u8) -> End {
    let mut k = 0;
    loop {
        // At the start of a cell.
        if row.get(k) != Some(&b'"') {
            match row[k..].iter().position(|b| *b == separator || matches!(b, b'\r' | b'\n')) {
                Some(n) if row[k + n] == separator => {
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
        while row.get(k).is_some_and(|b| *b != separator && matches!(b, b' ' | b'\t')) {
            k += 1;
        }
        match row.get(k) {
            None | Some(b'\r' | b'\n') => return End::Whole,
            Some(b) if *b == separator => k += 1,
            Some(_) => return End::Wrong(opened),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::table::{InputTable, TableRecord};
    use proptest::prelude::*;
    use std::path::PathBuf;

    /// The rows of a text, and whether one of its quotes made no sense.
    fn ours(text: &str) -> (Vec<Vec<String>>, bool) {
        let mut table =
            InputTable::from_reader(Box::new(std::io::Cursor::new(text.to_string())), PathBuf::from("-")).unwrap();
        let (mut rows, mut record, mut faulty) = (Vec::new(), TableRecord::default(), false);
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
