//! The radiance that leaves a leaf towards the viewer: W Eq. 1 under direct light, as `mesophyll_viewer::scene` states
//! it.
//!
//! ```text
//! sun on the viewed side:  E · V · max(0, N·l) · (ρd/π + f_s)      sun on the far side:  E · V · max(0, F·l) · ρt_far/π
//! … through an instance with maps of its own for where the sun stands:                   E · V · f · ρt_far/π
//! constant sky:            L · (ρd + ρt_far + ρs · a(N·v, m))
//! dome:                    (ρd E(N) + ρt_far E(F))/π + ∫ L f_s max(0, N·l) dl, E the irradiance on a normal
//! ```

use super::accelerate::{Forest, Hit, Ray, Shape};
use super::albedo::AlbedoTable;
use super::dome::{self, IrradianceMap};
use super::lobe::Reflect;
use super::lookup::Taps;
use super::world::{Interior, NormalFrame, Placement, ReferenceLeaf, ReferenceSide, ReferenceSun, Sunlit, World};
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::PI;

/// A world ready to be seen.
pub(super) struct Stage<'a> {
    pub world: &'a World,
    pub forest: Forest,
    /// Local → world rotation of an instance.
    turn: Vec<DMat3>,
    /// a(N·v, m), a leaf each; only under a sky and for glossy leaves.
    albedo: Vec<Option<AlbedoTable>>,
    /// Under a dome.
    irradiance: Option<IrradianceMap>,
    /// How far a shadow ray starts off the blade.
    step: f64,
}

/// Points on the sun's disk, as offsets in units of its radius.
pub(super) type DiskPoint = [f64; 2];

/// What one ray saw.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub radiance: [f64; 3],
    /// 0 where nothing was hit (see [`dome`] for the parts of a sky), else 1 + 2·instance + (1 for the back).
    pub surface: u32,
    /// Which kinds of sun sample there were: [`HIDDEN`], [`VIEWED_SIDE`], [`FAR_SIDE`].
    pub light: u8,
}

pub(super) const HIDDEN: u8 = 1;
pub(super) const VIEWED_SIDE: u8 = 2;
pub(super) const FAR_SIDE: u8 = 4;

impl<'a> Stage<'a> {
    /// `world` must have been validated.
    pub fn new(world: &'a World) -> Stage<'a> {
        let shapes = world.leaves.iter().map(|l| Shape::new(&l.mesh.positions, &l.mesh.indices)).collect();
        let placed: Vec<_> = world.instances.iter().map(|p| (p.leaf, p.transform)).collect();
        let forest = Forest::new(shapes, &placed);
        let turn = world.instances.iter().map(rotation).collect();
        let albedo = world.leaves.iter().map(|leaf| world.sky.and_then(|_| albedo_table(leaf))).collect();
        let step = 1e-9 * forest.extent();
        let irradiance = world.dome.as_ref().map(IrradianceMap::new);
        Stage { world, forest, turn, albedo, irradiance, step }
    }

    /// What comes back along `ray` (unit direction); the sun is sampled at the given points of its disk, a
    /// glossy side's view of a dome at those of the unit square.
    pub fn see(&self, ray: &Ray, sun_points: &[DiskPoint], lobe_points: &[[f64; 2]]) -> Seen {
        match self.forest.nearest(ray, |i, t, b| self.on_leaf(i, t, b)) {
            None => {
                let (radiance, surface) = match &self.world.dome {
                    Some(dome) => dome.seen(ray.direction, self.world.sun.as_ref()),
                    None => (self.world.background, 0),
                };
                Seen { radiance, surface, light: 0 }
            }
            Some(hit) => self.shade(ray, &hit, sun_points, lobe_points),
        }
    }

    fn leaf(&self, instance: usize) -> &'a ReferenceLeaf {
        &self.world.leaves[self.world.instances[instance].leaf]
    }

    /// The alpha test: a bilinear mask of at least ½.
    fn on_leaf(&self, instance: usize, triangle: usize, barycentric: [f64; 2]) -> bool {
        let leaf = self.leaf(instance);
        let Some(mask) = &leaf.mask else { return true };
        let uv = texture_point(leaf, triangle, barycentric);
        Taps::new(uv.x, uv.y, leaf.width, leaf.height, false).coverage(mask) >= 0.5
    }

