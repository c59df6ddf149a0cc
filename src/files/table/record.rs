//! One row as it was read, and how a row is split into its cells.

use memchr::memchr_iter;
use std::borrow::Cow;

/// Splits rows into their cells.
#[derive(Debug, Clone)]
pub(super) struct Splitter {
    reader: csv_core::Reader,
    separator: u8,
}

impl Splitter {
    pub fn new(separator: u8) -> Splitter {
        Splitter { reader: csv_core::ReaderBuilder::new().delimiter(separator).build(), separator }
    }

    /// Splits a row, which ends in a line end. `plain` says that it has no quotes. Returns false where the row does not
    /// hold exactly one record, which would be a fault of who cut the rows.
    pub fn split(&mut self, row: &[u8], plain: bool, record: &mut TableRecord) -> bool {
        if plain {
            record.hold(row, self.separator);
            return true;
        }
        let mut rest = row;
        record.between = 0;
        let (mut filled, mut count) = (0, 0);
        // A row has no more bytes in its cells than in the file.
        if record.bytes.len() < rest.len() {
            record.bytes.resize(rest.len(), 0);
        }
        loop {
            if record.ends.len() <= count {
                record.ends.resize(2 * count + 16, 0);
            }
            let (state, read, wrote, ended) =
                self.reader.read_record(rest, &mut record.bytes[filled..], &mut record.ends[count..]);
            rest = &rest[read..];
            filled += wrote;
            count += ended;
            match state {
                csv_core::ReadRecordResult::OutputEndsFull => {}
                csv_core::ReadRecordResult::OutputFull => record.bytes.resize(2 * filled + 64, 0),
                ended => {
                    record.count = count;
                    record.exact = false;
                    return ended == csv_core::ReadRecordResult::Record && rest.is_empty();
                }
            }
        }
    }
}

/// One row as it was read.
#[derive(Debug, Clone, Default)]
pub struct TableRecord {
    /// The text of the cells, one after another.
    bytes: Vec<u8>,
    /// Where each cell's text ends.
    ends: Vec<usize>,
    /// Bytes between two cells: the separator of a row that was taken as it is.
    between: usize,
    /// How many cells there are.
    count: usize,
    /// Whether the cells can be written to a CSV as they are, because commas separate them and none is quoted.
    exact: bool,
    /// Line of the file where the row begins.
    pub(super) line: usize,
    /// Why the row's quotes make no sense, if so.
    pub(super) unclosed: Option<String>,
}

impl TableRecord {
    /// Takes a line without quotes as it is.
    fn hold(&mut self, line: &[u8], separator: u8) {
        self.bytes.clear();
        self.bytes.extend_from_slice(line);
        self.ends.clear();
        self.ends.extend(memchr_iter(separator, line));
        // The end of the line is a blank at the end of the last cell.
        self.ends.push(line.len());
        (self.count, self.between, self.exact) = (self.ends.len(), 1, separator == b',');
    }

    /// Whether its cells stand in the file as they are, so that none needs quotes when it is written.
    pub(super) fn is_exact(&self) -> bool {
        self.exact
    }

    /// Line of the file where the row begins; the first line is 1.
    pub fn line(&self) -> usize {
        self.line
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
