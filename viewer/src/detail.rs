//! Levels of detail: which of a mesh's triangulations each instance is drawn with. The levels share the vertices, and
//! their indices follow each other in one buffer. When the camera needs another split, instances are sorted by level.
//! So a leaf needs one instanced draw for each level.

use crate::gpu::Gpu;
use crate::passes::bend::Carrier;
use crate::scene::{Camera, Instance, Mesh};
use crate::thinning::{MANY, Seen, enlarged, larger, ranks};
use glam::Vec3;
use std::ops::Range;

/// Largest error of a level in a picture (pixels), and in a shadow map (texels).
pub(crate) const PIXELS: f32 = 0.5;
const TEXELS: f32 = 0.25;
/// The same for what moves, whose shadow maps are drawn for each picture. It is as much as the maps' filter blurs.
const TEXELS_MOVING: f32 = 1.0;

/// What the vertex stage reads of each instance at rest.
pub(crate) struct InstanceInputs {
    /// The rows of its transform.
    pub rows: Vec<[[f32; 4]; 3]>,
    /// The section that carries it (`passes::bend`).
    pub rides: Vec<Carrier>,
    /// The first row of light that arrives at it, and the first of its shares of the sun ([`begin`]).
    pub begins: Vec<[u32; 2]>,
}

/// A ball around an instance at rest, and the instance's scale.
#[derive(Clone, Copy)]
struct InstanceBall {
    centre: Vec3,
    radius: f32,
    scale: f32,
}

/// The levels of a mesh, of which the mesh itself is the first, and the level of each instance.
pub(crate) struct Levels {
    /// Range of indices, and largest distance of the level from the mesh (units of the mesh).
    levels: Vec<(Range<u32>, f32)>,
    /// Number of levels that may be lit. The others are for shadow maps.
    lit: usize,
    /// A ball around the mesh.
    ball: (Vec3, f32),
    /// A ball around each instance at rest.
    spheres: Vec<InstanceBall>,
    /// What the vertex stage reads of each instance, in the order of the scene.
    inputs: InstanceInputs,
    /// The largest scale, and whether something moves an instance. A frame must not look through all instances for
    /// these.
    largest: f32,
    moves: bool,
    /// Whether nothing moves the instance away from its ball.
    still: Vec<bool>,
    /// Balls that hold what moves, however it moves; none where they are not known.
    reach: Vec<(Vec3, f32)>,
    /// The rank of each instance, where fewer and larger leaves may be drawn at a distance.
    ranks: Vec<f32>,
    chosen: Vec<u8>,
    /// The factor by which each instance is drawn larger; 0 where it is not drawn.
    sizes: Vec<f32>,
    /// The instances as the main pass draws them, if any is enlarged.
    enlarged: Option<wgpu::Buffer>,
    /// The instances as shadow maps draw them, where fewer and larger ones do.
    thinned: Option<Thinned>,
    /// Level and range of instances of each draw.
    runs: Vec<(usize, Range<u32>)>,
}

/// Fewer and larger instances, for shadow maps.
pub(crate) struct Thinned {
    /// Side of a texel for which they were chosen.
    texel: f32,
    pub instances: wgpu::Buffer,
    pub rides: wgpu::Buffer,
    pub count: u32,
}

/// The first row of light that arrives at an instance, with the level of its anchors in the four highest bits, and the
/// first of its shares of the sun.
pub(crate) fn begin(instance: &Instance) -> [u32; 2] {
    [instance.first_row | instance.first_level << 28, instance.first_share.unwrap_or(0)]
}

/// The triangles of the mesh itself, followed by those of its levels.
pub(crate) fn indices(mesh: &Mesh) -> Vec<u32> {
    mesh.indices.iter().chain(mesh.details.iter().flat_map(|d| &d.indices)).copied().collect()
}

/// The angle that a pixel covers (rad).
pub(crate) fn pixel(camera: &Camera, height: u32) -> f32 {
    2.0 * camera.half_height() / height.max(1) as f32
}

