//! Projection of a sky's upper hemisphere onto spherical harmonics, by quadrature in polar coordinates around the
//! *sun*.
//!
//! Three things spoil a plain (θ, φ) rule: the cone of e^(Dγ) at the sun (a kink in every direction through it), the
//! essential singularity of e^(B/cosθ) at the horizon, and the jump to zero below the horizon. In polar coordinates (γ,
//! ψ) around the sun the cone is smooth. Each ray runs from the sun (γ = 0) to the point where it meets the horizon,
//! γ₁(ψ) = atan2(cosθs, −sinθs cosψ), so the horizon is a coordinate line.
//!
//! - Along a ray, cosθ = r sin(γ₁ − γ) exactly, with r² = cos²θs + sin²θs cos²ψ. Nodes are denser towards the horizon
//!   end. For a low sun they are denser towards the sun as well, because then both ends are near the horizon.
//! - Across rays, γ₁ changes from π to 0 within η = asinh(cot θs) of ψ = π/2. The substitution ψ = π/2 + η sinh u
//!   spreads that change evenly over u.
//!
//! Both are Gauss–Legendre rules and converge geometrically. Everything is even in azimuth, so half of the rays are
//! enough, and coefficients of m < 0 are zero. The error at [`ProjectionQuality::Exact`] is ≤ 1e-10 of c00 for Preetham
//! at any turbidity of 1.7 … 10 and any sun, N ≤ 20 (tested against an adaptive integration in zenith angle and
//! azimuth, and against half as many nodes more). Hosek–Wilkie's √cosθ and single precision leave 1e-5.

use super::harmonics::{HarmonicBasis, HarmonicCoefficients};
use super::{Sky, colour, quadrature};
use std::f64::consts::FRAC_PI_2;

/// How many nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ProjectionQuality {
    /// About 1e-7 of c00 for turbidities from 2.5 on: what a fit to 1e-6 needs.
    Fit,
    /// 1e-10 of c00 and better.
    #[default]
    Exact,
    /// Half as many nodes more, to check [`ProjectionQuality::Exact`].
    Checked,
}

/// Closer to the horizon than this, the sun counts as being on it; the difference is smaller than rounding.
const LOWEST: f64 = 1e-13;
/// For suns lower than this (zenith angle), nodes are denser at both ends of a ray.
const LOW: f64 = 1.43;

/// A rule for one sun and a number of bands: directions, angles to the sun, and weights times the basis. Skies of any
/// turbidity (and any model) with that sun are projected in one pass over the nodes.
#[derive(Debug, Clone)]
pub struct ProjectionRule {
    bands: usize,
    sun_zenith: f64,
    nodes: Vec<Node>,
    /// Weighted basis, N(N+1)/2 values a node.
    weighted: Vec<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    d: [f64; 3],
    gamma: f64,
}

impl ProjectionRule {
    /// `sun_zenith` from 0 to π/2 (see [`Sky::sun_zenith`]), `bands` from 1 on.
    pub fn new(sun_zenith: f64, bands: usize, quality: ProjectionQuality) -> ProjectionRule {
        let (sin, cos) = (sun_zenith.sin(), sun_zenith.cos().max(LOWEST));
        // Half the width of the change of γ₁, and half the range of u that covers ψ = 0 … π.
        let eta = if sin > 0.0 { (cos / sin).asinh().min(50.0) } else { 50.0 };
        let reach = (FRAC_PI_2 / eta).asinh();
        let more = 1.3 * bands.saturating_sub(7) as f64;
        let count = |base: f64, slope: f64| ((base + slope * reach + more) / 4.0).ceil() as usize * 4;
        let (rays, steps) = match quality {
            ProjectionQuality::Fit => (count(24.0, 6.0), 32 + more as usize),
            ProjectionQuality::Exact => (count(36.0, 12.0), 64 + more as usize),
            ProjectionQuality::Checked => (count(54.0, 18.0), 96 + more as usize),
        };
        let basis = HarmonicBasis::new(bands);
        let size = bands * (bands + 1) / 2;
        let mut rule = ProjectionRule {
            bands,
            sun_zenith,
            nodes: Vec::with_capacity(rays * steps),
            weighted: vec![0.0; rays * steps * size],
        };
        let along = quadrature::gauss(steps);
        for &(x, w) in quadrature::gauss(rays).iter() {
            let u = reach * x;
            let psi = FRAC_PI_2 + eta * u.sinh();
            let w_psi = w * reach * eta * u.cosh();
            let (sin_psi, cos_psi) = psi.sin_cos();
            let end = cos.atan2(-sin * cos_psi);
            let r = cos.hypot(sin * cos_psi);
            for &(x, w) in along.iter() {
                let (done, left, slope) = gathered(0.5 * (1.0 + x), sun_zenith > LOW);
                let gamma = end * done;
                let (sin_gamma, cos_gamma) = gamma.sin_cos();
                let d = [sin * cos_gamma - cos * sin_gamma * cos_psi, sin_gamma * sin_psi, r * (end * left).sin()];
                // Twice, for the other half of the rays.
                let weight = 2.0 * w_psi * 0.5 * w * slope * end * sin_gamma;
                let at = rule.nodes.len() * size;
                let values = &mut rule.weighted[at..at + size];
                basis.fill_even(d, values);
                values.iter_mut().for_each(|v| *v *= weight);
                rule.nodes.push(Node { d, gamma });
            }
        }
        rule
    }

