//! Chooses which of the plants that stand in many places a picture shows, how many of their leaves, and at which level
//! of detail. What the plants share is on the adapter once; a plant costs a row of numbers in each list that has it.
//! Plants outside the view are left out. All leaves of a plant are thinned alike, by its distance (`far`).

use crate::detail::{Levels, PIXELS};
use crate::extents::{StandBounds, scale_of};
use crate::far::FarKind;
use crate::gpu::Gpu;
use crate::passes::shadow::STRIDE;
use crate::scene::{Instance, PlantStand, StandPlace, Sun};
use crate::shader::Defines;
use crate::thinning::{FADE, Seen};
use glam::{Mat3, Mat4, Vec3};
use std::ops::Range;
use std::sync::Arc;
use wgpu::BufferUsages as Use;

/// The bind group of the plants.
pub(crate) const GROUP: u32 = 3;
/// Classes of numbers of leaves between a number and twice as many. The draws of a class have as many leaves.
const CLASSES: f32 = 4.0;
/// The largest distance (mm) by which surfaces are lifted out of their own shadows because of levels of detail. Coarser
/// levels leave out and widen, and move what they keep by less.
const LIFTED: f32 = 32.0;
/// The sine of the least elevation of the sun at which plants are left out of shadow maps.
const LOW_SUN: f32 = 0.05;
/// The largest number of instances of a draw.
const MOST_INSTANCES: usize = 1 << 28;

/// The names and constants of shaders that draw plants of a stand.
pub(crate) fn defines(defines: Defines, stand: bool) -> Defines {
    defines.set("STAND", stand).constant("FADE_PERCENT", (100.0 * FADE) as u32)
}

/// The layout of what the vertex stage reads of plants.
pub(crate) fn layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    let entry = |binding: u32, ty: wgpu::BufferBindingType| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::VERTEX,
        ty: wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: binding == 0,
            min_binding_size: wgpu::BufferSize::new(if binding == 0 { 32 } else { 64 }),
        },
        count: None,
    };
    let storage = wgpu::BufferBindingType::Storage { read_only: true };
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("stand"),
        entries: &[entry(0, wgpu::BufferBindingType::Uniform), entry(1, storage), entry(2, storage)],
    })
}

/// What the vertex stage reads of each leaf, in the order of the ranks.
pub(crate) fn leaves(rows: &[[[f32; 4]; 3]], rides: &[i32], far: Option<&FarKind>) -> Vec<[[f32; 4]; 4]> {
    let rank = |k: usize| far.map_or(0.0, |(plant, kind)| plant.leaves[*kind].ranks[k]);
    let mut order: Vec<usize> = (0..rows.len()).collect();
    order.sort_by(|a, b| rank(*a).total_cmp(&rank(*b)));
    let one = |k: usize| {
        let [x, y, z] = rows[k];
        [x, y, z, [rides[k] as f32, rank(k), 0.0, 0.0]]
    };
    order.into_iter().map(one).collect()
}

/// One mesh in one material of the plants of a stand.
pub(crate) struct StandBatch {
    stand: Arc<PlantStand>,
    bounds: Arc<StandBounds>,
    /// Number of instances in a plant.
    leaves: u32,
    /// What is known of the plant at a distance, where fewer leaves may be drawn.
    far: Option<FarKind>,
    layout: wgpu::BindGroupLayout,
    /// What pictures show, and what casts shadows.
    pub seen: StandList,
    pub casting: StandList,
}

/// Draws of plants, and what they read.
#[derive(Default)]
pub(crate) struct StandList {
    plants: Option<wgpu::Buffer>,
    draws: Option<wgpu::Buffer>,
    group: Option<wgpu::BindGroup>,
    runs: Vec<StandRun>,
    /// The largest error of a level that is drawn (mm).
    pub apart: f32,
}

struct StandRun {
    indices: Range<u32>,
    instances: u32,
    offset: u32,
}

/// Where shadows fall, for pictures whose shadow maps are drawn with them.
pub(crate) struct Falls {
    seen: Seen,
    /// Towards the sun.
    sun: Vec3,
    /// Height below which there is nothing.
    low: f32,
}

impl Falls {
    /// Where the sun's shadows fall; `None` for a low sun, whose shadows are long.
    pub(crate) fn new(seen: Seen, sun: &Sun, low: f32) -> Option<Falls> {
        let sun = sun.direction.normalize();
        (sun.z > LOW_SUN).then_some(Falls { seen, sun, low })
    }

    /// Where the shadow of a ball ends.
    fn end(&self, centre: Vec3, radius: f32) -> Vec3 {
        let height = (centre.z + radius - self.low).max(0.0);
        centre - self.sun * (height / self.sun.z)
    }
}

