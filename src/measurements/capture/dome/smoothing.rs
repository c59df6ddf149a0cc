//! Gaussian smoothing of maps with holes, and what it does to noise. Widths in texels.
//!
//! A map is smoothed by normalised convolution (Knutsson & Westin 1993). Texels of weight 0 contribute nothing and are
//! filled in from their neighbours, so that neither the outline nor a hole distorts the values beside it.

use rayon::prelude::*;

/// A symmetric kernel of unit sum: its centre and its right half.
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothingKernel(Vec<f64>);

impl SmoothingKernel {
    /// A Gaussian of standard deviation `sigma` texels, cut at 4.5 σ; 0 leaves a map as it is.
    pub fn gaussian(sigma: f64) -> SmoothingKernel {
        if sigma <= 0.0 {
            return SmoothingKernel(vec![1.0]);
        }
        let reach = (4.5 * sigma).ceil() as usize;
        let half: Vec<f64> = (0..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
        let sum = half[0] + 2.0 * half[1..].iter().sum::<f64>();
        SmoothingKernel(half.into_iter().map(|v| v / sum).collect())
    }

    fn full(&self) -> Vec<f64> {
        self.0.iter().skip(1).rev().chain(&self.0).copied().collect()
    }

    /// The kernel of one smoothing after another.
    pub fn then(&self, other: &SmoothingKernel) -> SmoothingKernel {
        let both = convolve(&self.full(), &other.full());
        SmoothingKernel(both[both.len() / 2..].to_vec())
    }

    /// Second moment (texels²).
    pub fn variance(&self) -> f64 {
        2.0 * self.0.iter().enumerate().map(|(k, v)| (k * k) as f64 * v).sum::<f64>()
    }

    /// Standard deviation of white noise of unit deviation after this kernel in both directions.
    pub fn noise(&self) -> f64 {
        squares(&self.full())
    }

    /// Standard deviation of the slope (per texel, central differences) that such noise causes along one direction.
    pub fn slope_noise(&self) -> f64 {
        let difference = convolve(&self.full(), &[0.5, 0.0, -0.5]);
        (squares(&difference) * squares(&self.full())).sqrt()
    }

    /// Covariance, at one place, of white noise of unit deviation after this kernel and after another.
    pub fn covariance(&self, other: &SmoothingKernel) -> f64 {
        product(&self.full(), &other.full()).powi(2)
    }

    /// The same of their slopes.
    pub(crate) fn slope_covariance(&self, other: &SmoothingKernel) -> f64 {
        let slope = |k: &SmoothingKernel| convolve(&k.full(), &[0.5, 0.0, -0.5]);
        product(&slope(self), &slope(other)) * product(&self.full(), &other.full())
    }

    /// The noise that the estimate of `noise.rs` finds after this kernel, relative to its true deviation. It is less
    /// than 1, because smoothed noise looks like relief.
    pub(crate) fn laplacian_noise(&self) -> f64 {
        squares(&convolve(&self.full(), &[1.0, -2.0, 1.0])) / 6.0 / self.noise()
    }
}

fn squares(kernel: &[f64]) -> f64 {
    kernel.iter().map(|v| v * v).sum()
}

/// Σ a b of two kernels of odd length about one centre.
fn product(a: &[f64], b: &[f64]) -> f64 {
    let (long, short) = if a.len() >= b.len() { (a, b) } else { (b, a) };
    long[(long.len() - short.len()) / 2..].iter().zip(short).map(|(x, y)| x * y).sum()
}

fn convolve(a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; a.len() + b.len() - 1];
    for (i, x) in a.iter().enumerate() {
        for (j, y) in b.iter().enumerate() {
            out[i + j] += x * y;
        }
    }
    out
}

/// Smooths `values` (row-major, `width` a row) where `weight` is above 0; NaN where the kernel meets no weight. Values
/// of weight 0 are never read.
pub fn smooth(values: &[f64], weight: &[f64], width: usize, kernel: &SmoothingKernel) -> Vec<f64> {
    let product: Vec<f64> = values.iter().zip(weight).map(|(v, w)| if *w > 0.0 { v * w } else { 0.0 }).collect();
    let (top, bottom) = (pass(&product, width, kernel), pass(weight, width, kernel));
    top.into_iter().zip(bottom).map(|(t, b)| if b > 1e-9 { t / b } else { f64::NAN }).collect()
}

