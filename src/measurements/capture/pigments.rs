//! The table of specific absorptions and refractive indices that the option `--pigments` names.

use mesophyll_base::error::{Error, Result};
use mesophyll_base::statistics::median_of;
use mesophyll_files::table::{InputTable, TableRecord};
use mesophyll_optics::foliar::LARGEST_INDEX;
use mesophyll_optics::foliar::pigments::{OpticalConstants, OpticalSpectrum};
use std::path::Path;

/// The columns, whose names end in their units.
pub const COLUMNS: [&str; 9] = [
    "wavelength_nm",
    "chlorophyll_cm2_g",
    "carotenoid_cm2_g",
    "protein_cm2_g",
    "cellulose_lignin_cm2_g",
    "water_per_cm",
    "n_cuticle",
    "n_mesophyll",
    "n_antidermal",
];

/// A step that is this many times as long as the usual one is a gap.
const GAP: f64 = 1.5;

/// Reads a table. It has one row for each wavelength, in ascending order and even steps.
///
/// # Errors
/// A column that is missing or whose name states another unit; a cell that is empty, no number or out of range;
/// wavelengths that do not ascend; gaps. Each names the file, the line and the column.
pub fn read(path: &Path) -> Result<OpticalSpectrum> {
    let mut table = InputTable::open(path)?;
    let mut places = [0; COLUMNS.len()];
    for (place, name) in places.iter_mut().zip(COLUMNS) {
        *place = column(&table, name)?;
    }
    let mut points: Vec<(f64, OpticalConstants)> = Vec::new();
    let mut record = TableRecord::default();
    while table.next_record(&mut record)? {
        let line = record.line();
        let at = |name: &str| format!("line {line}, {name}");
        if let Some(fault) = record.fault(table.header.len()) {
            return Err(Error::field(path, &format!("line {line}"), fault));
        }
        let mut values = [0.0; COLUMNS.len()];
        for (k, (value, name)) in values.iter_mut().zip(COLUMNS).enumerate() {
            let text = String::from_utf8_lossy(record.bytes(places[k])).into_owned();
            let (least, most, words) = match k {
                0 => (f64::MIN_POSITIVE, f64::MAX, "a wavelength above 0"),
                6.. => (1.0, LARGEST_INDEX, "a refractive index from 1 to 3"),
                _ => (0.0, f64::MAX, "0 or more"),
            };
            match table.number_in(&record, places[k], [0.0, f64::MAX]) {
                Ok(Some(v)) if (least..=most).contains(&v) => *value = v,
                Ok(None) if text.is_empty() => return Err(Error::field(path, &at(name), "the cell is empty")),
                Ok(None) => return Err(Error::field(path, &at(name), format!("the cell says {text}: no number"))),
                _ => return Err(Error::unexpected(path, &at(name), format!("{text:?}"), words)),
            }
        }
        let [wavelength, a, b, c, d, e, n_cuticle, n_mesophyll, n_antidermal] = values;
        if let Some((before, _)) = points.last().filter(|p| p.0 >= wavelength) {
            let expected = format!("more than {before}, the one before it");
            return Err(Error::unexpected(path, &at(COLUMNS[0]), wavelength, expected));
        }
        points.push((
            wavelength,
            OpticalConstants { specific: [a, b, c, d, e], indices: [n_cuticle, n_mesophyll, n_antidermal] },
        ));
    }
    if points.is_empty() {
        return Err(Error::input(path, "no rows; expected one a wavelength"));
    }
    let usual = median_of(points.windows(2).map(|w| w[1].0 - w[0].0)).unwrap_or(0.0);
    if let Some(gap) = points.windows(2).find(|w| w[1].0 - w[0].0 > GAP * usual) {
        let found = format!("a gap from {} to {} nm", gap[0].0, gap[1].0);
        return Err(Error::unexpected(path, COLUMNS[0], found, format!("steps of {usual} nm")));
    }
    Ok(OpticalSpectrum { points })
}

/// The place of a column. If a column has the same quantity in another unit, the error names it.
fn column(table: &InputTable, name: &str) -> Result<usize> {
    let quantity = ["_nm", "_cm2_g", "_per_cm"].iter().find_map(|unit| name.strip_suffix(unit));
    let alike = |h: &&String| quantity.is_some_and(|q| h.starts_with(q)) && table.column(name).is_none();
    if let Some(other) = table.header.iter().find(alike) {
        return Err(Error::field(
            table.name(),
            other,
            format!("this column is in another unit than is read here; expected {name}"),
        ));
    }
    table.require(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(text: &str) -> Result<OpticalSpectrum> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("pigments.csv");
        std::fs::write(&path, text).unwrap();
        read(&path)
    }

    const HEADER: &str = "wavelength_nm,chlorophyll_cm2_g,carotenoid_cm2_g,protein_cm2_g,cellulose_lignin_cm2_g,\
                          water_per_cm,n_cuticle,n_mesophyll,n_antidermal\n";
    const REST: &str = "2e4,1e4,9,4,1e-4,1.5,1.42,1.41";

    #[test]
    fn a_good_table_is_read_and_a_bad_one_named() {
        let rows = |wavelengths: &[f64]| -> String {
            HEADER.to_string() + &wavelengths.iter().map(|w| format!("{w},{REST}\n")).collect::<String>()
        };
        let spectrum = reading(&rows(&[400.0, 405.0, 410.0])).unwrap();
        assert_eq!(spectrum.range(), [400.0, 410.0]);
        assert_eq!(spectrum.at(402.0).unwrap().indices, [1.5, 1.42, 1.41]);
        let said = |text: String| reading(&text).unwrap_err().to_string();
        let falls = said(rows(&[410.0, 405.0]));
        assert!(falls.contains("line 3, wavelength_nm: found 405, expected more than 410"), "{falls}");
        let gap = said(rows(&[400.0, 405.0, 410.0, 420.0, 425.0]));
        assert!(gap.contains("found a gap from 410 to 420 nm, expected steps of 5 nm"), "{gap}");
        let unit = said(rows(&[400.0]).replace("chlorophyll_cm2_g", "chlorophyll_m2_g"));
        assert!(
            unit.contains("chlorophyll_m2_g: this column is in another unit") && unit.contains("chlorophyll_cm2_g")
        );
        let micro = said(rows(&[0.4]).replace("wavelength_nm", "wavelength_um"));
        assert!(micro.contains("wavelength_um") && micro.contains("expected wavelength_nm"), "{micro}");
        assert!(said(rows(&[400.0]).replace("water_per_cm", "sea")).contains("water_per_cm: no such column"));
        assert!(said(rows(&[400.0]).replace("9,4", ",4")).contains("line 2, protein_cm2_g: the cell is empty"));
        assert!(said(rows(&[400.0]).replace("9,4", "x,4")).contains("found \"x\", expected 0 or more"));
        assert!(said(rows(&[400.0]).replace("1.42", "14.2")).contains("a refractive index from 1 to 3"));
        assert!(said(HEADER.into()).contains("no rows"));
        assert!(said(rows(&[400.0]).replace(",1.41", "")).contains("line 2"));
    }
}
