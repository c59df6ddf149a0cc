//! A CSV as it is read: a header line that names the columns, then rows one at a time.

use super::quotes::{Faults, Quotes};
use crate::atomic;
use crate::{Error, Result};
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// An opened CSV: its header is read, its rows are not.
pub struct Table {
    reader: csv::Reader<Quotes<Box<dyn Read + Send>>>,
    faults: Faults,
    name: PathBuf,
    /// The file, or `-`.
    source: PathBuf,
    /// Names of the columns.
    pub header: Vec<String>,
    places: HashMap<String, usize>,
}

/// More columns than this are a mistake: traces of three channels and 10,000 frames have 30,000.
const MOST_COLUMNS: usize = 65_536;

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
        Ok(Table { source: path.to_path_buf(), ..Table::from_reader(source, name)? })
    }

    /// A table from any source; `name` stands for the file in messages.
    pub fn from_reader(source: Box<dyn Read + Send>, name: PathBuf) -> Result<Table> {
        let faults = Faults::default();
        let source = Quotes::new(source, faults.clone());
        let mut reader =
            csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).buffer_capacity(1 << 18).from_reader(source);
        let header: Vec<String> = reader
            .headers()
            .map_err(|e| Error::input(&name, format!("line 1: {}", plain_csv_error(&e))))?
            .iter()
            .map(|h| h.trim_start_matches('\u{feff}').to_string())
            .collect();
        if let Some(why) = faults.on(0..reader.position().line()) {
            return Err(Error::input(&name, format!("the header cannot be read: {why}")));
        }
        if header.iter().all(|h| h.is_empty()) {
            return Err(Error::input(&name, "no header line; the first line must name the columns"));
        }
        if header.len() > MOST_COLUMNS {
            return Err(Error::input(
                &name,
                format!("found {} columns, expected at most {MOST_COLUMNS}", header.len()),
            ));
        }
        let mut places = HashMap::new();
        for (k, h) in header.iter().enumerate() {
            if places.insert(h.clone(), k).is_some() {
                return Err(Error::field(&name, h, "the header names this column twice"));
            }
        }
        Ok(Table { reader, faults, source: name.clone(), name, header, places })
    }

    /// The file that is read; `-` for standard input.
    pub fn source(&self) -> &Path {
        &self.source
    }

    /// The file, or `-`.
    pub fn name(&self) -> &Path {
        &self.name
    }

    /// Position of a column.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.places.get(name).copied()
    }

    /// Position of a column that must be there.
    pub fn require(&self, name: &str) -> Result<usize> {
        self.column(name).ok_or_else(|| {
            Error::field(&self.name, name, format!("no such column; the header has {}", self.shown_header()))
        })
    }

    /// The header for a message, cut where it is long.
    fn shown_header(&self) -> String {
        let shown = self.header.iter().take(40).map(String::as_str).collect::<Vec<_>>().join(", ");
        if self.header.len() > 40 { format!("{shown} and {} more", self.header.len() - 40) } else { shown }
    }

    /// The column of an angle, which is `name` (radians) or `name_deg` (degrees), and the factor that makes radians of
    /// its numbers.
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

    /// Reads the next row; false at the end. Rows may be ragged or no text at all: see [`Record::fault`].
    pub fn next_record(&mut self, record: &mut Record) -> Result<bool> {
        let mut bytes = csv::ByteRecord::new();
        let start = self.reader.position().line();
        let more = self.reader.read_byte_record(&mut bytes).map_err(|e| {
            let line = e.position().map_or(0, |p| p.line());
            Error::input(&self.name, format!("line {line}: {}", plain_csv_error(&e)))
        })?;
        record.unclosed = self.faults.on(start..self.reader.position().line());
        (record.cells, record.foreign) = match csv::StringRecord::from_byte_record(bytes) {
            Ok(cells) => (cells, None),
            Err(e) => {
                let bytes = e.into_byte_record();
                (csv::StringRecord::from_byte_record_lossy(bytes.clone()), Some(bytes))
            }
        };
        Ok(more)
    }
}

/// One row as it was read.
#[derive(Debug, Clone, Default)]
pub struct Record {
    /// Without the blanks around them; bytes that are no UTF-8 stand as replacement characters.
    pub cells: csv::StringRecord,
    /// The same as bytes where some cell is no UTF-8.
    foreign: Option<csv::ByteRecord>,
    /// Why its quotes make no sense, if they do not.
    unclosed: Option<String>,
}

impl Record {
    /// Why a row of a table of `width` columns cannot be read, if it cannot. A cell in another encoding spoils only
    /// itself.
    pub fn fault(&self, width: usize) -> Option<String> {
        let ragged =
            || (self.cells.len() != width).then(|| format!("{} fields where the header has {width}", self.cells.len()));
        self.unclosed.clone().or_else(ragged)
    }

    /// A cell as it stands in the file, whatever its encoding.
    pub fn bytes(&self, k: usize) -> &[u8] {
        match &self.foreign {
            Some(bytes) => bytes.get(k).unwrap_or_default(),
            None => self.cells.get(k).unwrap_or_default().as_bytes(),
        }
    }

    /// A cell as text, if there is such a column.
    pub fn text(&self, k: Option<usize>) -> Option<std::result::Result<&str, std::str::Utf8Error>> {
        k.map(|k| std::str::from_utf8(self.bytes(k)))
    }
}

fn plain_csv_error(e: &csv::Error) -> String {
    match e.kind() {
        csv::ErrorKind::Io(io) => atomic::explain(io),
        csv::ErrorKind::Utf8 { .. } => "not valid UTF-8 text".into(),
        _ => e.to_string(),
    }
}
