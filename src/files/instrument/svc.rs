//! `.sig` files of Spectra Vista's HR and XHR spectrometers and of GER's: `key= value` lines, `data=`, then lines of
//! wavelength (nm), reference, target and reflectance in per cent.
//!
//! Source: the manual of the SVC HR-1024i and HR-768i. Raw files hold the spectra of the three detectors one after the
//! other, and these overlap; the instrument's program can remove that.

use super::join::joined;
use super::text::{left_out, lines, number, pair, wavelength};
use super::{InstrumentFile, InstrumentFormat, ReflectanceUnit, SpectrumQuantity};
use mesophyll_base::statistics::median_of;
use std::collections::HashMap;

/// `/*** Spectra Vista SIG Data ***/`, `/*** Spectra Vista HR-1024 ***/`, `///GER SIGNATUR FILE///`.
pub(super) fn is_first_line(line: &str) -> bool {
    line.starts_with("/*** Spectra Vista") || line.starts_with("///GER SIGNATUR") || line.starts_with("///GER ASCII")
}

pub(super) fn read(text: &str, name: &str) -> Result<InstrumentFile, String> {
    let mut header: HashMap<String, String> = HashMap::new();
    // Wavelength, reference, target, reflectance (NaN where the line ends before it).
    let mut rows: Vec<[f64; 4]> = Vec::new();
    let (mut in_data, mut bad) = (false, Vec::new());
    for (at, line) in lines(text).skip(1).filter(|(_, line)| !line.trim().is_empty()) {
        if !in_data {
            match pair(line, '=') {
                Some((key, _)) if key == "data" => in_data = true,
                Some((key, value)) => drop(header.insert(key, value.to_string())),
                // GER's oldest files have no line `data=`.
                None => {
                    in_data = row(line).is_some_and(|row| {
                        rows.push(row);
                        true
                    })
                }
            }
            continue;
        }
        match row(line) {
            Some(row) => rows.push(row),
            None => bad.push(at),
        }
    }
    if rows.is_empty() {
        return Err(match in_data {
            true => "no line after `data=` holds a wavelength and its readings".into(),
            false => "the file ends before its line `data=`".into(),
        });
    }
    let of = |key: &str| header.get(key).map(String::as_str).unwrap_or_default();
    let mut file = InstrumentFile::new(InstrumentFormat::SpectraVista, name, rows.iter().map(|r| r[0]));
    file.instrument = header.get("instrument").filter(|i| !i.is_empty()).cloned();
    let units = of("units").to_ascii_lowercase();
    let light = match () {
        () if units.contains("irradiance") => SpectrumQuantity::Irradiance,
        () if units.contains("radiance") => SpectrumQuantity::Radiance,
        () if units.contains("count") => SpectrumQuantity::Counts,
        () => SpectrumQuantity::Unknown,
    };
    file.holds = vec![(light, 2)];
    file.notes.extend(left_out(&bad));
    if rows.iter().all(|r| r[3].is_nan()) {
        file.barred = Some(format!(
            "it holds the {light} of a reference and of a target, but no reflectance; save the reflectance with the \
             instrument's program"
        ));
        return Ok(file);
    }
    file.holds.push((SpectrumQuantity::Reflectance, 1));
    file.unit = Some(unit(&rows));
    let joined = joined(&rows.iter().map(|r| [r[0], r[3]]).collect::<Vec<_>>())?;
    file.notes.extend(joined.notes());
    let factors = of("factors").to_ascii_lowercase();
    if let Some(removed) = factors.split_once("overlap: remove").map(|(_, rest)| rest) {
        let end = removed.find([';', ']']).unwrap_or(removed.len());
        let places = removed[..end].split(", matching").next().unwrap_or_default().trim();
        file.notes.push(
            format!("the instrument's program has removed the overlap of the detectors {places}").trim_end().into(),
        );
    }
    file.spectrum(SpectrumQuantity::Reflectance, joined.kept.iter().map(|&k| [rows[k][0], rows[k][3]]));
    Ok(file)
}

/// Three or four numbers, the first of which is a wavelength.
fn row(line: &str) -> Option<[f64; 4]> {
    let mut tokens = line.split_whitespace();
    let first = wavelength(tokens.next()?)?;
    let rest: Vec<f64> = tokens.map(number).collect::<Option<_>>()?;
    match rest[..] {
        [reference, target] => Some([first, reference, target, f64::NAN]),
        [reference, target, reflectance, ..] => Some([first, reference, target, reflectance]),
        _ => None,
    }
}

/// The form states per cent. Programs have written shares all the same, so the unit is taken from the file's own
/// readings: the reflectance is the target over the reference.
fn unit(rows: &[[f64; 4]]) -> ReflectanceUnit {
    let scales = rows.iter().map(|r| r[3] * r[1] / r[2]).filter(|s| s.is_finite() && *s > 0.0);
    let share = median_of(scales).is_some_and(|middle| (0.5..2.0).contains(&middle));
    if share { ReflectanceUnit::Share } else { ReflectanceUnit::PerCent }
}
