//! The data that the vertex stage needs to bend branches and what rides on them: the branches' numbers and, where there
//! is wind, one motion texture. For plants in the wind there are also the sections that carry vertices and leaves. They
//! are group 2 of the main and the shadow pass. A scene in which nothing bends has no such group.

use crate::bend::Moved;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::scene::{Branch, Instance, Scene, Section, Sections, Wind};
use crate::shader::{Defines, assemble};
use crate::stats::Stats;
use crate::variant::Variant;
use bytemuck::Zeroable;
use glam::Vec3;

/// WGSL of the bend, which is put in front of a pass's own source.
pub(crate) const SOURCE: &str = include_str!("bend.wgsl");

/// Number of sections in a row of their texture, three texels each, and number of vertices in a row of theirs.
pub(crate) const SECTIONS_WIDE: u32 = 512;
pub(crate) const VERTICES_WIDE: u32 = 2048;

/// A branch in the shader's memory layout.
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
    /// The sections at the present time.
    sections: Option<wgpu::Texture>,
    bend: Bending,
}

/// What moves the vertices of a scene's instances.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub(crate) struct Bending {
    /// Number of the scene's branches if anything rides on one. With 0, no branch bends.
    pub branches: u32,
    /// Whether branches sway by a motion texture.
    pub motion: bool,
    /// Whether sections carry vertices and leaves of plants.
    pub sections: bool,
}

impl Bending {
    /// Whether anything moves.
    pub(crate) fn any(&self) -> bool {
        self.branches > 0 || self.sections
    }

    /// What moves anything in a whole scene. The bind group holds this.
    fn of(scene: &Scene) -> Bending {
        let rides = scene.instances.iter().any(|i| i.ride.is_some());
        let branches = if rides { scene.branches.len() as u32 } else { 0 };
        Bending {
            branches,
            motion: branches > 0 && scene.wind.as_ref().is_some_and(|w| w.size > 0),
            sections: scene.sections.is_some() && scene.instances.iter().any(|i| i.carried.is_some()),
        }
    }
}

/// Adds the names and constants of a shader that bends.
pub(crate) fn defines(defines: Defines, bend: &Bending) -> Defines {
    defines_of_times(defines, bend, 1, 0)
}

/// The same for a shader that knows more than one time. `sections` is the number of sections at each time.
pub(crate) fn defines_of_times(defines: Defines, bend: &Bending, times: u32, sections: usize) -> Defines {
    defines
        .constant("BRANCHES", bend.branches.max(1))
        .constant("BRANCHES_HELD", times * bend.branches.max(1))
        .constant("SECTIONS_ROWS", section_rows(sections) as u32)
        .constant("SECTIONS_WIDE", SECTIONS_WIDE)
        .constant("VERTICES_WIDE", VERTICES_WIDE)
        .set("BEND", bend.any())
        .set("MOTION", bend.motion)
        .set("SECTIONS", bend.sections)
}

/// What the shaders of these instances need: nothing, or everything that moves anything in the scene.
pub(crate) fn needs(scene: &Scene, instances: &[Instance]) -> Bending {
    if instances.iter().any(|i| Moved::of(i).any()) { Bending::of(scene) } else { Bending::default() }
}

/// The layout of group 2; `None` for a variant that does not bend.
pub(crate) fn layout_of(gpu: &Gpu, variant: &Variant) -> Option<wgpu::BindGroupLayout> {
    variant.bend.any().then(|| layout(gpu, &variant.bend))
}

fn layout(gpu: &Gpu, bend: &Bending) -> wgpu::BindGroupLayout {
    let visibility = wgpu::ShaderStages::VERTEX | wgpu::ShaderStages::COMPUTE;
    let entry = |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let uniform = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let texture = |sample_type| wgpu::BindingType::Texture {
        sample_type,
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    let float = wgpu::TextureSampleType::Float { filterable: false };
    let mut entries = vec![entry(0, uniform)];
    if bend.motion {
        entries.push(entry(1, texture(float)));
    }
    if bend.sections {
        entries.extend([entry(2, texture(float)), entry(3, texture(wgpu::TextureSampleType::Uint))]);
    }
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("bend"), entries: &entries })
}

/// What moves an instance, as the shader reads it. For a branch it is the number of the branch and the place, and −1
/// for none of either. For a section it is −2 − its number, and the first entry of the vertices' own sections.
pub(crate) fn ride(instance: &Instance) -> [f32; 2] {
    match instance.carried {
        Some(c) => [-2.0 - c.first as f32, c.vertices.map_or(-1.0, |v| v as f32)],
        None => instance.ride.map_or([-1.0; 2], |r| [r.branch as f32, r.at.unwrap_or(-1.0)]),
    }
}

/// Number of rows in the sections' texture that one time takes.
fn section_rows(sections: usize) -> usize {
    sections.div_ceil(SECTIONS_WIDE as usize).max(1)
}

/// The branches at several times, one time after the other.
fn all_numbers(branches: &[Branch], winds: &[Option<&Wind>]) -> Vec<OnGpu> {
    winds.iter().flat_map(|wind| numbers(branches, *wind)).collect()
}

fn numbers(branches: &[Branch], wind: Option<&Wind>) -> Vec<OnGpu> {
    let four = |v: Vec3, w: f32| [v.x, v.y, v.z, w];
    let still = OnGpu::zeroed();
    let mut all: Vec<OnGpu> = branches
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
        .collect();
    // A uniform buffer must not be empty.
    all.resize(branches.len().max(1), still);
    all
}

impl BendPass {
    /// Uploads the branches; `None` where nothing rides on any of them.
    pub(crate) fn new(gpu: &Gpu, scene: &Scene, stats: &mut Stats) -> Option<BendPass> {
        BendPass::at_times(gpu, scene, &[scene.wind.as_ref()], stats)
    }

