//! Spectra of leaves and of the ground: what they scatter at any wavelength, and the colours that pictures show of it.

use super::{LeafOrigin, SceneGround, SceneManifest, UniformLeaf};
use crate::manifest::{Error, Result};
use mesophyll_base::surface::side::Side;
use mesophyll_files::spectra::{self, SingleSpectrum};
use mesophyll_files::table::InputTable;
use mesophyll_sky::response::ObserverResponse;
use serde::Deserialize;
use std::path::PathBuf;
use std::sync::Arc;

/// A table that a scene names, and what it holds.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(from = "PathBuf")]
pub struct StatedSpectrum {
    /// The file, as the scene names it.
    pub file: PathBuf,
    /// What was read from it: of a leaf R of the front, R of the back and T; of the ground its albedo.
    pub read: Option<Arc<SingleSpectrum>>,
    /// Why it has no colours for pictures, where it has none and the scene states none.
    pub colourless: Option<String>,
}

impl From<PathBuf> for StatedSpectrum {
    fn from(file: PathBuf) -> StatedSpectrum {
        StatedSpectrum { file, read: None, colourless: None }
    }
}

impl StatedSpectrum {
    /// The sRGB of all its quantities under daylight, each 0 to 1.
    fn colours(&mut self, quantities: usize) -> Vec<[f64; 3]> {
        let Some(read) = &self.read else { return vec![[0.0; 3]; quantities] };
        match ObserverResponse::Srgb.weights(&read.wavelengths) {
            Ok(weights) => {
                let of = |values: &Vec<f64>, c: usize| values.iter().zip(&weights).map(|(v, w)| v * w[c]).sum::<f64>();
                read.values.iter().map(|values| [0, 1, 2].map(|c| of(values, c).clamp(0.0, 1.0))).collect()
            }
            Err(why) => {
                self.colourless = Some(why);
                vec![[0.0; 3]; quantities]
            }
        }
    }
}

/// What stands for three numbers that a scene does not state.
pub fn unstated() -> [f64; 3] {
    [f64::NAN; 3]
}

impl UniformLeaf {
    /// The first of `rho_d` and `rho_t` that is neither stated nor found from the spectrum.
    pub fn lacks(&self) -> Option<&'static str> {
        let lists = [("rho_d", self.rho_d[0][0]), ("rho_t", self.rho_t[0])];
        lists.into_iter().find(|(_, first)| first.is_nan()).map(|(name, _)| name)
    }
}

impl SceneManifest {
    /// Reads the spectra of leaves and ground, and finds the colours that the scene does not state.
    pub(super) fn read_spectra(&mut self) -> Result<()> {
        for k in 0..self.leaves.len() {
            let LeafOrigin::Uniform(leaf) = &self.leaves[k].origin else { continue };
            let Some(file) = leaf.spectrum.as_ref().map(|s| self.resolve(&s.file)) else { continue };
            let read = of_leaf(SingleSpectrum::read(&file, leaf_columns)?)?;
            let LeafOrigin::Uniform(leaf) = &mut self.leaves[k].origin else { continue };
            let Some(spectrum) = &mut leaf.spectrum else { continue };
            spectrum.read = Some(Arc::new(read));
            if leaf.rho_d[0][0].is_nan() && leaf.rho_t[0].is_nan() {
                let colours = spectrum.colours(3);
                for c in 0..3 {
                    let [front, back, through] = [0, 1, 2].map(|q: usize| colours[q][c]);
                    // A colour beyond what sRGB holds may give more than it gets.
                    let over = (front.max(back) + through).max(1.0);
                    (leaf.rho_d[0][c], leaf.rho_d[1][c], leaf.rho_t[c]) = (front / over, back / over, through / over);
                }
            }
        }
        let Some(file) = self.ground.as_ref().and_then(|g| g.spectrum.as_ref()).map(|s| self.resolve(&s.file)) else {
            return Ok(());
        };
        let read = SingleSpectrum::read(&file, ground_column)?;
        if let Some(SceneGround { albedo, spectrum: Some(spectrum), .. }) = &mut self.ground {
            spectrum.read = Some(Arc::new(read));
            if albedo[0].is_nan() {
                *albedo = spectrum.colours(1)[0];
            }
        }
        Ok(())
    }

    /// The spectra of leaves and ground, each with the field that states it.
    fn spectra(&self) -> impl Iterator<Item = (String, &StatedSpectrum)> {
        let leaves = self.leaves.iter().filter_map(|leaf| match &leaf.origin {
            LeafOrigin::Uniform(of) => Some((format!("leaf \"{}\", uniform", leaf.name), of.spectrum.as_ref()?)),
            _ => None,
        });
        leaves.chain(self.ground.iter().filter_map(|g| Some(("ground".to_string(), g.spectrum.as_ref()?))))
    }

