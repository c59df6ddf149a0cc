//! What the slab says after an edit.

use crate::bundle::LeafSlabs;
use mesophyll_optics::slab::curve::ResponseCurve;
use mesophyll_viewer::scene::{Interior, LeafMaterial, SlabCurve};

/// Relative error of a curve between its points.
const ALLOWED: f64 = 1e-4;

/// A value that no slab has.
#[derive(Debug, thiserror::Error)]
#[error("{what}: found {found}, expected {expected}")]
pub struct EditError {
    what: &'static str,
    found: f64,
    expected: &'static str,
}

/// The slab over the thicknesses of a side's texels: `thickness_mm` plus the δ of each texel (mm), the fourth number of
/// its γ and δ. σ is in 1/mm.
pub fn slab(sigma_a: [f64; 3], sigma_s: [f64; 3], thickness_mm: f64, texels: &[[f32; 4]]) -> ResponseCurve {
    let h = thickness_mm;
    let (low, high) = texels.iter().fold((h, h), |(a, b), t| (a.min(h + f64::from(t[3])), b.max(h + f64::from(t[3]))));
    // An edit may request a mean thickness that is smaller than the variation of the veins.
    ResponseCurve::sampled(sigma_a, sigma_s, [low.max(1e-3 * h), high], ALLOWED, |_, _| ())
}

/// A curve in the renderer's precision.
pub fn slab_curve(curve: &ResponseCurve) -> SlabCurve {
    let rgb = |list: &[[f64; 3]]| list.iter().map(|c| c.map(|v| v as f32)).collect();
    SlabCurve { min_mm: curve.min as f32, max_mm: curve.max as f32, rho_d: rgb(&curve.rho_d), rho_t: rgb(&curve.rho_t) }
}

impl LeafSlabs {
    /// Computes the slabs of `leaf` again, as this says them.
    ///
    /// # Errors
    /// For a thickness that is not positive and for a σ below 0. The leaf then stays as it was.
    pub fn apply(&self, leaf: &mut LeafMaterial) -> Result<(), EditError> {
        let found = self.thickness_mm;
        if !(found > 0.0 && found.is_finite()) {
            return Err(EditError { what: "thickness (mm)", found, expected: "a positive number" });
        }
        let all = self.sides.iter().filter_map(|(_, slab)| slab.as_ref());
        if let Some(&found) =
            all.flat_map(|s| s.sigma_a.iter().chain(&s.sigma_s)).find(|v| !(v.is_finite() && **v >= 0.0))
        {
            return Err(EditError { what: "σ (1/mm)", found, expected: "a number of 0 or more" });
        }
        for (side, edit) in self.sides.iter() {
            let Some(edit) = edit else { continue };
            let maps = &mut leaf.sides[side];
            let made = slab(edit.sigma_a, edit.sigma_s, self.thickness_mm, &maps.gamma_delta);
            maps.interior = Interior::Scalars(slab_curve(&made));
        }
        leaf.thickness_mm = self.thickness_mm as f32;
        Ok(())
    }
}
