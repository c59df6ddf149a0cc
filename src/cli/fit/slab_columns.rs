//! Which columns of a table `fit slab` reads.

use super::slab::{ALSO, INPUTS};
use super::spectra;
use crate::cli::{Error, Result};
use mesophyll_files::table::InputTable;

/// The wavelengths of a table in wide form, ascending: those with a reflectance (`R550`) and a transmittance (`T550`),
/// with the columns of both and of their errors.
pub(super) fn wavelengths(table: &InputTable) -> Result<Vec<(f64, [String; 4])>> {
    let found = spectra::wide(table);
    let columns: Vec<_> = found.readings.iter().filter(|c| !c.is_abaxial()).collect();
    let mut pairs: Vec<(f64, [String; 4])> = columns
        .iter()
        .filter(|r| !r.through)
        .filter_map(|r| {
            let t = columns.iter().find(|t| t.through && t.wavelength == r.wavelength)?;
            Some((r.wavelength, [r.name.clone(), t.name.clone(), r.error.clone(), t.error.clone()]))
        })
        .collect();
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let one = columns.first().filter(|_| pairs.is_empty()).map(|c| if c.through { "T" } else { "R" });
    if let Some(one) = one {
        let what =
            format!("its columns hold {one} alone; expected R and T at the same wavelengths, such as R450 and T450");
        return Err(Error::input(table.name(), what));
    }
    if pairs.is_empty() && spectra::has_others(&found) {
        return Err(spectra::nothing(table, &found, "fit slab takes columns R450, T450 and so on, or R and T"));
    }
    Ok(pairs)
}

/// The input's column for each of [`INPUTS`].
pub(super) fn column_names(mapping: &[String], table: &InputTable) -> Result<Vec<String>> {
    let usual = |(name, also): (&&str, &&[&str])| {
        let there = std::iter::once(name).chain(*also).find(|n| table.column(n).is_some());
        there.unwrap_or(name).to_string()
    };
    let mut names: Vec<String> = INPUTS.iter().zip(&ALSO).map(usual).collect();
    for pair in mapping.iter().filter(|p| !p.is_empty()) {
        let Some((name, column)) = pair.split_once('=') else {
            return Err(Error::Usage(format!(
                "--columns has {pair:?}; expected NAME=COLUMN with NAME one of {}",
                INPUTS.join(", ")
            )));
        };
        let Some(k) = INPUTS.iter().position(|n| *n == name.trim()) else {
            return Err(Error::Usage(format!(
                "--columns names {:?}; expected one of {}",
                name.trim(),
                INPUTS.join(", ")
            )));
        };
        names[k] = column.trim().to_string();
    }
    for (k, name) in names.iter().enumerate() {
        if names[..k].contains(name) {
            return Err(Error::Usage(format!("--columns uses the column {name:?} twice")));
        }
    }
    Ok(names)
}
