//! T(r, d), and whether it can be trusted: one row of what `eval dipole` prints.

use super::{DipoleForm, Tissue};
use crate::slab;
use mesophyll_base::error::Status;

/// Upper limit of n. Even at σa = 1e-6/mm the sum converges long before this.
pub const MOST_DIPOLES: u32 = 1_000_000;
/// Relative error that the status `ok` promises at most.
const PROMISE: f64 = 0.1;

/// T(r, d) in 1/mm² at `radius_mm` ≥ 0 and `thickness_mm` > 0, and whether diffusion holds there. The value is given
/// wherever the formula has one; it is NaN where the status is [`Status::Refused`].
pub fn evaluate(tissue: &Tissue, form: DipoleForm, thickness_mm: f64, radius_mm: f64) -> (f64, Status) {
    let (thickness, radius) = (thickness_mm, radius_mm);
    let refused = |why: String| (f64::NAN, Status::Refused(why));
    if !(thickness > 0.0 && thickness.is_finite()) {
        return refused(format!("thickness is {thickness}; expected above 0 (mm)"));
    }
    if !(radius >= 0.0 && radius.is_finite()) {
        return refused(format!("radius is {radius}; expected 0 or more (mm)"));
    }
    let l = tissue.mean_free_path();
    if !l.is_finite() {
        return refused("nothing absorbs or scatters; expected sigma_a + (1-g) sigma_s above 0".into());
    }
    if form == DipoleForm::Images && thickness <= l {
        return refused(format!(
            "thickness is {thickness}; expected above one mean free path, {l:.4} mm, with the method images"
        ));
    }
    let t = tissue.transmittance(radius, thickness, form);
    if !t.is_finite() {
        return refused(format!("t has no finite value at thickness {thickness} and radius {radius}"));
    }
    let status = match doubt(tissue, form, thickness, t) {
        None => Status::Ok,
        Some(why) => Status::Undetermined(format!("t: {why}")),
    };
    (t, status)
}

/// Why a value that can be computed is not to be trusted.
fn doubt(tissue: &Tissue, form: DipoleForm, thickness: f64, t: f64) -> Option<String> {
    if let Some(why) = tissue.doubt() {
        return Some(why);
    }
    let l = tissue.mean_free_path();
    if form != DipoleForm::Thin && thickness <= l {
        return Some(format!(
            "diffusion does not hold at a thickness of at most one mean free path, {l:.4} mm; the method thin does"
        ));
    }
    if t < 0.0 {
        return Some("negative; the sum does not hold here".into());
    }
    if tissue.sigma_a > tissue.reduced_scattering() {
        return Some("diffusion does not hold where sigma_a exceeds (1-g) sigma_s".into());
    }
    if let DipoleForm::Dipoles(n) = form {
        // The value is that of the sum that was asked for. The share of all the light that the sum leaves out is its
        // error.
        let whole = tissue.total(thickness, DipoleForm::Images);
        let left_out = 1.0 - tissue.total(thickness, form) / whole;
        if whole > 0.0 && !(left_out.abs() <= PROMISE) {
            return Some(format!("{n} dipoles leave out {:.0} % of the light at this thickness", 100.0 * left_out));
        }
    }
    // With matched faces (A = 1) the exact total is known, and the result is compared with it.
    if tissue.a == 1.0 {
        let exact = slab::response(tissue.sigma_a, tissue.reduced_scattering(), thickness).rho_t;
        let off = tissue.total(thickness, form) / exact - 1.0;
        if exact > 0.0 && !(off.abs() <= PROMISE) {
            return Some(format!(
                "the form's total is {:+.0} % off the transport equation's at this thickness",
                100.0 * off
            ));
        }
    }
    None
}
