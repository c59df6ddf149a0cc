//! A CSV as it is read: a header line that names the columns, then rows one at a time.

use super::rows::{Block, Rows};
use crate::atomic;
use crate::instrument::{self, Stated};
use crate::{Error, Result};
use memchr::memchr_iter;
use std::borrow::Cow;
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// An opened CSV: its header is read, its rows are not.
pub struct Table {
    rows: Rows<Box<dyn Read + Send>>,
    splitter: Splitter,
    /// The rows that [`Table::next_record`] reads from, and how far it has come in them.
    block: Block,
    at: usize,
    name: PathBuf,
    /// The file, or `-`.
    source: PathBuf,
    /// What the file states besides its cells, where it is one of an instrument.
    stated: Option<Stated>,
    /// Names of the columns.
    pub header: Vec<String>,
    places: HashMap<String, usize>,
}

/// More columns than this are a mistake: even traces of three channels and 10,000 frames have only 30,000.
const MOST_COLUMNS: usize = 65_536;

/// Bytes of a block of rows: wide traces are read in smaller blocks.
const MOST_BYTES: usize = 1 << 24;

impl Table {
    /// Opens `path` (`-`: standard input) and reads the header line. A file of an instrument becomes a table first.
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
        let (source, stated) = instrument::through(source, &name)?;
        Ok(Table { source: path.to_path_buf(), stated, ..Table::from_reader(source, name)? })
    }

    /// A table from any source; `name` takes the place of the file's name in messages.
    pub fn from_reader(source: Box<dyn Read + Send>, name: PathBuf) -> Result<Table> {
        let mut table = Table {
            rows: Rows::new(source),
            splitter: Splitter::default(),
            block: Block::default(),
            at: 0,
            source: name.clone(),
            name,
            stated: None,
            header: Vec::new(),
            places: HashMap::new(),
        };
        let mut record = Record::default();
        table.next_record(&mut record)?;
        let name = &table.name;
        if let Some(why) = &record.unclosed {
            return Err(Error::input(name, format!("the header cannot be read: {why}")));
        }
        let cell = |k: usize| match record.text(Some(k)) {
            Some(Ok(text)) => Ok(text.trim_start_matches('\u{feff}').trim().to_string()),
            _ => Err(Error::input(name, "line 1: not valid UTF-8 text")),
        };
        let header = (0..record.len()).map(cell).collect::<Result<Vec<String>>>()?;
        if header.iter().all(|h| h.is_empty()) {
            return Err(Error::input(name, "no header line; the first line must name the columns"));
        }
        if header.len() > MOST_COLUMNS {
            return Err(Error::input(name, format!("found {} columns, expected at most {MOST_COLUMNS}", header.len())));
        }
        let mut places = HashMap::new();
        for (k, h) in header.iter().enumerate() {
            if places.insert(h.clone(), k).is_some() {
                return Err(Error::field(name, h, "the header names this column twice"));
            }
        }
        (table.header, table.places) = (header, places);
        Ok(table)
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
    pub fn stated(&self) -> Option<&Stated> {
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
    fn shown_header(&self) -> String {
        let shown = self.header.iter().take(40).map(String::as_str).collect::<Vec<_>>().join(", ");
        if self.header.len() > 40 { format!("{shown} and {} more", self.header.len() - 40) } else { shown }
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
    /// [`Record::fault`].
    pub fn next_record(&mut self, record: &mut Record) -> Result<bool> {
        loop {
            let mut rest = &self.block.bytes[self.at..];
            let plain = self.block.rows.first().is_some_and(|row| row.plain);
            if self.splitter.split(&mut rest, plain, record) {
                self.at = self.block.bytes.len() - rest.len();
                record.unclosed = self.block.fault(0).cloned();
                return Ok(true);
            }
            self.block.clear();
            self.at = 0;
            if !self.rows.next(&mut self.block).map_err(|e| self.unreadable(&e))? {
                return Ok(false);
            }
        }
    }

    /// Reads the next `most` rows, or fewer where they are long, without looking at their cells; reads none at the end.
    pub(super) fn next_block(&mut self, most: usize, block: &mut Block) -> Result<()> {
        block.clear();
        while block.rows.len() < most && block.bytes.len() < MOST_BYTES {
            self.rows.in_memory(block, most).map_err(|e| self.unreadable(&e))?;
            // What is left begins with a quote, or with the part of a line that ends further on in the file.
            if block.rows.len() < most && !self.rows.next(block).map_err(|e| self.unreadable(&e))? {
                break;
            }
        }
        Ok(())
    }

    fn unreadable(&self, e: &io::Error) -> Error {
        Error::input(&self.name, format!("line {}: {}", self.rows.line(), atomic::explain(e)))
    }
}

/// Splits rows into their cells.
#[derive(Debug, Clone)]
pub(super) struct Splitter(csv_core::Reader);

impl Default for Splitter {
    fn default() -> Splitter {
        // The reader's own default is one without rules.
        Splitter(csv_core::Reader::new())
    }
}

impl Splitter {
    /// Takes the first row off `rows`, which end in a line feed; returns false where there is none. `plain` says that
    /// it is the only one and has no quotes.
    pub fn split(&mut self, rows: &mut &[u8], plain: bool, record: &mut Record) -> bool {
        // The reader beneath takes an empty input for the end of the file and then reads no more.
        if rows.is_empty() {
            return false;
        }
        if plain {
            record.hold(std::mem::take(rows));
            return true;
        }
        record.between = 0;
        let (mut filled, mut count) = (0, 0);
        // A row has no more bytes in its cells than in the file.
        if record.bytes.len() < rows.len() {
            record.bytes.resize(rows.len(), 0);
        }
        loop {
            if record.ends.len() <= count {
                record.ends.resize(2 * count + 16, 0);
            }
            let (state, read, wrote, ended) =
                self.0.read_record(rows, &mut record.bytes[filled..], &mut record.ends[count..]);
            *rows = &rows[read..];
            filled += wrote;
            count += ended;
            match state {
                csv_core::ReadRecordResult::OutputEndsFull => {}
                csv_core::ReadRecordResult::OutputFull => record.bytes.resize(2 * filled + 64, 0),
                ended => {
                    record.count = count;
                    return ended == csv_core::ReadRecordResult::Record;
                }
            }
        }
    }
}

/// One row as it was read.
#[derive(Debug, Clone, Default)]
pub struct Record {
    /// The text of the cells, one after another.
    bytes: Vec<u8>,
    /// Where each cell's text ends.
    ends: Vec<usize>,
    /// Bytes between two cells: the comma of a row that was taken as it is.
    between: usize,
    /// How many cells there are.
    count: usize,
    /// Why the row's quotes make no sense, if so.
    pub(super) unclosed: Option<String>,
}

impl Record {
    /// Takes a line without quotes as it is.
    fn hold(&mut self, line: &[u8]) {
        self.bytes.clear();
        self.bytes.extend_from_slice(line);
        self.ends.clear();
        self.ends.extend(memchr_iter(b',', line));
        // The end of the line is a blank at the end of the last cell.
        self.ends.push(line.len());
        (self.count, self.between) = (self.ends.len(), 1);
    }

    /// Whether its cells stand in the file as they are, so that none needs quotes when it is written.
    pub(super) fn is_plain(&self) -> bool {
        self.between == 1
    }

    /// How many cells it has.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether it has no cells.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Why a row of a table of `width` columns cannot be read, if so. A cell in another encoding spoils only itself.
    pub fn fault(&self, width: usize) -> Option<String> {
        let ragged = || (self.count != width).then(|| format!("{} fields where the header has {width}", self.count));
        self.unclosed.clone().or_else(ragged)
    }

    /// A cell as it is in the file, in any encoding, without the blanks around it; empty where there is no such cell.
    pub fn bytes(&self, k: usize) -> &[u8] {
        if k >= self.count {
            return &[];
        }
        let start = if k == 0 { 0 } else { self.ends[k - 1] + self.between };
        self.bytes[start..self.ends[k]].trim_ascii()
    }

    /// A cell as text, if there is such a column.
    pub fn text(&self, k: Option<usize>) -> Option<std::result::Result<&str, std::str::Utf8Error>> {
        k.map(|k| std::str::from_utf8(self.bytes(k)))
    }

    /// A cell as text; bytes that are not UTF-8 become replacement characters.
    pub fn shown(&self, k: usize) -> Cow<'_, str> {
        String::from_utf8_lossy(self.bytes(k))
    }
}
