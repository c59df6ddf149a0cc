//! Which columns of a table `fit slab` reads.

use super::slab::{ALSO, INPUTS};
use crate::cli::{Error, Result};
use mesophyll_files::spectra;
use mesophyll_files::table::{BatchSpec, InputRow, InputTable};
use mesophyll_fits::slab::{CoefficientPrior, SlabMeasurement};
use mesophyll_optics::slab::inverse::SlabCoefficient;
use std::cmp::Ordering;

/// The columns of one slab: a row has one slab in long form, and one a wavelength in wide form.
#[derive(Debug)]
pub(super) struct SlabColumns {
    /// In the order of [`INPUTS`].
    pub names: Vec<String>,
    /// In nm, where a row has several slabs.
    pub wavelength: Option<f64>,
    /// The numbers of the columns that are read.
    places: Vec<Option<usize>>,
}

impl SlabColumns {
    pub(super) fn new(names: Vec<String>, wavelength: Option<f64>) -> SlabColumns {
        SlabColumns { names, wavelength, places: Vec::new() }
    }

    /// The columns of reflectance and transmittance.
    pub(super) fn readings(&self) -> std::slice::Iter<'_, String> {
        self.names[..2].iter()
    }

    /// The columns of their errors.
    pub(super) fn errors(&self) -> std::slice::Iter<'_, String> {
        self.names[3..5].iter()
    }

    /// Finds the columns among those of a batch.
    pub(super) fn within(self, spec: &BatchSpec) -> SlabColumns {
        SlabColumns { places: self.names.iter().map(|name| spec.place(name)).collect(), ..self }
    }

    /// What a row states, in the units of the table; NaN where the table has no such column.
    ///
    /// # Errors
    /// A reading that cannot be read; two known coefficients.
    pub(super) fn read(&self, row: &InputRow) -> std::result::Result<SlabMeasurement, String> {
        if let Some((_, why)) = row.faults().find(|(place, _)| self.places.contains(&Some(*place))) {
            return Err(why.to_string());
        }
        let [rho_d, rho_t, thickness_mm, rho_d_err, rho_t_err, sigma_a, sigma_s, a_err, s_err] =
            std::array::from_fn(|k| self.places[k].map_or(f64::NAN, |place| row.get(place)));
        let known = match (sigma_a.is_nan(), sigma_s.is_nan()) {
            (true, true) => None,
            (true, false) => Some((SlabCoefficient::Scattering, sigma_s, s_err)),
            (false, true) => Some((SlabCoefficient::Absorption, sigma_a, a_err)),
            (false, false) => {
                return Err(format!("{} and {} are both given; expected one", self.names[5], self.names[6]));
            }
        };
        let known = known.map(|(coefficient, sigma, err)| CoefficientPrior { coefficient, sigma, err });
        Ok(SlabMeasurement { rho_d, rho_t, thickness_mm, rho_d_err, rho_t_err, known })
    }
}

/// The wavelengths of a table in wide form, ascending: those with a reflectance (`R550`) and a transmittance (`T550`).
/// What each wavelength has no columns for has the columns of `names`.
pub(super) fn wavelengths(table: &InputTable, names: &[String]) -> Result<Vec<SlabColumns>> {
    let found = spectra::wide(table);
    let columns: Vec<_> = found.readings.iter().filter(|c| !c.is_abaxial()).collect();
    let mut pairs: Vec<SlabColumns> = columns
        .iter()
        .filter(|r| !r.through)
        .filter_map(|r| {
            let t = columns.iter().find(|t| t.through && t.wavelength == r.wavelength)?;
            let mut names = names.to_vec();
            for (k, name) in [(0, &r.name), (1, &t.name), (3, &r.error), (4, &t.error)] {
                names[k].clone_from(name);
            }
            Some(SlabColumns::new(names, Some(r.wavelength)))
        })
        .collect();
    pairs.sort_by(|a, b| a.wavelength.partial_cmp(&b.wavelength).unwrap_or(Ordering::Equal));
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
