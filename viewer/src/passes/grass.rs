//! The grass pass: lawns as slices, each the back faces of its box, drawn in the main pass after all meshes. Only
//! scenes with grass have its pipelines and textures.

use crate::gpu::Gpu;
use crate::maps::{Level, upload_half};
use crate::passes::bend::{self, Bending};
use crate::passes::main::{DEPTH, frame_layout};
use crate::passes::sky::pixel_rays;
use crate::scene::{Camera, Dome, GRASS_STEPS, Grass, GrassSheet, GrassTable, Scene, Sun};
use crate::shader::assemble;
use crate::stats::Stats;
use crate::variant::{Lights, Surface, Variant};
use glam::Vec2;
use std::sync::Arc;

/// What the shader is told of a lawn; see `grass.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
struct Uniform {
    base: [f32; 4],
    corners: [f32; 4],
    period: [f32; 4],
    upright: [f32; 4],
    level: [f32; 4],
    shown: [f32; 4],
    soil: [f32; 4],
    scatter: [f32; 4],
    below: [f32; 4],
    rays: [[f32; 4]; 3],
    tables: [[[f32; 4]; 5]; 4],
}

pub(crate) struct GrassPass {
    lawns: Vec<Lawn>,
}

struct Lawn {
    grass: Arc<Grass>,
    pipeline: wgpu::RenderPipeline,
    uniform: wgpu::Buffer,
    group: wgpu::BindGroup,
}

/// What a frame's camera and lights tell.
#[derive(Clone, Copy)]
pub(crate) struct Aim<'a> {
    pub camera: &'a Camera,
    /// Of the picture, in pixels.
    pub size: [u32; 2],
    pub sun: Option<&'a Sun>,
    pub dome: Option<&'a Dome>,
}

impl GrassPass {
    /// `None` for a scene without grass.
    pub(crate) fn new(gpu: &Gpu, scene: &Scene, stats: &mut Stats) -> Option<GrassPass> {
        let lawns: Vec<Lawn> = scene.grass.iter().map(|grass| Lawn::new(gpu, scene, grass, stats)).collect();
        (!lawns.is_empty()).then_some(GrassPass { lawns })
    }

    /// Takes over what this frame sees.
    pub(crate) fn aim(&self, gpu: &Gpu, aim: Aim<'_>) {
        for lawn in &self.lawns {
            gpu.queue.write_buffer(&lawn.uniform, 0, bytemuck::bytes_of(&uniform(&lawn.grass, aim)));
        }
    }

    /// Draws all lawns; the main pass has bound its own group.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, stats: &mut Stats) {
        for lawn in &self.lawns {
            pass.set_pipeline(&lawn.pipeline);
            pass.set_bind_group(1, &lawn.group, &[]);
            pass.draw(0..36, 0..1);
            stats.draws += 1;
        }
    }
}

impl Lawn {
    fn new(gpu: &Gpu, scene: &Scene, grass: &Arc<Grass>, stats: &mut Stats) -> Lawn {
        let device = &gpu.device;
        let level = grass.level.is_some();
        let layout = layout(gpu, level);
        stats.pipeline(if level { "grass" } else { "grass without a level slice" });
        let pipeline = pipeline(gpu, scene, grass, &layout);
        let uniform = gpu.uniform("grass", &[Uniform::default()]);
        stats.upload("grass", size_of::<Uniform>() as u64);
        let mut put = |what: &str, sheet: &GrassSheet| {
            let name = format!("{} {what}", grass.name);
            let planes: Vec<Vec<Level>> = (0..4)
                .map(|k| {
                    let one = |l: &crate::scene::GrassLevel| Level {
                        width: l.width,
                        height: l.height,
                        texels: l.planes[k].clone(),
                    };
                    sheet.levels.iter().map(one).collect()
                })
                .collect();
            let uploaded = upload_half(gpu, &name, &planes);
            stats.upload(&name, uploaded.bytes);
            uploaded.view
        };
        let upright = put("upright slices", &grass.upright);
        let level = grass.level.as_ref().map(|sheet| put("level slice", sheet));
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("slices"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        let mut entries = vec![
            wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(&upright) },
            wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::Sampler(&sampler) },
        ];
        if let Some(level) = &level {
            entries.push(wgpu::BindGroupEntry { binding: 3, resource: wgpu::BindingResource::TextureView(level) });
        }
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("grass"),
            layout: &layout,
            entries: &entries,
        });
        Lawn { grass: Arc::clone(grass), pipeline, uniform, group }
    }
}