    /// Whether the sun is hidden in direction `l` (not normalised) from a point on the blade with geometric normal
    /// `flat`.
    fn hidden(&self, point: DVec3, flat: DVec3, l: DVec3) -> bool {
        // start on the sun's side of the flat triangle, so that the blade never shades itself where it is lit
        let side = if flat.dot(l) < 0.0 { -flat } else { flat };
        let ray = Ray::new(point + side * self.step, l);
        self.forest.blocked(&ray, |i, t, b| self.on_leaf(i, t, b))
    }

    /// Whether a point off any surface sees this point of the sun's disk.
    pub(crate) fn sees_sun(&self, sun: &ReferenceSun, point: DVec3, offset: DiskPoint) -> bool {
        !self.forest.blocked(&Ray::new(point, Disk::new(sun).toward(offset)), |i, t, b| self.on_leaf(i, t, b))
    }

    fn shade(&self, ray: &Ray, hit: &Hit, sun_points: &[DiskPoint], lobe_points: &[[f64; 2]]) -> Seen {
        let leaf = self.leaf(hit.instance);
        let mesh = &leaf.mesh;
        let turn = &self.turn[hit.instance];
        let corner = corners(leaf, hit.triangle);
        let weight = [1.0 - hit.barycentric[0] - hit.barycentric[1], hit.barycentric[0], hit.barycentric[1]];
        let mix = |of: &[DVec3]| of[corner[0]] * weight[0] + of[corner[1]] * weight[1] + of[corner[2]] * weight[2];
        let view = -ray.direction;
        let point = ray.origin + ray.direction * hit.t;
        let [p0, p1, p2] = corner.map(|c| mesh.positions[c]);
        let flat = (*turn * (p1 - p0).cross(p2 - p0)).normalize_or_zero();
        let smooth = mix(&mesh.normals).normalize_or(DVec3::Z);
        let front_normal = *turn * smooth;
        let seen_from_back = front_normal.dot(view) < 0.0;
        let toward_viewer = if seen_from_back { -front_normal } else { front_normal };
        let (viewed, far) = if seen_from_back { (&leaf.back, &leaf.front) } else { (&leaf.front, &leaf.back) };
        let uv = texture_point(leaf, hit.triangle, hit.barycentric);
        let taps = |back: bool| Taps::new(uv.x, uv.y, leaf.width, leaf.height, back);
        let tangents = || corner.iter().zip(weight).map(|(&c, w)| mesh.tangents[c] * w).sum::<glam::DVec4>();
        let mapped = |side: &ReferenceSide, back: bool| -> DVec3 {
            let Some(map) = &side.normal else { return if back { -front_normal } else { front_normal } };
            let [x, y, z] = taps(back).vector(&map.values);
            let (x, z) = if back { (-x, -z) } else { (x, z) };
            let local = match map.frame {
                NormalFrame::Blade => DVec3::new(x, y, z),
                NormalFrame::Tangent => {
                    let t = tangents();
                    let along = (t.truncate() - smooth * smooth.dot(t.truncate())).normalize_or_zero();
                    along * x + smooth.cross(along) * (t.w.signum() * y) + smooth * z
                }
            };
            (*turn * local).normalize_or(if back { -front_normal } else { front_normal })
        };

        let world = self.world;
        let viewed_taps = taps(seen_from_back);
        let n = mapped(viewed, seen_from_back);
        let rho_d = reflectance(viewed, &viewed_taps);
        let gloss = viewed.gloss.as_ref().map(|g| (viewed_taps.colour(&g.rho_s), viewed_taps.scalar(&g.m)));
        let mut rho_t_far = None;
        let mut transmittance = || *rho_t_far.get_or_insert_with(|| through(far, &taps(!seen_from_back)));

        let mut radiance = [0.0; 3];
        let mut light = 0;
        if let Some(sun) = &world.sun {
            let f = mapped(far, !seen_from_back);
            let through =
                world.through.get(hit.instance).and_then(|t| t.entering[usize::from(!seen_from_back)].as_ref());
            let disk = Disk::new(sun);
            // sums over the disk of: cosine on the viewed side, f_s/ρs with its cosine, cosine on the far side
            let (mut lambert, mut shine, mut behind) = (0.0, 0.0, 0.0);
            for &offset in sun_points {
                let l = disk.toward(offset);
                if self.hidden(point, flat, l) {
                    light |= HIDDEN;
                } else if toward_viewer.dot(l) > 0.0 {
                    light |= VIEWED_SIDE;
                    lambert += n.dot(l).max(0.0);
                    if let Some((_, m)) = gloss {
                        let length = l.length();
                        shine += leaf.lobe.times_cosine(n, view, l / length, m) * length;
                    }
                } else {
                    light |= FAR_SIDE;
                    // Points of the disk count by their cosine; a map holds the cosine's stand-in for the centre, their
                    // mean direction.
                    behind += if through.is_some() { 1.0 } else { f.dot(l).max(0.0) };
                }
            }
            let share = 1.0 / sun_points.len().max(1) as f64;
            let rho_t = match through {
                _ if behind <= 0.0 => [0.0; 3],
                None => transmittance(),
                Some(Sunlit::Factor(map)) => {
                    let f = taps(!seen_from_back).scalar(map).max(0.0);
                    transmittance().map(|r| r * f)
                }
                Some(Sunlit::Colour(maps)) => taps(!seen_from_back).colour(maps).map(|m| m.max(0.0)),
            };
            for c in 0..3 {
                let surface = gloss.map_or(0.0, |(rho_s, _)| rho_s[c] * shine);
                radiance[c] += sun.irradiance[c] * share * ((rho_d[c] * lambert + rho_t[c] * behind) / PI + surface);
            }
        }
        if let Some(sky) = world.sky {
            let rho_t = transmittance();
            let table = self.albedo[world.instances[hit.instance].leaf].as_ref();
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
            let (near, beyond) = (irradiance.at(n), irradiance.at(mapped(far, !seen_from_back)));
            let mut shine = [0.0; 3];
            if let Some((_, m)) = gloss {
                for (l, weight) in lobe_points.iter().filter_map(|&p| dome::reflected(leaf.lobe, n, view, m, p)) {
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
                let surface = gloss.map_or(0.0, |(_, m)| leaf.lobe.with_cosine(n, view, l, m, scanner.bounded));
                [n.dot(l).max(0.0) / PI, surface]
            };
            let [lambert, shine] = scanner.gathered(point, lamp);
            for c in 0..3 {
                radiance[c] += rho_d[c] * lambert + gloss.map_or(0.0, |(rho_s, _)| rho_s[c] * shine);
            }
        }
        Seen { radiance, surface: 1 + 2 * hit.instance as u32 + u32::from(seen_from_back), light }
    }
}

/// The sun's disk in the plane one unit away that faces it, uniform there: its mean direction is the centre's, so that
/// a surface which sees all of it receives exactly E·(N·l). (A sphere of uniform radiance differs by the radius
/// squared: 2e-5.)
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

