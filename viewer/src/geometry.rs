//! Meshes and instances on the adapter. Each quantity of a vertex has a buffer of its own, so that a quantity that no
//! shader reads is never uploaded; only a vertex's section comes with its position. A mesh in a material needs one
//! instanced draw for each level of detail, however often the two occur.

use crate::detail::{self, InstanceInputs, Levels};
use crate::extents::bounds;
use crate::far::{FarPlants, thinned};
use crate::gpu::Gpu;
use crate::passes::bend::{self, BendPass, Carrier, Ride};
use crate::passes::bounds::reach;
use crate::passes::choose::Choice;
use crate::passes::place::{PlacePass, Placed};
use crate::scene::{Instance, Mesh, Scene};
use crate::stand::{self, Falls, StandBatch};
use crate::stats::RenderStatistics;
use crate::thinning::Seen;
use crate::variant::Variant;
use glam::{Mat4, Vec3};
use std::collections::BTreeMap;
use wgpu::BufferUsages as Use;

/// A mesh on the adapter.
pub(crate) struct MeshOnGpu {
    pub positions: wgpu::Buffer,
    pub normals: wgpu::Buffer,
    pub tangents: Option<wgpu::Buffer>,
    pub uvs: Option<wgpu::Buffer>,
    /// Places of the vertices among the anchors, where light arrives by a transfer.
    pub places: Option<wgpu::Buffer>,
    pub indices: wgpu::Buffer,
}

impl MeshOnGpu {
    /// Uploads those parts of mesh `index` that the shaders of `batches` read; `None` where none of them draws it.
    pub(crate) fn new(
        gpu: &Gpu,
        index: usize,
        mesh: &Mesh,
        batches: &[Batch],
        stats: &mut RenderStatistics,
    ) -> Option<MeshOnGpu> {
        let positions = bytemuck::cast_slice(&mesh.positions);
        let draws = batches.iter().any(|b| b.mesh == index && b.alone.is_none());
        draws.then(|| MeshOnGpu::of(gpu, index, mesh, positions, batches, stats))
    }

    /// Uploads the mesh of an instance whose vertices have sections of their own.
    pub(crate) fn carried(
        gpu: &Gpu,
        scene: &Scene,
        points: &[Vec3],
        batch: &Batch,
        stats: &mut RenderStatistics,
    ) -> Option<MeshOnGpu> {
        let (positions, mesh) = bend::by_vertices(scene, &scene.instances[batch.alone?], points)?;
        let positions = bytemuck::cast_slice(&positions);
        Some(MeshOnGpu::of(gpu, batch.mesh, &mesh, positions, std::slice::from_ref(batch), stats))
    }

    fn of(
        gpu: &Gpu,
        index: usize,
        mesh: &Mesh,
        positions: &[u8],
        batches: &[Batch],
        stats: &mut RenderStatistics,
    ) -> MeshOnGpu {
        let mut put = |name: &str, bytes: &[u8], usage| put(gpu, &format!("mesh {index} {name}"), bytes, usage, stats);
        let mut out = MeshOnGpu {
            positions: put("positions", positions, Use::VERTEX),
            normals: put("normals", bytemuck::cast_slice(&mesh.normals), Use::VERTEX),
            tangents: None,
            uvs: None,
            places: None,
            indices: put("indices", bytemuck::cast_slice(&detail::indices(mesh)), Use::INDEX),
        };
        out.complete(gpu, index, mesh, batches, stats);
        out
    }

    /// Uploads the parts that the shaders of `batches` read and that are not on the adapter yet.
    pub(crate) fn complete(
        &mut self,
        gpu: &Gpu,
        index: usize,
        mesh: &Mesh,
        batches: &[Batch],
        stats: &mut RenderStatistics,
    ) {
        let read = |of: fn(&Variant) -> bool| batches.iter().any(|b| b.mesh == index && of(&b.variant));
        if self.tangents.is_none() && read(Variant::tangent) {
            let bytes = bytemuck::cast_slice(&mesh.tangents);
            self.tangents = Some(put(gpu, &format!("mesh {index} tangents"), bytes, Use::VERTEX, stats));
        }
        if self.uvs.is_none() && read(|v| v.leaf().is_some()) {
            let bytes = bytemuck::cast_slice(&mesh.uvs);
            self.uvs = Some(put(gpu, &format!("mesh {index} uvs"), bytes, Use::VERTEX, stats));
        }
        if let (None, Some(anchors), true) = (&self.places, &mesh.anchors, read(|v| v.anchored.is_some())) {
            let bytes = bytemuck::cast_slice(&anchors.places);
            self.places = Some(put(gpu, &format!("mesh {index} places among anchors"), bytes, Use::VERTEX, stats));
        }
    }
}

