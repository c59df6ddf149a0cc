//! A table as it is read: a header line that names the columns, then rows one at a time.

use super::cell::{self, Cell, Possible};
use super::dialect::Dialect;
use super::lines::{Encoding, FromUtf16};
use super::record::{Splitter, TableRecord};
use super::rows::{LARGEST_BLOCK, RowBlock, TableRows};
use crate::instrument::{self, InstrumentStatement};
use crate::{Error, Result};
use crate::{atomic, progress};
use flate2::read::MultiGzDecoder;
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Cursor, Read};
use std::path::{Path, PathBuf};

type Source = Box<dyn Read + Send>;

/// An opened table: its header is read, its rows are not.
pub struct InputTable {
    rows: TableRows<Source>,
    pub(super) dialect: Dialect,
    /// The row that [`InputTable::next_record`] reads, and what splits it.
    splitter: Splitter,
    block: RowBlock,
    /// The first bytes of the file, and whether they are all of it.
    head: (Vec<u8>, bool),
    /// How many lines that are not empty were passed over or became the header, and how many became rows.
    before: u64,
    handed: u64,
    name: PathBuf,
    /// The file, or `-`.
    source: PathBuf,
    /// What the file states besides its cells, where it is one of an instrument.
    stated: Option<InstrumentStatement>,
    /// Names of the columns.
    pub header: Vec<String>,
    places: HashMap<String, usize>,
}

/// More columns than this are a mistake: even traces of three channels and 10,000 frames have only 30,000.
const MOST_COLUMNS: usize = 65_536;

/// This much of a file is looked at before its rows are read (bytes), and more until there are some lines, but not more
/// than the second number.
const HEAD: usize = 1 << 20;
const LONGEST_HEAD: usize = 1 << 23;

/// This many names of a header are shown in a message.
const SHOWN: usize = 10;

/// What a source holds, and whether gzip packed it: where it begins as gzip does, it is unpacked.
///
/// # Errors
/// Those of the source.
pub fn unpacked(mut source: Box<dyn Read + Send>) -> io::Result<(Box<dyn Read + Send>, bool)> {
    let mut head = Vec::new();
    source.by_ref().take(2).read_to_end(&mut head)?;
    let packed = head == [0x1f, 0x8b];
    let whole = Cursor::new(head).chain(source);
    let whole: Source = if packed { Box::new(MultiGzDecoder::new(whole)) } else { Box::new(whole) };
    Ok((whole, packed))
}

impl InputTable {
    /// Opens `path` (`-`: standard input) and reads the header line. What gzip packed is unpacked, and a file of an
    /// instrument becomes a table first.
    ///
    /// # Errors
    /// [`Error::Input`] for a missing file, no header, or a column named twice.
    pub fn open(path: &Path) -> Result<InputTable> {
        let (source, name): (Source, PathBuf) = if path == Path::new("-") {
            (Box::new(io::stdin()), "standard input".into())
        } else {
            let file = File::open(path).map_err(|e| Error::input(path, atomic::explain(&e)))?;
            (Box::new(file), path.to_path_buf())
        };
        let (source, _) = unpacked(source).map_err(|e| Error::input(&name, atomic::explain(&e)))?;
        let (source, stated) = instrument::through(source, &name)?;
        Ok(InputTable { source: path.to_path_buf(), stated, ..InputTable::from_reader(source, name)? })
    }

    /// A table from any source; `name` takes the place of the file's name in messages. The form of the table is told by
    /// its first lines; where it is not the usual one, a line on standard error says so.
    ///
    /// # Errors
    /// As [`InputTable::open`].
    pub fn from_reader(source: Source, name: PathBuf) -> Result<InputTable> {
        let unreadable = |e: &io::Error| Error::input(&name, format!("line 1: {}", atomic::explain(e)));
        let (head, whole, rest, encoding) = begin(source).map_err(|e| unreadable(&e))?;
        let dialect = Dialect::of(&head, whole);
        let utf_16 = (encoding != Encoding::Utf8).then(|| "as UTF-16".to_string());
        let form = dialect.words().map(|words| match words.starts_with("separated") && utf_16.is_none() {
            true => format!("as {words}"),
            false => words,
        });
        let parts: Vec<String> = utf_16.iter().cloned().chain(form).collect();
        let mut rows: TableRows<Source> = TableRows::new(Box::new(Cursor::new(head.clone()).chain(rest)), &dialect);
        let before = rows.skip(dialect.skipped).map_err(|e| unreadable(&e))?;
        let mut table = InputTable {
            rows,
            splitter: Splitter::new(dialect.separator),
            dialect,
            block: RowBlock::default(),
            head: (head, whole),
            before,
            handed: 0,
            source: name.clone(),
            name,
            stated: None,
            header: Vec::new(),
            places: HashMap::new(),
        };
        table.read_header()?;
        if !parts.is_empty() {
            progress::say(format!("{}: read {}", table.name.display(), parts.join(", ")));
        }
        Ok(table)
    }

