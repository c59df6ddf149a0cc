//! Files as instruments and their programs write them: spectra of leaves and slabs, in each instrument's own form.
//!
//! [`recognise`] tells the form by the beginning of a file, [`read`] takes its spectra out, and [`through`] gives every
//! command that reads a table the same spectra as a CSV in long form, a row a wavelength. Numbers stay as they are in
//! the file: per cent stay per cent, and [`InstrumentStatement`] says that the form states them so.

mod asd;
mod asd_text;
mod ci710;
mod iad;
mod join;
mod licor;
mod long_form;
mod spectral_evolution;
mod statement;
mod svc;
#[cfg(test)]
mod tests;
mod text;
mod xlsx;

pub use statement::InstrumentStatement;

use crate::{Error, Result, atomic};
use std::io::{self, Read};
use std::path::Path;

/// Bytes at the beginning of a file that tell its form.
pub const HEAD: usize = 4096;
/// A file of an instrument may not be longer (bytes): a spectrum has some hundred kB.
const MOST_BYTES: u64 = 1 << 28;

/// A form that an instrument or its program writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::EnumIter)]
pub enum InstrumentFormat {
    /// Text of Spectra Vista's and GER's field spectrometers, `.sig`.
    SpectraVista,
    /// Text of Spectral Evolution's field spectrometers, `.sed`.
    SpectralEvolution,
    /// Binary file of ASD's field spectrometers, `.asd`.
    Asd,
    /// Text that ASD's program ViewSpec makes of an `.asd`.
    AsdText,
    /// CSV of the leaf spectrometer CI-710s.
    Ci710,
    /// Input of the program for inverse adding-doubling, `.rxt`.
    Iad,
    /// Text of the spectrometer LI-180.
    Li180,
    /// Text of the spectroradiometer LI-1800, `.PRN`.
    Li1800,
    /// Workbook, `.xlsx`.
    Xlsx,
}

impl InstrumentFormat {
    /// The form in words, with its article.
    pub fn name(self) -> &'static str {
        match self {
            InstrumentFormat::SpectraVista => "a Spectra Vista .sig file",
            InstrumentFormat::SpectralEvolution => "a Spectral Evolution .sed file",
            InstrumentFormat::Asd => "an ASD .asd file",
            InstrumentFormat::AsdText => "a text that ASD's ViewSpec exported",
            InstrumentFormat::Ci710 => "a CI-710s table",
            InstrumentFormat::Iad => "an iad .rxt file",
            InstrumentFormat::Li180 => "a LI-COR LI-180 text",
            InstrumentFormat::Li1800 => "a LI-COR LI-1800 .PRN text",
            InstrumentFormat::Xlsx => "an Excel workbook (.xlsx)",
        }
    }
}

/// What a spectrum holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, strum::Display)]
#[strum(serialize_all = "lowercase")]
pub enum SpectrumQuantity {
    /// Reflectance, relative to a white reference.
    Reflectance,
    /// Transmittance.
    Transmittance,
    /// Transmittance of the light that was neither scattered nor absorbed.
    #[strum(to_string = "unscattered transmittance")]
    Unscattered,
    /// Radiance.
    Radiance,
    /// Irradiance.
    Irradiance,
    /// Counts of the detector.
    #[strum(to_string = "raw counts")]
    Counts,
    /// Absorbance or absorptance, as the instrument computed it.
    Absorbance,
    /// Anything else.
    #[strum(to_string = "unknown quantity")]
    Unknown,
}

/// Unit of reflectances and transmittances.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::Display)]
#[strum(serialize_all = "lowercase")]
pub enum ReflectanceUnit {
    /// 0 to 1.
    Share,
    /// 0 to 100.
    #[strum(to_string = "per cent")]
    PerCent,
}

/// Readings at one wavelength.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpectralReading {
    /// Place of the leaf's name in [`InstrumentFile::leaves`].
    pub leaf: usize,
    /// In nm; NaN where the form has none.
    pub wavelength: f64,
    /// Reflectance in the file's unit; NaN where there is none.
    pub r: f64,
    /// Transmittance in the file's unit; NaN where there is none.
    pub t: f64,
    /// Refractive index at this wavelength; NaN where the file has one for all, or none.
    pub index: f64,
    /// Thickness (mm) at this reading; NaN where the file has one for all, or none.
    pub thickness_mm: f64,
}

