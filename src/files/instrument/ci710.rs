//! CSV of CID's leaf spectrometer CI-710s (program SpectraVue): a row a measurement with its mode, and the wavelengths
//! (nm) as names of columns behind `Wavelengths(nm)`. All values are per cent.

use super::text::{lines, number, wavelength};
use super::{InstrumentFile, InstrumentFormat, ReflectanceUnit, SpectralReading, SpectrumQuantity};

/// A silicon detector sees no light beyond these wavelengths (nm), and the lamp of the instrument ends before them.
/// What the table has there is noise, such as a reflectance of 284 %.
const SEEN: [f64; 2] = [380.0, 1100.0];

/// The column whose name tells where the wavelengths begin.
const WAVELENGTHS: &str = "wavelengths(nm)";

fn cells(line: &str, separator: char) -> impl Iterator<Item = &str> {
    line.split(separator).map(|cell| cell.trim().trim_matches('"').trim())
}

fn position(header: &str, separator: char, name: &str) -> Option<usize> {
    cells(header, separator).position(|cell| cell.to_ascii_lowercase().replace(' ', "") == name)
}

fn separator(header: &str) -> Option<char> {
    [',', ';', '\t'].into_iter().find(|s| position(header, *s, "mode").is_some())
}

pub(super) fn is_header(line: &str) -> bool {
    separator(line).is_some_and(|s| position(line, s, WAVELENGTHS).is_some())
}

/// The quantity that a row's mode names.
fn quantity(mode: &str) -> SpectrumQuantity {
    let mode = mode.to_ascii_lowercase();
    match () {
        () if mode.starts_with("reflect") => SpectrumQuantity::Reflectance,
        () if mode.starts_with("transmi") => SpectrumQuantity::Transmittance,
        () if mode.starts_with("absor") => SpectrumQuantity::Absorbance,
        () if mode.starts_with("raw") || mode.contains("count") || mode.contains("scope") => SpectrumQuantity::Counts,
        () if mode.contains("irradiance") => SpectrumQuantity::Irradiance,
        () => SpectrumQuantity::Unknown,
    }
}

pub(super) fn read(text: &str, name: &str) -> Result<InstrumentFile, String> {
    let mut rest = lines(text).filter(|(_, line)| !line.trim().is_empty());
    let (_, header) = rest.next().ok_or("the file is empty")?;
    let separator = separator(header).ok_or("the header has no column Mode")?;
    let (Some(mode), Some(first)) = (position(header, separator, "mode"), position(header, separator, WAVELENGTHS))
    else {
        return Err("the header has no columns Mode and Wavelengths(nm)".into());
    };
    let tag = position(header, separator, "tag");
    // Place of a cell and its wavelength.
    let columns: Vec<(usize, f64)> = cells(header, separator)
        .enumerate()
        .skip(first + 1)
        .filter_map(|(k, cell)| wavelength(cell).map(|w| (k, w)))
        .collect();
    if columns.is_empty() {
        return Err("no number follows Wavelengths(nm) in the header".into());
    }
    let mut file = InstrumentFile::new(InstrumentFormat::Ci710, name, columns.iter().map(|c| c.1));
    (file.leaves, file.unit) = (Vec::new(), Some(ReflectanceUnit::PerCent));
    // For each leaf the rows of its reflectance and of its transmittance.
    let mut leaves: Vec<(String, [Option<Vec<f64>>; 2])> = Vec::new();
    for (_, line) in rest {
        let row: Vec<&str> = cells(line, separator).collect();
        let quantity = quantity(row.get(mode).unwrap_or(&""));
        match file.holds.iter_mut().find(|(q, _)| *q == quantity) {
            Some((_, n)) => *n += 1,
            None => file.holds.push((quantity, 1)),
        }
        let Some(place) =
            [SpectrumQuantity::Reflectance, SpectrumQuantity::Transmittance].iter().position(|q| *q == quantity)
        else {
            continue;
        };
        let values = columns.iter().map(|(k, _)| row.get(*k).and_then(|c| number(c)).unwrap_or(f64::NAN)).collect();
        let tag = tag.and_then(|k| row.get(k)).copied().filter(|t| !t.is_empty()).unwrap_or(name).to_string();
        // Repeated measurements of a leaf follow each other: the first reflectance belongs to the first transmittance.
        match leaves.iter_mut().find(|(leaf, of)| *leaf == tag && of[place].is_none()) {
            Some((_, of)) => of[place] = Some(values),
            None => leaves.push((tag, std::array::from_fn(|k| (k == place).then(|| values.clone())))),
        }
    }
    if file.holds.is_empty() {
        return Err("no row follows the header".into());
    }
    for (leaf, (tag, values)) in leaves.iter().enumerate() {
        let earlier = leaves[..leaf].iter().filter(|(t, _)| t == tag).count();
        file.leaves.push(if earlier == 0 { tag.clone() } else { format!("{tag} {}", earlier + 1) });
        let value = |place: usize, k: usize| values[place].as_ref().map_or(f64::NAN, |v| v[k]);
        let seen = |w: f64| (SEEN[0]..=SEEN[1]).contains(&w);
        let mut readings: Vec<SpectralReading> = (columns.iter().enumerate())
            .filter(|(_, (_, w))| seen(*w))
            .map(|(k, (_, wavelength))| SpectralReading {
                leaf,
                wavelength: *wavelength,
                r: value(0, k),
                t: value(1, k),
                index: f64::NAN,
                thickness_mm: f64::NAN,
            })
            .filter(|r| !(r.r.is_nan() && r.t.is_nan()))
            .collect();
        readings.sort_by(|a, b| a.wavelength.total_cmp(&b.wavelength));
        file.readings.extend(readings);
    }
    if file.range.is_some_and(|[low, high]| low < SEEN[0] || high > SEEN[1]) {
        file.notes.push(format!(
            "the readings below {} and above {} nm are left out: the instrument's detector sees nothing there",
            SEEN[0], SEEN[1]
        ));
    }
    if file.readings.is_empty() {
        let held = file.holds.iter().map(|(q, _)| q.to_string()).collect::<Vec<_>>().join(" and ");
        file.barred = Some(match leaves.is_empty() {
            true => format!("it holds {held}, but no reflectance and no transmittance"),
            false => "it holds no reading at a wavelength that its detector sees".into(),
        });
    }
    Ok(file)
}