    /// This table as one that was made of another: `source` is the file that is read, and `lines` are the lines of that
    /// file that its rows come from, for messages.
    pub fn standing_for(mut self, source: &Path, lines: Vec<usize>) -> InputTable {
        self.source = source.to_path_buf();
        self.rows.stand_for(lines);
        self
    }

    fn read_header(&mut self) -> Result<()> {
        let mut record = TableRecord::default();
        self.next_record(&mut record)?;
        (self.before, self.handed) = (self.before + self.handed, 0);
        let name = &self.name;
        if let Some(why) = &record.unclosed {
            return Err(Error::input(name, format!("the header cannot be read: {why}")));
        }
        let line = record.line.max(1);
        let cell = |k: usize| match record.text(Some(k)) {
            // What was no text in UTF-16 is a replacement character.
            Some(Ok(text)) if !text.contains(char::REPLACEMENT_CHARACTER) => {
                Ok(text.trim_start_matches('\u{feff}').trim().to_string())
            }
            _ => Err(Error::input(name, format!("line {line}: not valid UTF-8 text"))),
        };
        let mut header = (0..record.len()).map(cell).collect::<Result<Vec<String>>>()?;
        if let Some(first) = header.first_mut() {
            *first = first.trim_start_matches(&self.dialect.mark).trim().to_string();
        }
        if header.iter().all(|h| h.is_empty()) {
            return Err(Error::input(name, "no header line; the first line must name the columns"));
        }
        if header.len() > MOST_COLUMNS {
            return Err(Error::input(name, format!("found {} columns, expected at most {MOST_COLUMNS}", header.len())));
        }
        let mut places = HashMap::new();
        for (k, h) in header.iter().enumerate() {
            // Spreadsheets leave columns without a name at the end.
            if places.insert(h.clone(), k).is_some() && !h.is_empty() {
                return Err(Error::field(name, h, "the header names this column twice"));
            }
        }
        (self.header, self.places) = (header, places);
        Ok(())
    }

    /// The file that is read; `-` for standard input.
    pub fn source(&self) -> &Path {
        &self.source
    }

    /// The file, or `-`.
    pub fn name(&self) -> &Path {
        &self.name
    }

    /// What the file states besides its cells; `None` for a plain table.
    pub fn stated(&self) -> Option<&InstrumentStatement> {
        self.stated.as_ref()
    }

