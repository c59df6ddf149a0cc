//! A sky of any radiance for the reference renderer. It uses the true function of direction, and never its harmonics.
//!
//! Diffuse light is integrated by a product rule over the sphere for a grid of normals, and interpolated between them
//! (errors of a few 1e-4, tested). Glossy light is sampled for every ray, by half vectors drawn from the lobe's slope
//! density. The horizon and the sun's disk bound surfaces of their own, so that no pixel across their edges counts as
//! interior.

use super::lobe::{COS_VIEW_FLOOR, Lobe, M_FLOOR};
use super::world::ReferenceSun;
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Radiance of each channel from a unit direction, all around.
pub type RadianceAt = Arc<dyn Fn(DVec3) -> [f64; 3] + Send + Sync>;

/// A direction of a rule over the sphere.
#[derive(Debug, Clone, Copy)]
pub struct DomeNode {
    /// A unit vector towards the light.
    pub direction: DVec3,
    /// The light from there: radiance times solid angle.
    pub light: [f64; 3],
}

/// A sky that depends on direction. Nothing shades it.
#[derive(Clone)]
pub struct ReferenceDome {
    /// The radiance that lights the leaves.
    pub radiance: RadianceAt,
    /// The radiance that is drawn below the horizon, where that is one colour.
    pub seen_below: Option<[f64; 3]>,
    /// The directions over whose light irradiance is the sum. `None`: a rule for skies that are smooth above the
    /// horizon and below it.
    pub nodes: Option<Arc<Vec<DomeNode>>>,
}

impl std::fmt::Debug for ReferenceDome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Dome")
    }
}

/// The surface number of a ray that met no leaf: above the horizon, below it, or the sun.
pub(super) const ABOVE: u32 = 0;
pub(super) const BELOW: u32 = u32::MAX - 1;
pub(super) const DISK: u32 = u32::MAX - 2;

impl ReferenceDome {
    /// The radiance that is seen in a direction, without the sun. A model's blue may be slightly negative, which is 0.
    pub fn behind(&self, d: DVec3) -> [f64; 3] {
        let below = self.seen_below.filter(|_| d.z <= 0.0);
        below.unwrap_or_else(|| (self.radiance)(d).map(|v| v.max(0.0)))
    }

    /// The radiance that is seen in a direction: the sky, with the sun's disk in front of it.
    pub(super) fn seen(&self, d: DVec3, sun: Option<&ReferenceSun>) -> ([f64; 3], u32) {
        let mut radiance = self.behind(d);
        if d.z <= 0.0 && self.seen_below.is_some() {
            return (radiance, BELOW);
        }
        if let Some(sun) = sun
            && sun.radius > 0.0
            && d.angle_between(sun.direction) < sun.radius
        {
            let share = PI * sun.radius.sin().powi(2);
            (0..3).for_each(|c| radiance[c] += sun.irradiance[c] / share);
            return (radiance, DISK);
        }
        (radiance, ABOVE)
    }
}

/// The irradiance on any normal.
#[derive(Debug, Clone)]
pub struct IrradianceMap {
    values: Vec<[f64; 3]>,
}

/// The grid of normals: steps of 3° in polar angle and in azimuth.
const RINGS: usize = 61;
const SPOKES: usize = 120;

impl IrradianceMap {
    /// Integrates `dome` for every normal of the grid.
    pub fn new(dome: &ReferenceDome) -> IrradianceMap {
        let own = || Arc::new(nodes(dome));
        let nodes = dome.nodes.clone().unwrap_or_else(own);
        let values = (0..RINGS * SPOKES)
            .into_par_iter()
            .map(|k| {
                let n = direction((k / SPOKES) as f64, (k % SPOKES) as f64);
                nodes.iter().fold([0.0; 3], |sum, DomeNode { direction, light: l }| {
                    let c = n.dot(*direction).max(0.0);
                    [sum[0] + c * l[0], sum[1] + c * l[1], sum[2] + c * l[2]]
                })
            })
            .collect();
        IrradianceMap { values }
    }

