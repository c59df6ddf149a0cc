//! A texel under a linear light source (G3; W §3): a tube of uniform radiance moves over the blade, and a fixed
//! orthographic camera looks on.
//!
//! Lengths in mm, angles in radians, z out of the blade. In pass x the tube is parallel to y and moves along x; in pass
//! y it is the other way round. The camera stays. A value of 1 is a white texel facing up under an infinite tube at u =
//! 0, where u is the tube's position over its height. So a trace is `ρd·D + ρs·S`, where D and S are known from the
//! geometry, the normal and the slope m.
//!
//! **The tube's radius.** Seen from a texel, a cylinder of radius a at distance R and of uniform radiance fills the
//! angles θ ± asin(a/R) of the plane of travel evenly, and the flux of an infinite one is exactly that of a thin one.
//! So the thin tube's integrand is averaged over that range of angles (few Gauss nodes). By the capture's convention,
//! the lit length ends at the angles at which the ends of the axis are seen. The tube's end caps are not seen.
//!
//! **Limits.** The texel is a point and nothing shadows it. Interreflection and the camera's footprint are left out.

pub mod arc;
pub mod evaluator;

use crate::gloss::Lobe;
pub use arc::{ArcSums, TubeArc};
use mesophyll_base::quadrature::symmetric;
use serde::{Deserialize, Serialize};

/// The lamp: axis height over the blade, lit length centred on the blade, radius (0: thin).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tube {
    /// Height of the axis over the blade (mm).
    pub height_mm: f64,
    /// Length of the lit part (mm).
    pub length_mm: f64,
    /// Radius (mm); 0 is a thin line.
    pub radius_mm: f64,
}

/// Direction of travel: in pass `x` the tube is parallel to y and moves along x, in pass `y` the other way round.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, strum::IntoStaticStr)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum Travel {
    /// The tube is parallel to y and travels along x.
    X,
    /// The tube is parallel to x and travels along y.
    Y,
}

impl Travel {
    /// Its name in files and folders.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// A vector in the pass's own frame: (along the travel, along the tube, up).
    pub fn local(self, v: [f64; 3]) -> [f64; 3] {
        match self {
            Travel::X => v,
            Travel::Y => [v[1], v[0], v[2]],
        }
    }
}

/// Accuracy: the numbers of nodes along half the tube and across its radius. `Precision::default()` stays within 1e-5
/// of the peak for m from .02 to .9; Cook–Torrance stays within 2e-4 where masking sets in.
#[derive(Debug, Clone, PartialEq)]
pub struct TubePrecision {
    /// Gauss–Legendre nodes on the part of the tube that lights the lobe. Without symmetry there are twice as many.
    pub along: usize,
    /// Gauss–Legendre nodes across the tube's radius.
    pub across: usize,
}

impl Default for TubePrecision {
    fn default() -> Self {
        TubePrecision { along: 8, across: 3 }
    }
}

impl TubePrecision {
    /// For truth: 1e-8 and better.
    pub fn fine() -> Self {
        TubePrecision { along: 24, across: 8 }
    }
}

/// What one frame shows of a texel: the diffuse and the glossy response per unit ρd and ρs, and their derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TubeResponse {
    /// Diffuse response D, per unit ρd.
    pub d: f64,
    /// Glossy response S, per unit ρs.
    pub s: f64,
    /// ∂S/∂m.
    pub s_m: f64,
    /// ∂D/∂n and ∂S/∂n for a free vector n; multiply by ∂n/∂parameter.
    pub d_n: [f64; 3],
    /// ∂S/∂n.
    pub s_n: [f64; 3],
}

/// The plain evaluation of one frame in double precision, for any normal and any camera. It is the reference for the
/// vectorised one.
#[derive(Debug, Clone)]
pub struct TubeModel {
    /// The lamp.
    pub tube: Tube,
    /// Direction to the camera, a unit vector.
    pub camera: [f64; 3],
    /// The gloss lobe.
    pub lobe: Lobe,
    rule: arc::ArcRule,
    across: Vec<(f64, f64)>,
}

impl TubeModel {
    /// `camera`: unit vector from the blade towards the camera.
    pub fn new(tube: Tube, camera: [f64; 3], lobe: Lobe, precision: &TubePrecision) -> TubeModel {
        let across = if tube.radius_mm > 0.0 { symmetric(precision.across.max(1)) } else { symmetric(1) };
        TubeModel { tube, camera, lobe, rule: arc::ArcRule::new(precision.along), across }
    }

    /// The arcs that stand for the tube at `light_mm` (along the travel), seen from the texel at `texel_mm`, in the
    /// pass's own frame.
    pub(crate) fn arcs(&self, travel: Travel, light_mm: f64, texel_mm: [f64; 2]) -> impl Iterator<Item = TubeArc> + '_ {
        let texel = travel.local([texel_mm[0], texel_mm[1], 0.0]);
        let x = light_mm - texel[0];
        let distance = x.hypot(self.tube.height_mm);
        let theta = x.atan2(self.tube.height_mm);
        let half = 0.5 * self.tube.length_mm;
        let ends = [(-half - texel[1]) / distance, (half - texel[1]) / distance];
        let beta = (self.tube.radius_mm / distance).min(1.0).asin();
        let spread = if self.tube.radius_mm > 0.0 { beta / self.tube.radius_mm } else { 1.0 / distance };
        self.across.iter().map(move |&(node, weight)| {
            let (sin, cos) = (theta + beta * node).sin_cos();
            TubeArc { sin, cos, ends, scale: 0.5 * weight * spread * self.tube.height_mm }
        })
    }

    /// D, S and their derivatives for a normal `n` (unit) and slope `m` (> 0).
    pub fn response(&self, travel: Travel, light_mm: f64, texel_mm: [f64; 2], n: [f64; 3], m: f64) -> TubeResponse {
        let (normal, camera) = (travel.local(n), travel.local(self.camera));
        let mut sum = ArcSums::default();
        for arc in self.arcs(travel, light_mm, texel_mm) {
            sum.add(&arc.integrate(self.lobe, normal, camera, m, &self.rule));
        }
        TubeResponse { d: sum.d, s: sum.s, s_m: sum.s_m, d_n: travel.local(sum.d_n), s_n: travel.local(sum.s_n) }
    }
}

#[cfg(test)]
mod tests;
