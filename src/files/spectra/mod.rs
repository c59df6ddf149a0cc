//! Tables of spectra as people have them: which columns hold which readings, in which unit their wavelengths are, and
//! whether the readings are in per cent. Used by fits, and by scenes whose leaves and ground have spectra.

mod name;
mod pairs;
mod single;

pub use pairs::open;
pub use single::SingleSpectrum;

use crate::progress;
use crate::table::{BatchSpec, Groups, InputTable, percent};
use crate::unit::LengthUnit;
use crate::{Error, Result};
use mesophyll_base::statistics::median;
use mesophyll_base::surface::side::Side;
use name::SpectrumColumnName;
use std::collections::{HashMap, HashSet};
use std::path::Path;

/// Names of the column with the leaf's name; the first one that exists is used.
pub const LEAF: [&str; 4] = ["leaf", "leaf_id", "sample", "sample_id"];

/// A column of readings.
#[derive(Debug, Clone, PartialEq)]
pub struct SpectrumColumn {
    /// Its name in the header.
    pub name: String,
    /// The column of its standard errors, which the table may lack.
    pub error: String,
    /// In nm; NaN where each row has its own.
    pub wavelength: f64,
    /// Of transmittance.
    pub through: bool,
    /// The lit side, where its name says so.
    pub side: Option<Side>,
}

impl SpectrumColumn {
    /// Whether the lower side was lit.
    pub fn is_abaxial(&self) -> bool {
        self.side == Some(Side::Back)
    }
}

/// Columns whose names have a number.
#[derive(Debug, Default)]
pub struct WideSpectra {
    /// Readings, each with its wavelength.
    pub readings: Vec<SpectrumColumn>,
    /// Wavelengths (nm) of columns whose names do not say what they hold.
    pub bare: Vec<(String, f64)>,
    /// Names with numbers that count: `R1`, `R2`.
    pub replicates: Vec<String>,
}

/// A table with a row for each wavelength.
#[derive(Debug)]
pub struct LongSpectra {
    /// The column of wavelengths.
    pub wavelength: String,
    /// What its unit is in nm.
    pub unit_nm: f64,
    /// The columns of readings.
    pub readings: Vec<SpectrumColumn>,
}

/// Names of a header that belong to spectra.
fn names(table: &InputTable) -> Vec<(&String, SpectrumColumnName)> {
    table.header.iter().filter_map(|text| Some((text, SpectrumColumnName::of(text)?))).collect()
}

/// What tells a reading's column from others: quantity, number (as bits) and side.
type Key = (Option<bool>, Option<u64>, Option<bool>);

fn key(name: &SpectrumColumnName) -> Key {
    (name.through, name.number.map(f64::to_bits), name.side.map(|side| side == Side::Back))
}

/// The columns of standard errors among `names`.
fn errors<'a>(names: &[(&'a String, SpectrumColumnName)]) -> HashMap<Key, &'a String> {
    names.iter().filter(|(_, n)| n.error).map(|(text, n)| (key(n), *text)).collect()
}

/// The column of a reading's standard error, which the table may lack.
fn error_of(text: &str, name: &SpectrumColumnName, errors: &HashMap<Key, &String>) -> String {
    errors.get(&key(name)).map_or_else(|| format!("{text}_err"), |error| error.to_string())
}

/// The columns of a table whose names have a number.
pub fn wide(table: &InputTable) -> WideSpectra {
    let names = names(table);
    let numbered: Vec<&(&String, SpectrumColumnName)> =
        names.iter().filter(|(_, n)| n.is_numbered() && !n.error).collect();
    let numbers: Vec<f64> =
        numbered.iter().filter(|(_, n)| n.unit_nm.is_none()).filter_map(|(_, n)| n.number).collect();
    let micrometres = are_micrometres(&numbers) && numbers.iter().any(|v| v.fract() != 0.0);
    let (mut found, errors) = (WideSpectra::default(), errors(&names));
    for (text, name) in numbered {
        let unit = name.unit_nm.unwrap_or(if micrometres { 1e3 } else { 1.0 });
        let wavelength = in_nm(name.number.unwrap_or(f64::NAN), unit);
        if !is_wavelength(wavelength) {
            found.replicates.extend(name.through.is_some().then(|| text.to_string()));
            continue;
        }
        match name.through {
            Some(through) => found.readings.push(SpectrumColumn {
                name: text.to_string(),
                error: error_of(text, name, &errors),
                wavelength,
                through,
                side: name.side,
            }),
            None => found.bare.push((text.to_string(), wavelength)),
        }
    }
    found
}

