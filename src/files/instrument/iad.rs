//! `.rxt` files, the input of the program `iad` for inverse adding-doubling: `IAD1`, 17 numbers in a fixed order,
//! what was measured, then the readings. Blanks and line ends are alike, and `#` begins a comment.
//!
//! Source: S. Prahl, "Everything I think you should know about Inverse Adding-Doubling", the manual of `iad`, and that
//! program's reading of its files. The 17 numbers: index of the sample and of the slides, thickness of the sample and
//! of the slides (mm), diameter of the beam (mm), reflectance of the standard, number of spheres, then for the sphere
//! of the reflectance and for that of the transmittance its diameter, three diameters of ports (mm) and the
//! reflectance of its wall.
//!
//! The measured M_R already contains the standard. Without a sphere (0), and in a dual beam (`iad -X`), M_R and M_T are
//! the sample's reflectance and transmittance. With one or two spheres they depend on the sphere, and only `iad`'s fit
//! takes that off again.

use super::text::lines;
use super::{InstrumentFile, InstrumentFormat, ReflectanceUnit, SpectralReading, SpectrumQuantity};

pub(super) fn is_first_line(line: &str) -> bool {
    line.strip_prefix("IAD")
        .is_some_and(|rest| rest.strip_prefix('1').unwrap_or(rest).starts_with([' ', '\t', '#', '\r']))
        || ["IAD", "IAD1"].contains(&line)
}

/// A word of the file outside comments, and its line.
struct Token<'a>(usize, &'a str);

impl Token<'_> {
    fn number(&self) -> Option<f64> {
        self.1.parse().ok()
    }
}

/// What each number of a row is when the file states how many were measured.
const FIXED: [char; 7] = ['r', 't', 'u', 'w', 'W', 'R', 'T'];
/// All letters that name columns.
const LETTERS: &str = "aAbBcCdDeEfFgiLMnNqrRStTuwW";

pub(super) fn read(text: &str, name: &str) -> Result<InstrumentFile, String> {
    if !text.trim_start().starts_with("IAD1") {
        return Err("it is of the old form without the 1 of IAD1, which iad itself no longer reads".into());
    }
    let (mut tokens, mut told): (Vec<Token>, Vec<&str>) = (Vec::new(), Vec::new());
    for (at, line) in lines(text) {
        let (code, comment) = line.split_once('#').unwrap_or((line, ""));
        told.push(comment);
        tokens.extend(code.split_whitespace().map(|word| Token(at, word)));
    }
    let mut rest = tokens.iter().skip(1).peekable();
    let mut header = [0.0; 17];
    for (k, value) in header.iter_mut().enumerate() {
        let token = rest.next().ok_or_else(|| format!("the file ends after {k} of the 17 numbers of its header"))?;
        *value = token.number().filter(|v| v.is_finite()).ok_or_else(|| {
            format!("line {}: {:?} stands where number {} of the header is expected", token.0, token.1, k + 1)
        })?;
    }
    let [index, _, thickness, _, _, _, spheres, ..] = header;
    let legend = rest.peek().ok_or("the file ends before it says what was measured")?;
    let (at, count) = (legend.0, legend.number());
    let labels: Vec<char> = match count {
        Some(count) if (1.0..=7.0).contains(&count) && count.fract() == 0.0 => {
            rest.next();
            FIXED[..count as usize].to_vec()
        }
        Some(count) => return Err(format!("line {at}: {count} measurements; expected 1 to 7, or letters of columns")),
        None => {
            let mut labels = Vec::new();
            while let Some(token) = rest.next_if(|token| token.0 == at) {
                let mut letters = token.1.chars();
                match (letters.next().filter(|c| LETTERS.contains(*c)), letters.next()) {
                    (Some(letter), None) => labels.push(letter),
                    _ => return Err(format!("line {at}: {:?} is no letter of a column", token.1)),
                }
            }
            labels
        }
    };
    if !labels.iter().any(|l| "rtu".contains(*l)) {
        return Err(format!("line {at}: no column is a reflectance (r) or a transmittance (t, u)"));
    }
    let mut rows: Vec<(f64, Vec<f64>)> = Vec::new();
    while rest.peek().is_some() {
        let mut next = || -> Result<f64, String> {
            let token = rest.next().ok_or("the file ends inside its last reading")?;
            token.number().ok_or_else(|| format!("line {}: {:?} stands where a number is expected", token.0, token.1))
        };
        // Without letters a first number above 1 is the wavelength.
        let mut first = next()?;
        let mut wavelength = f64::NAN;
        if count.is_some() && first > 1.0 {
            (wavelength, first) = (first, next()?);
        }
        let mut values = vec![first];
        for _ in 1..labels.len() {
            values.push(next()?);
        }
        if let Some(k) = labels.iter().position(|l| *l == 'L') {
            wavelength = values[k];
        }
        rows.push((if wavelength > 0.0 { wavelength } else { f64::NAN }, values));
    }
    if rows.is_empty() {
        return Err("no reading follows the header".into());
    }
    let mut file = InstrumentFile::new(InstrumentFormat::Iad, name, rows.iter().map(|r| r.0).filter(|w| !w.is_nan()));
    if file.range.is_none() {
        file.wavelengths = rows.len();
        file.notes.push("its readings have no wavelengths".into());
    }
    (file.thickness_mm, file.index, file.unit) = (Some(thickness), Some(index), Some(ReflectanceUnit::Share));
    let of = |values: &[f64], label: char| labels.iter().position(|l| *l == label).map_or(f64::NAN, |k| values[k]);
    let column = |label: char| rows.iter().map(move |(_, values)| of(values, label)).filter(|v| !v.is_nan());
    // A 0 stands for what was not measured.
    let measured = |values: &[f64], label: char| Some(of(values, label)).filter(|v| *v != 0.0).unwrap_or(f64::NAN);
    for (label, quantity) in [
        ('r', SpectrumQuantity::Reflectance),
        ('t', SpectrumQuantity::Transmittance),
        ('u', SpectrumQuantity::Unscattered),
    ] {
        if rows.iter().any(|(_, values)| !measured(values, label).is_nan()) {
            file.holds.push((quantity, 1));
        }
    }
    file.barred = barred(&header, &told, &labels, &column);
    let zeros = column('t').filter(|t| *t == 0.0).count();
    if zeros > 0 {
        file.notes.push(format!("{zeros} transmittances of 0 are taken as not measured, as iad takes them"));
    }
    if spheres > 0.0 && file.barred.is_none() {
        file.loses_light = true;
        file.notes.push(
            "its comment says that it was measured in a dual beam (iad -X): no correction for the sphere is needed. \
             Light that leaves the sample beyond the sphere's ports is missing all the same, which makes the \
             absorption too large; iad estimates it by Monte Carlo"
                .into(),
        );
    }
    if file.has(SpectrumQuantity::Unscattered) {
        file.notes.push("the unscattered transmittance is not used".into());
    }
    if file.barred.is_some() {
        return Ok(file);
    }
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    file.readings = rows
        .iter()
        .map(|(wavelength, values)| SpectralReading {
            leaf: 0,
            wavelength: *wavelength,
            r: measured(values, 'r'),
            t: measured(values, 't'),
            index: of(values, 'n'),
            thickness_mm: of(values, 'd'),
        })
        .collect();
    Ok(file)
}

