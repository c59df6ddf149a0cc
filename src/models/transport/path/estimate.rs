//! Means over paths, with standard errors from independent randomisations.

use super::SIDE_BY_SIDE;
use super::samples::{MOST_PATHS, PathSampler};
use crate::seeds::scramble;
use mesophyll_files::progress;
use rayon::prelude::*;

/// A number and its standard error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Mean over the randomisations.
    pub mean: f64,
    /// Standard error of the mean.
    pub error: f64,
}

/// The least and the largest number of randomisations, and the number of paths for one more. With few randomisations
/// the stated error is itself uncertain: by 13 % with 32, by 3 % with 512.
const ROUNDS: [u32; 2] = [32, 512];
const PATHS_A_ROUND: u32 = 256;

/// Means of the numbers that `follow` returns for each of a few paths, over `paths` paths. It ends early when a stop is
/// requested.
pub(super) fn estimate<const N: usize>(
    seed: u64,
    paths: u32,
    follow: impl Fn(&mut [PathSampler]) -> Vec<[f64; N]> + Sync,
) -> [Estimate; N] {
    let all = estimate_all(seed, paths, N, |samples, add| follow(samples).iter().for_each(|found| add(found)));
    std::array::from_fn(|q| all[q])
}

/// The same for `count` numbers. `follow` adds those of each of a few paths.
pub(super) fn estimate_all(
    seed: u64,
    paths: u32,
    count: usize,
    follow: impl Fn(&mut [PathSampler], &mut dyn FnMut(&[f64])) + Sync,
) -> Vec<Estimate> {
    let rounds = (paths / PATHS_A_ROUND).clamp(ROUNDS[0], ROUNDS[1]).max(paths.div_ceil(MOST_PATHS));
    let each = paths.div_ceil(rounds);
    let means: Vec<Vec<f64>> = (0..rounds)
        .into_par_iter()
        .map(|round| {
            let mut sum = vec![0.0; count];
            let begin = |k: u32| PathSampler::new(scramble(seed, u64::from(round)), k);
            let firsts = (0..each).step_by(SIDE_BY_SIDE as usize);
            for first in firsts.take_while(|_| !progress::stop_requested()) {
                let mut samples: Vec<PathSampler> = (first..each.min(first + SIDE_BY_SIDE)).map(begin).collect();
                follow(&mut samples, &mut |found| {
                    sum.iter_mut().zip(found).for_each(|(sum, v)| *sum += v / f64::from(each));
                });
            }
            sum
        })
        .collect();
    let n = f64::from(rounds);
    let of = |q: usize| {
        let mean = means.iter().map(|m| m[q]).sum::<f64>() / n;
        let spread = means.iter().map(|m| (m[q] - mean).powi(2)).sum::<f64>() / (n - 1.0);
        Estimate { mean, error: (spread / n).sqrt() }
    };
    (0..count).map(of).collect()
}

/// The mean of independent means of `count` numbers each, and the variance of that mean; infinite for a single one.
pub(super) fn spread(means: &[Vec<f64>], count: usize) -> (Vec<f64>, Vec<f64>) {
    let n = means.len() as f64;
    let mean: Vec<f64> = (0..count).map(|c| means.iter().map(|m| m[c]).sum::<f64>() / n).collect();
    let variance = (0..count).map(|c| match means.len() {
        0 | 1 => f64::INFINITY,
        _ => means.iter().map(|m| (m[c] - mean[c]).powi(2)).sum::<f64>() / (n - 1.0) / n,
    });
    let variance = variance.collect();
    (mean, variance)
}