    /// Towards a point of the disk; its length is 1/cos of the angle to the centre, the weight that the plane's uniform
    /// measure needs.
    fn toward(&self, offset: DiskPoint) -> DVec3 {
        self.centre + self.across[0] * offset[0] + self.across[1] * offset[1]
    }
}

fn rotation(placed: &Placement) -> DMat3 {
    let m = DMat3::from_mat4(placed.transform);
    m * (1.0 / m.determinant().abs().cbrt())
}

fn corners(leaf: &ReferenceLeaf, triangle: usize) -> [usize; 3] {
    [0, 1, 2].map(|k| leaf.mesh.indices[3 * triangle + k] as usize)
}

fn texture_point(leaf: &ReferenceLeaf, triangle: usize, barycentric: [f64; 2]) -> DVec2 {
    let [a, b, c] = corners(leaf, triangle).map(|k| leaf.mesh.uvs[k]);
    a + (b - a) * barycentric[0] + (c - a) * barycentric[1]
}

/// ρd with γ.
fn reflectance(side: &ReferenceSide, taps: &Taps) -> [f64; 3] {
    match &side.interior {
        Interior::Maps { rho_d, .. } => taps.colour(rho_d),
        Interior::Scalars { gamma, thickness, curve } => {
            let (rho_d, gamma) = (curve(taps.scalar(thickness)).0, taps.colour(gamma));
            [0, 1, 2].map(|c| gamma[c] * rho_d[c])
        }
    }
}

/// ρt of a beam that enters this side.
fn through(side: &ReferenceSide, taps: &Taps) -> [f64; 3] {
    match &side.interior {
        Interior::Maps { rho_t, .. } => taps.colour(rho_t),
        Interior::Scalars { thickness, curve, .. } => curve(taps.scalar(thickness)).1,
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
