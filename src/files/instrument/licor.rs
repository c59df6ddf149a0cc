//! Texts of LI-COR's spectrometers. The LI-180 measures the light of a lamp or of the sky: `Model Name`, then a line
//! `380nm` and its value a wavelength, all with tabs. The LI-1800's program PC1800 writes `.PRN`: lines in quotes, then
//! a wavelength and a value a line; its remark (`REM:`) names a reflectance or a transmittance in words, and `(QNTM)`
//! an irradiance in photons.

use super::join::joined;
use super::text::{left_out, lines, number, wavelength};
use super::{InstrumentFile, InstrumentFormat, ReflectanceUnit, SpectrumQuantity};

pub(super) fn is_li180(line: &str) -> bool {
    line.split('\t').map(str::trim).eq(["Model Name", "LI-180"])
}

/// The lines in quotes that every such file begins with.
pub(super) fn is_li1800(head: &str) -> bool {
    let quoted = |key: &str| lines(head).any(|(_, line)| line.trim_start().starts_with(&format!("\"{key}")));
    quoted("LIMS:") && quoted("INT:")
}

pub(super) fn li180(text: &str, name: &str) -> Result<InstrumentFile, String> {
    let readings: Vec<f64> = lines(text)
        .filter_map(|(_, line)| line.split_once('\t'))
        .filter(|(_, value)| number(value).is_some())
        .filter_map(|(key, _)| wavelength(key.trim().strip_suffix("nm")?))
        .collect();
    if readings.is_empty() {
        return Err("no line holds a wavelength and its reading".into());
    }
    let mut file = InstrumentFile::new(InstrumentFormat::Li180, name, readings.into_iter());
    file.instrument = Some("LI-180".into());
    file.holds = vec![(SpectrumQuantity::Irradiance, 1)];
    file.barred = Some(
        "it holds the spectral irradiance of a light, and no command takes the spectrum of a light; a leaf needs a \
         reflectance or a transmittance"
            .into(),
    );
    Ok(file)
}

pub(super) fn li1800(text: &str, name: &str) -> Result<InstrumentFile, String> {
    let (mut remark, mut points, mut bad) = (String::new(), Vec::new(), Vec::new());
    for (at, line) in lines(text).filter(|(_, line)| !line.trim().is_empty()) {
        if let Some(quoted) = line.trim().strip_prefix('"') {
            if let Some(rest) = quoted.strip_prefix("REM:") {
                remark = rest.trim_end_matches('"').trim().to_ascii_uppercase();
            }
            continue;
        }
        let mut tokens = line.split_whitespace();
        match tokens.next().and_then(wavelength).zip(tokens.next().and_then(number)) {
            Some((w, value)) => points.push([w, value]),
            None => bad.push(at),
        }
    }
    if points.is_empty() {
        return Err("no line holds a wavelength and its reading".into());
    }
    let mut file = InstrumentFile::new(InstrumentFormat::Li1800, name, points.iter().map(|p| p[0]));
    file.instrument = Some("LI-1800".into());
    file.notes.extend(left_out(&bad));
    let names = |what: &str| remark.split(|c: char| !c.is_ascii_alphabetic()).any(|word| word.starts_with(what));
    let quantity = match () {
        () if names("REFL") => SpectrumQuantity::Reflectance,
        () if names("TRAN") => SpectrumQuantity::Transmittance,
        () if names("ABS") => SpectrumQuantity::Absorbance,
        () if names("QNTM") => SpectrumQuantity::Irradiance,
        () => SpectrumQuantity::Unknown,
    };
    file.holds = vec![(quantity, 1)];
    if matches!(quantity, SpectrumQuantity::Reflectance | SpectrumQuantity::Transmittance) {
        let joined = joined(&points)?;
        file.unit = Some(ReflectanceUnit::Share);
        file.spectrum(quantity, joined.kept.iter().map(|&k| points[k]));
    } else {
        let held = match quantity {
            SpectrumQuantity::Unknown => {
                format!("its remark {remark:?} names neither a reflectance (REFL) nor a transmittance (TRAN)")
            }
            held => format!("it holds {held}"),
        };
        file.barred = Some(format!("{held}; a leaf needs a reflectance or a transmittance"));
    }
    Ok(file)
}