/// A wavelength in nm; µm are rounded, so that 0.57 is 570 and no number beside it.
pub fn in_nm(wavelength: f64, unit_nm: f64) -> f64 {
    if unit_nm == 1.0 { wavelength } else { (wavelength * unit_nm * 1e6).round() / 1e6 }
}

/// Whether a number can be a wavelength in nm. Smaller ones count replicates.
fn is_wavelength(nm: f64) -> bool {
    (100.0..=30_000.0).contains(&nm)
}

/// Whether numbers can be wavelengths in µm.
fn are_micrometres(numbers: &[f64]) -> bool {
    !numbers.is_empty() && numbers.iter().all(|v| (0.1..=30.0).contains(v))
}

/// The columns of a table with a row for each wavelength; `None` for a table without a column of wavelengths.
///
/// # Errors
/// Two columns of one quantity; wavelengths in an unknown unit.
pub fn long(table: &InputTable) -> Result<Option<LongSpectra>> {
    let Some((wavelength, unit_nm)) = wavelength(table)? else { return Ok(None) };
    Ok(Some(LongSpectra { wavelength, unit_nm, readings: readings(table)? }))
}

/// The column of wavelengths, and what its unit is in nm.
///
/// # Errors
/// As [`long`]; numbers that cannot be in the unit of the column's name.
pub fn wavelength(table: &InputTable) -> Result<Option<(String, f64)>> {
    let names = names(table);
    let usual = names.iter().find(|(text, _)| *text == "wavelength_nm");
    let Some((column, name)) = usual.or_else(|| names.iter().find(|(_, n)| n.is_wavelength())) else { return Ok(None) };
    let values = table.head(std::slice::from_ref(*column));
    let unit_nm = match name.unit_nm {
        Some(unit) if values.is_empty() || values.iter().any(|v| is_wavelength(v * unit)) => unit,
        Some(unit) => {
            let (own, other) = if unit == 1.0 { ("nm (100 to 30000)", "um") } else { ("um (0.1 to 30)", "nm") };
            let expected = format!("wavelengths in {own}, as its name says; is the column in {other}?");
            return Err(Error::unexpected(table.name(), column, values[0], expected));
        }
        None => unit_of(table, column, &values)?,
    };
    Ok(Some((column.to_string(), unit_nm)))
}

/// The unit of wavelengths by their size.
fn unit_of(table: &InputTable, column: &str, values: &[f64]) -> Result<f64> {
    if are_micrometres(values) {
        return Ok(1e3);
    }
    match values.iter().find(|v| !is_wavelength(**v)) {
        None => Ok(1.0),
        Some(odd) => {
            let expected = "wavelengths in nm (100 to 30000) or in um (0.1 to 30)";
            Err(Error::unexpected(table.name(), column, odd, expected))
        }
    }
}

/// Columns of readings without a wavelength in their names: `R`, `T(abaxial)`, `reflectance`.
///
/// # Errors
/// Two columns of one quantity and side.
pub fn readings(table: &InputTable) -> Result<Vec<SpectrumColumn>> {
    let names = names(table);
    let (mut found, errors): (Vec<SpectrumColumn>, _) = (Vec::new(), errors(&names));
    for (text, name) in &names {
        let (Some(through), None, false, false) = (name.through, name.number, name.error, name.wavelength) else {
            continue;
        };
        if let Some(other) = found.iter().find(|c| (c.through, c.side) == (through, name.side)) {
            let what = format!("{} holds the same quantity; rename or remove one of the two", other.name);
            return Err(Error::field(table.name(), text, what));
        }
        let error = error_of(text, name, &errors);
        found.push(SpectrumColumn { name: text.to_string(), error, wavelength: f64::NAN, through, side: name.side });
    }
    Ok(found)
}

