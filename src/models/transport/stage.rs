//! A world prepared for rays: what a ray hits first, and the properties of the surface there.
//!
//! Both CPU renderers use it: the direct-light reference ([`super::render`]) and the path tracer ([`super::path`]).

use super::accelerate::{InstanceForest, Ray, RayHit, TriangleTree, fetch};
use super::foliar::FoliarMaterial;
use super::lookup::{TexelTaps, texels};
use super::repetition::{Repeat, repeated};
use super::world::{
    NormalFrame, ReferenceInterior, ReferenceLeaf, ReferencePlacement, ReferenceSide, ReferenceWorld, SunlitMaps,
};
use glam::{DMat3, DVec2, DVec3, DVec4};

/// A world with its trees of boxes.
pub(super) struct Stage<'a> {
    pub world: &'a ReferenceWorld,
    forest: InstanceForest,
    repeat: Option<Repeat>,
    /// For each instance of the forest, the index of the world's instance. Where the world repeats, several have the
    /// same.
    instance: Vec<usize>,
    /// The local → world rotation of each instance.
    turn: Vec<DMat3>,
    /// Distance (mm) between a blade and the start of a ray that leaves it.
    step: f64,
}

/// How it is decided whether a ray sees the front or the back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SideBy {
    /// By the mesh's interpolated normal, like the GPU renderer.
    SmoothNormal,
    /// By the triangle itself, whose front is where its corners run anticlockwise. So light cannot pass unnoticed from
    /// one side to the other. An interpolated normal that points away is reversed.
    Triangle,
}

impl<'a> Stage<'a> {
    /// `world` must have passed [`ReferenceWorld::validate`].
    pub fn new(world: &'a ReferenceWorld) -> Stage<'a> {
        let shape = |l: &ReferenceLeaf| TriangleTree::with_solid(&l.mesh.positions, &l.mesh.indices, |t| solid(l, t));
        let shapes = world.leaves.iter().map(shape).collect();
        let mut placed: Vec<_> = world.instances.iter().map(|p| (p.leaf, p.transform)).collect();
        let mut instance: Vec<usize> = (0..placed.len()).collect();
        if let Some(size) = world.periodic {
            (placed, instance) = repeated(world, size);
        }
        let forest = InstanceForest::new(shapes, &placed);
        let turn = world.instances.iter().map(rotation).collect();
        // Far from the origin, the spacing of floating-point coordinates matters more than the size of the scene.
        let farthest = forest.bounds().map_or(0.0, |[low, high]| low.abs().max(high.abs()).max_element());
        let step = 1e-9 * forest.extent().max(farthest);
        let repeat = world
            .periodic
            .zip(forest.bounds())
            .map(|(size, [low, high])| Repeat { half: size.map(|s| 0.5 * s), height: [low.z - step, high.z + step] });
        Stage { world, forest, repeat, instance, turn, step }
    }

    /// The leaf of an instance.
    pub fn leaf(&self, instance: usize) -> &'a ReferenceLeaf {
        &self.world.leaves[self.world.instances[instance].leaf]
    }

