//! The file of coefficients: a row a wavelength, and in its last two columns what is no function of the wavelength.

use super::misfit::PlateMisfit;
use super::{CONTENTS, FREE, PlateCoefficients, PlatePoint, PlatePopulation, SUBSTANCES, USUAL, VARIANT};
use crate::{Error, Result};
use mesophyll_files::table::{InputTable, TableRecord, push_number, push_text};
use std::collections::HashMap;
use std::path::Path;

/// The columns of the constants, whose names end in their units where they have one.
const CONSTANTS: [&str; FREE] =
    ["chlorophyll_cm2_g", "carotenoid_cm2_g", "water_per_cm", "dry_cm2_g", "brown", "n", "growth"];
/// What one of the constants is in the file, for one inside: contents there are µg/cm² and g/cm², absorptions are for
/// 1 g.
const FACTORS: [f64; FREE] = [1e6 / USUAL[0], 1e6 / USUAL[1], 1.0 / USUAL[2], 1.0 / USUAL[3], 1.0 / USUAL[4], 1.0, 1.0];
/// The free numbers of a leaf, as the file names them.
const UNKNOWNS: [&str; FREE] = ["chlorophyll", "carotenoid", "water", "dry", "brown", "plates", "gloss"];
/// The column that names what is no function of the wavelength, and the column of its value.
const SETTING: [&str; 2] = ["setting", "value"];
/// The smallest and largest refractive index of a plate.
const INDEX: [f64; 2] = [1.0, 3.0];

/// Whether a table of `--pigments` holds coefficients of plates.
pub fn is_one(table: &InputTable) -> bool {
    SETTING.iter().chain(&["growth"]).all(|name| table.column(name).is_some())
}

fn mode_name(through: usize, k: usize) -> String {
    format!("misfit_{}_{}", ["r", "t"][through], k + 1)
}

/// What is no function of the wavelength.
fn settings(all: &PlateCoefficients) -> Vec<(String, String)> {
    let PlatePopulation { mean, spread, ratio, off, rms, counts } = all.population;
    let mut out: Vec<(String, String)> =
        vec![("variant".into(), VARIANT.into()), ("unknowns".into(), UNKNOWNS.join(" "))];
    let mut number = |name: String, value: f64| {
        let mut bytes = Vec::new();
        push_number(&mut bytes, value);
        out.push((name, String::from_utf8_lossy(&bytes).into_owned()));
    };
    number("leaves".into(), counts[0] as f64);
    number("species".into(), counts[1] as f64);
    number("rms".into(), rms);
    number("misfit_reach_nm".into(), all.misfit.reach);
    number("carotenoid_per_chlorophyll".into(), ratio[0]);
    number("carotenoid_spread_ug_cm2".into(), ratio[1]);
    (0..4).for_each(|k| number(format!("off_{}", SUBSTANCES[k]), off[k]));
    for k in 0..FREE {
        let unit = USUAL.get(k).copied().unwrap_or(1.0);
        number(format!("mean_{}", UNKNOWNS[k]), mean[k] * unit);
        number(format!("spread_{}", UNKNOWNS[k]), spread[k] * unit);
    }
    out
}

/// How many wavelengths a file needs to have room for what is no function of the wavelength.
pub const ROWS: usize = 26;

/// The text of the file.
pub fn write(all: &PlateCoefficients) -> Vec<u8> {
    let mut header: Vec<String> = vec!["wavelength_nm".into()];
    CONSTANTS.iter().for_each(|name| header.extend([name.to_string(), format!("{name}_err")]));
    for through in 0..2 {
        header.extend((0..all.misfit.modes.len()).map(|k| mode_name(through, k)));
    }
    header.extend(["misfit_short_r", "misfit_short_t"].into_iter().chain(SETTING).map(String::from));
    let mut bytes = (header.join(",") + "\n").into_bytes();
    let settings = settings(all);
    for (w, (wavelength, point)) in all.wavelengths.iter().zip(&all.points).enumerate() {
        let constants = point.all();
        let mut numbers = vec![*wavelength];
        for j in 0..FREE {
            numbers.extend([constants[j], all.errors[w][j]].map(|x| x * FACTORS[j]));
        }
        for through in 0..2 {
            numbers.extend(all.misfit.modes.iter().map(|m| m[w][through]));
        }
        numbers.extend(all.misfit.short[w]);
        for x in numbers {
            push_number(&mut bytes, x);
            bytes.push(b',');
        }
        if let Some((name, value)) = settings.get(w) {
            push_text(&mut bytes, name);
            bytes.push(b',');
            push_text(&mut bytes, value);
        } else {
            bytes.push(b',');
        }
        bytes.push(b'\n');
    }
    bytes
}

struct Reader<'a> {
    path: &'a Path,
    settings: HashMap<String, String>,
}

