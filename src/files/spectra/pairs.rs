//! Tables with two rows a leaf, one of reflectance and one of transmittance, told apart by a column. They become tables
//! with a row for each leaf and wavelength.

use super::name::{SpectrumColumnName, quantity_of};
use super::{LEAF, WideSpectra, in_nm, only_leaf, wide};
use crate::progress;
use crate::table::{InputTable, TableRecord, counted, push_quoted};
use crate::{Error, Result};
use std::collections::{HashMap, HashSet};
use std::io::Cursor;
use std::path::Path;

/// Names of a column that may say of each row which quantity it holds.
const KIND: [&str; 12] = [
    "type",
    "mode",
    "measurement",
    "kind",
    "quantity",
    "what",
    "property",
    "variable",
    "signal",
    "spectrum",
    "parameter",
    "measure",
];

/// Names of the column of readings in a table with a row for each wavelength and quantity.
const VALUE: [&str; 5] = ["value", "reading", "values", "data", "result"];

/// Opens a table of spectra. One with two rows a leaf comes back with a row for each leaf and wavelength.
///
/// # Errors
/// As [`InputTable::open`]; where nothing says which rows belong together.
pub fn open(path: &Path) -> Result<InputTable> {
    let table = InputTable::open(path)?;
    let found = wide(&table);
    let value = VALUE.into_iter().find_map(|name| column_like(&table, name));
    let wavelength =
        table.header.iter().position(|text| SpectrumColumnName::of(text).is_some_and(|n| n.is_wavelength()));
    let tidy = value.zip(wavelength);
    if !found.readings.is_empty() || found.bare.is_empty() && tidy.is_none() {
        return Ok(table);
    }
    match kind_column(&table, &found) {
        Some(kind) => joined(table, &found, kind, tidy),
        None => Ok(table),
    }
}

fn column_like(table: &InputTable, name: &str) -> Option<usize> {
    table.header.iter().position(|h| h.trim().eq_ignore_ascii_case(name))
}

/// The column that says of each row whether it holds reflectance or transmittance.
fn kind_column(table: &InputTable, found: &WideSpectra) -> Option<usize> {
    let bare: HashSet<&String> = found.bare.iter().map(|(name, _)| name).collect();
    let says = |k: &usize| {
        let name = &table.header[*k];
        if bare.contains(name) || LEAF.contains(&name.as_str()) {
            return false;
        }
        let words = table.head_words(name);
        let known = words.iter().filter(|word| quantity_of(word).is_some()).count();
        let told = KIND.iter().any(|kind| name.to_lowercase().contains(kind));
        // Without a telling name all its words must be quantities.
        known > 0 && (told || known == words.len())
    };
    (0..table.header.len()).find(says)
}

/// A leaf and lit side with the cells of its reflectance and transmittance at each wavelength.
struct Leaf {
    /// What stands beside the readings in its first row.
    beside: Vec<String>,
    line: usize,
    readings: [Vec<(f64, String)>; 2],
    /// How many rows of each quantity there are.
    rows: [usize; 2],
}