    /// The B1 model of an instance; `None` if it has none.
    pub fn foliar(&self, instance: usize) -> Option<&'a FoliarMaterial> {
        self.world.foliar.get(self.world.instances[instance].leaf)?.as_deref()
    }

    /// The first hit of a ray.
    pub fn nearest(&self, ray: &Ray) -> Option<Met> {
        let find = |ray: &Ray, limit: f64| {
            let mut hit = self.forest.nearest_within(ray, limit, |i, t, b| self.on_leaf(i, t, b))?;
            hit.instance = self.instance[hit.instance];
            Some(Met { ray: *ray, hit })
        };
        match &self.repeat {
            None => find(ray, f64::INFINITY),
            Some(repeat) => repeat.follow(ray, find),
        }
    }

    /// Whether a ray hits anything.
    pub fn blocked(&self, ray: &Ray) -> bool {
        let find = |ray: &Ray, limit: f64| self.forest.blocked_within(ray, limit, |i, t, b| self.on_leaf(i, t, b));
        match &self.repeat {
            None => find(ray, f64::INFINITY),
            Some(repeat) => repeat.follow(ray, |ray, limit| find(ray, limit).then_some(())).is_some(),
        }
    }

    /// The first hit of each of many rays. This is faster than one by one where the rays differ.
    pub fn nearest_of_each(&self, rays: &[Ray]) -> Vec<Option<Met>> {
        self.nearest_of(rays, |rays| self.forest.nearest_of_each(rays, |i, t, b| self.on_leaf(i, t, b)))
    }

    /// The same; faster where each ray is close to the next.
    pub fn nearest_of_neighbours(&self, rays: &[Ray]) -> Vec<Option<Met>> {
        self.nearest_of(rays, |rays| self.forest.nearest_of_neighbours(rays, |i, t, b| self.on_leaf(i, t, b)))
    }

    fn nearest_of(&self, rays: &[Ray], find: impl FnOnce(&[Ray]) -> Vec<Option<RayHit>>) -> Vec<Option<Met>> {
        if self.repeat.is_some() {
            return rays.iter().map(|ray| self.nearest(ray)).collect();
        }
        let met = |(ray, hit): (&Ray, Option<RayHit>)| {
            hit.map(|hit| Met { ray: *ray, hit: RayHit { instance: self.instance[hit.instance], ..hit } })
        };
        rays.iter().zip(find(rays)).map(met).collect()
    }

    /// Fetches from memory, ahead of time, the corners' numbers that [`Stage::surface`] will read.
    pub fn fetch_corners(&self, met: &Met) {
        fetch(&self.leaf(met.hit.instance).mesh.indices[3 * met.hit.triangle..][..3]);
    }

    /// Fetches from memory, ahead of time, the corners' normals and texture points that [`Stage::surface`] will read.
    pub fn fetch_surface(&self, met: &Met) {
        let leaf = self.leaf(met.hit.instance);
        for k in corners(leaf, met.hit.triangle) {
            fetch(&leaf.mesh.normals[k..=k]);
            if leaf.width * leaf.height > 1 {
                fetch(&leaf.mesh.uvs[k..=k]);
            }
        }
    }

    /// Lowest and highest corner of everything. Where the scene repeats, this is its content in the cell around the
    /// origin. `None` if there is nothing.
    pub fn bounds(&self) -> Option<[DVec3; 2]> {
        self.forest.bounds()
    }

    /// Distance (mm) between a blade and the start of a ray that leaves it.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// A ray in direction `l` (of any length) from a point on a blade with geometric normal `flat`. It starts on that
    /// side of the triangle to which it leaves, so that the triangle never shades its own lit side.
    pub fn leave(&self, point: DVec3, flat: DVec3, l: DVec3) -> Ray {
        let side = if flat.dot(l) < 0.0 { -flat } else { flat };
        Ray::new(point + side * self.step, l)
    }

    /// The alpha test. With a mask, its bilinear value has to be at least ½. On a disc, the point has to lie in the
    /// circle. `instance` counts the forest's instances.
    pub fn on_leaf(&self, instance: usize, triangle: usize, barycentric: [f64; 2]) -> bool {
        let leaf = self.leaf(self.instance[instance]);
        if leaf.mesh.discs {
            // The squared distance from the centre, divided by that of a corner. The circle's radius is half the
            // distance of a corner.
            let [b, c] = barycentric;
            let a = 1.0 - b - c;
            return a * a + b * b + c * c - a * b - b * c - c * a <= 0.25;
        }
        let Some(mask) = &leaf.mask else { return true };
        let uv = texture_point(leaf, triangle, barycentric);
        TexelTaps::new(uv.x, uv.y, leaf.width, leaf.height, false).coverage(mask) >= 0.5
    }

    /// The surface where a ray (of unit direction) hit.
    pub fn surface(&self, Met { ray, hit }: &Met, by: SideBy) -> Surface<'a> {
        let leaf = self.leaf(hit.instance);
        let turn = self.turn[hit.instance];
        let corner = corners(leaf, hit.triangle);
        let weight = [1.0 - hit.barycentric[0] - hit.barycentric[1], hit.barycentric[0], hit.barycentric[1]];
        let mesh = &leaf.mesh;
        // The same numbers as the mesh's, and nearer: the ray has just been tried on them.
        let [p0, p1, p2] = self.forest.corners(self.world.instances[hit.instance].leaf, hit.triangle);
        let flat = (turn * (p1 - p0).cross(p2 - p0)).normalize_or_zero();
        let mix = |of: &[DVec3]| of[corner[0]] * weight[0] + of[corner[1]] * weight[1] + of[corner[2]] * weight[2];
        let mut smooth = mix(&mesh.normals).normalize_or((p1 - p0).cross(p2 - p0).normalize_or(DVec3::Z));
        let mut front_normal = turn * smooth;
        if by == SideBy::Triangle && front_normal.dot(flat) < 0.0 {
            (smooth, front_normal) = (-smooth, -front_normal);
        }
        let view = -ray.direction;
        let decides = if by == SideBy::Triangle { flat } else { front_normal };
        Surface {
            leaf,
            instance: hit.instance,
            point: ray.origin + ray.direction * hit.t,
            view,
            flat,
            back: decides.dot(view) < 0.0,
            smooth,
            front_normal,
            turn,
            corner,
            weight,
            uv: texture_point(leaf, hit.triangle, hit.barycentric),
        }
    }

    /// How the sun's light passes through the leaf at `surface`, from the far side to the viewed one. `None` if no map
    /// describes it, so that the cosine with the mapped normal applies.
    pub fn sunlit(&self, surface: &Surface) -> Option<&'a SunlitMaps> {
        self.world.through.get(surface.instance)?.entering[usize::from(!surface.back)].as_ref()
    }
}

