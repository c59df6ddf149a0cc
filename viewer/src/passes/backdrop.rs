//! A picture of everything around that is seen behind everything: a map that lights nothing, or a dome's look. It is
//! drawn first in the main pass, in the place of the background or the sky.

use crate::gpu::Gpu;
use crate::maps::{Level, upload_table};
use crate::passes::fullscreen;
use crate::passes::main::DEPTH;
use crate::passes::sky::{disk_radiance, pixel_rays};
use crate::scene::{Backdrop, Camera, SkyDome, Sun};
use crate::stats::RenderStatistics;
use glam::Vec3;

pub(crate) struct BackdropPass {
    pipeline: wgpu::RenderPipeline,
    rays: wgpu::Buffer,
    group: wgpu::BindGroup,
    turn: f32,
}

/// The dome whose look the picture is, with the lights of a frame.
pub(crate) struct Look<'a> {
    pub dome: &'a SkyDome,
    pub sun: Option<&'a Sun>,
    pub background: [f32; 3],
}

impl BackdropPass {
    pub(crate) fn new(gpu: &Gpu, backdrop: &Backdrop, msaa: u32, stats: &mut RenderStatistics) -> BackdropPass {
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
        let rays = gpu.uniform("backdrop", &[[[0.0f32; 4]; 6]]);
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
        BackdropPass { pipeline, rays, group, turn: backdrop.turn }
    }

    /// Takes over the camera of this frame and, of a dome's look, its lights.
    pub(crate) fn aim(&self, gpu: &Gpu, camera: &Camera, size: [u32; 2], seen: Option<&Look>) {
        let four = |v: Vec3, w: f32| [v.x, v.y, v.z, w];
        let (pixel, [corner, right, down]) = pixel_rays(camera, size);
        let strength = seen.map_or(1.0, |s| s.dome.strength);
        let horizon = seen.is_some_and(|s| s.dome.is_model());
        let sun = seen.and_then(|s| s.sun);
        let [r, g, b] = disk_radiance(sun);
        let below = seen.map_or([0.0; 3], |s| s.dome.ground.map_or(s.background, |g| g.map(|v| v * strength)));
        let uniform = [
            four(corner, self.turn),
            four(right, strength),
            four(down, f32::from(u8::from(horizon))),
            sun.map_or([0.0, 0.0, 1.0, 0.0], |s| four(s.direction.normalize(), s.radius)),
            [r, g, b, pixel],
            [below[0], below[1], below[2], 0.0],
        ];
        gpu.queue.write_buffer(&self.rays, 0, bytemuck::bytes_of(&uniform));
    }

    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, stats: &mut RenderStatistics) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.draw(0..3, 0..1);
        stats.draws += 1;
    }
}