impl Levels {
    /// `reach` is a list of balls that hold all instances, however they move, if it is known. With `leaves`, fewer and
    /// larger instances may be drawn at a distance. `in_full`, all are drawn at their finest level.
    pub(crate) fn new(
        mesh: &Mesh,
        instances: &[Instance],
        inputs: InstanceInputs,
        reach: Vec<(Vec3, f32)>,
        leaves: bool,
        in_full: bool,
    ) -> Levels {
        let mut levels = vec![(0..mesh.indices.len() as u32, 0.0)];
        for detail in mesh.details.iter().filter(|_| !in_full) {
            let start = levels.last().map_or(0, |l| l.0.end);
            levels.push((start..start + detail.indices.len() as u32, detail.error));
        }
        let outlines = mesh.details.iter().filter(|d| d.outline_only && !in_full).count();
        let (centre, radius) = crate::geometry::ball(&mesh.positions);
        let sphere = |instance: &Instance| {
            let scale = instance.transform.x_axis.truncate().length();
            InstanceBall { centre: instance.transform.transform_point3(centre), radius: radius * scale, scale }
        };
        let n = instances.len();
        let spheres: Vec<InstanceBall> = instances.iter().map(sphere).collect();
        Levels {
            largest: spheres.iter().map(|s| s.scale).fold(0.0, f32::max),
            moves: instances.iter().any(|i| i.carried.is_some()),
            lit: levels.len() - outlines,
            levels,
            ball: (centre, radius),
            spheres,
            inputs,
            still: instances.iter().map(|i| i.carried.is_none()).collect(),
            reach,
            ranks: if leaves && n >= MANY && !in_full { ranks(n) } else { Vec::new() },
            chosen: vec![0; n],
            sizes: vec![1.0; n],
            enlarged: None,
            thinned: None,
            runs: vec![(0, 0..n as u32)],
        }
    }

    /// Takes into account that the instances stand where they are `factor` times as large at most.
    pub(crate) fn scale_up(&mut self, factor: f32) {
        self.largest *= factor;
    }

    /// The ball of an instance that is drawn `size` times as large.
    fn ball(&self, k: usize, size: f32) -> (Vec3, f32) {
        let InstanceBall { centre, radius, .. } = self.spheres[k];
        (centre, size * radius)
    }

    /// The rows of an instance that is drawn `size` times as large.
    fn larger(&self, k: usize, size: f32) -> [[f32; 4]; 3] {
        larger(&self.inputs.rows[k], self.ball.0, size)
    }

    /// The levels that may be lit: range of indices, and largest distance from the mesh.
    pub(crate) fn lit(&self) -> &[(Range<u32>, f32)] {
        &self.levels[..self.lit]
    }

    /// Whether there are levels besides the mesh itself, for pictures or for shadow maps.
    pub(crate) fn several(&self) -> bool {
        self.levels.len() > 1
    }

    /// The ball around each instance at rest: its centre, from the point of the section that carries the instance if
    /// one does, and the instance's scale.
    pub(crate) fn balls(&self) -> Vec<[f32; 4]> {
        let c = self.ball.0.extend(1.0);
        let one = |((rows, sphere), still): ((&[[f32; 4]; 3], &InstanceBall), &bool)| {
            let from_point = || Vec3::from(rows.map(|row| glam::Vec4::from_array(row).dot(c)));
            (if *still { sphere.centre } else { from_point() }).extend(sphere.scale).to_array()
        };
        self.inputs.rows.iter().zip(&self.spheres).zip(&self.still).map(one).collect()
    }

    /// Centre and radius of a ball around the mesh.
    pub(crate) fn around(&self) -> (Vec3, f32) {
        self.ball
    }

    /// The rank of each instance; none where all are drawn at any distance.
    pub(crate) fn ranks(&self) -> &[f32] {
        &self.ranks
    }

