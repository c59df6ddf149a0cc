//! Meshes and instances on the adapter. Each quantity of a vertex has a buffer of its own, so that a quantity that no
//! shader reads is never uploaded. A mesh in a material needs one instanced draw for each level of detail, however
//! often the two occur.

use crate::bend::Moved;
use crate::detail::{self, Levels};
use crate::gpu::Gpu;
use crate::passes::bend::BendPass;
use crate::passes::choose::Choice;
use crate::passes::place::{PlacePass, Placed};
use crate::passes::{bend, pose};
use crate::scene::{Carried, Instance, Mesh, Poses, Scene, Section, Sections, Wind};
use crate::stats::Stats;
use crate::thin::Seen;
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
    /// Uploads those parts of mesh `index` that the shaders of `batches` read.
    pub(crate) fn new(gpu: &Gpu, index: usize, mesh: &Mesh, batches: &[Batch], stats: &mut Stats) -> MeshOnGpu {
        let mut put = |name: &str, bytes: &[u8], usage| put(gpu, &format!("mesh {index} {name}"), bytes, usage, stats);
        let mut out = MeshOnGpu {
            positions: put("positions", bytemuck::cast_slice(&mesh.positions), Use::VERTEX),
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
    pub(crate) fn complete(&mut self, gpu: &Gpu, index: usize, mesh: &Mesh, batches: &[Batch], stats: &mut Stats) {
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

/// All instances of one mesh in one material. They take one draw for each level of detail.
pub(crate) struct Batch {
    pub mesh: usize,
    pub material: usize,
    pub variant: Variant,
    pub levels: Levels,
    pub instances: wgpu::Buffer,
    pub count: u32,
    /// Whether any of them casts a shadow.
    pub casts: bool,
    /// The section that carries each instance, where any is carried.
    pub rides: Option<wgpu::Buffer>,
    /// The instances as they have moved, where each moves as a whole.
    pub placed: Placed,
    /// What the adapter chooses of them, where it does.
    pub choice: Option<Choice>,
    /// The first row of arriving light and the first share of the sun of each instance, where either is read.
    pub begins: Option<wgpu::Buffer>,
}

impl Batch {
    /// Uploads everything that stands in the scene, ordered by material and then by mesh.
    pub(crate) fn all(gpu: &Gpu, scene: &Scene, stats: &mut Stats) -> Vec<Batch> {
        let mut together: BTreeMap<(usize, usize), Vec<Instance>> = BTreeMap::new();
        for instance in scene.instances.iter().filter(|i| !scene.meshes[i.mesh].indices.is_empty()) {
            together.entry((instance.material, instance.mesh)).or_default().push(*instance);
        }
        let batch = |((material, mesh), instances): ((usize, usize), Vec<Instance>)| {
            let variant = Variant::new(gpu, scene, &instances)?;
            let rows: Vec<[[f32; 4]; 3]> = instances.iter().map(detail::rows).collect();
            let rides: Vec<[f32; 2]> = instances.iter().map(bend::ride).collect();
            let begins: Vec<[u32; 2]> = instances.iter().map(detail::begin).collect();
            let mut put = |name: &str, bytes: &[u8]| {
                put(gpu, &format!("{name} of mesh {mesh}"), bytes, Use::VERTEX | Use::STORAGE | Use::COPY_DST, stats)
            };
            Some(Batch {
                mesh,
                material,
                levels: Levels::new(&scene.meshes[mesh], &instances, variant.leaf().is_some(), scene.in_full),
                instances: put("instances", bytemuck::cast_slice(&rows)),
                count: rows.len() as u32,
                casts: instances.iter().any(|i| !i.floor),
                rides: bend::needs(scene, &instances).then(|| put("rides", bytemuck::cast_slice(&rides))),
                placed: Placed::default(),
                choice: None,
                begins: variant.begins().then(|| put("beginnings", bytemuck::cast_slice(&begins))),
                variant,
            })
        };
        together.into_iter().filter_map(batch).collect()
    }

    /// Whether each instance moves as a whole, or not at all, and some move.
    pub(crate) fn moves_whole(&self) -> bool {
        self.rides.is_some() && !self.variant.bend
    }

    /// Moves the instances, if they move as wholes.
    pub(crate) fn place(&mut self, gpu: &Gpu, pass: &mut wgpu::ComputePass<'_>, place: &PlacePass, bend: &BendPass) {
        let Some(rides) = self.rides.as_ref().filter(|_| !self.variant.bend) else { return };
        place.record(gpu, pass, bend, (&self.instances, rides, self.count), &mut self.placed.all);
        match self.levels.enlarged() {
            Some(rows) => place.record(gpu, pass, bend, (rows, rides, self.count), &mut self.placed.enlarged),
            None => self.placed.enlarged = None,
        }
        match self.levels.thinned() {
            Some(few) => {
                place.record(gpu, pass, bend, (&few.instances, &few.rides, few.count), &mut self.placed.thinned);
            }
            None => self.placed.thinned = None,
        }
    }

    /// The rows of the instances for the main pass.
    pub(crate) fn shown(&self) -> &wgpu::Buffer {
        if let Some(choice) = &self.choice {
            return &choice.rows;
        }
        let placed = self.placed.enlarged.as_ref().or(self.placed.all.as_ref());
        placed.or(self.levels.enlarged()).unwrap_or(&self.instances)
    }

    /// Their first rows of arriving light and first shares of the sun.
    pub(crate) fn shown_begins(&self) -> Option<&wgpu::Buffer> {
        self.choice.as_ref().map_or(self.begins.as_ref(), |choice| choice.begins.as_ref())
    }

    /// Chooses on the CPU what a picture shows.
    pub(crate) fn arrange(&mut self, gpu: &Gpu, seen: &Seen) {
        self.levels.arrange(gpu, seen, &self.instances, self.rides.as_ref(), self.begins.as_ref());
    }

    /// Takes the instances back to their own order, if the adapter chooses from it.
    pub(crate) fn put_back(&mut self, gpu: &Gpu) {
        if self.choice.is_some() {
            self.levels.put_back(gpu, &self.instances, self.rides.as_ref(), self.begins.as_ref());
        }
    }

    /// The rows of the instances for shadow maps, the sections that carry them where these are read, and their number.
    pub(crate) fn casting(&self) -> (&wgpu::Buffer, Option<&wgpu::Buffer>, u32) {
        let (placed, bends) = (&self.placed, self.variant.bend);
        match self.levels.thinned() {
            Some(few) => (placed.thinned.as_ref().unwrap_or(&few.instances), bends.then_some(&few.rides), few.count),
            None => (placed.all.as_ref().unwrap_or(&self.instances), self.rides.as_ref().filter(|_| bends), self.count),
        }
    }
}

fn put(gpu: &Gpu, label: &str, bytes: &[u8], usage: Use, stats: &mut Stats) -> wgpu::Buffer {
    stats.upload(label, bytes.len() as u64);
    gpu.buffer(label, bytes, usage)
}

/// Layouts of the vertex buffers, in the order position, normal, tangent, uv, instance, ride, first row and first
/// share, place among anchors. A quantity whose argument is `false` is left out.
pub(crate) fn vertex_layouts(
    normal: bool,
    tangent: bool,
    uv: bool,
    ride: bool,
    begin: bool,
    place: bool,
) -> Vec<Option<wgpu::VertexBufferLayout<'static>>> {
    const POSITION: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![0 => Float32x3];
    const NORMAL: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![1 => Float32x3];
    const TANGENT: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![2 => Float32x4];
    const UV: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![3 => Float32x2];
    const WORLD: [wgpu::VertexAttribute; 3] = wgpu::vertex_attr_array![4 => Float32x4, 5 => Float32x4, 6 => Float32x4];
    const RIDE: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![7 => Float32x2];
    const BEGIN: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![9 => Uint32x2];
    const PLACE: [wgpu::VertexAttribute; 1] = wgpu::vertex_attr_array![8 => Float32x3];
    let layout =
        |array_stride, step_mode, attributes| Some(wgpu::VertexBufferLayout { array_stride, step_mode, attributes });
    let mut layouts = vec![layout(12, wgpu::VertexStepMode::Vertex, &POSITION[..])];
    if normal {
        layouts.push(layout(12, wgpu::VertexStepMode::Vertex, &NORMAL));
    }
    if tangent {
        layouts.push(layout(16, wgpu::VertexStepMode::Vertex, &TANGENT));
    }
    if uv {
        layouts.push(layout(8, wgpu::VertexStepMode::Vertex, &UV));
    }
    layouts.push(layout(48, wgpu::VertexStepMode::Instance, &WORLD));
    if ride {
        layouts.push(layout(8, wgpu::VertexStepMode::Instance, &RIDE));
    }
    if begin {
        layouts.push(layout(8, wgpu::VertexStepMode::Instance, &BEGIN));
    }
    if place {
        layouts.push(layout(12, wgpu::VertexStepMode::Vertex, &PLACE));
    }
    layouts
}

/// Points around every instance at rest, in world space, and what carries them. They are the corners of boxes, or every
/// vertex where a mesh bends.
pub(crate) struct Extents {
    /// What casts a shadow stands first.
    points: Vec<(Option<Carried>, Vec<Vec3>)>,
    /// How many of these cast a shadow.
    casters: usize,
    sections: Option<Sections>,
    /// Balls that hold all poses, where the adapter poses what is carried.
    reach: Option<Vec<(Vec3, f32)>>,
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

impl Extents {
    pub(crate) fn new(scene: &Scene) -> Extents {
        Extents::of(scene, scene.sections.as_ref().and_then(|s| s.poses.as_deref()))
    }

    /// Where the adapter poses what is carried, the extents are those at rest, and the ball holds all poses.
    fn of(scene: &Scene, poses: Option<&Poses>) -> Extents {
        let boxes: Vec<Option<[Vec3; 8]>> = scene.meshes.iter().map(|mesh| corners(&mesh.positions)).collect();
        let points = scene.instances.iter().filter_map(|instance| {
            let by = instance.carried;
            let own = by.is_some_and(|c| c.vertices.is_some()) && poses.is_none();
            let around = if own { &scene.meshes[instance.mesh].positions } else { &boxes[instance.mesh]?[..] };
            let points = around.iter().map(|p| instance.transform.transform_point3(*p)).collect();
            Some(((by, points), instance.floor))
        });
        // Lawns cast no shadow.
        let lawns = scene.grass.iter().map(|grass| {
            let far = (grass.high - grass.low).extend(grass.height);
            let corner = |k: u32| {
                let at = Vec3::new((k & 1) as f32, (k >> 1 & 1) as f32, (k >> 2) as f32);
                grass.origin + grass.low.extend(0.0) + at * far
            };
            ((None, (0..8).map(corner).collect()), true)
        });
        let (floors, mut points): (Vec<_>, Vec<_>) = points.chain(lawns).partition(|(_, floor)| *floor);
        let casters = points.len();
        points.extend(floors);
        Extents {
            points: points.into_iter().map(|(one, _)| one).collect(),
            casters,
            sections: scene.sections.clone(),
            reach: poses.map(|poses| pose::reach(scene, poses)),
        }
    }

    /// The points of what casts shadows and is not carried.
    pub(crate) fn still(&self) -> Vec<Vec3> {
        let still = self.points[..self.casters].iter().filter(|(by, _)| by.is_none());
        still.flat_map(|(_, points)| points).copied().collect()
    }

    /// Boxes around what stands in the scene at rest, as two corners: one around all that casts shadows, and one around
    /// each thing that does not.
    pub(crate) fn boxes(&self) -> Vec<[Vec3; 2]> {
        let around = |points: &mut dyn Iterator<Item = &Vec3>| {
            let first = *points.next()?;
            Some(points.fold([first; 2], |[low, high], p| [low.min(*p), high.max(*p)]))
        };
        let (casters, others) = self.points.split_at(self.casters);
        let all = around(&mut casters.iter().flat_map(|(_, points)| points));
        all.into_iter().chain(others.iter().filter_map(|(_, points)| around(&mut points.iter()))).collect()
    }

    pub(crate) fn sections(&self) -> Option<&Sections> {
        self.sections.as_ref()
    }

    /// The scene's extents at a time of its wind.
    pub(crate) fn at(&self, wind: Option<&Wind>) -> ExtentsNow {
        let sections = self.sections.as_ref().filter(|_| self.reach.is_none());
        let moved = Moved::new(sections, sections.map_or_else(Vec::new, |s| s.now(wind)));
        let mut points = Vec::with_capacity(self.points.iter().map(|(_, points)| points.len()).sum());
        let mut casting = 0;
        for (k, (by, own)) in self.points.iter().enumerate() {
            points.extend(own.iter().enumerate().map(|(n, p)| moved.place(*by, n, *p)));
            if k < self.casters {
                casting = points.len();
            }
        }
        let reach = self.reach.iter().flatten();
        let ends = reach.flat_map(|(centre, radius)| [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| (*centre, *radius * axis)));
        let far: Vec<Vec3> = ends.flat_map(|(centre, arm)| [centre - arm, centre + arm]).collect();
        let ball = match far.is_empty() {
            true => ball(&points),
            false => ball(&points.iter().chain(&far).copied().collect::<Vec<Vec3>>()),
        };
        points.truncate(casting);
        ExtentsNow { ball, casters: points, sections: moved.into_sections() }
    }
}

/// The extents of a scene at one time.
pub(crate) struct ExtentsNow {
    /// The motions of all sections; none where the adapter computes them.
    pub sections: Vec<Section>,
    /// The points that shadow maps must cover: everything that casts a shadow.
    pub casters: Vec<Vec3>,
    /// Centre and radius of a ball around everything, which clipping planes must cover.
    pub ball: (Vec3, f32),
}

/// Centre and radius of a ball around everything that a scene shows, as bent at its time.
pub fn ball_around(scene: &Scene) -> (Vec3, f32) {
    Extents::of(scene, None).at(scene.wind.as_ref()).ball
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
