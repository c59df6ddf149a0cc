//! Light in a leaf by random walk (Monte Carlo). It solves the transport equation without the diffusion approximation,
//! and judges the models that use this approximation.
//!
//! A homogeneous [`Medium`] lies between two faces: planes ([`slab`]), or two height fields on a grid of texels
//! ([`relief`]). Collisions are weighted by the albedo (survival weights), and weak histories end by Russian roulette,
//! so every mean is unbiased. Every result is an [`HistoryEstimate`] with its standard error. A run depends only on its
//! input and seed: each batch of histories has its own random stream, and batches are added in order, whatever the
//! number of threads. Units: mm, 1/mm; fluxes are relative to the flux that enters or arrives.
//!
//! Limits: one homogeneous medium, unpolarised, Henyey–Greenstein scattering. A transmittance far below 1/√(histories)
//! is found by few or no histories: its standard error then says so, but is itself uncertain. Histories beyond
//! [`EVENTS`] events are counted as lost.

#![warn(missing_docs)]

pub mod field;
pub mod phase;
pub mod relief;
pub mod rough;
pub mod slab;
pub mod tally;

pub use field::{FieldRim, LeafHeightField};
pub use relief::{IncidentLight, ReliefLeaf, ReliefWalk};
pub use slab::{Slab, SlabWalk};
pub use tally::{Histories, HistoryEstimate};

use mesophyll_base::error::{Error, Result};
use rough::RoughSurface;

/// A history with more collisions and crossings than this is given up and counted as lost.
pub(crate) const EVENTS: u32 = 10_000_000;
/// A history weaker than this share of its start plays roulette …
const WEAK: f64 = 0.02;
/// … and survives with this probability, its weight divided by it.
const SURVIVES: f64 = 0.25;

/// What light travels in: absorption and scattering coefficients (1/mm, ≥ 0) and the mean cosine of scattering (−1 < g
/// < 1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Medium {
    /// Absorption coefficient σa (1/mm), at least 0.
    pub sigma_a: f64,
    /// Scattering coefficient σs (1/mm), at least 0.
    pub sigma_s: f64,
    /// Mean cosine of scattering, between −1 and 1.
    pub g: f64,
}

impl Medium {
    /// σt = σa + σs (1/mm).
    pub fn extinction(&self) -> f64 {
        self.sigma_a + self.sigma_s
    }

    /// σs/σt; 1 where there is neither.
    pub fn albedo(&self) -> f64 {
        let t = self.extinction();
        if t > 0.0 { self.sigma_s / t } else { 1.0 }
    }

    fn check(&self) -> Result<()> {
        let coefficient = |name: &str, v: f64| {
            if v >= 0.0 && v.is_finite() {
                Ok(())
            } else {
                Err(Error::Usage(format!("random walk: {name} is {v}/mm, expected a number ≥ 0")))
            }
        };
        coefficient("sigma_a", self.sigma_a)?;
        coefficient("sigma_s", self.sigma_s)?;
        if self.g.abs() < 1.0 {
            Ok(())
        } else {
            Err(Error::Usage(format!("random walk: g is {}, expected −1 < g < 1", self.g)))
        }
    }
}

/// How both faces act on light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Boundary {
    /// Nothing: the same refractive index on both sides.
    Matched,
    /// Inside, this share of what arrives goes back, Lambertian; that is diffusion theory's A = (1 + ρ)/(1 − ρ). 0 ≤ ρ
    /// < 1.
    Diffuse {
        /// The share ρ.
        reflectance: f64,
    },
    /// A rough dielectric: refraction, reflection and total reflection at microfacets, both ways.
    Rough(RoughSurface),
}

impl Boundary {
    fn check(&self) -> Result<()> {
        match *self {
            Boundary::Matched => Ok(()),
            Boundary::Diffuse { reflectance: r } if (0.0..1.0).contains(&r) => Ok(()),
            Boundary::Diffuse { reflectance: r } => {
                Err(Error::Usage(format!("random walk: the inner reflectance is {r}, expected 0 ≤ ρ < 1")))
            }
            Boundary::Rough(rough) => rough.check(),
        }
    }
}

/// Russian roulette: false where the history ends.
fn survives(weight: &mut f64, start: f64, rng: &mut rand_pcg::Pcg64) -> bool {
    if *weight >= WEAK * start {
        return true;
    }
    if *weight > 0.0 && tally::uniform(rng) <= SURVIVES {
        *weight /= SURVIVES;
        return true;
    }
    false
}

#[cfg(test)]
mod relief_tests;
#[cfg(test)]
mod tests;
