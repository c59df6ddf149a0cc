//! Pipelines of passes that cover the whole picture with one triangle.

use crate::gpu::Gpu;

/// A pipeline with the `vertex` and `fragment` of `source` and one target. `depth` and `multisample` must be those of
/// the pass in which it is drawn.
pub(crate) fn pipeline(
    gpu: &Gpu,
    name: &str,
    source: &str,
    bindings: &wgpu::BindGroupLayout,
    target: wgpu::TextureFormat,
    depth: Option<wgpu::DepthStencilState>,
    multisample: wgpu::MultisampleState,
) -> wgpu::RenderPipeline {
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(name),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(name),
        bind_group_layouts: &[Some(bindings)],
        immediate_size: 0,
    });
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(name),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: depth,
        multisample,
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("fragment"),
            compilation_options: Default::default(),
            targets: &[Some(target.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}
