//! The spectrum that a texture must have so that a straight line through it has the wanted spectrum, and how to measure
//! the latter.
//!
//! H9 §4.5.3 gives a radially symmetric texture the wanted spectrum itself. But a line through an isotropic field has
//! the *Abel projection* of the field's spectrum Φ(ρ): S₁(k) = 2 ∫_k^∞ Φ(ρ) ρ dρ / √(ρ² − k²). So Φ must be the inverse
//! projection. It is solved on rings that are one frequency step wide; there the projection is a triangular matrix in
//! closed form. A sharp resonance has no inverse without negative power below it, because every ring also adds to all
//! lower frequencies of the line. Then Φ is the non-negative spectrum of least relative deviation (Richardson–Lucy
//! iteration; W. H. Richardson, J. Opt. Soc. Am. 62 (1972), 55–59). The deviation that remains is unavoidable for
//! isotropic textures.

use mesophyll_base::fourier::Complex;

/// How a texture's spectrum is made from the wanted one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SpectrumMethod {
    /// The wanted spectrum itself, as in H9; only the variance is made right.
    Plain,
    /// Its inverse Abel projection.
    #[default]
    InverseAbel,
    /// Not isotropic: the wanted spectrum along x and a narrow band along y. Lines nearly along x
    /// ([`super::motion::MotionTexture::trajectory`]) have the wanted spectrum, however sharp its resonance is. Lines
    /// in other directions do not.
    Directed,
}

/// Power over the plane of frequencies, constant on rings [j − ½, j + ½] for j = 1 … n in cycles a texture, two-sided.
#[derive(Debug, Clone, PartialEq)]
pub struct SpectrumRings(pub Vec<f64>);

/// Rounds of the iteration.
const ROUNDS: usize = 400;

impl SpectrumRings {
    /// From a one-sided power density `spectrum(f)` in Hz; ring j belongs to the frequency j times `lowest`.
    pub fn new(spectrum: impl Fn(f64) -> f64, lowest: f64, count: usize, method: SpectrumMethod) -> SpectrumRings {
        // Two-sided, for each unit of the wave number k.
        let wanted: Vec<f64> = (1..=count).map(|j| 0.5 * lowest * spectrum(j as f64 * lowest)).collect();
        let plain = {
            let raw = SpectrumRings(wanted.clone());
            let (have, want): (f64, f64) = (raw.variance(), 2.0 * wanted.iter().sum::<f64>());
            SpectrumRings(wanted.iter().map(|p| p * want / have).collect())
        };
        match method {
            SpectrumMethod::Plain | SpectrumMethod::Directed => plain,
            SpectrumMethod::InverseAbel => inverse(&wanted, &plain),
        }
    }

    /// The projection: two-sided power density of a line at j = 1 … n.
    pub fn projected(&self) -> Vec<f64> {
        (1..=self.0.len()).map(|i| (i..=self.0.len()).map(|j| kernel(i, j) * self.0[j - 1]).sum()).collect()
    }

    /// Integral over the plane.
    pub fn variance(&self) -> f64 {
        // π((j+½)² − (j−½)²) = 2π j.
        self.0.iter().enumerate().map(|(k, p)| std::f64::consts::TAU * (k + 1) as f64 * p).sum()
    }
}

/// What ring j adds to a line at k = i: 2 ∫ ρ dρ/√(ρ²−k²) over the ring.
fn kernel(i: usize, j: usize) -> f64 {
    let root = |rho: f64| (rho * rho - (i * i) as f64).max(0.0).sqrt();
    2.0 * (root(j as f64 + 0.5) - root(j as f64 - 0.5))
}

fn inverse(wanted: &[f64], plain: &SpectrumRings) -> SpectrumRings {
    let n = wanted.len();
    // Solves from the outermost ring inward; it is exact where the result is not negative.
    let mut power = vec![0.0; n];
    for i in (1..=n).rev() {
        let outer: f64 = (i + 1..=n).map(|j| kernel(i, j) * power[j - 1]).sum();
        power[i - 1] = (wanted[i - 1] - outer) / kernel(i, i);
    }
    if power.iter().all(|p| *p >= 0.0) {
        return SpectrumRings(power);
    }
    let mut rings = SpectrumRings(power.iter().zip(&plain.0).map(|(p, q)| p.max(1e-3 * q)).collect());
    for _ in 0..ROUNDS {
        let ratio: Vec<f64> = rings.projected().iter().zip(wanted).map(|(have, want)| want / have).collect();
        for j in 1..=n {
            let (mut top, mut bottom) = (0.0, 0.0);
            for i in 1..=j {
                let weight = kernel(i, j) / wanted[i - 1];
                top += weight * ratio[i - 1];
                bottom += weight;
            }
            rings.0[j - 1] *= top / bottom;
        }
    }
    rings
}