    /// The irradiance on the unit normal `n`.
    pub fn at(&self, n: DVec3) -> [f64; 3] {
        let x = n.z.clamp(-1.0, 1.0).acos() / PI * (RINGS - 1) as f64;
        let y = (n.y.atan2(n.x) / TAU).rem_euclid(1.0) * SPOKES as f64;
        let (i, k) = ((x as usize).min(RINGS - 2), (y as usize).min(SPOKES - 1));
        let (s, t) = (x - i as f64, y - k as f64);
        let get = |i: usize, k: usize| self.values[i * SPOKES + k % SPOKES];
        let (a, b, c, d) = (get(i, k), get(i, k + 1), get(i + 1, k), get(i + 1, k + 1));
        [0, 1, 2].map(|q| (a[q] * (1.0 - t) + b[q] * t) * (1.0 - s) + (c[q] * (1.0 - t) + d[q] * t) * s)
    }
}

/// Nodes of a product rule over the sphere.
fn nodes(dome: &ReferenceDome) -> Vec<DomeNode> {
    let mut nodes: Vec<DomeNode> = Vec::new();
    // Nodes with z = ±t² are dense near the horizon, where skies change fastest and the ground begins.
    for (sign, rings, spokes) in [(1.0, 80, 192), (-1.0, 64, 96)] {
        for i in 0..rings {
            let t = (f64::from(i) + 0.5) / f64::from(rings);
            let z = sign * t * t;
            let s = (1.0 - z * z).sqrt();
            for k in 0..spokes {
                let (sin, cos) = (TAU * (f64::from(k) + 0.5) / f64::from(spokes)).sin_cos();
                let d = DVec3::new(s * cos, s * sin, z);
                let weight = 2.0 * t / f64::from(rings) * TAU / f64::from(spokes);
                nodes.push(DomeNode { direction: d, light: (dome.radiance)(d).map(|v| v * weight) });
            }
        }
    }
    nodes
}

fn direction(ring: f64, spoke: f64) -> DVec3 {
    let (theta, phi) = (PI * ring / (RINGS - 1) as f64, TAU * spoke / SPOKES as f64);
    DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}

