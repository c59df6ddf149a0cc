//! How light is scattered at a point of a leaf: diffuse light in both directions and gloss, evaluated and sampled.
//!
//! ```text
//! l on the viewed side:  f max(0, N·l) = ρd max(0, N·l)/π + ρs f_s(l) max(0, N·l)
//! l on the far side:     f max(0, F·l) = ρt max(0, F·l)/π
//! ```
//! For a leaf by B1's models, the shares ρ depend on the direction of view, and lobes around the mirror direction
//! replace gloss ([`crate::foliar`]). N and F are the mapped normals of the viewed and of the far side. The triangle
//! decides on which side `l` is. So a direction that a mapped normal would draw through the blade has no weight.

use crate::foliar::{FoliarMaterial, FoliarModel, FoliarScattering, stream};
use crate::lobe::{Lobe, M_FLOOR, ReflectionLobe};
use crate::stage::Stage;
use crate::surface::Surface;
use glam::DVec3;
use mesophyll_optics::foliar::ray::turned;
use std::f64::consts::{PI, TAU};

/// A point of a leaf, as light meets it.
pub struct ScatterPoint<'a> {
    view: DVec3,
    /// The triangle's normal on the viewed side.
    out: DVec3,
    normal: DVec3,
    far_normal: DVec3,
    rho_d: [f64; 3],
    rho_t: [f64; 3],
    gloss: Option<Gloss>,
    /// The lobes that replace gloss, for a leaf by B1's models.
    mirrored: Option<Mirrored>,
    /// A leaf through whose layers rays are followed, and the normal of its front.
    layers: Option<(&'a FoliarMaterial, DVec3)>,
    /// The factor that replaces ρt times a cosine for light from the sun's centre.
    sunlit: Option<[f64; 3]>,
    /// Probabilities of drawing from ρd, from ρt and from gloss.
    choice: [f64; 3],
}

struct Gloss {
    rho_s: [f64; 3],
    m: f64,
    lobe: Lobe,
}

/// The part of the light that B1's models send to the lit side and that is not diffuse.
struct Mirrored {
    direction: DVec3,
    /// Unit vector in the leaf's plane, on the mirror's side.
    forward: DVec3,
    met: FoliarScattering,
    /// Probabilities of the light that the face reflects, and of the light that turned back.
    choice: [f64; 2],
}

impl Mirrored {
    /// The densities (1/sr) of the two at `l`.
    fn densities(&self, normal: DVec3, l: DVec3) -> [f64; 2] {
        let cos = normal.dot(l);
        if cos <= 0.0 { [0.0; 2] } else { self.met.densities(cos, self.direction.dot(l), self.forward.dot(l)) }
    }

    fn draw(&self, normal: DVec3, numbers: [f64; 4]) -> DVec3 {
        let mut random = stream(numbers);
        let (x, y) = (self.forward, normal.cross(self.forward));
        let [a, b, c] = if random() < self.choice[0] {
            let d = self.direction;
            let local = [d.dot(x), d.dot(y), d.dot(normal).max(1e-12)];
            turned(local, self.met.oblateness, &mut random)
        } else {
            let [cos, along, across] = self.met.draw_turned(&mut random);
            [along, across, cos]
        };
        (x * a + y * b + normal * c).normalize()
    }
}

/// The density of a direction that no other sampling can produce.
const SURE: f64 = 1e100;

/// A drawn direction.
pub struct DirectionSample {
    /// Unit vector towards the place that the light comes from.
    pub direction: DVec3,
    /// f times the cosine, over the density.
    pub weight: [f64; 3],
    /// Density (1/sr).
    pub density: f64,
    /// Whether the light comes through the leaf.
    pub through: bool,
    /// How often a ray through layers crossed the mesophyll, in thicknesses.
    pub crossings: f64,
}

