//! Surface reflection f_s for ρs = 1, bounded, and its directional albedo by quadrature.
//!
//! f_s = ρs·D·G/(4 (N·l)(N·v)) with a V-cavity factor G (Torrance & Sparrow 1967), D of W Eq. 7 (Beckmann) or GGX
//! (Walter et al. 2007, Eq. 33), and for Cook–Torrance (1982) the dielectric Fresnel factor. The slope m is above 0,
//! and angles are given by unit vectors. Limits: light scatters once in the surface (no inter-reflection between
//! facets), and N·v is at least 1e-3.

use super::quadrature::{adaptive, sixteen};
use glam::DVec3;
pub use mesophyll_optics::gloss::Lobe;
use std::f64::consts::PI;

/// The smallest cosine of a view. More grazing views are evaluated at this cosine.
pub const COS_VIEW_FLOOR: f64 = 1e-3;
/// The smallest slope. A smoother surface is drawn with this one.
pub const M_FLOOR: f64 = 1e-3;

/// The lobe with which scenes are lit: bounded by G, with the same smallest values as in the renderer, and with its
/// albedo by quadrature. D and F are those of [`Lobe`]; the renderer's shader computes them independently.
pub trait ReflectionLobe: Copy {
    /// D (1/sr), the density of the facets' slopes, where ∫ D cosα dω = 1. `cos` is cosα = N·h > 0.
    fn density(self, cos: f64, m: f64) -> f64;

    /// f_s/ρs times N·l (1/sr) for unit vectors. The product stays finite as N·l → 0, and is 0 where N·l ≤ 0.
    fn times_cosine(self, n: DVec3, v: DVec3, l: DVec3, m: f64) -> f64;

    /// The same, but without G where `bounded` is false: Wang et al. 2005, Eq. 7, with which leaves are fitted.
    fn with_cosine(self, n: DVec3, v: DVec3, l: DVec3, m: f64, bounded: bool) -> f64;

    /// a(N·v, m) = ∫ f_s/ρs (N·l) dω_l to about 1e-8, by an integral over the half vector.
    ///
    /// With dω_l = 4 (v·h) dω_h it becomes ∫ D cosα dω_h · G F (v·h)/(cosα N·v). Consider the plane of incidence with
    /// the view at θ, so that l is at 2α−θ or −(2α+θ). The integrand over α has kinks only where G changes its branch
    /// or l reaches the horizon there: α = θ, π/2−θ, π/4±θ/2, (π/2±θ)/3. Between the kinks it is smooth except for
    /// powers 3/2 at the ends, which the substitution α = a + (b−a) u²(3−2u) removes.
    fn directional_albedo(self, cos_view: f64, m: f64) -> f64;
}

impl ReflectionLobe for Lobe {
    fn density(self, cos: f64, m: f64) -> f64 {
        let cos2 = cos * cos;
        self.distribution((1.0 - cos2).max(0.0) / cos2, m)
    }

    fn times_cosine(self, n: DVec3, v: DVec3, l: DVec3, m: f64) -> f64 {
        self.with_cosine(n, v, l, m, true)
    }

    fn with_cosine(self, n: DVec3, v: DVec3, l: DVec3, m: f64, bounded: bool) -> f64 {
        let cos_l = n.dot(l);
        if cos_l <= 0.0 {
            return 0.0;
        }
        let cos_v = n.dot(v).max(COS_VIEW_FLOOR);
        let h = v + l;
        let length = h.length();
        if length < 1e-12 {
            return 0.0;
        }
        let h = h / length;
        let (cos_h, v_h) = (n.dot(h), v.dot(h));
        if cos_h <= 0.0 || v_h <= 0.0 {
            return 0.0;
        }
        let cavity = if bounded { 1f64.min(2.0 * cos_h * cos_v / v_h).min(2.0 * cos_h * cos_l / v_h) } else { 1.0 };
        self.density(cos_h, m.max(M_FLOOR)) * cavity * self.fresnel(v_h) / (4.0 * cos_v)
    }

    fn directional_albedo(self, cos_view: f64, m: f64) -> f64 {
        let mu = cos_view.clamp(COS_VIEW_FLOOR, 1.0);
        let m = m.max(M_FLOOR);
        let theta = mu.acos();
        let quarter = 0.5 * PI;
        // The last slopes only keep the pieces short where D varies.
        let mut cuts =
            [theta, quarter - theta, 0.5 * (quarter - theta), 0.5 * (quarter + theta), (quarter - theta) / 3.0]
                .into_iter()
                .chain([
                    (quarter + theta) / 3.0,
                    m.atan(),
                    (2.5 * m).atan(),
                    (7.0 * m).atan(),
                    (40.0 * m).atan(),
                    0.0,
                    quarter,
                ])
                .collect::<Vec<f64>>();
        cuts.sort_by(f64::total_cmp);
        let mut sum = 0.0;
        for pair in cuts.windows(2).filter(|p| p[1] - p[0] > 1e-12) {
            let length = pair[1] - pair[0];
            sum += adaptive(0.0, 1.0, 2e-9, &mut |u: f64| {
                let alpha = pair[0] + length * u * u * (3.0 - 2.0 * u);
                let (sin, cos) = alpha.sin_cos();
                let density = 2.0 * PI * self.density(cos, m) * sin * cos;
                if density < 1e-30 { 0.0 } else { density * length * 6.0 * u * (1.0 - u) * over_azimuth(self, mu, cos) }
            });
        }
        sum
    }
}

