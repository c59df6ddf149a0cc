//! Fits shadow maps to what the adapter moves: see `fit.wgsl`.

use crate::gpu::Gpu;
use crate::passes::main::Frame;
use crate::passes::pose::{Kernel, PosePass};
use crate::passes::shadow::{STRIDE, depth};
use crate::shader::{Defines, assemble};
use glam::Vec3;
use wgpu::BufferUsages as Use;

/// Fits as many maps as there are directions to the sun.
pub(crate) struct FitPass {
    kernel: Kernel,
    lights: wgpu::Buffer,
    /// The matrices, as far apart as those of the shadow pass, and then the side of a texel.
    fitted: wgpu::Buffer,
    still: Vec<Vec3>,
    layers: usize,
    used: wgpu::Buffer,
    clearing: wgpu::RenderPipeline,
    /// The side of the maps' texture, and of its corner in which they are drawn (texels).
    resolution: u32,
    pub side: u32,
}

impl FitPass {
    /// `parts` are boxes on the adapter; `still` are the points of what casts shadows and does not move.
    pub(crate) fn new(
        gpu: &Gpu,
        parts: &wgpu::Buffer,
        directions: &[Vec3],
        still: Vec<Vec3>,
        resolution: u32,
    ) -> FitPass {
        let layers = directions.len();
        // As many invocations as make a GPU quick; a software adapter takes them one after the other.
        let wide = if gpu.groups { 256 } else { 64 };
        let defines = Defines::default().constant("LAYERS", layers as u32).constant("WIDE", wide);
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("fit"),
            source: wgpu::ShaderSource::Wgsl(assemble(include_str!("fit.wgsl"), &defines).into()),
        });
        let lights = gpu.buffer(
            "lights of shadow maps",
            bytemuck::cast_slice(&lights(directions, &still)),
            Use::STORAGE | Use::COPY_DST,
        );
        let fitted = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("fitted shadow maps"),
            size: (layers * STRIDE + 16) as u64,
            usage: Use::STORAGE | Use::COPY_SRC,
            mapped_at_creation: false,
        });
        let used = gpu.uniform("used part of shadow maps", &[[resolution as f32, 1.0, 0.0, 0.0]]);
        let resources = [(0, parts), (1, &lights), (2, &fitted), (3, &used)].map(|(k, b)| (k, b.as_entire_binding()));
        let kernel = Kernel::new(gpu, &module, "fit_maps", &resources, 1);
        let clearing = clearing(gpu);
        FitPass { kernel, lights, fitted, still, layers, used, clearing, resolution, side: resolution }
    }

    /// How many texels wide and high the maps have to be so that a texel is not wider than a pixel, which is `pixel` mm
    /// wide where it is narrowest: all, a half or a quarter of the texture's side, whose texels have the side `texel`.
    pub(crate) fn needed(&self, texel: f32, pixel: f32) -> u32 {
        // What is not a number becomes 0.
        self.resolution >> (pixel / texel).log2().clamp(0.0, 2.0) as u32
    }

    /// From the next fit on, draws the maps with another number of texels.
    pub(crate) fn set_side(&mut self, gpu: &Gpu, side: u32) {
        self.side = side;
        let share = side as f32 / self.resolution as f32;
        gpu.queue.write_buffer(&self.used, 0, bytemuck::bytes_of(&[side as f32, share, 0.0, 0.0]));
    }

    /// Moves the sun.
    pub(crate) fn set_sun(&self, gpu: &Gpu, directions: &[Vec3]) {
        gpu.queue.write_buffer(&self.lights, 0, bytemuck::cast_slice(&lights(directions, &self.still)));
    }

    /// Fits the maps to the boxes of a pose, and hands the matrices over: to the pass that draws them (`spaced`) and to
    /// the one that reads them (`packed`).
    pub(crate) fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        pose: Option<&PosePass>,
        spaced: &wgpu::Buffer,
        packed: &wgpu::Buffer,
    ) {
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            if let Some(pose) = pose {
                pose.enclose(&mut pass);
            }
            self.kernel.record(&mut pass);
        }
        for k in 0..self.layers as u64 {
            let at = k * STRIDE as u64;
            encoder.copy_buffer_to_buffer(&self.fitted, at, spaced, at, 64);
            encoder.copy_buffer_to_buffer(&self.fitted, at + 64, packed, 64 * k, 64);
        }
    }

    /// Restricts a map's pass to the corner in which it is drawn, and clears it.
    pub(crate) fn begin(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_viewport(0.0, 0.0, self.side as f32, self.side as f32, 0.0, 1.0);
        pass.set_pipeline(&self.clearing);
        pass.draw(0..3, 0..1);
    }

    /// Writes the side of a texel into a frame's constants.
    pub(crate) fn texel(&self, encoder: &mut wgpu::CommandEncoder, frame: &wgpu::Buffer) {
        let to = std::mem::offset_of!(Frame, shadow) as u64;
        encoder.copy_buffer_to_buffer(&self.fitted, (self.layers * STRIDE) as u64, frame, to, 4);
    }
}

/// Covers all that it is drawn into with the largest depth.
fn clearing(gpu: &Gpu) -> wgpu::RenderPipeline {
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("clearing"),
        source: wgpu::ShaderSource::Wgsl(include_str!("clearing.wgsl").into()),
    });
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("clearing"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("vertex"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(depth(wgpu::CompareFunction::Always)),
        multisample: Default::default(),
        fragment: None,
        multiview_mask: None,
        cache: None,
    })
}

/// For each map its axes, the direction to the sun, and the extents of what stands still.
fn lights(directions: &[Vec3], still: &[Vec3]) -> Vec<[[f32; 4]; 5]> {
    let one = |direction: &Vec3| {
        let (x, y) = direction.any_orthonormal_pair();
        let place = |p: &Vec3| Vec3::new(p.dot(x), p.dot(y), -p.dot(*direction));
        let nowhere = (Vec3::splat(1e30), Vec3::splat(-1e30));
        let (low, high) = still.iter().map(place).fold(nowhere, |(l, h), p| (l.min(p), h.max(p)));
        [x, y, *direction, low, high].map(|v| v.extend(0.0).to_array())
    };
    directions.iter().map(one).collect()
}
