//! One lit side of a piece of leaf under the full convolution, and its reconstruction by a basis.

use super::{Candidate, Case};
use crate::{Error, Result};
use mesophyll_fits::translucency::spread::{ELEVATIONS, STEPS, Spread};
use mesophyll_optics::translucency::basis::Projector;
use mesophyll_optics::translucency::blade::LitSide;
use mesophyll_optics::translucency::convolve::{Convolver, Settings};
use mesophyll_optics::translucency::horizon::Horizon;
use mesophyll_optics::translucency::irradiance::{Visibility, irradiance, project};
use mesophyll_optics::translucency::lights::{Lights, raised};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Number of azimuths at each elevation but the first.
const AZIMUTHS: usize = 8;
/// Texels this close to the border of the piece are not judged (mm).
const MARGIN_MM: f64 = 1.5;

/// One candidate on one case.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Name of the leaf and of the lit side.
    pub case: String,
    /// What was judged.
    pub candidate: Candidate,
    /// Its errors at each of the three elevations.
    pub spreads: [Spread; 3],
}

impl Outcome {
    /// Mean of the mean absolute error over the three elevations. The paper's "average reconstruction error" is 3 %.
    pub fn mean(&self) -> f64 {
        self.spreads.iter().map(|s| s.mean).sum::<f64>() / 3.0
    }
}

/// A lit side with its horizons, its kernels, and the truth in the directions that are judged.
pub struct Judge<'a> {
    pub(super) case: &'a Case,
    pub(super) lit: LitSide<'a>,
    pub(super) horizon: Horizon,
    convolver: Convolver,
    /// Indices of the texels that count.
    judged: Vec<usize>,
    /// The directions of each elevation, and the light that comes through at the judged texels.
    pub(super) truth: Vec<Vec<([f64; 3], Vec<f64>)>>,
}

impl<'a> Judge<'a> {
    /// # Errors
    /// [`Error::Usage`] for a tissue or thicknesses out of range; [`Error::Missed`] for a blade without judged texels.
    pub fn new(case: &'a Case) -> Result<Judge<'a>> {
        let lit = case.blade.lit(case.side);
        let horizon = Horizon::new(&lit);
        let [thin, thick] = case
            .blade
            .thickness_range()
            .ok_or_else(|| Error::Missed(format!("{}: no texel on the leaf", case.name)))?;
        let convolver = Convolver::with(&Settings::new(case.tissue, lit.texel_mm), lit.width, lit.height, thin, thick)?;
        let margin = (MARGIN_MM / lit.texel_mm).ceil() as usize;
        let inner = |k: usize| {
            let (i, j) = (k % lit.width, k / lit.width);
            i >= margin && j >= margin && i + margin < lit.width && j + margin < lit.height
        };
        let judged: Vec<usize> = (0..lit.mask.len()).filter(|&k| lit.mask[k] && inner(k)).collect();
        if judged.is_empty() {
            return Err(Error::Missed(format!("{}: no texel farther than {MARGIN_MM} mm from the border", case.name)));
        }
        let mut judge = Judge { case, lit, horizon, convolver, judged, truth: Vec::new() };
        for elevation in ELEVATIONS {
            let count = if elevation < FRAC_PI_2 { AZIMUTHS } else { 1 };
            // The directions are not at the centres of the slices.
            let directions: Vec<[f64; 3]> =
                (0..count).map(|k| raised(elevation.sin(), TAU * (k as f64 + 0.3) / count as f64)).collect();
            let entered: Vec<Vec<f64>> =
                directions.iter().map(|d| irradiance(&judge.lit, &judge.horizon, *d, Visibility::Hard)).collect();
            let through = judge.through(&entered);
            judge.truth.push(directions.into_iter().zip(through).collect());
        }
        Ok(judge)
    }

    /// The light that leaves the judged texels.
    pub(super) fn through(&self, entered: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let all = self.convolver.run(&self.lit.thickness, entered);
        all.iter().map(|image| self.judged.iter().map(|&k| image[k]).collect()).collect()
    }

    /// Coefficients at the judged texels, one image a function.
    ///
    /// # Errors
    /// [`Error::Usage`] when the lights do not determine the basis.
    pub fn coefficients(&self, candidate: Candidate) -> Result<Vec<Vec<f64>>> {
        let projector =
            Projector::new(candidate.basis, &Lights::new(candidate.lights), candidate.weights).map_err(Error::Usage)?;
        Ok(self.through(&project(&self.lit, &self.horizon, &projector, Visibility::Hard)))
    }

    /// # Errors
    /// As [`Judge::coefficients`].
    pub fn judge(&self, candidate: Candidate) -> Result<Outcome> {
        let images = self.coefficients(candidate)?;
        let spread = |which: usize| {
            let weights: Vec<Vec<f64>> = self.truth[which]
                .iter()
                .map(|(d, _)| (0..images.len()).map(|i| candidate.basis.value(i, *d)).collect())
                .collect();
            let (weights, images) = (&weights, &images);
            let rec =
                move |m: usize, k: usize| weights[m].iter().zip(images).map(|(w, image)| w * image[k]).sum::<f64>();
            let pairs = self.truth[which]
                .iter()
                .enumerate()
                .flat_map(move |(m, (_, truth))| truth.iter().enumerate().map(move |(k, f)| [rec(m, k), *f]));
            Spread::of(ELEVATIONS[which], STEPS[which], pairs)
        };
        Ok(Outcome { case: self.case.name.clone(), candidate, spreads: [spread(0), spread(1), spread(2)] })
    }
}

#[cfg(test)]
mod tests {
    use super::super::rows::apart;
    use super::super::{FINE, PAPER_TISSUE, candidates, piece};
    use super::*;
    use mesophyll_fits::translucency::spread::BINS;
    use mesophyll_optics::side::Side;
    use mesophyll_optics::translucency::basis::{Basis, Weights};
    use mesophyll_optics::translucency::blade::Blade;
    use mesophyll_optics::translucency::lights::Rule;
    use mesophyll_synth::spec::Spec;