/// Puts the rows of each leaf together.
fn joined(mut table: InputTable, found: &WideSpectra, kind: usize, tidy: Option<(usize, usize)>) -> Result<InputTable> {
    let bare: Vec<(usize, f64)> = match tidy {
        Some(_) if found.bare.is_empty() => Vec::new(),
        _ => found.bare.iter().filter_map(|(name, nm)| Some((table.column(name)?, *nm))).collect(),
    };
    let tidy = tidy.filter(|_| bare.is_empty());
    let leaf = LEAF.into_iter().find_map(|name| table.column(name));
    let unit = match tidy {
        Some((_, at)) => super::long(&table)?.filter(|l| l.wavelength == table.header[at]).map_or(1.0, |l| l.unit_nm),
        None => 1.0,
    };
    let mut beside: Vec<usize> = (0..table.header.len()).collect();
    let read: HashSet<usize> =
        bare.iter().map(|(k, _)| *k).chain([kind]).chain(tidy.into_iter().flat_map(|(v, w)| [v, w])).collect();
    beside.retain(|k| !read.contains(k));
    // What becomes a column of its own is not carried along under the same name.
    beside.retain(|&k| !["wavelength_nm", "R", "T", ""].contains(&table.header[k].as_str()));
    let side = table.column("side");
    let (mut leaves, mut places): (Vec<Leaf>, HashMap<(String, String), usize>) = Default::default();
    let (mut record, mut others) = (TableRecord::default(), 0);
    while table.next_record(&mut record)? {
        let line = record.line();
        if let Some(fault) = record.fault(table.header.len()) {
            return Err(Error::field(table.name(), &format!("line {line}"), fault));
        }
        let Some(through) = quantity_of(&record.shown(kind)) else {
            others += 1;
            continue;
        };
        let key = [leaf, side].map(|k| k.map_or_else(String::new, |k| record.shown(k).into_owned()));
        let place = *places.entry(key.into()).or_insert_with(|| {
            let beside = beside.iter().map(|&k| plain(&table, &record, k)).collect();
            leaves.push(Leaf { beside, line, readings: Default::default(), rows: [0; 2] });
            leaves.len() - 1
        });
        let Leaf { readings, rows, .. } = &mut leaves[place];
        rows[usize::from(through)] += 1;
        let readings = &mut readings[usize::from(through)];
        match tidy {
            Some((value, at)) => {
                if let Ok(Some(w)) = table.number(&record, at) {
                    readings.push((in_nm(w, unit), plain(&table, &record, value)));
                }
            }
            None => readings.extend(bare.iter().map(|&(k, nm)| (nm, plain(&table, &record, k)))),
        }
    }
    if leaf.is_none() && tidy.is_none() && leaves.iter().any(|l| l.rows.iter().any(|n| *n > 1)) {
        let what = "no such column, and several rows hold the same quantity; expected the name of the leaf in each row";
        return Err(Error::field(table.name(), LEAF[0], what));
    }
    if others > 0 {
        let rows = counted(others, "row");
        progress::say(format!("{}: {rows} of neither reflectance nor transmittance left out", table.name().display()));
    }
    let mut text: Vec<u8> = Vec::new();
    let mut names: Vec<&str> = beside.iter().map(|&k| table.header[k].as_str()).collect();
    if leaf.is_none() {
        names.insert(0, LEAF[0]);
    }
    names.extend(["wavelength_nm", "R", "T"]);
    push_line(&mut text, names.into_iter());
    let (only, mut lines) = (only_leaf(table.name()), Vec::new());
    for leaf_rows in &leaves {
        for (nm, cells) in by_wavelength(leaf_rows) {
            let beside = leaf_rows.beside.iter().map(String::as_str);
            let first = leaf.is_none().then_some(only.as_str());
            let nm = nm.to_string();
            push_line(&mut text, first.into_iter().chain(beside).chain([nm.as_str(), &cells[0], &cells[1]]));
            lines.push(leaf_rows.line);
        }
    }
    let joined = InputTable::from_reader(Box::new(Cursor::new(text)), table.name().to_path_buf())?;
    Ok(joined.standing_for(table.source(), lines))
}

/// The cells of R and T at each wavelength, in the order of the first row.
fn by_wavelength(leaf: &Leaf) -> Vec<(f64, [String; 2])> {
    let mut rows: Vec<(f64, [String; 2])> = Vec::new();
    let mut places: HashMap<u64, usize> = HashMap::new();
    for (k, readings) in leaf.readings.iter().enumerate() {
        for (nm, cell) in readings {
            let place = *places.entry(nm.to_bits()).or_insert_with(|| {
                rows.push((*nm, Default::default()));
                rows.len() - 1
            });
            let slot = &mut rows[place].1[k];
            // What is there twice is no number, and the answer names it.
            *slot = if slot.is_empty() { cell.clone() } else { "there twice".into() };
        }
    }
    rows
}

/// A cell with a decimal point, where it is a number.
fn plain(table: &InputTable, record: &TableRecord, k: usize) -> String {
    let text = record.shown(k);
    match table.number(record, k) {
        Ok(Some(v)) if text.contains(',') => v.to_string(),
        _ => text.into_owned(),
    }
}

fn push_line<'a>(text: &mut Vec<u8>, cells: impl Iterator<Item = &'a str>) {
    for (k, cell) in cells.enumerate() {
        if k > 0 {
            text.push(b',');
        }
        push_quoted(text, cell);
    }
    text.push(b'\n');
}
