//! The main pass: draws everything that stands in the scene into a radiance target (HDR). It has a pipeline for each
//! variant of the shader that the scene needs.

use crate::dome::{self, MOST_BANDS};
use crate::geometry::{Batch, MeshOnGpu};
use crate::gpu::Gpu;
use crate::material::{self, MaterialOnGpu};
use crate::passes::backdrop::BackdropPass;
use crate::passes::bend::{self, BendPass};
use crate::passes::grass::GrassPass;
use crate::passes::harmonics;
use crate::passes::shadow::ShadowPass;
use crate::passes::sky::SkyPass;
use crate::passes::transfer::TransferPass;
use crate::scene::{Scene, SkyDome};
use crate::shader::{assemble, of_side};
use crate::stand;
use crate::stats::RenderStatistics;
use crate::variant::{Lights, Variant};
use crate::vertices::vertex_layouts;
use std::collections::HashMap;

pub(crate) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// The constants of a frame for the shader.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Frame {
    pub view_projection: [[f32; 4]; 4],
    pub eye: [f32; 4],
    pub sun_direction: [f32; 4],
    pub sun_irradiance: [f32; 4],
    pub sky: [f32; 4],
    pub shadow: [f32; 4],
    pub tube: [f32; 4],
    pub travel: [f32; 4],
}

/// The meshes and materials of the scene, by the scene's indices; `None` for those without an instance.
#[derive(Clone, Copy)]
pub(crate) struct Drawn<'a> {
    pub meshes: &'a [Option<MeshOnGpu>],
    pub materials: &'a [Option<MaterialOnGpu>],
    pub batches: &'a [Batch],
}

impl<'a> Drawn<'a> {
    /// The batches, each with its mesh and its material.
    pub(crate) fn iter(self) -> impl Iterator<Item = (&'a Batch, &'a MeshOnGpu, &'a MaterialOnGpu)> {
        self.batches.iter().filter_map(move |b| {
            let mesh = b.own.as_ref().or(self.meshes[b.mesh].as_ref())?;
            Some((b, mesh, self.materials[b.material].as_ref()?))
        })
    }
}

/// Pipelines made so far, kept from scene to scene.
#[derive(Default)]
pub(crate) struct Pipelines(HashMap<Variant, wgpu::RenderPipeline>);

pub(crate) struct MainPass {
    pub frame: wgpu::Buffer,
    dome: Option<wgpu::Buffer>,
    shares: Option<wgpu::Buffer>,
    group: wgpu::BindGroup,
}

/// The targets of the pass, and what is drawn besides the batches.
pub(crate) struct Targets<'a> {
    pub color: &'a wgpu::TextureView,
    pub resolve: Option<&'a wgpu::TextureView>,
    pub depth: &'a wgpu::TextureView,
    /// Radiance where nothing is hit.
    pub background: [f32; 3],
    /// The sky, which replaces the background.
    pub sky: Option<&'a SkyPass>,
    /// The environment map that is seen in the place of both.
    pub backdrop: Option<&'a BackdropPass>,
    /// The sections, if any.
    pub bend: Option<&'a BendPass>,
    /// The lawns, if any.
    pub grass: Option<&'a GrassPass>,
}

pub(crate) fn frame_layout(gpu: &Gpu, lights: &Lights) -> wgpu::BindGroupLayout {
    let Lights { dome, transfer, shares, .. } = *lights;
    let uniform = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let fragment = wgpu::ShaderStages::FRAGMENT;
    let entry = |binding, visibility, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let mut entries = vec![entry(0, fragment | wgpu::ShaderStages::VERTEX, uniform)];
    if lights.shadow > 0 {
        let map = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Depth,
            view_dimension: wgpu::TextureViewDimension::D2Array,
            multisampled: false,
        };
        entries.push(entry(1, fragment, map));
        entries.push(entry(2, fragment, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Comparison)));
        entries.push(entry(3, fragment, uniform));
    }
    let storage = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Storage { read_only: true },
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    if shares {
        entries.push(entry(10, wgpu::ShaderStages::VERTEX, storage));
    }
    if transfer {
        entries.push(entry(9, fragment | wgpu::ShaderStages::VERTEX, storage));
    } else if dome {
        entries.push(entry(8, fragment, uniform));
    }
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("frame"), entries: &entries })
}

impl Pipelines {
    /// Makes the variant's pipeline unless it exists. Its name is added to `stats` either way.
    pub(crate) fn need(&mut self, gpu: &Gpu, variant: &Variant, stats: &mut RenderStatistics) {
        stats.pipeline(&variant.name());
        self.0.entry(*variant).or_insert_with(|| pipeline(gpu, variant));
    }
}