fn layout(gpu: &Gpu, level: bool) -> wgpu::BindGroupLayout {
    let fragment = wgpu::ShaderStages::FRAGMENT;
    let entry = |binding, visibility, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let uniform = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let slices = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: true },
        view_dimension: wgpu::TextureViewDimension::D2Array,
        multisampled: false,
    };
    let mut entries = vec![
        entry(0, fragment | wgpu::ShaderStages::VERTEX, uniform),
        entry(1, fragment, slices),
        entry(2, fragment, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
    ];
    if level {
        entries.push(entry(3, fragment, slices));
    }
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("grass"), entries: &entries })
}

/// The shader of a lawn in a scene's lights.
fn source(scene: &Scene, grass: &Grass) -> (String, Lights) {
    let lights = Lights::of(scene);
    let variant = Variant {
        lights,
        surface: Surface::Opaque,
        msaa: scene.msaa,
        levels: false,
        bend: Bending::default(),
        anchored: None,
        shares: false,
    };
    let defines = variant.defines().set("LEVEL_SLICE", grass.level.is_some()).constant("STEPS", grass.steps);
    let parts = [bend::SOURCE, include_str!("main.wgsl"), include_str!("light.wgsl"), include_str!("grass.wgsl")];
    (assemble(&parts.concat(), &defines), lights)
}

fn pipeline(gpu: &Gpu, scene: &Scene, grass: &Grass, own: &wgpu::BindGroupLayout) -> wgpu::RenderPipeline {
    let (source, lights) = source(scene, grass);
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("grass"),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("grass"),
        bind_group_layouts: &[Some(&frame_layout(gpu, &lights)), Some(own)],
        immediate_size: 0,
    });
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("grass"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("grass_vertex"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        // Back faces: an eye in the grass sees them too.
        primitive: wgpu::PrimitiveState { cull_mode: Some(wgpu::Face::Front), ..Default::default() },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: wgpu::MultisampleState { count: scene.msaa, mask: !0, alpha_to_coverage_enabled: false },
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("grass_fragment"),
            compilation_options: Default::default(),
            targets: &[Some(gpu.hdr_format(scene.msaa).into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

fn uniform(grass: &Grass, Aim { camera, size, sun, dome }: Aim<'_>) -> Uniform {
    let sheet = |s: &GrassSheet| [s.cell[0] as f32, s.cell[1] as f32, s.border as f32, s.columns as f32];
    let rgb = |c: [f32; 3]| [c[0], c[1], c[2], 0.0];
    let (pixel, rays) = pixel_rays(camera, size);
    let upwards = sun.map_or(0.0, |s| s.direction.normalize().z).clamp(0.0, 1.0);
    let x = upwards * GRASS_STEPS as f32;
    let k = (x as usize).min(GRASS_STEPS - 1);
    let sunlit = grass.through.map(|row| row[k] + (x - k as f32) * (row[k + 1] - row[k]));
    let packed = |table: &GrassTable| {
        let mut out = [[0.0; 4]; 5];
        table.iter().enumerate().for_each(|(i, v)| out[i / 4][i % 4] = *v);
        out
    };
    // Counted from the rectangle below the eye: single precision has the most digits there.
    let period = Vec2::from(grass.period);
    let shift = ((camera.eye - grass.origin).truncate() / period).round() * period;
    let (low, high) = (grass.low - shift, grass.high - shift);
    Uniform {
        base: (grass.origin + shift.extend(0.0)).extend(grass.height).to_array(),
        corners: [low.x, low.y, high.x, high.y],
        period: [grass.period[0], grass.period[1], grass.count as f32, grass.level_cover],
        upright: sheet(&grass.upright),
        level: grass.level.as_ref().map_or([0.0; 4], sheet),
        shown: [grass.shown[0], grass.shown[1], grass.soil_open, pixel],
        soil: rgb(grass.soil),
        scatter: rgb(grass.scatter),
        below: rgb(dome.and_then(|d| Some(d.ground?.map(|v| v * d.strength))).unwrap_or_default()),
        rays: rays.map(|v| v.extend(0.0).to_array()),
        tables: [&grass.projection, &grass.cover, &grass.open, &sunlit].map(packed),
    }
}
