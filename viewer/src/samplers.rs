//! How textures of materials are read between their texels.

use crate::gpu::Gpu;

/// The samplers that all materials share.
pub(crate) struct Samplers {
    /// Trilinear where a map is minified, bilinear where it is magnified, and clamped at the rim.
    pub maps: wgpu::Sampler,
    /// The same for a pattern that is laid side by side and seen at a flat angle.
    pub tiles: wgpu::Sampler,
}

impl Samplers {
    pub(crate) fn new(gpu: &Gpu) -> Samplers {
        Samplers {
            maps: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("maps"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                mipmap_filter: wgpu::MipmapFilterMode::Linear,
                ..Default::default()
            }),
            tiles: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("tiles"),
                address_mode_u: wgpu::AddressMode::Repeat,
                address_mode_v: wgpu::AddressMode::Repeat,
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                mipmap_filter: wgpu::MipmapFilterMode::Linear,
                anisotropy_clamp: 16,
                ..Default::default()
            }),
        }
    }
}