/// Sets the columns of reflectance, transmittance, thickness and errors in `names` where the table has none of the
/// `usual` name: `reflectance`, `T(adaxial)`, `Thickness (um)`. Of a leaf's two sides the adaxial one is taken, and
/// that is said.
///
/// # Errors
/// As [`readings`].
pub fn find(table: &InputTable, usual: &[&str], names: &mut [String]) -> Result<()> {
    let lacks = |k: usize, names: &[String]| names[k] == usual[k] && table.column(&names[k]).is_none();
    if lacks(0, names) && lacks(1, names) {
        let found = readings(table)?;
        let of = |through: bool, back: bool| found.iter().find(|c| c.through == through && c.is_abaxial() == back);
        if let (Some(r), Some(t)) = (of(false, false), of(true, false)) {
            if of(false, true).is_some() || of(true, true).is_some() {
                let name = table.name().display();
                progress::say(format!("{name}: {} and {} are read, not those of the other side", r.name, t.name));
            }
            for (k, name) in [(0, &r.name), (1, &t.name), (3, &r.error), (4, &t.error)] {
                if lacks(k, names) && table.column(name).is_some() {
                    names[k].clone_from(name);
                }
            }
        }
    }
    if lacks(2, names) {
        let is_thickness = |h: &&String| {
            let lower = h.to_lowercase();
            let rest = lower.strip_prefix("leaf").map_or(lower.as_str(), |rest| rest.trim_start_matches(['_', ' ']));
            let unit =
                rest.strip_prefix("thickness").map(|unit| unit.trim_matches([' ', '_', '(', ')', '[', ']', '.']));
            unit.is_some_and(|unit| unit.is_empty() || unit.parse::<LengthUnit>().is_ok())
        };
        if let Some(thickness) = table.header.iter().find(is_thickness) {
            names[2].clone_from(thickness);
        }
    }
    Ok(())
}

/// Whether there are columns with numbers in their names that are no readings with a wavelength.
pub fn has_others(wide: &WideSpectra) -> bool {
    !(wide.bare.is_empty() && wide.replicates.is_empty())
}

/// Why a table has no readings that can be used. `takes` says what the command takes.
pub fn nothing(table: &InputTable, wide: &WideSpectra, takes: &str) -> Error {
    let some = |names: &[String]| {
        let more = if names.len() > 4 { " and so on" } else { "" };
        format!("{}{more}", names[..names.len().min(4)].join(", "))
    };
    let what = if !wide.bare.is_empty() {
        let names: Vec<String> = wide.bare.iter().map(|(name, _)| name.clone()).collect();
        format!(
            "its columns {} look like wavelengths, and nothing says whether they hold reflectance or transmittance; \
             {takes}; or give each leaf two rows and say in a column type which is R and which is T",
            some(&names)
        )
    } else if !wide.replicates.is_empty() {
        format!(
            "its columns {} are numbered like replicates and not by wavelengths; average them into R and T and state \
             the standard errors of the means as R_err and T_err, or give each replicate rows of its own",
            some(&wide.replicates)
        )
    } else {
        format!("no columns of readings; {takes}; found {}", table.shown_header())
    };
    Error::input(table.name(), what)
}

/// A standard error of shares from which on it looks like a number in per cent: no instrument is off by a twentieth of
/// all light.
const LARGE_NOISE: f64 = 0.05;

/// In which unit a table's readings are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReadingUnit {
    /// What is multiplied with them to make fractions of 1.
    pub scale: f64,
    /// Whether they plainly are in per cent and nobody said so.
    unsaid: bool,
}

impl ReadingUnit {
    /// Judges the first rows of `columns`. `percent` says that they are in per cent.
    ///
    /// # Errors
    /// [`Error::Input`] for readings that are fractions although `percent` says otherwise, and for a file of an
    /// instrument whose form states the other unit.
    pub fn of(table: &InputTable, columns: &[String], percent: bool) -> Result<ReadingUnit> {
        let scale = if percent { 0.01 } else { 1.0 };
        if let Some(stated) = table.stated().filter(|stated| stated.unit.is_some()) {
            stated.check_percent(table.name(), percent)?;
            return Ok(ReadingUnit { scale, unsaid: false });
        }
        // Marks of missing readings tell nothing.
        let mut values = table.head(columns);
        values.retain(|v| (-0.9..=200.0).contains(v));
        let named =
            columns.iter().any(|c| table.column(c).is_some() && SpectrumColumnName::of(c).is_some_and(|n| n.percent));
        if percent && !named && percent::are_fractions(&values) {
            let largest = values.iter().fold(0.0, |a: f64, v| a.max(*v));
            let what =
                format!("no reading is above {largest}, so they are fractions of 1 already; leave out --percent");
            return Err(Error::input(table.name(), what));
        }
        let unsaid = !percent && (named || percent::looks(&values));
        Ok(ReadingUnit { scale, unsaid })
    }

