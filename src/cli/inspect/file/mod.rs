//! `mesophyll inspect FILE`: what a file is, what it holds, and which command takes it.

mod formats;
mod spectrum;
mod tables;

use crate::cli::{CommonArgs, Error, Result};
use mesophyll_files::atomic::explain;
use mesophyll_files::instrument::{self, InstrumentFile, InstrumentFormat, ReflectanceUnit, SpectrumQuantity};
use mesophyll_files::{spectra, table};
use serde::Serialize;
use std::fmt::Write;
use std::io::Read;
use std::path::Path;

/// What a look at a file found.
#[derive(Debug, Default, Serialize)]
struct Found {
    /// The form of the file, with its article: `a Spectra Vista .sig file`.
    form: String,
    /// The instrument, where the file names it.
    #[serde(skip_serializing_if = "Option::is_none")]
    instrument: Option<String>,
    /// What it holds: `reflectance`, `transmittance`, `radiance`, `raw counts`; for a table what its rows are.
    holds: Vec<String>,
    /// Unit of reflectance and transmittance: `share` (0 to 1) or `per cent`.
    unit: Option<String>,
    /// Shortest and longest wavelength (nm).
    wavelength_nm: Option<[f64; 2]>,
    /// How many wavelengths there are.
    wavelengths: Option<usize>,
    /// How many spectra there are, each quantity of each leaf counted.
    spectra: Option<usize>,
    /// How many rows a table has.
    #[serde(skip_serializing_if = "Option::is_none")]
    rows: Option<usize>,
    /// The command that takes the file; words in capitals are to be filled in.
    command: Option<String>,
    /// Why no command takes it.
    reason: Option<String>,
    /// What else a user should know.
    notes: Vec<String>,
}

/// A name as a shell takes it.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=:@%,".contains(c);
    if !text.is_empty() && text.chars().all(plain) { text } else { format!("'{}'", text.replace('\'', r"'\''")) }
}

pub fn run(path: &Path, common: &CommonArgs) -> Result<u8> {
    let unreadable = |e: std::io::Error| Error::input(path, explain(&e));
    let file = std::fs::File::open(path).map_err(unreadable)?;
    let (mut file, packed) = table::unpacked(Box::new(file)).map_err(unreadable)?;
    let mut head = Vec::with_capacity(instrument::HEAD);
    file.by_ref().take(instrument::HEAD as u64).read_to_end(&mut head).map_err(unreadable)?;
    if head.is_empty() {
        return Err(Error::input(path, "the file is empty"));
    }
    let mut found = match instrument::recognise(&head) {
        Some(form) => {
            let bytes = instrument::whole(head, file, path)?;
            of_instrument(form, &bytes, path)?
        }
        None => match told(&head, path, packed)? {
            Some(found) => found,
            None => tables::of(spectra::open(path)?, path)?,
        },
    };
    if packed {
        found.form = format!("a gzip archive with {}", found.form);
    }
    if common.json {
        crate::cli::print_json(&found)?;
    } else {
        crate::cli::print(&text(&found, path))?;
    }
    Ok(0)
}

/// As [`formats::told`]. What gzip `packed` is taken by a command only where it is a table or of an instrument.
fn told(head: &[u8], path: &Path, packed: bool) -> Result<Option<Found>> {
    if !packed {
        return formats::told(head, path);
    }
    let barred = |form: &str| Found { form: form.into(), reason: Some("unpack it first".into()), ..Found::default() };
    Ok(match formats::told(head, path) {
        _ if head.get(257..262) == Some(&b"ustar"[..]) => Some(barred("a folder of files (.tar)")),
        Ok(Some(found)) if found.command.is_some() => Some(barred(&found.form)),
        Ok(found) => found,
        Err(_) => Some(barred("a file that is no table")),
    })
}

