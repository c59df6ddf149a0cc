//! How the errors of the blade's thickness map affect a fit of the tissue.
//!
//! The fit takes each texel's thickness from the leaf fit's map as if it were exact. Where the map is wrong, the
//! photographs differ from the model by more than their noise, in the same way in all photographs and channels, and the
//! best-fitting tissue changes. Let H be the Gauss–Newton matrix JᵀWJ, G the change of the photographs with the
//! thicknesses and S the covariance of the map's errors. Then the covariance of the logarithms that are searched for is
//!
//!   H⁻¹ (H + JᵀW G S GᵀW J) H⁻¹.
//!
//! It contains the noise of the readings, and the map's errors carried through the same search. Thickness enters light
//! exponentially, so errors that cancel on average still shift the result. This shift is of second order in the errors.
//! It is found by adding the same amount of error again and watching the gradient, and its square is added to the
//! covariance.

use super::TissueMeasurement;
use super::model::{TissueFitModel, TissueScore};
use crate::translucency::Result;
use mesophyll_base::random::RandomStream;
use mesophyll_capture::dome::smoothing::{SmoothingKernel, pass};
use mesophyll_optics::side::mirror;
use nalgebra::{DMatrix, DVector};

/// What the leaf fit states about the errors of its thickness maps.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ThicknessErrors {
    /// Standard errors (mm), one map for each of [`TissueMeasurement::thickness`], in the same columns. No maps mean
    /// that the thickness is exact.
    pub each: Vec<Vec<f64>>,
    /// Standard deviation (texels) of the Gaussian that the maps were smoothed with; within it, neighbours have similar
    /// errors. 0: every texel's error is independent.
    pub smoothed: f64,
    /// Whether the maps of the two sides are one map, seen from either side.
    pub one_map: bool,
    /// Relative standard error that all texels share (the caliper's). Fits of the scale do not depend on it.
    pub shared: f64,
}

/// The effect of the maps' errors, at fixed weights.
#[derive(Debug, Clone)]
pub struct ThicknessSpread {
    /// JᵀW G S GᵀW J.
    pub scatter: DMatrix<f64>,
    /// Mean gradient of the cost that the errors cause at the true tissue.
    pub shift: DVector<f64>,
    /// χ² that the errors add to that of the noise.
    pub chi2: f64,
}

/// Number of draws for χ² and the shift; each is used with both signs. Their scatter also falls with the number of
/// texels.
const DRAWS: u64 = 2;

/// No texel becomes thinner than this share of its thickness.
const THINNEST: f64 = 0.1;

impl ThicknessErrors {
    fn kernel(&self) -> SmoothingKernel {
        SmoothingKernel::gaussian(self.smoothed)
    }

    /// One draw of the maps' errors (mm).
    pub fn draw(&self, width: usize, seed: u64) -> Vec<Vec<f64>> {
        let kernel = self.kernel();
        let white = |map: usize, texels: usize| -> Vec<f64> {
            let mut stream = RandomStream::new(seed, &[31, map as u64]);
            let pairs: Vec<[f64; 2]> = (0..texels.div_ceil(2)).map(|_| stream.normal_pair()).collect();
            pairs.into_iter().flatten().take(texels).collect()
        };
        let one = |(map, err): (usize, &Vec<f64>)| -> Vec<f64> {
            let own = pass(&white(if self.one_map { 0 } else { map }, err.len()), width, &kernel);
            let own = if self.one_map && map > 0 { mirror(&own, width) } else { own };
            own.iter().zip(err).map(|(n, e)| n * e / kernel.noise()).collect()
        };
        self.each.iter().enumerate().map(one).collect()
    }
}

impl TissueMeasurement {
    /// The same photographs on maps whose thickness is changed by `by` (mm) times `sign`.
    pub fn moved(&self, by: &[Vec<f64>], sign: f64) -> TissueMeasurement {
        let mut moved = self.clone();
        for (map, by) in moved.thickness.iter_mut().zip(by) {
            map.iter_mut().zip(by).for_each(|(d, by)| *d = (*d + sign * by).max(THINNEST * *d));
        }
        moved
    }
}

/// The effect of the stated errors of the thickness maps at the end `p` of a search.
///
/// # Errors
/// As [`TissueFitModel::images`].
pub fn spread(model: &TissueFitModel, p: &[f64]) -> Result<ThicknessSpread> {
    let (n, errors) = (p.len(), &model.measured.thickness_errors);
    let mut out = ThicknessSpread { scatter: DMatrix::zeros(n, n), shift: DVector::zeros(n), chi2: 0.0 };
    let shared = if model.scale_is_fixed() { errors.shared } else { 0.0 };
    if shared == 0.0 && errors.each.iter().flatten().all(|e| *e == 0.0) {
        return Ok(out);
    }
    let pulls = model.pulls(p)?;
    let common: DVector<f64> =
        DVector::from_iterator(n, pulls.iter().map(|maps| maps.iter().flatten().sum::<f64>() * shared));
    out.scatter += &common * common.transpose();
    if errors.each.is_empty() {
        return Ok(out);
    }
    scatter(model.measured, &pulls, &mut out.scatter);
    let score = |model: &TissueFitModel| -> Result<(Vec<f64>, DVector<f64>)> {
        let TissueScore { residuals, gradient } = model.score(p)?;
        Ok((residuals.into_iter().flatten().flatten().collect(), DVector::from_vec(gradient)))
    };
    let (_, here) = score(model)?;
    for seed in 0..DRAWS {
        let by = errors.draw(model.measured.width, seed);
        let [plus, minus] = [1.0, -1.0].map(|sign| score(&model.on(&model.measured.moved(&by, sign), p)?));
        let ((plus, above), (minus, below)) = (plus?, minus?);
        let apart = plus.iter().zip(&minus).map(|(a, b)| (0.5 * (a - b)).powi(2)).sum::<f64>();
        out.chi2 += apart / DRAWS as f64;
        out.shift += (0.5 * (above + below) - &here) / DRAWS as f64;
    }
    Ok(out)
}

/// Adds JᵀW G S GᵀW J. `pulls` is the result of [`TissueFitModel::pulls`].
fn scatter(measured: &TissueMeasurement, pulls: &[Vec<Vec<f64>>], into: &mut DMatrix<f64>) {
    let errors = &measured.thickness_errors;
    let kernel = errors.kernel();
    // For each parameter: the effect of each independent draw behind the maps' errors.
    let rows: Vec<Vec<f64>> = pulls
        .iter()
        .map(|maps| {
            let relative = |((pull, d), e): ((&f64, &f64), &f64)| if *d > 0.0 { pull * e / d } else { 0.0 };
            let one = |(map, pull): (usize, &Vec<f64>)| -> Vec<f64> {
                let own: Vec<f64> =
                    pull.iter().zip(&measured.thickness[map]).zip(&errors.each[map]).map(relative).collect();
                let mut own = pass(&own, measured.width, &kernel);
                own.iter_mut().for_each(|v| *v /= kernel.noise());
                if errors.one_map && map > 0 { mirror(&own, measured.width) } else { own }
            };
            let each = maps.iter().enumerate().map(one);
            if !errors.one_map {
                return each.flatten().collect();
            }
            let add = |a: Vec<f64>, b: Vec<f64>| a.iter().zip(&b).map(|(a, b)| a + b).collect();
            each.reduce(add).unwrap_or_default()
        })
        .collect();
    for i in 0..rows.len() {
        for j in 0..rows.len() {
            into[(i, j)] += rows[i].iter().zip(&rows[j]).map(|(a, b)| a * b).sum::<f64>();
        }
    }
}
