//! What the leaf's slab says at a thickness, and how the fit weighed a transmittance.

use super::{Seen, Setup};
use crate::leaf::curve::{Incidence, ThicknessCurve};
use mesophyll_files::quantity::{Quantity, RGB};
use mesophyll_optics::slab;

/// The slab of the leaf in one channel, at any thickness: by its curve, which answers 50 times faster than the slab
/// itself, where the curve reaches.
pub(super) struct Slab {
    curve: ThicknessCurve,
    range: [f64; 2],
    sigma: [f64; 2],
}

/// ρd and ρt at a thickness, and d ln ρ/d ln t of both.
#[derive(Debug, Clone, Copy)]
pub(super) struct At {
    pub rho_d: f64,
    pub rho_t: f64,
    pub slope_d: f64,
    pub slope_t: f64,
}

impl Slab {
    pub(super) fn new(sigma_a: f64, sigma_s: f64, h: f64) -> Slab {
        let curve = ThicknessCurve::new(sigma_a, sigma_s, h, Incidence(1.0));
        Slab { range: curve.range(), curve, sigma: [sigma_a, sigma_s] }
    }

    pub(super) fn at(&self, t: f64) -> At {
        if t >= self.range[0] && t <= self.range[1] {
            let p = self.curve.at(t.ln());
            return At { rho_d: p.ln_rho_d.exp(), rho_t: p.ln_rho_t.exp(), slope_d: p.d_rho_d, slope_t: p.d_rho_t };
        }
        let (r, by) = slab::response_with_partials(self.sigma[0], self.sigma[1], t);
        let slope = |of: f64, by: f64| t * by / of;
        At {
            rho_d: r.rho_d,
            rho_t: r.rho_t,
            slope_d: slope(r.rho_d, by.thickness.rho_d),
            slope_t: slope(r.rho_t, by.thickness.rho_t),
        }
    }
}

/// The variance of a transmittance as the fit weighed it: (relative·T)² + floor². The map of errors holds it for the
/// measured ρt.
pub(super) struct Variance<'a> {
    errors: [&'a [f32]; 3],
    rho_t: [&'a [f32]; 3],
    /// The part that grows with the light, in the map of errors.
    measured: [f64; 3],
    /// The same in the fit's weights: a scan's is its noise; that of photographs is common to all texels and no weight.
    weighed: f64,
}

impl<'a> Variance<'a> {
    /// `None` for fits that do not weigh ρt.
    pub(super) fn of(seen: &'a Seen) -> Option<Variance<'a>> {
        let (measured, weighed) = match seen.setup {
            Setup::Tube { straight: true } => {
                let relative = seen.relative_noise()?;
                ([relative; 3], relative)
            }
            Setup::Photo => {
                let shared = RGB.map(|c| seen.figure(&format!("rho_t_relative_err_shared.{c}")));
                let [Some(r), Some(g), Some(b)] = shared else { return None };
                ([r, g, b], 0.0)
            }
            _ => return None,
        };
        let errors = seen.errors.as_ref()?.three(Quantity::RhoT)?;
        Some(Variance { errors, rho_t: seen.maps.three(Quantity::RhoT)?, measured, weighed })
    }

    /// The variance at texel `k` where the model lets `model` through.
    pub(super) fn at(&self, c: usize, k: usize, model: f64) -> f64 {
        let (error, measured) = (f64::from(self.errors[c][k]), f64::from(self.rho_t[c][k]));
        let floor = error * error - (self.measured[c] * measured).powi(2);
        floor.max(1e-18) + (self.weighed * model).powi(2)
    }
}
