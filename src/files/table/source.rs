//! A CSV as it is read: a header line that names the columns, then rows one at a time.

use crate::files::atomic;
use crate::{Error, Result};
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// An opened CSV: its header is read, its rows are not.
pub struct Table {
    reader: csv::Reader<Box<dyn Read + Send>>,
    name: PathBuf,
    pub header: Vec<String>,
}

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
        Table::from_reader(source, name)
    }

    /// A table from any source; `name` stands for the file in messages.
    pub fn from_reader(source: Box<dyn Read + Send>, name: PathBuf) -> Result<Table> {
        let mut reader = csv::ReaderBuilder::new().flexible(true).trim(csv::Trim::All).buffer_capacity(1 << 18).from_reader(source);
        let header: Vec<String> = reader
            .headers()
            .map_err(|e| Error::input(&name, format!("line 1: {}", plain_csv_error(&e))))?
            .iter()
            .map(|h| h.trim_start_matches('\u{feff}').to_string())
            .collect();
        if header.iter().all(|h| h.is_empty()) {
            return Err(Error::input(&name, "no header line; the first line must name the columns"));
        }
        for (k, h) in header.iter().enumerate() {
            if header[..k].contains(h) {
                return Err(Error::field(&name, h, "the header names this column twice"));
            }
        }
        Ok(Table { reader, name, header })
    }

    pub fn name(&self) -> &Path {
        &self.name
    }

    /// Position of a column.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.header.iter().position(|h| h == name)
    }

    /// Position of a column that must be there.
    pub fn require(&self, name: &str) -> Result<usize> {
        self.column(name)
            .ok_or_else(|| Error::field(&self.name, name, format!("no such column; the header has {}", self.header.join(", "))))
    }

    /// The column of an angle, which is `name` (radians) or `name_deg` (degrees), and the factor that makes radians of its numbers.
    ///
    /// # Errors
    /// [`Error::Input`] where the header has both.
    pub fn angle(&self, name: &str) -> Result<(String, f64)> {
        let degrees = format!("{name}_deg");
        match (self.column(name), self.column(&degrees)) {
            (Some(_), Some(_)) => Err(Error::field(&self.name, name, format!("the header has {degrees} too; expected one of the two"))),
            (None, Some(_)) => Ok((degrees, 1f64.to_radians())),
            _ => Ok((name.to_string(), 1.0)),
        }
    }

    /// Reads the next row; false at the end. Rows may be ragged or no text at all: see [`Record::fault`].
    pub fn next_record(&mut self, record: &mut Record) -> Result<bool> {
        let mut bytes = csv::ByteRecord::new();
        let more = self.reader.read_byte_record(&mut bytes).map_err(|e| {
            let line = e.position().map_or(0, |p| p.line());
            Error::input(&self.name, format!("line {line}: {}", plain_csv_error(&e)))
        })?;
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
}

impl Record {
    /// Why a row of a table of `width` columns cannot be read, if it cannot. A cell in another encoding spoils only itself.
    pub fn fault(&self, width: usize) -> Option<String> {
        (self.cells.len() != width).then(|| format!("{} fields where the header has {width}", self.cells.len()))
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
