//! Shadows of the sun's disk: N orthographic depth maps for N directions that are spread evenly over the disk (Vogel's
//! spiral). The main pass averages N comparisons. With N this converges to the visible share of the disk, which is a
//! true soft shadow: the disk's radius determines the width of the penumbra. The maps are drawn once, and again only
//! when the sun or the geometry changes.

use crate::gpu::Gpu;
use crate::passes::bend::{self, BendPass, Ride};
use crate::passes::disk::disk_directions;
use crate::passes::fit::FitPass;
use crate::passes::main::Drawn;
use crate::passes::outline::{OUTLINE, mask_group, mask_layout};
use crate::samplers::Samplers;
use crate::scene::{Scene, Sun};
use crate::shader::{Defines, assemble};
use crate::stand;
use crate::stats::RenderStatistics;
use crate::variant::Variant;
use crate::vertices::vertex_layouts;
use glam::{Mat4, Vec3, Vec4};
use std::collections::HashMap;

const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Distance of uniforms with a dynamic offset, which suits every adapter.
pub(crate) const STRIDE: usize = 256;

pub(crate) struct ShadowPass {
    layers: Vec<wgpu::TextureView>,
    pub map: wgpu::TextureView,
    pub sampler: wgpu::Sampler,
    /// One matrix for each layer, packed, for the main pass.
    pub matrices: wgpu::Buffer,
    light_group: wgpu::BindGroup,
    light_buffer: wgpu::Buffer,
    /// The pipelines, by whether a mask cuts the outline, how sections move the mesh, and whether plants stand often.
    pipelines: HashMap<(bool, Option<Ride>, bool), wgpu::RenderPipeline>,
    mask_layout: Option<wgpu::BindGroupLayout>,
    /// The groups of masks, in the order of the batches.
    mask_groups: Vec<Option<wgpu::BindGroup>>,
    resolution: u32,
    drawn: bool,
    /// Fits the maps to what the adapter moves.
    fit: Option<FitPass>,
}

/// The tightest orthographic matrix around `corners` as seen along `direction`, and the longer side of its texels.
fn light_matrix(direction: Vec3, corners: &[Vec3], resolution: u32) -> (Mat4, f32) {
    let (x, y) = direction.any_orthonormal_pair();
    let place = |p: Vec3| Vec3::new(p.dot(x), p.dot(y), -p.dot(direction));
    let first = corners.first().copied().map_or(Vec3::ZERO, place);
    let (low, high) = corners.iter().map(|p| place(*p)).fold((first, first), |(l, h), p| (l.min(p), h.max(p)));
    // A rim of two texels keeps the filter inside the map. A little extra depth avoids a range of zero for flat scenes.
    let size = (high - low).max(Vec3::splat(1e-3));
    let margin =
        Vec3::new(size.x * 2.0 / resolution as f32, size.y * 2.0 / resolution as f32, 0.02 * size.max_element());
    let (low, high) = (low - margin, high + margin);
    let size = high - low;
    let row = |axis: Vec3, l: f32, s: f32| (axis * (2.0 / s)).extend(-2.0 * l / s - 1.0);
    let depth = (-direction / size.z).extend(-low.z / size.z);
    let rows = [row(x, low.x, size.x), row(y, low.y, size.y), depth, Vec4::W];
    (Mat4::from_cols(rows[0], rows[1], rows[2], rows[3]).transpose(), size.x.max(size.y) / resolution as f32)
}

/// The matrices of all layers, and the longest side of a texel (mm).
fn light_matrices(sun: &Sun, corners: &[Vec3], layers: u32, resolution: u32) -> (Vec<Mat4>, f32) {
    let all: Vec<(Mat4, f32)> =
        disk_directions(sun, layers).into_iter().map(|d| light_matrix(d, corners, resolution)).collect();
    let texel = all.iter().map(|(_, t)| *t).fold(0.0, f32::max);
    (all.into_iter().map(|(m, _)| m).collect(), texel)
}

