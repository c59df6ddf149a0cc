//! Quotes that are opened and never closed. A CSV reader takes everything up to the next quote for one cell, so that
//! one stray quote swallows the rows after it. [`Quotes`] stands between a file and its reader: it passes well-formed
//! text through as it is, and mends a row whose quote is not closed, so that the row stays one row and the rows after
//! it are rows again.

use std::collections::BTreeMap;
use std::io::{self, BufRead, BufReader, Read};
use std::sync::{Arc, Mutex, PoisonError};

/// A quoted cell may hold line breaks, but not more lines or bytes than these.
const MOST_LINES: usize = 100;
const MOST_BYTES: usize = 1 << 20;
/// A line may not be longer than this (bytes): something else than a table is being read.
const LONGEST_LINE: usize = 1 << 26;

/// The lines (from 1) whose quote is not closed, with the reason.
#[derive(Debug, Clone, Default)]
pub struct Faults(Arc<Mutex<BTreeMap<u64, String>>>);

impl Faults {
    /// The fault of a row on one of these lines (which may be blank up to the row).
    pub fn on(&self, lines: std::ops::Range<u64>) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).range(lines).next().map(|(_, why)| why.clone())
    }

    fn add(&self, line: u64, why: String) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(line, why);
    }
}

/// A CSV with its unclosed quotes mended; see the module.
pub struct Quotes<R> {
    source: BufReader<R>,
    /// Lines that were read ahead in search of a closing quote and are still to be looked at.
    ahead: std::collections::VecDeque<Vec<u8>>,
    ready: Vec<u8>,
    given: usize,
    /// Number of the next line, from 1.
    line: u64,
    faults: Faults,
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

impl<R: Read> Quotes<R> {
    pub fn new(source: R, faults: Faults) -> Self {
        Quotes {
            source: BufReader::with_capacity(1 << 18, source),
            ahead: Default::default(),
            ready: Vec::new(),
            given: 0,
            line: 1,
            faults,
        }
    }

    /// The next line with its end; empty at the end of the file.
    fn next_line(&mut self) -> io::Result<Vec<u8>> {
        if let Some(line) = self.ahead.pop_front() {
            return Ok(line);
        }
        let mut line = Vec::new();
        (&mut self.source).take(LONGEST_LINE as u64).read_until(b'\n', &mut line)?;
        if line.len() == LONGEST_LINE {
            let what = format!("line {} is longer than {} MiB, expected a table", self.line, LONGEST_LINE >> 20);
            return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
        }
        Ok(line)
    }

    /// Makes a whole row ready. Its end becomes a plain line feed, so that the reader counts lines as this does.
    fn push(&mut self, row: &[u8]) {
        match row.strip_suffix(b"\r\n") {
            Some(text) => {
                self.ready.extend_from_slice(text);
                self.ready.push(b'\n');
            }
            None => self.ready.extend_from_slice(row),
        }
    }

    /// Makes the next rows ready.
    fn fill(&mut self) -> io::Result<()> {
        self.ready.clear();
        self.given = 0;
        while self.ready.len() < 1 << 17 {
            let line = self.next_line()?;
            if line.is_empty() {
                return Ok(());
            }
            if line.contains(&b'"') {
                self.quoted(line)?;
            } else {
                self.push(&line);
                self.line += 1;
            }
        }
        Ok(())
    }

    /// A row that begins with `first`, which holds a quote.
    fn quoted(&mut self, first: Vec<u8>) -> io::Result<()> {
        let (mut row, mut lines, mut taken) = (first.clone(), 1, Vec::new());
        let why = loop {
            match scan(&row) {
                End::Whole => {
                    self.push(&row);
                    self.line += lines as u64;
                    return Ok(());
                }
                End::Wrong(_) => break "is closed in the middle of a cell",
                End::Open(_) if lines == MOST_LINES || row.len() > MOST_BYTES => {
                    break "is not closed on the lines that follow";
                }
                End::Open(_) => {
                    let next = self.next_line()?;
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
        self.faults.add(self.line, format!("the quote that opens on line {} {why}", self.line));
        // The quote at fault is the one that leaves the first line open.
        let opened = match scan(&first) {
            End::Open(at) | End::Wrong(at) => at,
            End::Whole => first.len(),
        };
        self.ready.extend_from_slice(&first[..opened]);
        // The rest of the line becomes one cell, as it stands there.
        let rest = &first[opened..];
        let text = rest.trim_ascii_end();
        self.ready.push(b'"');
        for &b in text {
            if b == b'"' {
                self.ready.push(b'"');
            }
            self.ready.push(b);
        }
        self.ready.extend_from_slice(b"\"\n");
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
            match row[k..].iter().position(|b| matches!(b, b',' | b'\n')) {
                Some(n) if row[k + n] == b',' => {
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

impl<R: Read> Read for Quotes<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.given == self.ready.len() {
            self.fill()?;
        }
        let n = out.len().min(self.ready.len() - self.given);
        out[..n].copy_from_slice(&self.ready[self.given..self.given + n]);
        self.given += n;
        Ok(n)
    }
}
