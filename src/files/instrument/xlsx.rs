//! Workbooks `.xlsx`: the first visible sheet with a table, as CSV.
//!
//! A workbook is a ZIP archive, and a small one may unpack to any size. So the archive is unpacked once to count its
//! bytes before anything is kept, and cells are read one after the other, never as the rectangle that the sheet claims
//! to have.

use crate::table::{push_number, push_quoted};
use calamine::{CellErrorType, DataRef, Reader, SheetVisible, Xlsx};
use std::collections::BTreeMap;
use std::io::{Cursor, Read};

/// A workbook may not unpack to more bytes, a sheet may not have more cells, and a table made of it not more.
const MOST_BYTES: u64 = 1 << 28;
const MOST_CELLS: usize = 20_000_000;
/// A workbook has some tens of parts.
const MOST_PARTS: usize = 10_000;

/// A ZIP archive with the parts of a workbook.
pub(super) fn is_workbook(head: &[u8]) -> bool {
    let has = |name: &[u8]| memchr::memmem::find(head, name).is_some();
    head.starts_with(b"PK\x03\x04")
        && (has(b"xl/") || has(b"[Content_Types].xml") || has(b"docProps/"))
        && !(has(b"word/") || has(b"ppt/") || has(b"mimetype"))
}

/// Cells by row, then by column; cells without text are not there.
type Cells = BTreeMap<u32, BTreeMap<u32, Cell>>;

#[derive(Clone, PartialEq)]
enum Cell {
    Number(f64),
    Text(String),
}

/// Unpacks the archive and forgets it, to see that it has no more than `most` bytes.
pub(super) fn unpacks_within(most: u64, bytes: &[u8]) -> Result<(), String> {
    let damaged = |e: zip::result::ZipError| format!("its archive is damaged: {e}");
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).map_err(damaged)?;
    if archive.len() > MOST_PARTS {
        return Err(format!("its archive has {} parts; expected at most {MOST_PARTS}", archive.len()));
    }
    let mut left = most;
    for k in 0..archive.len() {
        let part = archive.by_index(k).map_err(damaged)?;
        let unpacked = std::io::copy(&mut part.take(left + 1), &mut std::io::sink())
            .map_err(|e| format!("its archive is damaged: {e}"))?;
        left = left
            .checked_sub(unpacked)
            .ok_or_else(|| format!("it unpacks to more than {} MB; save the table alone, as CSV", most >> 20))?;
    }
    Ok(())
}

/// The first visible sheet with a table, as CSV, and notes on what was left out.
pub(super) fn sheet(bytes: &[u8]) -> Result<(Vec<u8>, Vec<String>), String> {
    unpacks_within(MOST_BYTES, bytes)?;
    let damaged = |e: calamine::XlsxError| format!("it cannot be read: {e}");
    let mut book: Xlsx<_> = Xlsx::new(Cursor::new(bytes)).map_err(damaged)?;
    let sheets = book.sheets_metadata();
    let visible = |s: &&calamine::Sheet| s.visible == SheetVisible::Visible;
    let names: Vec<String> = sheets.iter().filter(visible).map(|s| s.name.clone()).collect();
    let hidden = sheets.len() - names.len();
    for name in &names {
        let Ok(mut cells) = cells(&mut book, name) else { continue };
        let merged = book.merge_cells_by_sheet_name(name).unwrap_or_default();
        let Some(header) = header(&cells) else { continue };
        let filled = fill(&mut cells, &merged, header);
        let (table, mut notes) = table(&cells, header)?;
        let others: Vec<&str> = names.iter().filter(|n| *n != name).map(String::as_str).collect();
        let others = match (others.is_empty(), hidden) {
            (true, 0) => String::new(),
            (true, _) => format!("; {hidden} hidden ones are not read"),
            (false, 0) => format!("; the others are not read: {}", others.join(", ")),
            (false, _) => format!("; the others are not read: {}, and {hidden} hidden ones", others.join(", ")),
        };
        notes.insert(0, format!("the sheet {name:?} is read{others}"));
        if filled > 0 {
            notes.push(format!("{filled} cells take the value of the merged cell that covers them"));
        }
        return Ok((table, notes));
    }
    Err(match names.len() {
        0 => "it has no visible sheet".into(),
        1 => format!("its sheet {:?} holds no table: no line of names with numbers below it", names[0]),
        n => format!("none of its {n} sheets holds a table: no line of names with numbers below it"),
    })
}

