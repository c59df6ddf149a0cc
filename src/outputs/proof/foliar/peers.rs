//! The measurements that the peer of `bench abm` is run on (reflectance and transmittance of leaves of 45 species), and
//! our fit of the same readings.

use crate::Result;
use crate::bench::{BenchRow, median_us};
use crate::peers::PeerInputs;
use mesophyll_fits::foliar::surface::FoliarFitSetting;
use mesophyll_fits::foliar::{FoliarFitConstants, FoliarFitModel, FoliarParameter, FoliarReading};
use mesophyll_optics::foliar::pigments::{OpticalConstants, OpticalSpectrum};
use mesophyll_optics::foliar::{MesophyllPath, Oblateness};
use mesophyll_optics::side::Side;

/// Measured means of species (`SOURCE.md` in the same folder names the source). The last six columns are R and T at
/// [`WAVELENGTHS`].
const SPECIES: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/leaves/species_means.csv"));
/// The example's table of pigments.
const PIGMENTS: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/tables/pigments.csv"));
const WAVELENGTHS: [f64; 3] = [450.0, 550.0, 650.0];

/// The last `N` cells of every row but the header.
fn rows<const N: usize>(text: &str) -> Vec<[f64; N]> {
    let cells = |line: &str| line.split(',').filter_map(|cell| cell.parse().ok()).collect::<Vec<f64>>();
    let last = |line: &str| cells(line).last_chunk().copied();
    text.lines().skip(1).filter_map(last).collect()
}

fn spectrum() -> OpticalSpectrum {
    let point = |[nm, a, b, c, d, water, n_cuticle, n_mesophyll, n_antidermal]: [f64; 9]| {
        (nm, OpticalConstants { specific: [a, b, c, d, water], indices: [n_cuticle, n_mesophyll, n_antidermal] })
    };
    OpticalSpectrum { points: rows(PIGMENTS).into_iter().map(point).collect() }
}

/// 45 species at three wavelengths, and our row for each form of a crossing.
///
/// # Errors
/// Wavelengths that the table of pigments does not have.
pub fn inputs() -> Result<PeerInputs> {
    let species: Vec<[f64; 6]> = rows(SPECIES);
    let mut text = String::from("R450,T450,R550,T550,R650,T650\n");
    for leaf in &species {
        text.push_str(&(leaf.map(|x| x.to_string()).join(",") + "\n"));
    }
    let mut ours = Vec::new();
    for path in [MesophyllPath::Sieve, MesophyllPath::Slant] {
        let Oblateness { palisade, spongy, .. } = Oblateness::USUAL;
        let setting = FoliarFitSetting { palisade, spongy, path, incidence: 8f64.to_radians() };
        let asked = [FoliarParameter::Chlorophyll, FoliarParameter::Carotenoid, FoliarParameter::Oblateness];
        let model = FoliarFitModel::new(&spectrum(), &WAVELENGTHS.map(|nm| (nm, Side::Front)), setting, &asked, None)
            .map_err(crate::Error::Missed)?;
        let known = FoliarFitConstants { contents: [0.0; 5], oblateness: Oblateness::USUAL.epidermis };
        let reading = |(k, value): (usize, &f64)| FoliarReading {
            light: k / 2,
            through: k % 2 == 1,
            value: *value,
            err: f64::NAN,
        };
        // After the values and their errors comes the misfit of the readings.
        let misfit = |leaf: &[f64; 6]| {
            let readings: Vec<FoliarReading> = leaf.iter().enumerate().map(reading).collect();
            let answer = model.fit(&readings, &known);
            answer.values.get(2 * asked.len()).copied().unwrap_or(f64::NAN)
        };
        let found: Vec<f64> = species.iter().map(misfit).collect();
        let mean = found.iter().map(|r| r * r).sum::<f64>() / found.len() as f64;
        let us = median_us(100.0, || species.iter().map(misfit).sum::<f64>()) / species.len() as f64;
        let worst = found.iter().copied().fold(0.0, f64::max);
        let word: &str = path.into();
        ours.push(BenchRow {
            model: "abm".into(),
            knob: "peer".into(),
            setting: format!("mesophyll fit foliar, {word}"),
            error: mean.sqrt(),
            us,
            note: format!(
                "{} species, R and T at three wavelengths, root mean square, three parameters, worst species \
                 {worst:.1e}; the table of pigments is the example's",
                species.len()
            ),
        });
    }
    Ok(PeerInputs { files: vec![("leaves.csv".into(), text.into_bytes())], ours, turn: None })
}

#[cfg(test)]
mod tests {
    #[test]
    fn species_and_pigments_are_read_whole() {
        let species: Vec<[f64; 6]> = super::rows(super::SPECIES);
        assert_eq!((species.len(), species[0]), (45, [0.04, 0.017, 0.078, 0.133, 0.042, 0.041]));
        let spectrum = super::spectrum();
        assert_eq!(spectrum.at(550.0).unwrap().indices, [1.51, 1.415, 1.41]);
        assert_eq!(spectrum.points.len(), 3);
    }
}
