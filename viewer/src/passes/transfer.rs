//! The light that arrives at the anchors of a scene with a transfer: operator times light. The adapter computes it when
//! the light changes, and at no other time.

use crate::dome::{harmonic, norm};
use crate::gpu::Gpu;
use crate::scene::{RadianceTransfer, Scene, SkyDome, Sun};
use crate::stats::RenderStatistics;
use std::f64::consts::PI;

/// The operators, and the light that arrives through them.
pub(crate) struct TransferPass {
    /// The light of each row, which the main pass reads.
    pub arriving: wgpu::Buffer,
    light: wgpu::Buffer,
    group: wgpu::BindGroup,
    pipeline: wgpu::ComputePipeline,
    rows: u32,
    bands: Option<usize>,
    scale: f32,
    /// The light from which `arriving` was computed.
    now: Vec<[[f32; 4]; 2]>,
}

/// Sky and sun, as a transfer uses them.
#[derive(Clone, Copy)]
pub(crate) struct Lit<'a> {
    pub sky: Option<[f32; 3]>,
    pub dome: Option<&'a SkyDome>,
    pub sun: Option<&'a Sun>,
}

impl<'a> Lit<'a> {
    pub(crate) fn of(scene: &'a Scene) -> Lit<'a> {
        Lit { sky: scene.sky, dome: scene.dome.as_ref(), sun: scene.sun.as_ref() }
    }

    /// Two colours for each column: that of sky and sun together, and that of the sky alone.
    fn columns(&self, bands: Option<usize>, scale: f32) -> Vec<[[f32; 4]; 2]> {
        // The entries already contain the scene's own light.
        let Some(bands) = bands else { return vec![[[scale; 4], [0.0; 4]]] };
        let sun = |k: usize| {
            let (l, m) = order(k);
            self.sun.map_or([0.0; 3], |sun| {
                let y = harmonic(l, m, sun.direction.normalize().to_array().map(f64::from));
                sun.irradiance.map(|e| (f64::from(e) * y) as f32)
            })
        };
        let sky = |k: usize| match (self.dome, self.sky) {
            (Some(dome), _) => dome.harmonics.get(k).map_or([0.0; 3], |c| c.map(|v| dome.strength * v)),
            (None, Some(sky)) if k == 0 => sky.map(|v| (4.0 * PI).sqrt() as f32 * v),
            _ => [0.0; 3],
        };
        (0..bands * bands)
            .map(|k| {
                let (sun, sky) = (sun(k).map(|v| v * scale), sky(k).map(|v| v * scale));
                [[sun[0] + sky[0], sun[1] + sky[1], sun[2] + sky[2], 0.0], [sky[0], sky[1], sky[2], 0.0]]
            })
            .collect()
    }
}

/// Degree and order of coefficient `k`.
fn order(k: usize) -> (usize, isize) {
    let l = k.isqrt();
    (l, k as isize - (l * (l + 1)) as isize)
}

/// The entries as four half floats each. Rows of harmonics are multiplied by the factors that the shader's recurrence
/// leaves out.
fn packed(scene: &Scene, transfer: &RadianceTransfer) -> Vec<[u16; 4]> {
    let columns = columns(transfer);
    let mut factors = vec![1f32; transfer.entries.len() / columns];
    for instance in &scene.instances {
        let Some(anchors) = &scene.meshes[instance.mesh].anchors else { continue };
        let rows = anchors.rows as usize;
        for anchor in 0..anchors.count(instance.first_level) {
            for k in 6..rows {
                let (l, m) = order(k - 6);
                factors[instance.first_row as usize + anchor * rows + k] = norm(l, m.unsigned_abs()) as f32;
            }
        }
    }
    transfer
        .entries
        .chunks(columns)
        .zip(&factors)
        .flat_map(|(row, factor)| row.iter().map(move |e| e.map(|v| half::f16::from_f32(v * factor).to_bits())))
        .collect()
}

/// Number of columns of a transfer.
pub(crate) fn columns(transfer: &RadianceTransfer) -> usize {
    transfer.bands.map_or(1, |bands| bands * bands)
}

impl TransferPass {
    /// Uploads the operators and computes the light that arrives; `None` for a scene without a transfer.
    pub(crate) fn new(gpu: &Gpu, scene: &Scene, stats: &mut RenderStatistics) -> Option<TransferPass> {
        use wgpu::BufferUsages as Use;
        let transfer = scene.transfer.as_ref()?;
        let columns = columns(transfer);
        let rows = (transfer.entries.len() / columns) as u32;
        let packed = packed(scene, transfer);
        let bytes: &[u8] = bytemuck::cast_slice(&packed);
        stats.upload("transfer", bytes.len() as u64);
        let entries = gpu.buffer("transfer", bytes, Use::STORAGE);
        let light = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("light of the transfer"),
            size: 32 * columns as u64,
            usage: Use::STORAGE | Use::COPY_DST,
            mapped_at_creation: false,
        });
        let arriving = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("arriving light"),
            size: 16 * u64::from(rows.max(1)),
            usage: Use::STORAGE,
            mapped_at_creation: false,
        });
        let size = gpu.uniform("size of the transfer", &[[columns as u32, rows, 0, 0]]);
        let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
            count: None,
        };
        let read = wgpu::BufferBindingType::Storage { read_only: true };
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("transfer"),
            entries: &[
                entry(0, wgpu::BufferBindingType::Uniform),
                entry(1, read),
                entry(2, read),
                entry(3, wgpu::BufferBindingType::Storage { read_only: false }),
            ],
        });
        let bound: Vec<wgpu::BindGroupEntry> = [&size, &entries, &light, &arriving]
            .into_iter()
            .enumerate()
            .map(|(k, buffer)| wgpu::BindGroupEntry { binding: k as u32, resource: buffer.as_entire_binding() })
            .collect();
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("transfer"),
            layout: &layout,
            entries: &bound,
        });
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("transfer"),
            source: wgpu::ShaderSource::Wgsl(include_str!("transfer.wgsl").into()),
        });
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("transfer"),
            layout: Some(&gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("transfer"),
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            })),
            module: &module,
            entry_point: Some("main"),
            compilation_options: Default::default(),
            cache: None,
        });
        stats.pipeline("transfer");
        let RadianceTransfer { bands, scale, .. } = *transfer;
        let mut pass = TransferPass { arriving, light, group, pipeline, rows, bands, scale, now: Vec::new() };
        pass.set_light(gpu, &Lit::of(scene), stats);
        Some(pass)
    }

    /// Computes the light that arrives again if the light has changed.
    pub(crate) fn set_light(&mut self, gpu: &Gpu, lit: &Lit, stats: &mut RenderStatistics) {
        let columns = lit.columns(self.bands, self.scale);
        if columns == self.now {
            return;
        }
        gpu.queue.write_buffer(&self.light, 0, bytemuck::cast_slice(&columns));
        self.now = columns;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.group, &[]);
            // No dimension of a dispatch may exceed 65,535 groups.
            let groups = self.rows.div_ceil(64).max(1);
            let across = groups.min(1 << 15);
            pass.dispatch_workgroups(across, groups.div_ceil(across), 1);
        }
        gpu.queue.submit([encoder.finish()]);
        stats.transfers += 1;
    }
}