    /// Whether pictures can show everything in colours.
    ///
    /// # Errors
    /// [`Error::Input`] for a spectrum that is too short or too coarse for them, where the scene states none itself.
    pub fn require_colours(&self) -> Result<()> {
        match self.spectra().find_map(|(field, s)| Some((field, s, s.colourless.as_ref()?))) {
            None => Ok(()),
            Some((field, spectrum, why)) => {
                let (file, ground) = (spectrum.file.display(), field == "ground");
                let stated = if ground { "albedo" } else { "rho_d and rho_t" };
                let what =
                    format!("{file} has no colours ({why}); expected {stated} beside it, or `eval canopy --bands`");
                Err(Error::field(&self.path, &format!("{field}.spectrum"), what))
            }
        }
    }

    /// Gives up colours that spectra do not have, for callers that ask for wavelengths alone.
    pub fn forget_colours(&mut self) {
        let leaves = self.leaves.iter_mut().filter_map(|leaf| match &mut leaf.origin {
            LeafOrigin::Uniform(of) => of.spectrum.as_mut(),
            _ => None,
        });
        let ground = self.ground.iter_mut().filter_map(|g| g.spectrum.as_mut());
        leaves.chain(ground).for_each(|spectrum| spectrum.colourless = None);
    }

    /// All wavelengths (nm) of the scene's spectra that every one of them covers.
    ///
    /// # Errors
    /// [`Error::Input`] where there is none.
    pub fn wavelengths(&self) -> Result<Vec<f64>> {
        let read: Vec<&SingleSpectrum> = self.spectra().filter_map(|(_, s)| s.read.as_deref()).collect();
        let low = read.iter().map(|s| s.range()[0]).fold(f64::NEG_INFINITY, f64::max);
        let high = read.iter().map(|s| s.range()[1]).fold(f64::INFINITY, f64::min);
        let mut all: Vec<f64> = read.iter().flat_map(|s| s.wavelengths.iter().copied()).collect();
        all.retain(|nm| low <= *nm && *nm <= high);
        all.sort_by(f64::total_cmp);
        all.dedup();
        if all.is_empty() {
            let what = match read.is_empty() {
                true => "no leaf and no ground has a spectrum; expected one of each, for light of any wavelength",
                false => "the spectra of leaves and ground have no wavelength in common",
            };
            return Err(Error::input(&self.path, what));
        }
        Ok(all)
    }
}

/// The columns of a leaf: R, T, and R of the back where there is one.
fn leaf_columns(table: &InputTable) -> Result<Vec<String>> {
    let readings = spectra::readings(table)?;
    let of = |through: bool, back: bool| {
        readings.iter().find(|c| c.through == through && (c.side == Some(Side::Back)) == back).map(|c| c.name.clone())
    };
    let lacks = |name: &str| {
        let what =
            format!("no such column; a leaf needs wavelength_nm, R and T; the header has {}", table.shown_header());
        Error::field(table.name(), name, what)
    };
    let front = of(false, false).ok_or_else(|| lacks("R"))?;
    let back = of(false, true).unwrap_or_else(|| front.clone());
    // The model has one transmittance for both directions.
    let through = of(true, false).or_else(|| of(true, true)).ok_or_else(|| lacks("T"))?;
    Ok(vec![front, back, through])
}

/// The rounding error that R + T = 1 may have when the numbers have six digits.
const ROUNDING: f64 = 2e-6;

/// Checks that a leaf gives no more than it gets.
fn of_leaf(read: SingleSpectrum) -> Result<SingleSpectrum> {
    for (k, nm) in read.wavelengths.iter().enumerate() {
        let sum = read.values[0][k].max(read.values[1][k]) + read.values[2][k];
        if !(sum <= 1.0 + ROUNDING) {
            let what =
                format!("at {nm} nm R + T is {sum}; expected at most 1, because a leaf gives no more than it gets");
            return Err(Error::input(&read.file, what));
        }
    }
    Ok(read)
}

/// The column of the ground: `albedo`, or R.
fn ground_column(table: &InputTable) -> Result<Vec<String>> {
    if table.column("albedo").is_some() {
        return Ok(vec!["albedo".into()]);
    }
    let reading = spectra::readings(table)?.into_iter().find(|c| !c.through);
    reading.map(|c| vec![c.name]).ok_or_else(|| {
        let what = format!(
            "no such column; the ground needs wavelength_nm and albedo; the header has {}",
            table.shown_header()
        );
        Error::field(table.name(), "albedo", what)
    })
}