/// A hit and its ray. Where the scene repeats, the ray was shifted into the cell around the origin.
pub(super) struct Met {
    pub ray: Ray,
    pub hit: RayHit,
}

/// A point where a ray hit a leaf. The "viewed" side is the one that the ray came from, and the "far" side is the other
/// one.
pub(super) struct Surface<'a> {
    leaf: &'a ReferenceLeaf,
    /// The instance that was hit.
    pub instance: usize,
    pub point: DVec3,
    /// Towards the origin of the ray.
    pub view: DVec3,
    /// The triangle's normal, on its front.
    pub flat: DVec3,
    /// Whether the back is the viewed side.
    pub back: bool,
    smooth: DVec3,
    front_normal: DVec3,
    turn: DMat3,
    corner: [usize; 3],
    weight: [f64; 3],
    uv: DVec2,
}

impl<'a> Surface<'a> {
    /// The mesh's interpolated normal, on the viewed side.
    pub fn toward_viewer(&self) -> DVec3 {
        if self.back { -self.front_normal } else { self.front_normal }
    }

    /// Optical properties of the viewed side.
    pub fn viewed(&self) -> &'a ReferenceSide {
        if self.back { &self.leaf.back } else { &self.leaf.front }
    }

    /// Optical properties of the far side.
    pub fn far(&self) -> &'a ReferenceSide {
        if self.back { &self.leaf.front } else { &self.leaf.back }
    }

    /// The model of the gloss.
    pub fn lobe(&self) -> super::lobe::Lobe {
        self.leaf.lobe
    }

    /// Where the maps of the viewed side are read, or of the far side.
    pub fn taps(&self, far: bool) -> TexelTaps {
        TexelTaps::new(self.uv.x, self.uv.y, self.leaf.width, self.leaf.height, self.back != far)
    }

    /// The mapped normal of the viewed side.
    pub fn normal(&self) -> DVec3 {
        self.mapped(self.viewed(), self.back)
    }

    /// The mapped normal of the far side.
    pub fn far_normal(&self) -> DVec3 {
        self.mapped(self.far(), !self.back)
    }

    fn mapped(&self, side: &ReferenceSide, back: bool) -> DVec3 {
        let plain = if back { -self.front_normal } else { self.front_normal };
        let Some(map) = &side.normal else { return plain };
        let taps = TexelTaps::new(self.uv.x, self.uv.y, self.leaf.width, self.leaf.height, back);
        let [x, y, z] = taps.vector(&map.values);
        let (x, z) = if back { (-x, -z) } else { (x, z) };
        let local = match map.frame {
            NormalFrame::Blade => DVec3::new(x, y, z),
            NormalFrame::Tangent => {
                let tangents = &self.leaf.mesh.tangents;
                let t = self.corner.iter().zip(self.weight).map(|(&c, w)| tangents[c] * w).sum::<DVec4>();
                let smooth = self.smooth;
                let along = (t.truncate() - smooth * smooth.dot(t.truncate())).normalize_or_zero();
                along * x + smooth.cross(along) * (t.w.signum() * y) + smooth * z
            }
        };
        (self.turn * local).normalize_or(plain)
    }

    /// ρd of the viewed side, with γ.
    pub fn rho_d(&self) -> [f64; 3] {
        reflectance(self.viewed(), &self.taps(false))
    }

    /// ρt of a beam that enters at the far side.
    pub fn rho_t(&self) -> [f64; 3] {
        transmittance(self.far(), &self.taps(true))
    }

    /// ρt of a beam that enters at the viewed side.
    pub fn rho_t_inward(&self) -> [f64; 3] {
        transmittance(self.viewed(), &self.taps(false))
    }

    /// Derivatives of ρd, ρt and ρs, and of m, where front and back of the leaf have these derivatives, which are looks
    /// themselves.
    pub fn by_look(&self, sides: &[ReferenceSide; 2]) -> ([[f64; 3]; 3], f64) {
        let (viewed, far) = (&sides[usize::from(self.back)], &sides[usize::from(!self.back)]);
        let taps = self.taps(false);
        let gloss = viewed.gloss.as_ref().map(|gloss| (taps.colour(&gloss.rho_s), taps.scalar(&gloss.m)));
        let (rho_s, m) = gloss.unwrap_or_default();
        ([reflectance(viewed, &taps), transmittance(far, &self.taps(true)), rho_s], m)
    }

    /// ρs and m of the viewed side; `None` if it is not glossy.
    pub fn gloss(&self) -> Option<([f64; 3], f64)> {
        let gloss = self.viewed().gloss.as_ref()?;
        let taps = self.taps(false);
        Some((taps.colour(&gloss.rho_s), taps.scalar(&gloss.m)))
    }

    /// The factor that replaces ρt times a cosine, where maps describe how the sun's light passes; `rho_t` is
    /// [`Surface::rho_t`].
    pub fn through(&self, sunlit: &SunlitMaps, rho_t: impl FnOnce() -> [f64; 3]) -> [f64; 3] {
        match sunlit {
            SunlitMaps::Factor(map) => {
                let f = self.taps(true).scalar(map).max(0.0);
                rho_t().map(|r| r * f)
            }
            SunlitMaps::Colour(maps) => self.taps(true).colour(maps).map(|m| m.max(0.0)),
        }
    }
}

