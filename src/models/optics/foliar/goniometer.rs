//! The virtual goniometer of B1: how much light leaves into each of 20 × 40 patches of the sphere.
//!
//! Patches are 9° by 9°. The polar angle counts from the outward normal of the lit side, so that patches 0 to 9 collect
//! what is reflected and 10 to 19 what is let through. Azimuth 0 is towards the source, 180° the side of the mirror.

use super::walk::RayCounts;
use std::f64::consts::PI;

/// Rings of patches from the lit side's normal to the other side's.
pub const RINGS: usize = 20;
/// Patches a ring.
pub const SECTORS: usize = 40;

/// What was collected.
#[derive(Debug, Clone, PartialEq)]
pub struct Goniometer {
    /// Rays that left into each patch, ring by ring.
    pub patches: Vec<u64>,
    /// Where all rays went.
    pub counts: RayCounts,
}

/// One patch's reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatchReading {
    /// Share of the incident light that leaves into the patch, and its standard error.
    pub fraction: (f64, f64),
    /// The mean of the BRDF or BTDF over the patch (1/sr), and its standard error.
    pub bdf: (f64, f64),
}

/// The middle of a patch: polar angle and azimuth (radians).
pub fn middle(ring: usize, sector: usize) -> (f64, f64) {
    (PI * (ring as f64 + 0.5) / RINGS as f64, 2.0 * PI * (sector as f64 + 0.5) / SECTORS as f64)
}

/// ∫ |cos θ| dω over a patch of a ring (sr).
pub fn projected(ring: usize) -> f64 {
    let sin = |k: usize| (PI * k as f64 / RINGS as f64).sin();
    let squares = sin(ring + 1).powi(2) - sin(ring).powi(2);
    0.5 * squares.abs() * 2.0 * PI / SECTORS as f64
}

impl Goniometer {
    /// A goniometer that has not collected any ray.
    pub fn empty() -> Goniometer {
        Goniometer { patches: vec![0; RINGS * SECTORS], counts: RayCounts::default() }
    }

    /// Adds a ray. `lit` says whether it leaves on the lit side. `mu` is the cosine of its angle from that side's
    /// normal; x and y are cosine and sine of its azimuth.
    pub(super) fn collect(&mut self, lit: bool, [mu, x, y]: [f32; 3]) {
        let half = RINGS / 2;
        let from_normal = ((mu.acos() * (RINGS as f32 / std::f32::consts::PI)) as usize).min(half - 1);
        let ring = if lit { from_normal } else { RINGS - 1 - from_normal };
        let turn = y.atan2(x) / std::f32::consts::TAU;
        let turn = if turn < 0.0 { turn + 1.0 } else { turn };
        let sector = ((turn * SECTORS as f32) as usize).min(SECTORS - 1);
        self.patches[ring * SECTORS + sector] += 1;
    }

    /// The reading of one patch.
    pub fn reading(&self, ring: usize, sector: usize) -> PatchReading {
        let fraction = self.counts.share(self.patches[ring * SECTORS + sector]);
        let per = 1.0 / projected(ring);
        PatchReading { fraction, bdf: (fraction.0 * per, fraction.1 * per) }
    }
}
