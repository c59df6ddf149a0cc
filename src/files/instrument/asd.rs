//! `.asd` files of ASD's field spectrometers, versions 1 to 8: a header of 484 bytes, the spectrum, and from version 2
//! on the white reference. All numbers are little-endian.
//!
//! Source: "ASD File Format version 8: Revision B". What is stored is mostly counts; the programs divide by the stored
//! reference whenever a file is shown as reflectance. The header holds one integration time and one pair of gains: a
//! change of them voids the reference, so both spectra of a file were taken with the same ones, and these cancel. The
//! dark current does not cancel and must have been subtracted.

use super::{InstrumentFile, InstrumentFormat, ReflectanceUnit, SpectrumQuantity};
use mesophyll_base::statistics::median_of;

/// Bytes of the header.
const HEADER: usize = 484;

/// Places of the header's fields.
mod at {
    pub const PROGRAM: usize = 178;
    pub const DARK_CORRECTED: usize = 181;
    pub const DATA_TYPE: usize = 186;
    pub const START: usize = 191;
    pub const STEP: usize = 195;
    pub const DATA_FORMAT: usize = 199;
    pub const CHANNELS: usize = 204;
    pub const SATURATION: usize = 422;
    pub const SPLICE_1: usize = 444;
    pub const SPLICE_2: usize = 448;
}

/// The version that the first three bytes state. Texts may begin with the same letters, but the header has zeros.
pub(super) fn version(head: &[u8]) -> Option<u8> {
    let version = match head.get(..3)? {
        b"ASD" => 1,
        [b'a', b's', digit @ b'2'..=b'8'] => digit - b'0',
        _ => return None,
    };
    head[3..head.len().min(HEADER)].contains(&0).then_some(version)
}

/// Bytes of a file, read by place.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn get<const N: usize>(&self, at: usize) -> Option<[u8; N]> {
        self.0.get(at..)?.first_chunk().copied()
    }
    fn byte(&self, at: usize) -> Option<u8> {
        self.get::<1>(at).map(|[b]| b)
    }
    fn float(&self, at: usize) -> Option<f64> {
        self.get(at).map(|b| f64::from(f32::from_le_bytes(b)))
    }
    /// `n` values of the format `kind` from the byte `at` on.
    fn values(&self, at: usize, n: usize, kind: Kind) -> Option<Vec<f64>> {
        (0..n).map(|k| kind.value(self, at + k * kind.bytes())).collect()
    }
}

/// How values are stored.
#[derive(Clone, Copy)]
enum Kind {
    Float,
    Integer,
    Double,
}

impl Kind {
    fn of(code: u8) -> Option<Kind> {
        [Kind::Float, Kind::Integer, Kind::Double].get(usize::from(code)).copied()
    }
    fn bytes(self) -> usize {
        match self {
            Kind::Float | Kind::Integer => 4,
            Kind::Double => 8,
        }
    }
    fn value(self, bytes: &Bytes, at: usize) -> Option<f64> {
        match self {
            Kind::Float => bytes.float(at),
            Kind::Integer => bytes.get(at).map(|b| f64::from(i32::from_le_bytes(b))),
            Kind::Double => bytes.get(at).map(f64::from_le_bytes),
        }
    }
}

/// The white reference behind the spectrum; `None` where the file has none.
fn reference(bytes: &Bytes, version: u8, end: usize, n: usize, kind: Kind) -> Result<Option<Vec<f64>>, String> {
    let Some(flag) = bytes.get(end).filter(|_| version >= 2).map(i16::from_le_bytes) else { return Ok(None) };
    if flag == 0 {
        return Ok(None);
    }
    // The flag is followed by two times of 8 bytes and a description with its length.
    let cut = "the file ends inside its white reference";
    let length = bytes.get(end + 18).map(i16::from_le_bytes).ok_or(cut)?;
    let values = bytes.values(end + 20 + usize::try_from(length).unwrap_or(0), n, kind).ok_or(cut)?;
    Ok(values.iter().any(|v| *v > 0.0).then_some(values))
}