/// The mean over azimuth of G F (v·h)/(cosα N·v) at fixed α. Let x = v·h = centre + reach·cosφ. Each branch of G
/// (v·h)/(cosα N·v) is a + b·x, so only Fresnel's factor needs nodes.
fn over_azimuth(lobe: Lobe, mu: f64, c: f64) -> f64 {
    let (centre, reach) = (c * mu, (1.0 - c * c).max(0.0).sqrt() * (1.0 - mu * mu).max(0.0).sqrt());
    // The branches: the facet is fully seen and lit, hidden from the view, or hidden from the light.
    let branches = [(0.0, 1.0 / (mu * c)), (2.0, 0.0), (-2.0, 4.0 * c / mu)];
    let least = |x: f64| {
        let value = |(a, b): (f64, f64)| a + b * x;
        branches
            .into_iter()
            .fold((f64::INFINITY, 0.0), |best, next| if value(next) < value(best) { next } else { best })
    };
    let lowest = mu / (2.0 * c);
    if reach < 1e-14 {
        let (a, b) = least(centre);
        return if centre > lowest { (a + b * centre) * lobe.fresnel(centre) } else { 0.0 };
    }
    let azimuth = |x: f64| ((x - centre) / reach).clamp(-1.0, 1.0).acos();
    // x decreases with φ, so l is above the horizon for azimuths from 0 to `last`.
    let last = azimuth(lowest);
    let lit_from = if 4.0 * c * c > 1.0 { 2.0 * c * mu / (4.0 * c * c - 1.0) } else { f64::INFINITY };
    let mut cuts = [last, azimuth(mu / c).min(last), azimuth(2.0 * c * mu).min(last), azimuth(lit_from).min(last)];
    cuts.sort_by(f64::total_cmp);
    let (mut sum, mut from) = (0.0, 0.0);
    for to in cuts {
        if to > from {
            let (a, b) = least(centre + reach * (0.5 * (from + to)).cos());
            sum += if lobe.index().is_some() {
                sixteen().integrate(from, to, |phi| {
                    let x = centre + reach * phi.cos();
                    (a + b * x) * lobe.fresnel(x)
                })
            } else {
                (a + b * centre) * (to - from) + b * reach * (to.sin() - from.sin())
            };
            from = to;
        }
    }
    sum / PI
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    fn at(theta: f64, phi: f64) -> DVec3 {
        DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
    }

    #[test]
    fn slope_densities_integrate_to_one() {
        for lobe in Lobe::all(1.45) {
            for m in [0.05, 0.3, 0.8] {
                let sum = adaptive(0.0, PI / 2.0, 1e-10, &mut |a: f64| {
                    2.0 * PI * a.sin() * a.cos() * lobe.density(a.cos(), m)
                });
                assert!((sum - 1.0).abs() < 1e-8, "{lobe:?} {m}: {sum}");
            }
        }
    }

    /// By brute force: cosine-weighted directions over the hemisphere, with f_s as the renderer evaluates it.
    #[test]
    fn albedo_agrees_with_monte_carlo_over_the_hemisphere() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(7);
        for lobe in Lobe::all(1.45) {
            for (theta, m) in [(0.0, 0.5), (0.6, 0.25), (1.2, 0.4), (1.4, 0.6)] {
                let v = at(theta, 0.3);
                let (mut sum, mut square) = (0.0, 0.0);
                let n = 90_000;
                for _ in 0..n {
                    let (r, phi) = (rng.random::<f64>().sqrt(), 2.0 * PI * rng.random::<f64>());
                    let l = DVec3::new(r * phi.cos(), r * phi.sin(), (1.0 - r * r).sqrt());
                    // The density is cosθ/π.
                    let x = if l.z > 0.0 { lobe.times_cosine(DVec3::Z, v, l, m) * PI / l.z } else { 0.0 };
                    sum += x;
                    square += x * x;
                }
                let mean = sum / n as f64;
                let error = ((square / n as f64 - mean * mean) / n as f64).sqrt();
                let exact = lobe.directional_albedo(theta.cos(), m);
                assert!(
                    error < 0.03 * exact.max(0.05),
                    "{lobe:?} {theta} {m}: the Monte Carlo is too coarse, ±{error}"
                );
                assert!((mean - exact).abs() < 4.5 * error, "{lobe:?} {theta} {m}: {mean} ± {error} against {exact}");
                assert!(exact <= 1.0 + 1e-9, "{lobe:?} {theta} {m}: {exact} exceeds one");
            }
        }
    }

    /// The same integral over directions instead of half vectors, by nested quadrature, has no sampling noise.
    #[test]
    fn albedo_agrees_with_quadrature_over_directions() {
        for lobe in Lobe::all(1.45) {
            for (mu, m) in [(0.9f64, 0.3), (0.3, 0.5)] {
                let v = at(mu.acos(), 0.0);
                let direct = adaptive(0.0, PI, 2e-6, &mut |phi: f64| {
                    adaptive(0.0, PI / 2.0, 1e-6, &mut |t: f64| {
                        2.0 * t.sin() * lobe.times_cosine(DVec3::Z, v, at(t, phi), m)
                    })
                });
                let half = lobe.directional_albedo(mu, m);
                assert!((direct - half).abs() < 2e-5, "{lobe:?} {mu} {m}: {direct} {half}");
            }
        }
    }

    #[test]
    fn reflection_is_reciprocal() {
        let (v, l) = (at(0.4, 0.1), at(1.0, 2.0));
        for lobe in Lobe::all(1.45) {
            let there = lobe.times_cosine(DVec3::Z, v, l, 0.4) / l.z;
            let back = lobe.times_cosine(DVec3::Z, l, v, 0.4) / v.z;
            assert!((there / back - 1.0).abs() < 1e-12);
        }
    }
}
