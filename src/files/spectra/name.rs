//! What the name of a column says in a table of spectra: `R450`, `refl_450.5`, `X450`, `450nm`, `R(adaxial)`,
//! `Wavelength (nm)`, `Reflectance (%)`.

use mesophyll_base::surface::side::Side;

/// The parts of a column's name. A name with any other word in it belongs to no spectrum.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SpectrumColumnName {
    /// Transmittance (true) or reflectance (false), where it says so.
    pub through: Option<bool>,
    /// The number in it, which is a wavelength or counts replicates.
    pub number: Option<f64>,
    /// What a unit of this number, or of the column's numbers, is in nm.
    pub unit_nm: Option<f64>,
    /// The lit side.
    pub side: Option<Side>,
    /// Whether it is the standard error of such a reading.
    pub error: bool,
    /// Whether the readings are in per cent.
    pub percent: bool,
    /// Whether it says that its number, or the column's numbers, are wavelengths.
    pub wavelength: bool,
}

/// A word or a number of a name.
#[derive(Debug, Clone, PartialEq)]
enum Token {
    Word(String),
    Number(f64),
}

/// Whether a word names transmittance (true) or reflectance (false).
pub fn quantity(word: &str) -> Option<bool> {
    match word.to_lowercase().as_str() {
        "r" | "refl" | "reflectance" | "reflectances" | "reflectivity" | "reflection" | "rho" => Some(false),
        "t" | "tran" | "trans" | "transm" | "transmittance" | "transmittances" | "transmissivity" | "transmission"
        | "tau" => Some(true),
        _ => None,
    }
}

/// The only quantity that the words of a cell name: `Reflectance (%)`, `T`.
pub fn quantity_of(cell: &str) -> Option<bool> {
    let words = tokens(cell)?;
    let named: Vec<bool> =
        words.iter().filter_map(|t| if let Token::Word(w) = t { quantity(w) } else { None }).collect();
    named.first().copied().filter(|first| named.iter().all(|q| q == first))
}

impl SpectrumColumnName {
    /// The parts of a name; `None` where it belongs to no spectrum.
    pub fn of(name: &str) -> Option<SpectrumColumnName> {
        match name {
            "rho_d" | "rho_t" => {
                return Some(SpectrumColumnName { through: Some(name == "rho_t"), ..SpectrumColumnName::default() });
            }
            "rho_d_err" | "rho_t_err" => {
                return Some(SpectrumColumnName {
                    through: Some(name == "rho_t_err"),
                    error: true,
                    ..SpectrumColumnName::default()
                });
            }
            _ => {}
        }
        let tokens = tokens(name)?;
        let numbered = tokens.iter().any(|t| matches!(t, Token::Number(_)));
        let mut found = SpectrumColumnName::default();
        for token in &tokens {
            let twice = match token {
                Token::Number(v) => found.number.replace(*v).is_some(),
                Token::Word(word) => found.take(word, numbered)?,
            };
            if twice {
                return None;
            }
        }
        (!tokens.is_empty()).then_some(found)
    }

    /// Takes a word; true where the name says such a thing for the second time, `None` where the word is unknown.
    fn take(&mut self, word: &str, numbered: bool) -> Option<bool> {
        let lower = word.to_lowercase();
        // A small letter alone is anything: t may be a time.
        let letter = matches!(word, "r" | "t");
        if let Some(through) = quantity(word).filter(|_| numbered || !letter) {
            return Some(self.through.replace(through).is_some());
        }
        if let Some(side) = Side::of_botanical(&lower).or_else(|| lower.parse().ok()) {
            return Some(self.side.replace(side).is_some());
        }
        match lower.as_str() {
            "nm" | "nanometer" | "nanometers" | "nanometre" | "nanometres" => Some(self.unit_nm.replace(1.0).is_some()),
            "um" | "µm" | "μm" | "micron" | "microns" | "micrometer" | "micrometers" | "micrometre" | "micrometres" => {
                Some(self.unit_nm.replace(1e3).is_some())
            }
            "wl" | "wvl" | "wave" | "wavelength" | "wavelengths" | "lambda" | "λ" => {
                Some(std::mem::replace(&mut self.wavelength, true))
            }
            // A program for statistics puts it in front of names that are numbers.
            "x" if numbered => Some(std::mem::replace(&mut self.wavelength, true)),
            "err" | "error" | "se" | "stderr" => Some(std::mem::replace(&mut self.error, true)),
            "%" | "percent" | "pct" => Some(std::mem::replace(&mut self.percent, true)),
            "factor" | "spectral" | "mean" => Some(false),
            _ => None,
        }
    }

