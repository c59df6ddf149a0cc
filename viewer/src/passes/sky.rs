//! The sky that is seen behind the leaves. It is drawn first in the main pass by a pipeline of its own, and only where
//! the scene has a dome.

use crate::gpu::Gpu;
use crate::passes::fullscreen;
use crate::passes::main::DEPTH;
use crate::scene::{Camera, SkyDome, Sun};
use crate::stats::RenderStatistics;
use glam::Vec3;

#[repr(C)]
#[derive(Debug, Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
struct Uniform {
    corner: [f32; 4],
    right: [f32; 4],
    down: [f32; 4],
    sun: [f32; 4],
    disk: [f32; 4],
    below: [f32; 4],
    scale: [f32; 4],
    perez: [[f32; 4]; 6],
}

pub(crate) struct SkyPass {
    pipeline: wgpu::RenderPipeline,
    uniform: wgpu::Buffer,
    group: wgpu::BindGroup,
}

/// Angle of a pixel (rad), and three vectors for a picture of this size: the ray through a place (pixels) has the
/// direction corner + x·right + y·down.
pub(crate) fn pixel_rays(camera: &Camera, size: [u32; 2]) -> (f32, [Vec3; 3]) {
    let forward = (camera.target - camera.eye).normalize();
    let pixel = 2.0 * camera.half_height() / size[1] as f32;
    let across = forward.cross(camera.up).normalize();
    let (right, down) = (across * pixel, forward.cross(across) * pixel);
    (pixel, [forward - 0.5 * (right * size[0] as f32 + down * size[1] as f32), right, down])
}

impl SkyPass {
    pub(crate) fn new(gpu: &Gpu, msaa: u32, stats: &mut RenderStatistics) -> SkyPass {
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("sky"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::FRAGMENT,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            }],
        });
        // The sky is drawn first, so the leaves cover it.
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
            "sky",
            include_str!("sky.wgsl"),
            &layout,
            gpu.hdr_format(msaa),
            Some(depth),
            samples,
        );
        stats.pipeline("sky");
        let uniform = gpu.uniform("sky", &[Uniform::default()]);
        stats.upload("sky", size_of::<Uniform>() as u64);
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("sky"),
            layout: &layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() }],
        });
        SkyPass { pipeline, uniform, group }
    }

    /// Takes over the camera and the lights of this frame.
    pub(crate) fn aim(
        &self,
        gpu: &Gpu,
        dome: &SkyDome,
        sun: Option<&Sun>,
        background: [f32; 3],
        camera: &Camera,
        size: [u32; 2],
    ) {
        let four = |v: Vec3, w: f32| [v.x, v.y, v.z, w];
        let (pixel, [corner, right, down]) = pixel_rays(camera, size);
        let radius = sun.map_or(0.0, |s| s.radius);
        let below = dome.ground.map_or(background, |g| g.map(|v| v * dome.strength));
        let mut perez = [[0.0; 4]; 6];
        for (k, [a, b, c, d, e]) in dome.perez.into_iter().enumerate() {
            (perez[2 * k], perez[2 * k + 1]) = ([a, b, c, d], [e, 0.0, 0.0, 0.0]);
        }
        let [r, g, b] = disk_radiance(sun);
        let s = dome.scale.map(|v| v * dome.strength);
        let uniform = Uniform {
            corner: four(corner, 0.0),
            right: four(right, 0.0),
            down: four(down, 0.0),
            sun: four(dome.sun.normalize(), radius),
            disk: [r, g, b, pixel],
            below: [below[0], below[1], below[2], 0.0],
            scale: [s[0], s[1], s[2], 0.0],
            perez,
        };
        gpu.queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
    }

    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, stats: &mut RenderStatistics) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.draw(0..3, 0..1);
        stats.draws += 1;
    }
}

/// Radiance of the sun's disk: E/(π sin²r), as far as a 16-bit target holds it; 0 without a sun or for a point.
pub(crate) fn disk_radiance(sun: Option<&Sun>) -> [f32; 3] {
    let share = |s: &Sun| std::f32::consts::PI * s.radius.sin() * s.radius.sin();
    let seen = sun.filter(|s| share(s) > 0.0);
    seen.map_or([0.0; 3], |s| s.irradiance.map(|e| (e / share(s)).min(6e4)))
}
