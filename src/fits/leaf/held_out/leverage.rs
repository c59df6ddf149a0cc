//! How far predictions of held-out readings are off because of errors in the fitted parameters: the mean of j (JᵀJ)⁻¹
//! jᵀ over held-out readings. J holds the weighted slopes of the fitted readings by the parameters, j those of the
//! held-out reading.

use super::{FramePredictor, FrameSplits, PredictionScratch, ScanRecord, TexelParameters};
use crate::gloss::normal_slopes;
use mesophyll_capture::manifest::TubeManifest;
use mesophyll_optics::tube::Travel;
use nalgebra::{SMatrix, SVector};

/// ρd and ρs a channel, m, two tilts.
const PARAMETERS: usize = 9;
type Slope = SVector<f64, PARAMETERS>;

/// How many texels the mean is taken over. On all texels the figure would be the same within a few percent.
const SAMPLE: usize = 400;

/// Expected mean square of held-out residuals in units of the noise: for each pass, one figure for each held-out frame.
/// `texels` holds the place (mm) and the fit of each texel.
pub fn expected(
    scan: &ScanRecord,
    manifest: &TubeManifest,
    splits: &FrameSplits,
    texels: &[([f64; 2], TexelParameters)],
) -> [Vec<f64>; 2] {
    let passes: Vec<(Travel, [FramePredictor; 2])> = manifest
        .passes
        .iter()
        .map(|pass| {
            let (positions, split) = (pass.positions(), splits.of(pass.name));
            let at = |list: &[usize]| list.iter().map(|k| positions[*k]).collect::<Vec<f64>>();
            (pass.name, [&split.kept, &split.held].map(|list| FramePredictor::new(scan, pass.name, &at(list))))
        })
        .collect();
    let mut sums = [&splits.x, &splits.y].map(|s| vec![0.0; s.held.len()]);
    let mut count = 0usize;
    let mut scratch = PredictionScratch::default();
    for (at, texel) in texels.iter().step_by(texels.len().div_ceil(SAMPLE).max(1)) {
        let mut normal = SMatrix::<f64, PARAMETERS, PARAMETERS>::zeros();
        for (_, [kept, _]) in &passes {
            for j in slopes(scan, kept, &mut scratch, texel, *at, passes.len()).iter().flatten() {
                normal.ger(1.0, j, j, 1.0);
            }
        }
        let Some(inverse) = pseudo_inverse(&normal) else { continue };
        for (travel, [_, held]) in &passes {
            let frames = slopes(scan, held, &mut scratch, texel, *at, passes.len());
            for (sum, channels) in sums[*travel as usize].iter_mut().zip(&frames) {
                *sum += channels.iter().map(|j| j.dot(&(inverse * j))).sum::<f64>() / 3.0;
            }
        }
        count += 1;
    }
    sums.map(|list| list.iter().map(|sum| 1.0 + sum / count.max(1) as f64).collect())
}

/// Standard errors that a texel's readings leave it: of ρd and ρs a channel each and of m, and of its normal's
/// components.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexelErrors {
    /// ρd (R, G, B), ρs (R, G, B), m; 0 for what no reading depends on.
    pub parameters: [f64; 7],
    /// Of the normal's x, y and z.
    pub normal: [f64; 3],
}

/// The standard errors that the noise of the frames of all `passes` leaves a texel at `at` (mm). `None` where they
/// determine nothing.
pub fn known_errors(
    scan: &ScanRecord,
    passes: &[FramePredictor],
    scratch: &mut PredictionScratch,
    texel: &TexelParameters,
    at: [f64; 2],
) -> Option<TexelErrors> {
    let mut normal = SMatrix::<f64, PARAMETERS, PARAMETERS>::zeros();
    for pass in passes {
        for j in slopes(scan, pass, scratch, texel, at, passes.len()).iter().flatten() {
            normal.ger(1.0, j, j, 1.0);
        }
    }
    let covariance = pseudo_inverse(&normal)?;
    let error = |k: usize| covariance[(k, k)].max(0.0).sqrt();
    let n = texel.normal;
    let turns = normal_slopes([n[0].atan2(n[2]), n[1].clamp(-1.0, 1.0).asin()]);
    let of_normal = |axis: usize| (turns[0][axis] * error(7)).hypot(turns[1][axis] * error(8));
    Some(TexelErrors { parameters: std::array::from_fn(error), normal: std::array::from_fn(of_normal) })
}

