//! A table that holds one spectrum: a row for each wavelength, and every cell that is asked for is a number.

use super::{in_nm, is_wavelength, open, wavelength};
use crate::instrument::ReflectanceUnit;
use crate::table::{InputTable, TableRecord, percent};
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// A spectrum of a few quantities, each a share of the light.
#[derive(Debug, Clone, PartialEq)]
pub struct SingleSpectrum {
    /// The file that it was read from.
    pub file: PathBuf,
    /// Wavelengths (nm), ascending.
    pub wavelengths: Vec<f64>,
    /// For each quantity, its values at these wavelengths.
    pub values: Vec<Vec<f64>>,
}

impl SingleSpectrum {
    /// Reads the columns that `choose` picks from a table's header. With none it is a list of wavelengths.
    ///
    /// # Errors
    /// [`Error::Input`] for a file that is no such table, a cell that is no share of 1, and a wavelength that is given
    /// twice; and what `choose` refuses.
    pub fn read(path: &Path, choose: impl FnOnce(&InputTable) -> Result<Vec<String>>) -> Result<SingleSpectrum> {
        let mut table = open(path)?;
        let Some((nm, unit_nm)) = wavelength(&table)? else {
            let what = format!("no such column; the header has {}", table.shown_header());
            return Err(Error::field(table.name(), "wavelength_nm", what));
        };
        let names = choose(&table)?;
        let stated = table.stated().and_then(|stated| stated.unit);
        if stated.is_none() && !names.is_empty() && percent::looks(&table.head(&names)) {
            let what =
                format!("its {} look like per cent; expected shares of 1, so divide them by 100", names.join(", "));
            return Err(Error::input(table.name(), what));
        }
        let scale = if stated == Some(ReflectanceUnit::PerCent) { 0.01 } else { 1.0 };
        let places = std::iter::once(&nm).chain(&names).map(|n| table.require(n)).collect::<Result<Vec<usize>>>()?;
        let name = table.name().to_path_buf();
        let (mut rows, mut record): (Vec<Vec<f64>>, _) = (Vec::new(), TableRecord::default());
        while table.next_record(&mut record)? {
            let bad = |what: String| Err(Error::field(&name, &format!("line {}", record.line()), what));
            if let Some(fault) = record.fault(table.header.len()) {
                return bad(fault);
            }
            let mut row = Vec::with_capacity(places.len());
            for (k, place) in places.iter().enumerate() {
                let own = &table.header[*place];
                let value = match table.number(&record, *place) {
                    Ok(Some(value)) if k == 0 => in_nm(value, unit_nm),
                    Ok(Some(value)) => scale * value,
                    Ok(None) => return bad(format!("{own} has no reading; expected a number in every row")),
                    Err(why) => return bad(why),
                };
                if k == 0 && !is_wavelength(value) {
                    return bad(format!("{own} is {value} nm; expected 100 to 30000"));
                }
                if k > 0 && !(0.0..=1.0).contains(&value) {
                    return bad(format!("{own} is {value}; expected a share of the light, 0 to 1"));
                }
                row.push(value);
            }
            rows.push(row);
        }
        if rows.is_empty() {
            return Err(Error::input(&name, "no rows below the header; expected one for each wavelength"));
        }
        rows.sort_by(|a, b| a[0].total_cmp(&b[0]));
        if let Some(pair) = rows.windows(2).find(|pair| pair[0][0] == pair[1][0]) {
            let what = format!("found {} twice, expected each once: the spectrum of one leaf or soil", pair[0][0]);
            return Err(Error::field(&name, &nm, what));
        }
        let column = |k: usize| rows.iter().map(|row| row[k]).collect();
        Ok(SingleSpectrum {
            file: path.to_path_buf(),
            wavelengths: column(0),
            values: (1..places.len()).map(column).collect(),
        })
    }

    /// The first and the last wavelength (nm).
    pub fn range(&self) -> [f64; 2] {
        [self.wavelengths[0], self.wavelengths[self.wavelengths.len() - 1]]
    }

    /// Quantity `k` at other wavelengths (nm), on straight lines between its own.
    ///
    /// # Errors
    /// [`Error::Input`] for a wavelength that the spectrum does not cover.
    pub fn at(&self, k: usize, wavelengths: &[f64]) -> Result<Vec<f64>> {
        let (own, values) = (&self.wavelengths, &self.values[k]);
        let one = |nm: &f64| {
            let [low, high] = self.range();
            if !(low <= *nm && *nm <= high) {
                let what =
                    format!("it has {low} to {high} nm, and {nm} nm is asked for; expected a spectrum that covers it");
                return Err(Error::input(&self.file, what));
            }
            let above = own.partition_point(|w| w < nm);
            if own[above] == *nm {
                return Ok(values[above]);
            }
            let t = (nm - own[above - 1]) / (own[above] - own[above - 1]);
            Ok(values[above - 1] * (1.0 - t) + values[above] * t)
        };
        wavelengths.iter().map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, names: &[&str]) -> std::result::Result<SingleSpectrum, String> {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("s.csv");
        std::fs::write(&file, text).unwrap();
        let names = names.iter().map(|n| n.to_string()).collect();
        SingleSpectrum::read(&file, |_| Ok(names)).map_err(|e| e.to_string())
    }

    #[test]
    fn a_spectrum_lies_on_straight_lines() {
        // In micrometres and out of order.
        let found = read("wavelength_um,R,T\n0.6,0.2,0.1\n0.5,0.1,0.3\n0.8,0.4,0.5\n", &["R", "T"]).unwrap();
        assert_eq!(found.wavelengths, [500.0, 600.0, 800.0]);
        let near = |k: usize, nm: f64, want: f64| {
            let at = found.at(k, &[nm]).unwrap()[0];
            assert!((at - want).abs() < 1e-12, "{nm}: {at} {want}");
        };
        [(500.0, 0.1), (550.0, 0.15), (600.0, 0.2), (650.0, 0.25), (800.0, 0.4)]
            .into_iter()
            .for_each(|(nm, want)| near(0, nm, want));
        near(1, 700.0, 0.3);
        for nm in [499.0, 801.0, f64::NAN] {
            assert!(found.at(0, &[nm]).unwrap_err().to_string().contains("it has 500 to 800 nm"));
        }
    }

    #[test]
    fn what_is_no_spectrum_is_refused() {
        for (text, words) in [
            ("x,R\n500,0.1\n", "wavelength_nm: no such column"),
            (
                "wavelength_nm,R\n0.5,0.1\n",
                "found 0.5, expected wavelengths in nm (100 to 30000), as its name says; is the",
            ),
            (
                "wavelength_um,R\n500,0.1\n",
                "expected wavelengths in um (0.1 to 30), as its name says; is the column in nm?",
            ),
            ("wavelength_nm,R\n", "no rows below the header"),
            ("wavelength_nm,R\n500,\n", "line 2: R has no reading"),
            ("wavelength_nm,R\n500,0.1\n600,1.2\n", "line 3: R is 1.2; expected a share"),
            ("wavelength_nm,R\n500,-0.1\n", "line 2: R is -0.1"),
            ("wavelength_nm,R\n500,NaN\n", "line 2: R has no reading"),
            ("wavelength_nm,R\n500,0.1\n500,0.2\n", "found 500 twice"),
            ("wavelength_nm,R\n500,12\n600,15\n", "look like per cent"),
            ("wavelength_nm,R\n500,0.1\n-7,0.2\n", "expected"),
        ] {
            let told = read(text, &["R"]).unwrap_err();
            assert!(told.contains(words), "{text}: {told}");
        }
    }
}
