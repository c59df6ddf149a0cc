//! One lit side of a piece of leaf under the full convolution, and its reconstruction by a basis.

use super::{BasisCandidate, BasisCase};
use crate::{Error, Result};
use mesophyll_fits::translucency::spread::{ELEVATIONS, STEPS, TranslucencySpread};
use mesophyll_optics::translucency::basis::Projector;
use mesophyll_optics::translucency::blade::LitSide;
use mesophyll_optics::translucency::convolution::{ConvolutionSettings, Convolver};
use mesophyll_optics::translucency::horizon::Horizon;
use mesophyll_optics::translucency::irradiance::{Visibility, irradiance, project};
use mesophyll_optics::translucency::lights::{DirectionSet, raised};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Number of azimuths at each elevation but the first.
const AZIMUTHS: usize = 8;
/// Texels this close to the border of the piece are not judged (mm).
const MARGIN_MM: f64 = 1.5;

/// One candidate on one case.
#[derive(Debug, Clone, PartialEq)]
pub struct BasisOutcome {
    /// Name of the leaf and of the lit side.
    pub case: String,
    /// What was judged.
    pub candidate: BasisCandidate,
    /// Its errors at each of the three elevations.
    pub spreads: [TranslucencySpread; 3],
}

impl BasisOutcome {
    /// Mean of the mean absolute error over the three elevations. The paper's "average reconstruction error" is 3 %.
    pub fn mean(&self) -> f64 {
        self.spreads.iter().map(|s| s.mean).sum::<f64>() / 3.0
    }
}

/// A lit side with its horizons, its kernels, and the truth in the directions that are judged.
pub struct BasisJudge<'a> {
    pub(super) case: &'a BasisCase,
    pub(super) lit: LitSide<'a>,
    pub(super) horizon: Horizon,
    convolver: Convolver,
    /// Indices of the texels that count.
    judged: Vec<usize>,
    /// The directions of each elevation, and the light that comes through at the judged texels.
    pub(super) truth: Vec<Vec<([f64; 3], Vec<f64>)>>,
}

impl<'a> BasisJudge<'a> {
    /// # Errors
    /// [`Error::Usage`] for a tissue or thicknesses out of range; [`Error::Missed`] for a blade without judged texels.
    pub fn new(case: &'a BasisCase) -> Result<BasisJudge<'a>> {
        let lit = case.blade.lit(case.side);
        let horizon = Horizon::new(&lit);
        let [thin, thick] = case
            .blade
            .thickness_range()
            .ok_or_else(|| Error::Missed(format!("{}: no texel on the leaf", case.name)))?;
        let convolver =
            Convolver::with(&ConvolutionSettings::new(case.tissue, lit.texel_mm), lit.width, lit.height, thin, thick)?;
        let margin = (MARGIN_MM / lit.texel_mm).ceil() as usize;
        let inner = |k: usize| {
            let (i, j) = (k % lit.width, k / lit.width);
            i >= margin && j >= margin && i + margin < lit.width && j + margin < lit.height
        };
        let judged: Vec<usize> = (0..lit.mask.len()).filter(|&k| lit.mask[k] && inner(k)).collect();
        if judged.is_empty() {
            return Err(Error::Missed(format!("{}: no texel farther than {MARGIN_MM} mm from the border", case.name)));
        }
        let mut judge = BasisJudge { case, lit, horizon, convolver, judged, truth: Vec::new() };
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
    pub fn coefficients(&self, candidate: BasisCandidate) -> Result<Vec<Vec<f64>>> {
        let projector = Projector::new(candidate.basis, &DirectionSet::new(candidate.lights), candidate.weights)
            .map_err(Error::Usage)?;
        Ok(self.through(&project(&self.lit, &self.horizon, &projector, Visibility::Hard)))
    }

    /// # Errors
    /// As [`BasisJudge::coefficients`].
    pub fn judge(&self, candidate: BasisCandidate) -> Result<BasisOutcome> {
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
            TranslucencySpread::of(ELEVATIONS[which], STEPS[which], pairs)
        };
        Ok(BasisOutcome { case: self.case.name.clone(), candidate, spreads: [spread(0), spread(1), spread(2)] })
    }
}

#[cfg(test)]
mod tests {
    use super::super::rows::apart;
    use super::super::{FINE, PAPER_TISSUE, candidates, piece};
    use super::*;
    use mesophyll_fits::translucency::spread::BINS;
    use mesophyll_optics::side::Side;
    use mesophyll_optics::translucency::basis::{HemisphereBasis, SampleWeights};
    use mesophyll_optics::translucency::blade::BladeMaps;
    use mesophyll_optics::translucency::lights::DirectionRule;
    use mesophyll_synth::spec::LeafSpec;

    fn elm() -> LeafSpec {
        include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/data/leaves/elm.toml")).parse().unwrap()
    }

    /// Every basis that contains the cosine reproduces a flat uniform leaf exactly, whatever the tissue.
    #[test]
    fn a_flat_leaf_has_no_error() {
        let case = BasisCase {
            name: "flat".into(),
            blade: BladeMaps::flat(40, 36, 0.1, 0.2, 0.9),
            side: Side::Back,
            tissue: PAPER_TISSUE,
        };
        let judge = BasisJudge::new(&case).unwrap();
        for candidate in candidates().into_iter().filter(|c| c.weights == SampleWeights::Gram) {
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
        let case = BasisCase { name: "elm".into(), blade, side: Side::Front, tissue: PAPER_TISSUE };
        let judge = BasisJudge::new(&case).unwrap();
        let visible = |basis: HemisphereBasis, weights: SampleWeights, lights: DirectionRule| {
            let spreads = judge.judge(BasisCandidate { basis, weights, lights }).unwrap().spreads;
            (spreads.iter().map(|s| s.visible.powi(2)).sum::<f64>() / 3.0).sqrt()
        };
        let straight = visible(HemisphereBasis::HalfLife2, SampleWeights::Gram, FINE);
        assert!(straight > 0.01, "there is relief: {straight}");
        assert!(visible(HemisphereBasis::Bent { count: 3 }, SampleWeights::Gram, FINE) < 0.8 * straight);
        assert!(visible(HemisphereBasis::Hemispherical { bands: 3 }, SampleWeights::Gram, FINE) < 0.8 * straight);
        // The same 128 directions with and without their Gram matrix; the mean level is compared.
        let mean = |weights: SampleWeights| {
            let images = judge
                .coefficients(BasisCandidate {
                    basis: HemisphereBasis::HalfLife2,
                    weights,
                    lights: DirectionRule::default(),
                })
                .unwrap();
            let fine = judge
                .coefficients(BasisCandidate {
                    basis: HemisphereBasis::HalfLife2,
                    weights: SampleWeights::Gram,
                    lights: FINE,
                })
                .unwrap();
            apart(&images, &fine)
        };
        assert!(
            mean(SampleWeights::Gram) < mean(SampleWeights::Plain),
            "{} {}",
            mean(SampleWeights::Gram),
            mean(SampleWeights::Plain)
        );
    }
}
