//! What passes share that draw outlines only: the vertex, and the mask that cuts a leaf out of its mesh.

use crate::gpu::Gpu;
use crate::material::MaterialOnGpu;
use crate::samplers::Samplers;

/// WGSL of a vertex and its mask. It stands between the source of the bend and the source of the pass.
pub(crate) const OUTLINE: &str = include_str!("outline.wgsl");

/// A leaf's mask for a pass that only needs outlines; `None` for a material without one.
pub(crate) fn mask_group(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    material: &MaterialOnGpu,
    samplers: &Samplers,
) -> Option<wgpu::BindGroup> {
    let mask = material.mask()?;
    Some(gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("mask"),
        layout,
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(mask) },
            wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&samplers.maps) },
        ],
    }))
}

/// The layout of [`mask_group`].
pub(crate) fn mask_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    let entry =
        |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility: wgpu::ShaderStages::FRAGMENT, ty, count: None };
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("mask"),
        entries: &[
            entry(
                0,
                wgpu::BindingType::Texture {
                    sample_type: wgpu::TextureSampleType::Float { filterable: true },
                    view_dimension: wgpu::TextureViewDimension::D2,
                    multisampled: false,
                },
            ),
            entry(1, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
        ],
    })
}