fn spaced(matrices: &[Mat4]) -> Vec<u8> {
    let mut bytes = vec![0u8; matrices.len() * STRIDE];
    for (slot, matrix) in bytes.chunks_mut(STRIDE).zip(matrices) {
        slot[..64].copy_from_slice(bytemuck::bytes_of(matrix));
    }
    bytes
}

impl ShadowPass {
    /// Makes the maps, and the pipelines that the casters need. Also returns the side of a texel (mm).
    pub(crate) fn new(
        gpu: &Gpu,
        scene: &Scene,
        sun: &Sun,
        corners: &[Vec3],
        drawn: Drawn<'_>,
        samplers: &Samplers,
        stats: &mut RenderStatistics,
    ) -> (ShadowPass, f32) {
        let device = &gpu.device;
        let (layers, resolution) = (scene.shadow_samples, scene.shadow_resolution);
        // The GL backend of wgpu makes a plain texture from one square layer, and cubes from multiples of six. A spare
        // layer avoids both.
        let spare = u32::from(gpu.is_gl() && (layers == 1 || layers.is_multiple_of(6)));
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("shadow maps"),
            size: wgpu::Extent3d { width: resolution, height: resolution, depth_or_array_layers: layers + spare },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let view = |base, count, dimension| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(dimension),
                base_array_layer: base,
                array_layer_count: Some(count),
                ..Default::default()
            })
        };
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("shadow"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            compare: Some(wgpu::CompareFunction::LessEqual),
            ..Default::default()
        });
        let (matrices, texel) = light_matrices(sun, corners, layers, resolution);
        let light_buffer = gpu.uniform("shadow matrices, spaced", &spaced(&matrices));
        let light_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("shadow light"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::VERTEX,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: true,
                    min_binding_size: wgpu::BufferSize::new(64),
                },
                count: None,
            }],
        });
        let light_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("shadow light"),
            layout: &light_layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                    buffer: &light_buffer,
                    offset: 0,
                    size: wgpu::BufferSize::new(64),
                }),
            }],
        });
        let own_mask = drawn.batches.iter().any(|b| b.casts && b.variant.masked()).then(|| mask_layout(gpu));
        let mut pipelines = HashMap::new();
        for variant in drawn.batches.iter().filter(|b| b.casts).map(|b| &b.variant) {
            let (masked, bends) = (variant.masked(), variant.bend);
            pipelines.entry((masked, bends, variant.stand)).or_insert_with(|| {
                let name = if masked { "shadow: masked" } else { "shadow: opaque" };
                let more = [(bends.is_some(), ", bend"), (variant.stand, ", stand")];
                let more: String = more.into_iter().filter(|(on, _)| *on).map(|(_, word)| word).collect();
                stats.pipeline(&format!("{name}{more}"));
                pipeline(gpu, &light_layout, own_mask.as_ref().filter(|_| masked), variant)
            });
        }
        let mut pass = ShadowPass {
            layers: (0..layers).map(|i| view(i, 1, wgpu::TextureViewDimension::D2)).collect(),
            map: view(0, layers + spare, wgpu::TextureViewDimension::D2Array),
            sampler,
            matrices: gpu.uniform("shadow matrices", &matrices),
            light_group,
            light_buffer,
            pipelines,
            mask_layout: own_mask,
            mask_groups: Vec::new(),
            resolution,
            drawn: false,
            fit: None,
        };
        pass.bind_masks(gpu, drawn, samplers);
        (pass, texel)
    }

    /// Binds the leaves' masks again, after a leaf was uploaded again.
    pub(crate) fn bind_masks(&mut self, gpu: &Gpu, drawn: Drawn<'_>, samplers: &Samplers) {
        let group = |material| mask_group(gpu, self.mask_layout.as_ref()?, material, samplers);
        self.mask_groups = drawn.iter().map(|(_, _, material)| group(material)).collect();
    }

    /// Moves the sun. The maps are drawn again with the next picture. Returns the side of a texel (mm).
    pub(crate) fn set_sun(&mut self, gpu: &Gpu, sun: &Sun, corners: &[Vec3]) -> f32 {
        let (matrices, texel) = light_matrices(sun, corners, self.layers.len() as u32, self.resolution);
        gpu.queue.write_buffer(&self.light_buffer, 0, &spaced(&matrices));
        gpu.queue.write_buffer(&self.matrices, 0, bytemuck::cast_slice(&matrices));
        if let Some(fit) = &self.fit {
            fit.set_sun(gpu, &disk_directions(sun, self.layers.len() as u32));
        }
        self.drawn = false;
        texel
    }

    /// Lets the maps follow the boxes of `parts`, which move on the adapter, and points that stand `still`.
    pub(crate) fn follow(
        &mut self,
        gpu: &Gpu,
        parts: &wgpu::Buffer,
        sun: &Sun,
        still: Vec<Vec3>,
        stats: &mut RenderStatistics,
    ) {
        stats.pipeline("shadow: fit");
        stats.pipeline("shadow: clear");
        let directions = disk_directions(sun, self.layers.len() as u32);
        self.fit = Some(FitPass::new(gpu, parts, &directions, still, self.resolution));
    }

    /// Whether the maps follow what moves, and are drawn for each picture.
    pub(crate) fn follows_motion(&self) -> bool {
        self.fit.is_some()
    }

    /// Whether the maps are valid as they are.
    pub(crate) fn is_drawn(&self) -> bool {
        self.drawn
    }

    /// Marks the maps as not drawn, so that drawing them can be timed.
    pub(crate) fn forget(&mut self) {
        self.drawn = false;
    }

    /// Prepares for a picture whose pixels are nowhere narrower than `pixel` (mm) on what they show. Maps that follow
    /// what moves are drawn for each picture, with no more texels than it can show. Returns the side of a texel, which
    /// is `texel` where all are used.
    pub(crate) fn aim(&mut self, gpu: &Gpu, texel: f32, pixel: f32) -> f32 {
        let Some(fit) = &mut self.fit else { return texel };
        let side = fit.needed(texel, pixel);
        // Finer maps are not kept either: a picture must not depend on what was drawn before it.
        if side != fit.side {
            fit.set_side(gpu, side);
            self.drawn = false;
        }
        texel * self.resolution as f32 / fit.side as f32
    }

    /// The share of the texture's side up to which it holds the maps. What was in the rest is not cleared.
    pub(crate) fn share(&self) -> f32 {
        let side = self.fit.as_ref().map_or(self.resolution, |fit| fit.side);
        // A comparison reads the texels on both sides. The maps' rim is wider than one.
        if side < self.resolution { (side - 1) as f32 / self.resolution as f32 } else { 1.0 }
    }

    /// Draws the maps, whose texels have about the side `texel` (mm), unless they are still valid. `times` records a
    /// timestamp before and after the layers. Maps that follow what moves write the true side into `frame`.
    #[expect(clippy::too_many_arguments, reason = "a pass is recorded from what different owners hold")]
    pub(crate) fn draw(
        &mut self,
        texel: f32,
        encoder: &mut wgpu::CommandEncoder,
        drawn: Drawn<'_>,
        bend: Option<&BendPass>,
        frame: &wgpu::Buffer,
        times: Option<(&wgpu::QuerySet, u32)>,
        stats: &mut RenderStatistics,
    ) -> bool {
        if let Some(fit) = &self.fit {
            if !self.drawn {
                fit.record(encoder, bend.and_then(|b| b.pose.as_ref()), &self.light_buffer, &self.matrices);
            }
            fit.texel(encoder, frame);
        }
        if self.drawn {
            return false;
        }
        stats.shadow_triangles = 0;
        stats.shadow_side = self.fit.as_ref().map_or(self.resolution, |fit| fit.side);
        // To clear a large texture takes longer than to draw a tree into its corner. (A mobile GPU, which loads what is
        // not cleared, may see it otherwise.)
        let corner = self.fit.as_ref().filter(|fit| fit.side < self.resolution);
        let load = if corner.is_some() { wgpu::LoadOp::Load } else { wgpu::LoadOp::Clear(1.0) };
        for (i, layer) in self.layers.iter().enumerate() {
            let timestamp_writes = times.map(|(query_set, base)| wgpu::RenderPassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: (i == 0).then_some(base),
                end_of_pass_write_index: (i + 1 == self.layers.len()).then_some(base + 1),
            });
            let timestamp_writes = timestamp_writes
                .filter(|t| t.beginning_of_pass_write_index.is_some() || t.end_of_pass_write_index.is_some());
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("shadow"),
                color_attachments: &[],
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: layer,
                    depth_ops: Some(wgpu::Operations { load, store: wgpu::StoreOp::Store }),
                    stencil_ops: None,
                }),
                timestamp_writes,
                occlusion_query_set: None,
                multiview_mask: None,
            });
            if let Some(fit) = corner {
                fit.begin(&mut pass);
            }
            pass.set_bind_group(0, &self.light_group, &[(i * STRIDE) as u32]);
            if let Some(bend) = bend {
                pass.set_bind_group(2, &bend.group, &[]);
            }
            for ((batch, mesh, _), mask) in drawn.iter().zip(&self.mask_groups) {
                if !batch.casts {
                    continue;
                }
                let kind = (mask.is_some(), batch.variant.bend, batch.variant.stand);
                let Some(pipeline) = self.pipelines.get(&kind) else { continue };
                pass.set_pipeline(pipeline);
                if let Some(group) = mask {
                    pass.set_bind_group(1, group, &[]);
                }
                let uvs = mesh.uvs.as_ref().filter(|_| mask.is_some());
                let (instances, rides, count) = batch.casting();
                let buffers = [Some(&mesh.positions), uvs, instances, rides];
                for (slot, buffer) in buffers.into_iter().flatten().enumerate() {
                    pass.set_vertex_buffer(slot as u32, buffer.slice(..));
                }
                pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
                if let Some(stand) = &batch.stand {
                    stats.draws += stand.casting.draw(&mut pass);
                    stats.shadow_triangles += if i == 0 { stand.casting.triangles() } else { 0 };
                    continue;
                }
                let indices = batch.levels.shadow(texel);
                if i == 0 {
                    stats.shadow_triangles += indices.len() as u64 / 3 * u64::from(count);
                }
                pass.draw_indexed(indices, 0, 0..count);
                stats.draws += 1;
            }
        }
        self.drawn = true;
        stats.shadow_renders += 1;
        true
    }
}