    /// Whether the column holds wavelengths, as in long form.
    pub fn is_wavelength(&self) -> bool {
        self.number.is_none() && self.through.is_none() && !self.error && (self.wavelength || self.unit_nm.is_some())
    }

    /// Whether it is a reading with a wavelength of its own, or its error.
    pub fn is_numbered(&self) -> bool {
        self.number.is_some() && !(self.wavelength && self.through.is_some())
    }
}

/// Splits a name into words and numbers; `None` for a character that belongs to neither.
fn tokens(name: &str) -> Option<Vec<Token>> {
    let (mut tokens, mut rest) = (Vec::new(), name.trim());
    while let Some(c) = rest.chars().next() {
        let (length, token) = if c.is_ascii_digit() {
            let point =
                |k: usize, b: u8| b".,".contains(&b) && rest.as_bytes().get(k + 1).is_some_and(u8::is_ascii_digit);
            let mut points = 0;
            let end = rest.bytes().enumerate().position(|(k, b)| {
                points += usize::from(point(k, b));
                !(b.is_ascii_digit() || point(k, b) && points == 1)
            });
            let length = end.unwrap_or(rest.len());
            (length, Some(Token::Number(rest[..length].replace(',', ".").parse().ok()?)))
        } else if c.is_alphabetic() {
            let length = rest.find(|c: char| !c.is_alphabetic()).unwrap_or(rest.len());
            (length, Some(Token::Word(rest[..length].to_string())))
        } else if c == '%' {
            (1, Some(Token::Word("%".into())))
        } else if " _-.()[]{}/:".contains(c) {
            (c.len_utf8(), None)
        } else {
            return None;
        };
        tokens.extend(token);
        rest = &rest[length..];
    }
    Some(tokens)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_taken_apart() {
        let of = |name: &str| {
            let n = SpectrumColumnName::of(name).unwrap_or_else(|| panic!("{name} is of a spectrum"));
            (n.through, n.number, n.unit_nm, n.side, n.error, n.percent)
        };
        let (r, t) = (Some(false), Some(true));
        for (name, want) in [
            ("R450", (r, Some(450.0), None, None, false, false)),
            ("T550.5", (t, Some(550.5), None, None, false, false)),
            ("R450,5", (r, Some(450.5), None, None, false, false)),
            ("R450_abaxial", (r, Some(450.0), None, Some(Side::Back), false, false)),
            ("R450_abaxial_err", (r, Some(450.0), None, Some(Side::Back), true, false)),
            ("refl_450", (r, Some(450.0), None, None, false, false)),
            ("Transmittance.450.nm", (t, Some(450.0), Some(1.0), None, false, false)),
            ("0.45um", (None, Some(0.45), Some(1e3), None, false, false)),
            ("X450", (None, Some(450.0), None, None, false, false)),
            ("450.5", (None, Some(450.5), None, None, false, false)),
            ("R(adaxial)", (r, None, None, Some(Side::Front), false, false)),
            ("Reflectance (%)", (r, None, None, None, false, true)),
            ("rho_t", (t, None, None, None, false, false)),
            ("R_err", (r, None, None, None, true, false)),
        ] {
            assert_eq!(of(name), want, "{name}");
        }
        for name in ["wl", "Wavelength (nm)", "wavelength_um", "nm", "lambda", "Wavelengths[µm]"] {
            assert!(SpectrumColumnName::of(name).unwrap().is_wavelength(), "{name}");
        }
        for name in
            ["leaf", "thickness_um", "h", "t", "note", "", "450_460", "R450T450", "Tag", "water_g_cm2", "2013-09-20"]
        {
            assert_eq!(
                SpectrumColumnName::of(name).filter(|n| n.number.is_some() || n.through.is_some()),
                None,
                "{name}"
            );
        }
        assert_eq!(
            ["Reflectance (%)", "T", "transmittance", "R/T", "absorbance"].map(quantity_of),
            [r, t, t, None, None]
        );
    }
}
