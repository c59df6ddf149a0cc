//! The data that the vertex stage needs to move plants: the sections that carry their bark and their leaves. They are
//! group 2 of the main and the shadow pass. A scene in which nothing is carried has no such group.

use crate::error::Result;
use crate::gpu::Gpu;
use crate::passes::pose::PosePass;
use crate::scene::{Instance, Mesh, Scene, SectionAnimation, SectionMotion, SectionSeat};
use crate::shader::{Defines, assemble};
use crate::stats::RenderStatistics;
use crate::variant::Variant;
use glam::{Quat, Vec3};
use std::collections::BTreeSet;

/// WGSL of rigid motions, and of the bend and of stands with it, which is put in front of a pass's own source.
pub(crate) const RIGID: &str = include_str!("rigid.wgsl");
pub(crate) const SOURCE: &str =
    concat!(include_str!("rigid.wgsl"), include_str!("bend.wgsl"), include_str!("stand.wgsl"));

/// How sections move a mesh in the vertex stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Ride {
    /// A section carries each instance.
    Instances,
    /// A section carries each vertex. There is only one instance.
    Vertices,
}

/// What carries an instance as a whole: the number of the section, or −1.
pub(crate) type Carrier = i32;

/// Sections on the adapter.
pub(crate) struct BendPass {
    pub group: wgpu::BindGroup,
    layout: wgpu::BindGroupLayout,
    /// Where the sections move to at the present times.
    pub sections: wgpu::Buffer,
    /// The points of the sections at rest from which the adapter counts.
    pub points: Vec<Vec3>,
    /// Computes them on the adapter, for scenes that say how.
    pub pose: Option<PosePass>,
}

/// Adds the names and constants of a shader that moves vertices as `ride` says. `sections` is the number of sections
/// at each of several times, which only a shader that knows more than one time reads.
pub(crate) fn defines(defines: Defines, ride: Option<Ride>, sections: usize) -> Defines {
    let defines = defines.set("BEND", ride.is_some()).set("OWN", ride == Some(Ride::Vertices));
    defines.constant("SECTIONS", sections as u32)
}

/// How sections carry these instances, where they carry any.
pub(crate) fn kind(scene: &Scene, instances: &[Instance]) -> Option<Ride> {
    let own = instances.iter().any(|i| alone(scene, i));
    needs(scene, instances).then_some(if own { Ride::Vertices } else { Ride::Instances })
}

/// Whether the vertices of an instance have sections of their own.
pub(crate) fn alone(scene: &Scene, instance: &Instance) -> bool {
    scene.sections.is_some() && instance.carried.is_some_and(|c| c.vertices.is_some())
}

/// The branches that carry the vertices of an instance, where these have sections of their own and the scene says how
/// branches bend.
pub(crate) fn branches(scene: &Scene, instance: &Instance) -> Option<BTreeSet<usize>> {
    let (by, sections) = (instance.carried?, scene.sections.as_ref()?);
    let (first, poses) = (by.vertices? as usize, sections.poses.as_ref()?);
    let own = &sections.of_vertices[first..][..scene.meshes[instance.mesh].positions.len()];
    Some(own.iter().map(|k| poses.seats[(by.first + k) as usize].limb as usize).collect())
}

/// Whether a section carries any of these instances.
fn needs(scene: &Scene, instances: &[Instance]) -> bool {
    scene.sections.is_some() && instances.iter().any(|i| i.carried.is_some())
}

/// The layout of group 2; `None` for a variant that does not bend.
pub(crate) fn layout_of(gpu: &Gpu, variant: &Variant) -> Option<wgpu::BindGroupLayout> {
    variant.bend.map(|_| layout(gpu))
}

fn layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    let entry = wgpu::BindGroupLayoutEntry {
        binding: 0,
        visibility: wgpu::ShaderStages::VERTEX | wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Storage { read_only: true },
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    };
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("bend"), entries: &[entry] })
}

/// The points of all sections at rest.
pub(crate) fn points(scene: &Scene) -> Vec<Vec3> {
    let Some(sections) = &scene.sections else { return Vec::new() };
    match &sections.poses {
        Some(poses) => poses.seats.iter().map(|seat| seat.from).collect(),
        None => sections.now(scene.wind.as_ref()).iter().map(|section| section.from).collect(),
    }
}

/// What carries an instance, as the shader reads it.
pub(crate) fn ride(instance: &Instance) -> Carrier {
    instance.carried.map_or(-1, |c| c.first as Carrier)
}

/// The three rows of an instance's transform, from the point of the section that carries it as a whole.
pub(crate) fn rows(scene: &Scene, instance: &Instance, points: &[Vec3]) -> [[f32; 4]; 3] {
    let mut m = instance.transform;
    if let Some(by) = instance.carried.filter(|by| scene.sections.is_some() && by.vertices.is_none()) {
        m.w_axis -= points[by.first as usize].extend(0.0);
    }
    [m.row(0).to_array(), m.row(1).to_array(), m.row(2).to_array()]
}