/// One-sided power density of evenly spaced samples, `dt` (s) apart, at multiples of 1/(segment · dt): mean over
/// half-overlapping segments under Hann's window (P. D. Welch, IEEE Trans. Audio Electroacoust. 15 (1967), 70–73).
/// Empty where the samples do not fill a segment.
pub(crate) fn periodogram(samples: &[f64], dt: f64, segment: usize) -> Vec<f64> {
    if segment < 2 || samples.len() < segment {
        return Vec::new();
    }
    let fft = mesophyll_base::fourier::forward(segment);
    let window: Vec<f64> =
        (0..segment).map(|k| (std::f64::consts::PI * k as f64 / segment as f64).sin().powi(2)).collect();
    let power: f64 = window.iter().map(|w| w * w).sum();
    let mut sum = vec![0.0; segment / 2 + 1];
    let mut count = 0.0;
    for start in (0..=samples.len() - segment).step_by((segment / 2).max(1)) {
        let mut buffer: Vec<Complex<f64>> =
            samples[start..start + segment].iter().zip(&window).map(|(s, w)| Complex::new(s * w, 0.0)).collect();
        fft.process(&mut buffer);
        for (total, value) in sum.iter_mut().zip(&buffer) {
            *total += value.norm_sqr();
        }
        count += 1.0;
    }
    sum.iter().map(|s| 2.0 * dt * s / (power * count)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Φ = e^(−ρ²/2a²) projects to a√(2π) e^(−k²/2a²).
    #[test]
    fn the_projection_of_a_gaussian_is_a_gaussian() {
        let a = 12.0f64;
        let rings = SpectrumRings((1..=90).map(|j| (-f64::from(j * j) / (2.0 * a * a)).exp()).collect());
        // Up to two standard deviations of k: there, steps of one ring follow the slope to about half a percent.
        for (k, p) in rings.projected().iter().take(24).enumerate() {
            let i = (k + 1) as f64;
            let exact = a * std::f64::consts::TAU.sqrt() * (-i * i / (2.0 * a * a)).exp();
            assert!((p / exact - 1.0).abs() < 0.01, "at {i}: {p} {exact}");
        }
    }

    #[test]
    fn a_falling_spectrum_is_inverted_exactly_and_a_peak_as_well_as_can_be() {
        let falling = |f: f64| (1.0 + f).powf(-5.0 / 3.0);
        let rings = SpectrumRings::new(falling, 0.1, 40, SpectrumMethod::InverseAbel);
        for (k, p) in rings.projected().iter().enumerate() {
            let want = 0.05 * falling(0.1 * (k + 1) as f64);
            assert!((p / want - 1.0).abs() < 1e-10, "{k}");
        }
        let peak = |f: f64| 1.0 / (0.01 + (f - 2.0) * (f - 2.0));
        let deviation = |m: SpectrumMethod| {
            let p = SpectrumRings::new(peak, 0.1, 40, m).projected();
            let sum: f64 =
                p.iter().enumerate().map(|(k, p)| (p / (0.05 * peak(0.1 * (k + 1) as f64))).log10().powi(2)).sum();
            (sum / 40.0).sqrt()
        };
        assert!(SpectrumRings::new(peak, 0.1, 40, SpectrumMethod::InverseAbel).0.iter().all(|p| *p >= 0.0));
        assert!(
            deviation(SpectrumMethod::InverseAbel) < 0.8 * deviation(SpectrumMethod::Plain),
            "{}",
            deviation(SpectrumMethod::InverseAbel)
        );
    }

    /// White noise of variance σ² has the one-sided density 2 σ² dt; a sine holds half its squared amplitude.
    #[test]
    fn periodograms_have_the_right_scale() {
        let mut state = 1u64;
        let white: Vec<f64> = (0..1 << 15)
            .map(|_| {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
            })
            .collect();
        let p = periodogram(&white, 0.25, 256);
        let mean = p[1..128].iter().sum::<f64>() / 127.0;
        assert!((mean / (2.0 * 0.25 / 12.0) - 1.0).abs() < 0.03, "{mean}");
        let sine: Vec<f64> =
            (0..4096).map(|k| 3.0 * (std::f64::consts::TAU * 0.1 * f64::from(k) + 0.3).sin()).collect();
        let p = periodogram(&sine, 1.0, 1024);
        assert!((p.iter().sum::<f64>() / 1024.0 / 4.5 - 1.0).abs() < 1e-3);
        assert!(periodogram(&sine, 1.0, 5000).is_empty());
    }
}
