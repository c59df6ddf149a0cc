//! How much light comes through one thickness, scattered and unscattered, with derivatives by the tissue. Values and
//! parameters are in logarithms.

use super::PARTIALS;
use crate::dipole::{DipoleForm, Tissue};
use crate::slab::{self, medium::SlabMedium};
use crate::translucency::convolution::TotalsSource;

/// ln of the scattered total and of the unscattered share at thickness d, then their derivatives, parameter by
/// parameter. `slant` describes the beam, unless it is along the normal.
pub fn logarithms(
    tissue: &Tissue,
    totals: TotalsSource,
    slant: Option<&SlantTotals>,
    d: f64,
) -> [f64; 2 * (PARTIALS + 1)] {
    let scattered = tissue.beyond_with_partials(0.0, d, DipoleForm::Thin);
    let (a, s) = (tissue.sigma_a, tissue.reduced_scattering());
    let mut log = [0.0; 2 * (PARTIALS + 1)];
    log[0] = scattered.value.ln();
    log[1] = -(a + s) * d;
    for (p, by) in
        [tissue.sigma_a * scattered.by[0], tissue.sigma_s * scattered.by[1], scattered.by[3]].into_iter().enumerate()
    {
        log[2 * (p + 1)] = by / scattered.value;
    }
    (log[3], log[5], log[7]) = (-a * d, -s * d, -(a + s) * d);
    if totals == TotalsSource::Transport {
        // Both are rescaled, so that their sum is that of the transport equation.
        let share = scattered.value / (scattered.value + log[1].exp());
        let wanted = slant.map_or_else(|| along_normal(a, s, d), |beam| beam.at(d));
        for (p, wanted) in wanted.into_iter().enumerate() {
            let own = match p {
                0 => (scattered.value + log[1].exp()).ln(),
                _ => share * log[2 * p] + (1.0 - share) * log[2 * p + 1],
            };
            log[2 * p] += wanted - own;
            log[2 * p + 1] += wanted - own;
        }
    }
    log
}

/// ln ρt of the slab and its derivatives by ln σa, ln σs, ln d.
fn along_normal(a: f64, s: f64, d: f64) -> [f64; PARTIALS + 1] {
    let (r, by) = slab::response_with_partials(a, s, d);
    [r.rho_t.ln(), a * by.sigma_a.rho_t / r.rho_t, s * by.sigma_s.rho_t / r.rho_t, d * by.thickness.rho_t / r.rho_t]
}

/// The same for a beam at cosine `mu` (relative to the flux through the horizontal), for many thicknesses of one
/// tissue. Derivatives are differences of the exact solution, with an error of order h⁴.
pub struct SlantTotals {
    mu: f64,
    /// Extinction and medium: of the tissue itself (`middle`), and with ln σa, then ln σs′, moved by h, −h, 2h and −2h
    /// (`beside`).
    middle: (f64, SlabMedium),
    beside: [[(f64, SlabMedium); 4]; 2],
}

impl SlantTotals {
    const H: f64 = 2e-3;

    pub fn new(tissue: &Tissue, mu: f64) -> SlantTotals {
        let (a, s) = (tissue.sigma_a, tissue.reduced_scattering());
        let medium = |by_a: f64, by_s: f64| {
            let (a, s) = (a * by_a.exp(), s * by_s.exp());
            (a + s, SlabMedium::new(s / (a + s), a / (a + s)))
        };
        let h = SlantTotals::H;
        let at = [h, -h, 2.0 * h, -2.0 * h];
        SlantTotals { mu, middle: medium(0.0, 0.0), beside: [at.map(|x| medium(x, 0.0)), at.map(|x| medium(0.0, x))] }
    }

    fn at(&self, d: f64) -> [f64; PARTIALS + 1] {
        let ln = |(extinction, medium): &(f64, SlabMedium)| medium.solve_log(self.mu, extinction * d).1;
        let slope = |at: &[(f64, SlabMedium); 4]| {
            (8.0 * (ln(&at[0]) - ln(&at[1])) - (ln(&at[2]) - ln(&at[3]))) / (12.0 * SlantTotals::H)
        };
        let [by_a, by_s] = [0, 1].map(|k: usize| slope(&self.beside[k]));
        // Only products with d matter.
        [ln(&self.middle), by_a, by_s, by_a + by_s]
    }
}