impl<'a> ScatterPoint<'a> {
    /// Scattering at the point of `surface`. `carried` is the share of each channel that the path transports so far; it
    /// affects which lobe is drawn. `rho_t` is for light that enters the far side if the path goes against the light,
    /// and for light that enters the viewed side if it goes with the light.
    pub fn new(stage: &Stage<'a>, surface: &Surface<'a>, carried: [f64; 3], rho_t: [f64; 3]) -> ScatterPoint<'a> {
        let lobe = surface.lobe();
        let gloss = surface.gloss().map(|(rho_s, m)| Gloss { rho_s, m: m.max(M_FLOOR), lobe });
        let weigh = |rho: [f64; 3]| (0..3).map(|c| rho[c].max(0.0) * carried[c]).sum::<f64>();
        let mut scatter = ScatterPoint {
            view: surface.view,
            out: if surface.back { -surface.flat } else { surface.flat },
            normal: surface.normal(),
            far_normal: surface.far_normal(),
            rho_d: surface.rho_d(),
            rho_t,
            gloss,
            mirrored: None,
            layers: None,
            sunlit: stage.sunlit(surface).map(|s| surface.through(s, || rho_t)),
            choice: [0.0; 3],
        };
        let mut shine = scatter.gloss.as_ref().map_or(0.0, |g| weigh(g.rho_s));
        if let Some(foliar) = stage.foliar(surface.instance) {
            scatter.gloss = None;
            if foliar.model() == FoliarModel::Abm {
                let up = if surface.back { -scatter.normal } else { scatter.normal };
                return ScatterPoint { layers: Some((foliar, up)), rho_d: [0.0; 3], rho_t: [0.0; 3], ..scatter };
            }
            let met = foliar.meet(surface.view, scatter.normal, surface.back);
            let weights = [weigh(met.surface), weigh([met.turned; 3])];
            shine = weights[0] + weights[1];
            let choice = if shine > 0.0 { weights.map(|w| w / shine) } else { [1.0, 0.0] };
            let n = scatter.normal;
            let direction = n * (2.0 * n.dot(surface.view).max(0.0)) - surface.view;
            let along = direction - n * n.dot(direction);
            let forward = along.try_normalize().unwrap_or_else(|| n.any_orthonormal_vector());
            (scatter.rho_d, scatter.rho_t) = (met.diffuse, met.through);
            scatter.mirrored = Some(Mirrored { direction, forward, met, choice });
        }
        scatter.choose([weigh(scatter.rho_d), weigh(scatter.rho_t), shine]);
        scatter
    }

    /// Whether the sun's light passes by its own maps, which only the light's own sampling can evaluate.
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
        if let Some(mirrored) = &self.mirrored {
            let [around, back] = mirrored.densities(self.normal, l);
            (0..3).for_each(|c| sum[c] += mirrored.met.surface[c] * around + mirrored.met.turned * back);
        }
        sum
    }

    /// The same for the diffuse light alone, as in B1's rule for direct light.
    pub fn diffuse_times_cosine(&self, l: DVec3) -> [f64; 3] {
        let (rho, cos) =
            if self.faces(l) { (self.rho_d, self.normal.dot(l)) } else { (self.rho_t, self.far_normal.dot(l)) };
        rho.map(|r| r * cos.max(0.0) / PI)
    }

    /// B1's three rays, each with what it carries: around the mirror direction, and diffuse to the viewed and to the
    /// far side.
    pub fn three(&self, numbers: [f64; 4]) -> [(DVec3, [f64; 3]); 3] {
        let [_, u, v, _] = numbers;
        let mirror = self.mirrored.as_ref().map_or((self.normal, [0.0; 3]), |m| {
            (m.draw(self.normal, numbers), m.met.surface.map(|s| s + m.met.turned))
        });
        let near = cosine(self.normal, u, v);
        // Half a turn and the opposite end of the unit square, so that the two diffuse rays differ.
        let far = cosine(self.far_normal, 1.0 - u, (v + 0.5).fract());
        [mirror, (near, self.rho_d), (far, self.rho_t)]
    }

    /// The same for light of the sun.
    pub fn times_cosine_of_sun(&self, l: DVec3) -> [f64; 3] {
        match self.sunlit {
            Some(through) if !self.faces(l) => through.map(|t| t / PI),
            _ => self.times_cosine(l),
        }
    }

    /// Density (1/sr) with which [`ScatterPoint::draw`] gives the unit direction `l`.
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
        if let Some(mirrored) = &self.mirrored {
            let [a, b] = mirrored.densities(self.normal, l);
            sum += self.choice[2] * (mirrored.choice[0] * a + mirrored.choice[1] * b);
        }
        sum
    }

    /// Draws a direction from uniform numbers; `None` where the drawn direction has no weight.
    pub fn draw(&self, numbers: [f64; 4]) -> Option<DirectionSample> {
        if let Some((foliar, up)) = self.layers {
            let (direction, weight, crossings) = foliar.follow(self.view, up, &mut stream(numbers))?;
            // A direction that an interpolated normal sends through the blade has no weight.
            let sound = (self.normal.dot(direction) > 0.0) == self.faces(direction);
            return sound.then(|| DirectionSample {
                direction,
                weight,
                density: SURE,
                through: !self.faces(direction),
                crossings,
            });
        }
        let direction = self.direction(numbers)?;
        let density = self.density(direction);
        let f = self.times_cosine(direction);
        let counts = density > 0.0 && f.iter().any(|x| *x > 0.0);
        counts.then(|| DirectionSample {
            direction,
            weight: f.map(|x| x / density),
            density,
            through: !self.faces(direction),
            crossings: 0.0,
        })
    }

    /// Whether rays are followed through the layers of the leaf, so that [`ScatterPoint::draw`] alone knows what they
    /// carry.
    pub fn layered(&self) -> bool {
        self.layers.is_some()
    }

    /// Gives lobes that are asked for (ρd, ρt, ρs) at least this share of the draws, also where they reflect nothing:
    /// a derivative by what is 0 is found by nothing else.
    pub fn raise(&mut self, asked: [bool; 3], least: f64) {
        let there = [true, true, self.gloss.is_some()];
        if self.layers.is_some() {
            return;
        }
        for ((choice, asked), there) in self.choice.iter_mut().zip(asked).zip(there) {
            if asked && there {
                *choice = choice.max(least);
            }
        }
        let sum: f64 = self.choice.iter().sum();
        if sum > 0.0 {
            self.choice = self.choice.map(|c| c / sum);
        }
    }

    /// Draws from ρd, ρt and gloss in these proportions.
    pub fn choose(&mut self, shares: [f64; 3]) {
        let sum: f64 = shares.iter().sum();
        self.choice = if sum > 0.0 { shares.map(|s| s / sum) } else { [0.0; 3] };
    }

    /// What [`ScatterPoint::times_cosine`] multiplies ρd, ρt and ρs by (1/sr).
    pub fn factors(&self, l: DVec3) -> [f64; 3] {
        if !self.faces(l) {
            return [0.0, self.far_normal.dot(l).max(0.0) / PI, 0.0];
        }
        let shine = |g: &Gloss| g.lobe.times_cosine(self.normal, self.view, l, g.m);
        [self.normal.dot(l).max(0.0) / PI, 0.0, self.gloss.as_ref().map_or(0.0, shine)]
    }

    /// The same, and the last one's derivative by the slope m.
    pub fn lobes(&self, l: DVec3) -> [f64; 4] {
        let [diffuse, through, gloss] = self.factors(l);
        let by_m = self.gloss.as_ref().filter(|_| self.faces(l)).map_or(0.0, |g| {
            let (step, shine) = (1e-4 * g.m, |m: f64| g.lobe.times_cosine(self.normal, self.view, l, m));
            (shine(g.m + step) - shine(g.m - step)) / (2.0 * step)
        });
        [diffuse, through, gloss, by_m]
    }

    /// ρs; 0 where there is no gloss.
    pub fn rho_s(&self) -> [f64; 3] {
        self.gloss.as_ref().map_or([0.0; 3], |g| g.rho_s)
    }

    /// A direction from uniform numbers, whatever light comes along it; `None` where the draw gives none.
    pub fn direction(&self, numbers: [f64; 4]) -> Option<DVec3> {
        let [choice, u, v, _] = numbers;
        let [d, t, s] = self.choice;
        Some(if choice < d {
            cosine(self.normal, u, v)
        } else if choice < d + t || s == 0.0 {
            cosine(self.far_normal, u, v)
        } else if let Some(mirrored) = &self.mirrored {
            mirrored.draw(self.normal, numbers)
        } else {
            let g = self.gloss.as_ref()?;
            let tan = g.lobe.quantile(u, g.m).sqrt();
            let (a, b) = self.normal.any_orthonormal_pair();
            let (sin, cos) = (TAU * v).sin_cos();
            let h = (self.normal + (a * cos + b * sin) * tan).normalize();
            let v_h = self.view.dot(h);
            // A facet that faces away reflects nothing, and its directions are not part of the density.
            if v_h <= 0.0 {
                return None;
            }
            h * (2.0 * v_h) - self.view
        })
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
impl ScatterPoint<'_> {
    /// A point of a level leaf seen from `view`, for tests.
    pub fn level(view: DVec3, rho: [f64; 2], gloss: Option<(f64, f64, Lobe)>) -> ScatterPoint<'static> {
        let up = DVec3::Z * view.z.signum();
        let gloss = gloss.map(|(rho_s, m, lobe)| Gloss { rho_s: [rho_s; 3], m, lobe });
        let shares = [rho[0], rho[1], gloss.as_ref().map_or(0.0, |g| g.rho_s[0])];
        let sum: f64 = shares.iter().sum();
        ScatterPoint {
            view,
            out: up,
            normal: up,
            far_normal: -up,
            rho_d: [rho[0]; 3],
            rho_t: [rho[1]; 3],
            gloss,
            mirrored: None,
            layers: None,
            sunlit: None,
            choice: shares.map(|s| s / sum),
        }
    }
}
