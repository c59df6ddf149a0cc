//! A world prepared for rays: what a ray hits first, and the properties of the surface there.
//!
//! Both CPU renderers use it: the direct-light reference ([`super::render`]) and the path tracer ([`super::path`]).

use super::accelerate::{InstanceForest, Ray, RayHit, TriangleTree, fetch};
use super::foliar::FoliarMaterial;
use super::lookup::{TexelTaps, texels};
use super::repetition::{Cell, Repeat};
use super::surface::{Surface, corners, texture_point};
use super::world::{ReferenceLeaf, ReferencePlacement, ReferenceWorld, SunlitMaps};
use glam::{DMat3, DMat4, DVec3};

/// A world with its trees of boxes.
pub(super) struct Stage<'a> {
    pub world: &'a ReferenceWorld,
    forest: InstanceForest,
    repeat: Option<Repeat>,
    /// For each instance of the forest, the number of the world's instance, and for each place of the forest the
    /// world's place. Where the world repeats, several have the same; where it does not, no place is listed.
    instance: Vec<usize>,
    place: Vec<u32>,
    /// For each of the world's instances its leaf, and the rotation from there to the world, or to its group.
    leaf_of: Vec<usize>,
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
        let at = |p: &ReferencePlacement| (p.leaf, p.transform);
        let groups: Vec<Vec<_>> = world.groups.iter().map(|group| group.iter().map(at).collect()).collect();
        let Cell { placed, mut instance, places, place } = match world.periodic {
            Some(size) => Cell::of(world, size),
            None => Cell {
                placed: world.instances.iter().map(at).collect(),
                instance: (0..world.instances.len()).collect(),
                places: world.places.iter().map(|p| (p.group, p.transform)).collect(),
                place: Vec::new(),
            },
        };
        instance.extend(world.instances.len()..world.numbered().count());
        let forest = InstanceForest::with_groups(shapes, &placed, &groups, &places);
        let leaf_of = world.numbered().map(|p| p.leaf).collect();
        let turn = world.numbered().map(|p| rotation(&p.transform)).collect();
        // Far from the origin, the spacing of floating-point coordinates matters more than the size of the scene.
        let farthest = forest.bounds().map_or(0.0, |[low, high]| low.abs().max(high.abs()).max_element());
        let step = 1e-9 * forest.extent().max(farthest);
        let repeat = world
            .periodic
            .zip(forest.bounds())
            .map(|(size, [low, high])| Repeat { half: size.map(|s| 0.5 * s), height: [low.z - step, high.z + step] });
        Stage { world, forest, repeat, instance, place, leaf_of, turn, step }
    }

    /// The number of instances of the world, with those of groups.
    pub fn instances(&self) -> usize {
        self.leaf_of.len()
    }

    /// The index of an instance's leaf.
    pub fn leaf_index(&self, instance: usize) -> usize {
        self.leaf_of[instance]
    }

    /// The leaf of an instance.
    pub fn leaf(&self, instance: usize) -> &'a ReferenceLeaf {
        &self.world.leaves[self.leaf_of[instance]]
    }

    /// A number below 2³¹ for the leaf that was hit, which leaves near it do not have: that of the instance, or one
    /// after all instances where its group stands at another place than the first.
    pub fn number(&self, surface: &Surface) -> u32 {
        let members = (self.leaf_of.len() - self.world.instances.len()) as u64;
        ((surface.instance as u64 + members * u64::from(surface.place.unwrap_or(0))) % ((1 << 31) - 1)) as u32
    }

    /// A hit of the forest as one of the world.
    fn in_world(&self, hit: RayHit) -> RayHit {
        let place = hit.place.map(|place| self.place.get(place as usize).copied().unwrap_or(place));
        RayHit { instance: self.instance[hit.instance], place, ..hit }
    }

    /// The B1 model of an instance; `None` if it has none.
    pub fn foliar(&self, instance: usize) -> Option<&'a FoliarMaterial> {
        self.world.foliar.get(self.leaf_of[instance])?.as_deref()
    }

    /// The first hit of a ray.
    pub fn nearest(&self, ray: &Ray) -> Option<Met> {
        let find = |ray: &Ray, limit: f64| {
            let hit = self.forest.nearest_within(ray, limit, |i, t, b| self.on_leaf(i, t, b))?;
            Some(Met { ray: *ray, hit: self.in_world(hit) })
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
        let met = |(ray, hit): (&Ray, Option<RayHit>)| hit.map(|hit| Met { ray: *ray, hit: self.in_world(hit) });
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
        let own = self.turn[hit.instance];
        let turn = hit.place.map_or(own, |k| rotation(&self.world.places[k as usize].transform) * own);
        let corner = corners(leaf, hit.triangle);
        let weight = [1.0 - hit.barycentric[0] - hit.barycentric[1], hit.barycentric[0], hit.barycentric[1]];
        let mesh = &leaf.mesh;
        // The same numbers as the mesh's, and nearer: the ray has just been tried on them.
        let [p0, p1, p2] = self.forest.corners(self.leaf_of[hit.instance], hit.triangle);
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
            place: hit.place,
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

/// The rotation of a placement, without its scale.
pub(super) fn rotation(transform: &DMat4) -> DMat3 {
    let m = DMat3::from_mat4(*transform);
    m * (1.0 / m.determinant().abs().cbrt())
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
