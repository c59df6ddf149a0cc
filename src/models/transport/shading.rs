//! The radiance that a leaf sends to the viewer: W Eq. 1 under direct light, as `mesophyll_viewer::scene` describes it.
//!
//! ```text
//! sun on the viewed side:  E · V · max(0, N·l) · (ρd/π + f_s)
//! sun on the far side:     E · V · max(0, F·l) · ρt_far/π
//! … through an instance with maps of its own for where the sun stands:                   E · V · f · ρt_far/π
//! constant sky:            L · (ρd + ρt_far + ρs · a(N·v, m))
//! dome:                    (ρd E(N) + ρt_far E(F))/π + ∫ L f_s max(0, N·l) dl, E the irradiance on a normal
//! ```

use super::accelerate::Ray;
use super::albedo::AlbedoTable;
use super::dome::{self, IrradianceMap};
use super::lobe::ReflectionLobe;
use super::stage::{Met, SideBy, Stage};
use super::surface::Surface;
use super::world::{ReferenceLeaf, ReferenceSun, ReferenceWorld};
use glam::DVec3;
use std::f64::consts::PI;

/// A world that is ready to be drawn under direct light.
pub(super) struct Direct<'a> {
    pub stage: Stage<'a>,
    /// a(N·v, m) for each leaf; only under a sky and for glossy leaves.
    albedo: Vec<Option<AlbedoTable>>,
    /// The irradiance of the dome, if there is one.
    irradiance: Option<IrradianceMap>,
}

/// A point on the sun's disk, as an offset in units of its radius.
pub(super) type DiskPoint = [f64; 2];

/// The result of one ray.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub radiance: [f64; 3],
    /// 0 where nothing was hit (see [`dome`] for the parts of a sky), else 1 + 2·number of the leaf
    /// ([`Stage::number`]), plus 1 for the back.
    pub surface: u32,
    /// The kinds of sun samples that occurred: [`HIDDEN`], [`VIEWED_SIDE`], [`FAR_SIDE`].
    pub light: u8,
}

pub(super) const HIDDEN: u8 = 1;
pub(super) const VIEWED_SIDE: u8 = 2;
pub(super) const FAR_SIDE: u8 = 4;