    /// Position of a column.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.places.get(name).copied()
    }

    /// Position of a column that must be there.
    pub fn require(&self, name: &str) -> Result<usize> {
        self.column(name).ok_or_else(|| match &self.stated {
            Some(stated) => Error::input(&self.name, stated.lacks(name)),
            None => Error::field(&self.name, name, format!("no such column; the header has {}", self.shown_header())),
        })
    }

    /// The header for a message, shortened where it is long.
    pub fn shown_header(&self) -> String {
        let shown = self.header.iter().take(SHOWN).map(String::as_str).collect::<Vec<_>>().join(", ");
        if self.header.len() > SHOWN { format!("{shown} and {} more", self.header.len() - SHOWN) } else { shown }
    }

    /// The numbers of some columns in the first rows of the table (about the first MiB), row by row. Cells that hold no
    /// number are left out.
    pub fn head(&self, columns: &[String]) -> Vec<f64> {
        let places: Vec<usize> = columns.iter().filter_map(|name| self.column(name)).collect();
        let mut values = Vec::new();
        self.each_in_head(|record| {
            let numbers = places.iter().filter_map(|&k| self.number(record, k).ok().flatten());
            values.extend(numbers.filter(|v| v.is_finite()));
        });
        values
    }

    /// The words of a column in the first rows of the table; see [`InputTable::head`].
    pub fn head_words(&self, column: &str) -> Vec<String> {
        let mut words = Vec::new();
        if let Some(k) = self.column(column) {
            self.each_in_head(|record| words.push(record.shown(k).into_owned()));
        }
        words
    }

    /// Calls `see` with the whole rows of the file's first bytes.
    pub(super) fn each_in_head(&self, mut see: impl FnMut(&TableRecord)) {
        let (bytes, whole) = &self.head;
        let end = if *whole { bytes.len() } else { memchr::memrchr2(b'\n', b'\r', bytes).map_or(0, |at| at + 1) };
        let mut rows = TableRows::new(&bytes[..end], &self.dialect);
        let (mut splitter, mut record) = (self.splitter.clone(), TableRecord::default());
        let mut block = RowBlock::default();
        // Bytes in memory are read without errors.
        let _ = rows.skip(self.dialect.skipped);
        while rows.next(&mut block).unwrap_or(false) {
            let row = block.rows[0];
            let sound = splitter.split(&block.bytes, row.plain, &mut record);
            if sound && row.number > 0 && block.fault(0).is_none() && record.len() == self.header.len() {
                see(&record);
            }
            block.clear();
        }
    }

    /// The number in a cell; `None` where it says that there is no reading.
    ///
    /// # Errors
    /// The sentence that names the column, what was found, and what was expected.
    pub fn number(&self, record: &TableRecord, column: usize) -> std::result::Result<Option<f64>, String> {
        self.number_in(record, column, Possible::ANY.range)
    }

    /// As [`InputTable::number`], for a quantity that is always in `range`: numbers such as −999 outside it mean that
    /// there is no reading. Other numbers outside it are returned.
    ///
    /// # Errors
    /// As [`InputTable::number`].
    pub fn number_in(
        &self,
        record: &TableRecord,
        column: usize,
        range: [f64; 2],
    ) -> std::result::Result<Option<f64>, String> {
        let name = self.header.get(column).map_or("", String::as_str);
        let Ok(text) = std::str::from_utf8(record.bytes(column)) else {
            return Err(format!("{name} is not valid UTF-8 text; expected a number"));
        };
        match cell::read(text, self.dialect.decimal_comma, &Possible::within(range)) {
            Cell::Number(v) => Ok(Some(v)),
            Cell::Missing | Cell::Stated => Ok(None),
            found => Err(cell::complaint(name, text, found, self.dialect.decimal_comma)),
        }
    }

    /// The column of an angle, which is called `name` (radians) or `name_deg` (degrees), and the factor that converts
    /// its numbers to radians.
    ///
    /// # Errors
    /// [`Error::Input`] where the header has both.
    pub fn angle(&self, name: &str) -> Result<(String, f64)> {
        let degrees = format!("{name}_deg");
        match (self.column(name), self.column(&degrees)) {
            (Some(_), Some(_)) => {
                Err(Error::field(&self.name, name, format!("the header has {degrees} too; expected one of the two")))
            }
            (None, Some(_)) => Ok((degrees, 1f64.to_radians())),
            _ => Ok((name.to_string(), 1.0)),
        }
    }

    /// Reads the next row; returns false at the end. Rows may have a wrong number of cells or not be text: see
    /// [`TableRecord::fault`].
    ///
    /// # Errors
    /// [`Error::Input`] for a file that cannot be read, and where the rows that were read are not all lines of the
    /// file.
    pub fn next_record(&mut self, record: &mut TableRecord) -> Result<bool> {
        self.block.clear();
        if !self.rows.next(&mut self.block).map_err(|e| self.unreadable(&e))? {
            self.balance(self.handed)?;
            return Ok(false);
        }
        let row = self.block.rows[0];
        if self.splitter.split(&self.block.bytes, row.plain, record) {
            self.handed += row.lines;
        }
        record.line = row.line;
        record.unclosed = self.block.fault(0).cloned();
        Ok(true)
    }

    /// Reads the next `most` rows, or fewer where they are long, without looking at their cells; reads none at the end.
    pub(super) fn next_block(&mut self, most: usize, block: &mut RowBlock) -> Result<()> {
        block.clear();
        while block.rows.len() < most && block.bytes.len() < LARGEST_BLOCK {
            self.rows.in_memory(block, most).map_err(|e| self.unreadable(&e))?;
            // What is left begins with a quote, or with the part of a line that ends further on in the file.
            if block.rows.len() < most && !self.rows.next(block).map_err(|e| self.unreadable(&e))? {
                break;
            }
        }
        Ok(())
    }

    /// Compares the number of lines whose rows were answered with the number of lines that were read, which is counted
    /// without any knowledge of rows.
    ///
    /// # Errors
    /// [`Error::Input`] where they differ: a row was lost, which is a fault of this program.
    pub(super) fn balance(&self, answered: u64) -> Result<()> {
        let there = self.rows.lines_read().saturating_sub(self.before);
        if answered == there {
            return Ok(());
        }
        Err(Error::input(
            &self.name,
            format!(
                "{answered} of its {there} lines below the header were answered, expected all; this is a fault of the \
                 program, and no file was written"
            ),
        ))
    }

    fn unreadable(&self, e: &io::Error) -> Error {
        Error::input(&self.name, format!("line {}: {}", self.rows.line(), atomic::explain(e)))
    }
}

/// Reads the beginning of a file: its first bytes in UTF-8, whether they are all, what follows, and how it is stored.
fn begin(mut source: Source) -> io::Result<(Vec<u8>, bool, Source, Encoding)> {
    let mut head = Vec::new();
    let mut whole = !fill(&mut source, &mut head, HEAD)?;
    let (encoding, mark) = Encoding::of(&head);
    head.drain(..mark);
    if let Encoding::Utf16 { big_endian } = encoding {
        source = Box::new(FromUtf16::new(Cursor::new(std::mem::take(&mut head)).chain(source), big_endian));
        whole = !fill(&mut source, &mut head, HEAD)?;
    }
    // A header of many columns may be longer than that, and the rows below it tell its form.
    while !whole && head.len() < LONGEST_HEAD && memchr::memchr2_iter(b'\n', b'\r', &head).take(4).count() < 4 {
        let more = head.len() + HEAD;
        whole = !fill(&mut source, &mut head, more)?;
    }
    Ok((head, whole, source, encoding))
}

/// Reads until `bytes` has `length` bytes; false where the source ends before.
fn fill(source: &mut Source, bytes: &mut Vec<u8>, length: usize) -> io::Result<bool> {
    let missing = length.saturating_sub(bytes.len()) as u64;
    source.take(missing).read_to_end(bytes)?;
    Ok(bytes.len() >= length)
}