fn of_instrument(form: InstrumentFormat, bytes: &[u8], path: &Path) -> Result<Found> {
    if form == InstrumentFormat::Xlsx {
        // The sheet that is read becomes a table, as in every command.
        let table = spectra::open(path)?;
        let notes = table.stated().map(|s| s.notes().to_vec()).unwrap_or_default();
        let mut found = tables::of(table, path)?;
        found.form = format!("{} with {}", form.name(), found.form);
        found.notes.splice(0..0, notes);
        return Ok(found);
    }
    let file = instrument::read(bytes, &instrument::sample(path)).map_err(|why| Error::input(path, why))?;
    let mut found = Found {
        form: form.name().into(),
        instrument: file.instrument.clone(),
        holds: file.holds.iter().map(|(quantity, _)| quantity.to_string()).collect(),
        unit: file.unit.map(|unit| unit.to_string()),
        wavelength_nm: file.range,
        wavelengths: Some(file.wavelengths),
        spectra: Some(file.spectra()),
        notes: file.notes.clone(),
        reason: file.barred.clone(),
        ..Found::default()
    };
    if file.barred.is_none() {
        let spectrum = spectrum::SpectrumContents {
            reflectance: file.has(SpectrumQuantity::Reflectance),
            transmittance: file.has(SpectrumQuantity::Transmittance),
            thickness: file.thickness_mm.is_some() || file.readings.iter().any(|r| !r.thickness_mm.is_nan()),
            percent: file.unit == Some(ReflectanceUnit::PerCent),
            wavelengths: file.range.is_some(),
            index: file.index.filter(|n| *n != 1.0),
        };
        spectrum.takes(&mut found, path);
        found.notes.extend(further(&file));
    }
    Ok(found)
}

/// What the form states besides the readings.
fn further(file: &InstrumentFile) -> Vec<String> {
    let mut notes = Vec::new();
    if let Some(h) = file.thickness_mm {
        notes.push(format!("thickness {h} mm"));
    }
    if let Some(n) = file.index {
        notes.push(format!("refractive index {n}"));
    }
    if file.leaves.len() > 1 {
        notes.push(format!("{} leaves: {}", file.leaves.len(), listed(&file.leaves)));
    }
    notes
}

/// The first names of a list.
fn listed(names: &[String]) -> String {
    let shown = names.iter().take(6).map(String::as_str).collect::<Vec<_>>().join(", ");
    if names.len() > 6 { format!("{shown} and {} more", names.len() - 6) } else { shown }
}

fn text(f: &Found, path: &Path) -> String {
    let mut out = format!("{}: {}", path.display(), f.form);
    let mut line = |name: &str, text: &str| {
        let _ = write!(out, "\n  {name:<12} {text}");
    };
    if let Some(instrument) = &f.instrument {
        line("instrument", instrument);
    }
    let unit = f.unit.as_ref().map_or_else(String::new, |unit| match unit.as_str() {
        "share" => " (as shares, 0 to 1)".into(),
        unit => format!(" (in {unit})"),
    });
    if !f.holds.is_empty() {
        // The unit is that of reflectance and transmittance.
        let is_share = |what: &str| ["reflectance", "transmittance"].contains(&what);
        let each = f.holds.iter().map(|what| format!("{what}{}", if is_share(what) { unit.as_str() } else { "" }));
        line("holds", &each.collect::<Vec<_>>().join(", "));
    }
    if let Some([low, high]) = f.wavelength_nm {
        let count = f.wavelengths.map_or_else(String::new, |n| format!(", {n} of them"));
        line("wavelengths", &format!("{} to {} nm{count}", rounded(low), rounded(high)));
    }
    if let Some(n) = f.spectra {
        line("spectra", &n.to_string());
    }
    if let Some(n) = f.rows {
        line("rows", &n.to_string());
    }
    f.notes.iter().for_each(|note| line("note", note));
    match (&f.command, &f.reason) {
        (Some(command), _) => line("command", command),
        (None, Some(reason)) => line("no command", reason),
        (None, None) => line("no command", "nothing here reads it"),
    }
    out.push('\n');
    out
}

/// A wavelength without the digits of a single-precision number.
fn rounded(w: f64) -> f64 {
    (w * 1e3).round() / 1e3
}