fn cells(book: &mut Xlsx<Cursor<&[u8]>>, sheet: &str) -> Result<Cells, String> {
    let mut cells = Cells::new();
    let mut count = 0;
    let mut reader = book.worksheet_cells_reader(sheet).map_err(|e| e.to_string())?;
    while let Some(cell) = reader.next_cell().map_err(|e| e.to_string())? {
        let value = match cell.get_value() {
            DataRef::Int(v) => Cell::Number(*v as f64),
            DataRef::Float(v) => Cell::Number(*v),
            DataRef::String(text) => Cell::Text(text.trim().to_string()),
            DataRef::SharedString(text) => Cell::Text(text.trim().to_string()),
            DataRef::Bool(v) => Cell::Text(v.to_string()),
            // A number that the sheet shows as a date is no reading; as text it spoils only its own row.
            DataRef::DateTime(v) => Cell::Text(format!("date {v}")),
            DataRef::DateTimeIso(text) | DataRef::DurationIso(text) => Cell::Text(text.clone()),
            DataRef::Error(CellErrorType::NA) | DataRef::Empty => continue,
            DataRef::Error(e) => Cell::Text(e.to_string()),
        };
        if value == Cell::Text(String::new()) {
            continue;
        }
        count += 1;
        if count > MOST_CELLS {
            return Err(format!("more than {MOST_CELLS} cells"));
        }
        let (row, column) = cell.get_position();
        cells.entry(row).or_default().insert(column, value);
    }
    Ok(cells)
}

/// The row that names the columns: the first one with about as many cells as most rows have, followed by a row with a
/// number. Titles and remarks above a table are shorter.
fn header(cells: &Cells) -> Option<u32> {
    let mut lengths: Vec<usize> = cells.values().map(BTreeMap::len).collect();
    lengths.sort_unstable();
    let usual = lengths.get(lengths.len() / 2)?;
    let enough = (3 * usual).div_ceil(4).max(2);
    let rows: Vec<(u32, &BTreeMap<u32, Cell>)> = cells.iter().map(|(row, of)| (*row, of)).collect();
    let numbers = |of: &BTreeMap<u32, Cell>| of.values().any(|cell| matches!(cell, Cell::Number(_)));
    let found = rows.windows(2).find(|pair| pair[0].1.len() >= enough && numbers(pair[1].1))?;
    Some(found[0].0)
}

/// Copies the value of each merged cell to all cells below the header that it covers; returns how many it filled.
fn fill(cells: &mut Cells, merged: &[calamine::Dimensions], header: u32) -> usize {
    let mut filled = 0;
    for region in merged {
        let ((top, left), (bottom, right)) = (region.start, region.end);
        let Some(value) = cells.get(&top).and_then(|row| row.get(&left)).cloned().filter(|_| top > header) else {
            continue;
        };
        let rows: Vec<u32> = cells.range(top..=bottom.max(top)).map(|(row, _)| *row).collect();
        for row in rows {
            for column in left..=right.max(left).min(left.saturating_add(16_384)) {
                if filled < MOST_CELLS && (row, column) != (top, left) {
                    cells.entry(row).or_default().insert(column, value.clone());
                    filled += 1;
                }
            }
        }
    }
    filled
}

/// The rows from the header on, as CSV. Cells outside the named columns are left out.
fn table(cells: &Cells, header: u32) -> Result<(Vec<u8>, Vec<String>), String> {
    let names = &cells[&header];
    let rows = cells.range(header + 1..);
    if names.len().saturating_mul(rows.clone().count() + 1) > MOST_CELLS {
        return Err(format!("its table has more than {MOST_CELLS} cells; save it as CSV"));
    }
    let mut bytes = Vec::new();
    let write = |bytes: &mut Vec<u8>, cell: Option<&Cell>| match cell {
        // Wavelengths and counts as people write them: 450, not 450.0.
        Some(Cell::Number(v)) if v.fract() == 0.0 && v.abs() < 1e15 => {
            bytes.extend_from_slice(format!("{v}").as_bytes())
        }
        Some(Cell::Number(v)) => push_number(bytes, *v),
        Some(Cell::Text(text)) => push_quoted(bytes, text),
        None => {}
    };
    let mut outside = 0;
    for (_, row) in std::iter::once((&header, names)).chain(rows) {
        for (k, column) in names.keys().enumerate() {
            if k > 0 {
                bytes.push(b',');
            }
            write(&mut bytes, row.get(column));
        }
        bytes.push(b'\n');
        outside += row.keys().filter(|column| !names.contains_key(column)).count();
    }
    let mut notes = Vec::new();
    let above = cells.range(..header).count();
    if above > 0 {
        notes.push(format!("{above} rows above the names of the columns are left out"));
    }
    if outside > 0 {
        notes.push(format!("{outside} cells in columns without a name are left out"));
    }
    Ok((bytes, notes))
}