/// The functions that evaluate the harmonics of the light from all around, where there are any.
fn harmonics(variant: &Variant) -> String {
    match (variant.lights.dome, variant.anchored) {
        (false, _) => String::new(),
        (true, Some(anchored)) => harmonics::source(anchored.bands as usize, false),
        (true, None) => harmonics::source(MOST_BANDS, true),
    }
}

/// WGSL of how light meets a surface, with the functions that it needs under a variant's lights.
pub(crate) fn light(variant: &Variant) -> String {
    include_str!("light.wgsl").to_string() + &harmonics(variant)
}

/// The shader of a variant.
pub(crate) fn source(variant: &Variant) -> String {
    let shared = [bend::SOURCE, include_str!("main.wgsl"), &light(variant)].concat();
    let defines = variant.defines();
    let Some(leaf) = variant.leaf() else { return assemble(&(shared + include_str!("opaque.wgsl")), &defines) };
    let own =
        [include_str!("leaf.wgsl"), include_str!("arrives.wgsl"), include_str!("maps.wgsl"), include_str!("lobe.wgsl")]
            .concat();
    let sides = leaf
        .sides
        .iter()
        .map(|(side, needs)| assemble(&of_side(include_str!("side.wgsl"), side), &variant.side_defines(leaf, needs)));
    assemble(&(shared + &own), &defines) + &sides.collect::<String>()
}

fn pipeline(gpu: &Gpu, variant: &Variant) -> wgpu::RenderPipeline {
    let source = source(variant);
    let bend = bend::layout_of(gpu, variant);
    let stand = variant.stand.then(|| stand::layout(gpu));
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("main"),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("main"),
        bind_group_layouts: &[
            Some(&frame_layout(gpu, &variant.lights)),
            Some(&material::layout(gpu, variant)),
            bend.as_ref(),
            stand.as_ref(),
        ],
        immediate_size: 0,
    });
    let buffers = vertex_layouts(
        true,
        variant.tangent(),
        variant.leaf().is_some(),
        variant.bend,
        variant.begins(),
        variant.anchored.is_some(),
        variant.stand,
    );
    let vertex = vertex_state(&module, "vertex", &buffers);
    let (fragment, primitive) = ((&module, "fragment"), Default::default());
    drawing(
        gpu,
        Drawing { label: "main", layout: &layout, vertex, fragment, primitive, msaa: variant.msaa, solid: true },
    )
}

/// A vertex stage without constants of its own.
pub(crate) fn vertex_state<'a>(
    module: &'a wgpu::ShaderModule,
    entry: &'a str,
    buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
) -> wgpu::VertexState<'a> {
    wgpu::VertexState { module, entry_point: Some(entry), compilation_options: Default::default(), buffers }
}

/// The description of a pipeline whose targets have the formats of the main pass.
pub(crate) struct Drawing<'a> {
    pub label: &'a str,
    pub layout: &'a wgpu::PipelineLayout,
    pub vertex: wgpu::VertexState<'a>,
    /// The module of the fragment shader and its entry point.
    pub fragment: (&'a wgpu::ShaderModule, &'a str),
    pub primitive: wgpu::PrimitiveState,
    pub msaa: u32,
    /// Whether the nearest surface hides the others. If not, colours are multiplied by their opacity and blended over
    /// what is there, and no depth is written.
    pub solid: bool,
}

/// Makes the pipeline.
pub(crate) fn drawing(gpu: &Gpu, drawn: Drawing<'_>) -> wgpu::RenderPipeline {
    let Drawing { label, layout, vertex, fragment: (module, entry), primitive, msaa, solid } = drawn;
    let blend = (!solid).then_some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING);
    let target = wgpu::ColorTargetState { blend, ..gpu.hdr_format(msaa).into() };
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(label),
        layout: Some(layout),
        vertex,
        primitive,
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(solid),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: wgpu::MultisampleState { count: msaa, mask: !0, alpha_to_coverage_enabled: false },
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(entry),
            compilation_options: Default::default(),
            targets: &[Some(target)],
        }),
        multiview_mask: None,
        cache: None,
    })
}