/// A plant of a list: its level, its class, its place, the share of its leaves that is drawn, and the factors of their
/// areas and of the sun's light.
type Listed = (usize, u32, u32, f32, [f32; 2]);

impl StandBatch {
    pub(crate) fn new(
        gpu: &Gpu,
        stand: &Arc<PlantStand>,
        bounds: &Arc<StandBounds>,
        instances: &[Instance],
        far: Option<FarKind>,
    ) -> StandBatch {
        StandBatch {
            stand: stand.clone(),
            bounds: bounds.clone(),
            leaves: instances.len() as u32,
            far,
            layout: layout(gpu),
            seen: StandList::default(),
            casting: StandList::default(),
        }
    }

    /// Chooses what a picture shows. `sun` is the direction towards it, if it casts shadows, which factors of light
    /// hold. `levels` are those of the mesh.
    pub(crate) fn arrange(
        &mut self,
        gpu: &Gpu,
        seen: &Seen,
        sun: Option<Vec3>,
        levels: &Levels,
        leaves: &wgpu::Buffer,
    ) {
        let mut listed: Vec<Listed> = Vec::new();
        let mut apart = 0.0f32;
        for (k, place) in self.stand.places.iter().enumerate() {
            let scale = scale_of(&place.transform);
            let (centre, radius) = self.bounds.moving;
            if !seen.shows(place.transform.transform_point3(centre), radius * scale) {
                continue;
            }
            let (centre, radius) = self.bounds.rest;
            let to_eye = seen.eye - place.transform.transform_point3(centre);
            let distance = to_eye.length();
            let (kept, factors) = match seen.has_perspective() {
                true => self.kept(&place.transform, seen.pixel * distance, to_eye, sun),
                false => (1.0, [1.0; 2]),
            };
            let most = PIXELS * seen.pixel * (distance - radius * scale).max(0.0);
            let enlarged = scale * largest(kept) * factors[0].sqrt();
            let level = (0..levels.lit().len()).rev().find(|n| levels.lit()[*n].1 * enlarged <= most).unwrap_or(0);
            apart = apart.max((levels.lit()[level].1 * enlarged).min(LIFTED));
            listed.push((level, self.class(kept), k as u32, kept, factors));
        }
        let ranges: Vec<Range<u32>> = levels.lit().iter().map(|(range, _)| range.clone()).collect();
        let mut list = std::mem::take(&mut self.seen);
        list.apart = apart;
        self.fill(gpu, &mut list, listed, &ranges, levels.around().0, leaves);
        self.seen = list;
    }

    /// The part of [`StandList::apart`] that the level in shadow maps has.
    pub(crate) fn apart_in_maps(&self, texel: f32, levels: &Levels) -> f32 {
        levels.apart_in_maps(texel).min(LIFTED)
    }

    /// Chooses what maps show whose texels have this side. With `falls`, plants are left out whose shadows fall beside
    /// the picture.
    pub(crate) fn cast(
        &mut self,
        gpu: &Gpu,
        texel: f32,
        sun: Vec3,
        falls: Option<&Falls>,
        levels: &Levels,
        leaves: &wgpu::Buffer,
    ) {
        let one = |(k, place): (usize, &StandPlace)| {
            let scale = scale_of(&place.transform);
            let (centre, radius) = self.bounds.moving;
            let (centre, radius) = (place.transform.transform_point3(centre), radius * scale);
            if falls.is_some_and(|falls| !falls.seen.shows_on_way([centre, falls.end(centre, radius)], radius)) {
                return None;
            }
            let (kept, factors) = self.kept(&place.transform, texel, sun, None);
            Some((0, self.class(kept), k as u32, kept, factors))
        };
        let listed = self.stand.places.iter().enumerate().filter_map(one).collect();
        let mut list = std::mem::take(&mut self.casting);
        self.fill(gpu, &mut list, listed, &[levels.shadow(texel)], levels.around().0, leaves);
        self.casting = list;
    }

    /// The share of its leaves that is drawn of a plant, where pixels or texels have this width (mm), and the factors
    /// of their areas and of the sun's light. Directions are towards the eye and the sun, from wherever is looked.
    fn kept(&self, place: &Mat4, pixel: f32, eye: Vec3, sun: Option<Vec3>) -> (f32, [f32; 2]) {
        let Some((plant, kind)) = &self.far else { return (1.0, [1.0; 2]) };
        let pixel = pixel / scale_of(place).max(1e-30);
        let kept = plant.kept(*kind, pixel);
        if kept >= 1.0 {
            return (1.0, [1.0; 2]);
        }
        let back = Mat3::from_mat4(*place).transpose();
        let own = |d: Vec3| (back * d).normalize_or(Vec3::Z);
        (kept, plant.factors(pixel, own(eye), sun.map(own)))
    }

