//! How light is turned at a point of a leaf: both ways' diffuse light and gloss, evaluated and drawn from.
//!
//! ```text
//! l on the viewed side:  f max(0, N·l) = ρd max(0, N·l)/π + ρs f_s(l) max(0, N·l)
//! l on the far side:     f max(0, F·l) = ρt max(0, F·l)/π
//! ```
//! N and F are the mapped normals of the viewed and the far side; the triangle decides which side `l` is on, so that
//! what a mapped normal would draw through the blade counts nothing.

use crate::lobe::{Lobe, M_FLOOR, Reflect};
use crate::stage::{Stage, Surface};
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// A point of a leaf as light meets it.
pub struct Scatter {
    view: DVec3,
    /// The triangle's normal on the viewed side.
    out: DVec3,
    normal: DVec3,
    far_normal: DVec3,
    rho_d: [f64; 3],
    rho_t: [f64; 3],
    gloss: Option<Gloss>,
    /// What stands in for ρt times a cosine for light from the sun's centre.
    sunlit: Option<[f64; 3]>,
    /// Probability to draw from ρd, ρt and gloss.
    choice: [f64; 3],
}

struct Gloss {
    rho_s: [f64; 3],
    m: f64,
    lobe: Lobe,
}

/// A drawn direction.
pub struct Turn {
    /// Unit vector that the light comes from.
    pub direction: DVec3,
    /// f times cosine over the density.
    pub weight: [f64; 3],
    /// Density (1/sr).
    pub density: f64,
    /// Whether the light comes through the leaf.
    pub through: bool,
}

impl Scatter {
    /// The point that `surface` tells of; `carried` is what the path so far lets through of each channel, and weighs
    /// which lobe is drawn from. `rho_t` is of light that enters the far side where a path is followed against the
    /// light, and the viewed side where it is followed with it.
    pub fn new(stage: &Stage, surface: &Surface, carried: [f64; 3], rho_t: [f64; 3]) -> Scatter {
        let rho_d = surface.rho_d();
        let lobe = surface.lobe();
        let gloss = surface.gloss().map(|(rho_s, m)| Gloss { rho_s, m: m.max(M_FLOOR), lobe });
        let weigh = |rho: [f64; 3]| (0..3).map(|c| rho[c].max(0.0) * carried[c]).sum::<f64>();
        let shares = [weigh(rho_d), weigh(rho_t), gloss.as_ref().map_or(0.0, |g| weigh(g.rho_s))];
        let sum: f64 = shares.iter().sum();
        Scatter {
            view: surface.view,
            out: if surface.back { -surface.flat } else { surface.flat },
            normal: surface.normal(),
            far_normal: surface.far_normal(),
            rho_d,
            rho_t,
            gloss,
            sunlit: stage.sunlit(surface).map(|s| surface.through(s, || rho_t)),
            choice: if sum > 0.0 { shares.map(|s| s / sum) } else { [0.0; 3] },
        }
    }

    /// Whether the sun's light comes through by maps of its own, which only the light's own sampling knows of.
    pub fn sun_by_maps(&self) -> bool {
        self.sunlit.is_some()
    }

    /// Whether `l` is on the viewed side.
    pub fn faces(&self, l: DVec3) -> bool {
        self.out.dot(l) > 0.0
    }

    /// f times cosine (1/sr) for light from the unit direction `l`.
    pub fn times_cosine(&self, l: DVec3) -> [f64; 3] {
        if !self.faces(l) {
            let cos = self.far_normal.dot(l).max(0.0);
            return self.rho_t.map(|r| r * cos / PI);
        }
        let cos = self.normal.dot(l).max(0.0);
        let mut sum = self.rho_d.map(|r| r * cos / PI);
        if let Some(g) = &self.gloss {
            let f = g.lobe.times_cosine(self.normal, self.view, l, g.m);
            (0..3).for_each(|c| sum[c] += g.rho_s[c] * f);
        }
        sum
    }

    /// The same for light of the sun.
    pub fn times_cosine_of_sun(&self, l: DVec3) -> [f64; 3] {
        match self.sunlit {
            Some(through) if !self.faces(l) => through.map(|t| t / PI),
            _ => self.times_cosine(l),
        }
    }

    /// Density (1/sr) with which [`Scatter::draw`] gives the unit direction `l`.
    pub fn density(&self, l: DVec3) -> f64 {
        let mut sum =
            self.choice[0] * self.normal.dot(l).max(0.0) / PI + self.choice[1] * self.far_normal.dot(l).max(0.0) / PI;
        if let Some(g) = self.gloss.as_ref().filter(|_| self.choice[2] > 0.0) {
            let h = (self.view + l).normalize_or_zero();
            let (cos_h, v_h) = (self.normal.dot(h), self.view.dot(h));
            if cos_h > 0.0 && v_h > 0.0 {
                sum += self.choice[2] * g.lobe.density(cos_h, g.m) * cos_h / (4.0 * v_h);
            }
        }
        sum
    }

    /// Draws a direction by three uniform numbers; `None` where the drawn light counts nothing.
    pub fn draw(&self, [choice, u, v, _]: [f64; 4]) -> Option<Turn> {
        let [d, t, s] = self.choice;
        let direction = if choice < d {
            cosine(self.normal, u, v)
        } else if choice < d + t || s == 0.0 {
            cosine(self.far_normal, u, v)
        } else {
            let g = self.gloss.as_ref()?;
            let tan = g.lobe.quantile(u, g.m).sqrt();
            let (a, b) = self.normal.any_orthonormal_pair();
            let (sin, cos) = (TAU * v).sin_cos();
            let h = (self.normal + (a * cos + b * sin) * tan).normalize();
            let v_h = self.view.dot(h);
            // A facet that is turned away mirrors nothing; what it would give is no part of the density.
            if v_h <= 0.0 {
                return None;
            }
            h * (2.0 * v_h) - self.view
        };
        let density = self.density(direction);
        let f = self.times_cosine(direction);
        let counts = density > 0.0 && f.iter().any(|x| *x > 0.0);
        counts.then(|| Turn { direction, weight: f.map(|x| x / density), density, through: !self.faces(direction) })
    }
}

/// A direction around `n` with density cosθ/π.
fn cosine(n: DVec3, u: f64, v: f64) -> DVec3 {
    let (a, b) = n.any_orthonormal_pair();
    let (sin, cos) = (TAU * v).sin_cos();
    let r = u.sqrt();
    (a * (r * cos) + b * (r * sin) + n * (1.0 - u).max(0.0).sqrt()).normalize()
}

#[cfg(test)]
impl Scatter {
    /// A point of a level leaf that is seen from `view`, for tests.
    pub fn level(view: DVec3, rho: [f64; 2], gloss: Option<(f64, f64, Lobe)>) -> Scatter {
        let up = DVec3::Z * view.z.signum();
        let gloss = gloss.map(|(rho_s, m, lobe)| Gloss { rho_s: [rho_s; 3], m, lobe });
        let shares = [rho[0], rho[1], gloss.as_ref().map_or(0.0, |g| g.rho_s[0])];
        let sum: f64 = shares.iter().sum();
        Scatter {
            view,
            out: up,
            normal: up,
            far_normal: -up,
            rho_d: [rho[0]; 3],
            rho_t: [rho[1]; 3],
            gloss,
            sunlit: None,
            choice: shares.map(|s| s / sum),
        }
    }
}