/// Why the readings are no plain reflectance and transmittance of a bare sample.
fn barred<I: Iterator<Item = f64>>(
    header: &[f64; 17],
    told: &[&str],
    labels: &[char],
    column: &impl Fn(char) -> I,
) -> Option<String> {
    let [_, slides, _, slide_thickness, _, _, spheres, ..] = *header;
    let any = |label: char, test: fn(f64) -> bool| column(label).any(test);
    let most = ['S', 'M'].into_iter().flat_map(column).fold(spheres, f64::max);
    let on_command = told.iter().filter(|line| line.contains("iad")).flat_map(|line| line.split_whitespace());
    let dual = on_command.map(|word| word.trim_matches(['\'', '"', '`'])).any(|word| word == "-X");
    if most > 0.0 && !(dual && most < 2.0) {
        let (s, it) = if most > 1.0 { ("s", "them") } else { ("", "it") };
        return Some(format!(
            "it was measured with {most} integrating sphere{s}, and its M_R and M_T are not yet corrected for \
             {it}; invert it with `iad`, or give the corrected reflectance and transmittance as a table"
        ));
    }
    let (has_slides, per_row) = (slide_thickness > 0.0 && slides > 1.0, any('D', |d| d > 0.0) && any('N', |n| n > 1.0));
    if has_slides || per_row {
        return Some(format!(
            "its sample lies between slides of index {slides}, which reflect, and no fit here takes that off; invert \
             it with `iad`"
        ));
    }
    if any('c', |c| c != 1.0) || any('C', |c| c != 1.0) {
        return Some(
            "its M_R and M_T leave out a part of the unscattered light (columns c, C), so they are no whole \
             reflectance and transmittance; invert it with `iad`"
                .into(),
        );
    }
    if !labels.iter().any(|l| "rt".contains(*l)) {
        return Some("it holds nothing but an unscattered transmittance, which no fit here takes".into());
    }
    None
}
