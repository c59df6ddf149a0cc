//! Synthetic measurements of branches with seeded noise, for tests and the tables of stress and bench.

use super::measured::{Along, Branch, Reading};
use mesophyll_plant::beam;
use mesophyll_plant::length::settled;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// The true branch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Taper α: radius at the tip over radius at the root.
    pub alpha: f64,
    /// Deflection of the tip over the length, before the length is corrected.
    pub tip: f64,
    /// Length of the branch (mm).
    pub length: f64,
    /// The whole load (N), spread evenly.
    pub load: f64,
    /// Modulus of elasticity (GPa).
    pub modulus: f64,
}

impl Default for Truth {
    fn default() -> Self {
        Truth { alpha: 0.3, tip: 0.3, length: 800.0, load: 4.0, modulus: 8.0 }
    }
}

impl Truth {
    /// F/(E′r₁⁴), the load over the stiffness of the root, divided by the length.
    pub fn amplitude(&self) -> f64 {
        self.tip / beam::deflection(self.alpha, 1.0)
    }
    /// F/(E′r₁⁴) (mm).
    pub fn load_over_stiffness(&self) -> f64 {
        self.amplitude() * self.length
    }
    /// Root radius s₁ (mm), from F L³/(E s₁⁴) = F/(E′r₁⁴).
    pub fn root_radius(&self) -> f64 {
        (self.load * self.length.powi(3) / (self.modulus * 1e3 * self.load_over_stiffness())).powf(0.25)
    }
    /// Deflection (mm) of the mark at x.
    pub fn across(&self, x: f64, along: Along) -> f64 {
        self.length
            * match along {
                Along::Branch => settled(self.alpha, x, self.amplitude()).across,
                Along::Axis => self.amplitude() * beam::deflection(self.alpha, x),
            }
    }
    /// Deflection of the tip across (mm), where positions are measured along the branch or along its axis.
    pub fn tip_mm(&self, along: Along) -> f64 {
        self.across(1.0, along)
    }
}

/// A branch with `marks` evenly spaced marks up to the tip, without one at the root. The readings have Gaussian noise
/// of `noise` times the tip's deflection, which is stated.
pub fn branch(truth: &Truth, marks: usize, noise: f64, seed: u64, along: Along) -> Branch {
    let mut rng = Pcg64::seed_from_u64(seed);
    let error = (noise * truth.tip_mm(along).abs()).max(1e-12 * truth.length);
    let readings = (1..=marks)
        .map(|k| {
            let x = k as f64 / marks as f64;
            let (a, b): (f64, f64) = (rng.random(), rng.random());
            let normal = (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos();
            Reading { position: x * truth.length, deflection: truth.across(x, along) + error * normal, error }
        })
        .collect();
    Branch { length: truth.length, readings, load: [truth.load, 0.0], modulus: [truth.modulus, 0.0] }
}