    /// Why these readings are refused before they are computed, if the whole table plainly is in per cent.
    pub fn refuse<'a>(&self, mut readings: impl Iterator<Item = (&'a str, f64)>) -> Option<String> {
        self.unsaid.then(|| match readings.find(|(_, v)| v.is_finite()) {
            Some((name, value)) => format!("{name} is {value}: {}", percent::SENTENCE),
            None => "no reading".into(),
        })
    }

    /// As [`ReadingUnit::refuse`], also for one reading that can only be in per cent.
    pub fn refuse_each<'a>(&self, readings: impl Iterator<Item = (&'a str, f64)> + Clone) -> Option<String> {
        let must = |(_, v): &(&str, f64)| self.scale == 1.0 && percent::must_be(*v);
        let one = |(name, v): (&str, f64)| format!("{name} is {v}: {}", percent::SENTENCE);
        self.refuse(readings.clone()).or_else(|| readings.clone().find(must).map(one))
    }

    /// Judges the standard error that was stated for all readings: a share of 1, also of readings in per cent.
    ///
    /// # Errors
    /// [`Error::Argument`] for one that is larger than most readings and can hardly be a share of 1.
    pub fn check_noise(&self, table: &InputTable, columns: &[String], noise: Option<f64>) -> Result<()> {
        let Some(noise) = noise.filter(|noise| *noise >= LARGE_NOISE && !self.unsaid) else { return Ok(()) };
        let mut shares: Vec<f64> = table.head(columns).into_iter().map(|v| self.scale * v).collect();
        shares.retain(|v| (-0.009..=2.0).contains(v));
        let Some(median) = median(&mut shares) else { return Ok(()) };
        // Rounded, because 0.07 / 100 is 0.0007000000000000001.
        let meant = format!("--noise {}", (noise * 1e4).round() / 1e6);
        if noise > median {
            let expected = format!(
                "a share of 1, also beside --percent; half of the first readings are below {median:.3}, less than \
                 their own error: was it meant in per cent ({meant})?"
            );
            return Err(Error::argument("--noise", noise, expected));
        }
        progress::say(format!(
            "--noise {noise} is {:.0} % of all light, more than instruments are off by: it is a share of 1, also \
             beside --percent; was it meant in per cent ({meant})?",
            100.0 * noise
        ));
        Ok(())
    }

    /// Whether all rows are refused.
    pub fn refuses_all(&self) -> bool {
        self.unsaid
    }
}

/// The name of a table's only leaf: that of its file.
pub fn only_leaf(path: &Path) -> String {
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    if stem.is_empty() || stem == "-" { "leaf".into() } else { stem }
}

/// All rows of a table in long form, grouped by leaf. A table without a column of leaves holds one leaf, named as the
/// file, where no wavelength is repeated.
///
/// # Errors
/// As [`Groups::read`]; a wavelength that is repeated where nothing names the leaves.
pub fn leaves(table: InputTable, spec: &BatchSpec) -> Result<Groups> {
    if let Some(by) = LEAF.into_iter().find(|by| table.column(by).is_some()) {
        return Groups::read(table, spec, by);
    }
    let (name, source) = (table.name().to_path_buf(), table.source().to_path_buf());
    let groups = Groups::one(table, spec, LEAF[0], &only_leaf(&source))?;
    let mut seen = HashSet::new();
    if let Some(row) = groups.rows().find(|row| !seen.insert((row.values[0].to_bits(), row.texts.first().cloned()))) {
        let what = format!(
            "no such column, and the wavelength {} of line {} is there before; expected the name of the leaf in each \
             row",
            row.values[0], row.line
        );
        return Err(Error::field(&name, LEAF[0], what));
    }
    Ok(groups)
}
