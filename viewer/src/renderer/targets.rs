//! The textures that a frame is drawn into.

use crate::gpu::Gpu;
use crate::passes::bloom::{Bloom, BloomPass};
use crate::passes::main::DEPTH;
use crate::passes::tonemap::{self, TonemapPass};

/// The textures that pictures of one size are drawn into.
pub(super) struct TargetSet {
    pub width: u32,
    pub height: u32,
    pub msaa: u32,
    pub hdr: wgpu::Texture,
    pub hdr_view: wgpu::TextureView,
    pub samples: Option<wgpu::TextureView>,
    pub depth: wgpu::TextureView,
    pub ldr: wgpu::Texture,
    pub ldr_view: wgpu::TextureView,
    /// The picture with scattered light, where the scene has bloom.
    pub bloom: Option<Bloom>,
    pub radiance: wgpu::BindGroup,
}

impl TargetSet {
    pub fn new(
        gpu: &Gpu,
        tonemap: &TonemapPass,
        bloom: Option<&BloomPass>,
        width: u32,
        height: u32,
        msaa: u32,
    ) -> TargetSet {
        use wgpu::TextureUsages as Use;
        let texture = |label, format, sample_count, usage| {
            gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let view = |t: &wgpu::Texture| t.create_view(&Default::default());
        let format = gpu.hdr_format(msaa);
        let read = Use::RENDER_ATTACHMENT | Use::TEXTURE_BINDING | Use::COPY_SRC;
        let hdr = texture("radiance", format, 1, read);
        let ldr = texture("picture", tonemap::FORMAT, 1, read);
        let hdr_view = view(&hdr);
        let bloom = bloom.map(|pass| pass.on(gpu, &hdr_view, width, height));
        TargetSet {
            width,
            height,
            msaa,
            samples: (msaa > 1).then(|| view(&texture("samples", format, msaa, Use::RENDER_ATTACHMENT))),
            depth: view(&texture("depth", DEPTH, msaa, Use::RENDER_ATTACHMENT)),
            ldr_view: view(&ldr),
            radiance: tonemap.bind(gpu, bloom.as_ref().map_or(&hdr_view, |b| &b.radiance)),
            bloom,
            hdr,
            hdr_view,
            ldr,
        }
    }
}
