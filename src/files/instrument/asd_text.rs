//! Texts that ASD's program ViewSpec makes of `.asd` files: sentences about the measurement, then a line
//! `Wavelength` and the names of the spectra, then a line a wavelength.

use super::text::{left_out, lines, number, wavelength};
use super::{InstrumentFile, InstrumentFormat, ReflectanceUnit, SpectralReading, SpectrumQuantity};

pub(super) fn read(text: &str, name: &str) -> Result<InstrumentFile, String> {
    let mut rest = lines(text).filter(|(_, line)| !line.trim().is_empty());
    let mut told = String::new();
    let header = loop {
        let (_, line) = rest.next().ok_or("the file ends before its line `Wavelength`")?;
        if line.trim_start().to_ascii_lowercase().starts_with("wavelength") {
            break line;
        }
        // The first sentence has the file's path, whose words say nothing.
        if !line.starts_with("Text conversion") {
            told += &line.to_ascii_lowercase();
            told.push('\n');
        }
    };
    let separator = ['\t', ';', ','].into_iter().find(|s| header.contains(*s)).unwrap_or(' ');
    let leaves: Vec<String> =
        header.split(separator).skip(1).map(|n| n.trim().to_string()).filter(|n| !n.is_empty()).collect();
    let (mut rows, mut bad): (Vec<(f64, Vec<f64>)>, Vec<usize>) = (Vec::new(), Vec::new());
    for (at, line) in rest {
        let mut cells = line.split(separator).map(str::trim).filter(|c| !c.is_empty());
        let values = |cells: &mut dyn Iterator<Item = &str>| cells.map(number).collect::<Option<Vec<f64>>>();
        match cells.next().and_then(wavelength).zip(values(&mut cells)) {
            Some((w, values)) if !values.is_empty() => rows.push((w, values)),
            _ => bad.push(at),
        }
    }
    if rows.is_empty() {
        return Err("no line after `Wavelength` holds a wavelength and a reading".into());
    }
    let n = rows.iter().map(|r| r.1.len()).max().unwrap_or(1);
    let mut file = InstrumentFile::new(InstrumentFormat::AsdText, name, rows.iter().map(|r| r.0));
    file.notes.extend(left_out(&bad));
    if leaves.len() == n {
        file.leaves = leaves.iter().map(|leaf| leaf.trim_end_matches(".asd").to_string()).collect();
    } else {
        file.leaves = (1..=n).map(|k| if n == 1 { name.to_string() } else { format!("{name} {k}") }).collect();
    }
    let says = |what: &str| told.contains(what);
    let quantity = match () {
        () if says("transmittance") => SpectrumQuantity::Transmittance,
        () if says("not compared to a white reference") && says("radiance") => SpectrumQuantity::Radiance,
        () if says("not compared to a white reference") => SpectrumQuantity::Counts,
        () if says("compared to a white reference") || says("reflectance") => SpectrumQuantity::Reflectance,
        () => SpectrumQuantity::Unknown,
    };
    file.holds = vec![(quantity, n)];
    if !matches!(quantity, SpectrumQuantity::Reflectance | SpectrumQuantity::Transmittance) {
        file.barred =
            Some(format!("it holds {quantity} that were not divided by a white reference; export the reflectance"));
        return Ok(file);
    }
    file.unit = Some(ReflectanceUnit::Share);
    file.notes.push("it is relative to the white panel, whose own reflectance the file does not state".into());
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    for leaf in 0..n {
        let value =
            |values: &[f64], of| if of == quantity { values.get(leaf).copied() } else { None }.unwrap_or(f64::NAN);
        file.readings.extend(rows.iter().map(|(wavelength, values)| SpectralReading {
            leaf,
            wavelength: *wavelength,
            r: value(values, SpectrumQuantity::Reflectance),
            t: value(values, SpectrumQuantity::Transmittance),
            index: f64::NAN,
            thickness_mm: f64::NAN,
        }));
    }
    Ok(file)
}
