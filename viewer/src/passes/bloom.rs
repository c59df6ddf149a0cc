//! Bloom: the light that a camera's lens scatters around what is bright. It changes only the 8-bit picture, never the
//! radiance, and only where a scene has it.

use crate::gpu::Gpu;
use crate::passes::fullscreen;
use crate::shader::{Defines, assemble};
use crate::stats::RenderStatistics;

/// The largest number of times that the picture is halved, and the fewest pixels along a side of the smallest half.
const MOST_HALVES: usize = 6;
const SMALLEST: u32 = 4;

/// The pipelines of the pass.
pub(crate) struct BloomPass {
    layouts: [wgpu::BindGroupLayout; 2],
    pipelines: [wgpu::RenderPipeline; 2],
    format: wgpu::TextureFormat,
    /// Share of the light that is scattered.
    pub share: f32,
}

/// What halves a picture, and what blends a picture with one of half its size.
#[derive(Clone, Copy)]
enum Step {
    Halve,
    Blend,
}

/// The textures for pictures of one size, and the steps that fill them.
pub(crate) struct Bloom {
    steps: Vec<(Step, wgpu::TextureView, wgpu::BindGroup)>,
    /// The picture with scattered light.
    pub radiance: wgpu::TextureView,
    /// Share of the light that is scattered.
    pub share: f32,
}

impl BloomPass {
    /// The pass for a picture with `msaa` samples a pixel, which scatters this share of the light (0 to 1).
    pub(crate) fn new(gpu: &Gpu, msaa: u32, share: f32, stats: &mut RenderStatistics) -> BloomPass {
        let texture = |binding| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty: wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable: false },
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
            count: None,
        };
        let uniform = wgpu::BindGroupLayoutEntry {
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            ..texture(2)
        };
        let layout = |entries: &[_]| {
            let label = Some("bloom");
            gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label, entries })
        };
        let layouts = [layout(&[texture(0)]), layout(&[texture(0), texture(1), uniform])];
        let format = gpu.hdr_format(msaa);
        let pipeline = |blends: bool| {
            let source = assemble(include_str!("bloom.wgsl"), &Defines::default().set("BLEND", blends));
            let layout = &layouts[usize::from(blends)];
            fullscreen::pipeline(gpu, "bloom", &source, layout, format, None, Default::default())
        };
        let pipelines = [pipeline(false), pipeline(true)];
        stats.pipeline("bloom");
        BloomPass { layouts, pipelines, format, share }
    }

    /// The textures and steps for a picture of this size.
    pub(crate) fn on(&self, gpu: &Gpu, picture: &wgpu::TextureView, width: u32, height: u32) -> Bloom {
        let texture = |width, height| {
            let made = gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("bloom"),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: self.format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            });
            made.create_view(&Default::default())
        };
        let group = |step: Step, fine: &wgpu::TextureView, coarse: Option<(&wgpu::TextureView, f32)>| {
            let view =
                |binding, view| wgpu::BindGroupEntry { binding, resource: wgpu::BindingResource::TextureView(view) };
            let share = gpu.uniform("share of the coarse picture", &[[coarse.map_or(0.0, |c| c.1), 0.0, 0.0, 0.0]]);
            let mut entries = vec![view(0, fine)];
            if let Some((coarse, _)) = coarse {
                entries.push(view(1, coarse));
                entries.push(wgpu::BindGroupEntry { binding: 2, resource: share.as_entire_binding() });
            }
            let layout = &self.layouts[step as usize];
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("bloom"), layout, entries: &entries })
        };
        let mut sizes = vec![[width, height]];
        while let Some([w, h]) = sizes.last().map(|s| s.map(|n| n.div_ceil(2)))
            && sizes.len() <= MOST_HALVES
            && w.min(h) >= SMALLEST
        {
            sizes.push([w, h]);
        }
        let mut steps = Vec::new();
        let mut halves: Vec<wgpu::TextureView> = vec![picture.clone()];
        for [w, h] in &sizes[1..] {
            let half = texture(*w, *h);
            steps.push((Step::Halve, half.clone(), group(Step::Halve, &halves[halves.len() - 1], None)));
            halves.push(half);
        }
        // All halves get the same share of the scattered light, and the picture keeps the rest.
        let mut sum = halves[halves.len() - 1].clone();
        for k in (0..halves.len() - 1).rev() {
            let share = if k == 0 { self.share } else { 1.0 - 1.0 / (halves.len() - k) as f32 };
            let blended = texture(sizes[k][0], sizes[k][1]);
            let own = group(Step::Blend, &halves[k], Some((&sum, share)));
            steps.push((Step::Blend, blended.clone(), own));
            sum = blended;
        }
        Bloom { steps, radiance: sum, share: self.share }
    }

    /// Scatters the light of the picture that was drawn last.
    pub(crate) fn draw(&self, encoder: &mut wgpu::CommandEncoder, bloom: &Bloom, stats: &mut RenderStatistics) {
        for (step, target, group) in &bloom.steps {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("bloom"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: target,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                depth_stencil_attachment: None,
                timestamp_writes: None,
                occlusion_query_set: None,
                multiview_mask: None,
            });
            pass.set_pipeline(&self.pipelines[*step as usize]);
            pass.set_bind_group(0, group, &[]);
            pass.draw(0..3, 0..1);
            stats.draws += 1;
        }
    }
}
