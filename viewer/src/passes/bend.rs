//! What the vertex stage needs to bend branches and what rides on them: their numbers, and one motion texture where
//! there is wind. Bound as group 2 of the main and the shadow pass; a scene without branches has neither.

use crate::error::Result;
use crate::gpu::Gpu;
use crate::scene::{Branch, Instance, Ride, Scene, Wind};
use crate::shader::{Defines, assemble};
use crate::stats::Stats;
use crate::variant::Variant;
use glam::Vec3;

/// WGSL of the bend, put in front of a pass's own.
pub(crate) const SOURCE: &str = include_str!("bend.wgsl");

/// A branch as the shader holds it.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct OnGpu {
    root: [f32; 4],
    t: [f32; 4],
    r: [f32; 4],
    s: [f32; 4],
    a: [f32; 4],
    still: [f32; 4],
    gain: [f32; 4],
}

/// Branches and motion texture on the adapter.
pub(crate) struct BendPass {
    buffer: wgpu::Buffer,
    pub group: wgpu::BindGroup,
    layout: wgpu::BindGroupLayout,
    count: u32,
    motion: bool,
}

/// What a shader that bends is assembled with.
pub(crate) fn defines(defines: Defines, branches: u32, motion: bool) -> Defines {
    defines.constant("BRANCHES", branches.max(1)).set("BEND", branches > 0).set("MOTION", branches > 0 && motion)
}

/// Whether any of these instances rides on a branch, and so needs the bend in its shaders: the number of branches, and
/// whether they sway.
pub(crate) fn needs(scene: &Scene, instances: &[Instance]) -> (u32, bool) {
    if instances.iter().any(|i| i.ride.is_some()) {
        (scene.branches.len() as u32, scene.wind.is_some())
    } else {
        (0, false)
    }
}

/// The layout of group 2; `None` for a variant that does not bend.
pub(crate) fn layout_of(gpu: &Gpu, variant: &Variant) -> Option<wgpu::BindGroupLayout> {
    (variant.branches > 0).then(|| layout(gpu, variant.motion))
}

fn layout(gpu: &Gpu, motion: bool) -> wgpu::BindGroupLayout {
    let visibility = wgpu::ShaderStages::VERTEX | wgpu::ShaderStages::COMPUTE;
    let entry = |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let uniform = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let mut entries = vec![entry(0, uniform)];
    if motion {
        let texture = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: false },
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        entries.push(entry(1, texture));
    }
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("bend"), entries: &entries })
}

/// What an instance rides on to the shader: branch and place, −1 for none of either.
pub(crate) fn ride(instance: &Instance) -> [f32; 2] {
    on(instance.ride)
}

fn on(ride: Option<Ride>) -> [f32; 2] {
    ride.map_or([-1.0; 2], |r| [r.branch as f32, r.at.unwrap_or(-1.0)])
}

fn numbers(branches: &[Branch], wind: Option<&Wind>) -> Vec<OnGpu> {
    let four = |v: Vec3, w: f32| [v.x, v.y, v.z, w];
    branches
        .iter()
        .map(|b| {
            let [x, y] = wind.map_or([0.0; 2], |w| w.place(b));
            OnGpu {
                root: four(b.root, b.length),
                t: four(b.t, b.alpha),
                r: four(b.r, b.ln_alpha),
                s: four(b.s, b.ell),
                a: b.a,
                still: [b.still[0], b.still[1], x, y],
                gain: [b.gain, 0.0, 0.0, 0.0],
            }
        })
        .collect()
}

impl BendPass {
    /// Uploads the branches; `None` where nothing rides on one.
    pub(crate) fn new(gpu: &Gpu, scene: &Scene, stats: &mut Stats) -> Option<BendPass> {
        if !scene.instances.iter().any(|i| i.ride.is_some()) {
            return None;
        }
        let numbers = numbers(&scene.branches, scene.wind.as_ref());
        stats.upload("branches", std::mem::size_of_val(numbers.as_slice()) as u64);
        let buffer = gpu.uniform("branches", &numbers);
        let layout = layout(gpu, scene.wind.is_some());
        let view = scene.wind.as_ref().map(|wind| {
            stats.upload("motion texture", (wind.motion.len() * 8) as u64);
            motion_texture(gpu, wind)
        });
        let mut entries = vec![wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }];
        if let Some(view) = &view {
            entries.push(wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(view) });
        }
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("bend"),
            layout: &layout,
            entries: &entries,
        });
        Some(BendPass { buffer, group, layout, count: scene.branches.len() as u32, motion: scene.wind.is_some() })
    }

    /// Moves every branch to another time.
    pub(crate) fn set_time(&self, gpu: &Gpu, branches: &[Branch], wind: &Wind) {
        gpu.queue.write_buffer(&self.buffer, 0, bytemuck::cast_slice(&numbers(branches, Some(wind))));
    }

    /// Runs the vertex stage's function over vertices in world space: position, normal and tangent each.
    pub(crate) fn probe(&self, gpu: &Gpu, ride: Option<Ride>, vertices: &[[Vec3; 3]]) -> Result<Vec<[Vec3; 3]>> {
        let source = assemble(
            &format!("{SOURCE}{}", include_str!("probe.wgsl")),
            &defines(Defines::default(), self.count, self.motion),
        );
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
        let [branch, at] = on(ride);
        let uniform = gpu.uniform("probe", &[[branch, at, 0.0, 0.0]]);
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

fn motion_texture(gpu: &Gpu, wind: &Wind) -> wgpu::TextureView {
    let size = wgpu::Extent3d { width: wind.size, height: wind.size, depth_or_array_layers: 1 };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("motion texture"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rg32Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    gpu.queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture: &texture,
            mip_level: 0,
            origin: wgpu::Origin3d::ZERO,
            aspect: wgpu::TextureAspect::All,
        },
        bytemuck::cast_slice(&wind.motion),
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(8 * wind.size), rows_per_image: Some(wind.size) },
        size,
    );
    texture.create_view(&Default::default())
}