    /// The same for several times of the scene's wind, from which shaders choose.
    pub(crate) fn at_times(gpu: &Gpu, scene: &Scene, winds: &[Option<&Wind>], stats: &mut Stats) -> Option<BendPass> {
        let bend = Bending::of(scene);
        if !bend.any() {
            return None;
        }
        let numbers = all_numbers(&scene.branches, winds);
        stats.upload("branches", std::mem::size_of_val(numbers.as_slice()) as u64);
        let buffer = gpu.uniform("branches", &numbers);
        let layout = layout(gpu, &bend);
        let view = scene.wind.as_ref().filter(|_| bend.motion).map(|wind| {
            stats.upload("motion texture", (wind.motion.len() * 8) as u64);
            motion_texture(gpu, wind)
        });
        let mut entries = vec![wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }];
        if let Some(view) = &view {
            entries.push(wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(view) });
        }
        let carried = scene.sections.as_ref().filter(|_| bend.sections).map(|sections| {
            stats.upload("sections", (winds.len() * sections.count * 48) as u64);
            stats.upload("sections of vertices", (sections.of_vertices.len() * 4) as u64);
            let own = rows(&sections.of_vertices, VERTICES_WIDE as usize, 0);
            let (motions, own) = (
                texture(
                    gpu,
                    "sections",
                    wgpu::TextureFormat::Rgba32Float,
                    3 * SECTIONS_WIDE,
                    winds.len() * section_rows(sections.count),
                ),
                {
                    let t = texture(
                        gpu,
                        "sections of vertices",
                        wgpu::TextureFormat::R32Uint,
                        VERTICES_WIDE,
                        own.len() / VERTICES_WIDE as usize,
                    );
                    fill(gpu, &t, bytemuck::cast_slice(&own));
                    t
                },
            );
            fill(gpu, &motions, bytemuck::cast_slice(&texels(sections, winds)));
            (motions, own)
        });
        let views = carried.as_ref().map(|(a, b)| [a, b].map(|t| t.create_view(&Default::default())));
        if let Some(views) = &views {
            entries.extend((2..).zip(views).map(|(binding, view)| wgpu::BindGroupEntry {
                binding,
                resource: wgpu::BindingResource::TextureView(view),
            }));
        }
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("bend"),
            layout: &layout,
            entries: &entries,
        });
        Some(BendPass { buffer, sections: carried.map(|(motions, _)| motions), group, layout, bend })
    }

    /// Moves every branch and section to another time.
    pub(crate) fn set_time(&self, gpu: &Gpu, branches: &[Branch], sections: Option<&Sections>, wind: &Wind) {
        self.set_times(gpu, branches, sections, &[Some(wind)]);
    }

    /// The same for several times, as many as the pass was made with.
    pub(crate) fn set_times(
        &self,
        gpu: &Gpu,
        branches: &[Branch],
        sections: Option<&Sections>,
        winds: &[Option<&Wind>],
    ) {
        if let (Some(texture), Some(sections)) = (&self.sections, sections) {
            fill(gpu, texture, bytemuck::cast_slice(&texels(sections, winds)));
        }
        gpu.queue.write_buffer(&self.buffer, 0, bytemuck::cast_slice(&all_numbers(branches, winds)));
    }

    /// The layout of its bind group.
    pub(crate) fn layout(&self) -> &wgpu::BindGroupLayout {
        &self.layout
    }

    /// Runs the vertex stage's function on vertices in world space, each with position, normal and tangent.
    pub(crate) fn probe(&self, gpu: &Gpu, instance: &Instance, vertices: &[[Vec3; 3]]) -> Result<Vec<[Vec3; 3]>> {
        let source =
            assemble(&format!("{SOURCE}{}", include_str!("probe.wgsl")), &defines(Defines::default(), &self.bend));
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
        let [branch, at] = ride(instance);
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
    let texture = texture(gpu, "motion texture", wgpu::TextureFormat::Rg32Float, wind.size, wind.size as usize);
    fill(gpu, &texture, bytemuck::cast_slice(&wind.motion));
    texture.create_view(&Default::default())
}

fn texture(gpu: &Gpu, label: &str, format: wgpu::TextureFormat, width: u32, height: usize) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width, height: height.max(1) as u32, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

/// Writes the whole of a texture.
fn fill(gpu: &Gpu, texture: &wgpu::Texture, bytes: &[u8]) {
    let size = texture.size();
    gpu.queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level: 0,
            origin: wgpu::Origin3d::ZERO,
            aspect: wgpu::TextureAspect::All,
        },
        bytes,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(bytes.len() as u32 / size.height),
            rows_per_image: Some(size.height),
        },
        size,
    );
}

/// Fills a list up to whole rows of `wide` entries, with at least one row.
fn rows<T: Copy>(list: &[T], wide: usize, rest: T) -> Vec<T> {
    let mut out = list.to_vec();
    out.resize(list.len().next_multiple_of(wide).max(wide), rest);
    out
}

/// The sections at several times of the wind, with three texels each and whole rows for each time.
fn texels(sections: &Sections, winds: &[Option<&Wind>]) -> Vec<[[f32; 4]; 3]> {
    let texel = |s: &Section| [s.from.extend(0.0).to_array(), s.to.extend(0.0).to_array(), s.turn.to_array()];
    let of_time = |wind: &Option<&Wind>| {
        let all: Vec<[[f32; 4]; 3]> = sections.now(*wind).iter().map(texel).collect();
        rows(&all, SECTIONS_WIDE as usize, [[0.0; 4]; 3])
    };
    winds.iter().flat_map(of_time).collect()
}