/// Slopes of every reading (frame by channel) by the parameters, divided by the reading's noise.
fn slopes(
    scan: &ScanRecord,
    pass: &FramePredictor,
    scratch: &mut PredictionScratch,
    texel: &TexelParameters,
    at: [f64; 2],
    tilts: usize,
) -> Vec<[Slope; 3]> {
    let n = texel.normal;
    let turns = normal_slopes([n[0].atan2(n[2]), n[1].clamp(-1.0, 1.0).asin()]);
    let columns = pass.columns(scratch, texel, at, &turns[..tilts.min(2)]);
    // Without any gloss neither ρs nor m is a parameter.
    let glossy = texel.rho_s.iter().any(|s| *s > 0.0);
    (0..pass.frames())
        .map(|k| {
            [0, 1, 2].map(|c: usize| {
                let (d, s) = (texel.rho_d[c], texel.rho_s[c]);
                let mut j = Slope::zeros();
                j[c] = columns[0][k];
                if glossy {
                    j[3 + c] = columns[1][k];
                    j[6] = s * columns[2][k];
                }
                for t in 0..tilts.min(2) {
                    j[7 + t] = d * columns[3 + 2 * t][k] + s * columns[4 + 2 * t][k];
                }
                j / scan.noise(d * columns[0][k] + s * columns[1][k])
            })
        })
        .collect()
}

/// Inverse on the directions that the readings determine. A parameter that no reading depends on contributes nothing.
fn pseudo_inverse(normal: &SMatrix<f64, PARAMETERS, PARAMETERS>) -> Option<SMatrix<f64, PARAMETERS, PARAMETERS>> {
    if !normal.iter().all(|v| v.is_finite()) {
        return None;
    }
    let scale = Slope::from_fn(|i, _| if normal[(i, i)] > 0.0 { normal[(i, i)].sqrt().recip() } else { 0.0 });
    let scaled = SMatrix::from_fn(|i, j| normal[(i, j)] * scale[i] * scale[j]);
    let eigen = nalgebra::SymmetricEigen::try_new(scaled, 1e-14, 1000)?;
    let inverted = Slope::from_fn(|i, _| if eigen.eigenvalues[i] > 1e-9 { eigen.eigenvalues[i].recip() } else { 0.0 });
    let inverse = eigen.eigenvectors * SMatrix::from_diagonal(&inverted) * eigen.eigenvectors.transpose();
    Some(SMatrix::from_fn(|i, j| inverse[(i, j)] * scale[i] * scale[j]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over the fitted readings the mean is parameters/readings whatever the design, because it is the trace of a
    /// projection.
    #[test]
    fn over_fitted_readings_the_mean_is_parameters_over_readings() {
        let scan = ScanRecord {
            camera_deg: 55.0,
            tube_height_mm: 100.0,
            tube_length_mm: 500.0,
            tube_radius_mm: 2.5,
            noise_relative: 0.01,
            noise_floor: 5e-4,
            ..ScanRecord::default()
        };
        let positions: Vec<f64> = (0..60).map(|k| -400.0 + 650.0 * f64::from(k) / 59.0).collect();
        let texel = TexelParameters {
            rho_d: [0.05, 0.1, 0.03].into(),
            rho_s: [0.04; 3].into(),
            m: 0.3,
            normal: [0.1, 0.0, 0.99f64.sqrt()],
        };
        let pass = FramePredictor::new(&scan, Travel::X, &positions);
        let rows: Vec<Slope> = slopes(&scan, &pass, &mut PredictionScratch::default(), &texel, [3.0, -2.0], 1)
            .into_iter()
            .flatten()
            .collect();
        let mut normal = SMatrix::<f64, PARAMETERS, PARAMETERS>::zeros();
        rows.iter().for_each(|j| normal.ger(1.0, j, j, 1.0));
        let inverse = pseudo_inverse(&normal).unwrap();
        let trace: f64 = rows.iter().map(|j| j.dot(&(inverse * j))).sum();
        // Six reflectances, m, one tilt.
        assert!((trace - 8.0).abs() < 1e-6, "{trace}");
    }
}