    /// The draws of the main pass: ranges of indices and of instances.
    pub(crate) fn runs(&self) -> impl Iterator<Item = (Range<u32>, Range<u32>)> + '_ {
        self.runs.iter().map(|(level, instances)| (self.levels[*level].0.clone(), instances.clone()))
    }

    /// The coarsest level whose error stays below `most` at every instance, and its largest error.
    fn everywhere(&self, most: f32) -> (usize, f32) {
        let scale = self.largest;
        let fits = |k: &usize| self.levels[*k].1 * scale <= most;
        let level = (0..self.levels.len()).rev().find(fits).unwrap_or(0);
        (level, self.levels[level].1 * scale)
    }

    /// The level for shadow maps whose texels have this side, and its largest error.
    fn in_maps(&self, texel: f32) -> (usize, f32) {
        self.everywhere(texel * if self.moves { TEXELS_MOVING } else { TEXELS })
    }

    /// Range of indices for the shadow pass, for maps whose texels have this side.
    pub(crate) fn shadow(&self, texel: f32) -> Range<u32> {
        self.levels[self.in_maps(texel).0].0.clone()
    }

    /// Chooses fewer and larger instances for shadow maps whose texels have this side, where they are below a few
    /// texels. What casts a shadow need not be seen, so the camera does not matter.
    pub(crate) fn thin_maps(&mut self, gpu: &Gpu, texel: f32) {
        if self.ranks.is_empty() || self.thinned.as_ref().is_some_and(|t| t.texel == texel) {
            return;
        }
        let size = |(rank, sphere): (&f32, &InstanceBall)| enlarged(2.0 * sphere.radius / texel.max(1e-30), *rank);
        let sizes: Vec<f32> = self.ranks.iter().zip(&self.spheres).map(size).collect();
        self.thinned = None;
        if sizes.iter().all(|size| *size == 1.0) {
            return;
        }
        let kept: Vec<usize> = (0..sizes.len()).filter(|k| sizes[*k] > 0.0).collect();
        let rows: Vec<[[f32; 4]; 3]> = kept.iter().map(|k| self.larger(*k, sizes[*k])).collect();
        let rides: Vec<Carrier> = kept.iter().map(|k| self.inputs.rides[*k]).collect();
        let put = |label: &str, bytes: &[u8]| {
            // No buffer is empty.
            gpu.buffer(
                label,
                if bytes.is_empty() { &[0; 48] } else { bytes },
                wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::STORAGE,
            )
        };
        self.thinned = Some(Thinned {
            texel,
            instances: put("instances in shadow maps", bytemuck::cast_slice(&rows)),
            rides: put("rides in shadow maps", bytemuck::cast_slice(&rides)),
            count: kept.len() as u32,
        });
    }

    /// The instances for shadow maps, if these are not all.
    pub(crate) fn thinned(&self) -> Option<&Thinned> {
        self.thinned.as_ref()
    }

    /// The largest distance between the surface that is drawn and the surface in the shadow maps.
    pub(crate) fn apart(&self, texel: f32) -> f32 {
        if self.levels.len() == 1 {
            return 0.0;
        }
        let drawn = self
            .chosen
            .iter()
            .zip(&self.spheres)
            .zip(&self.sizes)
            .map(|((level, s), size)| self.levels[*level as usize].1 * s.scale * size)
            .fold(0.0, f32::max);
        drawn + self.in_maps(texel).1
    }

    /// The part of [`Levels::apart`] that the level in shadow maps has.
    pub(crate) fn apart_in_maps(&self, texel: f32) -> f32 {
        if self.several() { self.in_maps(texel).1 } else { 0.0 }
    }

    /// The instances as the main pass draws them, if any of them is enlarged.
    pub(crate) fn enlarged(&self) -> Option<&wgpu::Buffer> {
        self.enlarged.as_ref()
    }

    /// Chooses which instances a picture shows, and the level of each. The buffers are rewritten when the choice has
    /// changed. Instances that are not drawn come last, because shadow maps draw all of them.
    pub(crate) fn arrange(
        &mut self,
        gpu: &Gpu,
        seen: &Seen,
        instances: &wgpu::Buffer,
        rides: Option<&wgpu::Buffer>,
        begins: Option<&wgpu::Buffer>,
    ) {
        let away = !self.reach.is_empty() && !self.reach.iter().any(|(centre, radius)| seen.shows(*centre, *radius));
        let size = |(k, InstanceBall { centre, radius, .. }): (usize, &InstanceBall)| {
            let size = self.ranks.get(k).map_or(1.0, |rank| seen.enlarged(*rank, *centre, *radius));
            let (centre, radius) = self.ball(k, size);
            if away || (self.still[k] && !seen.shows(centre, radius)) { 0.0 } else { size }
        };
        let sizes: Vec<f32> = self.spheres.iter().enumerate().map(size).collect();
        let choose = |(k, (InstanceBall { scale, .. }, size)): (usize, (&InstanceBall, &f32))| {
            let (centre, radius) = self.ball(k, *size);
            let most = PIXELS * seen.pixel * (seen.eye.distance(centre) - radius);
            (0..self.lit).rev().find(|k| self.levels[*k].1 * scale * size <= most).unwrap_or(0) as u8
        };
        let chosen: Vec<u8> = self.spheres.iter().zip(&sizes).enumerate().map(choose).collect();
        if chosen == self.chosen && sizes == self.sizes {
            return;
        }
        let mut order: Vec<usize> = (0..chosen.len()).collect();
        order.sort_by_key(|i| (sizes[*i] == 0.0, chosen[*i]));
        let drawn = order.partition_point(|i| sizes[*i] > 0.0);
        rewrite(gpu, Some(instances), &self.inputs.rows, &order);
        rewrite(gpu, rides, &self.inputs.rides, &order);
        rewrite(gpu, begins, &self.inputs.begins, &order);
        self.runs.clear();
        for level in 0..self.levels.len() {
            let first = order[..drawn].partition_point(|i| usize::from(chosen[*i]) < level) as u32;
            let end = order[..drawn].partition_point(|i| usize::from(chosen[*i]) <= level) as u32;
            if end > first {
                self.runs.push((level, first..end));
            }
        }
        (self.chosen, self.sizes) = (chosen, sizes);
        self.enlarge(gpu, &order);
    }

    /// Writes the instances in their own order, all in full detail.
    pub(crate) fn put_back(
        &mut self,
        gpu: &Gpu,
        instances: &wgpu::Buffer,
        rides: Option<&wgpu::Buffer>,
        begins: Option<&wgpu::Buffer>,
    ) {
        let order: Vec<usize> = (0..self.inputs.rows.len()).collect();
        rewrite(gpu, Some(instances), &self.inputs.rows, &order);
        rewrite(gpu, rides, &self.inputs.rides, &order);
        rewrite(gpu, begins, &self.inputs.begins, &order);
        self.chosen.fill(0);
        self.sizes.fill(1.0);
        (self.enlarged, self.runs) = (None, vec![(0, 0..self.chosen.len() as u32)]);
    }

    /// The level and the rows of each instance that is drawn, as the CPU has chosen, in the order of the draws.
    pub(crate) fn drawn(&self) -> Vec<(usize, [[f32; 4]; 3])> {
        let mut order: Vec<usize> = (0..self.inputs.rows.len()).filter(|k| self.sizes[*k] > 0.0).collect();
        order.sort_by_key(|k| self.chosen[*k]);
        order.iter().map(|k| (usize::from(self.chosen[*k]), self.larger(*k, self.sizes[*k]))).collect()
    }

    /// Writes the instances at the size at which they are drawn, if any is enlarged.
    fn enlarge(&mut self, gpu: &Gpu, order: &[usize]) {
        if self.sizes.iter().all(|s| *s == 0.0 || *s == 1.0) {
            self.enlarged = None;
            return;
        }
        let rows: Vec<[[f32; 4]; 3]> = order.iter().map(|i| self.larger(*i, self.sizes[*i])).collect();
        match &self.enlarged {
            Some(buffer) => gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&rows)),
            None => {
                use wgpu::BufferUsages as Use;
                let usage = Use::VERTEX | Use::STORAGE | Use::COPY_DST;
                self.enlarged = Some(gpu.buffer("enlarged instances", bytemuck::cast_slice(&rows), usage));
            }
        }
    }

    /// Number of triangles that the main pass draws.
    pub(crate) fn triangles(&self) -> u64 {
        self.runs().map(|(indices, instances)| indices.len() as u64 / 3 * instances.len() as u64).sum()
    }
}

/// Writes values of the instances in another order, if there is a buffer for them.
fn rewrite<T: bytemuck::Pod>(gpu: &Gpu, buffer: Option<&wgpu::Buffer>, of: &[T], order: &[usize]) {
    if let Some(buffer) = buffer {
        let sorted: Vec<T> = order.iter().map(|i| of[*i]).collect();
        gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&sorted));
    }
}
