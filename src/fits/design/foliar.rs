//! Bands of a spectrometer: which of them tell most about the contents of leaves.
//!
//! What the coefficients leave unexplained is alike over long ranges of wavelength. Each of its modes is an unknown
//! amplitude with a standard deviation of 1 beside the seven numbers of a leaf, so that bands which only repeat one
//! another are not taken for new information.

use crate::gloss::synthetic::GaussianDeviates;
use crate::plates::leaf::PlateLight;
use crate::plates::{CONTENTS, FREE, LOWER, PlateCoefficients, UPPER, USUAL};
use mesophyll_base::selection::{DesignAim, DesignParameter, DesignProblem, DesignSituation};
use rayon::prelude::*;

/// Leaves that a design has to serve.
const LEAVES: usize = 48;
/// What is known of a leaf: it is like those of the training, within this many of their standard deviations.
const WIDE: f64 = 3.0;

/// A spectrometer, and leaves like those that the coefficients were made from.
#[derive(Debug, Clone)]
pub struct FoliarDesign<'a> {
    /// The constants of the leaves' substances.
    pub coefficients: &'a PlateCoefficients,
    /// Centres of the bands to choose among (nm).
    pub bands: Vec<f64>,
    /// Whether reflectance and transmittance are read.
    pub read: [bool; 2],
    /// Standard error of a reading.
    pub noise: f64,
    /// Which of [`CONTENTS`] it is for.
    pub wanted: [bool; 4],
}

impl FoliarDesign<'_> {
    /// Bands `step` nm apart over the range of the coefficients, or a part of it.
    pub fn spaced(coefficients: &PlateCoefficients, step: f64, [from, to]: [f64; 2]) -> Vec<f64> {
        let [least, most] = coefficients.range();
        let (from, to) = (from.max(least), to.min(most));
        let count = ((to - from) / step + 1e-9).floor().max(-1.0) as i64 + 1;
        (0..count).map(|k| from + step * k as f64).collect()
    }

    /// The problem of choosing bands; contents are in the units of [`CONTENTS`].
    pub fn problem(&self) -> DesignProblem {
        let (population, modes) = (&self.coefficients.population, self.coefficients.misfit.modes.len());
        let unit = |k: usize| USUAL.get(k).copied().unwrap_or(1.0);
        let free = ["chlorophyll_ug_cm2", "carotenoid_ug_cm2", "water_g_cm2", "dry_g_cm2", "brown", "plates", "gloss"];
        let leaf = |k: usize| DesignParameter {
            name: free[k].into(),
            known: WIDE * population.spread[k].max(1e-6) * unit(k),
            wanted: k < CONTENTS.len() && self.wanted[k],
        };
        let mode = |k: usize| DesignParameter { name: format!("misfit_{k}"), known: 1.0, wanted: false };
        let parameters = (0..FREE).map(leaf).chain((0..modes).map(mode)).collect();
        let mut draws = GaussianDeviates::new(1);
        let leaves: Vec<[f64; FREE]> = (0..LEAVES)
            .map(|_| {
                let of = |k: usize| {
                    let usual = population.mean[k] + population.spread[k] * draws.normal();
                    // A leaf without a substance tells nothing of how its content is found.
                    usual.clamp(LOWER[k].max(0.1 * population.mean[k]), UPPER[k])
                };
                let mut of = of;
                std::array::from_fn(&mut of)
            })
            .collect();
        let situations = leaves.par_iter().map(|leaf| self.situation(leaf)).collect();
        DesignProblem { aim: DesignAim::Parameters, parameters, situations, taken: Vec::new() }
    }

    fn situation(&self, leaf: &[f64; FREE]) -> DesignSituation {
        let misfit = &self.coefficients.misfit;
        let rows = |wavelength: &f64| {
            let (k, t) = self.coefficients.place(*wavelength);
            let last = self.coefficients.wavelengths.len() - 1;
            let between = |of: &[[f64; 2]], i: usize| of[k][i] + t * (of[(k + 1).min(last)][i] - of[k][i]);
            let light = PlateLight::new(self.coefficients.at(*wavelength));
            let response = light.response(leaf);
            let mut rows = Vec::new();
            for i in (0..2).filter(|i| self.read[*i]) {
                let sd = self.noise.hypot(between(&misfit.short, i));
                let by = response[i].1.iter().enumerate();
                rows.extend(by.map(|(j, v)| v / sd / USUAL.get(j).copied().unwrap_or(1.0)));
                rows.extend(misfit.modes.iter().map(|mode| between(mode, i) / sd));
            }
            rows
        };
        let values = leaf.iter().enumerate().map(|(k, v)| v * USUAL.get(k).copied().unwrap_or(1.0));
        let values = values.chain(misfit.modes.iter().map(|_| 0.0)).collect();
        DesignSituation { values, rows: self.bands.iter().map(rows).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plates::misfit::PlateMisfit;
    use crate::plates::{PlatePoint, PlatePopulation};
    use mesophyll_base::selection::evenly;

    /// Chlorophyll absorbs around 660 nm, water around 1450 nm, dry matter everywhere beyond 1000 nm.
    fn coefficients() -> PlateCoefficients {
        let wavelengths: Vec<f64> = (0..=200).map(|k| 400.0 + 10.0 * f64::from(k)).collect();
        let bell = |w: f64, at: f64, wide: f64| (-((w - at) / wide).powi(2)).exp();
        let point = |w: &f64| PlatePoint {
            specific: [
                1.5 * bell(*w, 660.0, 60.0),
                bell(*w, 460.0, 40.0),
                1.2 * bell(*w, 1450.0, 90.0),
                if *w > 1000.0 { 0.1 } else { 0.0 },
                0.0,
            ],
            index: 1.4,
            growth: 1.0,
        };
        let count = wavelengths.len();
        PlateCoefficients {
            points: wavelengths.iter().map(point).collect(),
            errors: vec![[0.0; FREE]; count],
            population: PlatePopulation {
                mean: [0.8, 0.8, 1.0, 1.0, 0.1, 0.6, 0.5],
                spread: [0.2, 0.2, 0.3, 0.3, 0.1, 0.2, 0.2],
                ratio: [0.2, 2.0],
                off: [0.0; 4],
                rms: 0.01,
                counts: [100, 20],
            },
            misfit: PlateMisfit { modes: vec![vec![[0.01; 2]; count]], short: vec![[0.002; 2]; count], reach: 15.0 },
            wavelengths,
        }
    }

    #[test]
    fn water_is_read_in_its_band_and_chlorophyll_in_its_own() {
        let coefficients = coefficients();
        let bands = FoliarDesign::spaced(&coefficients, 20.0, [400.0, 2400.0]);
        assert_eq!(bands.len(), 101);
        let design = |wanted| FoliarDesign {
            coefficients: &coefficients,
            bands: bands.clone(),
            read: [true; 2],
            noise: 0.003,
            wanted,
        };
        let within = |wanted, near: f64, far: f64| {
            let problem = design(wanted).problem();
            let choice = problem.choose(5).unwrap();
            let even = problem.judge(&evenly(101, 5)).unwrap();
            assert!(choice.ratio < even.ratio, "{} {}", choice.ratio, even.ratio);
            choice.chosen.iter().filter(|k| (near..far).contains(&bands[**k])).count()
        };
        assert!(within([true, false, false, false], 550.0, 770.0) >= 1);
        assert!(within([false, false, true, false], 1250.0, 1650.0) >= 1);
        assert_eq!(within([true, false, false, false], 1250.0, 1650.0), 0);
    }
}