    /// The class of a share of the leaves: 0 for all of them.
    fn class(&self, kept: f32) -> u32 {
        (-CLASSES * kept.log2()).max(0.0) as u32
    }

    /// Number of leaves in the draws of a class.
    fn of_class(&self, class: u32) -> u32 {
        let most = self.leaves as f32 * (-(class as f32) / CLASSES).exp2();
        (most.ceil() as u32).clamp(1, self.leaves)
    }

    fn fill(
        &self,
        gpu: &Gpu,
        list: &mut StandList,
        mut listed: Vec<Listed>,
        levels: &[Range<u32>],
        middle: Vec3,
        leaves: &wgpu::Buffer,
    ) {
        listed.sort_by_key(|(level, class, place, ..)| (*level, *class, *place));
        let plant = |(_, _, place, kept, [larger, lit]): &Listed| {
            let place = &self.stand.places[*place as usize];
            let m = place.transform;
            let [x, y, z] = [0, 1, 2].map(|k| m.row(k).to_array());
            [x, y, z, [*kept, (place.pose * self.stand.sections) as f32, *larger, *lit]]
        };
        let plants: Vec<[[f32; 4]; 4]> = listed.iter().map(plant).collect();
        let (mut draws, mut first) = (Vec::new(), 0);
        list.runs.clear();
        for run in listed.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            let (level, class, ..) = run[0];
            let of = self.of_class(class);
            for part in run.chunks((MOST_INSTANCES / of as usize).max(1)) {
                let offset = draws.len();
                draws.resize(offset + STRIDE, 0u8);
                let numbers = [of, first, 0, 0].map(u32::to_le_bytes).concat();
                let middle = middle.extend(0.0).to_array().map(f32::to_le_bytes).concat();
                draws[offset..offset + 32].copy_from_slice(&[numbers, middle].concat());
                let instances = of * part.len() as u32;
                list.runs.push(StandRun { indices: levels[level].clone(), instances, offset: offset as u32 });
                first += part.len() as u32;
            }
        }
        if plants.is_empty() {
            return;
        }
        let grown = write(gpu, "plants of a stand", &mut list.plants, bytemuck::cast_slice(&plants), Use::STORAGE)
            | write(gpu, "draws of a stand", &mut list.draws, &draws, Use::UNIFORM);
        let (Some(plants), Some(draws)) = (&list.plants, &list.draws) else { return };
        if grown || list.group.is_none() {
            let draw = wgpu::BufferBinding { buffer: draws, offset: 0, size: wgpu::BufferSize::new(32) };
            list.group = Some(gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("stand"),
                layout: &self.layout,
                entries: &[
                    wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::Buffer(draw) },
                    wgpu::BindGroupEntry { binding: 1, resource: leaves.as_entire_binding() },
                    wgpu::BindGroupEntry { binding: 2, resource: plants.as_entire_binding() },
                ],
            }));
        }
    }
}

/// The factor by which the largest of the leaves is drawn, of which this share is.
fn largest(kept: f32) -> f32 {
    if kept >= 1.0 { 1.0 } else { (kept - 0.5 * (FADE * kept).min(1.0 - kept)).sqrt().recip() }
}

/// Writes a buffer, and makes it larger where that is needed; true where it is a new one.
fn write(gpu: &Gpu, label: &str, buffer: &mut Option<wgpu::Buffer>, bytes: &[u8], usage: Use) -> bool {
    let held = buffer.as_ref().is_some_and(|b| b.size() >= bytes.len() as u64);
    if !held {
        *buffer = Some(gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.len() as u64,
            usage: usage | Use::COPY_DST,
            mapped_at_creation: false,
        }));
    }
    if let Some(buffer) = buffer {
        gpu.queue.write_buffer(buffer, 0, bytes);
    }
    !held
}

impl StandList {
    /// Draws the plants, and returns the number of draws.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>) -> u64 {
        let Some(group) = self.group.as_ref().filter(|_| !self.runs.is_empty()) else { return 0 };
        for run in &self.runs {
            pass.set_bind_group(GROUP, group, &[run.offset]);
            pass.draw_indexed(run.indices.clone(), 0, 0..run.instances);
        }
        self.runs.len() as u64
    }

    /// Number of triangles that it draws.
    pub(crate) fn triangles(&self) -> u64 {
        self.runs.iter().map(|run| run.indices.len() as u64 / 3 * u64::from(run.instances)).sum()
    }
}
