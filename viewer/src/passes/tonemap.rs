//! The tone map from radiance to 8-bit sRGB: exposure, Reinhard's curve for each channel, IEC 61966-2-1.

use crate::gpu::Gpu;
use crate::passes::fullscreen;
use crate::stats::RenderStatistics;

/// The shader does the encoding, so that rounding is the same on every adapter.
pub(crate) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

pub(crate) struct TonemapPass {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    exposure: wgpu::Buffer,
}

impl TonemapPass {
    pub(crate) fn new(gpu: &Gpu) -> TonemapPass {
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty,
            count: None,
        };
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("tonemap"),
            entries: &[
                entry(
                    0,
                    wgpu::BindingType::Texture {
                        sample_type: wgpu::TextureSampleType::Float { filterable: false },
                        view_dimension: wgpu::TextureViewDimension::D2,
                        multisampled: false,
                    },
                ),
                entry(
                    1,
                    wgpu::BindingType::Buffer {
                        ty: wgpu::BufferBindingType::Uniform,
                        has_dynamic_offset: false,
                        min_binding_size: None,
                    },
                ),
            ],
        });
        let pipeline = fullscreen::pipeline(
            gpu,
            "tonemap",
            include_str!("tonemap.wgsl"),
            &layout,
            FORMAT,
            None,
            Default::default(),
        );
        TonemapPass { pipeline, layout, exposure: gpu.uniform("exposure", &[[1.0f32; 4]]) }
    }

    pub(crate) fn set_exposure(&self, gpu: &Gpu, exposure: f32) {
        gpu.queue.write_buffer(&self.exposure, 0, bytemuck::bytes_of(&[exposure, 0.0, 0.0, 0.0]));
    }

    /// Binds a radiance picture.
    pub(crate) fn bind(&self, gpu: &Gpu, radiance: &wgpu::TextureView) -> wgpu::BindGroup {
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("tonemap"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(radiance) },
                wgpu::BindGroupEntry { binding: 1, resource: self.exposure.as_entire_binding() },
            ],
        })
    }

    pub(crate) fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        radiance: &wgpu::BindGroup,
        target: &wgpu::TextureView,
        times: Option<wgpu::RenderPassTimestampWrites<'_>>,
        stats: &mut RenderStatistics,
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("tonemap"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
            })],
            depth_stencil_attachment: None,
            timestamp_writes: times,
            occlusion_query_set: None,
            multiview_mask: None,
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, radiance, &[]);
        pass.draw(0..3, 0..1);
        stats.draws += 1;
    }
}