/// A depth target of a shadow map.
pub(crate) fn depth(compare: wgpu::CompareFunction) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: FORMAT,
        depth_write_enabled: Some(true),
        depth_compare: Some(compare),
        stencil: Default::default(),
        bias: Default::default(),
    }
}

fn pipeline(
    gpu: &Gpu,
    light: &wgpu::BindGroupLayout,
    mask: Option<&wgpu::BindGroupLayout>,
    variant: &Variant,
) -> wgpu::RenderPipeline {
    let defines = bend::defines(Defines::default(), variant.bend, 0).set("MASK", mask.is_some());
    let defines = stand::defines(defines, variant.stand);
    let source = assemble(&[bend::SOURCE, OUTLINE, include_str!("shadow.wgsl")].concat(), &defines);
    let bend = bend::layout_of(gpu, variant);
    let stand = variant.stand.then(|| stand::layout(gpu));
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("shadow"),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("shadow"),
        bind_group_layouts: &[Some(light), mask, bend.as_ref(), stand.as_ref()],
        immediate_size: 0,
    });
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("shadow"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &vertex_layouts(false, false, mask.is_some(), variant.bend, false, false, variant.stand),
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(depth(wgpu::CompareFunction::LessEqual)),
        multisample: Default::default(),
        fragment: mask.map(|_| wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: Default::default(),
            targets: &[],
        }),
        multiview_mask: None,
        cache: None,
    })
}