/// Plain convolution in both directions, zero beyond the image.
pub fn pass(values: &[f64], width: usize, kernel: &SmoothingKernel) -> Vec<f64> {
    let height = values.len() / width.max(1);
    let full = kernel.full();
    let reach = full.len() / 2;
    if reach == 0 {
        return values.to_vec();
    }
    let mut rows = vec![0.0; values.len()];
    rows.par_chunks_mut(width).zip(values.par_chunks(width)).for_each(|(out, row)| {
        for (i, o) in out.iter_mut().enumerate() {
            let (a, b) = (i.saturating_sub(reach), (i + reach + 1).min(width));
            *o = row[a..b].iter().zip(&full[a + reach - i..]).map(|(v, k)| v * k).sum();
        }
    });
    let mut out = vec![0.0; values.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(j, out)| {
        for y in j.saturating_sub(reach)..(j + reach + 1).min(height) {
            let k = full[y + reach - j];
            out.iter_mut().zip(&rows[y * width..(y + 1) * width]).for_each(|(o, v)| *o += k * v);
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_base::random::RandomStream;

    #[test]
    fn a_plane_stays_a_plane_inside_and_holes_are_filled() {
        let (w, h) = (40, 30);
        let plane: Vec<f64> = (0..w * h).map(|k| 2.0 + 0.3 * (k % w) as f64 - 0.1 * (k / w) as f64).collect();
        let kernel = SmoothingKernel::gaussian(1.5);
        let mut weight = vec![1.0; w * h];
        let flat = smooth(&plane, &weight, w, &kernel);
        for j in 8..22 {
            for i in 8..32 {
                assert!((flat[j * w + i] - plane[j * w + i]).abs() < 1e-12);
            }
        }
        weight[15 * w + 20] = 0.0;
        let mut broken = plane.clone();
        broken[15 * w + 20] = f64::NAN;
        let filled = smooth(&broken, &weight, w, &kernel);
        assert!(
            (filled[15 * w + 20] - plane[15 * w + 20]).abs() < 1e-9,
            "the hole is symmetric, so the plane goes through it"
        );
    }

    /// Compares the stated noise with noise that is drawn, smoothed and measured.
    #[test]
    fn the_noise_left_is_the_noise_stated() {
        let (w, h) = (256, 256);
        let white: Vec<f64> = (0..w * h / 2).flat_map(|k| RandomStream::new(5, &[k as u64]).normal_pair()).collect();
        for sigma in [0.5, 1.0, 2.0] {
            let kernel = SmoothingKernel::gaussian(sigma);
            let left = smooth(&white, &vec![1.0; w * h], w, &kernel);
            let inner = || (16..h - 16).flat_map(|j| (16..w - 16).map(move |i| j * w + i));
            let n = inner().count() as f64;
            let sd = (inner().map(|k| left[k].powi(2)).sum::<f64>() / n).sqrt();
            let slope = (inner().map(|k| (0.5 * (left[k + 1] - left[k - 1])).powi(2)).sum::<f64>() / n).sqrt();
            // The number of independent values is about one in 4πσ² texels.
            let spread = (4.0 * std::f64::consts::PI * sigma * sigma / n).sqrt().max(1.0 / n.sqrt());
            assert!((sd / kernel.noise() - 1.0).abs() < 4.0 * spread, "{sigma}: {sd} {}", kernel.noise());
            assert!(
                (slope / kernel.slope_noise() - 1.0).abs() < 4.0 * spread,
                "{sigma}: {slope} {}",
                kernel.slope_noise()
            );
        }
        // Two smoothings, one after the other, add their squares, nearly.
        let both = SmoothingKernel::gaussian(3.0).then(&SmoothingKernel::gaussian(4.0));
        assert!((both.noise() / SmoothingKernel::gaussian(5.0).noise() - 1.0).abs() < 1e-4);
    }
}
