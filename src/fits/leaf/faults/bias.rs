//! How far texels move when they are fitted again under another cause.

use crate::leaf::held_out::TexelParameters;
use mesophyll_base::rgb::Rgb;
use mesophyll_base::statistics::{NORMAL_SCATTER, median_of};

/// How far a quantity of the texels is from what it is under the right cause.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TrialBias {
    /// Relative root mean square difference of ρd.
    pub rho_d: f64,
    /// Relative root mean square difference of ρs.
    pub rho_s: f64,
    /// Relative root mean square difference of m.
    pub m: f64,
    /// Root mean square difference of a component of the normal.
    pub normal: f64,
}

pub(super) fn bias(before: &[TexelParameters], after: &[TexelParameters]) -> TrialBias {
    let rms = |difference: &dyn Fn(&TexelParameters, &TexelParameters) -> f64| {
        let all = before.iter().zip(after).map(|(a, b)| difference(a, b)).filter(|v| v.is_finite());
        // The median keeps a texel without gloss from deciding.
        NORMAL_SCATTER * median_of(all.map(f64::abs)).unwrap_or(f64::NAN)
    };
    let relative = |a: Rgb, b: Rgb| a.sum() / b.sum() - 1.0;
    let or_zero = |v: f64| if v.is_finite() { v } else { 0.0 };
    TrialBias {
        rho_d: or_zero(rms(&|a, b| relative(a.rho_d, b.rho_d))),
        rho_s: or_zero(rms(&|a, b| relative(a.rho_s, b.rho_s))),
        m: or_zero(rms(&|a, b| a.m / b.m - 1.0)),
        normal: or_zero(rms(&|a, b| (a.normal[0] - b.normal[0]).hypot(a.normal[1] - b.normal[1]))),
    }
}
