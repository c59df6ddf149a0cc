//! `.sed` files of Spectral Evolution's PSR, SR and RS spectrometers: `Key: value` lines, `Data:`, a line that names
//! the columns, then the columns separated by tabs.
//!
//! The columns are `Wvl` (nm), light or counts of the reference and of the target (`Rad. (Ref.)`, `Norm. DN (Target)`,
//! `Irrad. (Ref.)`) and the reflectance, as `Reflect. %` or as `Reflect. [1.0]`. The line `Measurement:` says whether
//! that was a reflectance or a transmittance.

use super::join::joined;
use super::text::{left_out, lines, number, pair, wavelength};
use super::{InstrumentFile, InstrumentFormat, ReflectanceUnit, SpectrumQuantity};
use std::collections::HashMap;

/// Keys that every such file has before its data.
pub(super) fn is_header(head: &str) -> bool {
    let keys: Vec<String> = lines(head).filter_map(|(_, line)| pair(line, ':')).map(|(key, _)| key).collect();
    let has = |key: &str| keys.iter().any(|k| k == key);
    has("instrument") && has("measurement") && (has("channels") || has("detectors") || has("file name"))
}

/// A column of values.
struct Column {
    quantity: SpectrumQuantity,
    unit: Option<ReflectanceUnit>,
}

/// What a column holds, by its name. `transmitting`: whether transmittances were measured.
fn column(name: &str, transmitting: bool) -> Column {
    let name = name.to_ascii_lowercase();
    let unit = match () {
        () if name.contains('%') => Some(ReflectanceUnit::PerCent),
        () if name.contains("[1.0]") => Some(ReflectanceUnit::Share),
        () => None,
    };
    let ratio = name.starts_with("reflect") || name.starts_with("tgt./ref") || name.starts_with("tgt/ref");
    let quantity = match () {
        () if name.starts_with("trans") || (ratio && transmitting) => SpectrumQuantity::Transmittance,
        () if ratio => SpectrumQuantity::Reflectance,
        () if name.starts_with("abs") => SpectrumQuantity::Absorbance,
        () if name.starts_with("irr") => SpectrumQuantity::Irradiance,
        () if name.starts_with("rad") => SpectrumQuantity::Radiance,
        () if name.contains("dn") => SpectrumQuantity::Counts,
        () => SpectrumQuantity::Unknown,
    };
    Column { quantity, unit }
}

pub(super) fn read(text: &str, name: &str) -> Result<InstrumentFile, String> {
    let mut header: HashMap<String, String> = HashMap::new();
    let mut rest = lines(text).filter(|(_, line)| !line.trim().is_empty());
    loop {
        let (_, line) = rest.next().ok_or("the file ends before its line `Data:`")?;
        match pair(line, ':') {
            Some((key, "")) if key == "data" => break,
            Some((key, value)) => drop(header.insert(key, value.to_string())),
            None => {}
        }
    }
    let (_, names) = rest.next().ok_or("the file ends before the line that names its columns")?;
    let names: Vec<&str> = names.split('\t').map(str::trim).collect();
    let begins = |name: &&str| ["wvl", "wavelength"].iter().any(|w| name.to_ascii_lowercase().starts_with(w));
    let across = names.iter().position(begins).ok_or_else(|| {
        format!("the line after `Data:` names no column Wvl; it begins with {:?}", names.first().unwrap_or(&""))
    })?;
    let (mut rows, mut bad): (Vec<Vec<f64>>, _) = (Vec::new(), Vec::new());
    for (at, line) in rest {
        let cells: Vec<&str> = line.split_whitespace().collect();
        let wavelength = cells.get(across).and_then(|cell| wavelength(cell));
        match wavelength.filter(|_| cells.len() == names.len()) {
            Some(_) => rows.push(cells.iter().map(|cell| number(cell).unwrap_or(f64::NAN)).collect()),
            None => bad.push(at),
        }
    }
    if rows.is_empty() {
        return Err("no line of the data holds a wavelength and its readings".into());
    }
    let of = |key: &str| header.get(key).map(String::as_str).unwrap_or_default();
    let transmitting = of("measurement").to_ascii_lowercase().contains("transmi");
    let columns: Vec<Column> = names.iter().map(|name| column(name, transmitting)).collect();
    let mut file = InstrumentFile::new(InstrumentFormat::SpectralEvolution, name, rows.iter().map(|r| r[across]));
    file.instrument = header.get("instrument").filter(|i| !i.is_empty()).cloned();
    let wanted = |c: &Column| matches!(c.quantity, SpectrumQuantity::Reflectance | SpectrumQuantity::Transmittance);
    for (k, c) in columns.iter().enumerate().filter(|(k, _)| *k != across && !names[*k].starts_with("Chan")) {
        if wanted(c) && file.readings.is_empty() {
            let points: Vec<[f64; 2]> = rows.iter().map(|r| [r[across], r[k]]).collect();
            let joined = joined(&points)?;
            file.notes.extend(joined.notes());
            file.unit = c.unit;
            file.spectrum(c.quantity, joined.kept.iter().map(|&k| points[k]));
        }
        match file.holds.iter_mut().find(|(q, _)| *q == c.quantity) {
            Some((_, n)) => *n += 1,
            None => file.holds.push((c.quantity, 1)),
        }
    }
    file.notes.extend(left_out(&bad));
    if file.readings.is_empty() {
        let held = file.holds.iter().map(|(q, _)| q.to_string()).collect::<Vec<_>>().join(" and ");
        file.barred = Some(format!(
            "it holds {held}, but no reflectance and no transmittance; save these with the instrument's program"
        ));
    }
    Ok(file)
}
