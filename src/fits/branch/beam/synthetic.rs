//! Synthetic measurements of branches with seeded noise, for tests and the tables of stress and bench.

use super::fit::{DeflectionMark, MeasuredBranch, PositionReference};
use mesophyll_plants::mechanics::elastica::Elastica;
use mesophyll_plants::mechanics::length::AxisPoint;
use mesophyll_plants::mechanics::load::Load;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// The true branch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BranchFitTruth {
    /// Taper α: radius at the tip over radius at the root.
    pub alpha: f64,
    /// Deflection that the tip of a linear beam would have under this load, over the length. The branch itself moves
    /// less.
    pub tip: f64,
    /// Length of the branch (mm).
    pub length: f64,
    /// The whole load (N).
    pub load: f64,
    /// How it is spread.
    pub kind: Load,
    /// Modulus of elasticity (GPa).
    pub modulus: f64,
}

impl Default for BranchFitTruth {
    fn default() -> Self {
        BranchFitTruth { alpha: 0.3, tip: 0.3, length: 800.0, load: 4.0, kind: Load::Even, modulus: 8.0 }
    }
}

impl BranchFitTruth {
    /// F/(E′r₁⁴), the load over the stiffness of the root, divided by the length.
    pub fn amplitude(&self) -> f64 {
        self.tip / (self.bent(1e-7, 1.0).across / 1e-7)
    }
    /// F/(E′r₁⁴) (mm).
    pub fn load_over_stiffness(&self) -> f64 {
        self.amplitude() * self.length
    }
    /// Root radius s₁ (mm), from F L³/(E s₁⁴) = F/(E′r₁⁴).
    pub fn root_radius(&self) -> f64 {
        (self.load * self.length.powi(3) / (self.modulus * 1e3 * self.load_over_stiffness())).powf(0.25)
    }
    /// The point at the share `t` of the branch, for an amplitude; NaN where there is no such branch.
    fn bent(&self, amplitude: f64, t: f64) -> AxisPoint<f64> {
        let nowhere =
            AxisPoint { along: f64::NAN, across: f64::NAN, cos: f64::NAN, sin: f64::NAN, curvature: f64::NAN };
        Elastica::solve(self.kind, self.alpha, amplitude).map_or(nowhere, |bent| bent.at(t))
    }
    /// Where the mark at the share `t` of the branch is (mm): along the straight axis, and across.
    pub fn place(&self, t: f64) -> [f64; 2] {
        let bent = self.bent(self.amplitude(), t);
        [bent.along, bent.across].map(|v| v * self.length)
    }
    /// Deflection of the tip across (mm).
    pub fn tip_mm(&self) -> f64 {
        self.place(1.0)[1]
    }
}

/// A branch with `marks` evenly spaced marks up to the tip, without one at the root. The readings have Gaussian noise
/// of `noise` times the tip's deflection, which is stated.
pub fn branch(truth: &BranchFitTruth, marks: usize, noise: f64, seed: u64, along: PositionReference) -> MeasuredBranch {
    let mut rng = Pcg64::seed_from_u64(seed);
    let error = (noise * truth.tip_mm().abs()).max(1e-12 * truth.length);
    let readings = (1..=marks)
        .map(|k| {
            let t = k as f64 / marks as f64;
            let (a, b): (f64, f64) = (rng.random(), rng.random());
            let normal = (-2.0 * (1.0 - a).ln()).sqrt() * (std::f64::consts::TAU * b).cos();
            let [x, across] = truth.place(t);
            let position = if along == PositionReference::Branch { t * truth.length } else { x };
            DeflectionMark { position, deflection: across + error * normal, error }
        })
        .collect();
    MeasuredBranch { length: truth.length, readings, load: [truth.load, 0.0], modulus: [truth.modulus, 0.0] }
}
