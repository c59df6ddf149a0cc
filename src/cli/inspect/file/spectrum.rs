//! Which command takes spectra of leaves and slabs.

use super::{Found, quoted};
use std::path::Path;

/// What decides which fit can use spectra.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpectrumContents {
    pub reflectance: bool,
    pub transmittance: bool,
    pub thickness: bool,
    pub percent: bool,
    pub wavelengths: bool,
    /// Refractive index of the sample, where it is stated and not 1.
    pub index: Option<f64>,
}

impl SpectrumContents {
    /// Names the command: `fit slab` needs R, T and the thickness, `fit foliar` takes R or T alone.
    pub fn takes(&self, found: &mut Found, path: &Path) {
        let file = quoted(path);
        let percent = if self.percent { " --percent" } else { "" };
        let index = self.index.map_or_else(String::new, |n| format!(" --index {n}"));
        let slab = format!("mesophyll fit slab{index}{percent} --in {file}");
        let foliar = format!("mesophyll fit foliar --pigments PIGMENTS.csv{percent} --in {file}");
        if self.wavelengths {
            found.notes.push(format!(
                "its colours, by readings from 400 to 700 nm: mesophyll eval bands{percent} --in {file}"
            ));
        }
        if self.wavelengths || (self.reflectance && self.transmittance && self.thickness) {
            let what =
                "add --noise S, the standard error of a reading as a share of 1: without it the answer has no errors";
            found.notes.push(what.into());
        }
        let both = self.reflectance && self.transmittance;
        if both && self.thickness {
            found.command = Some(slab);
            if self.wavelengths {
                found.notes.push(format!("its pigments: {foliar}"));
            }
            return;
        }
        let lacks = match (self.reflectance, self.transmittance, self.thickness) {
            (true, true, _) => "the thickness (a column thickness_mm)",
            (true, false, true) => "the transmittance too",
            (true, false, false) => "the transmittance and the thickness too",
            (false, _, true) => "the reflectance too",
            (false, _, false) => "the reflectance and the thickness too",
        };
        if self.wavelengths {
            found.command = Some(foliar);
            found.notes.push(format!("`mesophyll fit slab` needs {lacks}"));
        } else {
            found.reason = Some(format!(
                "`mesophyll fit slab` needs {lacks}, and `mesophyll fit foliar` needs a wavelength for each reading"
            ));
        }
    }
}