/// The mesh of an instance whose vertices have sections of their own, in the scene's axes: each vertex from its
/// section's point, with the section's number, and the mesh with its normals and tangents. The vertex stage then needs
/// no transform.
pub(crate) fn by_vertices(scene: &Scene, instance: &Instance, points: &[Vec3]) -> Option<(Vec<[f32; 4]>, Mesh)> {
    let (by, sections) = (instance.carried?, scene.sections.as_ref()?);
    let first = by.vertices? as usize;
    let (m, mut mesh) = (instance.transform, scene.meshes[instance.mesh].clone());
    let one = |(own, position): (&u32, &Vec3)| {
        let section = by.first + own;
        (m.transform_point3(*position) - points[section as usize]).extend(section as f32).to_array()
    };
    let positions = sections.of_vertices[first..].iter().zip(&mesh.positions).map(one).collect();
    mesh.normals.iter_mut().for_each(|n| *n = m.transform_vector3(*n));
    mesh.tangents.iter_mut().for_each(|t| *t = m.transform_vector3(t.truncate()).extend(t.w));
    Some((positions, mesh))
}

impl BendPass {
    /// Poses everything on the adapter if the scene says how, or on the CPU as `now`; `None` where sections carry
    /// nothing.
    pub(crate) fn posed(
        gpu: &Gpu,
        scene: &Scene,
        now: Vec<SectionMotion>,
        stats: &mut RenderStatistics,
    ) -> Option<BendPass> {
        let sections = scene.sections.as_ref().filter(|_| needs(scene, &scene.instances))?;
        let Some(poses) = &sections.poses else {
            return Some(BendPass::of(gpu, sections, points(scene), &[now], stats));
        };
        let at_rest = |seat: &SectionSeat| SectionMotion { from: seat.from, to: seat.from, turn: Quat::IDENTITY };
        let mut pass = BendPass::of(gpu, sections, points(scene), &[poses.seats.iter().map(at_rest).collect()], stats);
        let pose = PosePass::new(gpu, scene, poses, &pass.sections, stats);
        pose.set_time(gpu, scene.wind.as_ref().map_or(0.0, |w| w.time_s));
        pass.pose = Some(pose);
        Some(pass)
    }

    /// Uploads the motions of all sections at each of these `times`, from which shaders choose, counted from `points`.
    pub(crate) fn of(
        gpu: &Gpu,
        sections: &SectionAnimation,
        points: Vec<Vec3>,
        times: &[Vec<SectionMotion>],
        stats: &mut RenderStatistics,
    ) -> BendPass {
        stats.upload("sections", (times.len() * sections.count * 32) as u64);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let sections = gpu.buffer("sections", bytemuck::cast_slice(&motions(times, &points)), usage);
        let layout = layout(gpu);
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("bend"),
            layout: &layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: sections.as_entire_binding() }],
        });
        BendPass { sections, points, group, layout, pose: None }
    }

    /// Moves every section to other times, as many as the pass was made with.
    pub(crate) fn set_times(&self, gpu: &Gpu, times: &[Vec<SectionMotion>]) {
        gpu.queue.write_buffer(&self.sections, 0, bytemuck::cast_slice(&motions(times, &self.points)));
    }

    /// The layout of its bind group.
    pub(crate) fn layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    /// Runs the vertex stage's function on vertices, which `rides` carry: each has its place from its section's point,
    /// its normal and its tangent, in the scene's axes.
    pub(crate) fn probe(&self, gpu: &Gpu, rides: &[Carrier], vertices: &[[Vec3; 3]]) -> Result<Vec<[Vec3; 3]>> {
        if let Some(pose) = &self.pose {
            pose.now(gpu);
        }
        let defines = defines(Defines::default(), Some(Ride::Instances), 0);
        let source = assemble(&format!("{SOURCE}{}", include_str!("probe.wgsl")), &defines);
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
                entry(0, wgpu::BufferBindingType::Storage { read_only: true }),
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
        let rides = gpu.buffer("probe: rides", bytemuck::cast_slice(rides), wgpu::BufferUsages::STORAGE);
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
                wgpu::BindGroupEntry { binding: 0, resource: rides.as_entire_binding() },
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

/// Where sections move to, one time after the other. A section may state its motion by another point at each time; the
/// adapter always counts from these.
fn motions(times: &[Vec<SectionMotion>], points: &[Vec3]) -> Vec<[[f32; 4]; 2]> {
    let one = |(s, point): (&SectionMotion, &Vec3)| {
        let to = s.to + s.turn * (point - s.from);
        [to.extend(0.0).to_array(), s.turn.to_array()]
    };
    times.iter().flat_map(|now| now.iter().zip(points).map(one)).collect()
}
