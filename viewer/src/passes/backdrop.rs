//! An environment map that is seen behind everything and lights nothing. It is drawn first in the main pass, in the
//! place of the background or the sky.

use crate::gpu::Gpu;
use crate::maps::{Level, upload_table};
use crate::passes::fullscreen;
use crate::passes::main::DEPTH;
use crate::passes::sky::pixel_rays;
use crate::scene::{Backdrop, Camera};
use crate::stats::Stats;
use glam::Vec3;

pub(crate) struct BackdropPass {
    pipeline: wgpu::RenderPipeline,
    rays: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl BackdropPass {
    pub(crate) fn new(gpu: &Gpu, backdrop: &Backdrop, msaa: u32, stats: &mut Stats) -> BackdropPass {
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty,
            count: None,
        };
        let uniform = wgpu::BindingType::Buffer {
            ty: wgpu::BufferBindingType::Uniform,
            has_dynamic_offset: false,
            min_binding_size: None,
        };
        let texture = wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable: false },
            view_dimension: wgpu::TextureViewDimension::D2,
            multisampled: false,
        };
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("backdrop"),
            entries: &[entry(0, uniform), entry(1, texture)],
        });
        // It is drawn first, so everything else covers it.
        let depth = wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(false),
            depth_compare: Some(wgpu::CompareFunction::Always),
            stencil: Default::default(),
            bias: Default::default(),
        };
        let samples = wgpu::MultisampleState { count: msaa, mask: !0, alpha_to_coverage_enabled: false };
        let pipeline = fullscreen::pipeline(
            gpu,
            "backdrop",
            include_str!("backdrop.wgsl"),
            &layout,
            gpu.hdr_format(msaa),
            Some(depth),
            samples,
        );
        stats.pipeline("backdrop");
        let rays = gpu.uniform("backdrop", &[[[0.0f32; 4]; 3]]);
        let texels = backdrop.texels.iter().map(|[r, g, b]| [*r, *g, *b, 0.0]).collect();
        let map = upload_table(gpu, "backdrop", Level { width: backdrop.width, height: backdrop.height, texels });
        stats.upload("backdrop", map.bytes);
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("backdrop"),
            layout: &layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: rays.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::TextureView(&map.view) },
            ],
        });
        BackdropPass { pipeline, rays, group }
    }

    /// Takes over the camera of this frame.
    pub(crate) fn aim(&self, gpu: &Gpu, camera: &Camera, size: [u32; 2]) {
        let four = |v: Vec3| [v.x, v.y, v.z, 0.0];
        let (_, rays) = pixel_rays(camera, size);
        gpu.queue.write_buffer(&self.rays, 0, bytemuck::bytes_of(&rays.map(four)));
    }

    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, stats: &mut Stats) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.draw(0..3, 0..1);
        stats.draws += 1;
    }
}