impl Reader<'_> {
    fn text(&self, name: &str) -> Result<&str> {
        let found = self.settings.get(name).map(String::as_str);
        found.ok_or_else(|| {
            Error::field(
                self.path,
                SETTING[0],
                format!("no row says {name}; was the file written by fit coefficients?"),
            )
        })
    }

    fn number(&self, name: &str, least: f64) -> Result<f64> {
        let text = self.text(name)?;
        match text.parse::<f64>() {
            Ok(x) if x.is_finite() && x >= least => Ok(x),
            _ => Err(Error::unexpected(self.path, name, format!("{text:?}"), format!("a number of at least {least}"))),
        }
    }

    fn population(&self) -> Result<PlatePopulation> {
        let (mut mean, mut spread, mut off) = ([0.0; FREE], [0.0; FREE], [0.0; 4]);
        for k in 0..FREE {
            let unit = USUAL.get(k).copied().unwrap_or(1.0);
            mean[k] = self.number(&format!("mean_{}", UNKNOWNS[k]), 0.0)? / unit;
            spread[k] = self.number(&format!("spread_{}", UNKNOWNS[k]), f64::MIN_POSITIVE)? / unit;
        }
        for (off, name) in off.iter_mut().zip(SUBSTANCES) {
            *off = self.number(&format!("off_{name}"), 0.0)?;
        }
        let least = f64::MIN_POSITIVE;
        let ratio = [self.number("carotenoid_per_chlorophyll", 0.0)?, self.number("carotenoid_spread_ug_cm2", least)?];
        let counts = [self.number("leaves", 0.0)? as usize, self.number("species", 0.0)? as usize];
        Ok(PlatePopulation { mean, spread, ratio, off, rms: self.number("rms", least)?, counts })
    }
}

/// Reads a file of coefficients.
///
/// # Errors
/// Another variant, a column or a setting that is missing, a cell that is no number or out of range, wavelengths that
/// do not ascend. Each names the file, the line and the column.
pub fn read(path: &Path) -> Result<PlateCoefficients> {
    let mut table = InputTable::open(path)?;
    let modes = (0..).take_while(|k| table.column(&mode_name(0, *k)).is_some()).count();
    let mut columns: Vec<(String, [f64; 2])> = vec![("wavelength_nm".into(), [f64::MIN_POSITIVE, f64::MAX])];
    for (j, name) in CONSTANTS.iter().enumerate() {
        let range = if j == 5 { INDEX } else { [if j == 6 { f64::MIN_POSITIVE } else { 0.0 }, f64::MAX] };
        columns.extend([(name.to_string(), range), (format!("{name}_err"), [0.0, f64::MAX])]);
    }
    for through in 0..2 {
        columns.extend((0..modes).map(|k| (mode_name(through, k), [-1.0, 1.0])));
    }
    columns.extend(["misfit_short_r", "misfit_short_t"].map(|name| (name.to_string(), [0.0, 1.0])));
    let places = columns.iter().map(|(name, _)| table.require(name)).collect::<Result<Vec<_>>>()?;
    let [setting, value] = [table.require(SETTING[0])?, table.require(SETTING[1])?];
    let mut settings = HashMap::new();
    let (mut wavelengths, mut points, mut errors): (Vec<f64>, Vec<PlatePoint>, Vec<[f64; FREE]>) = Default::default();
    let mut misfit = PlateMisfit { modes: vec![Vec::new(); modes], short: Vec::new(), reach: 0.0 };
    let mut record = TableRecord::default();
    while table.next_record(&mut record)? {
        let line = format!("line {}", record.line());
        if let Some(fault) = record.fault(table.header.len()) {
            return Err(Error::field(path, &line, fault));
        }
        let mut numbers = Vec::with_capacity(places.len());
        for (place, (name, [least, most])) in places.iter().zip(&columns) {
            match table.number(&record, *place) {
                Ok(Some(x)) if (*least..=*most).contains(&x) => numbers.push(x),
                found => {
                    let found =
                        found.ok().flatten().map_or_else(|| record.shown(*place).into_owned(), |x| x.to_string());
                    let range = if *most == f64::MAX {
                        format!("a number of at least {least}")
                    } else {
                        format!("a number from {least} to {most}")
                    };
                    return Err(Error::unexpected(path, &format!("{line}, {name}"), format!("{found:?}"), range));
                }
            }
        }
        if let Some(before) = wavelengths.last().filter(|b| **b >= numbers[0]) {
            let expected = format!("more than {before}, the one before it");
            return Err(Error::unexpected(path, &format!("{line}, wavelength_nm"), numbers[0], expected));
        }
        wavelengths.push(numbers[0]);
        points.push(PlatePoint::of(std::array::from_fn(|j| numbers[1 + 2 * j] / FACTORS[j])));
        errors.push(std::array::from_fn(|j| numbers[2 + 2 * j] / FACTORS[j]));
        let rest = &numbers[1 + 2 * FREE..];
        for (k, mode) in misfit.modes.iter_mut().enumerate() {
            mode.push([rest[k], rest[modes + k]]);
        }
        misfit.short.push([rest[2 * modes], rest[2 * modes + 1]]);
        let name = record.shown(setting).trim().to_string();
        if !name.is_empty() {
            settings.insert(name, record.shown(value).trim().to_string());
        }
    }
    if wavelengths.len() < 2 {
        return Err(Error::input(path, "fewer than two rows; expected one a wavelength"));
    }
    let reader = Reader { path, settings };
    let variant = reader.text("variant")?;
    if variant != VARIANT {
        return Err(Error::unexpected(path, "variant", format!("{variant:?}"), VARIANT));
    }
    let (unknowns, known) = (reader.text("unknowns")?, UNKNOWNS.join(" "));
    if unknowns != known {
        return Err(Error::unexpected(path, "unknowns", format!("{unknowns:?}"), known));
    }
    misfit.reach = reader.number("misfit_reach_nm", f64::MIN_POSITIVE)?;
    Ok(PlateCoefficients { population: reader.population()?, wavelengths, points, errors, misfit })
}

/// The column of a measured content in a table of training.
pub fn measured(k: usize) -> String {
    format!("measured_{}", CONTENTS[k])
}