/// Material, mesh and stand of a batch, and the instance whose vertices have sections of their own.
pub(crate) type BatchKey = (usize, usize, Option<u32>, Option<usize>);

/// All instances of one mesh in one material. They take one draw for each level of detail. An instance whose vertices
/// have sections of their own is a batch by itself.
pub(crate) struct Batch {
    pub mesh: usize,
    pub material: usize,
    /// The index of the instance whose vertices have sections of their own, and its mesh, which has no rows.
    pub alone: Option<usize>,
    pub own: Option<MeshOnGpu>,
    /// The places of its plants, where they are many. `instances` then has a plant's leaves in its own frame.
    pub stand: Option<StandBatch>,
    pub variant: Variant,
    pub levels: Levels,
    pub instances: wgpu::Buffer,
    pub count: u32,
    /// Whether any of them casts a shadow.
    pub casts: bool,
    /// How sections carry the instances, where they carry any.
    pub ride: Option<Ride>,
    /// The section that carries each instance, where they carry instances.
    pub rides: Option<wgpu::Buffer>,
    /// The instances as they have moved, where each moves as a whole.
    pub placed: Placed,
    /// What the adapter chooses of them, where it does.
    pub choice: Option<Choice>,
    /// The first row of arriving light and the first share of the sun of each instance, where either is read.
    pub begins: Option<wgpu::Buffer>,
}

impl Batch {
    /// Uploads everything that stands in the scene, ordered by material and then by mesh. `points` are those of all
    /// sections at rest.
    pub(crate) fn all(
        gpu: &Gpu,
        scene: &Scene,
        points: &[Vec3],
        known: &mut FarPlants,
        stats: &mut RenderStatistics,
    ) -> Vec<Batch> {
        // In closed form a branch may come out of its ball.
        let poses = scene.sections.as_ref().and_then(|s| s.poses.as_ref()).filter(|p| !p.closed_form);
        let reach = poses.map_or_else(Vec::new, |poses| reach(scene, poses));
        let stands = bounds(scene);
        let mut together: BTreeMap<BatchKey, Vec<Instance>> = BTreeMap::new();
        for (k, instance) in scene.instances.iter().enumerate() {
            if !scene.meshes[instance.mesh].indices.is_empty() {
                let alone = bend::alone(scene, instance).then_some(k);
                together.entry((instance.material, instance.mesh, instance.stand, alone)).or_default().push(*instance);
            }
        }
        let far = thinned(scene, &together, &stands, known);
        let batch = |(key, instances): (BatchKey, Vec<Instance>)| {
            let (material, mesh, of, alone) = key;
            let variant = Variant::new(gpu, scene, &instances)?;
            let rows: Vec<[[f32; 4]; 3]> = instances.iter().map(|i| bend::rows(scene, i, points)).collect();
            let rides: Vec<Carrier> = instances.iter().map(bend::ride).collect();
            let begins: Vec<[u32; 2]> = instances.iter().map(detail::begin).collect();
            let mut put = |name: &str, bytes: &[u8]| {
                put(gpu, &format!("{name} of mesh {mesh}"), bytes, Use::VERTEX | Use::STORAGE | Use::COPY_DST, stats)
            };
            let ride = bend::kind(scene, &instances);
            let limbs = alone
                .filter(|_| !reach.is_empty() && of.is_none())
                .and_then(|k| bend::branches(scene, &scene.instances[k]));
            let mut trunks: Vec<(Vec3, f32)> = limbs.into_iter().flatten().map(|limb| reach[limb]).collect();
            // The branches of a trunk mostly follow each other.
            trunks.dedup();
            let far = of.filter(|_| alone.is_none()).and_then(|k| far.get(&(k, material, mesh)));
            let stand = of.map(|k| (&scene.stands[k as usize], &stands[k as usize]));
            let put_rows = match stand {
                Some(_) => put("leaves", bytemuck::cast_slice(&stand::leaves(&rows, &rides, far))),
                None => put("instances", bytemuck::cast_slice(&rows)),
            };
            let carried = ride == Some(Ride::Instances) && stand.is_none();
            let rides_put = carried.then(|| put("rides", bytemuck::cast_slice(&rides)));
            let begins_put = variant.begins().then(|| put("beginnings", bytemuck::cast_slice(&begins)));
            let inputs = InstanceInputs { rows, rides, begins };
            let leaf = variant.leaf().is_some();
            let mut levels = Levels::new(&scene.meshes[mesh], &instances, inputs, trunks, leaf, scene.in_full);
            let stand = stand.map(|(stand, bounds)| {
                levels.scale_up(bounds.largest);
                StandBatch::new(gpu, stand, bounds, &instances, far.cloned())
            });
            Some(Batch {
                mesh,
                material,
                alone,
                own: None,
                stand,
                ride,
                instances: put_rows,
                count: instances.len() as u32,
                casts: instances.iter().any(|i| !i.floor),
                rides: rides_put,
                placed: Placed::default(),
                choice: None,
                begins: begins_put,
                levels,
                variant,
            })
        };
        together.into_iter().filter_map(batch).collect()
    }