/// A file of an instrument.
#[derive(Debug, Clone, PartialEq)]
pub struct InstrumentFile {
    /// Its form.
    pub form: InstrumentFormat,
    /// The instrument and, where forms have several, the version, as the file names them.
    pub instrument: Option<String>,
    /// All quantities that the file holds, with the number of their spectra.
    pub holds: Vec<(SpectrumQuantity, usize)>,
    /// Unit of reflectance and transmittance, where the form states it.
    pub unit: Option<ReflectanceUnit>,
    /// Range of all wavelengths in the file (nm); `None` where it has none.
    pub range: Option<[f64; 2]>,
    /// How many wavelengths it has; rows where it has no wavelengths.
    pub wavelengths: usize,
    /// Names of leaves or samples.
    pub leaves: Vec<String>,
    /// What can be computed with, ascending by wavelength for each leaf; empty where `barred` says why.
    pub readings: Vec<SpectralReading>,
    /// Thickness of the sample (mm), where the form states one for all readings.
    pub thickness_mm: Option<f64>,
    /// Refractive index of the sample, where the form states one.
    pub index: Option<f64>,
    /// Whether the instrument misses light that leaves the sample beside its ports, so that it seems to be absorbed.
    pub loses_light: bool,
    /// What a user should know of the readings.
    pub notes: Vec<String>,
    /// Why nothing can be computed with the file, and what helps.
    pub barred: Option<String>,
}

impl InstrumentFile {
    /// A file of one sample without readings yet. `wavelengths` in nm, in any order.
    fn new(form: InstrumentFormat, name: &str, wavelengths: impl Iterator<Item = f64>) -> InstrumentFile {
        let (mut range, mut count) = (None, 0);
        for w in wavelengths {
            let [low, high] = range.unwrap_or([w, w]);
            (range, count) = (Some([w.min(low), w.max(high)]), count + 1);
        }
        InstrumentFile {
            form,
            instrument: None,
            holds: Vec::new(),
            unit: None,
            range,
            wavelengths: count,
            leaves: vec![name.to_string()],
            readings: Vec::new(),
            thickness_mm: None,
            index: None,
            loses_light: false,
            notes: Vec::new(),
            barred: None,
        }
    }

    /// Adds a spectrum of the first leaf: wavelengths (nm) and values of reflectance or transmittance.
    fn spectrum(&mut self, quantity: SpectrumQuantity, points: impl Iterator<Item = [f64; 2]>) {
        let place = |value: f64, of: SpectrumQuantity| if of == quantity { value } else { f64::NAN };
        self.readings.extend(points.map(|[wavelength, value]| SpectralReading {
            leaf: 0,
            wavelength,
            r: place(value, SpectrumQuantity::Reflectance),
            t: place(value, SpectrumQuantity::Transmittance),
            index: f64::NAN,
            thickness_mm: f64::NAN,
        }));
    }

    /// Whether it holds this quantity.
    pub fn has(&self, quantity: SpectrumQuantity) -> bool {
        self.holds.iter().any(|(q, n)| *q == quantity && *n > 0)
    }

    /// How many spectra it holds, of all quantities.
    pub fn spectra(&self) -> usize {
        self.holds.iter().map(|(_, n)| n).sum()
    }
}

/// The form of the file that begins with these bytes ([`HEAD`] are enough); `None` for everything else, plain tables
/// among it.
pub fn recognise(head: &[u8]) -> Option<InstrumentFormat> {
    if asd::version(head).is_some() {
        return Some(InstrumentFormat::Asd);
    }
    if xlsx::is_workbook(head) {
        return Some(InstrumentFormat::Xlsx);
    }
    let head = text::decode(&head[..head.len().min(HEAD)]);
    let first = text::lines(&head).map(|(_, line)| line.trim()).find(|line| !line.is_empty())?;
    let has = |what: &str| head.contains(what);
    Some(match () {
        () if svc::is_first_line(first) => InstrumentFormat::SpectraVista,
        () if has("Text conversion of header file") || has("New ASD spectrum file") => InstrumentFormat::AsdText,
        () if iad::is_first_line(first) => InstrumentFormat::Iad,
        () if ci710::is_header(first) => InstrumentFormat::Ci710,
        () if licor::is_li180(first) => InstrumentFormat::Li180,
        () if licor::is_li1800(&head) => InstrumentFormat::Li1800,
        () if spectral_evolution::is_header(&head) => InstrumentFormat::SpectralEvolution,
        () => return None,
    })
}

