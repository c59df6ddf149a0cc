//! The data that the vertex stage needs to move plants: the sections that carry their bark and their leaves. They are
//! group 2 of the main and the shadow pass. A scene in which nothing is carried has no such group.

use crate::error::Result;
use crate::gpu::Gpu;
use crate::passes::pose::PosePass;
use crate::scene::{Instance, Scene, Seat, Section, Sections};
use crate::shader::{Defines, assemble};
use crate::stats::Stats;
use crate::variant::Variant;
use glam::{Quat, Vec3};

/// WGSL of the bend, which is put in front of a pass's own source.
pub(crate) const SOURCE: &str = include_str!("bend.wgsl");

/// Sections on the adapter.
pub(crate) struct BendPass {
    pub group: wgpu::BindGroup,
    layout: wgpu::BindGroupLayout,
    /// A point of each section at rest, and where the sections move to at the present times.
    points: wgpu::Buffer,
    sections: wgpu::Buffer,
    /// Computes them on the adapter, for scenes that say how.
    pub pose: Option<PosePass>,
}

/// Adds the names and constants of a shader that moves vertices if `bend` says so. `sections` is the number of sections
/// at each of several times, which only a shader that knows more than one time reads.
pub(crate) fn defines(defines: Defines, bend: bool, sections: usize) -> Defines {
    defines.constant("SECTIONS", sections as u32).set("BEND", bend)
}

/// Whether a section carries any of these instances.
pub(crate) fn needs(scene: &Scene, instances: &[Instance]) -> bool {
    scene.sections.is_some() && instances.iter().any(|i| i.carried.is_some())
}

/// The layout of group 2; `None` for a variant that does not bend.
pub(crate) fn layout_of(gpu: &Gpu, variant: &Variant) -> Option<wgpu::BindGroupLayout> {
    variant.bend.then(|| layout(gpu))
}

fn layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    let entry = |binding| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::VERTEX | wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only: true },
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    };
    let entries = [entry(0), entry(1), entry(2)];
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("bend"), entries: &entries })
}

/// What carries an instance, as the shader reads it: the number of the section, and the first entry of the vertices'
/// own sections. −1 stands for none.
pub(crate) fn ride(instance: &Instance) -> [f32; 2] {
    instance.carried.map_or([-1.0; 2], |c| [c.first as f32, c.vertices.map_or(-1.0, |v| v as f32)])
}

impl BendPass {
    /// Uploads the motions of all sections at each of these `times`, from which shaders choose; `None` where sections
    /// carry nothing.
    pub(crate) fn new(gpu: &Gpu, scene: &Scene, times: &[Vec<Section>], stats: &mut Stats) -> Option<BendPass> {
        let sections = scene.sections.as_ref().filter(|_| needs(scene, &scene.instances))?;
        Some(BendPass::of(gpu, sections, times, stats))
    }

    /// Poses everything on the adapter if the scene says how, or on the CPU as `now`.
    pub(crate) fn posed(gpu: &Gpu, scene: &Scene, now: Vec<Section>, stats: &mut Stats) -> Option<BendPass> {
        let sections = scene.sections.as_ref().filter(|_| needs(scene, &scene.instances))?;
        let Some(poses) = &sections.poses else { return BendPass::new(gpu, scene, &[now], stats) };
        let at_rest = |seat: &Seat| Section { from: seat.from, to: seat.from, turn: Quat::IDENTITY };
        let mut pass = BendPass::of(gpu, sections, &[poses.seats.iter().map(at_rest).collect()], stats);
        let pose = PosePass::new(gpu, scene, poses, &pass.sections, stats);
        pose.set_time(gpu, scene.wind.as_ref().map_or(0.0, |w| w.time_s));
        pass.pose = Some(pose);
        Some(pass)
    }

    fn of(gpu: &Gpu, sections: &Sections, times: &[Vec<Section>], stats: &mut Stats) -> BendPass {
        stats.upload("sections", (times.len() * sections.count * 48) as u64);
        stats.upload("sections of vertices", (sections.of_vertices.len() * 4) as u64);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let points = gpu.buffer("points of sections", bytemuck::cast_slice(&points(times)), usage);
        let motions = gpu.buffer("sections", bytemuck::cast_slice(&motions(times)), usage);
        let own: &[u32] = if sections.of_vertices.is_empty() { &[0] } else { &sections.of_vertices };
        let of_vertices = gpu.buffer("sections of vertices", bytemuck::cast_slice(own), usage);
        let layout = layout(gpu);
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("bend"),
            layout: &layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: points.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: motions.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 2, resource: of_vertices.as_entire_binding() },
            ],
        });
        BendPass { points, sections: motions, group, layout, pose: None }
    }

    /// Moves every section to other times, as many as the pass was made with.
    pub(crate) fn set_times(&self, gpu: &Gpu, times: &[Vec<Section>]) {
        gpu.queue.write_buffer(&self.points, 0, bytemuck::cast_slice(&points(times)));
        gpu.queue.write_buffer(&self.sections, 0, bytemuck::cast_slice(&motions(times)));
    }

    /// The layout of its bind group.
    pub(crate) fn layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    /// Runs the vertex stage's function on vertices in world space, each with position, normal and tangent.
    pub(crate) fn probe(&self, gpu: &Gpu, instance: &Instance, vertices: &[[Vec3; 3]]) -> Result<Vec<[Vec3; 3]>> {
        let source =
            assemble(&format!("{SOURCE}{}", include_str!("probe.wgsl")), &defines(Defines::default(), true, 0));
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("probe"),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
            count: None,
        };
        let own = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("probe"),
            entries: &[
                entry(0, wgpu::BufferBindingType::Uniform),
                entry(1, wgpu::BufferBindingType::Storage { read_only: false }),
            ],
        });
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("probe"),
            bind_group_layouts: &[Some(&own), None, Some(&self.layout)],
            immediate_size: 0,
        });
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("probe"),
            layout: Some(&layout),
            module: &module,
            entry_point: Some("main"),
            compilation_options: Default::default(),
            cache: None,
        });
        let flat: Vec<[f32; 4]> = vertices.iter().flatten().map(|v| [v.x, v.y, v.z, 0.0]).collect();
        let [section, first] = ride(instance);
        let uniform = gpu.uniform("probe", &[[section, first, 0.0, 0.0]]);
        let storage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
        let buffer = gpu.buffer("probe", bytemuck::cast_slice(&flat), storage);
        let back = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("probe back"),
            size: buffer.size(),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("probe"),
            layout: &own,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: buffer.as_entire_binding() },
            ],
        });
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.set_bind_group(2, &self.group, &[]);
            pass.dispatch_workgroups((vertices.len() as u32).div_ceil(64), 1, 1);
        }
        encoder.copy_buffer_to_buffer(&buffer, 0, &back, 0, buffer.size());
        gpu.queue.submit([encoder.finish()]);
        let found: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&crate::readback::buffer(gpu, &back)?);
        Ok(found.as_chunks::<3>().0.iter().map(|v| v.map(|[x, y, z, _]| Vec3::new(x, y, z))).collect())
    }
}

/// The points of sections at rest, one time after the other.
fn points(times: &[Vec<Section>]) -> Vec<[f32; 4]> {
    times.iter().flatten().map(|s| s.from.extend(0.0).to_array()).collect()
}

/// Where sections move to, one time after the other.
fn motions(times: &[Vec<Section>]) -> Vec<[[f32; 4]; 2]> {
    times.iter().flatten().map(|s| [s.to.extend(0.0).to_array(), s.turn.to_array()]).collect()
}