    /// Uploads what its shader reads of a mesh of its own and what is not on the adapter yet.
    pub(crate) fn complete(&mut self, gpu: &Gpu, scene: &Scene, stats: &mut RenderStatistics) {
        let lacks = |own: &mut MeshOnGpu| {
            (own.tangents.is_none() && self.variant.tangent()) || (own.uvs.is_none() && self.variant.leaf().is_some())
        };
        let Some(mut own) = self.own.take_if(lacks) else { return };
        let instance = self.alone.map(|k| &scene.instances[k]);
        if let Some((_, mesh)) = instance.and_then(|i| bend::by_vertices(scene, i, &bend::points(scene))) {
            own.complete(gpu, self.mesh, &mesh, std::slice::from_ref(self), stats);
        }
        self.own = Some(own);
    }

    /// Those instances of the scene that are in the batch.
    pub(crate) fn of(&self, scene: &Scene) -> Vec<Instance> {
        let own = |(k, i): &(usize, &Instance)| match self.alone {
            Some(alone) => *k == alone,
            None => {
                (i.mesh, i.material, i.stand.is_some()) == (self.mesh, self.material, self.stand.is_some())
                    && !bend::alone(scene, i)
            }
        };
        scene.instances.iter().enumerate().filter(own).map(|(_, instance)| *instance).collect()
    }

    /// The sections that carry instances, where the vertex stage moves them.
    pub(crate) fn bending(&self) -> Option<&wgpu::Buffer> {
        self.rides.as_ref().filter(|_| self.variant.bend.is_some())
    }

    /// The sections of instances that each move as a whole, or not at all; `None` where none moves so.
    pub(crate) fn moving_whole(&self) -> Option<&wgpu::Buffer> {
        self.rides.as_ref().filter(|_| self.variant.bend.is_none())
    }

    /// Whether the next picture needs instances that are moved before it, or its shadow `maps` do.
    pub(crate) fn places(&self, maps: bool) -> bool {
        self.moving_whole().is_some() && (self.choice.is_none() || maps && self.casts)
    }

    /// Moves the instances, if they move as wholes, as far as a picture needs it, and shadow maps if there are `maps`.
    /// What the adapter chooses for a picture it moves itself.
    pub(crate) fn place(
        &mut self,
        gpu: &Gpu,
        pass: &mut wgpu::ComputePass<'_>,
        place: &PlacePass,
        bend: &BendPass,
        maps: bool,
    ) {
        let Some(rides) = self.moving_whole().cloned().filter(|_| self.places(maps)) else { return };
        let (chosen, thinned) = (self.choice.is_some(), self.levels.thinned());
        if !chosen || (maps && self.casts && thinned.is_none()) {
            place.record(gpu, pass, bend, (&self.instances, &rides, self.count), &mut self.placed.all);
        }
        match self.levels.enlarged() {
            Some(rows) => place.record(gpu, pass, bend, (rows, &rides, self.count), &mut self.placed.enlarged),
            None => self.placed.enlarged = None,
        }
        match thinned {
            Some(few) if maps => {
                place.record(gpu, pass, bend, (&few.instances, &few.rides, few.count), &mut self.placed.thinned);
            }
            Some(_) => {}
            None => self.placed.thinned = None,
        }
    }

    /// The rows of the instances for the main pass, where the vertex stage reads any.
    pub(crate) fn shown(&self) -> Option<&wgpu::Buffer> {
        if let Some(choice) = &self.choice {
            return Some(&choice.rows);
        }
        let placed = self.placed.enlarged.as_ref().or(self.placed.all.as_ref());
        placed.or(self.levels.enlarged()).or(self.rows())
    }

    /// The rows of the instances at rest, where the vertex stage reads any.
    pub(crate) fn rows(&self) -> Option<&wgpu::Buffer> {
        Some(&self.instances).filter(|_| self.alone.is_none() && self.stand.is_none())
    }

    /// Their first rows of arriving light and first shares of the sun.
    pub(crate) fn shown_begins(&self) -> Option<&wgpu::Buffer> {
        self.choice.as_ref().map_or(self.begins.as_ref(), |choice| choice.begins.as_ref())
    }

    /// Chooses on the CPU what a picture shows.
    pub(crate) fn arrange(&mut self, gpu: &Gpu, seen: &Seen, sun: Option<Vec3>) {
        if let Some(stand) = &mut self.stand {
            return stand.arrange(gpu, seen, sun, &self.levels, &self.instances);
        }
        self.levels.arrange(gpu, seen, &self.instances, self.rides.as_ref(), self.begins.as_ref());
    }

