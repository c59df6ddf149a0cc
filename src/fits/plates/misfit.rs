//! What the model leaves of leaves that it has not seen: a covariance over wavelength, of a long-range part (modes) and
//! a short-range part, which falls exponentially.

use super::leaf::PlateReading;
use mesophyll_base::solvers::decomposition::symmetric_eigen;
use mesophyll_base::statistics::median_of;
use nalgebra::DMatrix;

/// Modes that are kept.
pub const MODES: usize = 10;
/// A leaf that leaves more than this many times what half of them leave counts as if it left as much.
const WILD: f64 = 2.0;

/// The covariance of what the model leaves.
#[derive(Debug, Clone, PartialEq)]
pub struct PlateMisfit {
    /// For each mode and wavelength, what it adds to R and T: the covariance is the sum of their products.
    pub modes: Vec<Vec<[f64; 2]>>,
    /// Standard deviation of the short-range part of R and T at each wavelength.
    pub short: Vec<[f64; 2]>,
    /// Over this distance (nm) the short-range part falls by e.
    pub reach: f64,
}

/// Root mean square of what is left of a leaf.
pub(super) fn rms(left: &[[f64; 2]]) -> f64 {
    let (sum, count) =
        left.iter().flatten().filter(|r| !r.is_nan()).fold((0.0, 0usize), |(s, n), r| (s + r * r, n + 1));
    (sum / count.max(1) as f64).sqrt()
}

/// Estimates the covariance from what is left of each leaf at each wavelength.
pub(super) fn estimate(wavelengths: &[f64], left: &[Vec<[f64; 2]>]) -> PlateMisfit {
    let typical = median_of(left.iter().map(|l| rms(l))).unwrap_or(0.0);
    let (count, width) = (left.len(), 2 * wavelengths.len());
    let rows: Vec<Vec<f64>> = left
        .iter()
        .map(|l| {
            let tame = (WILD * typical / rms(l).max(f64::MIN_POSITIVE)).min(1.0);
            l.iter().flatten().map(|r| if r.is_nan() { 0.0 } else { tame * r }).collect()
        })
        .collect();
    let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let gram = DMatrix::from_fn(count, count, |i, j| product(&rows[i], &rows[j]) / count as f64);
    let mut modes: Vec<Vec<f64>> = Vec::new();
    if let Some(eigen) = symmetric_eigen(gram) {
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        // The last ones of few leaves are their noise.
        for k in order.into_iter().take(MODES.min(count / 4)) {
            let mode = |i: usize| (0..count).map(|l| rows[l][i] * eigen.eigenvectors[(l, k)]).sum::<f64>();
            modes.push((0..width).map(|i| mode(i) / (count as f64).sqrt()).collect());
        }
    }
    let spread = |i: usize| {
        let all = rows.iter().map(|r| r[i] * r[i]).sum::<f64>() / count.max(1) as f64;
        (all - modes.iter().map(|m| m[i] * m[i]).sum::<f64>()).max(0.0).sqrt()
    };
    // What is left beside the modes, and how alike it is at neighbouring wavelengths.
    let (mut near, mut same) = (0.0, 0.0);
    for row in &rows {
        let mut rest = row.clone();
        for mode in &modes {
            let along = product(row, mode) / product(mode, mode).max(f64::MIN_POSITIVE);
            rest.iter_mut().zip(mode).for_each(|(r, m)| *r -= along * m);
        }
        near += rest.iter().zip(&rest[2.min(width)..]).map(|(a, b)| a * b).sum::<f64>();
        same += product(&rest, &rest);
    }
    let alike = (near / same.max(f64::MIN_POSITIVE)).clamp(0.05, 0.98);
    let step = median_of(wavelengths.windows(2).map(|w| w[1] - w[0])).unwrap_or(1.0);
    let pairs = |of: &dyn Fn(usize) -> f64| (0..wavelengths.len()).map(|w| [of(2 * w), of(2 * w + 1)]).collect();
    PlateMisfit {
        modes: modes.iter().map(|m| pairs(&|i| m[i])).collect(),
        short: pairs(&spread),
        reach: -step / alike.ln(),
    }
}

/// The covariance at the readings of one leaf. What the model is off by is taken to be the same from both sides, so
/// that a second side adds nothing that is only a repetition.
pub(super) struct LeafMisfit<'a> {
    /// Wavelengths of all lights, ascending.
    pub wavelengths: &'a [f64],
    /// The misfit there.
    pub misfit: &'a PlateMisfit,
    /// The leaf's readings, in the order of their lights.
    pub readings: &'a [PlateReading],
    /// Standard error of a reading that has none of its own.
    pub noise: f64,
}

