//! The tone map from radiance to 8-bit sRGB: the map of channels, exposure, the curve for each channel, IEC 61966-2-1.

use crate::gpu::Gpu;
use crate::passes::fullscreen;
use crate::scene::{PictureDisplay, ToneCurve};
use crate::stats::RenderStatistics;

/// The shader does the encoding, so that rounding is the same on every adapter.
pub(crate) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

pub(crate) struct TonemapPass {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    shown: wgpu::Buffer,
    exposure: f32,
    display: PictureDisplay,
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
        TonemapPass {
            pipeline,
            layout,
            shown: gpu.uniform("display", &[[1.0f32; 4]; 4]),
            exposure: 1.0,
            display: PictureDisplay::default(),
        }
    }

    /// Sets how the pictures that follow are shown.
    pub(crate) fn set(&mut self, gpu: &Gpu, exposure: f32, display: PictureDisplay) {
        (self.exposure, self.display) = (exposure, display);
        self.show(gpu, display);
    }

    /// Shows the pictures that follow as checks compare them, or as they were set.
    pub(crate) fn plain(&self, gpu: &Gpu, plain: bool) {
        self.show(gpu, if plain { PictureDisplay::default() } else { self.display });
    }

    fn show(&self, gpu: &Gpu, display: PictureDisplay) {
        let film = if display.curve == ToneCurve::Film { 1.0 } else { 0.0 };
        let [r, g, b] = display.channels.to_srgb().map(|row| row.map(|v| v as f32)).map(|[x, y, z]| [x, y, z, 0.0]);
        gpu.queue.write_buffer(&self.shown, 0, bytemuck::bytes_of(&[[self.exposure, film, 0.0, 0.0], r, g, b]));
    }

    /// Binds a radiance picture.
    pub(crate) fn bind(&self, gpu: &Gpu, radiance: &wgpu::TextureView) -> wgpu::BindGroup {
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("tonemap"),
            layout: &self.layout,
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(radiance) },
                wgpu::BindGroupEntry { binding: 1, resource: self.shown.as_entire_binding() },
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