impl<'a> Direct<'a> {
    /// `world` must have been validated.
    pub fn new(world: &'a ReferenceWorld) -> Direct<'a> {
        let albedo = world.leaves.iter().map(|leaf| world.sky.and_then(|_| albedo_table(leaf))).collect();
        Direct { stage: Stage::new(world), albedo, irradiance: world.dome.as_ref().map(IrradianceMap::new) }
    }

    /// The radiance along `ray` (unit direction). The sun is sampled at the given points of its disk, and a dome's
    /// reflection in a glossy side at those of the unit square.
    pub fn see(&self, ray: &Ray, sun_points: &[DiskPoint], lobe_points: &[[f64; 2]]) -> Seen {
        let world = self.stage.world;
        match self.stage.nearest(ray) {
            None => {
                let (radiance, surface) = match &world.dome {
                    Some(dome) => dome.seen(ray.direction, world.sun.as_ref()),
                    None => (world.background, 0),
                };
                Seen { radiance, surface, light: 0 }
            }
            Some(met) => self.shade(&met, sun_points, lobe_points),
        }
    }

    /// Whether a point that is not on a surface sees this point of the sun's disk.
    pub(crate) fn sees_sun(&self, sun: &ReferenceSun, point: DVec3, offset: DiskPoint) -> bool {
        !self.stage.blocked(&Ray::new(point, Disk::new(sun).toward(offset)))
    }

    fn shade(&self, met: &Met, sun_points: &[DiskPoint], lobe_points: &[[f64; 2]]) -> Seen {
        let world = self.stage.world;
        let surface = self.stage.surface(met, SideBy::SmoothNormal);
        let Surface { view, point, flat, .. } = surface;
        let (lobe, n, rho_d, gloss) = (surface.lobe(), surface.normal(), surface.rho_d(), surface.gloss());
        let mut rho_t_far = None;
        let mut transmittance = || *rho_t_far.get_or_insert_with(|| surface.rho_t());

        let mut radiance = [0.0; 3];
        let mut light = 0;
        if let Some(sun) = &world.sun {
            let f = surface.far_normal();
            let through = self.stage.sunlit(&surface);
            let disk = Disk::new(sun);
            // Sums over the disk of the cosine on the viewed side, of f_s/ρs with its cosine, and of the cosine on the
            // far side.
            let (mut lambert, mut shine, mut behind) = (0.0, 0.0, 0.0);
            for &offset in sun_points {
                let l = disk.toward(offset);
                if self.stage.blocked(&self.stage.leave(point, flat, l)) {
                    light |= HIDDEN;
                } else if surface.toward_viewer().dot(l) > 0.0 {
                    light |= VIEWED_SIDE;
                    lambert += n.dot(l).max(0.0);
                    if let Some((_, m)) = gloss {
                        let length = l.length();
                        shine += lobe.times_cosine(n, view, l / length, m) * length;
                    }
                } else {
                    light |= FAR_SIDE;
                    // Points of the disk count by their cosine. A map has the value that replaces the cosine for the
                    // centre, which is their mean direction.
                    behind += if through.is_some() { 1.0 } else { f.dot(l).max(0.0) };
                }
            }
            let share = 1.0 / sun_points.len().max(1) as f64;
            let rho_t = match through {
                _ if behind <= 0.0 => [0.0; 3],
                None => transmittance(),
                Some(sunlit) => surface.through(sunlit, &mut transmittance),
            };
            for c in 0..3 {
                let mirrored = gloss.map_or(0.0, |(rho_s, _)| rho_s[c] * shine);
                radiance[c] += sun.irradiance[c] * share * ((rho_d[c] * lambert + rho_t[c] * behind) / PI + mirrored);
            }
        }
        if let Some(sky) = world.sky {
            let rho_t = transmittance();
            let table = self.albedo[self.stage.leaf_index(surface.instance)].as_ref();
            let shine = match (gloss, table) {
                (Some((rho_s, m)), Some(table)) => {
                    let a = table.at(n.dot(view), m);
                    rho_s.map(|r| r * a)
                }
                _ => [0.0; 3],
            };
            for c in 0..3 {
                radiance[c] += sky[c] * (rho_d[c] + rho_t[c] + shine[c]);
            }
        }
        if let (Some(dome), Some(irradiance)) = (&world.dome, &self.irradiance) {
            let rho_t = transmittance();
            let (near, beyond) = (irradiance.at(n), irradiance.at(surface.far_normal()));
            let mut shine = [0.0; 3];
            if let Some((_, m)) = gloss {
                for (l, weight) in lobe_points.iter().filter_map(|&p| dome::reflected(lobe, n, view, m, p)) {
                    let seen = (dome.radiance)(l);
                    (0..3).for_each(|c| shine[c] += weight * seen[c] / lobe_points.len() as f64);
                }
            }
            for c in 0..3 {
                radiance[c] += (rho_d[c] * near[c] + rho_t[c] * beyond[c]) / PI
                    + gloss.map_or(0.0, |(rho_s, _)| rho_s[c] * shine[c]);
            }
        }
        if let Some(scanner) = &world.scanner {
            let lamp = |l: DVec3| {
                let mirrored = gloss.map_or(0.0, |(_, m)| lobe.with_cosine(n, view, l, m, scanner.bounded));
                [n.dot(l).max(0.0) / PI, mirrored]
            };
            let [lambert, shine] = scanner.gathered(point, lamp);
            for c in 0..3 {
                radiance[c] += rho_d[c] * lambert + gloss.map_or(0.0, |(rho_s, _)| rho_s[c] * shine);
            }
        }
        Seen { radiance, surface: 1 + 2 * self.stage.number(&surface) + u32::from(surface.back), light }
    }
}

/// The sun's disk in the plane one unit away that faces it, uniform in this plane. Its mean direction is that of the
/// centre, so a surface that sees all of it receives exactly E·(N·l). (A sphere of uniform radiance differs by the
/// radius squared: 2e-5.)
struct Disk {
    centre: DVec3,
    across: [DVec3; 2],
}

impl Disk {
    fn new(sun: &ReferenceSun) -> Disk {
        let centre = sun.direction.normalize();
        let (a, b) = centre.any_orthonormal_pair();
        let reach = sun.radius.tan();
        Disk { centre, across: [a * reach, b * reach] }
    }

    /// The vector to a point of the disk. Its length is 1/cos of the angle to the centre, which is the weight that the
    /// uniform measure of the plane needs.
    fn toward(&self, offset: DiskPoint) -> DVec3 {
        self.centre + self.across[0] * offset[0] + self.across[1] * offset[1]
    }
}

fn albedo_table(leaf: &ReferenceLeaf) -> Option<AlbedoTable> {
    let slopes = [&leaf.front, &leaf.back].into_iter().filter_map(|s| s.gloss.as_ref()).flat_map(|g| &g.m);
    let range = slopes.filter(|m| m.is_finite()).fold(None, |range: Option<[f64; 2]>, &m| {
        let m = f64::from(m);
        Some(range.map_or([m, m], |[low, high]| [low.min(m), high.max(m)]))
    })?;
    Some(AlbedoTable::new(leaf.lobe, range, 1e-4))
}
