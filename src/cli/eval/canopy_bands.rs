//! Which wavelengths `mesophyll eval canopy` is asked for.

use crate::cli::{Error, Result};
use mesophyll_files::spectra::SingleSpectrum;
use mesophyll_scene::manifest::SceneManifest;
use std::path::PathBuf;
use std::str::FromStr;

/// What `--bands` says.
#[derive(Debug, Clone, PartialEq)]
pub enum BandChoice {
    /// All that the scene's spectra have in common.
    All,
    /// These wavelengths (nm).
    Listed(Vec<f64>),
    /// The wavelengths of a table.
    Table(PathBuf),
}

/// More wavelengths than these are more likely a mistake than meant.
const MOST: usize = 10_000;

impl FromStr for BandChoice {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<BandChoice, String> {
        if text == "all" {
            return Ok(BandChoice::All);
        }
        let numbers: Vec<_> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
        if numbers.iter().all(|number| number.is_err()) {
            return match text.contains(',') || text.is_empty() {
                true => Err("expected wavelengths in nm such as 450,550, a table, or all".into()),
                false => Ok(BandChoice::Table(text.into())),
            };
        }
        let of = |(part, number): (&str, std::result::Result<f64, _>)| match number {
            Ok(nm) if (100.0..=30_000.0).contains(&nm) => Ok(nm),
            _ => Err(format!("found {}, expected a wavelength in nm, 100 to 30000", part.trim())),
        };
        text.split(',').zip(numbers).map(of).collect::<std::result::Result<_, _>>().map(BandChoice::Listed)
    }
}

impl BandChoice {
    /// The wavelengths (nm), for a scene.
    ///
    /// # Errors
    /// A table that cannot be read, a wavelength that is asked for twice, and a scene without spectra.
    pub fn wavelengths(&self, scene: &SceneManifest) -> Result<Vec<f64>> {
        let found = match self {
            BandChoice::All => scene.wavelengths()?,
            BandChoice::Listed(list) => list.clone(),
            BandChoice::Table(path) => SingleSpectrum::read(path, |_| Ok(Vec::new()))?.wavelengths,
        };
        let mut sorted = found.clone();
        sorted.sort_by(f64::total_cmp);
        if let Some(pair) = sorted.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(Error::Usage(format!("--bands has {} nm twice; expected each wavelength once", pair[0])));
        }
        match found.len() {
            n if n > MOST => Err(Error::Usage(format!("--bands has {n} wavelengths; expected at most {MOST}"))),
            _ => Ok(found),
        }
    }

    /// The columns of reflectance factors, each with that of its standard error.
    pub fn columns(wavelengths: &[f64]) -> Vec<String> {
        wavelengths.iter().flat_map(|nm| [format!("brf_{nm}"), format!("brf_{nm}_err")]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_told_apart() {
        let of = |text: &str| text.parse::<BandChoice>();
        assert_eq!(of("all"), Ok(BandChoice::All));
        assert_eq!(of("450, 550.5"), Ok(BandChoice::Listed(vec![450.0, 550.5])));
        assert_eq!(of("850"), Ok(BandChoice::Listed(vec![850.0])));
        assert_eq!(of("bands.csv"), Ok(BandChoice::Table("bands.csv".into())));
        for (text, words) in [
            ("450,x", "found x, expected a wavelength"),
            ("0.45,0.55", "found 0.45"),
            ("-450", "found -450"),
            ("nan", "found nan"),
            ("", "such as 450,550"),
            ("a,b", "such as 450,550"),
        ] {
            assert!(of(text).unwrap_err().contains(words), "{text}: {:?}", of(text));
        }
        assert_eq!(BandChoice::columns(&[450.0, 550.5]), ["brf_450", "brf_450_err", "brf_550.5", "brf_550.5_err"]);
    }
}