impl MainPass {
    pub(crate) fn new(
        gpu: &Gpu,
        scene: &Scene,
        shadow: Option<&ShadowPass>,
        transfer: Option<&TransferPass>,
        stats: &mut RenderStatistics,
    ) -> MainPass {
        let lights = Lights::of(scene);
        let frame = gpu.uniform("frame", &[Frame::default()]);
        let mut entries = vec![wgpu::BindGroupEntry { binding: 0, resource: frame.as_entire_binding() }];
        if let Some(shadow) = shadow {
            entries
                .push(wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(&shadow.map) });
            entries
                .push(wgpu::BindGroupEntry { binding: 2, resource: wgpu::BindingResource::Sampler(&shadow.sampler) });
            entries.push(wgpu::BindGroupEntry { binding: 3, resource: shadow.matrices.as_entire_binding() });
        }
        let dome = scene.dome.as_ref().filter(|_| transfer.is_none()).map(|dome| {
            let coefficients = dome::coefficients(dome);
            stats.upload("sky harmonics", size_of_val(&coefficients) as u64);
            gpu.uniform("sky harmonics", &coefficients)
        });
        if let Some(dome) = &dome {
            entries.push(wgpu::BindGroupEntry { binding: 8, resource: dome.as_entire_binding() });
        }
        if let Some(transfer) = transfer {
            entries.push(wgpu::BindGroupEntry { binding: 9, resource: transfer.arriving.as_entire_binding() });
        }
        let shares = scene.sun_shares.as_ref().filter(|_| lights.shares).map(|shares| {
            let words = words(shares);
            stats.upload("shares of the sun", words.len() as u64);
            gpu.buffer("shares of the sun", &words, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST)
        });
        if let Some(shares) = &shares {
            entries.push(wgpu::BindGroupEntry { binding: 10, resource: shares.as_entire_binding() });
        }
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("frame"),
            layout: &frame_layout(gpu, &lights),
            entries: &entries,
        });
        MainPass { frame, dome, shares, group }
    }

    /// Takes over new shares of the sun. Their number must not change.
    pub(crate) fn set_shares(&self, gpu: &Gpu, shares: &[u8]) {
        if let Some(buffer) = &self.shares {
            gpu.queue.write_buffer(buffer, 0, &words(shares));
        }
    }

    /// Takes over a changed dome.
    pub(crate) fn set_dome(&self, gpu: &Gpu, dome: &SkyDome) {
        if let Some(buffer) = &self.dome {
            gpu.queue.write_buffer(buffer, 0, bytemuck::cast_slice(&dome::coefficients(dome)));
        }
    }

    /// Draws everything over the background. Alpha is the coverage.
    pub(crate) fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        pipelines: &Pipelines,
        drawn: Drawn<'_>,
        targets: Targets<'_>,
        times: Option<wgpu::RenderPassTimestampWrites<'_>>,
        stats: &mut RenderStatistics,
    ) {
        let [r, g, b] = targets.background.map(f64::from);
        let store = if targets.resolve.is_some() { wgpu::StoreOp::Discard } else { wgpu::StoreOp::Store };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("main"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: targets.color,
                depth_slice: None,
                resolve_target: targets.resolve,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a: 0.0 }), store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: targets.depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            timestamp_writes: times,
            occlusion_query_set: None,
            multiview_mask: None,
        });
        if let Some(backdrop) = targets.backdrop {
            backdrop.draw(&mut pass, stats);
        } else if let Some(sky) = targets.sky {
            sky.draw(&mut pass, stats);
        }
        pass.set_bind_group(0, &self.group, &[]);
        if let Some(bend) = targets.bend {
            pass.set_bind_group(2, &bend.group, &[]);
        }
        for (batch, mesh, material) in drawn.iter() {
            let variant = &batch.variant;
            let Some(pipeline) = pipelines.0.get(variant) else { continue };
            pass.set_pipeline(pipeline);
            pass.set_bind_group(1, &material.group, &[]);
            let buffers = [
                Some(&mesh.positions),
                Some(&mesh.normals),
                mesh.tangents.as_ref().filter(|_| variant.tangent()),
                mesh.uvs.as_ref().filter(|_| variant.leaf().is_some()),
                batch.shown(),
                batch.bending(),
                batch.shown_begins().filter(|_| variant.begins()),
                mesh.places.as_ref().filter(|_| variant.anchored.is_some()),
            ];
            for (slot, buffer) in buffers.into_iter().flatten().enumerate() {
                pass.set_vertex_buffer(slot as u32, buffer.slice(..));
            }
            pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
            if let Some(stand) = &batch.stand {
                stats.draws += stand.seen.draw(&mut pass);
                continue;
            }
            if let Some(choice) = &batch.choice {
                stats.draws += choice.draw(&mut pass);
                continue;
            }
            for (indices, instances) in batch.levels.runs() {
                pass.draw_indexed(indices, 0, instances);
                stats.draws += 1;
            }
        }
        if let Some(grass) = targets.grass {
            grass.draw(&mut pass, stats);
        }
    }
}

/// The bytes, filled up to whole words.
fn words(bytes: &[u8]) -> Vec<u8> {
    let mut out = bytes.to_vec();
    out.resize(bytes.len().next_multiple_of(4).max(4), 0);
    out
}

#[cfg(test)]
#[path = "main_tests.rs"]
mod tests;