    /// Chooses on the CPU what shadow maps show whose texels have this side.
    pub(crate) fn cast(&mut self, gpu: &Gpu, texel: f32, sun: Vec3, falls: Option<&Falls>) {
        match &mut self.stand {
            Some(stand) => stand.cast(gpu, texel, sun, falls, &self.levels, &self.instances),
            None => self.levels.thin_maps(gpu, texel),
        }
    }

    /// The largest distance between the surface that is drawn and the surface in the shadow maps, as far as the CPU
    /// knows it.
    pub(crate) fn apart(&self, texel: f32) -> f32 {
        match (&self.stand, &self.choice) {
            (Some(stand), _) => stand.seen.apart + stand.apart_in_maps(texel, &self.levels),
            (None, Some(_)) => self.levels.apart_in_maps(texel),
            (None, None) => self.levels.apart(texel),
        }
    }

    /// Number of triangles that the main pass draws of what the CPU has chosen.
    pub(crate) fn triangles(&self) -> u64 {
        match (&self.stand, &self.choice) {
            (Some(stand), _) => stand.seen.triangles(),
            (None, Some(_)) => 0,
            (None, None) => self.levels.triangles(),
        }
    }

    /// Takes the instances back to their own order, if the adapter chooses from it.
    pub(crate) fn put_back(&mut self, gpu: &Gpu) {
        if self.choice.is_some() {
            self.levels.put_back(gpu, &self.instances, self.rides.as_ref(), self.begins.as_ref());
        }
    }

    /// The rows of the instances for shadow maps and the sections that carry them, where either is read, and their
    /// number.
    pub(crate) fn casting(&self) -> (Option<&wgpu::Buffer>, Option<&wgpu::Buffer>, u32) {
        let (placed, bending) = (&self.placed, self.bending());
        match self.levels.thinned() {
            Some(few) => (placed.thinned.as_ref().or(Some(&few.instances)), bending.map(|_| &few.rides), few.count),
            None => (placed.all.as_ref().or(self.rows()), bending, self.count),
        }
    }
}

fn put(gpu: &Gpu, label: &str, bytes: &[u8], usage: Use, stats: &mut RenderStatistics) -> wgpu::Buffer {
    stats.upload(label, bytes.len() as u64);
    gpu.buffer(label, bytes, usage)
}

/// The corners of the box around points; `None` where there are none.
pub(crate) fn corners(points: &[Vec3]) -> Option<[Vec3; 8]> {
    let first = *points.first()?;
    let (low, high) = points.iter().fold((first, first), |(low, high), p| (low.min(*p), high.max(*p)));
    let pick = |k: usize, bit: usize, l: f32, h: f32| if k & bit == 0 { l } else { h };
    Some(std::array::from_fn(|k| {
        Vec3::new(pick(k, 1, low.x, high.x), pick(k, 2, low.y, high.y), pick(k, 4, low.z, high.z))
    }))
}

/// Centre and radius of a ball around points; a unit ball where there are none.
pub(crate) fn ball(points: &[Vec3]) -> (Vec3, f32) {
    let Some(first) = points.first() else { return (Vec3::ZERO, 1.0) };
    let (low, high) = points.iter().fold((*first, *first), |(l, h), p| (l.min(*p), h.max(*p)));
    let centre = 0.5 * (low + high);
    (centre, points.iter().map(|p| p.distance(centre)).fold(1e-3, f32::max))
}

/// The matrix from world space to the picture, with an infinite far plane and reversed depth (1 near, 0 far). This
/// keeps precision at all distances.
pub(crate) fn view_projection(camera: &crate::scene::Camera, aspect: f32, near: f32) -> Mat4 {
    let view = glam::camera::rh::view::look_at_mat4(camera.eye, camera.target, camera.up.normalize());
    glam::camera::rh::proj::directx::perspective_infinite_reverse(camera.fov_y_deg.to_radians(), aspect, near) * view
}

/// The matrix from world space to a scanner's picture: a parallel projection along its camera onto z = 0. Depth grows
/// towards the camera.
pub(crate) fn parallel_projection(scanner: &crate::scene::Scanner, width: u32, height: u32, radius: f32) -> Mat4 {
    let scale = glam::vec2(width as f32, height as f32).recip() * (2.0 / scanner.pixel_mm);
    let slant = scanner.camera.truncate() / scanner.camera.z;
    Mat4::from_cols(
        glam::vec4(scale.x, 0.0, 0.0, 0.0),
        glam::vec4(0.0, scale.y, 0.0, 0.0),
        glam::vec4(-scale.x * slant.x, -scale.y * slant.y, 0.25 / radius.max(1e-3), 0.0),
        glam::vec4(0.0, 0.0, 0.5, 1.0),
    )
}
