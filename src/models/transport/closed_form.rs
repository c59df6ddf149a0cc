//! The radiance of a flat leaf of one colour in closed form, with which both renderers must agree.
//!
//! A card has uniform ρd, ρt, ρs and m, no mapped normals, and nothing hides the sun. The formulas use angles instead
//! of vectors. Of the lobe, this module shares D and F with the reference renderer, and nothing with the other
//! renderer. Limits: only the sun's centre counts, which is an error of the order of its radius squared over m²
//! (2e-5/m² for the real sun).

use super::camera::{CameraRays, ReferenceCamera};
use super::lobe::{COS_VIEW_FLOOR, Lobe, ReflectionLobe};
use super::world::ReferenceSun;
use crate::Result;
use glam::DVec3;
use std::f64::consts::PI;

/// A uniform leaf as seen from one of its sides.
#[derive(Debug, Clone, Copy)]
pub struct FlatLeaf {
    /// ρd (with γ), ρs and m of the side that is seen.
    pub rho_d: [f64; 3],
    /// ρs of the gloss, for each channel.
    pub rho_s: [f64; 3],
    /// Slope m of the surface.
    pub m: f64,
    /// The lobe of the gloss.
    pub lobe: Lobe,
    /// ρt of a beam that enters the other side.
    pub rho_t_far: [f64; 3],
    /// The normal, out of the side that is seen.
    pub normal: DVec3,
}

impl FlatLeaf {
    /// Radiance towards the unit vector `view` (which must lie on the normal's side).
    pub fn radiance(&self, view: DVec3, sun: Option<&ReferenceSun>, sky: Option<[f64; 3]>) -> [f64; 3] {
        let normal = self.normal.normalize();
        let view = view.normalize();
        let cos_view = normal.dot(view).max(COS_VIEW_FLOOR);
        let mut radiance = [0.0; 3];
        if let Some(sun) = sun {
            let l = sun.direction.normalize();
            let cos_sun = normal.dot(l);
            let shine = if cos_sun > 0.0 { self.shine(cos_sun, cos_view, l.dot(view)) } else { 0.0 };
            let diffuse = if cos_sun > 0.0 { self.rho_d } else { self.rho_t_far };
            radiance = [0, 1, 2].map(|c| sun.irradiance[c] * cos_sun.abs() * (diffuse[c] / PI + self.rho_s[c] * shine));
        }
        if let Some(sky) = sky {
            let albedo = if self.rho_s == [0.0; 3] { 0.0 } else { self.lobe.directional_albedo(cos_view, self.m) };
            for (c, radiance) in radiance.iter_mut().enumerate() {
                *radiance += sky[c] * (self.rho_d[c] + self.rho_t_far[c] + self.rho_s[c] * albedo);
            }
        }
        radiance
    }

    /// The contribution of a dome, by plain midpoint rules. `near` and `beyond` are its irradiances ([`irradiance`]) on
    /// the normal and on the opposite direction.
    pub fn under_dome(
        &self,
        view: DVec3,
        near: [f64; 3],
        beyond: [f64; 3],
        radiance: &dyn Fn(DVec3) -> [f64; 3],
    ) -> [f64; 3] {
        let mut out = [0, 1, 2].map(|c| (self.rho_d[c] * near[c] + self.rho_t_far[c] * beyond[c]) / PI);
        if self.rho_s == [0.0; 3] {
            return out;
        }
        let (n, v) = (self.normal.normalize(), view.normalize());
        let cos_view = n.dot(v).max(COS_VIEW_FLOOR);
        let (a, b) = n.any_orthonormal_pair();
        let (rings, spokes) = (48, 96);
        // Half vectors are drawn by slope: ∫ D cosα dω_h is 1, and f_s cosθ dω_l is D G F (v·h)/(N·v) dω_h.
        for i in 0..rings {
            let share = (f64::from(i) + 0.5) / f64::from(rings);
            let alpha = self.lobe.quantile(share, self.m).sqrt().atan();
            for k in 0..spokes {
                let (sin, cos) = (2.0 * PI * (f64::from(k) + 0.5) / f64::from(spokes)).sin_cos();
                let h = n * alpha.cos() + (a * cos + b * sin) * alpha.sin();
                let cos_half = v.dot(h);
                let l = h * (2.0 * cos_half) - v;
                let cos_light = n.dot(l);
                if cos_half > 0.0 && cos_light > 0.0 {
                    let cavity = (2.0 * alpha.cos() * cos_light.min(cos_view) / cos_half).min(1.0);
                    let weight = cavity * self.lobe.fresnel(cos_half) * cos_half / (cos_view * alpha.cos());
                    let light = radiance(l);
                    (0..3).for_each(|c| out[c] += self.rho_s[c] * weight * light[c] / f64::from(rings * spokes));
                }
            }
        }
        out
    }

    /// f_s/ρs (1/sr) from the cosines of sun and view and of the angle between them.
    fn shine(&self, cos_sun: f64, cos_view: f64, cos_between: f64) -> f64 {
        // The half vector lies at half of the angle between the two, and |v + l| = 2 cos(half).
        let half = 0.5 * cos_between.clamp(-1.0, 1.0).acos();
        let cos_alpha = (cos_sun + cos_view) / (2.0 * half.cos());
        let alpha = cos_alpha.clamp(-1.0, 1.0).acos();
        let d = self.lobe.distribution(alpha.tan().powi(2), self.m);
        let cavity = (2.0 * cos_alpha * cos_sun.min(cos_view) / half.cos()).min(1.0);
        d * cavity * self.lobe.fresnel(half.cos()) / (4.0 * cos_sun * cos_view)
    }

    /// The radiance at the centre of pixel (x, y), in a picture that shows the card there.
    pub fn pixel(
        &self,
        camera: &ReferenceCamera,
        size: (usize, usize),
        pixel: (usize, usize),
        sun: Option<&ReferenceSun>,
        sky: Option<[f64; 3]>,
    ) -> Result<[f64; 3]> {
        let ray = CameraRays::new(camera, size.0, size.1)?.ray(pixel.0 as f64 + 0.5, pixel.1 as f64 + 0.5);
        Ok(self.radiance(-ray.direction, sun, sky))
    }
}

/// Irradiance of a dome on the unit normal `n`, by a midpoint rule in elevation and azimuth. Steps in elevation are
/// even, so that the horizon is an edge of cells. Errors are below 1e-4 for skies that are smooth above the horizon.
pub fn irradiance(radiance: &dyn Fn(DVec3) -> [f64; 3], n: DVec3) -> [f64; 3] {
    let (rings, spokes) = (200, 400);
    let mut sum = [0.0; 3];
    for i in 0..2 * rings {
        let elevation = 0.5 * PI * ((f64::from(i) + 0.5) / f64::from(rings) - 1.0);
        let (z, s) = elevation.sin_cos();
        for k in 0..spokes {
            let (sin, cos) = (2.0 * PI * (f64::from(k) + 0.5) / f64::from(spokes)).sin_cos();
            let d = DVec3::new(s * cos, s * sin, z);
            let cosine = n.dot(d);
            if cosine > 0.0 {
                let weight = cosine * s * 0.5 * PI / f64::from(rings) * 2.0 * PI / f64::from(spokes);
                let light = radiance(d);
                (0..3).for_each(|c| sum[c] += weight * light[c]);
            }
        }
    }
    sum
}