impl LeafMisfit<'_> {
    fn mode(&self, k: usize, r: &PlateReading) -> f64 {
        self.misfit.modes[k][r.light][usize::from(r.through)]
    }

    fn short(&self, r: &PlateReading) -> f64 {
        self.misfit.short[r.light][usize::from(r.through)]
    }

    fn noise(&self, r: &PlateReading) -> f64 {
        if r.err >= 0.0 { r.err } else { self.noise }
    }

    /// The variance of a reading: what the model leaves, and noise.
    fn variance(&self, r: &PlateReading) -> [f64; 2] {
        let long: f64 = (0..self.misfit.modes.len()).map(|k| self.mode(k, r).powi(2)).sum();
        [long + self.short(r).powi(2), self.noise(r).powi(2)]
    }

    /// The mean of what the model leaves in a reading's square, without noise.
    pub fn mean_square(&self) -> f64 {
        self.readings.iter().map(|r| self.variance(r)[0]).sum::<f64>() / self.readings.len().max(1) as f64
    }

    /// The standard error that each reading would have if all were independent and told as much together:
    /// tr Σ² / tr Σ is its square.
    pub fn weight(&self) -> f64 {
        let modes = self.misfit.modes.len();
        let mut squares = 0.0;
        for a in 0..modes {
            for b in 0..modes {
                squares += self.readings.iter().map(|r| self.mode(a, r) * self.mode(b, r)).sum::<f64>().powi(2);
            }
        }
        let mut trace = 0.0;
        for through in [false, true] {
            // The squares of the readings before, each fallen by its distance, and the same for each mode.
            let (mut before, mut last) = (0.0, f64::NAN);
            let mut along = vec![0.0; modes];
            for r in self.readings.iter().filter(|r| r.through == through) {
                let at = self.wavelengths[r.light];
                let fall = if last.is_nan() { 0.0 } else { (-(at - last) / self.misfit.reach).exp() };
                before *= fall * fall;
                for (k, along) in along.iter_mut().enumerate() {
                    let here = self.mode(k, r) * self.short(r);
                    *along *= fall;
                    squares += 4.0 * here * *along;
                    *along += here;
                }
                let (short, noise) = (self.short(r).powi(2), self.noise(r).powi(2));
                let long: f64 = (0..modes).map(|k| self.mode(k, r).powi(2)).sum();
                squares += (short + noise) * (2.0 * long + short + noise) + 2.0 * short * before;
                trace += long + short + noise;
                before += short;
                last = at;
            }
        }
        if trace > 0.0 { (squares / trace).sqrt() } else { 1e-3 }
    }

    /// Jᵀ Σ J for the derivatives of the readings. What the model leaves counts `scale` times.
    pub fn between<const N: usize>(&self, jacobian: &[[f64; N]], scale: f64) -> DMatrix<f64> {
        let mut sum = DMatrix::zeros(N, N);
        for k in 0..self.misfit.modes.len() {
            let mut along = [0.0; N];
            for (r, by) in self.readings.iter().zip(jacobian) {
                let mode = self.mode(k, r);
                along.iter_mut().zip(by).for_each(|(a, by)| *a += mode * by);
            }
            add(&mut sum, &along, &along, scale);
        }
        for through in [false, true] {
            let (mut before, mut last) = ([0.0; N], f64::NAN);
            for (r, by) in self.readings.iter().zip(jacobian).filter(|(r, _)| r.through == through) {
                let at = self.wavelengths[r.light];
                let fall = if last.is_nan() { 0.0 } else { (-(at - last) / self.misfit.reach).exp() };
                before.iter_mut().for_each(|b| *b *= fall);
                let short = by.map(|b| b * self.short(r));
                add(&mut sum, &short, &short, scale);
                add(&mut sum, &short, &before, scale);
                add(&mut sum, &before, &short, scale);
                add(&mut sum, by, by, self.noise(r).powi(2));
                before.iter_mut().zip(short).for_each(|(b, s)| *b += s);
                last = at;
            }
        }
        sum
    }
}

fn add<const N: usize>(sum: &mut DMatrix<f64>, a: &[f64; N], b: &[f64; N], scale: f64) {
    for i in 0..N {
        for j in 0..N {
            sum[(i, j)] += scale * a[i] * b[j];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::FREE;
    use super::*;

    /// The sums that go along the wavelengths are those of the whole matrix.
    #[test]
    fn sums_along_the_wavelengths_are_those_of_the_whole_covariance() {
        let wavelengths = [400.0, 410.0, 430.0, 500.0];
        let wave = |k: usize| (0..4).map(|w| [0.01 * ((k + w) as f64).sin(), 0.02 * ((k * w) as f64).cos()]).collect();
        let misfit = PlateMisfit {
            modes: vec![wave(1), wave(3)],
            short: vec![[0.01, 0.02], [0.03, 0.01], [0.02, 0.02], [0.01, 0.03]],
            reach: 25.0,
        };
        let reading =
            |light: usize, through: bool, err: f64| PlateReading { light, below: false, through, value: 0.0, err };
        let readings = [
            reading(0, false, f64::NAN),
            reading(0, true, 0.02),
            reading(1, true, f64::NAN),
            reading(2, false, f64::NAN),
            reading(3, false, f64::NAN),
            reading(3, true, f64::NAN),
        ];
        let leaf = LeafMisfit { wavelengths: &wavelengths, misfit: &misfit, readings: &readings, noise: 0.005 };
        let whole = DMatrix::from_fn(6, 6, |i, j| {
            let (a, b) = (&readings[i], &readings[j]);
            let long: f64 = (0..2).map(|k| leaf.mode(k, a) * leaf.mode(k, b)).sum();
            let far = (wavelengths[a.light] - wavelengths[b.light]).abs();
            let short = if a.through == b.through { leaf.short(a) * leaf.short(b) * (-far / 25.0).exp() } else { 0.0 };
            3.0 * (long + short) + if i == j { leaf.noise(a).powi(2) } else { 0.0 }
        });
        let jacobian: Vec<[f64; FREE]> = (0..6).map(|i| std::array::from_fn(|j| ((i * 7 + j) as f64).sin())).collect();
        let j = DMatrix::from_fn(6, FREE, |i, k| jacobian[i][k]);
        let want = j.transpose() * &whole * &j;
        assert!((leaf.between(&jacobian, 3.0) - want).amax() < 1e-12);
        let once = LeafMisfit { misfit: &misfit, ..leaf };
        let plain = DMatrix::from_fn(6, 6, |i, j| {
            let noise = if i == j { once.noise(&readings[i]).powi(2) } else { 0.0 };
            (whole[(i, j)] - noise) / 3.0 + noise
        });
        let want = ((&plain * &plain).trace() / plain.trace()).sqrt();
        assert!((once.weight() - want).abs() < 1e-12, "{} {want}", once.weight());
    }
}
