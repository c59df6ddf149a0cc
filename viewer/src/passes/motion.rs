//! Motion vectors: how far the surface in every pixel has moved in the picture since an earlier time and camera. They
//! are made only on request, and no other pass depends on them.

use crate::gpu::Gpu;
use crate::passes::bend::{self, BendPass, Ride};
use crate::passes::main::{Drawing, Drawn, drawing, vertex_state};
use crate::passes::outline::{OUTLINE, mask_group, mask_layout};
use crate::samplers::Samplers;
use crate::scene::{Scene, SectionAnimation, WindState};
use crate::shader::{Defines, assemble};
use crate::stand;
use crate::stats::RenderStatistics;
use crate::vertices::vertex_layouts;
use std::collections::HashMap;

/// The two cameras for the shader.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Cameras {
    pub now: [[f32; 4]; 4],
    pub before: [[f32; 4]; 4],
    pub half_size: [f32; 4],
}

pub(crate) struct MotionPass {
    cameras: wgpu::Buffer,
    group: wgpu::BindGroup,
    /// The bend at both times, where anything moves.
    bend: Option<BendPass>,
    /// The pipelines, by whether a mask cuts the outline, how sections move the mesh, and whether it stands in many
    /// places.
    pipelines: HashMap<(bool, Option<Ride>, bool), wgpu::RenderPipeline>,
    mask_layout: wgpu::BindGroupLayout,
}

impl MotionPass {
    /// Makes the pipelines and groups that the batches of a scene need, which `bend` moves in its pictures.
    pub(crate) fn new(
        gpu: &Gpu,
        scene: &Scene,
        bend: Option<&BendPass>,
        drawn: Drawn<'_>,
        stats: &mut RenderStatistics,
    ) -> MotionPass {
        let cameras = gpu.uniform("cameras of motion", &[Cameras::default()]);
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("cameras of motion"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::VERTEX | wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            }],
        });
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("cameras of motion"),
            layout: &layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: cameras.as_entire_binding() }],
        });
        let now = scene.sections.as_ref().map_or_else(Vec::new, |s| s.now(scene.wind.as_ref()));
        let bend = bend
            .zip(scene.sections.as_ref())
            .map(|(bend, sections)| BendPass::of(gpu, sections, bend.points.clone(), &[now.clone(), now], stats));
        let mut pass = MotionPass { cameras, group, bend, pipelines: HashMap::new(), mask_layout: mask_layout(gpu) };
        let sections = scene.sections.as_ref().map_or(0, |s| s.count);
        for (batch, _, material) in drawn.iter() {
            let kind @ (masked, bends, stands) = (material.mask().is_some(), batch.ride, batch.stand.is_some());
            if !pass.pipelines.contains_key(&kind) {
                let made = pass.pipeline(gpu, &layout, kind, sections);
                stats.pipeline(&format!(
                    "motion{}{}{}",
                    if masked { ": masked" } else { "" },
                    if bends.is_some() { ", bend" } else { "" },
                    if stands { ", stand" } else { "" }
                ));
                pass.pipelines.insert(kind, made);
            }
        }
        pass
    }

    fn pipeline(
        &self,
        gpu: &Gpu,
        cameras: &wgpu::BindGroupLayout,
        (masked, bends, stands): (bool, Option<Ride>, bool),
        sections: usize,
    ) -> wgpu::RenderPipeline {
        let defines = bend::defines(Defines::default(), bends, sections).set("MASK", masked);
        let defines = stand::defines(defines, stands);
        let stand = stands.then(|| stand::layout(gpu));
        let source = assemble(&[bend::SOURCE, OUTLINE, include_str!("motion.wgsl")].concat(), &defines);
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("motion"),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("motion"),
            bind_group_layouts: &[
                Some(cameras),
                masked.then_some(&self.mask_layout),
                self.bend.as_ref().filter(|_| bends.is_some()).map(BendPass::layout),
                stand.as_ref(),
            ],
            immediate_size: 0,
        });
        let buffers = vertex_layouts(false, false, masked, bends, false, false, stands);
        let vertex = vertex_state(&module, "vertex", &buffers);
        let (fragment, primitive) = ((&module, "fragment"), Default::default());
        drawing(gpu, Drawing { label: "motion", layout: &layout, vertex, fragment, primitive, msaa: 1, solid: true })
    }

    /// Takes over the cameras, and the wind at the picture's time and at the earlier time.
    pub(crate) fn aim(
        &self,
        gpu: &Gpu,
        cameras: Cameras,
        sections: Option<&SectionAnimation>,
        winds: [Option<&WindState>; 2],
    ) {
        gpu.queue.write_buffer(&self.cameras, 0, bytemuck::bytes_of(&cameras));
        if let (Some(bend), Some(sections)) = (&self.bend, sections) {
            bend.set_times(gpu, &winds.map(|wind| sections.now(wind)));
        }
    }

    /// Draws into a target of pixels (x, y, 0, 1), which is 0 where nothing is drawn.
    pub(crate) fn draw(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        drawn: Drawn<'_>,
        samplers: &Samplers,
        [color, depth]: [&wgpu::TextureView; 2],
        stats: &mut RenderStatistics,
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("motion"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Discard }),
                stencil_ops: None,
            }),
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        });
        pass.set_bind_group(0, &self.group, &[]);
        if let Some(bend) = &self.bend {
            pass.set_bind_group(2, &bend.group, &[]);
        }
        for (batch, mesh, material) in drawn.iter() {
            let mask = mask_group(gpu, &self.mask_layout, material, samplers);
            let bends = batch.ride;
            let kind = (mask.is_some(), bends, batch.stand.is_some());
            let Some(pipeline) = self.pipelines.get(&kind) else { continue };
            pass.set_pipeline(pipeline);
            if let Some(mask) = &mask {
                pass.set_bind_group(1, mask, &[]);
            }
            let buffers = [
                Some(&mesh.positions),
                mesh.uvs.as_ref().filter(|_| mask.is_some()),
                batch.levels.enlarged().or(batch.rows()),
                batch.rides.as_ref(),
            ];
            for (slot, buffer) in buffers.into_iter().flatten().enumerate() {
                pass.set_vertex_buffer(slot as u32, buffer.slice(..));
            }
            pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
            if let Some(stand) = &batch.stand {
                stats.draws += stand.seen.draw(&mut pass);
                continue;
            }
            for (indices, instances) in batch.levels.runs() {
                pass.draw_indexed(indices, 0, instances);
                stats.draws += 1;
            }
        }
    }
}