    fn elm() -> Spec {
        include_str!("../../../../../data/leaves/elm.toml").parse().unwrap()
    }

    /// Every basis that contains the cosine reproduces a flat uniform leaf exactly, whatever the tissue.
    #[test]
    fn a_flat_leaf_has_no_error() {
        let case = Case {
            name: "flat".into(),
            blade: Blade::flat(40, 36, 0.1, 0.2, 0.9),
            side: Side::Back,
            tissue: PAPER_TISSUE,
        };
        let judge = Judge::new(&case).unwrap();
        for candidate in candidates().into_iter().filter(|c| c.weights == Weights::Gram) {
            for s in judge.judge(candidate).unwrap().spreads {
                assert!(s.worst < 1e-9 && s.visible < 1e-9 && s.faint == 0.0, "{}: {}", candidate.name(), s.worst);
                assert!((s.histogram[BINS / 2] - 1.0).abs() < 1e-12);
            }
        }
    }

    /// On veins, more functions are more accurate, three functions of the bent light are more accurate than three of
    /// the straight one, and the paper's plain sums are less accurate than the Gram matrix.
    #[test]
    fn veins_need_more_than_a_vector() {
        let blade = piece(&elm(), 0.2, [2.0, 2.0], [9.0, 8.0]).unwrap();
        blade.validate().unwrap();
        let case = Case { name: "elm".into(), blade, side: Side::Front, tissue: PAPER_TISSUE };
        let judge = Judge::new(&case).unwrap();
        let visible = |basis: Basis, weights: Weights, lights: Rule| {
            let spreads = judge.judge(Candidate { basis, weights, lights }).unwrap().spreads;
            (spreads.iter().map(|s| s.visible.powi(2)).sum::<f64>() / 3.0).sqrt()
        };
        let straight = visible(Basis::HalfLife2, Weights::Gram, FINE);
        assert!(straight > 0.01, "there is relief: {straight}");
        assert!(visible(Basis::Bent { count: 3 }, Weights::Gram, FINE) < 0.8 * straight);
        assert!(visible(Basis::Hemispherical { bands: 3 }, Weights::Gram, FINE) < 0.8 * straight);
        // The same 128 directions with and without their Gram matrix; the mean level is compared.
        let mean = |weights: Weights| {
            let images =
                judge.coefficients(Candidate { basis: Basis::HalfLife2, weights, lights: Rule::default() }).unwrap();
            let fine = judge
                .coefficients(Candidate { basis: Basis::HalfLife2, weights: Weights::Gram, lights: FINE })
                .unwrap();
            apart(&images, &fine)
        };
        assert!(mean(Weights::Gram) < mean(Weights::Plain), "{} {}", mean(Weights::Gram), mean(Weights::Plain));
    }
}
