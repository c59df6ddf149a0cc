//! A point of a leaf in our own model, and as another program's material shows it.

use crate::foreign::micro::{MicrofacetLobe, conductor, half};
use mesophyll_base::surface::gloss::{Lobe, dot, fresnel};
use mesophyll_base::surface::side::{Side, Sides};
use std::f64::consts::PI;

/// One side of a leaf at a point.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ExportTexelSide {
    /// Diffuse reflectance.
    pub rho_d: [f64; 3],
    /// Transmittance for light that enters this side.
    pub rho_t: [f64; 3],
    /// Gloss; 0 is a matte side.
    pub rho_s: [f64; 3],
    /// Slope of the gloss.
    pub m: f64,
}

/// A point of a leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExportTexel {
    /// Both sides.
    pub sides: Sides<ExportTexelSide>,
    /// The lobe of the gloss.
    pub lobe: Lobe,
}

impl ExportTexel {
    /// f_r (1/sr) seen from a side, for directions above it.
    pub fn reflected(&self, side: Side, v: [f64; 3], l: [f64; 3]) -> [f64; 3] {
        let part = &self.sides[side];
        let shine = if part.rho_s.iter().any(|r| *r > 0.0) {
            self.lobe.bounded([0.0, 0.0, 1.0], l, v, part.m.max(1e-3))
        } else {
            0.0
        };
        [0, 1, 2].map(|c| part.rho_d[c] / PI + part.rho_s[c] * shine)
    }

    /// f_t (1/sr) seen from a side.
    pub fn through(&self, side: Side) -> [f64; 3] {
        self.sides[side.other()].rho_t.map(|r| r / PI)
    }
}

/// What lies between the gloss and the diffuse light of a material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DiffuseCoupling {
    /// Both are added.
    Added,
    /// Diffuse light keeps what the largest Fresnel factor leaves: 1 − max F(v·h) (glTF).
    Facet,
    /// Diffuse light keeps 1 − E(v), where E is the directional albedo of the gloss without its colour (OpenPBR).
    Albedo,
}

/// The gloss of a material: D·G/(4 cosθi cosθo) times a factor of v·h for each colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaterialGloss {
    /// Its lobe.
    pub micro: MicrofacetLobe,
    /// Its slope.
    pub alpha: f64,
    /// The factor at normal incidence, and at grazing incidence (Schlick 1994).
    pub colour: [[f64; 3]; 2],
    /// Index of a dielectric whose Fresnel factor multiplies it.
    pub index: Option<f64>,
    /// k of a conductor for each colour, whose Fresnel factor multiplies it.
    pub metal: Option<[f64; 3]>,
}

impl MaterialGloss {
    /// The factor at v·h.
    pub fn factor(&self, vh: f64) -> [f64; 3] {
        let x = (1.0 - vh).clamp(0.0, 1.0).powi(5);
        let f = self.index.map_or(1.0, |n| fresnel(vh, n));
        let [normal, grazing] = self.colour;
        [0, 1, 2].map(|c| {
            let metal = self.metal.map_or(1.0, |k| conductor(vh, k[c]));
            f * metal * (normal[c] + (grazing[c] - normal[c]) * x)
        })
    }

    /// The directional albedo of the lobe with its Fresnel factor, without colour.
    pub fn albedo(&self, cos: f64) -> f64 {
        let v = [(1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos];
        let lobe = self.micro.slopes.lobe();
        let (rings, azimuths, mut sum) = (20, 32, 0.0);
        for (x, w) in mesophyll_base::quadrature::unit(rings) {
            let tan2 = lobe.quantile(x, self.alpha);
            let c = 1.0 / (1.0 + tan2).sqrt();
            let s = (1.0 - c * c).max(0.0).sqrt();
            for k in 0..azimuths {
                let phi = PI * (f64::from(k) + 0.5) / f64::from(azimuths);
                let h = [s * phi.cos(), s * phi.sin(), c];
                let vh = dot(v, h);
                let l = [0, 1, 2].map(|i| 2.0 * vh * h[i] - v[i]);
                let density = lobe.distribution(tan2, self.alpha) * c / (4.0 * vh);
                if vh > 0.0 && l[2] > 0.0 {
                    let f = self.index.map_or(1.0, |n| fresnel(vh, n));
                    sum += w / f64::from(azimuths) * f * self.micro.value(v, l, self.alpha) * l[2] / density;
                }
            }
        }
        sum
    }
}

/// A point of a leaf as a material shows it from one side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaterialTexel {
    /// Matte reflection.
    pub diffuse: [f64; 3],
    /// Matte transmission.
    pub through: [f64; 3],
    /// Gloss.
    pub shine: Option<MaterialGloss>,
    /// What the gloss leaves to the diffuse light.
    pub under: DiffuseCoupling,
}

impl MaterialTexel {
    /// What is left of diffuse light for a viewer at `v`, which is the same for all lights.
    pub fn left(&self, v: [f64; 3]) -> f64 {
        match (self.under, &self.shine) {
            (DiffuseCoupling::Albedo, Some(shine)) => 1.0 - shine.albedo(v[2]),
            _ => 1.0,
        }
    }

    /// f_r and f_t (1/sr) for a viewer and a light above the surface, and for the same light below it. `left` is
    /// [`MaterialTexel::left`].
    pub fn both(&self, v: [f64; 3], l: [f64; 3], left: f64) -> [[f64; 3]; 2] {
        let vh = dot(v, half(v, l));
        let factor = self.shine.map_or([0.0; 3], |s| s.factor(vh));
        let lobe = self.shine.map_or(0.0, |s| s.micro.value(v, l, s.alpha));
        let left = match self.under {
            DiffuseCoupling::Facet => 1.0 - factor.iter().copied().fold(0.0, f64::max),
            DiffuseCoupling::Added | DiffuseCoupling::Albedo => left,
        };
        let reflected = [0, 1, 2].map(|c| left * self.diffuse[c] / PI + factor[c] * lobe);
        [reflected, self.through.map(|t| left * t / PI)]
    }
}