/// A light direction for a half vector that is drawn from D cosα by two uniform numbers. Its weight is f_s
/// (N·l)/density for ρs = 1, which is F·G·(v·h)/((N·v) cosα). `None` where no light can come from.
pub fn reflected(lobe: Lobe, n: DVec3, v: DVec3, m: f64, [u, w]: [f64; 2]) -> Option<(DVec3, f64)> {
    let m = m.max(M_FLOOR);
    let tan = lobe.quantile(u, m).sqrt();
    let (a, b) = n.any_orthonormal_pair();
    let (sin, cos) = (TAU * w).sin_cos();
    let h = (n + (a * cos + b * sin) * tan).normalize();
    let (cos_h, v_h, cos_v) = (n.dot(h), v.dot(h), n.dot(v).max(COS_VIEW_FLOOR));
    let l = h * (2.0 * v_h) - v;
    let cos_l = n.dot(l);
    if v_h <= 0.0 || cos_l <= 0.0 {
        return None;
    }
    let cavity = 1f64.min(2.0 * cos_h * cos_v / v_h).min(2.0 * cos_h * cos_l / v_h);
    Some((l, lobe.fresnel(v_h) * cavity * v_h / (cos_v * cos_h)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lobe::ReflectionLobe;

    /// The irradiance of a linear sky is π + 2π/3 a·n; that of a uniform upper half is π (1 + cosθ)/2.
    #[test]
    fn irradiance_meets_its_closed_forms() {
        let a = DVec3::new(0.3, -0.5, 0.6);
        let of = |radiance: RadianceAt| {
            IrradianceMap::new(&ReferenceDome { radiance, seen_below: Some([0.0; 3]), nodes: None })
        };
        let linear = of(Arc::new(move |d| [1.0 + a.dot(d); 3]));
        let half = of(Arc::new(|d| if d.z > 0.0 { [1.0; 3] } else { [0.0; 3] }));
        for k in 0..200 {
            let f = f64::from(k);
            let z: f64 = 1.0 - 2.0 * (f + 0.5) / 200.0;
            let n = DVec3::new((1.0 - z * z).sqrt() * (2.4 * f).cos(), (1.0 - z * z).sqrt() * (2.4 * f).sin(), z);
            let want = PI + TAU / 3.0 * a.dot(n);
            assert!((linear.at(n)[0] / want - 1.0).abs() < 1e-3, "{n}: {} {want}", linear.at(n)[0]);
            let want = PI * (1.0 + z) / 2.0;
            assert!((half.at(n)[1] - want).abs() < 1e-3 * PI, "{n}: {} {want}", half.at(n)[1]);
        }
    }

    /// ∫ f/ρs cosθ dω by a plain grid, even in sin²θ and azimuth, over the lobes as the papers write them (Beckmann:
    /// Wang et al. 2005, Eq. 7; GGX: Walter et al. 2007, Eq. 33; V-cavities and Fresnel: Cook & Torrance 1982). It uses
    /// no code of the renderer.
    fn albedo(lobe: Lobe, theta: f64, m: f64) -> f64 {
        let (nv, sin_v, n) = (theta.cos(), theta.sin(), 1500);
        let mut sum = 0.0;
        for i in 0..n {
            let sin2 = (f64::from(i) + 0.5) / f64::from(n);
            let nl = (1.0 - sin2).sqrt();
            for k in 0..n {
                let x = sin2.sqrt() * (PI * (f64::from(k) + 0.5) / f64::from(n)).cos();
                // v·l gives the cosines of the half vector without computing the vector.
                let vh = ((1.0 + nv * nl + sin_v * x) / 2.0).sqrt();
                let nh = (nv + nl) / (2.0 * vh);
                let (cos2, m2) = (nh * nh, m * m);
                let tan2 = (1.0 / cos2 - 1.0).max(0.0);
                let density = match lobe {
                    Lobe::Ggx => m2 / (PI * cos2 * cos2 * (m2 + tan2).powi(2)),
                    _ => (-tan2 / m2).exp() / (PI * m2 * cos2 * cos2),
                };
                let cavity = (2.0 * nh * nv / vh).min(2.0 * nh * nl / vh).min(1.0);
                let fresnel = match lobe {
                    Lobe::CookTorrance { index } => {
                        let g = (index * index + vh * vh - 1.0).sqrt();
                        let ratio = (vh * (g + vh) - 1.0) / (vh * (g - vh) + 1.0);
                        0.5 * ((g - vh) / (g + vh)).powi(2) * (1.0 + ratio * ratio)
                    }
                    _ => 1.0,
                };
                sum += density * cavity * fresnel / (4.0 * nl * nv);
            }
        }
        PI * sum / f64::from(n * n)
    }

    /// The mean weight of the samples is the directional albedo.
    #[test]
    fn samples_weigh_as_much_as_the_lobe_reflects() {
        for lobe in [Lobe::Beckmann, Lobe::Ggx, Lobe::CookTorrance { index: 1.45 }] {
            for (theta, m) in [(0.2f64, 0.3), (1.1, 0.2), (1.3, 0.5)] {
                let v = DVec3::new(theta.sin(), 0.0, theta.cos());
                let count = 20_000u32;
                let sum: f64 = (0..count)
                    .map(|k| {
                        let [a, b, ..] = sobol_burley::sample_4d(k, 0, 5);
                        reflected(lobe, DVec3::Z, v, m, [f64::from(a), f64::from(b)]).map_or(0.0, |(_, w)| w)
                    })
                    .sum();
                let (got, table, want) =
                    (sum / f64::from(count), lobe.directional_albedo(theta.cos(), m), albedo(lobe, theta, m));
                assert!(
                    (got - want).abs() < 2e-3 && (table - want).abs() < 2e-3,
                    "{lobe:?} {theta} {m}: {got} {table} {want}"
                );
            }
        }
    }
}
