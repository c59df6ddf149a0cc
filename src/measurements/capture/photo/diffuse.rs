//! What a leaf does with light from all sides: it reflects another share of it than of a beam along the normal, and
//! lets another share through. The light table and the sheet behind a leaf send such light to its underside.
//!
//! Of the slab, the shares are 2 ∫ ρ(μ) μ dμ over the cosines μ of incidence. Of the surface, it is Fresnel's
//! reflectance averaged in the same way, in closed form (Walsh 1926; Duntley 1942).

use mesophyll_optics::slab::inverse;
use mesophyll_optics::slab::medium::SlabMedium;

/// Gauss–Legendre nodes over the cosine of incidence. Through a thick, absorbing slab light falls off like e^(−Δ/μ),
/// which equal steps integrate badly (24 of them are off by .5 % at Δ = 7).
const NODES: usize = 16;
/// Where no slab has the reflectance and the transmittance: what a dark one does.
const DARK: [f64; 2] = [1.33, 0.6];

/// How much more of even light the slab that reflects `rho_d` and lets `rho_t` through of a beam along the normal
/// reflects, and how much more it lets through: [reflected/ρd, through/ρt].
pub fn over_normal(rho_d: f64, rho_t: f64) -> [f64; 2] {
    let (d, t) = (rho_d.max(1e-3), rho_t.max(1e-4));
    let scale = (0.98 / (d + t)).min(1.0);
    let (d, t) = (d * scale, t * scale);
    let slab = inverse::invert(d, t, 1.0, 1e-6, 1e-6);
    let delta = slab.sigma_a + slab.sigma_s;
    if !(delta.is_finite() && delta > 0.0) {
        return DARK;
    }
    let medium = SlabMedium::new(slab.sigma_s / delta, slab.sigma_a / delta);
    let [mut up, mut down] = [0.0; 2];
    for (mu, weight) in mesophyll_base::quadrature::unit(NODES) {
        let (r, ln_t) = medium.solve_log(mu, delta);
        up += 2.0 * mu * r * weight;
        down += 2.0 * mu * ln_t.exp() * weight;
    }
    let (r, ln_t) = medium.solve_log(1.0, delta);
    let found = [up / r, down / ln_t.exp()];
    if found.iter().all(|v| v.is_finite() && *v > 0.0) { found } else { DARK }
}

/// The share of even light that a smooth surface of refractive index `n` ≥ 1 reflects.
pub fn fresnel(n: f64) -> f64 {
    if n < 1.0 + 1e-4 {
        return 0.0;
    }
    let (p, q) = (n * n, n.powi(4));
    0.5 + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * (n + 1.0).powi(2))
        + p * (p - 1.0).powi(2) / (p + 1.0).powi(3) * ((n - 1.0) / (n + 1.0)).ln()
        - 2.0 * n.powi(3) * (p + 2.0 * n - 1.0) / ((p + 1.0) * (q - 1.0))
        + 8.0 * q * (q + 1.0) / ((p + 1.0) * (q - 1.0).powi(2)) * n.ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesophyll_optics::gloss;
    use mesophyll_optics::slab::medium::response;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn the_closed_form_is_fresnels_law_from_all_sides() {
        for n in [1.05, 1.2, 1.4, 1.7, 2.5] {
            let steps = 200_000;
            let at = |k: usize| gloss::fresnel(((k as f64 + 0.5) / f64::from(steps)).sqrt(), n) / f64::from(steps);
            let direct: f64 = (0..steps as usize).map(at).sum();
            assert!((fresnel(n) - direct).abs() < 1e-5, "{n}: {} {direct}", fresnel(n));
        }
        assert_eq!(fresnel(1.0), 0.0);
    }

    /// Photons walk through a leaf that lies on a light table. By reciprocity, each starts at the camera, along the
    /// normal. Those that reach the table count as its light; it throws the share r back as even light, which the
    /// leaf's underside partly returns. So the mean number of visits is what the camera sees over the bare table.
    #[test]
    fn a_walk_between_leaf_and_table_is_the_series() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(5);
        let (r, photons) = (0.5, 400_000);
        for (omega, delta) in [(0.95, 2.0), (0.6, 1.2)] {
            let (mut visits, mut squares) = (0.0f64, 0.0);
            for _ in 0..photons {
                let (mut depth, mut mu, mut seen) = (0.0f64, 1.0f64, 0.0f64);
                loop {
                    depth -= mu * (1.0 - rng.random::<f64>()).ln();
                    if depth < 0.0 {
                        break;
                    } else if depth > delta {
                        seen += 1.0;
                        if rng.random::<f64>() > r {
                            break;
                        }
                        (depth, mu) = (delta, -rng.random::<f64>().sqrt());
                    } else if rng.random::<f64>() > omega {
                        break;
                    } else {
                        mu = 2.0 * rng.random::<f64>() - 1.0;
                    }
                }
                visits += seen;
                squares += seen * seen;
            }
            let n = f64::from(photons);
            let (mean, sd) = (visits / n, (squares / n - (visits / n).powi(2)).sqrt() / n.sqrt());
            let slab = response((1.0 - omega) * delta, omega * delta, 1.0);
            let [up, down] = over_normal(slab.rho_d, slab.rho_t);
            let series = slab.rho_t / (1.0 - r * up * slab.rho_d);
            let normal = slab.rho_t / (1.0 - r * slab.rho_d);
            println!(
                "ω {omega}, Δ {delta}: walk {mean:.5} ± {sd:.5}, series {series:.5}, along the normal {normal:.5}"
            );
            assert!((mean - series).abs() < 4.0 * sd + 1e-3 * series, "{mean} ± {sd}, {series}");
            assert!(up > 1.05 && down < 1.0);
        }
    }
}
