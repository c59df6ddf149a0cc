//! Tables of leaves with measured contents, for training.

use super::CONTENTS;
use super::table::measured as column_of;
use super::training::{self, PlateExample, PlateTraining};
use crate::{Error, Result};
use mesophyll_files::progress;
use mesophyll_files::spectra::{self, ReadingUnit, SpectrumColumn};
use mesophyll_files::table::{InputTable, Omissions, TableRecord, counted};
use mesophyll_optics::side::Side;
use std::path::Path;

/// The lit side that a cell names; the upper one where it names none.
///
/// # Errors
/// Another word.
pub fn side(word: Option<&str>) -> std::result::Result<Side, String> {
    match word.unwrap_or_default() {
        "" => Ok(Side::Front),
        word => Side::of_botanical(word).ok_or_else(|| format!("side is {word:?}; expected adaxial or abaxial")),
    }
}

/// The columns of R and of T at each wavelength, ascending.
fn pairs(name: &Path, columns: &[SpectrumColumn]) -> Result<Vec<(f64, [Option<usize>; 2])>> {
    let mut pairs: Vec<(f64, [Option<usize>; 2])> = Vec::new();
    for (k, c) in columns.iter().enumerate().filter(|(_, c)| !c.is_abaxial()) {
        let at = match pairs.iter().position(|p| p.0 == c.wavelength) {
            Some(at) => at,
            None => {
                pairs.push((c.wavelength, [None; 2]));
                pairs.len() - 1
            }
        };
        let slot = &mut pairs[at].1[usize::from(c.through)];
        if let Some(other) = slot.replace(k) {
            let what = format!("{} holds the same quantity; rename or remove one of the two", columns[other].name);
            return Err(Error::field(name, &c.name, what));
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(pairs)
}

/// Reads a table of leaves: a row a leaf, with R and T by wavelength and measured contents. What is left out is said.
///
/// # Errors
/// A table without readings of both kinds, or without the columns of contents; readings in per cent.
pub fn read(mut table: InputTable, percent: bool) -> Result<PlateTraining> {
    let name = table.name().to_path_buf();
    const TAKES: &str = "fit coefficients takes a row a leaf, with R and T by wavelength in nm, such as R450, T450";
    if let Some(long) = spectra::long(&table)? {
        let what = format!("a column of wavelengths, so a row is no leaf; {TAKES}");
        return Err(Error::field(&name, &long.wavelength, what));
    }
    let found = spectra::wide(&table);
    let columns = found.readings.clone();
    let pairs = pairs(&name, &columns)?;
    if pairs.is_empty() {
        return Err(spectra::nothing(&table, &found, TAKES));
    }
    let below = columns.iter().filter(|c| c.is_abaxial()).count();
    if below > 0 {
        progress::say(format!("{}: {} of lower sides left out", name.display(), counted(below, "column")));
    }
    if !pairs.iter().any(|p| p.1[0].is_some()) || !pairs.iter().any(|p| p.1[1].is_some()) {
        return Err(Error::input(&name, "it has only one of reflectance and transmittance; training needs both"));
    }
    let species = table.column("species");
    if species.is_none() {
        progress::say(format!(
            "{}: no column species, so each leaf counts as a species of its own, and neighbouring rows are left out \
             together; where leaves of one plant stand apart, the errors are too small",
            name.display()
        ));
    }
    let measured = (0..4).map(|k| table.require(&column_of(k))).collect::<Result<Vec<_>>>()?;
    let names: Vec<String> = columns.iter().map(|c| c.name.clone()).collect();
    let shares = ReadingUnit::of(&table, &names, percent)?;
    let places = names.iter().map(|n| table.require(n)).collect::<Result<Vec<_>>>()?;
    let lit = table.column("side");
    let leaf = spectra::LEAF.into_iter().find_map(|n| table.column(n));
    let wavelengths = pairs.iter().map(|p| p.0).collect();
    let mut out = PlateTraining { wavelengths, without_species: species.is_none(), ..PlateTraining::default() };
    let (left, mut record) = (Omissions::default(), TableRecord::default());
    while table.next_record(&mut record)? {
        let line = record.line();
        if let Some(fault) = record.fault(table.header.len()) {
            left.add(line, fault);
            continue;
        }
        match lit.map_or(Ok(Side::Front), |place| side(Some(record.shown(place).trim()))) {
            Ok(Side::Front) => {}
            Ok(Side::Back) => {
                left.add(line, "a leaf lit from below; coefficients describe leaves lit from above");
                continue;
            }
            Err(why) => {
                left.add(line, why);
                continue;
            }
        }
        let number = |place: usize| -> std::result::Result<f64, String> {
            table.number(&record, place).map(|x| x.unwrap_or(f64::NAN))
        };
        let mut spectra = vec![[f64::NAN; 2]; pairs.len()];
        let mut count = 0;
        for (pair, (_, of)) in spectra.iter_mut().zip(&pairs) {
            for (value, column) in pair.iter_mut().zip(of) {
                let Some(column) = *column else { continue };
                match number(places[column]).map(|x| (x, shares.scale * x)) {
                    Ok((x, _)) if x.is_nan() => {}
                    Ok((_, x)) if (-0.1..=1.1).contains(&x) => {
                        *value = x;
                        count += 1;
                    }
                    Ok((x, _)) => {
                        let reading = (columns[column].name.as_str(), x);
                        let why = shares.refuse_each([reading].into_iter());
                        left.add(line, why.unwrap_or_else(|| format!("{} is {x}; expected 0 to 1", reading.0)));
                    }
                    Err(why) => left.add(line, why),
                }
            }
        }
        let mut contents = [f64::NAN; 4];
        for (k, (content, place)) in contents.iter_mut().zip(&measured).enumerate() {
            match number(*place) {
                Ok(x) if x.is_nan() || x >= 0.0 && x.is_finite() => *content = x,
                Ok(x) => left.add(line, format!("measured_{} is {x}; expected 0 or more", CONTENTS[k])),
                Err(why) => left.add(line, why),
            }
        }
        let shown = leaf.map(|k| record.shown(k).trim().to_string()).filter(|name| !name.is_empty());
        let shown = shown.unwrap_or_else(|| format!("line {line}"));
        let kind = species.map_or_else(|| format!("line {line}"), |k| record.shown(k).trim().to_string());
        if kind.is_empty() {
            left.add(line, "species is empty");
            continue;
        }
        if count < training::FEWEST_WAVELENGTHS {
            let fewest = training::FEWEST_WAVELENGTHS;
            left.add(line, format!("it has {}, expected at least {fewest}", counted(count, "reading")));
            continue;
        }
        let place = out.species.iter().position(|s| *s == kind).unwrap_or_else(|| {
            out.species.push(kind);
            out.species.len() - 1
        });
        out.examples.push(PlateExample { name: shown, species: place, spectra, measured: contents });
    }
    if shares.refuses_all() {
        let why = mesophyll_files::table::percent::SENTENCE;
        return Err(Error::input(&name, format!("its readings are above 1: {why}")));
    }
    left.say(&name);
    Ok(out)
}
