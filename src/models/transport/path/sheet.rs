//! Means over paths from many places, with their derivatives and variances: pictures, and lists of reflectance factors.

use super::{PathSampler, estimate};
use crate::Result;
use mesophyll_files::progress;
use rayon::prelude::*;

/// Pictures of radiance and of its derivatives. A place is a pixel or a direction.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DerivativePicture {
    /// Numbers of a place: three channels, or as many as there are bands.
    pub channels: usize,
    /// How many numbers it is differentiated by.
    pub parameters: usize,
    /// Mean radiance (or reflectance factors), all channels of a place together.
    pub mean: Vec<f64>,
    /// The variance of that mean.
    pub variance: Vec<f64>,
    /// Derivatives: place by place, parameter by parameter, channel by channel.
    pub slopes: Vec<f64>,
}

impl DerivativePicture {
    /// The derivative at a place by a parameter.
    pub fn slope(&self, place: usize, parameter: usize, channel: usize) -> f64 {
        self.slopes[(place * self.parameters + parameter) * self.channels + channel]
    }

    /// Multiplies each channel by a number.
    pub(super) fn scale(&mut self, by: &[f64]) {
        let channels = self.channels;
        let each = |list: &mut [f64], power: i32| {
            list.chunks_exact_mut(channels)
                .for_each(|of| of.iter_mut().zip(by).for_each(|(v, by)| *v *= by.powi(power)));
        };
        each(&mut self.mean, 1);
        each(&mut self.slopes, 1);
        each(&mut self.variance, 2);
    }
}

/// Means over rounds of `each` paths from each of `places` places, of `channels` numbers and their derivatives by
/// `parameters` others. `follow` is given a place and the numbers of a path, and writes what the path brings: the
/// radiance first, and then its derivatives, parameter by parameter.
///
/// # Errors
/// A stop that was asked for.
pub(super) fn sheet(
    places: usize,
    [channels, parameters]: [usize; 2],
    [rounds, each]: [u32; 2],
    seed: u64,
    follow: impl Fn(usize, &mut PathSampler, &mut [f64]) + Sync,
) -> Result<DerivativePicture> {
    let all = channels * (1 + parameters);
    let of = |place: usize| {
        let (mut means, mut sums, mut brought) = (Vec::with_capacity(rounds as usize), vec![0.0; all], vec![0.0; all]);
        if progress::stop_requested() {
            return (vec![0.0; channels], vec![0.0; channels], sums);
        }
        for round in 0..rounds {
            let seed = super::picture::pixel_seed(seed, place, round);
            let mut mean = vec![0.0; channels];
            for path in 0..each {
                let mut samples = PathSampler::new(seed, path);
                follow(place, &mut samples, &mut brought);
                mean.iter_mut().zip(&brought).for_each(|(mean, v)| *mean += v / f64::from(each));
                let share = 1.0 / f64::from(each * rounds);
                let slopes = sums[channels..].iter_mut().zip(&brought[channels..]);
                slopes.for_each(|(sum, v)| *sum += v * share);
            }
            means.push(mean);
        }
        let (mean, variance) = estimate::spread(&means, channels);
        (mean, variance, sums)
    };
    let found: Vec<_> = (0..places).into_par_iter().map(of).collect();
    progress::go_on()?;
    let mut out = DerivativePicture { channels, parameters, ..DerivativePicture::default() };
    out.slopes.reserve(places * channels * parameters);
    for (mean, variance, sums) in found {
        out.mean.extend(mean);
        out.variance.extend(variance);
        out.slopes.extend_from_slice(&sums[channels..]);
    }
    Ok(out)
}