/// The rotation of a placement, without its scale.
pub(super) fn rotation(placed: &ReferencePlacement) -> DMat3 {
    let m = DMat3::from_mat4(placed.transform);
    m * (1.0 / m.determinant().abs().cbrt())
}

fn corners(leaf: &ReferenceLeaf, triangle: usize) -> [usize; 3] {
    [0, 1, 2].map(|k| leaf.mesh.indices[3 * triangle + k] as usize)
}

fn texture_point(leaf: &ReferenceLeaf, triangle: usize, barycentric: [f64; 2]) -> DVec2 {
    if leaf.width * leaf.height == 1 {
        // A single texel is the same everywhere.
        return DVec2::ZERO;
    }
    let [a, b, c] = corners(leaf, triangle).map(|k| leaf.mesh.uvs[k]);
    a + (b - a) * barycentric[0] + (c - a) * barycentric[1]
}

/// Whether [`Stage::on_leaf`] holds at every point of a triangle: all texels that its points can read are on.
fn solid(leaf: &ReferenceLeaf, triangle: usize) -> bool {
    if leaf.mesh.discs {
        return false;
    }
    let Some(mask) = &leaf.mask else { return true };
    let uvs = corners(leaf, triangle).map(|k| leaf.mesh.uvs[k]);
    let (low, high) = (uvs[0].min(uvs[1]).min(uvs[2]), uvs[0].max(uvs[1]).max(uvs[2]));
    let (columns, rows) = (texels(low.x, high.x, leaf.width), texels(low.y, high.y, leaf.height));
    rows.into_iter().all(|j| mask[j * leaf.width..][columns.clone()].iter().all(|on| *on != 0))
}

fn reflectance(side: &ReferenceSide, taps: &TexelTaps) -> [f64; 3] {
    match &side.interior {
        ReferenceInterior::Maps { rho_d, .. } => taps.colour(rho_d),
        ReferenceInterior::Scalars { gamma, thickness, curve } => {
            let (rho_d, gamma) = (curve(taps.scalar(thickness)).0, taps.colour(gamma));
            [0, 1, 2].map(|c| gamma[c] * rho_d[c])
        }
    }
}

fn transmittance(side: &ReferenceSide, taps: &TexelTaps) -> [f64; 3] {
    match &side.interior {
        ReferenceInterior::Maps { rho_t, .. } => taps.colour(rho_t),
        ReferenceInterior::Scalars { thickness, curve, .. } => curve(taps.scalar(thickness)).1,
    }
}