pub(super) fn read(bytes: &[u8], name: &str) -> Result<InstrumentFile, String> {
    let version = version(bytes).ok_or("the first bytes name no version")?;
    let bytes = Bytes(bytes);
    if bytes.0.len() < HEADER {
        return Err(format!("the file ends after {} bytes, inside its header of {HEADER}", bytes.0.len()));
    }
    let cut = || "the file ends inside its header".to_string();
    let n = usize::from(bytes.get(at::CHANNELS).map(u16::from_le_bytes).ok_or_else(cut)?);
    let (start, step) = (bytes.float(at::START).ok_or_else(cut)?, bytes.float(at::STEP).ok_or_else(cut)?);
    let code = bytes.byte(at::DATA_FORMAT).ok_or_else(cut)?;
    let kind =
        Kind::of(code).ok_or_else(|| format!("its data format is {code}; expected 0 (float), 1 (integer) or 2"))?;
    let last = start + step * n.saturating_sub(1) as f64;
    if n == 0 || !(start > 0.0 && step > 0.0 && last < 1e5) {
        return Err(format!(
            "its header states {n} channels from {start} nm on in steps of {step} nm; expected a rising range"
        ));
    }
    let end = HEADER + n * kind.bytes();
    let spectrum = bytes.values(HEADER, n, kind).ok_or_else(|| {
        let there = (bytes.0.len() - HEADER) / kind.bytes();
        format!("the file ends after {there} of the {n} channels that its header states")
    })?;
    let mut file = InstrumentFile::new(InstrumentFormat::Asd, name, (0..n).map(|k| start + step * k as f64));
    let program = bytes.byte(at::PROGRAM).map_or_else(String::new, |b| format!(", program {}.{}", b >> 4, b & 15));
    file.instrument = Some(format!("file version {version}{program}"));
    let code = bytes.byte(at::DATA_TYPE).ok_or_else(cut)?;
    let stored = match code {
        0 => SpectrumQuantity::Counts,
        1 => SpectrumQuantity::Reflectance,
        2 => SpectrumQuantity::Radiance,
        4 => SpectrumQuantity::Irradiance,
        6 => SpectrumQuantity::Transmittance,
        8 => SpectrumQuantity::Absorbance,
        _ => SpectrumQuantity::Unknown,
    };
    let result = if stored == SpectrumQuantity::Transmittance {
        SpectrumQuantity::Transmittance
    } else {
        SpectrumQuantity::Reflectance
    };
    let reference = reference(&bytes, version, end, n, kind);
    let has_reference = matches!(reference, Ok(Some(_)));
    // Reflectances are about 1 at most, counts are hundreds and more.
    let middle = median_of(spectrum.iter().copied().filter(|v| v.is_finite()));
    let divided = stored == result && middle.is_some_and(|m| m.abs() <= 2.0);
    file.holds = vec![(if stored == result && !divided { SpectrumQuantity::Counts } else { stored }, 1)];
    if has_reference {
        file.notes.push("the file holds the spectrum of its white reference".into());
    }
    let values = match (stored, reference) {
        (SpectrumQuantity::Counts | SpectrumQuantity::Reflectance | SpectrumQuantity::Transmittance, _) if divided => {
            Ok(spectrum)
        }
        (
            SpectrumQuantity::Counts | SpectrumQuantity::Reflectance | SpectrumQuantity::Transmittance,
            Ok(Some(white)),
        ) => {
            if bytes.byte(at::DARK_CORRECTED) == Some(0) {
                Err("it holds raw counts from which the dark current was not subtracted, so they are not proportional \
                     to the light; measure the dark current, or export the reflectance with ASD's program"
                    .into())
            } else {
                file.holds.push((result, 1));
                file.notes.push(format!(
                    "the {result} is the stored counts over those of the white reference; both were taken with the one \
                     integration time and the gains of the header"
                ));
                Ok(spectrum.iter().zip(&white).map(|(s, w)| if *w > 0.0 { s / w } else { f64::NAN }).collect())
            }
        }
        (SpectrumQuantity::Counts | SpectrumQuantity::Reflectance | SpectrumQuantity::Transmittance, Ok(None)) => {
            Err("it holds raw counts without a white reference, and counts alone are no reflectance; save the white \
                 reference with the file, or export the reflectance with ASD's program"
                .into())
        }
        (SpectrumQuantity::Counts | SpectrumQuantity::Reflectance | SpectrumQuantity::Transmittance, Err(why)) => {
            Err(format!("it holds raw counts, and {why}"))
        }
        _ => Err(format!("it holds {stored} (data type {code}); export the reflectance with ASD's program")),
    };
    let values: Vec<f64> = match values {
        Ok(values) => values,
        Err(why) => {
            file.barred = Some(why);
            return Ok(file);
        }
    };
    file.unit = Some(ReflectanceUnit::Share);
    if result == SpectrumQuantity::Reflectance {
        file.notes.push("it is relative to the white panel, whose own reflectance the file does not state".into());
    }
    let saturated = saturated(&bytes, &mut file.notes);
    let points = values.iter().enumerate().map(|(k, v)| [start + step * k as f64, *v]);
    file.spectrum(result, points.filter(|[w, v]| v.is_finite() && !saturated(*w)));
    if file.readings.is_empty() {
        file.barred = Some("no reading is left: the white reference is dark, or every detector was saturated".into());
    }
    Ok(file)
}

/// Tells the wavelengths (nm) of detectors that were saturated, and notes them.
fn saturated(bytes: &Bytes, notes: &mut Vec<String>) -> impl Fn(f64) -> bool + use<> {
    let flags = bytes.byte(at::SATURATION).unwrap_or(0);
    let splice = |at| bytes.float(at).filter(|w| *w > 0.0).unwrap_or(f64::INFINITY);
    let (first, second) = (splice(at::SPLICE_1), splice(at::SPLICE_2));
    for (bit, name) in [(1, "VNIR"), (2, "SWIR 1"), (4, "SWIR 2")] {
        if flags & bit != 0 {
            notes.push(format!("the detector {name} was saturated; its readings are left out"));
        }
    }
    move |w| {
        let bit = match () {
            () if w <= first => 1,
            () if w <= second => 2,
            () => 4,
        };
        flags & bit != 0
    }
}