    /// Number of bands N: l = 0 … N−1.
    pub fn bands(&self) -> usize {
        self.bands
    }
    /// The sun zenith angle (rad) that the rule was made for.
    pub fn sun_zenith(&self) -> f64 {
        self.sun_zenith
    }
    /// Number of directions in which a sky is evaluated.
    pub fn evaluations(&self) -> usize {
        self.nodes.len()
    }

    /// Integrals of three functions times each basis function of m ≥ 0: N(N+1)/2 triples at l(l+1)/2 + m. `f` gets a
    /// direction and γ.
    pub fn integrate(&self, mut f: impl FnMut([f64; 3], f64) -> [f64; 3]) -> Vec<[f64; 3]> {
        let size = self.bands * (self.bands + 1) / 2;
        let mut planes = vec![0.0; 3 * size];
        let (a, rest) = planes.split_at_mut(size);
        let (b, c) = rest.split_at_mut(size);
        for (node, y) in self.nodes.iter().zip(self.weighted.chunks_exact(size)) {
            let v = f(node.d, node.gamma);
            for (k, y) in y.iter().enumerate() {
                a[k] += v[0] * y;
                b[k] += v[1] * y;
                c[k] += v[2] * y;
            }
        }
        (0..size).map(|k| [a[k], b[k], c[k]]).collect()
    }

    /// The sky's coefficients in linear sRGB (kcd/m²). The sky must have this rule's sun.
    pub fn project(&self, sky: &dyn Sky) -> HarmonicCoefficients {
        debug_assert_eq!(sky.sun_zenith(), self.sun_zenith);
        spread(self.bands, &self.integrate(|d, gamma| sky.xyz_near_sun(d, gamma)), colour::rgb_from_xyz)
    }
}

/// The part of the way that is done (0 … 1), the part that is left (not as a difference of the two, because the horizon
/// needs its digits), and the slope, for t evenly over 0 … 1.
fn gathered(t: f64, both: bool) -> (f64, f64, f64) {
    let s = 1.0 - t;
    if both { (t * t * (3.0 - 2.0 * t), s * s * (1.0 + 2.0 * t), 6.0 * t * s) } else { (t * (2.0 - t), s * s, 2.0 * s) }
}

/// N² coefficients from those of m ≥ 0, each passed through `colour`; m < 0 are zero.
pub fn spread(bands: usize, even: &[[f64; 3]], colour: impl Fn([f64; 3]) -> [f64; 3]) -> HarmonicCoefficients {
    let mut out = HarmonicCoefficients::zero(bands);
    for l in 0..bands {
        for m in 0..=l {
            out.values_mut()[l * (l + 1) + m] = colour(even[l * (l + 1) / 2 + m]);
        }
    }
    out
}

/// N² coefficients of a sky in linear sRGB (kcd/m²), sun at azimuth 0, by integration without any polynomial: 49 × 3
/// numbers for 7 bands.
pub fn direct(sky: &dyn Sky, bands: usize) -> HarmonicCoefficients {
    ProjectionRule::new(sky.sun_zenith(), bands, ProjectionQuality::Exact).project(sky)
}

#[cfg(test)]
mod tests;