/// Reads a file of an instrument. `name` is the name of the sample where the form has none: the file's name without
/// its ending.
///
/// # Errors
/// The sentence that says what is wrong with the file. A sound file that nothing can be computed with is no error: see
/// [`InstrumentFile::barred`].
pub fn read(bytes: &[u8], name: &str) -> std::result::Result<InstrumentFile, String> {
    let form = recognise(bytes).ok_or("no form of an instrument is recognised")?;
    let text = || text::decode(bytes);
    match form {
        InstrumentFormat::Asd => asd::read(bytes, name),
        InstrumentFormat::Xlsx => Err("a workbook holds a table; it is read as such".into()),
        InstrumentFormat::SpectraVista => svc::read(&text(), name),
        InstrumentFormat::SpectralEvolution => spectral_evolution::read(&text(), name),
        InstrumentFormat::AsdText => asd_text::read(&text(), name),
        InstrumentFormat::Ci710 => ci710::read(&text(), name),
        InstrumentFormat::Iad => iad::read(&text(), name),
        InstrumentFormat::Li180 => licor::li180(&text(), name),
        InstrumentFormat::Li1800 => licor::li1800(&text(), name),
    }
    .map_err(|why| format!("{}: {why}", form.name()))
}

/// The first sheet of a workbook that holds a table, as CSV, and what a user should know of it.
///
/// # Errors
/// The sentence that says what is wrong with the file.
pub fn sheet(bytes: &[u8]) -> std::result::Result<(Vec<u8>, Vec<String>), String> {
    xlsx::sheet(bytes).map_err(|why| format!("{}: {why}", InstrumentFormat::Xlsx.name()))
}

/// A table from a file of any form. Where `source` begins like a file of an instrument, its spectra come back as CSV
/// in long form, with what the form states; everything else comes back unchanged.
///
/// # Errors
/// A file of an instrument that cannot be read, and one with which nothing can be computed: the sentence names the
/// form and what helps.
pub fn through(
    mut source: Box<dyn Read + Send>,
    path: &Path,
) -> Result<(Box<dyn Read + Send>, Option<InstrumentStatement>)> {
    let unreadable = |e: io::Error| Error::input(path, atomic::explain(&e));
    let mut bytes = Vec::with_capacity(HEAD);
    source.by_ref().take(HEAD as u64).read_to_end(&mut bytes).map_err(unreadable)?;
    let Some(form) = recognise(&bytes) else {
        return Ok((Box::new(io::Cursor::new(bytes).chain(source)), None));
    };
    let bytes = whole(bytes, source, path)?;
    let (table, stated) = if form == InstrumentFormat::Xlsx {
        let (table, notes) = sheet(&bytes).map_err(|why| Error::input(path, why))?;
        (table, InstrumentStatement::of_sheet(notes))
    } else {
        let file = read(&bytes, &sample(path)).map_err(|why| Error::input(path, why))?;
        if let Some(why) = &file.barred {
            return Err(Error::input(path, format!("{}: {why}", form.name())));
        }
        (long_form::table(&file), InstrumentStatement::of(&file))
    };
    stated.say(path);
    Ok((Box::new(io::Cursor::new(table)), Some(stated)))
}

/// A file of an instrument whose first bytes, `head`, were read already.
///
/// # Errors
/// An unreadable file, and one that is longer than any file of an instrument.
pub fn whole(head: Vec<u8>, rest: impl Read, path: &Path) -> Result<Vec<u8>> {
    let mut bytes = head;
    rest.take(MOST_BYTES).read_to_end(&mut bytes).map_err(|e| Error::input(path, atomic::explain(&e)))?;
    if bytes.len() as u64 > MOST_BYTES {
        let form = recognise(&bytes).map_or("a file", InstrumentFormat::name);
        return Err(Error::input(path, format!("{form} of more than {} MB is too long", MOST_BYTES >> 20)));
    }
    Ok(bytes)
}

/// The sample's name: the name of the file without its ending.
pub fn sample(path: &Path) -> String {
    match path.file_stem() {
        Some(stem) if !["-", "standard input"].iter().any(|p| path == Path::new(p)) => {
            stem.to_string_lossy().into_owned()
        }
        _ => "sample".into(),
    }
}
