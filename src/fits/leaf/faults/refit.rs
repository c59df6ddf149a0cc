//! A texel fitted again, from a start of its own, to readings and a device that differ from those of the fit.

use super::sample::PassReadings;
use crate::gloss::{normal_of, normal_slopes};
use crate::leaf::held_out::{FramePredictor, PredictionScratch, TexelParameters};
use mesophyll_base::rgb::Rgb;
use mesophyll_optics::tube::Travel;
use nalgebra::{SMatrix, SVector};

/// Steps of a fit at most.
const STEPS: usize = 14;
/// Residuals' slopes: ρd and ρs a channel, ln m, two tilts.
pub const PARAMETERS: usize = 9;
type Vector = SVector<f64, PARAMETERS>;
type Matrix = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// Value and inverse standard deviation, by frame and channel.
pub type FrameReadings = Vec<[[f64; 2]; 3]>;

/// One pass as it is under a cause.
pub struct PassHypothesis<'a> {
    pub predictor: FramePredictor,
    pub travel: Travel,
    /// Passes that came before it.
    pub before: usize,
    /// Frames of those passes.
    pub first: usize,
    pub positions: Vec<f64>,
    pub readings: &'a PassReadings,
    pub used: &'a [bool],
}

/// Levenberg–Marquardt from `start`. Returns χ² and the texel.
pub fn descend(
    scratch: &mut PredictionScratch,
    start: TexelParameters,
    at: [f64; 2],
    passes: &[PassHypothesis],
    data: &[FrameReadings],
) -> (f64, TexelParameters) {
    let tilts = passes.len().min(2);
    let texel = |p: &Vector| TexelParameters {
        rho_d: Rgb::of(|c| p[c]),
        rho_s: Rgb::of(|c| p[3 + c]),
        m: p[6].exp(),
        normal: normal_of([p[7], p[8]]),
    };
    let n = start.normal;
    let mut p = Vector::from_column_slice(&[
        start.rho_d[0],
        start.rho_d[1],
        start.rho_d[2],
        start.rho_s[0],
        start.rho_s[1],
        start.rho_s[2],
        start.m.clamp(0.02, 1.0).ln(),
        n[0].atan2(n[2]),
        if tilts == 2 { n[1].clamp(-1.0, 1.0).asin() } else { 0.0 },
    ]);
    let mut damping = 1e-3;
    let mut here = sums(scratch, &p, &texel(&p), at, passes, data, tilts);
    for _ in 0..STEPS {
        let (chi2, normal, gradient) = &here;
        let mut damped = *normal;
        for i in 0..PARAMETERS {
            damped[(i, i)] = normal[(i, i)] * (1.0 + damping) + 1e-12;
        }
        let Some(step) = damped.cholesky().map(|c| c.solve(gradient)) else { break };
        let mut next = p + step;
        next[6] = next[6].clamp(0.01f64.ln(), 1.2f64.ln());
        (next[7], next[8]) = (next[7].clamp(-1.05, 1.05), next[8].clamp(-1.05, 1.05));
        let there = sums(scratch, &next, &texel(&next), at, passes, data, tilts);
        if there.0 < *chi2 {
            let small = chi2 - there.0 < (1e-3 * chi2).max(0.05);
            (p, here) = (next, there);
            damping = (damping * 0.2).max(1e-7);
            if small {
                break;
            }
        } else {
            damping *= 8.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    (here.0, texel(&p))
}

/// χ², the normal matrix and the (descending) gradient.
fn sums(
    scratch: &mut PredictionScratch,
    p: &Vector,
    texel: &TexelParameters,
    at: [f64; 2],
    passes: &[PassHypothesis],
    data: &[FrameReadings],
    tilts: usize,
) -> (f64, Matrix, Vector) {
    let (mut chi2, mut normal, mut gradient) = (0.0, Matrix::zeros(), Vector::zeros());
    let slopes = normal_slopes([p[7], p[8]]);
    for (pass, data) in passes.iter().zip(data) {
        let columns = pass.predictor.columns(scratch, texel, at, &slopes[..tilts]);
        for (k, channels) in data.iter().enumerate() {
            for (c, [y, weight]) in channels.iter().enumerate().filter(|(_, r)| r[1] > 0.0) {
                let (d, s) = (texel.rho_d[c], texel.rho_s[c]);
                let r = weight * (y - d * columns[0][k] - s * columns[1][k]);
                chi2 += r * r;
                let mut j = [0.0; 5];
                j[0] = weight * columns[0][k];
                j[1] = weight * columns[1][k];
                j[2] = weight * s * texel.m * columns[2][k];
                for t in 0..tilts {
                    j[3 + t] = weight * (d * columns[3 + 2 * t][k] + s * columns[4 + 2 * t][k]);
                }
                let index = [c, 3 + c, 6, 7, 8];
                for a in 0..5 {
                    gradient[index[a]] += j[a] * r;
                    for b in 0..5 {
                        normal[(index[a], index[b])] += j[a] * j[b];
                    }
                }
            }
        }
    }
    (chi2, normal, gradient)
}
